"""Variations of a motion through several mechanisms: carried along each phase, and across the changes between.

A change takes place where ``g(t, x, p) = 0``. With variations ``dx`` just before at a fixed time, rates ``f⁻`` before
and ``f⁺`` after, and a jump ``x⁺ = h(t, x, p)``,

    dtau = -dg / g_rate,   dx⁻ = dx + f⁻ dtau,   dx⁺ = dh,   and at a fixed time just after  dx⁺ - f⁺ dtau:

the saltation matrix. The jump is that of :class:`ImpactLaw`.

References
----------
Aizerman and Gantmacher, "Determination of stability by linear approximation of a periodic solution of a system of
differential equations with discontinuous right-hand sides", Q. J. Mech. Appl. Math. 11 (1958) 385; Leine and Nijmeijer,
*Dynamics and Bifurcations of Non-Smooth Mechanical Systems*, Springer 2004, chapter 7.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.impact_law import ImpactLaw
from ..errors import ModelError, SimulationError
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter, StateVariable, place_of
from ..numerics.least_squares import largest, least_norm
from ..numerics.rank import analyse_rank
from ..results.phases import places_in
from ..results.state import EventOccurrence, State
from ..results.trajectory import Trajectory
from .phase_flow import PhaseFlow, VariedMotion, VariedState

#: Rate of an event, relative to the rates of its state, below which the motion grazes and has no derivative.
GRAZING = 1e-8
#: Share of a variation up to which the rows of a joint that closes may open for other values.
CLOSING_TOLERANCE = 1e-5


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
    changes, ending = _changes(varied.motion, events), _ending(varied.motion, events)
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

    def run(self, changes: Sequence[Event], ending: Event | None) -> PhasedVariation:
        """Go through all phases."""
        self._endings = [event.expression for event in changes]
        self._endings += [] if ending is None else [ending.expression]
        flow: PhaseFlow | None = self._flow(0)
        pieces = []
        for number, part in enumerate(self._varied.motion.phases):
            if flow is None:
                break
            values, slopes, x, self._dx = flow.run(self._dx, flow.dp(self._parameters))
            pieces.append((flow.grid, values, slopes))
            if number < len(changes):
                flow = self._change(flow, changes[number], number, float(part.t[-1]), x)
            elif ending is not None:
                self._end(flow, ending, float(part.t[-1]), x)
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

    def _change(self, flow: PhaseFlow, event: Event, number: int, time: float, x: np.ndarray) -> PhaseFlow | None:
        """Go across a change: the motion that follows, None if the motion ends just after it."""
        following = self._flow(number + 1)
        instant = _at_event(flow, event, time, x, self._dx, flow.dp(self._parameters))
        jumped, self._parameters = _Change(flow, following, event, instant).across(self._parameters)
        after = VariedState(time, following.x0, instant.dt, jumped, following.dp(self._parameters))
        values = flow.outputs_at(instant), following.outputs_at(after, starts=True)
        self._events.append(EventVariation(event.name, time, instant.dt, *values))
        if len(self._varied.motion.phases[number + 1]) < 2:
            self._dx = jumped
            return None
        self._dx = jumped - np.outer(following.rates(time, following.x0, starts=True), instant.dt)
        return following


def _changes(motion: Trajectory, events: Sequence[Event]) -> list[Event]:
    """The event of each change of a motion."""
    known = {event.name: event for event in events}
    chosen = []
    for event in motion.events:
        if event.name not in known:
            raise ModelError(
                f"sensitivities: event '{event.name}' of the motion is not in events=; give those of the run (a switch "
                "of exact friction has no derivative)"
            )
        if event.after is not None and known[event.name].becomes is None:
            raise ModelError(
                f"sensitivities: event '{event.name}' resets velocities; derivatives are carried through changes of "
                "the mechanism alone (becomes=, with restitution= for a bounce)"
            )
    for before in motion.phases[:-1]:
        here = [e for e in motion.events if e.after is not None and _is_at(e, float(before.t[-1]))]
        if len(here) != 1:
            names = ", ".join(f"'{e.name}'" for e in here)
            raise ModelError(
                f"sensitivities: the events {names} take place together at t = {before.t[-1]:.6g} s; which one is "
                "first for other values decides the motion, and there is no derivative"
            )
        if len(before) < 2:
            raise ModelError(f"sensitivities: event '{here[0].name}' takes place at the start of its phase")
        chosen.append(known[here[0].name])
    return chosen


def _is_at(event: EventOccurrence, time: float) -> bool:
    return abs(event.t - time) <= 4 * float(np.spacing(abs(time)))


def _ending(motion: Trajectory, events: Sequence[Event]) -> Event | None:
    """The event that ends a motion without a change; None if there is none."""
    known = {event.name: event for event in events}
    last = [e for e in motion.events if _is_at(e, float(motion.t[-1]))]
    return next((known[e.name] for e in last if known[e.name].terminal and known[e.name].becomes is None), None)


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


class _Change:
    """A change of the mechanism, across which variations are carried.

    Parameters
    ----------
    flow, following : PhaseFlow
        The phases before and after it.
    event : Event
        The event at which it takes place.
    instant : VariedState
        State just before, and its variations along with the instant.
    """

    def __init__(self, flow: PhaseFlow, following: PhaseFlow, event: Event, instant: VariedState):
        self._flow, self._following, self._event, self._instant = flow, following, event, instant
        self._law = ImpactLaw(following.eom, event.restitution)
        known = {symbol.element_hash() for symbol in ca.vertsplit(flow.eom.q)}
        coordinates = ca.vertsplit(following.eom.q)
        #: coordinates that go on, in the mechanism after it, and their places in the one before
        self._going_on = [k for k, symbol in enumerate(coordinates) if symbol.element_hash() in known]
        self._places = np.array(places_in(flow.eom.q, following.eom.q[self._going_on]), int)

    def across(self, parameters: dict[Any, np.ndarray]) -> tuple[np.ndarray, dict[Any, np.ndarray]]:
        """Variations of the state just after it, and of the parameters from there on."""
        parameters, states = dict(parameters), {}
        for symbol, value in self._event.new_values:
            row = self._flow.at(value, self._instant)[1].ravel()
            if isinstance(symbol, Parameter):
                parameters[symbol] = row
            elif isinstance(symbol, StateVariable):
                states[symbol] = row
        dp = self._following.dp(parameters)
        old, n = list(self._flow.mechanism.states), self._flow.eom.q.numel()
        dz = np.zeros((len(self._following.mechanism.states), self._instant.dt.size))
        for k, symbol in enumerate(self._following.mechanism.states):
            place = place_of(symbol, old)
            dz[k] = states.get(symbol, 0.0 if place is None else self._instant.dx[2 * n + place])
        dq, dv = self._carried(dz, dp)
        dv = self._jumped(dq, dv, dz, dp)
        return np.vstack([dq, dv, dz]), parameters

    def _carried(self, dz: np.ndarray, dp: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Variations of the coordinates just after it, and of the velocities just before it, of bodies that go on."""
        following, eom, law, dt = self._following, self._following.eom, self._law, self._instant.dt
        n_old, n = self._flow.eom.q.numel(), eom.q.numel()
        dq, dv = np.zeros((n, dt.size)), np.zeros((n, dt.size))
        dq[self._going_on], dv[self._going_on] = (self._instant.dx[k + self._places] for k in (0, n_old))
        rows = law.positions
        if not rows.numel():
            return dq, dv
        slopes = ca.Function(
            "rows",
            [eom.t, eom.q, eom.z, eom.p],
            [ca.densify(ca.jacobian(rows, x)) for x in (eom.q, eom.t, eom.z, eom.p)],
        )
        state = following.x0[:n], following.x0[2 * n : 2 * n + eom.z.numel()]
        by_q, by_t, by_z, by_p = (x.full() for x in slopes(self._instant.time, *state, following.p))
        new = [k for k in range(n) if k not in set(self._going_on)]
        open_ = by_q @ dq + by_t @ dt[None, :] + by_z @ dz + by_p @ dp
        if new:
            dq[new] = least_norm(by_q[:, new], -open_)
            open_ = open_ + by_q[:, new] @ dq[new]
        size = 1 + largest(dq) + largest(dt)
        if largest(open_) > CLOSING_TOLERANCE * size:
            worst = law.position_names[int(np.argmax(np.max(np.abs(open_), axis=1)))]
            raise SimulationError(
                f"sensitivities: for other values event '{self._event.name}' at t = {self._instant.time:.6g} s would "
                f"not find the position of '{worst}' closed; let a parameter in it take the value of that instant "
                "(reset=)",
                time=self._instant.time,
            )
        return dq, dv

    def _jumped(self, dq: np.ndarray, dv: np.ndarray, dz: np.ndarray, dp: np.ndarray) -> np.ndarray:
        """Variations of the velocities just after it: the law of impact, differentiated as an implicit function."""
        following, eom, law, time = self._following, self._following.eom, self._law, self._instant.time
        n_old, n = self._flow.eom.q.numel(), eom.q.numel()
        v_before = np.zeros(n)
        v_before[self._going_on] = self._instant.x[n_old + self._places]
        q, z = following.x0[:n], following.x0[2 * n : 2 * n + eom.z.numel()]
        _ = following.motion.numeric.mass_of_impulses  # raises if masses change
        jump = law.solve(following.motion.numeric, time, q, v_before, z)
        kept = [k for k in range(law.impulses.numel()) if k not in set(jump.dependent)]
        rows = ca.vertcat(law.momentum, law.velocity[kept])
        unknowns = ca.vertcat(eom.v, law.impulses[kept])
        known = [eom.t, eom.q, law.v_before, eom.z, eom.p]
        arguments = [*known, eom.v, law.impulses]
        slopes = ca.Function("impact", arguments, [ca.densify(ca.jacobian(rows, s)) for s in (unknowns, *known)])
        by_unknowns, by_t, by_q, by_v, by_z, by_p = (
            m.full() for m in slopes(time, q, v_before, z, following.p, jump.v, jump.impulses)
        )
        right = -(by_t @ self._instant.dt[None, :] + by_q @ dq + by_v @ dv + by_z @ dz + by_p @ dp)
        return np.asarray(least_norm(by_unknowns, right)[:n])


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
