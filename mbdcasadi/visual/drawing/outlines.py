"""Geometry of bodies: outlines of their shapes, and the places of their elements."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...model.bodies import Body, Marker
from . import lines
from .pen import Pen

#: Half the width of a link, in units.
HALF_WIDTH = 0.95
#: Cuts across a body, at whose middles its name may be led to.
CUTS = 7


def outlines_of(body: Body) -> list[np.ndarray]:
    """Outlines of a body's shape in its centroidal frame; a rod as its two ends."""
    return [np.asarray(outline.points, float) + body.shape_frame for outline in body.shape.outlines()]  # type: ignore[union-attr]


def shape_loops(body: Body, unit: float) -> list[np.ndarray]:
    """Outlines of a body's shape in its centroidal frame; rods get a width."""
    return [lines.plate(loop, HALF_WIDTH * unit) if len(loop) == 2 else loop for loop in outlines_of(body)]


def local_outlines(body: Body, marker: Marker, pen: Pen) -> list[np.ndarray]:
    """Outline of a body's shape in the axes of a marker on it; a rod as its two ends."""
    frame = pen.on(marker)
    return [lines.turned(loop - frame.shift, -frame.angle) for loop in outlines_of(body)]


def sections(loops: Sequence[np.ndarray]) -> tuple[float, float, float, float]:
    """Ends along x, and the usual edges across it: medians over cuts, so that a flange or a foot does not count."""
    points = np.vstack(loops)
    back, front = float(points[:, 0].min()), float(points[:, 0].max())
    bottoms, tops = [], []
    for x in np.linspace(back, front, 25)[1:-1]:
        heights = [h for loop in loops for h in _crossings(loop, x)]
        if heights:
            bottoms.append(min(heights))
            tops.append(max(heights))
    if not bottoms:
        return back, front, float(points[:, 1].min()), float(points[:, 1].max())
    return back, front, float(np.median(bottoms)), float(np.median(tops))


def _crossings(loop: np.ndarray, x: float) -> list[float]:
    """Heights at which a closed polygon passes a place x."""
    p, q = loop, np.roll(loop, -1, axis=0)
    passes = (p[:, 0] - x) * (q[:, 0] - x) < 0
    p, q = p[passes], q[passes]
    return list(p[:, 1] + (x - p[:, 0]) / (q[:, 0] - p[:, 0]) * (q[:, 1] - p[:, 1]))


def places_on(loops: Sequence[np.ndarray], middle: np.ndarray) -> list[tuple[float, float]]:
    """Points on the material of a body, from the one nearest to a point on: in the middle of cuts across it.

    Parameters
    ----------
    loops : sequence of numpy.ndarray
        Outlines (k, 2) of the body, in its frame, m; those of a hole too.
    middle : numpy.ndarray
        The point (2,), m.
    """
    loops = [loop for loop in loops if len(loop) > 2 and loop.shape[1] == 2]
    if not loops:
        return [(float(middle[0]), float(middle[1]))]
    points = np.vstack(loops)
    spread = points - points.mean(axis=0)
    x, y = np.linalg.eigh(spread.T @ spread)[1][:, -1]  # along it
    angle = float(np.arctan2(y, x))
    turned, (centre,) = [lines.turned(loop, -angle) for loop in loops], lines.turned(middle[None], -angle)
    low, high = (float(f(np.vstack(turned)[:, 0])) for f in (np.min, np.max))
    found = []
    for at in [centre[0], *np.linspace(low, high, CUTS + 2)[1:-1]]:
        heights = sorted(h for loop in turned for h in _crossings(loop, at))
        pieces = list(zip(heights[::2], heights[1::2], strict=False))
        if any(bottom <= centre[1] <= top for bottom, top in pieces) and at == centre[0]:
            found.append([at, centre[1]])
        elif pieces:
            bottom, top = max(pieces, key=lambda piece: piece[1] - piece[0])
            found.append([at, (bottom + top) / 2])
    places = lines.turned(np.array(found), angle)
    nearest = np.argsort(np.hypot(*(places - middle).T), kind="stable")
    return [(float(x), float(y)) for x, y in places[nearest]]


def is_inside(loops: Sequence[np.ndarray], point: np.ndarray) -> bool:
    """Return True if a point (2,) lies within outlines, but in their holes."""
    return sum(h > point[1] for loop in loops for h in _crossings(loop, float(point[0]))) % 2 == 1


def nearest_on(line: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Point (2,) of a line through points (k, 2) that is nearest to a point (2,)."""
    start, way = line[:-1], np.diff(line, axis=0)
    length = np.maximum(np.sum(way**2, axis=1), 1e-300)
    feet = start + np.clip(np.sum((point - start) * way, axis=1) / length, 0, 1)[:, None] * way
    return feet[np.argmin(np.hypot(*(feet - point).T))]


def points_on(body: Body, elements: Sequence[Any], pen: Pen) -> np.ndarray:
    """Different places of elements on a body (k, 2), in its frame, m."""
    return np.array(list(apart(markers_on(body, elements), pen).values())).reshape(-1, 2)


def markers_on(body: Body, elements: Sequence[Any]) -> list[Marker]:
    """Markers of elements on a body."""
    return [m for e in elements for m in getattr(e, "markers", ()) if m.body is body]


def apart(markers: Sequence[Marker], pen: Pen) -> dict[Marker, np.ndarray]:
    """Markers on one body with their places (2,), m; of those at one place the first."""
    places: dict[Marker, np.ndarray] = {}
    for marker in markers:
        place = pen.first(marker.local)
        if not any(pen.vanishes(place - other) for other in places.values()):
            places[marker] = place
    return places
