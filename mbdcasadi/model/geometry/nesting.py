"""Outlines that lie inside each other, side by side, or cross."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

#: Edges that are compared with others at a time.
_AT_A_TIME = 64


def crossing_of(loops: Sequence[np.ndarray], touching: float) -> np.ndarray | None:
    """Return a point in which edges of outlines cross, those of one outline among them; None if none do.

    Parameters
    ----------
    loops : sequence of numpy.ndarray
        Closed outlines (k, 2), the first point not repeated.
    touching : float
        Distance of an end of an edge from another edge up to which they touch.
    """
    starts = np.vstack(loops)
    ends = np.vstack([np.roll(loop, -1, axis=0) for loop in loops])
    order = np.argsort(np.minimum(starts[:, 0], ends[:, 0]), kind="stable")
    starts, ends = starts[order], ends[order]
    left, right = np.minimum(starts[:, 0], ends[:, 0]), np.maximum(starts[:, 0], ends[:, 0])
    for first in range(0, len(starts), _AT_A_TIME):
        some = slice(first, first + _AT_A_TIME)
        others = slice(first, int(np.searchsorted(left, np.max(right[some]), side="right")))
        a, b = _beside(starts[some], ends[some], starts[others], ends[others])
        c, d = (x.T for x in _beside(starts[others], ends[others], starts[some], ends[some]))
        crosses = (a * b < 0) & (c * d < 0) & (np.min(np.abs([a, b, c, d]), axis=0) > touching)
        if np.any(crosses):
            k, m = np.argwhere(crosses)[0]
            fraction = a[k, m] / (a[k, m] - b[k, m])
            point: np.ndarray = starts[others][m] + fraction * (ends[others][m] - starts[others][m])
            return point
    return None


def _beside(
    starts: np.ndarray, ends: np.ndarray, others: np.ndarray, ends_of_others: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Distances of both ends of other edges (m, 2) from the lines of edges (k, 2), by sides; each (k, m)."""
    along = ends - starts
    along = along / np.maximum(np.linalg.norm(along, axis=1), 1e-300)[:, None]
    from_others, from_ends = (points[None] - starts[:, None] for points in (others, ends_of_others))
    return _cross(along[:, None], from_others), _cross(along[:, None], from_ends)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    product: np.ndarray = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return product


def sides_of(loop: np.ndarray, other: np.ndarray, touching: float) -> tuple[bool, bool]:
    """True if parts of an outline lie inside another one, and outside.

    Parameters
    ----------
    loop, other : numpy.ndarray
        Closed outlines (k, 2) and (m, 2).
    touching : float
        Distance up to which a point is on the other outline.
    """
    if np.any(loop.max(axis=0) < other.min(axis=0)) or np.any(loop.min(axis=0) > other.max(axis=0)):
        return False, True
    inside = outside = False
    for points in _points_of(loop):
        away = _distance(points, other) > touching
        within = _is_inside(points, other)
        inside, outside = inside or bool(np.any(away & within)), outside or bool(np.any(away & ~within))
    return inside, outside


def _points_of(loop: np.ndarray) -> Iterator[np.ndarray]:
    """Corners and middles of the edges of an outline, some at a time."""
    points = np.vstack([loop, (loop + np.roll(loop, -1, axis=0)) / 2])
    for first in range(0, len(points), _AT_A_TIME):
        yield points[first : first + _AT_A_TIME]


def _distance(points: np.ndarray, loop: np.ndarray) -> np.ndarray:
    """Distance of points (k, 2) from an outline (k,)."""
    edges = np.roll(loop, -1, axis=0) - loop
    away = points[:, None] - loop[None]
    squares = np.maximum(np.sum(edges**2, axis=1), 1e-300)
    part = np.clip(np.sum(away * edges, axis=2) / squares, 0, 1)
    shortest: np.ndarray = np.min(np.linalg.norm(away - part[..., None] * edges, axis=2), axis=1)
    return shortest


def _is_inside(points: np.ndarray, loop: np.ndarray) -> np.ndarray:
    """True for points (k, 2) inside an outline, by the edges that a ray crosses (k,)."""
    x, y = points.T[..., None]
    (xa, ya), (xb, yb) = loop.T, np.roll(loop, -1, axis=0).T
    crosses = (ya > y) != (yb > y)
    with np.errstate(divide="ignore", invalid="ignore"):
        at = xa + (y - ya) / (yb - ya) * (xb - xa)
    inside: np.ndarray = np.sum(crosses & (at > x), axis=1) % 2 == 1
    return inside
