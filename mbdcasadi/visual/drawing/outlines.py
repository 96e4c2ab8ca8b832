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


def on_material(loops: Sequence[np.ndarray], point: np.ndarray) -> np.ndarray:
    """Return a point of a body, or, if it lies in the hole of a ring, one on the rim above it (2,)."""
    heights = sorted(h for loop in loops if len(loop) > 2 for h in _crossings(loop, float(point[0])))
    around = [sum(h > point[1] for h in _crossings(loop, float(point[0]))) % 2 for loop in loops if len(loop) > 2]
    if sum(around) < 2 or sum(around) % 2:  # not inside both a rim and its hole
        return point
    return np.array([point[0], (heights[-1] + heights[-2]) / 2])


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
