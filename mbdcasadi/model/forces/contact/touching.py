"""Where two outlines touch: gap, normal and point, for each pair of kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...quantities import known_value
from .edges import disc_beside_polygon, polygon_polygon, segment_polygon, segment_segment
from .outlines import Circle, HalfPlane, HollowCircle, Outline, Point, PolygonEdges, Segment
from .places import Touch, between_discs, nearest_point


def _disc_on_plane(centre: ca.SX, radius: Any, plane: HalfPlane, reach: Any) -> Touch:
    normal = plane.marker.y_axis
    height = ca.dot(normal, centre - plane.marker.position)
    return Touch(height - radius, normal, centre - radius * normal, _reach(reach))


def _reach(size: Any) -> ca.SX | None:
    """Depth to which an outline of a size may go into a solid without a middle; any, if it has none either."""
    size = ca.SX(size)
    return None if size.is_zero() else size


def disc_plane(a: Any, b: HalfPlane) -> list[Touch]:
    """A circle or a point above a half-plane."""
    return [_disc_on_plane(a.marker.position, a.radius, b, a.radius)]


def disc_disc(a: Any, b: Any) -> list[Touch]:
    """Two circles, or a circle and a point."""
    if isinstance(a, Point) and isinstance(b, Point):
        raise ModelError("two points never touch; give one of them a radius: Circle(marker, radius)")
    return [between_discs(a.marker.position, a.radius, b.marker.position, b.radius)]


def disc_segment(a: Any, b: Segment) -> list[Touch]:
    """A circle or a point beside a bar."""
    if isinstance(a, Point) and b.thin:
        raise ModelError("a point passes through a bar without thickness; give Segment(…, radius=), or take a Circle")
    centre = a.marker.position
    return [between_discs(centre, a.radius, nearest_point(centre, *b.ends), b.radius)]


def segment_plane(a: Segment, b: HalfPlane) -> list[Touch]:
    """Both ends of a bar above a half-plane."""
    return [_disc_on_plane(end, a.radius, b, a.radius) for end in a.ends]


def polygon_plane(a: PolygonEdges, b: HalfPlane) -> list[Touch]:
    """Each corner of a polygon above a half-plane."""
    return [_disc_on_plane(corner, 0.0, b, a.half_width) for corner in a.corners]


def disc_polygon(a: Any, b: PolygonEdges) -> list[Touch]:
    """A circle or a point beside a polygon."""
    return [disc_beside_polygon(a.marker.position, a.radius, b)]


def disc_hollow(a: Any, b: HollowCircle) -> list[Touch]:
    """A circle or a point in a hole."""
    return [_disc_in_hole(a.marker.position, a.radius, b, a.radius)]


def segment_hollow(a: Segment, b: HollowCircle) -> list[Touch]:
    """Both ends of a bar in a hole."""
    return [_disc_in_hole(end, a.radius, b, a.radius) for end in a.ends]


def polygon_hollow(a: PolygonEdges, b: HollowCircle) -> list[Touch]:
    """Each corner of a polygon in a hole."""
    return [_disc_in_hole(corner, 0.0, b, a.half_width) for corner in a.corners]


def _disc_in_hole(centre: ca.SX, radius: Any, hole: HollowCircle, reach: Any) -> Touch:
    middle = hole.marker.position
    known, disc = known_value(hole.radius), known_value(radius)
    if known is not None and disc is not None and disc >= known:
        raise ModelError(f"a circle of radius {disc:g} m does not go into a hole of radius {known:g} m")
    inward = between_discs(middle, 0.0, centre, 0.0)
    return Touch(hole.radius - radius - inward.gap, inward.normal, centre - radius * inward.normal, _reach(reach))


_KINDS: Sequence[tuple[tuple[type, ...], tuple[type, ...], Callable[[Any, Any], list[Touch]]]] = (
    ((Circle, Point), (HalfPlane,), disc_plane),
    ((Circle, Point), (Circle, Point), disc_disc),
    ((Circle, Point), (Segment,), disc_segment),
    ((Segment,), (HalfPlane,), segment_plane),
    ((PolygonEdges,), (HalfPlane,), polygon_plane),
    ((Circle, Point), (PolygonEdges,), disc_polygon),
    ((Segment,), (Segment,), segment_segment),
    ((Segment,), (PolygonEdges,), segment_polygon),
    ((PolygonEdges,), (PolygonEdges,), polygon_polygon),
    ((Circle, Point), (HollowCircle,), disc_hollow),
    ((Segment,), (HollowCircle,), segment_hollow),
    ((PolygonEdges,), (HollowCircle,), polygon_hollow),
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
