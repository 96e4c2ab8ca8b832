"""A start, a motion and its outputs as one differentiable function of a vector of numbers."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..assembly.setup import Setup, kept_numeric
from ..errors import SimulationError, warn
from ..integrators import RungeKutta
from ..integrators.failures import reason_of
from ..model.cache import Cache
from ..model.mechanism import Mechanism
from ..numerics.console import call
from ..numerics.lazy import cached_property
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.changes.modes import SingleMode
from ..simulation.checks.accuracy import range_near_rounding, ranges_of, tolerance_for, unresolved_range
from ..simulation.path import Path
from ..simulation.simulate import chosen_integrator, suited_to_friction
from ..simulation.singular.regularity import Regularity, folding_pose, turns_far
from .cuts import Cuts
from .derivatives import Compiled, lengths_of
from .design_variables import DesignVariables
from .differentiable_motion import DifferentiableMotion
from .differentiable_start import DifferentiableStart, found
from .reference_run import REMEMBERED, is_near, simulated

#: Difference from the motion that continues smoothly, in sizes of the coordinates, from which one is on another branch.
BRANCH_TOLERANCE = 1e-2
#: Patterns of cuts for which compiled functions are kept.
PATTERNS = 16


class MotionSetup(Setup):
    """The arguments of an analysis that differentiates or repeats a motion.

    Parameters
    ----------
    method, reltol, abstol
        The integrator; ``"auto"`` takes an explicit one if the motion at the start is not stiff, that of CasADi if one
        in C does not lead through the motion.
    keeps_abstol : bool, optional
        True if the absolute tolerance is the user's; by default it is if it is given, or an integrator is.
    **arguments
        ``initial``, ``inputs`` and ``parameters``, as for :class:`Setup`.

    Attributes
    ----------
    integrator : Integrator
        Method and tolerances.
    differentiable_start : DifferentiableStart
        The start as a function.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        analysis: str,
        times: Any,
        *,
        method: Any = "idas",
        reltol: float | None = None,
        abstol: float | None = None,
        keeps_abstol: bool | None = None,
        **arguments: Any,
    ):
        super().__init__(mechanism, analysis, times=times, takes_duration=False, **arguments)
        self.differentiable_start = DifferentiableStart(self.numeric, self.initial, self.time, self.signals)
        _ = self.start[self.eom.a]  # raises where there are no accelerations
        chooses = isinstance(method, str) and method == "auto"
        in_c = self._in_c() if chooses else None
        integrator = chosen_integrator(
            method, SingleMode(self), reltol=reltol, abstol=abstol, analysis=analysis, in_c=in_c
        )
        self.integrator = suited_to_friction(integrator, self.numeric)
        stated = abstol is not None or integrator is method
        self._is_tried = chooses and self.integrator.whole_run is not None
        self._analysis, self._keeps_abstol = analysis, stated if keeps_abstol is None else keeps_abstol

    def _in_c(self) -> Sequence[ca.SX] | None:
        """What methods in C would evaluate beside the equations; None if the analysis takes none for this mechanism."""
        return None

    @cached_property
    def start(self) -> State:
        return self.differentiable_start.state

    def motion(self, varied: Collection[int], **options: Any) -> DifferentiableMotion:
        """Return the motion over the grid; for the options see :class:`DifferentiableMotion`.

        An absolute tolerance that was not given is one that resolves the range of the motion at the values given.

        Warns
        -----
        MechanismWarning
            If the one that was given does not resolve it.
        """
        given = self.integrator
        made = DifferentiableMotion(self, given, varied=varied, **options)
        if self._is_tried and not len(made.poses):  # as through a pose in which the linkage could fold
            given = self.integrator = RungeKutta(*given.tolerances)
            made = DifferentiableMotion(self, given, varied=varied, **options)
        for sentence in range_near_rounding(made.poses):
            warn(f"{self._analysis}: {sentence}")
        if not self.resolve_all([made.poses]):
            return made
        resolving = DifferentiableMotion(self, self.integrator, varied=varied, **options)
        if len(resolving.poses):
            return resolving
        self.integrator = given  # the forces are too rough for a finer one
        warn(f"{self._analysis}: {unresolved_range(made.poses, given.abstol)}")
        return made

    def resolve_all(self, motions: Sequence[np.ndarray]) -> bool:
        """Take an absolute tolerance that resolves the range of each of some motions; True if it is another one.

        Parameters
        ----------
        motions : sequence of numpy.ndarray
            Coordinates by output (n_t, n); without outputs, or with NaN, one does not count.

        Warns
        -----
        MechanismWarning
            If the tolerance was given, and does not resolve the smallest one.
        """
        abstol = self.integrator.abstol
        known = [(q, tolerance_for(ranges_of(q), abstol)) for q in motions if len(q) and np.all(np.isfinite(q))]
        small = [(finer, q) for q, finer in known if finer is not None]
        if not small:
            return False
        finer, q = min(small, key=lambda entry: entry[0])
        if self._keeps_abstol:
            warn(f"{self._analysis}: {unresolved_range(q, abstol)}")
            return False
        self.integrator = self.integrator.replace(abstol=finer)
        return True


