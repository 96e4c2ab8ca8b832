"""Events of a run: found between consecutive outputs, located by integrating again to trial times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
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
from ...numerics.roots import bracketed_root, may_touch, narrowed_extrema, nears_zero
from ...numerics.tolerances import AT_REST, ZERO_VALUE
from ...results.state import State
from ..outputs import Outputs
from ..path import StatesAt, StatesFrom

#: Change of an expression, relative to the coordinates and velocities, by which an event at rest leaves its place.
AWAY = 1e-9
#: Expression, relative to the coordinates, below which an event that was located counts as at its zero: short
#: integrations that end at other times differ by the error of the integrator.
LOCATED = 1e-6
#: Acceleration through the zero of an event, relative to the accelerations, that counts as none.
NO_PRESSURE = 1e-9
#: Change of an expression, relative to the velocities or reactions, that may be rounding.
ROUNDING = 1e-11
#: Points at which an interval is looked at, inside which an expression may have touched zero between two outputs.
CLOSER_POINTS = 16
_NONE = np.zeros(0)


@dataclass(frozen=True)
class Crossing:
    """An event that was located.

    Attributes
    ----------
    event : Event
        The event.
    time : float
        Its time, s.
    x : numpy.ndarray
        State there.
    interval : int
        Output interval in which it took place.
    """

    event: Event
    time: float
    x: np.ndarray
    interval: int


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


class _Terms:
    """Expressions and functions of events; made once for a mechanism and some events.

    Attributes
    ----------
    rate_is_known : list of bool
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
        self.rate_is_known = [rate is not None for rate in rates]
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
    resting : dict of Event to float, optional
        Events that stand still at their zero, and the values of their expressions there; several watches of a run
        share it. One with a reset takes place again once its expression has moved away by more than rounding.
    own : sequence of Event, optional
        Events at which the equations cease to hold: a piece of motion starts on the side on which they do.
    """

    def __init__(
        self,
        eom: Equations,
        events: Sequence[Event],
        instant: float,
        resting: dict[Event, float] | None = None,
        own: Sequence[Event] = (),
    ):
        self.events, self.instant = (*own, *events), instant
        self._own = range(len(own))
        self.resting = {} if resting is None else resting
        self._side: dict[int, float] = {}
        self._offset: dict[int, float] = {}
        self._band: dict[int, float] = {}
        self._left: dict[int, int] = {}
        self._not_a_number: set[int] = set()
        self._fineness = 1.0
        self._state: State | None = None
        self._known: dict[str, Any] = {}
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
            np.sign([event.direction for event in self.events]).astype(int),
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
            return _NONE, _NONE, _NONE
        offset, band, side = (np.zeros(len(self.events)) for _ in range(3))
        away = AWAY * self._fineness * (1 + largest(x)) if self.resting else 0.0
        for k, event in enumerate(self.events):
            if event in self.resting:
                offset[k], band[k], side[k] = self.resting[event], away, -event.direction or 1
            else:
                offset[k], side[k] = self._offset.get(k, 0.0), self._side.get(k, 0.0)
        return offset, band, side

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

    def accelerations(self, state: State) -> np.ndarray:
        """Second derivatives of the expressions at a state; 0 if the model does not know them."""
        return self._derivatives(state)[1]

    def _derivatives(self, state: State) -> np.ndarray:
        """First and second derivatives at a state (2, n); 0 where they have none, as of a norm at zero."""

        def found() -> np.ndarray:
            if not self.events:
                return np.zeros((2, 0))
            values = state.equations.function(self._terms.derivatives)(*state.arguments).full()
            return np.nan_to_num(values).reshape(2, -1)

        return self._once(state, "derivatives", found)

    def _once(self, state: State, key: str, find: Callable[[], Any]) -> Any:
        """Result at a state; that at the last one is kept."""
        if self._state is not state:
            self._state, self._known = state, {}
        if key not in self._known:
            self._known[key] = find()
        return self._known[key]

    def start_at(self, state: State, located: Sequence[Event] = ()) -> None:
        """Forget what was before: a piece of motion starts, and each expression on the side to which it goes.

        Parameters
        ----------
        located : sequence of Event
            Events that have just taken place: their expressions begin at zero, whatever the error of that place is.
        """
        self._side, self._offset, self._band = {}, {}, {}
        if not self.events:
            return
        rates, seconds, rests = self.rates(state), self.accelerations(state), self.rests(state)
        self._fineness = fineness = _fineness(state)
        close = LOCATED * fineness * (1 + largest(state.q))
        near = [
            k
            for k, event in enumerate(self.events)
            if event in located and abs(float(state[event.expression])) <= close
        ]
        for index in dict.fromkeys([*self.at_zero(state), *near]):
            event = self.events[index]
            if (event.reset or event.becomes is not None) and rests[index]:
                self.resting.setdefault(event, float(state[event.expression]))
                continue
            # the value an instant later; zero if only its third derivative would tell
            value = 0.0
            if abs(rates[index]) > at_rest(state):
                value = rates[index] * self.instant
            elif abs(seconds[index]) > NO_PRESSURE * fineness * (1 + largest(state.a)):
                value = seconds[index] * self.instant**2 / 2
            if value != 0 or (rests[index] and index in self._own):
                self._side[index] = value
                self._offset[index] = float(state[event.expression])
            elif rests[index]:
                self.resting.setdefault(event, float(state[event.expression]))
        for index, event in enumerate(self.events):
            if index in self._own or (event not in located and self._is_of_reactions(index)):
                self._begin_before(index, state)

    def _is_of_reactions(self, index: int) -> bool:
        """True for an event that changes the motion in one direction of an expression whose rate is not known."""
        event = self.events[index]
        changes = event.reset or event.becomes is not None
        return bool(changes and event.direction) and not self._terms.rate_is_known[index]

    def _begin_before(self, index: int, state: State) -> None:
        """Let an event that is at its zero at a start, as friction without load, take place once it goes beyond it."""
        event, value = self.events[index], float(state[self.events[index].expression])
        size = largest(state.v) if self._terms.rate_is_known[index] else largest(state.lam)
        band = ROUNDING * max(size, abs(value)) + np.finfo(float).tiny
        beyond = event.direction * self._side.get(index, value)
        if beyond < -band:
            return
        if beyond <= band or index in self._own:  # rounding, also of what decided that the equations hold
            self._band[index], self._side[index] = band, -event.direction * band
            self._offset[index] = value + event.direction * band
        elif event.becomes is not None:  # a jump has led there: at once
            self._side[index] = -event.direction * band

    def moves_through(self, state: State) -> list[bool]:
        """True for each expression at zero that passes it in the direction in which the event counts.

        One whose rate is not known, or that counts in both directions, does not.
        """
        limit = at_rest(state)
        return [
            known and event.direction * rate > limit
            for event, rate, known in zip(self.events, self.rates(state), self._terms.rate_is_known, strict=True)
        ]

    def rests(self, state: State) -> list[bool]:
        """True for each expression that stands still at a state; one whose rate is not known counts as moving."""
        limit = at_rest(state)
        return [
            known and abs(rate) <= limit
            for rate, known in zip(self.rates(state), self._terms.rate_is_known, strict=True)
        ]

    def at_zero(self, state: State) -> list[int]:
        """Events whose expressions vanish at a state, within an instant of its motion and within rounding."""

        def found() -> list[int]:
            size = ZERO_VALUE * _fineness(state) * (1 + largest(state.q))
            values = np.array([float(state[event.expression]) for event in self.events])
            limits = np.maximum(self.instant * np.abs(self.rates(state)), size)
            return [int(k) for k in np.flatnonzero(np.abs(values) <= limits)]

        return self._once(state, "at zero", found) if self.events else []

    def pressed_through(self, state: State) -> list[Event]:
        """Events at rest at their zeros, through which the accelerations press them."""
        rests, seconds = self.rests(state), self.accelerations(state)
        limit = NO_PRESSURE * _fineness(state) * (1 + largest(state.a))
        return [
            self.events[k] for k in self.at_zero(state) if rests[k] and self.events[k].direction * seconds[k] > limit
        ]

    # --- finding --------------------------------------------------------------------------------
    def crossings(
        self,
        outputs: Outputs,
        times: np.ndarray,
        x: np.ndarray,
        states_from: StatesFrom,
        decides: Callable[[Event], bool],
    ) -> list[Crossing]:
        """Events among outputs in order of time, up to the instant of the first that decides how the run goes on.

        Parameters
        ----------
        times, x : numpy.ndarray
            Start and outputs of a piece (k + 1,), (k + 1, n_x).
        states_from : callable
            Motion from an output on.
        decides : callable
            True if the run ends, or goes on otherwise, at an event.
        """
        since = np.r_[times[0], times[:-1]]
        values = self.values(outputs, times, x, since)
        self._report_not_a_number(times, values)
        for index, value in self._side.items():
            values[0, index] = value
        for index, offset in self._offset.items():  # what is at its zero at the start is measured from there
            values[1:, index] -= offset
        self._wake(x, values)
        touched = self._may_touch(times, values)
        crossings: list[Crossing] = []
        for k in range(len(times) - 1):
            crossed = [i for i, e in enumerate(self.events) if _crossed(e, values[k, i], values[k + 1, i])]
            if not crossed and not touched[k]:
                continue
            states_at = states_from(float(times[k]), x[k])
            located = [self._located(outputs, i, times[k : k + 2], values[k : k + 2, i], states_at) for i in crossed]
            here = [(i, time) for i, time in zip(crossed, located, strict=True)]
            here += [
                (i, time)
                for i in touched[k]
                if i not in crossed
                for time in self._closer(outputs, i, times[k : k + 2], values[k : k + 2, i], states_at, k)
            ]
            here.sort(key=lambda item: item[1])
            states = states_at(np.array([time for _, time in here])) if here else np.zeros((0, x.shape[1]))
            met = [Crossing(self.events[i], time, y, k) for (i, time), y in zip(here, states, strict=True)]
            for n, crossing in enumerate(met):
                if decides(crossing.event):
                    return crossings + [c for c in met[n:] if c.time - crossing.time <= self.instant]
                crossings.append(crossing)
        # projection may move them by rounding before the next piece
        self._side = {i: float(value) for i, value in enumerate(values[-1]) if value != 0 and np.isfinite(value)}
        self._band = {i: band for i, band in self._band.items() if abs(values[-1, i]) <= 2 * band}
        self._offset = {i: self._offset[i] for i in self._band}
        return crossings

    def _wake(self, x: np.ndarray, values: np.ndarray) -> None:
        """Measure resting events from where they rest, and none of their rounding."""
        size = AWAY * self._fineness * (1 + largest(x))
        self._left = {}
        for index, event in enumerate(self.events):
            if event not in self.resting:
                continue
            moved = values[:, index] - self.resting[event]
            away = np.abs(moved) > size
            first = int(np.argmax(away))
            stands = event.reset or event.becomes is not None  # others only leave their zeros
            if away[first] and (not stands or event.direction * moved[first] < 0):
                del self.resting[event]
                self._left[index] = first
                values[:first, index] = np.sign(moved[first]) * np.finfo(float).tiny
                continue
            side = -event.direction or 1
            values[:, index] = np.where(away, moved, side * np.finfo(float).tiny)

    def _may_touch(self, times: np.ndarray, values: np.ndarray) -> list[list[int]]:
        """Events by interval whose expressions may pass zero and come back between two outputs.

        Parabolas through three neighbouring outputs estimate the extremum inside.
        """
        candidates: list[list[int]] = [[] for _ in range(times.size - 1)]
        if times.size < 3:
            return candidates
        h = np.diff(times)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):  # of an interval of no length there is no parabola
            slopes = np.diff(values, axis=0) / h
            curvature = (slopes[1:] - slopes[:-1]) / (h[1:] + h[:-1])
        same = (np.sign(values[:-1]) == np.sign(values[1:])) & (values[:-1] != 0)
        for first, bend in ((slice(0, -1), curvature), (slice(1, None), curvature)):
            near = nears_zero(values[:-1][first], values[1:][first], h[first], bend)
            offset = first.start or 0
            for k, i in np.argwhere(near & same[first]):
                if int(i) not in candidates[int(k) + offset]:
                    candidates[int(k) + offset].append(int(i))
        return candidates

    def _closer(
        self, outputs: Outputs, index: int, ends: np.ndarray, values: np.ndarray, states_at: StatesAt, interval: int
    ) -> list[float]:
        """Times inside an interval at which an event takes place whose expression returns to its side by the end.

        That of an event that rested until there counts from where it has left its place by more than rounding.
        """

        def values_at(times: np.ndarray) -> np.ndarray:
            own: np.ndarray = self.values(outputs, times, states_at(times), np.full(times.size, ends[0]))[:, index]
            return own - self._zero_of(index)

        left = self._left.get(index, 0)
        if interval + 1 < left:
            return []
        times = np.linspace(ends[0], ends[1], CLOSER_POINTS + 2)
        course = np.r_[values[0], values_at(times[1:-1]), values[1]]
        if interval < left:
            leaves = np.argmax(np.abs(course) > AWAY * self._fineness * (1 + largest(states_at(times[-1:]))))
            times, course = times[leaves:], course[leaves:]
        peak = _peak_near_zero(times, course, values_at)
        if peak is not None:
            times, course = (np.insert(old, peak[0], new) for old, new in ((times, peak[1]), (course, peak[2])))
        crossings = []
        for k in range(course.size - 1):
            if _crossed(self.events[index], course[k], course[k + 1]):
                crossings.append(self._located(outputs, index, times[k : k + 2], course[k : k + 2], states_at, ends[0]))
        return crossings

    def _located(
        self,
        outputs: Outputs,
        index: int,
        ends: np.ndarray,
        values: np.ndarray,
        states_at: StatesAt,
        since: float | None = None,
    ) -> float:
        """Time of an event between two times, to rounding."""
        low, high = float(ends[0]), float(ends[1])
        begin = np.array([low if since is None else since])
        zero = self._zero_of(index)

        def value_at(time: float) -> float:
            return float(self.values(outputs, np.array([time]), states_at(np.array([time])), begin)[0, index]) - zero

        return bracketed_root(value_at, low, high, float(values[0]), float(values[1]))

    def _zero_of(self, index: int) -> float:
        """Value from which the expression of an event is measured."""
        return self.resting.get(self.events[index], self._offset.get(index, 0.0))

    def _report_not_a_number(self, times: np.ndarray, values: np.ndarray) -> None:
        """Warn once of an event whose expression has no value: it cannot be found from there on."""
        for index in np.flatnonzero(np.any(np.isnan(values), axis=0)):
            if int(index) not in self._not_a_number:
                self._not_a_number.add(int(index))
                time = float(times[np.argmax(np.isnan(values[:, index]))])
                warn(
                    f"event '{self.events[index].name}': its expression is not a number at t = {time:.6g} s (a root of "
                    "a negative number, or a division by zero); there it cannot take place"
                )


def _peak_near_zero(
    times: np.ndarray, course: np.ndarray, values_at: Callable[[np.ndarray], np.ndarray]
) -> tuple[int, float, float] | None:
    """Place among samples of one sign, time and value of an extremum that may be beyond zero; None if there is none."""
    if course.size < 3:
        return None
    k = int(np.argmin(np.abs(course[1:-1]))) + 1
    sign = np.sign(course[k])
    if np.any(np.sign(course) != sign) or sign == 0:
        return None
    if not may_touch(times[k - 1], course[k - 1], times[k], course[k], times[k + 1], course[k + 1]):
        return None
    bracket = times[k - 1 : k], times[k + 1 : k + 2]
    (time,) = narrowed_extrema(lambda points: values_at(points.ravel())[None, :], *bracket, np.array([-sign]))
    return k + int(time > times[k]), float(time), float(values_at(np.array([time]))[0])


def _crossed(event: Event, before: float, after: float) -> bool:
    rising, falling = before < 0 <= after, before > 0 >= after
    return rising if event.direction > 0 else falling if event.direction < 0 else rising or falling


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
