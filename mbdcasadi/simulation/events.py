"""Events between two outputs, located by integrating again to trial times."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ExpressionError, ModelError
from ..model.events import Event
from ..model.rates import time_derivative
from ..numerics.roots import bracketed_root
from ..results.state import State
from .outputs import Outputs

#: ``time -> state``: a short integration from an output to a time after it.
Way = Callable[[float], np.ndarray]
#: ``(start, state, channel) -> way`` from an output on.
WayFrom = Callable[[float, np.ndarray, "np.ndarray | None"], Way]


@dataclass(frozen=True)
class Crossing:
    """An event that was located.

    Attributes
    ----------
    event : Event
        Which one.
    time : float
        When, s.
    x : numpy.ndarray
        State there.
    interval : int
        Output before which it took place, by index.
    channel : numpy.ndarray or None
        Inputs of its interval.
    """

    event: Event
    time: float
    x: np.ndarray
    interval: int
    channel: np.ndarray | None


class EventWatch:
    """Looks for events among consecutive outputs.

    Parameters
    ----------
    eom : Equations
        Equations of the mechanism.
    events : sequence of Event
        What to look for.
    """

    def __init__(self, eom: Equations, events: Sequence[Event]):
        self.events = read_events(events)
        names = [event.name for event in self.events]
        if len(set(names)) < len(names):
            raise ModelError(f"events= holds a name twice: {', '.join(names)}")
        #: time that counts as one instant, s; the run says how long that is
        self.instant = 1e-12
        self._behind: dict[int, float] = {}
        self._rates = ca.vertcat(ca.SX(0, 1), *[self._rate(eom, e) for e in self.events])
        expressions = ca.vertcat(ca.SX(0, 1), *[e.expression for e in self.events])
        self._values = eom.function(expressions)
        #: sizes of what a state need not be completed by, where no event asks for accelerations, reactions or inputs
        needs = ca.depends_on(expressions, ca.vertcat(eom.a, eom.lam, eom.u))
        self._left_out = None if needs else (eom.a.numel(), eom.lam.numel(), eom.u.numel())

    def values(self, outputs: Outputs, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None) -> np.ndarray:
        """Expressions of all events at outputs (k, n_events)."""
        if self._left_out is None:
            t, q, v, a, z, lam, u = outputs.block(times, x, channel)
        else:
            t, (q, v, z) = times, outputs.split(x)
            a, lam, u = (np.zeros((times.size, size)) for size in self._left_out)
        return self._values(t[None, :], q.T, v.T, a.T, z.T, lam.T, u.T, outputs.numeric.p).full().T

    @staticmethod
    def _rate(eom: Equations, event: Event) -> ca.SX:
        try:
            return time_derivative(event.expression, eom.mechanism)
        except ExpressionError:  # it holds accelerations or reactions
            return ca.SX(0)

    @staticmethod
    def _crossed(event: Event, before: float, after: float) -> bool:
        rising, falling = before < 0 <= after, before > 0 >= after
        return rising if event.direction > 0 else falling if event.direction < 0 else rising or falling

    def crossings(
        self, outputs: Outputs, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None, way_from: WayFrom
    ) -> list[Crossing]:
        """Events among outputs, in order of time, up to the first that ends the run or resets velocities.

        Parameters
        ----------
        outputs : Outputs
            Makes outputs of states.
        times, x : numpy.ndarray
            Start and outputs of a chunk (k + 1,), (k + 1, n_x).
        channel : numpy.ndarray or None
            Inputs by interval (channel, k).
        way_from : callable
            Gives the way from an output on.
        """
        columns = None if channel is None else np.hstack([channel[:, :1], channel[:, : len(times) - 1]])
        values = self.values(outputs, times, x, columns)
        for index, value in self._behind.items():
            values[0, index] = value
        self._behind = {}
        found: list[Crossing] = []
        for k in range(len(times) - 1):
            crossed = [i for i, e in enumerate(self.events) if self._crossed(e, values[k, i], values[k + 1, i])]
            if not crossed:
                continue
            column = None if channel is None else channel[:, k : k + 1]
            way, here = way_from(times[k], x[k], column), []
            for index in crossed:
                at = self._located(outputs, index, times[k : k + 2], values[k : k + 2, index], column, way)
                here.append(Crossing(self.events[index], at, way(at), k, column))
            here.sort(key=lambda c: c.time)
            for n, crossing in enumerate(here):
                if crossing.event.terminal or crossing.event.reset:
                    return found + self._at_once(here[n:])
                found.append(crossing)
        return found

    def _at_once(self, following: Sequence[Crossing]) -> list[Crossing]:
        """Events at the instant of a first one that ends the run or resets velocities, the one that decides last."""
        first = following[0]
        same = [c for c in following if not c.event.reset and c.time - first.time <= self.instant]
        last = ([first] + [c for c in same if c.event.terminal])[-1]
        return [c for c in same if c is not last] + [last]

    def reset_at(self, state: State) -> None:
        """Take note of a state just after a reset: events at their zero there start on the side to which they go."""
        self._behind = {}
        for index, rate in enumerate(self.rates(state)):
            value = float(state[self.events[index].expression])
            if rate != 0 and abs(value) <= self.instant * abs(rate):
                self._behind[index] = rate * self.instant

    def rates(self, state: State) -> np.ndarray:
        """Rates of the events' expressions at a state; 0 where the model does not know them."""
        return np.atleast_1d(state[self._rates]) if self.events else np.zeros(0)

    def _located(
        self,
        outputs: Outputs,
        index: int,
        ends: np.ndarray,
        values: np.ndarray,
        channel: np.ndarray | None,
        way: Way,
    ) -> float:
        """Time of an event between two outputs, to rounding."""
        low, high = float(ends[0]), float(ends[1])

        def value_at(time: float) -> float:
            return float(self.values(outputs, np.array([time]), way(time)[None, :], channel)[0, index])

        accuracy = 4e-16 * max(abs(low), abs(high)) + 1e-13 * (high - low)
        return bracketed_root(value_at, low, high, float(values[0]), float(values[1]), accuracy)


def read_events(events: Any) -> tuple[Event, ...]:
    """Events as they were given, checked."""
    if isinstance(events, Event):
        raise ModelError(f"events= takes a list: write events=[{events!r}]")
    for event in events:
        if not isinstance(event, Event):
            raise ModelError(f"events= takes Event objects, got {event!r}")
    return tuple(events)
