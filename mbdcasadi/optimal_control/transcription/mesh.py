"""The mesh of a phase: intervals in segments between its waypoints, and mesh points that move."""

from __future__ import annotations

import itertools
from collections.abc import Collection, Hashable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...numerics.lazy import cached_property
from ...numerics.tolerances import NEGLIGIBLE


@dataclass(frozen=True, eq=False)
class Mesh:
    """Mesh points as fractions of the segments between start, waypoints and end."""

    #: mesh fractions of each segment, from 0 to 1
    segments: tuple[np.ndarray, ...]
    #: mesh points whose times the solver finds, in order; their fractions are those to begin with
    moving: tuple[int, ...] = ()
    #: those of them that keep their times, whatever moves beside them: where costs, limits or forces jump in time
    pinned: tuple[int, ...] = ()
    #: longest interval beside a mesh point that moves, as a share of the duration; None for no limit
    longest: float | None = None

    @classmethod
    def equal(cls, intervals: int, segment_times: np.ndarray) -> Mesh:
        """Intervals of nearly equal length over segments that begin and end at given times."""
        lengths = np.diff(segment_times)
        counts = np.maximum(np.round(intervals * lengths / lengths.sum()).astype(int), 1)
        while counts.sum() > intervals and counts.max() > 1:
            counts[np.argmax(np.where(counts > 1, counts / lengths, 0.0))] -= 1  # every segment keeps an interval
        while counts.sum() < intervals:
            counts[np.argmin(counts / lengths)] += 1
        fractions = {n: np.linspace(0, 1, n + 1) for n in set(counts.tolist())}
        return cls(tuple(fractions[n] for n in counts.tolist()))

    @classmethod
    def instant(cls) -> Mesh:
        """The mesh of a phase of no duration: one point, and no interval."""
        return cls((np.zeros(1),))

    @classmethod
    def through(cls, positions: np.ndarray, moving: Collection[float], pinned: Collection[float] = ()) -> Mesh:
        """The mesh through points given as number of the segment plus fraction, some of which move or are pinned."""
        segments = []
        for k in range(round(float(positions[-1]))):
            inside = positions[(positions > k) & (positions < k + 1)] - k
            segments.append(np.r_[0.0, inside, 1.0])
        some, still = (tuple(np.searchsorted(positions, sorted(of)).tolist()) for of in (moving, pinned))
        return cls(tuple(segments), some, still)

    @cached_property
    def counts(self) -> tuple[int, ...]:
        """Number of intervals of each segment."""
        return tuple(fractions.size - 1 for fractions in self.segments)

    @property
    def free(self) -> tuple[int, ...]:
        """Mesh points that move and are not pinned."""
        return tuple(k for k in self.moving if k not in self.pinned)

    @property
    def structure(self) -> Hashable:
        """Number of intervals of each segment, and mesh points that move: meshes alike in these share a program."""
        return self.counts, self.moving, self.longest

    @property
    def count(self) -> int:
        """Number of intervals."""
        return sum(self.counts)

    @property
    def waypoints(self) -> np.ndarray:
        """Mesh points at which a segment ends and another one begins."""
        return np.cumsum(self.counts)[:-1]

    @cached_property
    def positions(self) -> np.ndarray:
        """Mesh points as number of the segment plus fraction (N + 1,)."""
        return np.concatenate([[0.0], *(k + fractions[1:] for k, fractions in enumerate(self.segments))])

    # --- pieces between the mesh points with times of their own -----------------------------
    @cached_property
    def knots(self) -> np.ndarray:
        """Start, waypoints, moving mesh points and end, as indices of mesh points."""
        return np.unique(np.r_[0, self.waypoints, np.array(self.moving, int), self.count])

    @cached_property
    def piece(self) -> np.ndarray:
        """Piece between two knots in which each interval lies (N,)."""
        return np.repeat(np.arange(self.knots.size - 1), np.diff(self.knots))

    @cached_property
    def begin(self) -> np.ndarray:
        """Fraction of its piece at which each interval begins (N,)."""
        return (self.positions[:-1] - self._piece_begin) / self._piece_length

    @cached_property
    def length(self) -> np.ndarray:
        """Fraction of its piece that each interval takes (N,)."""
        return np.diff(self.positions) / self._piece_length

    @property
    def _piece_begin(self) -> np.ndarray:
        return self.positions[self.knots[self.piece]]

    @property
    def _piece_length(self) -> np.ndarray:
        return self.positions[self.knots[self.piece + 1]] - self._piece_begin

    # --- times --------------------------------------------------------------------------------
    def is_same(self, other: Mesh) -> bool:
        """Return True if another mesh has the same points."""
        alike = self.structure == other.structure and self.pinned == other.pinned
        return alike and np.array_equal(self.positions, other.positions)

    def times(self, segment_times: np.ndarray) -> np.ndarray:
        """Mesh points (N + 1,), s, for segments that begin and end at given times."""
        segment = self.positions[:-1].astype(int)
        fraction = self.positions[:-1] - segment
        return np.r_[segment_times[segment] + fraction * np.diff(segment_times)[segment], segment_times[-1]]

    def moved(self, times: np.ndarray) -> Mesh:
        """Return the mesh with its moving points at the times that were found, those of all knots (k,), s.

        Points that have met, or passed each other in a program that was not solved, are a negligible share apart.
        """
        if not self.moving:
            return self
        points = times[self.piece] + self.begin * np.diff(times)[self.piece]
        ends = times[np.searchsorted(self.knots, np.r_[0, self.waypoints, self.count])]
        segment = self.positions[:-1].astype(int)
        positions = segment + (points - ends[segment]) / np.diff(ends)[segment]
        positions = self._apart(np.r_[positions, self.positions[-1]])
        mesh = Mesh.through(positions, positions[list(self.moving)], positions[list(self.pinned)])
        return replace(mesh, longest=self.longest)

    def _apart(self, positions: np.ndarray) -> np.ndarray:
        """Positions of points that stay in their segments, in order and a negligible share apart; waypoints stay."""
        if np.min(np.diff(positions)) >= NEGLIGIBLE:
            return positions
        segment, room = self.positions.astype(int), NEGLIGIBLE * np.arange(positions.size)
        ordered = np.maximum.accumulate(np.clip(positions, segment, segment + 1) - room) + room
        fixed = np.r_[0, self.waypoints, self.count]
        ordered[fixed] = self.positions[fixed]
        apart: np.ndarray = np.minimum.accumulate((ordered - room)[::-1])[::-1] + room
        return apart

    def refined(self, pieces: np.ndarray) -> Mesh:
        """Mesh with intervals split into so many pieces (N,)."""
        if not self.count:
            return self
        ends = zip(self.positions[:-1], self.positions[1:], pieces, strict=True)
        points = [self.positions[:1], *(np.linspace(begin, end, count + 1)[1:] for begin, end, count in ends)]
        knots = (self.positions[list(places)] for places in (self.moving, self.pinned))
        return Mesh.through(np.concatenate(points), *knots)

    def split(self, pieces: int) -> Mesh:
        """Mesh with every interval split into as many pieces."""
        return self.refined(np.full(self.count, pieces))

    def resized(self, share: float) -> Mesh:
        """Mesh of equal intervals in each segment, a `share` of the present number and at least one."""
        if not self.count:
            return self
        return Mesh(tuple(np.linspace(0, 1, max(1, round(share * count)) + 1) for count in self.counts))

    def through_points(
        self, points: np.ndarray, near: float, moving: np.ndarray, pinned: np.ndarray | None = None
    ) -> Mesh:
        """Mesh with further points, and with others that move in place of the present ones, as :attr:`positions` are.

        Points nearer to one of them than a share of the interval on their other side are left out. Without `pinned`
        ones those stay that are there.
        """
        fixed = np.arange(len(self.segments) + 1.0)
        pinned = self.positions[list(self.pinned)] if pinned is None else pinned
        moving = np.union1d(moving, pinned)
        ends = np.unique(np.r_[fixed, points, moving])
        chosen = [ends[:1]]
        for begin, end in itertools.pairwise(ends):
            inside = self.positions[(self.positions > begin) & (self.positions < end)].tolist()
            while inside and inside[0] - begin < near * ((inside[1] if len(inside) > 1 else end) - inside[0]):
                del inside[0]
            while inside and end - inside[-1] < near * (inside[-1] - (inside[-2] if len(inside) > 1 else begin)):
                del inside[-1]
            chosen += [np.array(inside), np.array([end])]
        return Mesh.through(np.concatenate(chosen), np.setdiff1d(moving, fixed).tolist(), pinned.tolist())

    def without_free(self) -> Mesh:
        """Return the mesh whose points do not move, but for those that are pinned."""
        return replace(self, moving=self.pinned)

    def with_moving(self, points: Iterable[int]) -> Mesh:
        """Return the mesh with further mesh points that move; start, waypoints and end do not."""
        fixed = {0, *self.waypoints.tolist(), self.count}
        return replace(self, moving=tuple(sorted({*self.moving, *points} - fixed)))


def interval_count(meshes: Iterable[Mesh]) -> int:
    """Return the number of intervals of meshes of several phases."""
    return sum(mesh.count for mesh in meshes)
