"""Outlines of bodies, for contact."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ....errors import ModelError
from ....numerics.lazy import cached_property
from ...bodies import Marker, as_marker
from ...geometry.curves import crossing
from ...immutable import Immutable
from ...quantities import HasQuantities, number_pairs
from ...symbols import Scalar, Vector


class Outline(Immutable, HasQuantities):
    """Base class of outlines: a shape at a marker of a body."""

    marker: Marker

    def __init__(self, marker: Marker):
        self.marker = as_marker(marker, type(self).__name__, "marker")

    @property
    def description(self) -> str:
        """Kind and body, as messages give it."""
        return f"{type(self).__name__} on '{self.marker.body.name}'"

    @property
    def bounding_circle(self) -> tuple[ca.SX, ca.SX] | None:
        """Centre (2,) and radius of a circle around it, m; None if it is not bounded, or touched from inside."""
        return None

    @cached_property
    def likeness(self) -> Hashable:
        """Equal for outlines of the same shape at the same place of their bodies."""
        sizes = [(name, value) for name, value in self.__dict__.items() if name not in ("marker", "limits", "_sealed")]
        sizes += [("place", self.marker.local), ("angle", self.marker.local_angle)]
        fixed = id(self.marker.body) if self.marker.body.is_ground else None
        return type(self), fixed, *((name, _entries(value)) for name, value in sizes)

    def __repr__(self) -> str:
        return self.description


def _entries(value: Any) -> tuple[Hashable, ...]:
    """Numbers, and hashes of the other entries, of a quantity or of some."""
    return tuple(float(e) if e.is_constant() else e.element_hash() for e in ca.vertsplit(ca.vec(ca.SX(value))))


class _Round(Outline):
    """A centre and a radius."""

    def __init__(self, marker: Marker, radius: Scalar):
        super().__init__(marker)
        self.radius = self.read(radius, "radius", above=0.0)


class Circle(_Round):
    """A disc, touched from outside.

    Parameters
    ----------
    marker : Marker
        Its centre.
    radius : float or expression
        m, above 0.
    """

    @property
    def bounding_circle(self) -> tuple[ca.SX, ca.SX]:
        return self.marker.position, ca.SX(self.radius)


class HollowCircle(_Round):
    """A round hole, touched from inside: a bore, a drum.

    Parameters
    ----------
    marker : Marker
        Its centre.
    radius : float or expression
        m, above 0.
    """


class Point(Outline):
    """A point: a corner, a foot.

    Parameters
    ----------
    marker : Marker
        Its position.
    """

    radius = 0.0

    @property
    def bounding_circle(self) -> tuple[ca.SX, ca.SX]:
        return self.marker.position, ca.SX(0)


class Segment(Outline):
    """A straight bar with round ends along the marker's x axis, centred at the marker; touched from all sides.

    Parameters
    ----------
    marker : Marker
        Its middle and direction.
    length : float or expression
        Between the centres of its ends, m, above 0.
    radius : float or expression, default 0
        Half its thickness, m.
    """

    def __init__(self, marker: Marker, length: Scalar, radius: Scalar = 0.0):
        super().__init__(marker)
        self.length = self.read(length, "length", above=0.0)
        self.radius = self.read(radius, "radius", at_least=0.0)

    @property
    def thin(self) -> bool:
        """True if it has no thickness, so that points and corners pass through it."""
        return bool(ca.SX(self.radius).is_zero())

    @property
    def ends(self) -> tuple[ca.SX, ca.SX]:
        """Positions of the centres of its ends, each (2,), m."""
        half = self.length / 2 * self.marker.x_axis
        return self.marker.position - half, self.marker.position + half

    @property
    def bounding_circle(self) -> tuple[ca.SX, ca.SX]:
        return self.marker.position, ca.SX(self.length) / 2 + self.radius


class HalfPlane(Outline):
    """The solid below the marker's x axis: a floor, a wall, a slope.

    Parameters
    ----------
    marker : Marker
        A point of its surface; the y axis points out of it.
    """


class PolygonEdges(Outline):
    """A polygon: a block, a wedge, a ratchet, a bracket.

    It may have hollow corners. A disc then touches each row of edges between them in one point, and so rests on both
    sides of a hollow; corners of other polygons touch the nearest edge. Two polygons of which one has hollow corners
    should not lie on each other with corners in line, where the nearest edge is not that on which they lie.

    Parameters
    ----------
    marker : Marker
        Its frame.
    points : sequence of (x, y)
        Corners in the marker's axes, in counter-clockwise order, m.
    """

    def __init__(self, marker: Marker, points: Sequence[Vector]):
        super().__init__(marker)
        what = repr(self)
        self.points = number_pairs(points, what)
        if len(self.points) < 3:
            raise ModelError(f"{what}: a polygon has at least three corners, got {len(self.points)}")
        straight = np.flatnonzero(np.sin(self._turns) == 0)
        if straight.size:
            x, y = self.points[straight[0]]
            raise ModelError(f"{what}: the outline has no corner at ({x:g}, {y:g}), or goes back there; leave it out")
        rounds = float(np.sum(self._turns)) / (2 * np.pi)
        cut = crossing(self.points)
        if cut is not None or abs(rounds) > 1.5:
            where = "" if cut is None else f" near ({cut[0]:g}, {cut[1]:g})"
            raise ModelError(f"{what}: the outline goes round {rounds:.0f} times and cuts itself{where}")
        if rounds < 0:
            raise ModelError(f"{what}: the corners must go round counter-clockwise; reverse their order")
        self.points.setflags(write=False)

    @property
    def _turns(self) -> np.ndarray:
        """Angle by which the outline turns at each corner, counter-clockwise (k,), rad."""
        after = np.roll(self.points, -1, axis=0) - self.points
        before = np.roll(after, 1, axis=0)
        return np.arctan2(before[:, 0] * after[:, 1] - before[:, 1] * after[:, 0], np.sum(before * after, axis=1))

    @property
    def is_convex(self) -> bool:
        """True if no corner is hollow."""
        return bool(np.all(self._turns > 0))

    @property
    def chains(self) -> list[list[int]]:
        """Edges, by their first corner, in rows that turn by less than a half turn, none past a hollow corner.

        A disc outside touches a row in one point. The corner at which a row begins is that of the row before.
        """
        count, turns = len(self.points), self._turns
        first = int(np.argmin(turns))
        rows, turned = [[first]], 0.0
        for k in range(first + 1, first + count):
            turned += turns[k % count]
            if turns[k % count] < 0 or turned >= np.pi:
                rows.append([])
                turned = 0.0
            rows[-1].append(k % count)
        return rows

    def is_hollow(self, corner: int) -> bool:
        """Return True if the outline turns clockwise at a corner, by its number."""
        return bool(self._turns[corner % len(self.points)] < 0)

    @property
    def half_width(self) -> float:
        """Half of the least width (between two parallel lines; of one that is not convex, of any part of it), m."""
        if not self.is_convex:
            return self._least_thickness / 2
        sides = np.roll(self.points, -1, axis=0) - self.points
        outward = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.hypot(*sides.T)[:, None]
        heights = outward @ self.points.T
        return float(np.min(np.ptp(heights, axis=1))) / 2

    @property
    def _least_thickness(self) -> float:
        """Least distance of a corner from an edge that does not end there, m."""
        count, least = len(self.points), np.inf
        for k, (first, second) in enumerate(zip(self.points, np.roll(self.points, -1, axis=0), strict=True)):
            along = second - first
            others = np.delete(self.points, [k, (k + 1) % count], axis=0)
            share = np.clip((others - first) @ along / (along @ along), 0, 1)
            least = min(least, float(np.min(np.hypot(*(others - first - share[:, None] * along).T))))
        return least

    @property
    def bounding_circle(self) -> tuple[ca.SX, ca.SX]:
        middle = (self.points.min(axis=0) + self.points.max(axis=0)) / 2
        radius = float(np.max(np.hypot(*(self.points - middle).T)))
        return self.marker.position + self.marker.axes @ ca.DM(middle), ca.SX(radius)

    @property
    def corners(self) -> list[ca.SX]:
        """Positions of the corners, each (2,), m."""
        return [self.marker.position + self.marker.axes @ ca.DM(point) for point in self.points]

    @property
    def tips(self) -> list[ca.SX]:
        """Positions of the corners that are not hollow, each (2,), m."""
        return [corner for corner, turn in zip(self.corners, self._turns, strict=True) if turn > 0]

    @property
    def normals(self) -> list[ca.SX]:
        """Outward unit normals of the edges, each from a corner to the next (2,)."""
        sides = np.roll(self.points, -1, axis=0) - self.points
        return [self.marker.axes @ ca.DM([s[1], -s[0]]) / float(np.hypot(*s)) for s in sides]
