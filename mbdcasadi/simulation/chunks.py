"""How a run is cut into chunks: when the integrator stops, and which of its outputs the user asked for."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

#: Chunks of a run: every restart of an integrator costs, and progress, cancelling and partial results need some.
CHUNKS = 20
#: Points at which a run looks for singular poses and for events, at the least.
WATCH_POINTS = 400


@dataclass(frozen=True)
class Chunk:
    """A stretch of a run.

    Attributes
    ----------
    start : float
        Time at which it starts, s.
    times : numpy.ndarray
        Outputs of the integrator, the last one its end.
    wanted : numpy.ndarray of bool
        Which of them are outputs of the user.
    parts : tuple of Chunk
        What it was joined from.
    """

    start: float
    times: np.ndarray
    wanted: np.ndarray
    parts: tuple[Chunk, ...] = ()

    @property
    def pieces(self) -> list[Chunk]:
        """The chunks of usual length of which it was made."""
        return [piece for part in self.parts for piece in part.pieces] if self.parts else [self]

    @property
    def length(self) -> float:
        """Time that it takes, s."""
        return float(self.times[-1] - self.start)

    def divided(self, count: int) -> list[Chunk]:
        """The same stretch in shorter chunks, as far as its outputs allow."""
        groups = [g for g in np.array_split(np.arange(self.times.size), min(count, self.times.size)) if g.size]
        starts = [self.start, *[float(self.times[g[-1]]) for g in groups[:-1]]]
        return [Chunk(s, self.times[g], self.wanted[g]) for s, g in zip(starts, groups, strict=True)]

    def rest(self, time: float, count: int) -> Chunk | None:
        """What is left of it after a time that lies behind `count` of its outputs; None where nothing is."""
        if count >= self.times.size:
            return None
        return Chunk(time, self.times[count:], self.wanted[count:])

    def cut(self, time: float) -> tuple[Chunk, Chunk]:
        """Two chunks, of which the first ends at a time between its outputs."""
        count = int(np.searchsorted(self.times, time))
        first = Chunk(self.start, np.r_[self.times[:count], time], np.r_[self.wanted[:count], False])
        return first, Chunk(time, self.times[count:], self.wanted[count:])

    def joined(self, following: Chunk) -> Chunk:
        """This chunk and the one that follows, as one."""
        times, wanted = np.r_[self.times, following.times], np.r_[self.wanted, following.wanted]
        return Chunk(self.start, times, wanted, (self, following))


def chunks_of(grid: np.ndarray, *, period: float | None = None, breaks: np.ndarray | None = None) -> list[Chunk]:
    """Cut an output grid into chunks.

    Parameters
    ----------
    grid : numpy.ndarray
        Output times, the first one the start.
    period : float, optional
        Sampling period of a controller: a chunk ends at each multiple of it.
    breaks : numpy.ndarray, optional
        Times at which inputs change; the integrator stops there.
    """
    start, end = grid[0], grid[-1]
    if period is not None:
        borders = periods_of(grid, period)
    elif grid.size - 1 >= CHUNKS:
        borders = np.array([part[-1] for part in np.array_split(grid[1:], _even(grid.size - 1))])
    else:
        borders = np.linspace(start, end, CHUNKS + 1)[1:]
    extra = [borders]
    if breaks is not None and breaks.size:
        extra.append(breaks[(breaks > start) & (breaks < end)])
    if grid.size < WATCH_POINTS:
        pieces = int(np.ceil(WATCH_POINTS / (grid.size - 1)))
        extra += [np.concatenate([np.linspace(a, b, pieces + 1)[1:] for a, b in pairwise(grid)])]
    times, wanted = _merge(grid[1:], np.concatenate(extra), tolerance=1e-9 * (end - start))
    chunks, first, since = [], 0, float(start)
    for border in borders:
        last = int(np.searchsorted(times, border + 1e-9 * (end - start)))
        if last > first:
            chunks.append(Chunk(since, times[first:last], wanted[first:last]))
            first, since = last, float(times[last - 1])
    return chunks


def periods_of(grid: np.ndarray, period: float) -> np.ndarray:
    """Ends of the sampling periods of a controller within an output grid, the last one its end."""
    start, end = grid[0], grid[-1]
    count = int(np.ceil((end - start) / period * (1 - 1e-12)))
    return np.minimum(start + period * np.arange(1, count + 1), end)


def merged(chunks: list[Chunk], count: int) -> list[Chunk]:
    """The same chunks joined into `count` longer ones."""
    groups = np.array_split(np.arange(len(chunks)), min(count, len(chunks))) if chunks else []
    longer = []
    for group in groups:
        whole = chunks[group[0]]
        for k in group[1:]:
            whole = whole.joined(chunks[k])
        longer.append(whole)
    return longer


def _even(intervals: int) -> int:
    """Number of chunks near to the usual one that hold equally many outputs: they share a compiled integrator."""
    fitting = [count for count in range(CHUNKS // 2, CHUNKS * 3 // 2 + 1) if intervals % count == 0]
    return min(fitting, key=lambda count: abs(count - CHUNKS), default=CHUNKS)


def _merge(grid: np.ndarray, extra: np.ndarray, tolerance: float) -> tuple[np.ndarray, np.ndarray]:
    """Union of two sets of times; a time of the grid stands for those very near to it."""
    near = np.clip(np.searchsorted(grid, extra), 0, grid.size - 1)
    distance = np.minimum(np.abs(grid[near] - extra), np.abs(grid[np.maximum(near - 1, 0)] - extra))
    added = np.unique(extra[distance > tolerance])
    if added.size:
        added = added[np.r_[True, np.diff(added) > tolerance]]
    times = np.r_[grid, added]
    order = np.argsort(times, kind="stable")
    return times[order], (np.arange(times.size) < grid.size)[order]