class CompiledRun:
    """Outputs as a function of a design vector, with derivatives forward and adjoint.

    Parameters
    ----------
    wrt : sequence
        See :class:`DesignVariables`.
    expressions : sequence of casadi.SX
        Outputs.
    integrands : casadi.SX, optional
        Expressions whose integrals over the run are outputs too: the last rows at the last time.
    reversible : bool
        True if :meth:`adjoint` is called.
    """

    def __init__(
        self,
        setup: MotionSetup,
        wrt: Any,
        expressions: Sequence[ca.SX],
        integrands: ca.SX | None = None,
        *,
        reversible: bool = False,
    ):
        start = setup.differentiable_start
        self.setup = setup
        self.design = DesignVariables(wrt, setup, start)
        self.motion = setup.motion(self.design.varied, integrands=integrands, reversible=reversible)
        if self.motion.roots:
            warn(
                f'derivatives by method="{setup.integrator.name}" through {", ".join(self.motion.roots)} are those of '
                "its steps, which the error test does not control: where a power of a penetration begins they may be "
                'off by per cent while the motion is right; use method="idas"'
            )
        self.guess = start.guess
        self._expressions = list(expressions)
        self.rows = sum(e.numel() for e in self._expressions)
        self._outputs = self.motion.outputs(expressions)
        self._compiled = Cache(PATTERNS)
        #: values at which a simulation has passed no pose in which the mechanism could fold
        self._regular: deque[np.ndarray] = deque(maxlen=REMEMBERED)

    def values(self, d: np.ndarray) -> np.ndarray:
        """All outputs (n_y n_t + integrals,), time by time.

        Raises
        ------
        ModelError
            For parameters beyond what the model allows.
        SimulationError
            If no start is found near the last one, the integrator stops, or the motion leaves for another branch in a
            pose in which the mechanism could fold.
        """
        self.setup.mechanism.check_values(self.design.parameters(d))
        course = self._course(d)
        y, states, residual, solution = self._run(course, d)
        self._refuse_no_start(float(residual), d)
        if not self.motion.reached(states.full()):
            raise SimulationError(self._stopped(d, "the step size became too small, or a value was not finite"))
        self._refuse_other_branch(d, states.full())
        self.guess = solution.full().ravel()
        return y.full().ravel()

    def forward(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and their derivatives (n, n_d), by forward sensitivities."""
        y = self.values(d)
        return y, self._slopes(d, y)

    def _slopes(self, d: np.ndarray, y: np.ndarray) -> np.ndarray:
        course, lengths = self._course(d), lengths_of(np.eye(d.size), d)
        arguments = [d, self.guess, *course.arguments]
        with self._stops_at(d):
            slopes: np.ndarray = self._of(course).changes(arguments, [y], np.diag(lengths)).full()
        return slopes / lengths

    def adjoint(self, d: np.ndarray, weights: np.ndarray, y: np.ndarray) -> np.ndarray:
        """``weights^T dY/dd`` (n_d,), by one adjoint integration, or forward if that could pass over a load, and in C.

        CasADi limits no steps of IDAS backwards in time: where the adjoint rests they grow, and pass over loads that
        are short.
        """
        course = self._course(d)
        grows = self.motion.load_limit.max_step is not None and self.setup.integrator.is_multistep
        if grows or self.motion.held.compiled.only_forward:
            return weights @ self._slopes(d, y)
        try:
            return self._of(course).adjoint([d, self.guess, *course.arguments], y, weights)
        except RuntimeError as error:
            raise SimulationError(self._stopped_backwards(d, course, reason_of(error))) from None

    def _stopped_backwards(self, d: np.ndarray, course: Cuts, why: str) -> str:
        """Message on an adjoint integration that failed; a singular pose on the way is a likely cause."""
        pose = self._folding_pose(d, self._path(self._run(course, d)[1].full()))
        if pose is not None:
            why += f", beside {pose}: the adjoint equations are singular there"
        remedy = 'take method="erk", larger tolerances, or more output times'
        return f"the adjoint integration stopped at {self._where(d)}: {why}; {remedy}"

    # --- singular poses on the way ----------------------------------------------------------------
    def _path(self, states: np.ndarray) -> Path:
        eom = self.setup.eom
        size = eom.q.numel() + eom.v.numel() + eom.z.numel()
        return Path(self.setup.grid, states[:size].T, np.zeros((0, 0)))

    @cached_property
    def _regularity(self) -> Regularity:
        return Regularity(self.setup.numeric, self.setup.start.t, self.setup.start.q)

    def _folding_pose(self, d: np.ndarray, path: Path) -> str | None:
        """Description of a pose of a motion in which the mechanism could fold; None if there is none."""
        return folding_pose(self._regularity, path, kept_numeric(self.setup.eom, self.design.parameters(d)))

    def _refuse_other_branch(self, d: np.ndarray, states: np.ndarray) -> None:
        """Raise if the motion is not the one that continues smoothly in a pose in which the mechanism could fold."""
        if not self.setup.eom.has_loops:
            return
        setup, path = self.setup, self._path(states)
        pose = self._folding_pose(d, path)
        if pose is None and (not turns_far(path, setup.eom) or is_near(d, self._regular)):
            return
        motion, passed = self._smooth(d, path.x[0])
        pose = pose or passed
        if pose is None:
            self._regular.append(d.copy())
            return
        smooth = motion.q
        apart = np.abs(smooth - path.x[:, : smooth.shape[1]])
        misses = apart / kept_numeric(setup.eom, self.design.parameters(d)).scale.coordinates
        if np.max(misses) > BRANCH_TOLERANCE:
            row, column = np.unravel_index(np.argmax(misses), misses.shape)
            raise SimulationError(
                f"the motion passes {pose}, and leaves for another branch at {self._where(d)}: "
                f"{setup.eom.coordinate_names[column]} is off by {apart[row, column]:.3g} at t = "
                f"{setup.grid[row]:.6g} s from the motion of simulate, which continues smoothly; end the run before "
                'that pose, or take smaller reltol= and abstol=, or method="erk"'
            )

    def _smooth(self, d: np.ndarray, start: np.ndarray) -> tuple[Trajectory, str | None]:
        """The motion of simulate from a start, and the first pose that it passes in which the mechanism could fold."""
        _, _, p, levels, channel = (part.full() for part in self.design.function(d))
        at_values = self.setup.at_values(self.setup.grid, RunValues(p.ravel(), levels.ravel(), channel))
        motion, passages = simulated(at_values, self.setup.integrator, start)
        return motion, f"a pose near t = {passages[0]:.3g} s in which the mechanism could fold" if passages else None

    def _pose_beside(self, d: np.ndarray) -> str | None:
        """Pose in which the mechanism could fold on the way of a motion that stopped; None if none is known."""
        if not self.setup.eom.has_loops:
            return None
        try:
            return self._smooth(d, self._start_at(d))[1]
        except (RuntimeError, SimulationError):
            return None

    def _start_at(self, d: np.ndarray) -> np.ndarray:
        """State at the start."""
        right, z, p, *_ = (part.full() for part in self.design.function(d))
        x, _, residual = call(self.setup.differentiable_start.function, p, right, z, self.guess)
        self._refuse_no_start(float(residual), d)
        return x.full().ravel()

    # --- the course ---------------------------------------------------------------------------
    def _course(self, d: np.ndarray) -> Cuts:
        """The cuts of the motion."""
        _, _, p, levels, channel = (part.full() for part in self.design.function(d))
        start = None
        if self.motion.needs_start:
            with self._stops_at(d):
                start = self._start_at(d)
        return self.motion.course(start, RunValues(p.ravel(), levels.ravel(), channel))

    def _run(self, course: Cuts, d: np.ndarray) -> Any:
        """Outputs, states, residual of the start, and its solution."""
        run = self._of(course)
        with self._stops_at(d):
            return run(d, self.guess, *course.arguments)

    def _of(self, course: Cuts) -> Compiled:
        """The compiled run for a course and others of its pattern."""
        return self._compiled.get_or_create(course.pattern, lambda: Compiled(self._function(course), 1), bounded=True)

    def _function(self, course: Cuts) -> ca.Function:
        """``(d, guess, cuts, sides, borders) -> (y, X, residual of the start, its solution)``."""
        start, motion = self.setup.differentiable_start, self.motion
        d, guess = ca.MX.sym("d", self.design.size), ca.MX.sym("guess", self.guess.size)
        arguments = course.symbols
        right, z, *values = self.design.function(d)
        x0, solution, residual = start.function(values[0], right, z, guess)
        states, _ = motion.motion(course)(x0, *values, *arguments)
        outputs = self._outputs(states, *values)
        totals = states[-1 - motion.integrals : -1, -1]
        return ca.Function(
            "run", [d, guess, *arguments], [ca.vertcat(ca.vec(outputs), totals), states, residual, solution]
        )

    def _refuse_no_start(self, residual: float, d: np.ndarray) -> None:
        if not found(residual):
            raise SimulationError(
                f"no start that meets the constraints and initial= was found at {self._where(d)}: "
                "the linkage does not reach there, or the values are too far from the last ones"
            )

    @contextmanager
    def _stops_at(self, d: np.ndarray) -> Iterator[None]:
        """Report where an integration that fails was."""
        try:
            yield
        except RuntimeError as error:
            raise SimulationError(self._stopped(d, reason_of(error))) from None

    def _stopped(self, d: np.ndarray, why: str) -> str:
        pose = self._pose_beside(d)
        if pose is not None:
            return (
                f"the integrator stopped at {self._where(d)}: {why}; the motion passes {pose}; end the run before that "
                'pose, or take smaller reltol= and abstol=, or method="erk"'
            )
        folds = ', or the linkage passes a pose in which it could fold: take method="erk"'
        return (
            f"the integrator stopped at {self._where(d)}: {why}; simulate with these values says where and why; if it "
            "reaches the end, a force has no finite derivative on the way, as a root or a power below one at zero"
            f"{folds if self.motion.held.compiled.only_forward else ''}"
        )

    def _where(self, d: np.ndarray) -> str:
        parts = [
            f"{e.label} = {d[low]:.6g}" + (" …" if e.size > 1 else "")
            for e, low in zip(self.design.entries, self.design.places[:-1], strict=True)
        ]
        return ", ".join(parts)
