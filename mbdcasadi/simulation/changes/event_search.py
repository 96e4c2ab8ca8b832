"""Events between the outputs of a piece: found by changes of sign, located by integrating again to trial times."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from ...model.events import Event
from ...numerics.roots import bracketed_root, may_touch, narrowed_extrema
from ..outputs import Outputs
from ..path import StatesAt, StatesFrom
from .events import EventWatch, Standing

#: Points at which an interval is looked at, inside which an expression may have touched zero between two outputs.
CLOSER_POINTS = 16


@dataclass(frozen=True, eq=False)
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


class EventSearch:
    """Looks for events on a path between its outputs.

    Parameters
    ----------
    watch : EventWatch
        Events, and their states at the start of the path.
    times, x : numpy.ndarray
        Start and outputs of a piece (k + 1,), (k + 1, n_x).
    states_from : callable
        Motion from an output on.
    """

    def __init__(self, watch: EventWatch, outputs: Outputs, times: np.ndarray, x: np.ndarray, states_from: StatesFrom):
        self._watch, self._outputs, self._times, self._x, self._states_from = watch, outputs, times, x, states_from
        self._values = watch.values(outputs, times, x, np.r_[times[0], times[:-1]])
        watch.report_not_a_number(times, self._values)
        self._left = watch.measured(self._values, x)

    def crossings(self, decides: Callable[[Event], bool]) -> list[Crossing]:
        """Events in order of time, up to the instant of the first that decides how the run goes on.

        Parameters
        ----------
        decides : callable
            True if the run ends, or goes on otherwise, at an event.
        """
        crossings: list[Crossing] = []
        for met in self._by_interval():
            for n, crossing in enumerate(met):
                if decides(crossing.event):
                    return crossings + [c for c in met[n:] if c.time - crossing.time <= self._watch.instant]
                crossings.append(crossing)
        for known, value in zip(self._watch.states, self._values[-1].tolist(), strict=True):
            known.pass_on(value)
        return crossings

    def _by_interval(self) -> Iterator[list[Crossing]]:
        """Events of each output interval that has some, in order of time."""
        events, values = self._watch.events, self._values
        touched = [np.flatnonzero(row).tolist() for row in may_touch(self._times, values)]
        for k in range(self._times.size - 1):
            crossed = [i for i, e in enumerate(events) if _crossed(e, values[k, i], values[k + 1, i])]
            if not crossed and not touched[k]:
                continue
            states_at = self._states_from(float(self._times[k]), self._x[k])
            ends, begin = self._times[k : k + 2], float(self._times[k])
            found = [(self._first(i, k, ends, states_at, begin), i) for i in crossed]
            found += [(t, i) for i in touched[k] if i not in crossed for t in self._closer(i, k, states_at)]
            if not found:
                continue
            found.sort(key=lambda place: place[0])
            states = states_at(np.array([time for time, _ in found]))
            yield [Crossing(events[i], time, y, k) for (time, i), y in zip(found, states, strict=True)]

    def _first(self, index: int, interval: int, ends: np.ndarray, states_at: StatesAt, begin: float) -> float:
        """Time of an event in an interval; of one that moves off its zero, after it has left the rounding of that."""
        values = self._values[interval : interval + 2, index]
        if interval == 0 and self._watch.states[index].standing is Standing.LEAVING:
            course, after = partial(self._course, index, states_at, begin), self._watch.instant
            while after < ends[1] - ends[0]:
                time = np.array([ends[0] + after])
                left = course(time)
                if left[0] * values[0] > 0:
                    ends, values = np.r_[time, ends[1]], np.r_[left, values[1]]
                    break
                after *= 2
        return self._located(index, ends, values, states_at, begin)

    def _closer(self, index: int, interval: int, states_at: StatesAt) -> list[float]:
        """Times inside an interval at which an event takes place whose expression returns to its side by the end.

        That of an event that rested until there counts from where it has left its place by more than rounding.
        """
        left, begin = self._left.get(index, 0), float(self._times[interval])
        if interval + 1 < left:
            return []
        times = np.linspace(begin, self._times[interval + 1], CLOSER_POINTS + 2)
        values_at = partial(self._course, index, states_at, begin)
        course = np.r_[self._values[interval, index], values_at(times[1:-1]), self._values[interval + 1, index]]
        if interval < left:
            leaves = np.argmax(np.abs(course) > self._watch.away(states_at(times[-1:])))
            times, course = times[leaves:], course[leaves:]
        peak = _peak_near_zero(times, course, values_at)
        if peak is not None:
            times, course = (np.insert(old, peak[0], new) for old, new in ((times, peak[1]), (course, peak[2])))
        event = self._watch.events[index]
        crossed = [k for k in range(course.size - 1) if _crossed(event, course[k], course[k + 1])]
        return [self._located(index, times[k : k + 2], course[k : k + 2], states_at, begin) for k in crossed]

    def _course(self, index: int, states_at: StatesAt, begin: float, times: np.ndarray) -> np.ndarray:
        """Values of an event at times (k,), with the inputs of the interval that begins at one."""
        values = self._watch.values(self._outputs, times, states_at(times), np.full(times.size, begin))
        own: np.ndarray = values[:, index] - self._watch.states[index].zero
        return own

    def _located(self, index: int, ends: np.ndarray, values: np.ndarray, states_at: StatesAt, begin: float) -> float:
        """Time of an event between two times, to rounding."""
        course = partial(self._course, index, states_at, begin)
        return bracketed_root(course, float(ends[0]), float(ends[1]), float(values[0]), float(values[1]))


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
    if not may_touch(times[k - 1 : k + 2], course[k - 1 : k + 2, None]).any():
        return None
    bracket = times[k - 1 : k], times[k + 1 : k + 2]
    (time,) = narrowed_extrema(lambda points: values_at(points.ravel())[None, :], *bracket, np.array([-sign]))
    return k + int(time > times[k]), float(time), float(values_at(np.array([time]))[0])


def _crossed(event: Event, before: float, after: float) -> bool:
    rising, falling = before < 0 <= after, before > 0 >= after
    return rising if event.direction > 0 else falling if event.direction < 0 else rising or falling
