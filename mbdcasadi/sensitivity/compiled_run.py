"""A start, a motion and its outputs as one differentiable function of a vector of numbers."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..equations.numeric import NumericEquations
from ..errors import SimulationError, warn
from ..integrators import Integrator
from ..integrators.failures import reason_of
from ..kinematics.singular import describe_singularity
from ..model.cache import Cache
from ..model.mechanism import Mechanism
from ..numerics.console import call
from ..numerics.lazy import cached_property
from ..results.state import State
from ..simulation.changes.modes import SingleMode
from ..simulation.checks.accuracy import range_near_rounding, ranges, tolerance_for, unresolved_range
from ..simulation.contact.watched_terms import has_gaps
from ..simulation.path import Path, hermite_states
from ..simulation.simulate import chosen_integrator, suited_to_friction
from ..simulation.singular.regularity import singular_time
from .cuts import Cuts
from .design_variables import DesignVariables
from .differentiable_motion import DifferentiableMotion
from .differentiable_start import DifferentiableStart, found

#: Patterns of cuts for which compiled functions are kept.
PATTERNS = 16


class MotionSetup(Setup):
    """The arguments of an analysis that differentiates or repeats a motion.

    Parameters
    ----------
    initial, inputs, parameters
        As for :func:`simulate`.
    method, reltol, abstol
        The integrator; ``"auto"`` takes Runge–Kutta if the motion at the start is not stiff.
    keeps_abstol : bool, optional
        True if the absolute tolerance is the user's; by default it is if it is given, or an integrator is.

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
        initial: Any = (),
        inputs: Any = None,
        parameters: Any = None,
        method: Any = "idas",
        reltol: float | None = None,
        abstol: float | None = None,
        keeps_abstol: bool | None = None,
    ):
        super().__init__(
            mechanism,
            analysis,
            times=times,
            initial=initial,
            inputs=inputs,
            parameters=parameters,
            takes_duration=False,
        )
        self.differentiable_start = DifferentiableStart(self.numeric, initial, float(self.grid[0]), self.signals)
        _ = self.start[self.eom.a]  # raises where there are no accelerations
        integrator = chosen_integrator(method, SingleMode(self), reltol=reltol, abstol=abstol, analysis=analysis)
        self.integrator = suited_to_friction(integrator, self.numeric)
        own = abstol is not None or integrator is method
        self._analysis, self._keeps_abstol = analysis, own if keeps_abstol is None else keeps_abstol

    @cached_property
    def start(self) -> State:
        return self.differentiable_start.state

    def motion(
        self,
        varied: Collection[int],
        *,
        integrands: ca.SX | None = None,
        in_state: bool = True,
        reversible: bool = False,
    ) -> DifferentiableMotion:
        """Return the motion over the grid; see :class:`DifferentiableMotion`.

        An absolute tolerance that was not given is one that resolves the range of the motion at the values given.

        Warns
        -----
        MechanismWarning
            If the one that was given does not resolve it.
        """

        def motion_by(integrator: Integrator) -> DifferentiableMotion:
            return DifferentiableMotion(
                self, integrator, varied=varied, integrands=integrands, in_state=in_state, reversible=reversible
            )

        made = motion_by(self.integrator)
        finer = tolerance_for(ranges(made.poses), self.integrator.abstol)
        for sentence in range_near_rounding(made.poses):
            warn(f"{self._analysis}: {sentence}")
        if finer is None:
            return made
        if self._keeps_abstol:
            warn(f"{self._analysis}: {unresolved_range(made.poses, self.integrator.abstol)}")
            return made
        resolving = motion_by(self.integrator.replace(abstol=finer))
        if not len(resolving.poses):  # the forces are too rough for it
            warn(f"{self._analysis}: {unresolved_range(made.poses, self.integrator.abstol)}")
            return made
        self.integrator = self.integrator.replace(abstol=finer)
        return resolving

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
        known = [(q, tolerance_for(ranges(q), abstol)) for q in motions if len(q) and np.all(np.isfinite(q))]
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
        if has_gaps(setup.mechanism) and not setup.integrator.is_multistep:
            warn(
                f'derivatives by method="{setup.integrator.name}" through contacts are those of its steps, which the '
                "error test does not control: through hard ones they may be off by tens of a per cent while the motion "
                'is right; use method="idas"'
            )
        self.motion = setup.motion(self.design.varied, integrands=integrands, reversible=reversible)
        self.guess = start.guess
        self._expressions = list(expressions)
        self.rows = sum(e.numel() for e in self._expressions)
        d = ca.MX.sym("d", self.design.size)
        self._given = ca.Function("given", [d], list(self.design.arguments(d)))
        self._outputs = self.motion.outputs(expressions)
        self._compiled = Cache(PATTERNS)

    def values(self, d: np.ndarray) -> np.ndarray:
        """All outputs (n_y n_t + integrals,), time by time.

        Raises
        ------
        ModelError
            For parameters beyond what the model allows.
        SimulationError
            If no start is found near the last one, or the integrator stops.
        """
        self.setup.mechanism.check_values(self.design.parameters(d))
        course = self._course(d)
        y, states, residual, solution = self._call(self._of(course).function, d, self.guess, *course.arguments)
        self._refuse_no_start(float(residual), d)
        if not self.motion.reached(states.full()):
            raise SimulationError(self._stopped(d, "the step size became too small, or a value was not finite"))
        self.guess = solution.full().ravel()
        return y.full().ravel()

    def forward(self, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Outputs and their derivatives (n, n_d), by forward sensitivities."""
        y = self.values(d)
        return y, self._slopes(d, y)

    def _slopes(self, d: np.ndarray, y: np.ndarray) -> np.ndarray:
        course, size = self._course(d), self.design.size
        arguments = [self.guess, *course.arguments]
        function = self._of(course).derivative("forward", size)
        lengths = lengths_of(np.eye(size), d)
        slope = self._call(function, d, *arguments, y, np.diag(lengths), *still(arguments, size))
        slopes: np.ndarray = slope.full() / lengths
        return slopes

    def adjoint(self, d: np.ndarray, weights: np.ndarray, y: np.ndarray) -> np.ndarray:
        """``weights^T dY/dd`` (n_d,), by one adjoint integration, or forward if that could pass over a load.

        CasADi limits no steps of IDAS backwards in time: where the adjoint rests they grow, and pass over loads that
        are short.
        """
        course = self._course(d)
        if self.motion.load_limit.max_step is not None and self.setup.integrator.is_multistep:
            return weights @ self._slopes(d, y)
        function = self._of(course).derivative("reverse", 1)
        try:
            found = call(function, d, self.guess, *course.arguments, y, weights)
        except RuntimeError as error:
            raise SimulationError(self._stopped_backwards(d, course, reason_of(error))) from None
        return found[0].full().ravel()

    def _stopped_backwards(self, d: np.ndarray, course: Cuts, why: str) -> str:
        """Message on an adjoint integration that failed; a singular pose on the way is a likely cause."""
        states = self._call(self._of(course).function, d, self.guess, *course.arguments)[1].full()
        eom = self.setup.eom
        n, k = eom.q.numel(), eom.q.numel() + eom.v.numel() + eom.z.numel()
        path = Path(self.setup.grid, states[:k].T, np.zeros((0, 0)))
        numeric = NumericEquations(eom, self.design.parameters(d))
        time = singular_time(numeric, path)
        if time is not None:
            pose = hermite_states(path, np.array([time]), n)[0, :n]
            rows = describe_singularity(numeric, time, pose).rows
            why += (
                f", beside a pose near t = {time:.3g} s in which {', '.join(rows)} depend on each other and the "
                "mechanism could fold: the adjoint equations are singular there"
            )
        remedy = 'take method="erk", larger tolerances, or more output times'
        return f"the adjoint integration stopped at {self._where(d)}: {why}; {remedy}"

    # --- the course ---------------------------------------------------------------------------
    def _course(self, d: np.ndarray) -> Cuts:
        """The cuts of the motion."""
        p, right, z, levels, channel = (part.full() for part in self._given(d))
        start = None
        if self.motion.needs_start:
            x, _, residual = self._call(self.setup.differentiable_start.function, p, right, z, self.guess)
            self._refuse_no_start(float(residual), d)
            start = x.full().ravel()
        return self.motion.course(start, p.ravel(), levels.ravel(), channel)

    def _of(self, course: Cuts) -> Compiled:
        """The compiled run for a course and others of its pattern."""
        return self._compiled.get_or_create(course.pattern, lambda: Compiled(self._function(course), 1), bounded=True)

    def _function(self, course: Cuts) -> ca.Function:
        """``(d, guess, cuts, sides, borders) -> (y, X, residual of the start, its solution)``."""
        start, motion = self.setup.differentiable_start, self.motion
        d, guess = ca.MX.sym("d", self.design.size), ca.MX.sym("guess", self.guess.size)
        arguments = course.symbols
        p, right, z, levels, channel = self._given(d)
        x0, solution, residual = start.function(p, right, z, guess)
        states, _ = motion.motion(course)(x0, p, levels, channel, *arguments)
        outputs = self._outputs(states, p, levels, channel)
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

    def _call(self, function: ca.Function, *arguments: Any) -> Any:
        try:
            return call(function, *arguments)
        except RuntimeError as error:
            raise SimulationError(self._stopped(arguments[0], reason_of(error))) from None

    def _stopped(self, d: np.ndarray, why: str) -> str:
        return (
            f"the integrator stopped at {self._where(d)}: {why}; simulate with these values says where and why; if it "
            "reaches the end, a force has no finite derivative on the way, as a root or a power below one at zero"
        )

    def _where(self, d: np.ndarray) -> str:
        parts = [
            f"{e.label} = {d[low]:.6g}" + (" …" if e.size > 1 else "")
            for e, low in zip(self.design.entries, self.design.places[:-1], strict=True)
        ]
        return ", ".join(parts)


class Compiled:
    """A compiled function and its derivatives, for one pattern of cuts.

    Parameters
    ----------
    outputs : int, optional
        Number of its outputs, from the first, that are differentiated; by default all.
    """

    def __init__(self, function: ca.Function, outputs: int | None = None):
        self.function = function
        arguments = function.mx_in()
        self._values = function if outputs is None else ca.Function("values", arguments, function(*arguments)[:outputs])
        self._derivatives: dict[tuple[str, int], ca.Function] = {}

    def derivative(self, kind: str, count: int) -> ca.Function:
        """Derivatives, "forward" or "reverse", in a number of directions."""
        if (kind, count) not in self._derivatives:
            self._derivatives[kind, count] = getattr(self._values, kind)(count)
        return self._derivatives[kind, count]


def lengths_of(directions: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return how far forward sensitivities go along directions, for the size of which their results are divided (k,).

    The error test of an integrator compares a derivative with its absolute tolerance, below which a derivative by a
    stiffness of 1e6 N/m would be as a whole: the derivative by its relative change is what counts.

    Parameters
    ----------
    directions : numpy.ndarray
        By column (n, k).
    values : numpy.ndarray
        Values of what changes along them (n,).
    """
    lengths: np.ndarray = np.max(np.abs(directions * values[:, None]), axis=0, initial=1.0)
    return lengths


def still(arguments: Sequence[np.ndarray], count: int) -> list[np.ndarray]:
    """Seeds of arguments that do not change in any of a number of directions."""
    return [np.zeros((ca.DM(a).size1(), count * ca.DM(a).size2())) for a in arguments]
