"""One phase of an optimum: its mesh, its motion, and the local errors of its intervals."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.recovery import Recovery
from ...model.cache import Cache
from ...model.conditions import Condition
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from ...numerics.symbolic import symbolic
from ...results.state import State
from ...results.steps import Direct
from ...results.trajectory import Statistics, Trajectory
from ..program.phase_program import SHORTEST_SWITCH, PhaseProgram
from ..statement.known_inputs import KnownInputs
from ..statement.phase import Phase
from ..transcription.mesh import Mesh
from ..transcription.motion import OptimalMotion, Polynomials
from .growth import Growth, growth
from .guess import PhaseGuess, guess_from_polynomials
from .reintegration import end_differences, inner_errors

#: Points of an interval by which the size of a running cost, and what soft limits cost, is integrated.
COST_POINTS = 4
#: Multiple of the shortest interval beside a mesh point that moves up to which one is no longer than that.
STOPPED = 1.01


class PhaseSolution:
    """One phase of a solution.

    It is made of the variables x of the whole program, in physical units, the times of start, waypoints and end if
    none of them is free, s, the values of the free parameters that the mechanism does not have, the time of the
    solve, s, and the inputs that were given.

    Attributes
    ----------
    phase : Phase
        The phase.
    mesh_times : numpy.ndarray
        Mesh points (N + 1,), s.
    polynomials : Polynomials
        Motion between the mesh points.
    """

    def __init__(
        self,
        program: PhaseProgram,
        numeric: NumericEquations,
        mesh: Mesh,
        x: np.ndarray,
        segment_times: np.ndarray,
        extra: np.ndarray,
        seconds: float,
        known: KnownInputs,
    ):
        self.phase: Phase = program.phase
        self.program, self.numeric, self.mesh, self.extra, self._seconds = program, numeric, mesh, extra, seconds
        self._known = known
        #: what was found about the phase
        self.cache = Cache()
        self._read(x, segment_times)

    def _read(self, x: np.ndarray, segment_times: np.ndarray) -> None:
        """Find times and motion among the variables of the whole program."""
        program, mesh, mesh_times = self.program, self.mesh, x[self.program.time_index]
        self.mesh = mesh.moved(mesh_times)
        self.segment_times = (
            mesh_times[program.stated_knots] if program.time_count else np.asarray(segment_times, float)
        )
        self.mesh_times = self.mesh.times(self.segment_times)
        numbers = np.arange(mesh.count + 1)[:, None]
        points = x[program.point_index(numbers)[:, : program.scheme.point_size]]
        given = program.scheme.known_columns(self.mesh_times, partial(self._known.values, program.number))
        intervals = np.hstack([x[program.inner_index(numbers[:-1])], given])
        self.polynomials = Polynomials(program.scheme, self.mesh_times, points, intervals, self.numeric)

    def by_polynomials(self, expressions: Sequence[ca.SX], intervals: np.ndarray, taus: np.ndarray) -> list[np.ndarray]:
        """Return values of expressions of the problem at points of intervals, each (size, k)."""
        values = self.evaluator(expressions).rows(*self.polynomials.unknowns(intervals, taus), self.extra)
        return [of.T for of in values]

    def evaluator(self, expressions: Sequence[ca.SX]) -> Evaluator:
        """Return expressions as functions of the unknowns of an interval, of which they need few."""
        motion, extra = self.program.scheme.motion.function, ca.SX.sym("e", self.extra.size)
        unknowns = motion.sx_in()
        values = ca.Function("values", self.program.arguments, [ca.densify(e) for e in expressions])
        return Evaluator(
            ca.Function("values", [*unknowns, extra], values.call([*motion.call(unknowns), unknowns[-1], extra]))
        )

    @property
    @symbolic
    def cost_size(self) -> float:
        """Integral of the absolute value of the running cost."""
        return self.integral(ca.fabs(self.phase.running_cost))

    def integral(self, expression: ca.SX) -> float:
        """Integral of an expression of the problem over the phase, by the polynomials."""
        count = self.mesh.count
        if expression.is_zero() or not count:
            return 0.0
        taus, weights = np.polynomial.legendre.leggauss(COST_POINTS)
        k, tau = np.repeat(np.arange(count), taus.size), np.tile((1 + taus) / 2, count)
        (values,) = self.by_polynomials([expression], k, tau)
        by_interval = values.reshape(count, taus.size) @ weights / 2
        return float(by_interval @ np.diff(self.mesh_times))

    @property
    def stopped(self) -> np.ndarray:
        """Intervals in which the start, a waypoint or the end comes up to a mesh point that keeps its time (N,)."""
        knots, program, mesh = self.mesh.knots, self.program, self.mesh
        if not mesh.pinned or not program.time_count:
            return np.zeros(mesh.count, bool)
        pinned, stated = np.isin(knots, mesh.pinned), np.isin(np.arange(knots.size), program.stated_knots)
        beside = (pinned[1:] & stated[:-1]) | (pinned[:-1] & stated[1:])
        shortest = np.diff(self.mesh_times[knots]) <= STOPPED * SHORTEST_SWITCH * program.scales.time
        stopped: np.ndarray = (beside & shortest)[mesh.piece]
        return stopped

    @property
    def duration(self) -> float:
        """Time of the phase, s."""
        return float(self.segment_times[-1] - self.segment_times[0])

    def times_at(self, k: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """Return the times at points of intervals, s."""
        begin = self.mesh_times[k]
        times: np.ndarray = begin + tau * (self.mesh_times[k + 1] - begin)
        return times

    def time_at(self, interval: int, tau: float) -> float:
        """Return the time at a point of an interval, s."""
        if self.mesh_times.size == 1:  # a phase of no duration
            return float(self.mesh_times[0])
        begin, end = self.mesh_times[interval], self.mesh_times[interval + 1]
        return float(begin + tau * (end - begin))

    @cached_property
    def mesh_states(self) -> np.ndarray:
        """Coordinates, velocities and first-order states at the mesh points (N + 1, k)."""
        return np.hstack(self.polynomials.at_mesh_points)

    @property
    def redundant(self) -> bool:
        """True if constraint rows were left out because others imply them."""
        return self.program.scheme.redundant

    @cached_property
    @symbolic
    def trajectory(self) -> OptimalMotion:
        """The motion at mesh points and stages; ``.at(times)`` between them by the polynomials of the scheme."""
        scheme = self.program.scheme
        statistics = Statistics(scheme.name, f"order {scheme.order}, {self.mesh.count} intervals", self._seconds)
        extra = dict(zip(self.program.extra_parameters, self.extra.tolist(), strict=True))
        return self.polynomials.trajectory(self.phase, extra, statistics)

    @property
    def limits(self) -> list[Condition]:
        """Inequalities that hold throughout: path conditions, and limits of inputs and first-order states."""
        return [c for c in (*self.phase.path, *self.program.limit_owners) if not c.equality]

    @property
    def points_per_interval(self) -> int:
        """Points of :attr:`trajectory` in each interval."""
        return (len(self.trajectory) - 1) // self.mesh.count

    @property
    def end_differences(self) -> np.ndarray:
        """Differences from the next mesh point of each interval, integrated again, in q, v and z (N, 2 n + k).

        Raises
        ------
        RuntimeError
            If the end of an interval is not reached.
        """
        if isinstance(self._reintegrated, RuntimeError):
            raise self._reintegrated.with_traceback(None)
        return self._reintegrated

    @cached_property
    @symbolic
    def _reintegrated(self) -> np.ndarray | RuntimeError:
        """The differences, or why there are none: an interval that locks up takes the integrator many steps."""
        try:
            return end_differences(self.polynomials)
        except RuntimeError as error:
            return error

    @property
    def end_errors(self) -> np.ndarray:
        """Sizes of the differences at the ends."""
        return np.abs(self.end_differences)

    @cached_property
    @symbolic
    def inner_errors(self) -> np.ndarray:
        """Largest errors of q and v inside the intervals to first order (N, 2 n)."""
        return inner_errors(self.polynomials)

    @cached_property
    @symbolic
    def projection_steps(self) -> np.ndarray:
        """Steps by which the ends of the intervals are moved onto the constraints, of q and v (N, 2 n)."""
        count, n = self.mesh.count, self.phase.equations.q.numel()
        _, q, v, *_ = self.polynomials.at(np.arange(count), np.ones(count))
        steps: np.ndarray = np.abs(self.mesh_states[1:, : 2 * n] - np.hstack([q, v]))
        return steps

    @cached_property
    @symbolic
    def growth(self) -> Growth:
        """Transitions of small errors from mesh point to mesh point."""
        return growth(self.polynomials)

    @cached_property
    def growth_to_end(self) -> np.ndarray:
        """Factors by which errors at the ends of the intervals grow up to the end, in typical sizes (N, k, 2 k)."""
        return self.growth.to_end(self.state_sizes)

    @cached_property
    def largest_growth(self) -> float:
        """Largest factor by which a small error grows from a mesh point to the end, in typical sizes.

        Infinite if accelerations have no slope somewhere, as in a pose in which a linkage branches.
        """
        factors = self.growth_to_end
        if not np.all(np.isfinite(factors)):
            return np.inf
        return float(np.max(np.linalg.norm(factors, 2, axis=(1, 2)), initial=1.0))

    @property
    def state_sizes(self) -> np.ndarray:
        """Typical sizes of coordinates and rates (2 n,)."""
        scales = self.program.scales.q
        return np.r_[scales, scales / self.duration]

    @property
    def state_errors(self) -> np.ndarray:
        """Differences of the first-order states at the ends, as shares of their ranges (N, k)."""
        return self.end_errors[:, 2 * self.phase.equations.q.numel() :] / self.state_ranges

    @property
    def scaled_errors(self) -> np.ndarray:
        """Largest difference by interval: coordinates, velocities times the duration, states by their ranges (N,)."""
        n = self.phase.equations.q.numel()
        errors = self.end_errors[:, : 2 * n] * np.repeat([1.0, self.duration], n)
        largest: np.ndarray = np.max(np.hstack([errors, self.state_errors]), axis=1)
        return largest

    @property
    def state_ranges(self) -> np.ndarray:
        """Ranges of the first-order states over the motion, typical sizes of those that do not change (k,)."""
        changes = np.ptp(self.mesh_states[:, 2 * self.phase.equations.q.numel() :], axis=0)
        ranges: np.ndarray = np.where(changes > 0, changes, self.program.scales.z)
        return ranges

    @cached_property
    def mesh_error(self) -> float:
        """Largest local error of an interval: q (m, rad), v by the duration, first-order states by their ranges.

        Infinite if an interval cannot be integrated again, as through a pose in which a linkage branches.
        """
        try:
            return float(np.max(self.scaled_errors, initial=0.0))
        except RuntimeError:  # the integrator did not get to the end of an interval
            return np.inf

    @property
    def initial(self) -> State:
        """State at the start of the phase, just after the change into it."""
        return self.trajectory.initial

    @property
    def final(self) -> State:
        """State at the end of the phase, just before the change out of it."""
        return self.trajectory.final

    def as_guess(self, phase: Phase, begin: float) -> PhaseGuess:
        """The motion as a guess for a phase from a time on, s, with perhaps other waypoints and another duration."""
        if phase.is_instant:
            return PhaseGuess(lambda _times: {}, np.array([begin, begin]))
        times, spans = self.segment_times - self.segment_times[0], phase.time_spans
        if len(times) != len(spans):
            times = np.linspace(0, times[-1], len(spans))
        times = np.clip(times, [low for low, _ in spans], [high for _, high in spans])
        return guess_from_polynomials(self.polynomials, begin + times)


class InstantSolution(PhaseSolution):
    """A phase of no duration in a solution: one state."""

    def _read(self, x: np.ndarray, segment_times: np.ndarray) -> None:
        program = self.program
        time = float(x[program.time_index][0]) if program.time_count else float(segment_times[0])
        self.segment_times = np.array([time, time])
        self.mesh_times = np.array([time])
        self._point = x[program.point_index(0)[: program.scheme.point_size]]

    @cached_property
    def mesh_states(self) -> np.ndarray:
        """Coordinates, velocities and first-order states (1, k)."""
        scheme = self.program.scheme
        parts = scheme.split_point(self._point)
        w, rate, z = (parts[name][None, :] for name in ("q", "v", "z"))
        q, v = scheme.eom.states(self.mesh_times, w, rate, z, self.numeric.p)
        return np.hstack([q, v, z])

    @cached_property
    @symbolic
    def trajectory(self) -> Trajectory:  # type: ignore[override]
        """The state as a motion of one time; inputs have their own values."""
        eom = self.phase.equations
        n = eom.q.numel()
        q, v, z = np.split(self.mesh_states, [n, 2 * n], axis=1)
        u = eom.input_values[None, :]
        t, complete = self.mesh_times, Recovery(self.numeric, redundant=self.redundant).complete
        arrays = complete(t, q, v, z, u)
        one = Direct(lambda times: complete(times, *(np.repeat(x, times.size, axis=0) for x in (q, v, z, u))), t)
        return Trajectory(self.phase.mechanism, t, *arrays, self.numeric.p, interpolation=one)

    @property
    def limits(self) -> list[Condition]:
        """Nothing: conditions on the state hold at one place."""
        return []

    @property
    def end_differences(self) -> np.ndarray:
        """None: nothing is integrated (0, 2 n + k)."""
        return np.zeros((0, self.mesh_states.shape[1]))
