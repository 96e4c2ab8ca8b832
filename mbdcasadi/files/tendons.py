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
    θ the angle of the wrap, if the straight way would meet the circle, or passes it on the other side than that of the
    file; else, and while an end is inside the circle, it is straight.
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
    if side is not None and min(np.hypot(*each) for each in map(_known, (p, q, side))) <= radius:
        raise _refusal(strand, "runs inside of it, or has its side there; only outside is read")
    outside = ca.logic_and(ca.sumsqr(p) > radius**2, ca.sumsqr(q) > radius**2)
    # harmless values while the strand is straight
    squares = [if_else(outside, ca.sumsqr(each), 2 * radius**2) for each in (p, q)]
    nearest = p + ca.fmin(ca.fmax(-ca.dot(p, q - p) / ca.sumsqr(q - p), 0), 1) * (q - p)
    meets = ca.sumsqr(nearest) < radius**2
    turn = ca.atan2(cross(p, q), ca.dot(p, q))
    free = sum(ca.acos(radius / ca.sqrt(each)) for each in squares)
    if side is None:
        angle = ca.fabs(turn)
    else:
        forward = _sense(_known(p), _known(q), _known(side), radius) * turn
        angle = forward + 2 * np.pi * (forward < 0)
        meets = ca.logic_or(meets, ca.dot(side, nearest) < 0)
    straight = sum(ca.sqrt(each - radius**2) for each in squares)
    return if_else(ca.logic_and(outside, meets), straight + radius * (angle - free), norm(end - start))


def _known(vector: ca.SX) -> np.ndarray:
    """Vector in the pose of the file (2,)."""
    return np.asarray(ca.DM(at_poses(vector)).full().ravel())


def _sense(p: np.ndarray, q: np.ndarray, side: np.ndarray, radius: float) -> int:
    """Sense of the way round a circle, of which the middle is nearer to the side; positive counter-clockwise."""
    first, last, there = (np.arctan2(*each[::-1]) for each in (p, q, side))
    free = [np.arccos(radius / np.hypot(*each)) for each in (p, q)]
    middles = {sense: first + sense * (((sense * (last - first)) % (2 * np.pi)) + free[0] - free[1]) / 2
               for sense in (1, -1)}  # fmt: skip
    return max(middles, key=lambda sense: float(np.cos(middles[sense] - there)))


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
