"""Places at which two outlines touch: gap, normal and point, for each pair of kinds."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ....errors import ModelError
from ...expressions import if_else, norm
from ...quantities import known_value
from .outlines import Circle, HalfPlane, HollowCircle, Outline, Point, PolygonEdges, Segment


@dataclass(frozen=True, eq=False)
class Touch:
    """One place at which two outlines may touch."""

    #: distance of the surfaces, m; negative if they penetrate
    gap: ca.SX
    #: unit vector (2,) from the second to the first outline
    normal: ca.SX
    #: point at which the force acts (2,), m
    point: ca.SX
    #: largest valid depth, m: half of the depth at which the middles of the outlines meet; for a half-plane or a hole
    #: that at which the other outline is inside the solid; None if there is no limit
    reach: ca.SX | None = None
    #: of a corner on an edge: how far it is inside the ends of the edge, m; None if nothing slips off
    within: ca.SX | None = None
    #: distance that stays zero while the surfaces touch, m; by default the gap
    height: ca.SX | None = None
    #: True if the ends of the edge belong to it
    covers_ends: bool = True

    def reversed(self) -> Touch:
        """Return the same place with the outlines exchanged."""
        return replace(self, normal=-self.normal)


def between_discs(centre: ca.SX, radius: Any, other: ca.SX, other_radius: Any) -> Touch:
    """Return the place of contact of two discs."""
    apart = centre - other
    distance = norm(apart)
    # concentric discs have no normal: take any, and do not divide by zero
    together = distance == 0
    normal = if_else(together, ca.DM([0, 1]), apart / if_else(together, 1, distance))
    reach = (ca.SX(radius) + other_radius) / 2
    return Touch(distance - radius - other_radius, normal, other + normal * other_radius, reach)


def share_along(point: ca.SX, first: ca.SX, along: ca.SX) -> ca.SX:
    """Return the projection of a point onto a segment: 0 at its first end and 1 at the other."""
    return ca.dot(point - first, along) / ca.sumsqr(along)


def nearest_point(point: ca.SX, first: ca.SX, second: ca.SX) -> ca.SX:
    """Return the nearest point of a segment."""
    along = second - first
    share = share_along(point, first, along)
    share = if_else(share > 0, if_else(share < 1, share, 1), 0)
    return first + share * along


def segment_segment(a: Segment, b: Segment) -> list[Touch]:
    """Ends of each bar against the other one."""
    if a.thin and b.thin:
        raise ModelError("two bars without thickness pass through each other; give one of them radius=")
    ends = [between_discs(end, a.radius, nearest_point(end, *b.ends), b.radius) for end in a.ends]
    return ends + [_beside(end, b.radius, a).reversed() for end in b.ends]


def segment_polygon(a: Segment, b: PolygonEdges) -> list[Touch]:
    """Ends of a bar against a polygon, and corners of the polygon against the bar."""
    if a.thin:
        raise ModelError("a corner passes through a bar without thickness; give Segment(…, radius=)")
    ends = [touch for end in a.ends for touch in disc_beside_polygon(end, a.radius, b)]
    return ends + [_beside(corner, 0.0, a).reversed() for corner in b.tips]


def _beside(centre: ca.SX, radius: ca.SX | float, bar: Segment) -> Touch:
    """Return the contact of a disc with the straight part of a bar; that with its round ends is one of these ends."""
    first, second = bar.ends
    share = share_along(centre, first, second - first)
    touch = between_discs(centre, radius, nearest_point(centre, first, second), bar.radius)
    straight = ca.logic_and(share > 0, share < 1)
    within = ca.fmin(share, 1 - share) * bar.length
    gap = if_else(straight, touch.gap, ca.fabs(touch.gap))
    return replace(touch, gap=gap, within=within, height=touch.gap, covers_ends=False)


def disc_beside_polygon(centre: ca.SX, radius: ca.SX | float, b: PolygonEdges) -> list[Touch]:
    """Return the contacts of a disc or point with a polygon, one for each row of edges that it may touch."""
    if b.is_convex:
        return [_disc_beside_convex(centre, radius, b)]
    return _disc_beside(centre, radius, b)


def _disc_beside(centre: ca.SX, radius: ca.SX | float, b: PolygonEdges) -> list[Touch]:
    """Return the contacts of a disc or point with a polygon of any kind."""
    # a point is nearest to one place; a disc in a hollow touches both of its sides
    rows = [range(len(b.points))] if ca.SX(radius).is_zero() else b.chains
    places = [_nearest_of(centre, b, edges) for edges in rows]
    least = ca.mmin(ca.vertcat(*[ca.sumsqr(centre - place[:2]) for place in places]))
    touches = []
    for place in places:
        foot, side, belongs = place[:2], place[2], place[3]
        beside = between_discs(centre, 0.0, foot, 0.0)
        distance = beside.gap
        # from outside if the corner is not that of another row; from inside if no other row is nearer
        outside = if_else(belongs, distance - radius, ca.fabs(distance - radius))
        inside = if_else(ca.sumsqr(centre - foot) <= least, -distance - radius, distance + radius)
        gap = if_else(side > 0, outside, inside)
        touches.append(Touch(gap, side * beside.normal, foot, (ca.SX(radius) + b.half_width) / 2))
    return touches


def _nearest_of(centre: ca.SX, b: PolygonEdges, edges: Sequence[int]) -> ca.SX:
    """Return the nearest point of a row of edges, 1 if the centre is outside there or -1, and 1 if it is its own (4,).

    The corner at which a row begins belongs to the row before.
    """
    corners, normals, count = b.corners, b.normals, len(b.points)
    best, found = ca.SX(0), ca.SX(0)
    for k in edges:
        first, second = corners[k], corners[(k + 1) % count]
        share = share_along(centre, first, second - first)
        foot = nearest_point(centre, first, second)
        side = if_else(ca.dot(normals[k], centre - first) < 0, -1, 1)
        # at a corner it is outside of one that is not hollow, however sharp
        at_first, at_second = (-1 if b.is_hollow(corner) else 1 for corner in (k, k + 1))
        side = if_else(share > 0, if_else(share < 1, side, at_second), at_first)
        belongs = share > 0 if k == edges[0] else 1
        place, distance = ca.vertcat(foot, side, belongs), ca.sumsqr(centre - foot)
        if k == edges[0]:
            best, found = distance, place
        else:
            closer = distance < best
            best, found = if_else(closer, distance, best), if_else(closer, place, found)
    return found


def _disc_beside_convex(centre: ca.SX, radius: ca.SX | float, b: PolygonEdges) -> Touch:
    """Return the contact of a disc or point with a convex polygon: nearest edge or corner; inside, nearest edge."""
    corners = b.corners
    outward = b.normals
    heights = [ca.dot(n, centre - c) for n, c in zip(outward, corners, strict=True)]
    # the edge with the largest height of the centre above it: inside the polygon, that of the least depth
    height, edge_normal = heights[0], outward[0]
    for other, normal in zip(heights[1:], outward[1:], strict=True):
        more = other > height
        height, edge_normal = if_else(more, other, height), if_else(more, normal, edge_normal)
    nearest = nearest_point(centre, corners[0], corners[1])
    for first, second in zip(corners[1:], [*corners[2:], corners[0]], strict=True):
        point = nearest_point(centre, first, second)
        closer = ca.sumsqr(centre - point) < ca.sumsqr(centre - nearest)
        nearest = if_else(closer, point, nearest)
    outside = between_discs(centre, radius, nearest, 0.0)
    inside = height <= 0
    gap = if_else(inside, height - radius, outside.gap)
    normal = if_else(inside, edge_normal, outside.normal)
    point = if_else(inside, centre - height * edge_normal, nearest)
    return Touch(gap, normal, point, (ca.SX(radius) + b.half_width) / 2)


def polygon_polygon(a: PolygonEdges, b: PolygonEdges, each_corner: bool = False) -> list[Touch]:
    """Corners of either polygon on an edge of the other, for the two edges that face each other.

    The edges are those of the axis that separates the polygons most, or along which they
    penetrate least, and the edge of the other polygon that faces it (Gottschalk, Lin,
    Manocha, "OBBTree", SIGGRAPH 1996; Catto, "Iterative dynamics with temporal
    coherence", GDC 2005). Both ends of both edges are places of contact, so that a
    block on an equal block stands on two corners at any offset; with `each_corner` all corners of a, then those
    of b, so that a place stays the same corner as the edges change.
    """
    if not (a.is_convex and b.is_convex):
        reach = ca.SX((a.half_width + b.half_width) / 2)
        places = [touch for tip in a.tips for touch in _disc_beside(tip, 0.0, b)]
        places += [touch.reversed() for tip in b.tips for touch in _disc_beside(tip, 0.0, a)]
        return [replace(touch, reach=reach) for touch in places]
    faces_a, faces_b = _faces(a), _faces(b)
    first = _least_deep(faces_a, b.corners)
    second = _least_deep(faces_b, a.corners)
    by_a = first[0] > second[0]
    on_a = if_else(by_a, first[1], _facing(faces_a, second[1][:2]))
    on_b = if_else(by_a, _facing(faces_b, first[1][:2]), second[1])
    of_a, of_b = (a.corners, b.corners) if each_corner else [(on[2:4], on[4:6]) for on in (on_a, on_b)]
    places = [_corner_on_edge(corner, on_b, closed=True) for corner in of_a]
    places += [_corner_on_edge(corner, on_a, closed=False).reversed() for corner in of_b]
    return [replace(touch, reach=ca.SX((a.half_width + b.half_width) / 2)) for touch in places]


def _faces(polygon: PolygonEdges) -> list[ca.SX]:
    """Return the outward normal and the ends of each edge, as one vector (6,) each."""
    corners = polygon.corners
    return [
        ca.vertcat(normal, start, end)
        for normal, start, end in zip(polygon.normals, corners, [*corners[1:], corners[0]], strict=True)
    ]


def _least_deep(faces: list[ca.SX], corners: list[ca.SX]) -> tuple[ca.SX, ca.SX]:
    """Return the largest separation of some corners from an edge (their least height above it), and that edge."""
    heights = [ca.mmin(ca.vertcat(*[ca.dot(face[:2], corner - face[2:4]) for corner in corners])) for face in faces]
    best, edge = heights[0], faces[0]
    for lowest, face in zip(heights[1:], faces[1:], strict=True):
        more = lowest > best
        best, edge = if_else(more, lowest, best), if_else(more, face, edge)
    return best, edge


def _facing(faces: list[ca.SX], normal: ca.SX) -> ca.SX:
    """Return the edge whose normal is most opposed to a direction."""
    best, edge = ca.dot(faces[0][:2], normal), faces[0]
    for face in faces[1:]:
        turned = ca.dot(face[:2], normal)
        more = turned < best
        best, edge = if_else(more, turned, best), if_else(more, face, edge)
    return edge


def _corner_on_edge(corner: ca.SX, face: ca.SX, *, closed: bool) -> Touch:
    """Return the contact of a corner with an edge, between the ends of the edge; if `closed`, at the ends too."""
    normal, start, end = face[:2], face[2:4], face[4:6]
    share = share_along(corner, start, end - start)
    height = ca.dot(normal, corner - start)
    on = ca.logic_and(share >= 0, share <= 1) if closed else ca.logic_and(share > 0, share < 1)
    distance = norm(corner - nearest_point(corner, start, end))
    within = ca.fmin(share, 1 - share) * norm(end - start)
    return Touch(if_else(on, height, distance), normal, corner, within=within, height=height, covers_ends=closed)


def _discs(outline: Any) -> list[tuple[ca.SX, Any, ca.SX | None]]:
    """Discs whose hull an outline is: centre (2,), radius, and the depth at which the outline is inside a solid, m."""
    if isinstance(outline, PolygonEdges):
        return [(corner, 0.0, ca.SX(2 * outline.half_width)) for corner in outline.tips]
    width = ca.SX(outline.radius) * 2
    centres = outline.ends if isinstance(outline, Segment) else [outline.marker.position]
    return [(centre, outline.radius, None if width.is_zero() else width) for centre in centres]


def on_plane(a: Any, b: HalfPlane) -> list[Touch]:
    """Circle, point, both ends of a bar, or each corner of a polygon above a half-plane."""
    normal, base = b.marker.y_axis, b.marker.position
    return [
        Touch(ca.dot(normal, centre - base) - radius, normal, centre - radius * normal, reach)
        for centre, radius, reach in _discs(a)
    ]


def disc_disc(a: Any, b: Any) -> list[Touch]:
    """Two circles, or a circle and a point."""
    if isinstance(a, Point) and isinstance(b, Point):
        raise ModelError("two points never touch; give one of them a radius: Circle(marker, radius)")
    return [between_discs(a.marker.position, a.radius, b.marker.position, b.radius)]


def disc_segment(a: Any, b: Segment) -> list[Touch]:
    """Circle or point against a bar."""
    if isinstance(a, Point) and b.thin:
        raise ModelError("a point passes through a bar without thickness; give Segment(…, radius=), or use a Circle")
    centre = a.marker.position
    return [between_discs(centre, a.radius, nearest_point(centre, *b.ends), b.radius)]


def disc_polygon(a: Any, b: PolygonEdges) -> list[Touch]:
    """Circle or point against a polygon."""
    return disc_beside_polygon(a.marker.position, a.radius, b)


def in_hole(a: Any, b: HollowCircle) -> list[Touch]:
    """Circle, point, both ends of a bar, or each corner of a polygon in a hole."""
    touches, hole = [], known_value(b.radius)
    for centre, radius, reach in _discs(a):
        disc = known_value(radius)
        if hole is not None and disc is not None and disc >= hole:
            raise ModelError(f"a circle of radius {disc:g} m does not go into a hole of radius {hole:g} m")
        inward = between_discs(b.marker.position, 0.0, centre, 0.0)
        gap = b.radius - radius - inward.gap
        touches.append(Touch(gap, inward.normal, centre - radius * inward.normal, reach))
    return touches


_KINDS: Sequence[tuple[tuple[type, ...], tuple[type, ...], Callable[[Any, Any], list[Touch]]]] = (
    ((Circle, Point, Segment, PolygonEdges), (HalfPlane,), on_plane),
    ((Circle, Point, Segment, PolygonEdges), (HollowCircle,), in_hole),
    ((Circle, Point), (Circle, Point), disc_disc),
    ((Circle, Point), (Segment,), disc_segment),
    ((Circle, Point), (PolygonEdges,), disc_polygon),
    ((Segment,), (Segment,), segment_segment),
    ((Segment,), (PolygonEdges,), segment_polygon),
    ((PolygonEdges,), (PolygonEdges,), polygon_polygon),
)


def bounding_distance(a: Outline, b: Outline) -> ca.SX | None:
    """Return an expression that is positive only if two outlines do not touch; None if there is none.

    Circles around the outlines are compared, and of two polygons the axes that may separate them: this costs far less
    than forces at the places of contact.
    """
    if isinstance(a, PolygonEdges) and isinstance(b, PolygonEdges) and a.is_convex and b.is_convex:
        return ca.fmax(_least_deep(_faces(a), b.corners)[0], _least_deep(_faces(b), a.corners)[0])
    if a.bounding_circle is None:
        a, b = b, a
    if a.bounding_circle is None:
        return None
    (centre, radius), marker = a.bounding_circle, b.marker
    if isinstance(b, HalfPlane):
        return ca.dot(marker.y_axis, centre - marker.position) - radius
    if isinstance(b, HollowCircle):
        inside = b.radius - radius
        return if_else(inside > 0, inside**2 - ca.sumsqr(centre - marker.position), -1)
    if b.bounding_circle is None:
        return None
    other, other_radius = b.bounding_circle
    return ca.sumsqr(centre - other) - (radius + other_radius) ** 2


def touches(a: Outline, b: Outline, what: str, *, each_corner: bool = False) -> list[Touch]:
    """Return the places at which two outlines may touch; a pair without a rule is refused.

    With `each_corner` every corner of two polygons is a place of its own, which it stays however they turn.
    """
    if each_corner:
        for outline, other in ((a, b), (b, a)):
            hollow = isinstance(outline, PolygonEdges) and not outline.is_convex
            if hollow and not isinstance(other, HalfPlane | HollowCircle):
                raise ModelError(
                    f"{what}: {outline.description} is not convex, which a rigid contact takes on a HalfPlane and in a "
                    "HollowCircle only; split it into convex ones, or take a Contact with a stiffness"
                )
        if isinstance(a, PolygonEdges) and isinstance(b, PolygonEdges):
            return polygon_polygon(a, b, each_corner)
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
