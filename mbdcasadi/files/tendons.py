"""Lengths of tendons that run from point to point, and around circles."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from ..errors import FileError
from ..model.bodies import Marker
from ..model.element import at_poses, cross
from ..model.expressions import if_else, norm
from .robot_contacts import ALONG
from .robots import Link, Strand

#: From a link and a point of the world, in the pose of the file, to the marker there.
At = Callable[[Link, np.ndarray], Marker]


def strand_length(strand: Strand, at: At, normal: np.ndarray) -> ca.SX:
    """Return the length of a strand, m: ``√(l² + h²)``, with the way l in the plane and h across it.

    Around a circle the way is ``√(p² - r²) + r θ + √(q² - r²)``, p and q the distances of the ends from its centre and
    θ the arc, the shorter one of the two, if the straight way would meet the circle. With a side the strand never lies
    across the ray from the centre away from it: if the straight way does, the other arc is taken (MuJoCo 4; before, one
    that was chosen by tangents). Else the way is straight, as if an end is inside of the circle.
    """
    start, end = (at(*point).position for point in (strand.start, strand.end))
    across = float(normal @ (strand.end[1] - strand.start[1]))
    way = norm(end - start) if strand.around is None else _wrapped(strand, at, normal, start, end)
    return way if across == 0 else ca.sqrt(way**2 + across**2)


def _wrapped(strand: Strand, at: At, normal: np.ndarray, start: ca.SX, end: ca.SX) -> ca.SX:
    solid = strand.around
    assert solid is not None
    radius = _radius(strand, normal)
    center = at(solid.link, solid.place).position
    p, q = start - center, end - center
    side = None if strand.side is None else at(*strand.side).position - center
    if side is not None and np.hypot(*np.ravel(ca.DM(at_poses(side)))) <= radius:
        raise _refusal(strand, "runs inside of it, or has its side there; only outside is read")
    nearest = p + ca.fmin(ca.fmax(-ca.dot(p, q - p) / ca.sumsqr(q - p), 0), 1) * (q - p)
    meets = ca.sumsqr(nearest) < radius**2
    angle = ca.fabs(ca.atan2(cross(p, q), ca.dot(p, q)))
    if side is not None:
        a, b = cross(side, p), cross(side, q)
        is_behind = ca.logic_and(a * b < 0, ca.dot(side, b * p - a * q) * (b - a) < 0)
        angle = if_else(is_behind, 2 * np.pi - angle, angle)
        meets = ca.logic_or(meets, is_behind)
    # inside of the circle any distance will do, as the arc is not taken
    is_outside = ca.fmin(ca.sumsqr(p), ca.sumsqr(q)) > radius**2
    free = [ca.sqrt(if_else(is_outside, ca.sumsqr(each), 2 * radius**2) - radius**2) for each in (p, q)]
    turns = [ca.atan(each / radius) for each in free]
    arc = radius * (angle - sum(turns))
    return if_else(ca.logic_and(meets, is_outside), sum(free) + arc, norm(end - start))


def _radius(strand: Strand, normal: np.ndarray) -> float:
    """Radius of the circle in the plane around which a strand runs, m."""
    solid = strand.around
    assert solid is not None
    axis = solid.link.rotation @ solid.rotation[:, 2]
    if solid.kind == "cylinder" and np.linalg.norm(np.cross(axis, normal)) < ALONG:
        return float(solid.size[0])
    beside = [abs(float(normal @ (point - solid.place))) for _, point in (strand.start, strand.end)]
    if solid.kind == "sphere" and max(beside) < ALONG * solid.size[0]:
        return float(solid.size[0])
    raise _refusal(
        strand, "is none of those that are read: a cylinder across the plane of the motion, or a sphere in it"
    )


def _refusal(strand: Strand, reason: str) -> FileError:
    assert strand.around is not None
    return strand.around.source.refuse(f"is what a tendon wraps, and {reason}")
