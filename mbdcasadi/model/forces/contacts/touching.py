"""Where two outlines touch: gap, normal and point, for each pair of kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ....errors import ModelError
from ...expressions import if_else, norm
from .outlines import Circle, HalfPlane, Outline, Point, PolygonEdges, Segment


@dataclass(frozen=True, eq=False)
class Touch:
    """One place where two outlines may touch.

    Attributes
    ----------
    gap : casadi.SX
        Distance of the surfaces, m; negative where they penetrate.
    normal : casadi.SX
        Unit vector (2,) from the second to the first outline.
    point : casadi.SX
        Where the force acts (2,), m.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX

    def reversed(self) -> Touch:
        """The same with the outlines exchanged."""
        return Touch(self.gap, -self.normal, self.point)


def _disc_on_plane(centre: ca.SX, radius: Any, plane: HalfPlane) -> Touch:
    normal = plane.marker.y_axis
    height = ca.dot(normal, centre - plane.marker.position)
    return Touch(height - radius, normal, centre - radius * normal)


def _between_discs(centre: ca.SX, radius: Any, other: ca.SX, other_radius: Any) -> Touch:
    apart = centre - other
    distance = norm(apart)
    # concentric discs have no normal: any will do, and no division by zero
    together = distance == 0
    normal = if_else(together, ca.DM([0, 1]), apart / if_else(together, 1, distance))
    return Touch(distance - radius - other_radius, normal, other + normal * other_radius)


def _nearest(point: ca.SX, first: ca.SX, second: ca.SX) -> ca.SX:
    """Nearest point of a segment."""
    along = second - first
    share = ca.dot(point - first, along) / ca.sumsqr(along)
    share = if_else(share > 0, if_else(share < 1, share, 1), 0)
    return first + share * along


def disc_plane(a: Any, b: HalfPlane) -> list[Touch]:
    """A circle or a point above a half-plane."""
    return [_disc_on_plane(a.marker.position, a.radius, b)]


def disc_disc(a: Any, b: Any) -> list[Touch]:
    """Two circles, or a circle and a point."""
    if isinstance(a, Point) and isinstance(b, Point):
        raise ModelError("two points never touch; give one of them a radius: Circle(marker, radius)")
    return [_between_discs(a.marker.position, a.radius, b.marker.position, b.radius)]


def disc_segment(a: Any, b: Segment) -> list[Touch]:
    """A circle or a point beside a bar."""
    if isinstance(a, Point) and b.radius is not None and ca.SX(b.radius).is_zero():
        raise ModelError("a point passes through a bar without thickness; give Segment(…, radius=), or take a Circle")
    centre = a.marker.position
    return [_between_discs(centre, a.radius, _nearest(centre, *b.ends), b.radius)]


def segment_plane(a: Segment, b: HalfPlane) -> list[Touch]:
    """Both ends of a bar above a half-plane."""
    return [_disc_on_plane(end, a.radius, b) for end in a.ends]


def polygon_plane(a: PolygonEdges, b: HalfPlane) -> list[Touch]:
    """Each corner of a polygon above a half-plane."""
    return [_disc_on_plane(corner, 0.0, b) for corner in a.corners]


def disc_polygon(a: Any, b: PolygonEdges) -> list[Touch]:
    """A circle or a point beside a polygon: the nearest edge or corner; inside, the edge that is nearest."""
    centre, corners = a.marker.position, b.corners
    sides = np.roll(b.points, -1, axis=0) - b.points
    outward = [b.marker.axes @ ca.DM([s[1], -s[0]]) / float(np.hypot(*s)) for s in sides]
    heights = [ca.dot(n, centre - c) for n, c in zip(outward, corners, strict=True)]
    # of the edges whose outer side the centre is on, the nearest one; within all, the one with the least depth
    height, edge_normal = heights[0], outward[0]
    for other, normal in zip(heights[1:], outward[1:], strict=True):
        more = other > height
        height, edge_normal = if_else(more, other, height), if_else(more, normal, edge_normal)
    nearest = _nearest(centre, corners[0], corners[1])
    for first, second in zip(corners[1:], [*corners[2:], corners[0]], strict=True):
        point = _nearest(centre, first, second)
        closer = ca.sumsqr(centre - point) < ca.sumsqr(centre - nearest)
        nearest = if_else(closer, point, nearest)
    outside = _between_discs(centre, a.radius, nearest, 0.0)
    inside = height <= 0
    gap = if_else(inside, height - a.radius, outside.gap)
    normal = if_else(inside, edge_normal, outside.normal)
    point = if_else(inside, centre - height * edge_normal, nearest)
    return [Touch(gap, normal, point)]


_KINDS: Sequence[tuple[tuple[type, ...], tuple[type, ...], Callable[[Any, Any], list[Touch]]]] = (
    ((Circle, Point), (HalfPlane,), disc_plane),
    ((Circle, Point), (Circle, Point), disc_disc),
    ((Circle, Point), (Segment,), disc_segment),
    ((Segment,), (HalfPlane,), segment_plane),
    ((PolygonEdges,), (HalfPlane,), polygon_plane),
    ((Circle, Point), (PolygonEdges,), disc_polygon),
)


def touches(a: Outline, b: Outline, what: str) -> list[Touch]:
    """Places where two outlines may touch.

    Raises
    ------
    ModelError
        For a pair that there is no rule for.
    """
    try:
        for first, second, rule in _KINDS:
            if isinstance(a, first) and isinstance(b, second):
                return rule(a, b)
            if isinstance(b, first) and isinstance(a, second):
                return [touch.reversed() for touch in rule(b, a)]
    except ModelError as error:
        raise ModelError(f"{what}: {error}") from None
    known = "; ".join(f"{'/'.join(t.__name__ for t in x)} on {'/'.join(t.__name__ for t in y)}" for x, y, _ in _KINDS)
    raise ModelError(
        f"{what}: there is no contact of {type(a).__name__} and {type(b).__name__}; there is {known}; "
        "put circles or points on one of the two"
    )
