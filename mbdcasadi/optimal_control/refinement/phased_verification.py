"""Verification of a motion of several phases: simulated phase by phase, with joints that close as events."""

from __future__ import annotations

from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...equations.recovery import Recovery
from ...model.events import Event
from ...numerics.console import without_warnings
from ...numerics.least_squares import largest
from ...results.phases import PhasedTrajectory, in_whole
from ...results.state import EventOccurrence, State
from ...results.trajectory import Trajectory
from ...simulation.simulate import simulate
from ..nlp.change import Change
from .local_error import local_errors
from .verification import Verification

if TYPE_CHECKING:
    from ..phase_solution import PhaseSolution
    from ..solution import Solution

#: Share of the duration of a phase by which the simulation goes on behind its planned end to find what closes.
BEYOND = 0.05


class _Replay:
    """The simulation of a solution, phase by phase."""

    def __init__(self, solution: Solution, reltol: float, abstol: float):
        self.solution, self._reltol, self._abstol = solution, reltol, abstol
        self.parts: list[Trajectory] = []
        self.events: list[EventOccurrence] = []
        self.times: list[float] = []
        self.deviations: list[np.ndarray] = []
        self.time_error = self.impulse_error = 0.0
        planned = solution.trajectory
        assert isinstance(planned, PhasedTrajectory)
        self.whole, self.p = planned.mechanism, planned.arguments[-1][0]

    def run(self) -> Verification:
        """Simulate all phases and compare with the plan."""
        parts, changes = self.solution.phases, [*self.solution.program.changes, None]
        state, late = parts[0].trajectory.initial, 0.0
        for part, change in zip(parts, changes, strict=True):
            if part.phase.is_instant:
                self._compare_instant(part, state)
            else:
                state, late = self._through(part, change, state, late)
            if change is not None:
                state = self._across(change, state)
        solution = self.solution
        motion = PhasedTrajectory(
            self.parts,
            self.whole,
            [self.p] * len(self.parts),
            events=self.events,
            statistics=self.parts[0].statistics,
        )
        return Verification(
            motion,
            float(np.max(self.deviations[-1][-1])),
            max(float(np.max(d)) for d in self.deviations),
            motion.drift.position,
            np.vstack([local_errors(part) for part in solution.phases if part.mesh.count]),
            np.array(self.times),
            self.time_error,
            self.impulse_error,
        )

    def _through(self, part: PhaseSolution, change: Change | None, start: State, late: float) -> tuple[State, float]:
        """Simulate a phase: the state at its end, and by how much it is later than planned."""
        times = part.mesh_times + late
        beyond = float(times[-1]) + BEYOND * part.duration
        event = None if change is None else _closing(part, change, self.solution.phases[change.after.number].numeric.p)
        grid = times if event is None else np.r_[times, beyond]
        inputs = {u: _moved(polynomial, late, beyond) for u, polynomial in part.polynomials.inputs.items()}
        p = dict(zip(part.phase.mechanism.parameters, part.numeric.p.tolist(), strict=True))
        events = [] if event is None else [event]
        with without_warnings(".*beyond its limits"):
            motion = simulate(
                part.phase.mechanism,
                grid,
                initial=start,
                inputs=inputs,
                parameters=p,
                events=events,
                reltol=self._reltol,
                abstol=self._abstol,
            )
        end, found = float(times[-1]), None
        if event is not None:
            found = min(motion.events, key=lambda e: abs(e.t - end), default=None)
            end = end if found is None else found.t
        state = motion.at(end).initial if found is None else found.state
        self._keep(part, motion, times, state)
        if change is not None:
            self.times.append(end if found is not None or event is None else np.nan)
            self.time_error = max(self.time_error, abs(end - float(part.mesh_times[-1])))
        return state, end - float(part.mesh_times[-1])

    def _keep(self, part: PhaseSolution, motion: Trajectory, times: np.ndarray, end: State) -> None:
        """Record the motion up to its end, and how far it is from the plan at the mesh points."""
        count = int(np.searchsorted(motion.t, end.t))
        arrays = [
            np.vstack([getattr(motion, name)[:count], getattr(end, name)])
            for name in ("q", "v", "a", "z", "lam", "inputs")
        ]
        q, v, a, z, lam, u = arrays
        t = np.r_[motion.t[:count], end.t]
        self.parts.append(
            Trajectory(
                motion.mechanism,
                t,
                q,
                v,
                a,
                z,
                lam,
                u,
                motion.parameters,
                statistics=motion.statistics,
                refine=motion._refine,
            )
        )
        n = part.phase.equations.q.numel()
        compared = min(count, times.size - 1)
        rows = [*range(compared), t.size - 1]
        planned = part.mesh_states[[*range(compared), times.size - 1]]
        self._compare(part, q[rows] - planned[:, :n], z[rows] - planned[:, 2 * n :])

    def _compare(self, part: PhaseSolution, q: np.ndarray, z: np.ndarray) -> None:
        self.deviations.append(np.abs(np.hstack([q, z / part.program.scales.z])))

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
        q = Recovery(numeric, redundant=False).positions(np.array([before.t]), before.q[change.here][None, :])[0]
        found = change.law.solve(numeric.mass, before.t, q, before.v[change.here], numeric.p)
        planned = self.solution.variables[change.index]
        kept = found.impulses[list(change.setup.kept)]
        size = largest(planned)
        if size > 0:
            self.impulse_error = max(self.impulse_error, largest(kept - planned) / size)
        z = np.array([x.value for x in phase.mechanism.states])
        for k, symbol in enumerate(phase.mechanism.states):
            place = next((i for i, x in enumerate(before.mechanism.states) if x is symbol), None)
            z[k] = z[k] if place is None else before.z[place]
        eom = phase.equations
        u = eom.input_values
        recovery = Recovery(numeric, redundant=self.solution.phases[change.after.number].redundant)
        t = np.array([before.t])
        a, lam = recovery.accelerations(t, q[None, :], found.v[None, :], z[None, :], u[None, :])
        after = State(phase.mechanism, before.t, q, found.v, a[0], z, lam[0], u, numeric.p, None, change.by_joint(kept))
        states = [in_whole(one, self.whole, self.p) for one in (before, after)]
        self.events.append(EventOccurrence(phase.name, before.t, *states))
        return after


def _closing(part: PhaseSolution, change: Change, p: np.ndarray) -> Event | None:
    """The event at which the next phase begins: a row that closes, in the planned direction; None if none does."""
    if not change.setup.guards:
        return None
    eom, final = change.setup.after.numeric.eom, part.trajectory.final
    rows = ca.vertcat(eom.Phi, change.law.momentary)[list(change.setup.guards)]
    rows = ca.substitute(rows, eom.p, ca.SX(ca.DM(p)))
    rates = np.atleast_1d(final[ca.jtimes(rows, eom.q, eom.v) + ca.jacobian(rows, eom.t)]).ravel()
    k = int(np.argmax(np.abs(rates)))
    if rates[k] == 0:
        return None
    return Event("closes", rows[k], direction=int(np.sign(rates[k])))


def _moved(polynomial: PiecewisePolynomial, late: float, beyond: float) -> PiecewisePolynomial:
    """An input that begins later, and goes on behind its end."""
    breaks = polynomial.breaks + late
    return PiecewisePolynomial(np.r_[breaks[:-1], beyond], polynomial.coefficients)


def phased_verification(solution: Solution, reltol: float, abstol: float) -> Verification:
    """Simulate a solution of several phases and compare at the mesh points."""
    return _Replay(solution, reltol, abstol).run()
