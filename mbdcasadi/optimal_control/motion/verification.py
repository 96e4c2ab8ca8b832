"""Verification of a solution: simulated with its inputs, phase by phase, with joints that close as events."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...assembly.impact import states_after
from ...equations.recovery import Recovery
from ...errors import MechanismError
from ...model.events import Event
from ...numerics.console import without_warnings
from ...numerics.least_squares import largest
from ...results.phases import PhasedTrajectory, in_whole
from ...results.state import EventOccurrence, State
from ...results.trajectory import Trajectory
from ...simulation.simulate import simulate
from ..program.change import Change
from .growth import REPLAY_ERROR, UNSTABLE_GROWTH
from .phase_solution import PhaseSolution
from .solved_motion import SolvedMotion

#: Share of the duration of a phase by which the simulation goes on behind its planned end to find what closes.
BEYOND = 0.05


@dataclass(frozen=True)
class Verification:
    """A simulation with the inputs of a solution, compared with it.

    Attributes
    ----------
    trajectory : Trajectory or None
        The simulated motion, up to where it stopped; None if it did not begin.
    final_error : float
        Largest difference at the end: of a coordinate, m or rad, or of a first-order state, as a share of its range.
        Infinite if the simulation stopped before.
        Local errors and those of the simulation grow by up to the factor :attr:`growth` on the way: an unstable motion,
        such as one that ends upright, does not replay by itself, however right it is. Then the defects say whether it
        is a motion; ``optimize(…, tolerance=…)`` makes them smaller, and feedback keeps a mechanism on its way.
    largest_deviation : float
        Largest deviation at any mesh point that was reached.
    drift : float
        Largest ``|Phi|`` of the simulated motion.
    defects : numpy.ndarray
        By interval, started again at each mesh point: largest difference in displacements (m) and in angles (rad),
        (N, 2); infinite in a phase of which an interval cannot be integrated.
    event_times : numpy.ndarray
        Times of the changes from phase to phase in the simulation, s; NaN if a joint did not close near its time, or
        the simulation stopped before.
    time_error : float
        Largest difference of one of them from the planned time, s.
    impulse_error : float
        Largest difference of an impulse, as a share of the largest one of its change.
    growth : float
        Largest factor by which a small error at a mesh point grows up to the end of its phase, in rad and sizes of the
        mechanism, and rates times the duration.
    stopped : MechanismError or None
        Error with which the simulation stopped before the end: in words, with its `.time`.
    """

    trajectory: Trajectory | None
    final_error: float
    largest_deviation: float
    drift: float
    defects: np.ndarray
    event_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    time_error: float = 0.0
    impulse_error: float = 0.0
    growth: float = 1.0
    stopped: MechanismError | None = None

    def __repr__(self) -> str:
        worst = np.max(self.defects, axis=0)
        changes = f"; changes off by up to {self.time_error:.1e} s" if self.event_times.size else ""
        lost = self.final_error > REPLAY_ERROR and self.growth > UNSTABLE_GROWTH
        unstable = f"; unstable: errors grow by a factor of {self.growth:.1e}" if lost else ""
        method = "" if self.trajectory is None else f" by {self.trajectory.statistics.method}"
        end = f"off by {self.final_error:.2e} at the end"
        if self.stopped is not None:
            reached = 0.0 if self.trajectory is None else self.trajectory.t[-1]
            end = f"stopped after t = {reached:.6g} s ({self.stopped})"
        return (
            f"Verification{method}: {end}, off by {self.largest_deviation:.2e} at most; defects of intervals up to "
            f"{worst[0]:.1e} m, {worst[1]:.1e} rad{changes}{unstable}"
        )


class Replay:
    """Simulation of a solution from its first state, phase by phase, compared with it at the mesh points."""

    def __init__(self, solution: SolvedMotion, reltol: float, abstol: float):
        self.solution, self._reltol, self._abstol = solution, reltol, abstol
        self.parts: list[Trajectory] = []
        self.events: list[EventOccurrence] = []
        self.times: list[float] = []
        self.deviations: list[np.ndarray] = []
        self.time_error = self.impulse_error = 0.0
        self._planned = solution.trajectory

    def run(self) -> Verification:
        """Simulate all phases, as far as the simulation gets, and compare with the plan."""
        parts, stopped = self.solution.phases, None
        try:
            self._replay()
        except MechanismError as error:
            stopped = error
        motion = self._motion() if self.parts else None
        missing = [np.nan] * (len(self.solution.program.changes) - len(self.times))
        return Verification(
            motion,
            float(np.max(self.deviations[-1][-1])) if stopped is None else np.inf,
            max((float(np.max(d, initial=0.0)) for d in self.deviations), default=0.0),
            0.0 if motion is None else motion.drift.position,
            np.vstack([defects_of(part) for part in parts if part.mesh.count]),
            np.array([*self.times, *missing]),
            self.time_error,
            self.impulse_error,
            max(part.largest_growth for part in parts if part.mesh.count),
            stopped,
        )

    def _replay(self) -> None:
        """Simulate phase after phase; raises as :func:`simulate` does, what was reached is in :attr:`parts`."""
        parts, changes = self.solution.phases, [*self.solution.program.changes, None]
        state, late = parts[0].trajectory.initial, 0.0
        for part, change in zip(parts, changes, strict=True):
            if part.phase.is_instant:
                self._compare_instant(part, state)
            else:
                state, late = self._through(part, change, state, late)
            if change is not None:
                state = self._across(change, state)

    def _motion(self) -> Trajectory:
        if not isinstance(self._planned, PhasedTrajectory):
            return self.parts[0]
        whole, parameters = self._planned.mechanism, [self._planned.arguments[-1][0]] * len(self.parts)
        statistics = self.parts[0].statistics
        return PhasedTrajectory(self.parts, whole, parameters, events=self.events, statistics=statistics)

    def _through(self, part: PhaseSolution, change: Change | None, start: State, late: float) -> tuple[State, float]:
        """Simulate a phase: the state at its end, and by how much it is later than planned."""
        times = part.mesh_times + late
        event = None if change is None else _closing(part, change, self.solution.phases[change.after.number].numeric.p)
        beyond = float(times[-1]) + (0.0 if event is None else BEYOND * part.duration)
        inputs = {u: _moved(polynomial, late, beyond) for u, polynomial in part.polynomials.inputs.items()}
        try:
            with without_warnings(".*beyond its limits"):  # Solution.limit_excess says how far limits are passed
                motion = simulate(
                    part.phase.mechanism,
                    times if event is None else np.r_[times, beyond],
                    initial=start,
                    inputs=inputs,
                    parameters=dict(zip(part.phase.mechanism.parameters, part.numeric.p.tolist(), strict=True)),
                    events=[] if event is None else [event],
                    reltol=self._reltol,
                    abstol=self._abstol,
                )
        except MechanismError as error:
            if isinstance(error.partial, Trajectory):
                self._compare_motion(part, error.partial, times, ended=False)
            raise
        found = min(motion.events, key=lambda e: abs(e.t - times[-1]), default=None)
        if event is not None:
            motion = _until(motion, motion.at(float(times[-1])).initial if found is None else found.state)
        self._compare_motion(part, motion, times, ended=True)
        end = motion.final
        if change is not None:
            self.times.append(end.t if found is not None or event is None else np.nan)
            self.time_error = max(self.time_error, abs(end.t - float(part.mesh_times[-1])))
        return end, end.t - float(part.mesh_times[-1])

    def _compare_motion(self, part: PhaseSolution, motion: Trajectory, times: np.ndarray, *, ended: bool) -> None:
        """Take a motion, and compare it at the mesh times before its end, and the end with the planned one."""
        self.parts.append(motion)
        n, before = part.phase.equations.q.numel(), min(motion.t.size, times.size) - 1
        rows = [*range(before), *([-1] if ended else [])]
        planned = part.mesh_states[rows]
        self._compare(part, motion.q[rows] - planned[:, :n], motion.z[rows] - planned[:, 2 * n :])

    def _compare(self, part: PhaseSolution, q: np.ndarray, z: np.ndarray) -> None:
        self.deviations.append(np.abs(np.hstack([q, z / part.state_ranges])))

    def _compare_instant(self, part: PhaseSolution, state: State) -> None:
        n = part.phase.equations.q.numel()
        planned = part.mesh_states
        self._compare(part, state.q[None, :] - planned[:, :n], state.z[None, :] - planned[:, 2 * n :])
        rows = (state.q, state.v, state.a, state.z, state.lam, state.inputs)
        q, v, a, z, lam, u = (x[None, :] for x in rows)
        self.parts.append(Trajectory(state.mechanism, np.array([state.t]), q, v, a, z, lam, u, state.parameters))

    def _across(self, change: Change, before: State) -> State:
        """The state just after a change."""
        numeric = self.solution.phases[change.after.number].numeric
        phase = change.after.phase
        z = states_after(phase.mechanism, before)
        start = np.array([before.t]), before.q[change.here][None, :], z[None, :]
        q = Recovery(numeric, redundant=False).positions(*start)[0]
        collision = change.law.solve(numeric, before.t, q, before.v[change.here], z)
        planned = self.solution.variables[change.index]
        kept = collision.impulses[list(change.setup.independent)]
        size = largest(planned)
        if size > 0:
            self.impulse_error = max(self.impulse_error, largest(kept - planned) / size)
        eom = phase.equations
        u = eom.input_values
        recovery = Recovery(numeric, redundant=self.solution.phases[change.after.number].redundant)
        t = np.array([before.t])
        a, lam = recovery.accelerations(t, q[None, :], collision.v[None, :], z[None, :], u[None, :])
        after = State(
            phase.mechanism, before.t, q, collision.v, a[0], z, lam[0], u, numeric.p, None, change.by_joint(kept)
        )
        whole, parameters = self._planned.mechanism, self._planned.arguments[-1][0]
        states = [in_whole(one, whole, parameters) for one in (before, after)]
        self.events.append(EventOccurrence(phase.name, before.t, *states))
        return after


def _closing(part: PhaseSolution, change: Change, p: np.ndarray) -> Event | None:
    """The event at which the next phase begins: a row that closes, in the planned direction; None if none does."""
    if not change.setup.guards:
        return None
    eom, final = change.setup.after.numeric.eom, part.trajectory.final
    rows = change.guards_at(p)
    rates = np.atleast_1d(final[ca.jtimes(rows, eom.q, eom.v) + ca.jacobian(rows, eom.t)]).ravel()
    k = int(np.argmax(np.abs(rates)))
    if rates[k] == 0:
        return None
    return Event("closes", rows[k], direction=int(np.sign(rates[k])))


def _until(motion: Trajectory, end: State) -> Trajectory:
    """The motion up to a state."""
    count = int(np.searchsorted(motion.t, end.t))
    t, names = np.r_[motion.t[:count], end.t], ("q", "v", "a", "z", "lam", "inputs")
    q, v, a, z, lam, u = (np.vstack([getattr(motion, name)[:count], getattr(end, name)]) for name in names)
    more: dict[str, Any] = {"statistics": motion.statistics, "interpolation": motion.interpolation}
    return Trajectory(motion.mechanism, t, q, v, a, z, lam, u, motion.parameters, **more)


def _moved(polynomial: PiecewisePolynomial, late: float, beyond: float) -> PiecewisePolynomial:
    """An input that begins later, and goes on behind its end."""
    breaks = polynomial.breaks + late
    return PiecewisePolynomial(np.r_[breaks[:-1], beyond], polynomial.coefficients)


def defects_of(part: PhaseSolution) -> np.ndarray:
    """Largest difference in displacements (m) and angles (rad) by interval (N, 2)."""
    if not np.isfinite(part.mesh_error):
        return np.full((part.mesh.count, 2), np.inf)
    errors = part.end_errors[:, : part.phase.equations.q.numel()]
    angles = part.program.scales.angles
    return np.column_stack([np.max(errors[:, ~angles], axis=1), np.max(errors[:, angles], axis=1)])
