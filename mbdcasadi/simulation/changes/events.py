"""Events of a run: their states from piece to piece, and what their expressions say of a state."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ...equations import Equations
from ...equations.scale import scale_of
from ...errors import ExpressionError, ModelError, SimulationError, warn
from ...integrators.native.stretch import Watched
from ...model.events import Event
from ...model.quantities import listed_by_name
from ...model.rates import time_derivative
from ...numerics.evaluation import Evaluator
from ...numerics.least_squares import largest
from ...numerics.tolerances import AT_REST, MET, NEGLIGIBLE, ZERO_VALUE
from ...results.state import State
from ..outputs import Outputs

#: Change of an expression, relative to the velocities or reactions, that may be rounding.
ROUNDING = 1e-11


class Accumulation:
    """Refuses events that take place ever faster, as the impacts of a ball that comes to rest.

    Parameters
    ----------
    remedy : str
        What to do instead, in words.
    answers : int
        Times in a row that an event may take place again at once if others take place between.
    """

    def __init__(self, remedy: str, answers: int = 0):
        self._remedy, self._answers = remedy, answers
        self._last: dict[Event, float] = {}
        self._in_a_row: dict[Event, int] = {}
        self._latest: set[Event] = set()

    def refuse(self, events: Sequence[Event], time: float, instant: float) -> None:
        """Take note of events that take place together; raise if one of them accumulates."""
        alone, self._latest = set(events) == self._latest, set(events)
        for event in events:
            before = self._last.get(event, -np.inf)
            self._last[event] = time
            at_once = time - before < 10 * instant
            self._in_a_row[event] = self._in_a_row.get(event, 0) + 1 if at_once else 0
            if at_once and (alone or self._in_a_row[event] > self._answers):
                raise SimulationError(
                    f"event '{event.name}' takes place ever faster: at t = {before:.12g} s and again "
                    f"{time - before:.3g} s later; {self._remedy}",
                    time=time,
                )


class Standing(Enum):
    """Where an event stands at the start of a piece of motion."""

    ARMED = "takes place once its expression changes sign"
    AT_ZERO = "is at its zero within rounding, and takes place once it goes beyond"
    LEAVING = "moves off its zero, and is measured from there"
    RESTING = "stands still at its zero, and is measured from there by more than rounding"


@dataclass
class EventState:
    """State of an event from one piece of motion to the next.

    Attributes
    ----------
    standing : Standing
        Where it stands.
    zero : float
        Value of the expression from which it is measured.
    side : float
        Its value at the start, of which the sign counts; 0 for that of the expression.
    band : float
        Size below which the sign is rounding, of one at its zero.
    is_reported : bool
        True if a warning has said that the expression is not a number.
    """

    standing: Standing = Standing.ARMED
    zero: float = 0.0
    side: float = 0.0
    band: float = 0.0
    is_reported: bool = False

    def become(self, standing: Standing, zero: float = 0.0, side: float = 0.0, band: float = 0.0) -> None:
        """Go on in another standing."""
        self.standing, self.zero, self.side, self.band = standing, zero, side, band

    def pass_on(self, value: float) -> None:
        """Go on after a piece of motion at whose end it has a value."""
        if self.standing is Standing.RESTING:
            return
        if self.standing is not Standing.AT_ZERO or not abs(value) <= 2 * self.band:
            self.become(Standing.ARMED)
        # projection may move it by rounding before the next piece
        self.side = value if np.isfinite(value) else 0.0


#: States of events, which several watches of a run share.
EventStates = defaultdict[Event, EventState]


class _Terms:
    """Expressions and functions of events; made once for a mechanism and some events.

    Attributes
    ----------
    rate_is_known : numpy.ndarray of bool
        By event.
    rates, derivatives : casadi.SX
        First derivatives of the expressions, and these above the second ones; 0 if the model does not know them.
    values, evaluator : casadi.Function, Evaluator
        The expressions.
    left_out : tuple of int or None
        Sizes of what a state need not be completed by, if no event contains accelerations, reactions or inputs.
    """

    def __init__(self, eom: Equations, events: Sequence[Event]):
        rates = [_rate(eom, e.expression) for e in events]
        self.rate_is_known = np.array([rate is not None for rate in rates], bool)
        self.rates = ca.vertcat(ca.SX(0, 1), *[ca.SX(0) if rate is None else rate for rate in rates])
        self.derivatives = ca.vertcat(self.rates, *[_second_rate(eom, e.expression) for e in events])
        expressions = ca.vertcat(ca.SX(0, 1), *[e.expression for e in events])
        self.values = eom.function(expressions)
        self.evaluator = Evaluator(self.values)
        needs = ca.depends_on(expressions, ca.vertcat(eom.a, eom.lam, eom.u))
        self.left_out = None if needs else (eom.a.numel(), eom.lam.numel(), eom.u.numel())


class EventWatch:
    """Looks for events among consecutive outputs.

    Parameters
    ----------
    instant : float
        Time that counts as one instant, s.
    states : EventStates, optional
        States of the events; several watches of a run share them. One with a reset that rests takes place again once
        its expression has moved away by more than rounding.
    own : sequence of Event, optional
        Events at which the equations cease to hold: a piece of motion starts on the side on which they do.
    """

    def __init__(
        self,
        eom: Equations,
        events: Sequence[Event],
        instant: float,
        states: EventStates | None = None,
        own: Sequence[Event] = (),
    ):
        self.events, self.instant = (*own, *events), instant
        self._own, self._directions = range(len(own)), np.array([event.direction for event in self.events])
        states = defaultdict(EventState) if states is None else states
        self.states = [states[event] for event in self.events]
        self._fineness = 1.0
        # of the last state: they are asked for again and again
        self._derivatives, self.at_zero = lru_cache(1)(self._derivatives_at), lru_cache(1)(self._at_zero)
        self._terms: _Terms = eom.mechanism.cache.get_or_create(
            ("events", *self.events), lambda: _Terms(eom, self.events), bounded=bool(self.events)
        )

    # --- for a method that looks at events inside its steps -----------------------------------
    def watched(self, decides: Callable[[Event], bool]) -> Watched | None:
        """Return what such a method needs to know of the events; None if there are none."""
        if not self.events:
            return None
        return Watched(
            self._terms.values,
            self._terms.left_out is None,
            np.sign(self._directions).astype(int),
            np.array([decides(event) for event in self.events]),
        )

    def levels(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return by event the value from which it is measured now, below which size its sign is rounding, and its side.

        Parameters
        ----------
        x : numpy.ndarray
            The present state.
        """
        if not self.events:
            return np.zeros(0), np.zeros(0), np.zeros(0)
        rests = np.array([state.standing is Standing.RESTING for state in self.states])
        zero, side = np.array([(state.zero, state.side) for state in self.states]).T
        away = self.away(x) if rests.any() else 0.0
        return zero, np.where(rests, away, 0.0), np.where(rests, [-e.direction or 1 for e in self.events], side)

    def away(self, x: np.ndarray) -> float:
        """Change of an expression by which an event that rests leaves its place, at some states."""
        return NEGLIGIBLE * self._fineness * (1 + largest(x))

    # --- values ------------------------------------------------------------------------------
    def values(self, outputs: Outputs, times: np.ndarray, x: np.ndarray, since: np.ndarray | None) -> np.ndarray:
        """Expressions of all events at outputs (k, n_events)."""
        if self._terms.left_out is None:
            t, q, v, a, z, lam, u = outputs.block(times, x, since)
        else:
            t, (q, v, z) = times, outputs.split(x)
            a, lam, u = (np.zeros((times.size, size)) for size in self._terms.left_out)
        return self._terms.evaluator.rows(t[:, None], q, v, a, z, lam, u, outputs.numeric.p)[0]

    def rates(self, state: State) -> np.ndarray:
        """Rates of the expressions at a state; 0 if the model does not know them."""
        return self._derivatives(state)[0]

    def rate_expression(self, index: int) -> ca.SX | None:
        """Rate of the expression of an event; None if the model does not know it."""
        return self._terms.rates[index] if self._terms.rate_is_known[index] else None

    def _derivatives_at(self, state: State) -> np.ndarray:
        """First and second derivatives at a state (2, n); 0 where they have none, as of a norm at zero."""
        if not self.events:
            return np.zeros((2, 0))
        values = state.equations.function(self._terms.derivatives)(*state.arguments).full()
        return np.nan_to_num(values).reshape(2, -1)

    def start_at(self, state: State, located: Sequence[Event] = ()) -> None:
        """Forget what was before: a piece of motion starts, and each expression on the side to which it goes.

        Parameters
        ----------
        located : sequence of Event
            Events that have just taken place: their expressions begin at zero, whatever the error of that place is.
        """
        for known in self.states:
            if known.standing is not Standing.RESTING:
                known.become(Standing.ARMED)
        if not self.events:
            return
        self._fineness = _fineness(state)
        close = MET * self._fineness * (1 + largest(state.q))
        near = [k for k, e in enumerate(self.events) if e in located and abs(float(state[e.expression])) <= close]
        rests = self.rests(state)
        for index in dict.fromkeys([*self.at_zero(state), *near]):
            self._begin_at_zero(index, state, rests[index])
        for index, event in enumerate(self.events):
            if index in self._own or (event not in located and self._is_of_reactions(index)):
                self._begin_before(index, state)

    def _begin_at_zero(self, index: int, state: State, rests: bool) -> None:
        """Let an event begin at its zero, on the side to which it goes."""
        event, known = self.events[index], self.states[index]
        if known.standing is Standing.RESTING:
            return
        value, side = float(state[event.expression]), self._side_after(index, state)
        if rests and (event.reset or event.becomes is not None or (side == 0 and index not in self._own)):
            known.become(Standing.RESTING, value)
        elif rests or side != 0:
            known.become(Standing.LEAVING, value, side)

    def _side_after(self, index: int, state: State) -> float:
        """Value of an expression at zero an instant later; zero if only its third derivative would tell."""
        rate, second = self._derivatives(state)[:, index]
        if abs(rate) > at_rest(state):
            return float(rate * self.instant)
        if abs(second) > NEGLIGIBLE * self._fineness * (1 + largest(state.a)):
            return float(second * self.instant**2 / 2)
        return 0.0

    def _is_of_reactions(self, index: int) -> bool:
        """True for an event that changes the motion in one direction of an expression whose rate is not known."""
        event = self.events[index]
        changes = event.reset or event.becomes is not None
        return bool(changes and event.direction) and not self._terms.rate_is_known[index]

    def _begin_before(self, index: int, state: State) -> None:
        """Let an event that is at its zero at a start, as friction without load, take place once it goes beyond it."""
        event, known = self.events[index], self.states[index]
        away = abs(self.rates(state)[index]) > at_rest(state) and event.direction * known.side < 0
        if known.standing is Standing.RESTING or (known.standing is Standing.LEAVING and away):
            return
        value = float(state[event.expression])
        size = largest(state.v) if self._terms.rate_is_known[index] else largest(state.lam)
        band = ROUNDING * max(size, abs(value)) + np.finfo(float).tiny
        beyond = event.direction * (value if known.standing is Standing.ARMED else known.side)
        if beyond < -band:
            return
        if beyond <= band or index in self._own:  # rounding, also of what decided that the equations hold
            known.become(Standing.AT_ZERO, value + event.direction * band, -event.direction * band, band)
        elif event.becomes is not None:  # a jump has led there: at once
            known.side = -event.direction * band

    def driven_through(self, state: State) -> list[Event]:
        """Events at their zeros that pass these in the direction in which they count."""
        through = self.moves_through(state)
        return [self.events[k] for k in self.at_zero(state) if through[k]]

    def moves_through(self, state: State) -> np.ndarray:
        """True for each expression at zero that passes it in the direction in which the event counts.

        One whose rate is not known, or that counts in both directions, does not.
        """
        moves: np.ndarray = self._terms.rate_is_known & (self._directions * self.rates(state) > at_rest(state))
        return moves

    def rests(self, state: State) -> np.ndarray:
        """True for each expression that stands still at a state; one whose rate is not known counts as moving."""
        rests: np.ndarray = self._terms.rate_is_known & (np.abs(self.rates(state)) <= at_rest(state))
        return rests

    def _at_zero(self, state: State) -> list[int]:
        """Events whose expressions vanish at a state, within an instant of its motion and within rounding."""
        if not self.events:
            return []
        size = ZERO_VALUE * _fineness(state) * (1 + largest(state.q))
        values = np.array([float(state[event.expression]) for event in self.events])
        limits = np.maximum(self.instant * np.abs(self.rates(state)), size)
        return [int(k) for k in np.flatnonzero(np.abs(values) <= limits)]

    def pressed_through(self, state: State) -> list[Event]:
        """Events at rest at their zeros, through which the accelerations press them."""
        limit = NEGLIGIBLE * _fineness(state) * (1 + largest(state.a))
        pressed = self.rests(state) & (self._directions * self._derivatives(state)[1] > limit)
        return [self.events[k] for k in self.at_zero(state) if pressed[k]]

    # --- between outputs --------------------------------------------------------------------------
    def measured(self, values: np.ndarray, x: np.ndarray) -> dict[int, int]:
        """Measure values of all events over a piece (k, n_events), in place, as their states ask for.

        Parameters
        ----------
        x : numpy.ndarray
            States there (k, n_x).

        Returns
        -------
        dict of int to int
            Events that rested until they left their places, and the first output after that.
        """
        left, away = {}, self.away(x)
        for index, (event, known) in enumerate(zip(self.events, self.states, strict=True)):
            own = values[:, index]
            if known.standing is not Standing.RESTING:
                own[1:] -= known.zero
                own[0] = known.side or own[0]
                continue
            moved = own - known.zero
            leaves = np.abs(moved) > away
            first = int(np.argmax(leaves))
            stands = event.reset or event.becomes is not None  # others only leave their zeros
            if leaves[first] and (not stands or event.direction * moved[first] < 0):
                known.become(Standing.ARMED)
                left[index] = first
                own[:first] = np.sign(moved[first]) * np.finfo(float).tiny
            else:  # none of its rounding
                own[:] = np.where(leaves, moved, (-event.direction or 1) * np.finfo(float).tiny)
        return left

    def report_not_a_number(self, times: np.ndarray, values: np.ndarray) -> None:
        """Warn once of an event whose expression has no value: it cannot be found from there on."""
        for index in np.flatnonzero(np.any(np.isnan(values), axis=0)):
            if not self.states[index].is_reported:
                self.states[index].is_reported = True
                time = float(times[np.argmax(np.isnan(values[:, index]))])
                warn(
                    f"event '{self.events[index].name}': its expression is not a number at t = {time:.6g} s (a root of "
                    "a negative number, or a division by zero); there it cannot take place"
                )


