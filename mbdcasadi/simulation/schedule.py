"""The times of a run: outputs, times that no step may cross, and those at which the integrator restarts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..numerics.lazy import cached_property
from ..numerics.real import distinct
from ..numerics.tolerances import NEGLIGIBLE

#: Pieces of a run: each start of an integrator costs, and progress, cancelling and partial results need some.
PIECES = 20
#: Points at which a run looks for singular poses and for events, at least.
WATCH_POINTS = 400
#: A multistep method starts with some hundred small steps of low order: pieces that take fewer steps than this are
#: joined (measured: twenty pieces of 140 steps take three times as long as one; of a four-bar pieces of 1000 steps take
#: a quarter longer than of 3000, at equal error, as each costs some milliseconds beside its steps).
STEPS_PER_PIECE = 3000


@dataclass(frozen=True)
class Piece:
    """A stretch of a run over which the integrator is started once.

    Attributes
    ----------
    start : float
        Time at which it starts, s.
    times : numpy.ndarray
        Outputs of the integrator, the last one its end.
    requested : numpy.ndarray of bool
        True for those that are outputs of the user.
    stops : numpy.ndarray of bool
        Over which of them no step may go.
    ends_at_jump : bool
        True if the equations jump at its end, and belong to its inside up to there.
    starts_at_jump : bool
        True if the equations jump at its start, and belong to its inside from there.
    """

    start: float
    times: np.ndarray
    requested: np.ndarray
    stops: np.ndarray
    ends_at_jump: bool = False
    starts_at_jump: bool = False

    @property
    def length(self) -> float:
        """Duration, s."""
        return float(self.times[-1] - self.start)

    @cached_property
    def begins(self) -> np.ndarray:
        """Start of each output interval."""
        return np.concatenate([[self.start], self.times[:-1]])

    @property
    def _margin(self) -> float:
        return 8 * math.ulp(max(abs(self.start), abs(self.times[-1])))

    @property
    def after(self) -> float:
        """Time just after its end, by some roundings."""
        return float(self.times[-1]) + self._margin

    @property
    def inside(self) -> tuple[float, np.ndarray]:
        """Start and outputs for the integrator: by some roundings off the jumps at the ends."""
        start, times = self.start, self.times
        if not (self.starts_at_jump or self.ends_at_jump):
            return start, times
        margin = self._margin
        if self.starts_at_jump and times[0] - start > 2 * margin:
            start += margin
        if self.ends_at_jump and times[-1] - np.r_[start, times][-2] > 2 * margin:
            times = np.r_[times[:-1], times[-1] - margin]
        return start, times

    def refined(self, times: np.ndarray) -> Piece:
        """The part of it that ends with the last of other times, with these instead of its own.

        Parameters
        ----------
        times : numpy.ndarray
            Increasing; its own ones up to the last of them, and others in between.
        """
        if times.size == self.times.size and (times == self.times).all():
            return self
        place = np.minimum(self.times.searchsorted(times), self.times.size - 1)
        known = self.times[place] == times
        ends_at_jump = self.ends_at_jump and bool(times[-1] == self.times[-1])
        requested, stops = known & self.requested[place], known & self.stops[place]
        return Piece(self.start, times, requested, stops, ends_at_jump, self.starts_at_jump)

    def through(self, stops: np.ndarray) -> Piece:
        """The beginning of it up to the last of some further stops; all of it if they are not inside."""
        if stops.size:
            stops = stops[(stops > self.start) & (stops < self.times[-1])]
        if not stops.size:
            return self
        part = self.refined(np.union1d(self.times[self.times <= stops[-1]], stops))
        return replace(part, stops=part.stops | np.isin(part.times, stops))

    def until(self, time: float) -> Piece:
        """The part of it up to a time between its start and its end."""
        return self.refined(np.r_[self.times[self.times < time], time])


class Schedule:
    """All times of a run in order.

    Parameters
    ----------
    grid : numpy.ndarray
        Output times, the first one the start.
    stops : numpy.ndarray
        Times that no step may cross.
    jumps : numpy.ndarray
        Times at which the equations jump: the integrator restarts.
    period : float, optional
        Sampling period of a controller: a piece ends at each multiple of it.
    watch_points : int
        Points at which the run is looked at, at least.

    Attributes
    ----------
    times : numpy.ndarray
        Every time after the start.
    """

    def __init__(
        self,
        grid: np.ndarray,
        *,
        stops: np.ndarray | None = None,
        jumps: np.ndarray | None = None,
        period: float | None = None,
        watch_points: int = 0,
    ):
        self.start, self.end = float(grid[0]), float(grid[-1])
        span = self.end - self.start
        #: times nearer to each other are one, s
        self.tolerance = max(NEGLIGIBLE * span, 2 * math.ulp(max(abs(self.start), abs(self.end))))
        none = np.zeros(0)
        stops, jumps = (none if extra is None else np.asarray(extra, float) for extra in (stops, jumps))
        samples = none if period is None else samples_of(grid, period)
        watch = none
        if watch_points:  # spread evenly over the time, whatever the outputs are
            pieces = np.ceil(np.diff(grid) / span * watch_points * (1 - 1e-9)).astype(int)
            owner = np.repeat(np.arange(pieces.size), pieces - 1)
            place = np.arange(owner.size) - (np.cumsum(pieces - 1) - (pieces - 1))[owner] + 1
            watch = grid[owner] + place * (np.diff(grid) / pieces)[owner]
        self.times, self.requested = self._merged(grid[1:], [jumps, samples, stops, watch])
        self._stops, self._jumps, self._samples = [self._marked(extra) for extra in (stops, jumps, samples)]
        self._breaks = self._jumps | self._samples
        self._starts_at_jump = self._near(jumps, self.start)

    def _merged(self, grid: np.ndarray, others: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Union of the outputs and other times; an output stands for times very near to it."""
        if not any([part.size for part in others]):
            return grid, np.ones(grid.size, bool)
        extra = np.concatenate(others)
        extra = distinct(extra[(extra > self.start + self.tolerance) & (extra < self.end - self.tolerance)])
        extra = extra[np.abs(grid[_nearest(grid, extra)] - extra) > self.tolerance]
        extra = extra[np.r_[True, np.diff(extra) > self.tolerance]] if extra.size else extra
        times = np.r_[grid, extra]
        order = np.argsort(times, kind="stable")
        return times[order], (np.arange(times.size) < grid.size)[order]

    def _marked(self, extra: np.ndarray) -> np.ndarray:
        """True for times that are among others."""
        marked = np.zeros(self.times.size, bool)
        if not extra.size:
            return marked
        places = _nearest(self.times, extra)
        marked[places[np.abs(self.times[places] - extra) <= self.tolerance]] = True
        return marked

    def _near(self, times: np.ndarray, time: float) -> bool:
        return times.size > 0 and bool((np.abs(times - time) <= self.tolerance).any())

    @property
    def size(self) -> int:
        """Number of times after the start."""
        return self.times.size

    def samples_at(self, index: int) -> bool:
        """True if a controller is called just after the time of an index (-1 is the start)."""
        return index >= 0 and bool(self._samples[index]) and index < self.size - 1

    def index_after(self, time: float) -> int:
        """Index of the first time after another."""
        return int(self.times.searchsorted(time, side="right"))

    def next_break(self, first: int) -> int:
        """Index of the next time, from one on, at which the integrator must restart, or of the last one."""
        breaks = self._breaks[first:]
        place = int(breaks.argmax())
        return first + place if breaks[place] else self.size - 1

    def joined(self, size: int, first: int, steps: int) -> int:
        """Return the number of times in the pieces from an index on: more than before, of equal length, if few steps.

        Parameters
        ----------
        size : int
            Times of the piece before.
        steps : int
            Steps that it took.
        """
        if steps >= STEPS_PER_PIECE:
            return size
        left = self.size - first
        pieces = max(1, round(left / size * steps / STEPS_PER_PIECE))
        return max(size, -(-left // pieces))  # of equal length: an integrator is made for each pattern of outputs

    def break_within(self, time: float, span: float) -> int | None:
        """Index of a jump or sample at a time or shortly after it; None if there is none."""
        first, last = int(np.searchsorted(self.times, time)), self.index_after(time + span)
        breaks = np.flatnonzero(self._breaks[first:last])
        return first + int(breaks[0]) if breaks.size else None

    def after_jump(self, index: int) -> float | None:
        """Time just after the jump at an index; None if the equations do not jump there."""
        return self.piece(self.start, index, index).after if self._jumps[index] else None

    def smooth_until(self, time: float) -> float:
        """Return the next time after another at which something changes: a jump, a stop, a sample; the end at last."""
        first = self.index_after(time)
        breaks = np.flatnonzero(self._breaks[first:] | self._stops[first:])
        return float(self.times[first + breaks[0]]) if breaks.size else self.end

    def piece(self, start: float, first: int, last: int) -> Piece:
        """Return the piece from a time to the time of the index `last`, with all times from the index `first` on.

        Parameters
        ----------
        start : float
            Before the time of the index `first`.
        """
        chosen = slice(first, last + 1)
        before = first - 1
        from_jump = self._starts_at_jump if before < 0 else bool(self._jumps[before]) and start == self.times[before]
        return Piece(
            start,
            self.times[chosen],
            self.requested[chosen],
            self._stops[chosen],
            ends_at_jump=bool(self._jumps[last]),
            starts_at_jump=from_jump,
        )

    def stretch(self, start: float, first: int, end: float) -> Piece:
        """Return the piece from a time to another one that need not be among the times of the run."""
        return self.piece(start, first, max(first, int(np.searchsorted(self.times, end)))).until(end)


def samples_of(grid: np.ndarray, period: float) -> np.ndarray:
    """Ends of the sampling periods of a controller within an output grid, the last one its end."""
    start, end = grid[0], grid[-1]
    count = int(np.ceil((end - start) / period * (1 - 1e-12)))
    return np.minimum(start + period * np.arange(1, count + 1), end)


def _nearest(times: np.ndarray, requested: np.ndarray) -> np.ndarray:
    """Index of the time (of an increasing list) that is nearest to each of others."""
    after = np.clip(np.searchsorted(times, requested), 0, times.size - 1)
    before = np.maximum(after - 1, 0)
    return np.where(np.abs(times[before] - requested) < np.abs(times[after] - requested), before, after)
