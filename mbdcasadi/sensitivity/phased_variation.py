"""Variations of a motion through several mechanisms: carried along each phase, and across the changes between.

A change takes place where ``g(t, x, p) = 0``. With variations ``dx`` just before at a fixed time, rates ``f⁻`` before
and ``f⁺`` after, and a jump ``x⁺ = h(t, x, p)``,

    dtau = -dg / g_rate,   dx⁻ = dx + f⁻ dtau,   dx⁺ = dh,   and at a fixed time just after  dx⁺ - f⁺ dtau:

the saltation matrix. The jump is that of :class:`ImpactLaw`, or of :class:`ContactImpact`; a mode of exact friction and
rigid contacts that ends is a change, too.

References
----------
Aizerman and Gantmacher, "Determination of stability by linear approximation of a periodic solution of a system of
differential equations with discontinuous right-hand sides", Q. J. Mech. Appl. Math. 11 (1958) 385; Leine and Nijmeijer,
*Dynamics and Bifurcations of Non-Smooth Mechanical Systems*, Springer 2004, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..equations import equations
from ..errors import ModelError, SimulationError
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..numerics.least_squares import largest, least_norm
from ..numerics.rank import analyse_rank
from ..results.state import EventOccurrence, State
from ..results.trajectory import Trajectory
from .change import CLOSING_TOLERANCE, Change, refuse_open_start
from .phase_flow import PhaseFlow, VariedMotion, VariedState
from .switched_motion import Boundary, is_among

#: Rate of an event, relative to the rates of its state, below which the motion grazes and has no derivative.
GRAZING = 1e-8


@dataclass(frozen=True)
class EventVariation:
    """An event, and how it and the state there vary.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    time : numpy.ndarray
        Variation of the time (k,).
    before, after : tuple of numpy.ndarray
        Values of the outputs just before and just after (n_y,), and their variations along with the instant
        (n_y, k); `after` is None if the motion ends there.
    """

    name: str
    t: float
    time: np.ndarray
    before: tuple[np.ndarray, np.ndarray]
    after: tuple[np.ndarray, np.ndarray] | None


@dataclass(frozen=True)
class PhasedVariation:
    """Outputs over time and at events, with their variations.

    Attributes
    ----------
    t : numpy.ndarray
        Times (n_t,), s; the instant of a change twice.
    y, slope : numpy.ndarray
        Outputs (n_t, n_y), and variations at fixed times (n_t, n_y, k).
    events : tuple of EventVariation
        Changes, and the event that ends the motion.
    end : numpy.ndarray
        Variation of the last state ``(q, v, z)``, along with the instant if an event ends the motion (n_x, k).
    """

    t: np.ndarray
    y: np.ndarray
    slope: np.ndarray
    events: tuple[EventVariation, ...]
    end: np.ndarray


def phased_variation(varied: VariedMotion, events: Sequence[Event]) -> PhasedVariation:
    """Carry variations along a motion that was simulated.

    Parameters
    ----------
    varied : VariedMotion
        The motion and its variations at the start.
    events : sequence of Event
        The events of the run.

    Raises
    ------
    ModelError
        For events that reset velocities, and several that take place together: their order decides the variation.
    SimulationError
        If the motion grazes the zero of an event, or a joint would not close for other values.
    """
    changes, ending = _changes(varied, events), _ending(varied.motion, events)
    return _Passage(varied).run(changes, ending)


class _Passage:
    """Variations on their way through the phases; see :func:`phased_variation`."""

    def __init__(self, varied: VariedMotion):
        self._varied = varied
        self._events: list[EventVariation] = []
        #: expressions of the events that end the phases
        self._endings: list[ca.SX] = []
        #: variations of the state at a fixed time, and of the parameters
        self._dx, self._parameters = varied.directions.start, dict(varied.directions.parameters)

    def run(self, changes: Sequence[Boundary], ending: Event | None) -> PhasedVariation:
        """Go through all phases."""
        self._endings = [change.events[0].expression for change in changes]
        self._endings += [] if ending is None else [ending.expression]
        first = self._flow(0)
        if self._varied.phases[0].modes is not None:
            refuse_open_start(first, self._dx, first.dp(self._parameters))
        flow: PhaseFlow | None = first
        pieces = []
        for number, phase in enumerate(self._varied.phases):
            if flow is None:
                break
            values, slopes, x, self._dx = flow.run(self._dx, flow.dp(self._parameters))
            pieces.append((flow.grid, values, slopes))
            if number < len(changes):
                flow = self._change(flow, changes[number], number, float(phase.motion.t[-1]), x)
            elif ending is not None:
                self._end(flow, ending, float(phase.motion.t[-1]), x)
        t, y, slope = (np.concatenate(parts) for parts in zip(*pieces, strict=True))
        return PhasedVariation(t, y, slope, tuple(self._events), self._dx)

    def _flow(self, number: int) -> PhaseFlow:
        """The motion in a phase."""
        return PhaseFlow(self._varied, number, dict(enumerate(self._endings)).get(number))

    def _end(self, flow: PhaseFlow, event: Event, time: float, x: np.ndarray) -> None:
        """End the motion at an event."""
        instant = _at_event(flow, event, time, x, self._dx, flow.dp(self._parameters))
        self._dx = instant.dx
        self._events.append(EventVariation(event.name, time, instant.dt, flow.outputs_at(instant), None))

    def _change(self, flow: PhaseFlow, change: Boundary, number: int, time: float, x: np.ndarray) -> PhaseFlow | None:
        """Go across a change: the motion that follows, None if the motion ends just after it."""
        following = self._flow(number + 1)
        instants = [_at_event(flow, e, time, x, self._dx, flow.dp(self._parameters)) for e in change.events]
        instant = instants[0]
        if any(largest(i.dt - instant.dt) > CLOSING_TOLERANCE * (1 + largest(instant.dt)) for i in instants[1:]):
            raise _together(change.occurrences)
        jumped, self._parameters = Change(flow, following, change, instant).across(self._parameters)
        after = VariedState(time, following.x0, instant.dt, jumped, following.dp(self._parameters))
        values = flow.outputs_at(instant), following.outputs_at(after, starts=True)
        self._events += [EventVariation(event.name, time, instant.dt, *values) for event in change.events]
        if not self._varied.phases[number + 1].lasts:
            self._dx = jumped
            return None
        self._dx = jumped - np.outer(following.rates(time, following.x0, starts=True), instant.dt)
        return following


def _changes(varied: VariedMotion, events: Sequence[Event]) -> list[Boundary]:
    """The events of each change of a motion."""
    motion, known = varied.motion, {event.name: event for event in events}
    own = {event.name for phase in varied.phases for event in phase.events}
    for event in motion.events:
        if event.name in own:
            if event.t == motion.t[0] and event.after is not None and event.after.impulses:
                raise ModelError(
                    f"sensitivities: '{event.name}' at the start, t = {event.t:.6g} s, by an impact: there is no "
                    "derivative; start before it"
                )
            continue
        if event.name not in known:
            raise ModelError(
                f"sensitivities: event '{event.name}' of the motion is not in events=; give those of the run"
            )
        if event.after is not None and known[event.name].becomes is None:
            raise ModelError(
                f"sensitivities: event '{event.name}' resets velocities; derivatives are carried through changes of "
                "the mechanism alone (becomes=, with restitution= for a bounce)"
            )
    chosen = []
    for phase in varied.phases[:-1]:
        end = float(phase.motion.t[-1])
        here = [e for e in motion.events if e.after is not None and is_among(end, [e.t])]
        at_modes = {event.name: event for event in phase.events}
        by_mode = [e for e in here if e.name in at_modes]
        if not here or (by_mode and phase.at_break):
            raise ModelError(
                f"sensitivities: friction or contact changes its mode at t = {end:.6g} s, where a load or an input "
                "changes at once: there is no derivative; let it change within a short time"
            )
        if len(by_mode) not in (0, len(here)) or (not by_mode and len(here) > 1):
            raise _together(here)
        if not phase.lasts:
            raise ModelError(f"sensitivities: event '{here[0].name}' takes place at the start of its phase")
        chosen.append(Boundary(tuple((known | at_modes)[e.name] for e in here), tuple(here)))
    return chosen


def _together(here: Sequence[EventOccurrence]) -> ModelError:
    names = ", ".join(f"'{e.name}'" for e in here)
    return ModelError(
        f"sensitivities: the events {names} take place together at t = {here[0].t:.6g} s; which one is first for other "
        "values decides the motion, and there is no derivative"
    )


def _ending(motion: Trajectory, events: Sequence[Event]) -> Event | None:
    """The event that ends a motion without a change; None if there is none."""
    known = {event.name: event for event in events}
    last = [known[e.name] for e in motion.events if e.name in known and is_among(e.t, [float(motion.t[-1])])]
    return next((event for event in last if event.terminal and event.becomes is None), None)


def _at_event(flow: PhaseFlow, event: Event, time: float, x: np.ndarray, dx: np.ndarray, dp: np.ndarray) -> VariedState:
    """The state at an event, which varies along with the instant, from its variations at a fixed time."""
    rate, rates = flow.rate_of(event.expression, time, x), flow.rates(time, x)
    if not np.isfinite(rate) or abs(rate) <= GRAZING * (1 + largest(rates)):
        raise SimulationError(
            f"sensitivities: the motion touches the zero of event '{event.name}' at t = {time:.6g} s with the rate "
            f"{rate:.3g}: the instant has no derivative",
            time=time,
        )
    _, change = flow.at(event.expression, VariedState(time, x, np.zeros(dx.shape[1]), dx, dp))
    dt = -change.ravel() / rate
    return VariedState(time, x, dt, dx + np.outer(rates, dt), dp)


def start_directions(mechanism: Mechanism, state: State) -> np.ndarray:
    """Return the directions in which a start may vary on the constraints, as columns for ``(q, v, z)``."""
    eom = equations(mechanism)
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
    n, k = eom.q.numel(), eom.z.numel()
    if not rows.numel():
        return np.eye(2 * n + k)
    slopes = [ca.densify(ca.jacobian(rows, x)) for x in (ca.vertcat(eom.q, eom.v), eom.z)]
    function = ca.Function("rows", [eom.t, eom.q, eom.v, eom.z, eom.p], slopes)
    slope, by_z = (x.full() for x in function(state.t, state.q, state.v, state.z, state.parameters))
    tangent = analyse_rank(slope).null_columns
    led = -least_norm(slope, by_z) if eom.follows_states else np.zeros((2 * n, k))
    return np.block([[tangent, led], [np.zeros((k, tangent.shape[1])), np.eye(k)]])