def at_rest(state: State) -> float:
    """Rate of an expression, relative to the velocities of a state, below which it does not move."""
    return AT_REST * _fineness(state) * (1 + largest(state.v))


def _fineness(state: State) -> float:
    """Share of the usual tolerances that the mechanism of a state takes."""
    eom = state.equations
    return scale_of(eom, state.parameters, eom.masses(state.parameters)).fineness


def _rate(eom: Equations, expression: ca.SX) -> ca.SX | None:
    """Rate of an expression; None if the model does not know it: of accelerations, reactions and inputs."""
    if ca.depends_on(expression, ca.vertcat(eom.a, eom.lam, eom.u)):
        return None
    try:
        return time_derivative(expression, eom.mechanism)
    except ExpressionError:  # the rate of a state may contain what has none
        return None


def _second_rate(eom: Equations, expression: ca.SX) -> ca.SX:
    rate = _rate(eom, expression)
    second = None if rate is None else _rate(eom, ca.substitute(rate, eom.a, ca.SX.zeros(eom.a.numel())))
    if rate is None or second is None:
        return ca.SX(0)
    # accelerations enter the rate only of an expression in velocities; its second derivative is not known then
    return ca.SX(0) if ca.depends_on(rate, eom.a) else second


def refuse_events(events: Any, analysis: str) -> None:
    """Raise ModelError for events in an analysis that takes none."""
    if read_events(events):
        raise ModelError(
            f"{analysis}: events= is not taken here, and {analysis} runs over all of times=; simulate takes events for "
            "one motion, sensitivities for its derivatives; a force may switch by if_else instead"
        )


def read_events(events: Any) -> tuple[Event, ...]:
    """Events as they were given, checked."""
    return events if isinstance(events, tuple) and not events else listed_by_name(events, Event, "events=")
