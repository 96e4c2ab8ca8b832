"""Where outlines with edges touch each other: bars and polygons."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ....errors import ModelError
from ...expressions import if_else, norm
from .outlines import PolygonEdges, Segment
from .places import Touch, between_discs, nearest_point, share_along


def segment_segment(a: Segment, b: Segment) -> list[Touch]:
    """Ends of either bar beside the other one."""
    if a.thin and b.thin:
        raise ModelError("two bars without thickness pass through each other; give one of them radius=")
    found = [between_discs(end, a.radius, nearest_point(end, *b.ends), b.radius) for end in a.ends]
    return found + [_beside(end, b.radius, a).reversed() for end in b.ends]


def segment_polygon(a: Segment, b: PolygonEdges) -> list[Touch]:
    """Ends of a bar beside a polygon, and the polygon's corners beside the bar."""
    if a.thin:
        raise ModelError("a corner passes through a bar without thickness; give Segment(…, radius=)")
    found = [disc_beside_polygon(end, a.radius, b) for end in a.ends]
    return found + [_beside(corner, 0.0, a).reversed() for corner in b.corners]


def _beside(centre: ca.SX, radius: ca.SX | float, bar: Segment) -> Touch:
    """A disc beside the straight part of a bar; what its round ends touch counts as contact of these ends."""
    first, second = bar.ends
    share = share_along(centre, first, second - first)
    touch = between_discs(centre, radius, nearest_point(centre, first, second), bar.radius)
    straight = ca.logic_and(share > 0, share < 1)
    return replace(touch, gap=if_else(straight, touch.gap, ca.fabs(touch.gap)))


def disc_beside_polygon(centre: ca.SX, radius: ca.SX | float, b: PolygonEdges) -> Touch:
    """A disc or a point beside a polygon: the nearest edge or corner; inside, the edge that is nearest."""
    corners = b.corners
    outward = b.normals
    heights = [ca.dot(n, centre - c) for n, c in zip(outward, corners, strict=True)]
    # of the edges whose outer side the centre is on, the nearest one; within all, the one with the least depth
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


def polygon_polygon(a: PolygonEdges, b: PolygonEdges) -> list[Touch]:
    """Corners of either polygon on an edge of the other, for the two edges that face each other.

    The edges are those of the axis that separates the polygons most, or that they
    penetrate least, and the edge of the other polygon that faces it (Gottschalk, Lin,
    Manocha, "OBBTree", SIGGRAPH 1996; Catto, "Iterative dynamics with temporal
    coherence", GDC 2005). Both ends of both edges are places; so a block on an equal
    block stands on two corners, wherever it is.
    """
    faces_a, faces_b = _faces(a), _faces(b)
    first = _least_deep(faces_a, b.corners)
    second = _least_deep(faces_b, a.corners)
    by_a = first[0] > second[0]
    on_a = if_else(by_a, first[1], _facing(faces_a, second[1][:2]))
    on_b = if_else(by_a, _facing(faces_b, first[1][:2]), second[1])
    found = [_corner_on_edge(corner, on_b, closed=True) for corner in (on_a[2:4], on_a[4:6])]
    found += [_corner_on_edge(corner, on_a, closed=False).reversed() for corner in (on_b[2:4], on_b[4:6])]
    return [replace(touch, reach=ca.SX((a.half_width + b.half_width) / 2)) for touch in found]


def _faces(polygon: PolygonEdges) -> list[ca.SX]:
    """Outward normal and ends of each edge, each as one vector (6,)."""
    corners = polygon.corners
    return [
        ca.vertcat(normal, start, end)
        for normal, start, end in zip(polygon.normals, corners, [*corners[1:], corners[0]], strict=True)
    ]


def _least_deep(faces: list[ca.SX], corners: list[ca.SX]) -> tuple[ca.SX, ca.SX]:
    """The edge above which some corners are highest, by the lowest of them: that height, and the edge."""
    best, found = ca.SX(-np.inf), faces[0]
    for face in faces:
        heights = [ca.dot(face[:2], corner - face[2:4]) for corner in corners]
        lowest = heights[0]
        for height in heights[1:]:
            lowest = ca.fmin(lowest, height)
        more = lowest > best
        best, found = if_else(more, lowest, best), if_else(more, face, found)
    return best, found


def _facing(faces: list[ca.SX], normal: ca.SX) -> ca.SX:
    """The edge that faces a direction most."""
    best, found = ca.dot(faces[0][:2], normal), faces[0]
    for face in faces[1:]:
        turned = ca.dot(face[:2], normal)
        more = turned < best
        best, found = if_else(more, turned, best), if_else(more, face, found)
    return found


def _corner_on_edge(corner: ca.SX, face: ca.SX, *, closed: bool) -> Touch:
    """A corner above an edge: below it in front of its ends, where `closed` at them too, it penetrates."""
    normal, start, end = face[:2], face[2:4], face[4:6]
    share = share_along(corner, start, end - start)
    height = ca.dot(normal, corner - start)
    on = ca.logic_and(share >= 0, share <= 1) if closed else ca.logic_and(share > 0, share < 1)
    distance = norm(corner - nearest_point(corner, start, end))
    return Touch(if_else(on, height, distance), normal, corner)
