"""The mesh: intervals of a motion, in phases between its waypoints."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh points as shares of the phases between start, waypoints and end.

    Attributes
    ----------
    phases : tuple of numpy.ndarray
        For each phase the shares of its mesh points, from 0 to 1.
    """

    phases: tuple[np.ndarray, ...]

    @classmethod
    def equal(cls, intervals: int, marks: np.ndarray) -> Mesh:
        """Intervals of nearly equal length over phases that begin and end at given times."""
        lengths = np.diff(marks)
        counts = np.maximum(np.round(intervals * lengths / lengths.sum()).astype(int), 1)
        while counts.sum() > intervals and counts.max() > 1:
            counts[np.argmax(counts / lengths)] -= 1
        while counts.sum() < intervals:
            counts[np.argmin(counts / lengths)] += 1
        return cls(tuple(np.linspace(0, 1, n + 1) for n in counts))

    @property
    def counts(self) -> tuple[int, ...]:
        """Intervals of each phase."""
        return tuple(shares.size - 1 for shares in self.phases)

    @property
    def count(self) -> int:
        """Intervals in all."""
        return sum(self.counts)

    @cached_property
    def phase(self) -> np.ndarray:
        """Phase of each interval (N,)."""
        return np.repeat(np.arange(len(self.phases)), self.counts)

    @cached_property
    def begin(self) -> np.ndarray:
        """Share of its phase at which each interval begins (N,)."""
        return np.concatenate([shares[:-1] for shares in self.phases])

    @cached_property
    def length(self) -> np.ndarray:
        """Share of its phase that each interval takes (N,)."""
        return np.concatenate([np.diff(shares) for shares in self.phases])

    def is_same(self, other: Mesh) -> bool:
        """Whether another mesh has the same points."""
        return self.counts == other.counts and all(map(np.array_equal, self.phases, other.phases))

    def times(self, marks: np.ndarray) -> np.ndarray:
        """Mesh points (N + 1,), s, for phases that begin and end at given times."""
        lengths = np.diff(marks)
        return np.r_[marks[self.phase] + self.begin * lengths[self.phase], marks[-1]]

    def refined(self, pieces: np.ndarray, merge: np.ndarray) -> Mesh:
        """Mesh with intervals split into pieces, or merged with the next one of their phase.

        Parameters
        ----------
        pieces : numpy.ndarray of int
            Into how many each interval is split (N,).
        merge : numpy.ndarray of bool
            Whether an interval is joined with the next one (N,).
        """
        phases, first = [], 0
        for shares in self.phases:
            count, points = shares.size - 1, [0.0]
            for k in range(count):
                i = first + k
                if merge[i] and k + 1 < count:
                    continue
                points += np.linspace(shares[k], shares[k + 1], pieces[i] + 1)[1:].tolist()
            phases.append(np.array(points))
            first += count
        return Mesh(tuple(phases))
