"""The mesh of a phase: intervals in segments between its waypoints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh points as fractions of the segments between start, waypoints and end.

    Attributes
    ----------
    segments : tuple of numpy.ndarray
        Mesh fractions of each segment, from 0 to 1.
    """

    segments: tuple[np.ndarray, ...]

    @classmethod
    def equal(cls, intervals: int, segment_times: np.ndarray) -> Mesh:
        """Intervals of nearly equal length over segments that begin and end at given times."""
        lengths = np.diff(segment_times)
        counts = np.maximum(np.round(intervals * lengths / lengths.sum()).astype(int), 1)
        while counts.sum() > intervals and counts.max() > 1:
            counts[np.argmax(counts / lengths)] -= 1
        while counts.sum() < intervals:
            counts[np.argmin(counts / lengths)] += 1
        return cls(tuple(np.linspace(0, 1, n + 1) for n in counts))

    @classmethod
    def instant(cls) -> Mesh:
        """The mesh of a phase of no duration: one point, and no interval."""
        return cls((np.zeros(1),))

    @property
    def counts(self) -> tuple[int, ...]:
        """Number of intervals of each segment."""
        return tuple(fractions.size - 1 for fractions in self.segments)

    @property
    def count(self) -> int:
        """Number of intervals."""
        return sum(self.counts)

    @cached_property
    def segment(self) -> np.ndarray:
        """Segment of each interval (N,)."""
        return np.repeat(np.arange(len(self.segments)), self.counts)

    @cached_property
    def begin(self) -> np.ndarray:
        """Fraction of its segment at which each interval begins (N,)."""
        return np.concatenate([fractions[:-1] for fractions in self.segments])

    @cached_property
    def length(self) -> np.ndarray:
        """Fraction of its segment that each interval takes (N,)."""
        return np.concatenate([np.diff(fractions) for fractions in self.segments])

    def is_same(self, other: Mesh) -> bool:
        """Return True if another mesh has the same points."""
        return self.counts == other.counts and all(map(np.array_equal, self.segments, other.segments))

    def times(self, segment_times: np.ndarray) -> np.ndarray:
        """Mesh points (N + 1,), s, for segments that begin and end at given times."""
        lengths = np.diff(segment_times)
        return np.r_[segment_times[self.segment] + self.begin * lengths[self.segment], segment_times[-1]]

    def refined(self, pieces: np.ndarray, merge: np.ndarray) -> Mesh:
        """Mesh with intervals split into pieces, or merged with the next one of their segment.

        Parameters
        ----------
        pieces : numpy.ndarray of int
            Number of pieces into which each interval is split (N,).
        merge : numpy.ndarray of bool
            True if an interval is joined with the next one (N,).
        """
        segments, first = [], 0
        for fractions in self.segments:
            count, points = fractions.size - 1, [0.0]
            for k in range(count):
                i = first + k
                if merge[i] and k + 1 < count:
                    continue
                points += np.linspace(fractions[k], fractions[k + 1], pieces[i] + 1)[1:].tolist()
            segments.append(np.array(points))
            first += count
        return Mesh(tuple(segments))
