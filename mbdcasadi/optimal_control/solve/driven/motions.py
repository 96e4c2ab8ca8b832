"""Motions of mechanisms with an input for each coordinate, and those of least effort among them.

The motion of least effort of an arm of many driven joints is fast. A program that sees its inputs at the stages alone
then has optima whose inputs are anything in between: no motions at all. Here the inputs follow from the motion, at more
points than the stages, so that what is minimised is the effort of a motion. There are no conditions, the cost is a sum
of squares, and its matrices are banded: a step takes a hundredth of the time of that of an interior-point method.

References
----------
Ferrolho, Ivan, Merkt, Havoutis, Vijayakumar, "Inverse dynamics vs. forward dynamics in direct transcription
formulations for trajectory optimization", IEEE ICRA 2021.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ....results.state import State
from ...poses.linear_conditions import state_by_linear_conditions
from ...problem import OptimalControlProblem
from ...program.collocation_program import CollocationProgram
from ...program.setup import PhaseSetup
from ...statement.phase import on_states
from .effort import Effort, effort_of
from .inverse_dynamics import InverseDynamics
from .mesh_effort import MeshEffort
from .spline import MotionSpline

#: Number of coordinates from which ways between two states differ so much in their effort that they are compared.
MANY = 3
#: Number of intervals that the coarsest mesh has at least, and decrease in a step, as a share of the effort, at which
#: a coarse mesh is left, and at which the last one is.
COARSEST, COARSE_TOLERANCE, TOLERANCE = 10, 1e-2, 5e-6
#: Least and largest number of steps after which a search on a mesh ends, and their work between these, the number of
#: intervals times the cube of that of coordinates: in long curved valleys more of them lower the effort by little.
STEPS, WORK = (50, 500), 5e6


@dataclass(frozen=True)
class FoundMotion:
    """A motion of least effort on a mesh."""

    #: scaled variables of the program
    x: np.ndarray
    #: integral of the sum of squares in the running cost, with the inputs that the motion needs between the stages
    effort: float
    #: derivatives of the cost by the first and the last state, each (2 n,)
    pulls: tuple[np.ndarray, np.ndarray]
    #: steps on the mesh
    iterations: int
    #: whether the effort falls no more, but by a share below :data:`TOLERANCE` in a step
    converged: bool


class DrivenMotions:
    """Motions of a phase from a state to another one, and the effort that they take.

    Parameters
    ----------
    setup : PhaseSetup
        Of a phase with an input for each independent coordinate, and no rows.
    effort : Effort
        Its running cost.
    ends : tuple of numpy.ndarray
        Independent coordinates and velocities at the start and at the end, each (2 n,).
    """

    def __init__(self, setup: PhaseSetup, effort: Effort, ends: tuple[np.ndarray, np.ndarray]):
        self.setup, self.effort, self.ends = setup, effort, ends
        eom = setup.scheme.eom
        self.dynamics, self.scales = InverseDynamics(setup.loads), setup.scales.of(eom.independent, eom.rows)

    @classmethod
    def of(cls, problem: OptimalControlProblem, setup: PhaseSetup, start: State) -> DrivenMotions | None:
        """The motions of the only phase of a problem without limits.

        None if inputs do not follow from the motion, or more is demanded of it than its ends.
        """
        phase, eom = setup.phase, setup.scheme.eom
        prescribed = [condition for condition in phase.path if condition.equality]
        demands = [problem.free_parameters, problem.boundary, phase.waypoints, prescribed, setup.extra_parameters]
        if any(len(demand) for demand in demands) or not problem.terminal_cost.is_zero():
            return None
        if not _follow_from_motion(setup) or phase.span[0] != phase.span[1] or setup.ends.initial is not None:
            return None
        end, effort = _end_of(setup), effort_of(eom, phase.running_cost, setup.numeric.p)
        if end is None or effort is None:
            return None
        first, last = (np.r_[q[eom.independent], v[eom.independent]] for q, v in ((start.q, start.v), end))
        return cls(setup, effort, (first, last))

    def effort_on(self, spline: MotionSpline) -> MeshEffort:
        """The effort on a mesh."""
        return MeshEffort(self.dynamics, self.effort, spline, self.scales.a)

    def _steps(self, count: int) -> int:
        """Largest number of steps on a mesh of so many intervals."""
        return int(np.clip(WORK / (count * self.dynamics.n**3), *STEPS))

    def spline(self, times: np.ndarray) -> MotionSpline:
        """The motions on a mesh with points at times."""
        return MotionSpline(times, self.setup.scheme.degree, self.ends)

    @property
    def least(self) -> float:
        """Cost of a motion without effort, what the sum of squares in the running cost leaves."""
        first, last = self.setup.path.segment_times[[0, -1]].tolist()
        return self.effort.least * float(last - first)

    # --- near a guess -----------------------------------------------------------------------
    def search(
        self,
        program: CollocationProgram,
        x: np.ndarray,
        times: np.ndarray,
        *,
        coarse_first: bool,
        stopped: Callable[[], bool],
    ) -> FoundMotion | None:
        """The motion of least effort near a guess; None if inputs do not follow from the motion.

        Parameters
        ----------
        program : CollocationProgram
            Program on the mesh.
        x : numpy.ndarray
            Scaled variables of the guess.
        times : numpy.ndarray
            Mesh points, s.
        coarse_first : bool
            True to begin on coarse meshes, as from a guess that is far from a solution.
        stopped : callable
            True if the user wants it to end.
        """
        count = times.size - 1
        strides = [2**k for k in range(count.bit_length()) if coarse_first and count // 2**k >= COARSEST] or [1]
        splines = [self.spline(times[np.unique(np.r_[np.arange(0, count, k), count])]) for k in reversed(strides)]
        states, accelerations = self._read(program, x)
        coarsest = splines[0]
        if coarsest.count == count:
            unknowns = coarsest.with_accelerations(states, accelerations)
        else:
            unknowns = coarsest.through(states[np.searchsorted(times, coarsest.times)])
        try:
            for spline, finer in itertools.pairwise(splines):
                unknowns = finer.like(
                    spline, self.effort_on(spline).end(unknowns, COARSE_TOLERANCE, STEPS[0], stopped).x
                )
            effort = self.effort_on(splines[-1])
            end = effort.end(unknowns, TOLERANCE, self._steps(count), stopped)
            found, pulls = self._variables(program, x, splines[-1], end.x), effort.pulls(end.x)
        except np.linalg.LinAlgError:
            return None
        if not np.isfinite(end.value):
            return None
        return FoundMotion(found, end.value, pulls, end.iterations, end.converged)

    def effort_of(self, program: CollocationProgram, x: np.ndarray, times: np.ndarray) -> float:
        """The effort of a motion in scaled variables of a program, as that of :meth:`search`; infinite without one."""
        spline = self.spline(times)
        states, accelerations = self._read(program, x)
        try:
            return self.effort_on(spline).value(spline.with_accelerations(states, accelerations))
        except np.linalg.LinAlgError:
            return np.inf

    def multipliers(
        self, program: CollocationProgram, found: FoundMotion, data: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Scaled multipliers of bounds and rows: of the first state and of the conditions at the end, others are zero.

        They are the derivatives of the effort by what these demand; windows that keep to a branch of a linkage do not.
        """
        phase, states = program.phases[0], 2 * self.dynamics.n
        of_bounds, of_rows = np.zeros(program.size), np.zeros(program.lower.size)
        first, last = (phase.point_index(k)[:states] for k in (0, phase.count))
        by_first, by_last = (
            pull * program.scale[at] / program.cost_scale for pull, at in zip(found.pulls, (first, last), strict=True)
        )
        of_bounds[first] = -by_first
        demands = [k for k, row in enumerate(program.rows) if row.condition and row.equality]
        slopes = program.nlp.derivatives["jac_g"](found.x, data)[1].sparse()[demands][:, last].toarray()
        of_rows[demands] = np.linalg.lstsq(slopes.T, -by_last, rcond=None)[0]
        return of_bounds, of_rows

    def _read(self, program: CollocationProgram, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """States at the mesh points (N + 1, 2 n) and accelerations at the stages (N, degree, n) of scaled variables."""
        phase, scheme, values = program.phases[0], self.setup.scheme, x * program.scale
        states = values[phase.point_index(np.arange(phase.count + 1)[:, None])[:, : 2 * self.dynamics.n]]
        states[0], states[-1] = self.ends
        inner = phase.inner_index(np.arange(phase.count)[:, None])[:, scheme.interval_slice("a")]
        return states, values[inner].reshape(phase.count, scheme.degree, self.dynamics.n)

    def _variables(
        self, program: CollocationProgram, guess: np.ndarray, spline: MotionSpline, x: np.ndarray
    ) -> np.ndarray:
        """Scaled variables of a program that are the motion; others are those of a guess."""
        phase, scheme, found = program.phases[0], self.setup.scheme, guess * program.scale
        n, count = spline.n, spline.count
        states = np.vstack([spline.by_interval(x)[:, : 2 * n], self.ends[1]])
        found[phase.point_index(np.arange(count + 1)[:, None])[:, : 2 * n]] = states
        times, shapes = spline.points(scheme.stages)
        places = spline.places(x, shapes)
        u, _ = self.dynamics.inputs(times, places)
        inner = phase.inner_index(np.arange(count)[:, None])
        found[inner[:, scheme.interval_slice("a")]] = places[:, 2].reshape(count, -1)
        unknowns = scheme.inputs.unknowns(u.reshape(count, -1, n))
        found[inner[:, scheme.interval_slice("u")]] = unknowns.reshape(count, -1)
        return found / program.scale

    def values(self, spline: MotionSpline, x: np.ndarray, times: np.ndarray) -> dict[str, np.ndarray]:
        """Values of a motion by name at times, of all coordinates and inputs, each (k, size)."""
        eom, places = self.setup.scheme.eom, spline.at(x, times)
        q, v = eom.states(times, places[:, 0], places[:, 1], self.setup.numeric.p)
        a, z = np.zeros_like(q), np.zeros((times.size, 0))
        a[:, eom.independent] = places[:, 2]
        lam, u = self.setup.loads.loads(times, q, v, a, z)
        return {"q": q, "v": v, "a": a, "z": z, "rate": z, "lam": lam, "u": u}


def _follow_from_motion(setup: PhaseSetup) -> bool:
    """True if a mechanism has many coordinates, every motion is one of its, and decides its inputs."""
    scheme = setup.scheme
    eom, n = scheme.eom, scheme.eom.q.numel()
    if n < MANY:
        return False
    if eom.rows or eom.z.numel() or eom.u.numel() != n or not scheme.integrates_accelerations or scheme.degree < 2:
        return False
    plain = not scheme.inputs.joined and np.array_equal(scheme.inputs.taus, scheme.stages)
    return plain and not ca.depends_on(ca.jacobian(eom.motion, eom.u), eom.u)


def _end_of(setup: PhaseSetup) -> tuple[np.ndarray, np.ndarray] | None:
    """Coordinates and velocities at the end, if the conditions there decide them and nothing else; else None."""
    final = setup.phase.final
    if isinstance(final, State):
        return final.q, final.v
    if len(on_states(final)) != len(final):
        return None
    end = float(setup.path.segment_times[-1])
    return state_by_linear_conditions(setup.numeric, final, end, setup.start.z, setup.scheme.eom)
