"""Outlines of bodies, for contact."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ....errors import ModelError
from ....numerics.lazy import cached_property
from ...bodies import Marker, as_marker
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
    """A convex polygon: a block, a wedge.

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
        sides = np.roll(self.points, -1, axis=0) - self.points
        turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
        angles = np.arctan2(turns, np.sum(sides * np.roll(sides, -1, axis=0), axis=1))
        if np.all(turns > 0) and not np.isclose(np.sum(angles), 2 * np.pi):
            raise ModelError(f"{what}: the outline goes round {np.sum(angles) / (2 * np.pi):.0f} times and cuts itself")
        if np.any(turns <= 0):
            corner = self.points[(int(np.argmin(turns)) + 1) % len(self.points)]
            raise ModelError(
                f"{what}: the corners must go round a convex polygon counter-clockwise, and do not at "
                f"({corner[0]:g}, {corner[1]:g}); split it into convex ones"
            )
        self.points.setflags(write=False)

    @property
    def half_width(self) -> float:
        """Half of the least width of the polygon (between two parallel lines), m."""
        sides = np.roll(self.points, -1, axis=0) - self.points
        outward = np.column_stack([sides[:, 1], -sides[:, 0]]) / np.hypot(*sides.T)[:, None]
        heights = outward @ self.points.T
        return float(np.min(np.ptp(heights, axis=1))) / 2

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
    def normals(self) -> list[ca.SX]:
        """Outward unit normals of the edges, each from a corner to the next (2,)."""
        sides = np.roll(self.points, -1, axis=0) - self.points
        return [self.marker.axes @ ca.DM([s[1], -s[0]]) / float(np.hypot(*s)) for s in sides]
