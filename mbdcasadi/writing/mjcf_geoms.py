"""Outlines of contacts as geoms of MuJoCo."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..model.forces.contact.outlines import Circle, HalfPlane, Outline, PolygonEdges, Segment
from ..numerics.tolerances import NEGLIGIBLE
from ..results.state import State


def geom_of(outline: Outline, state: State) -> tuple[str, np.ndarray, float] | None:
    """Kind and size of the geom of an outline, and the angle of its frame from the marker's, rad; None without one.

    The frame has the first axis of a box, and the last one of a plane and a capsule, which a file gives as ``zaxis``.
    """
    if isinstance(outline, Circle):
        return "sphere", np.array([_value(state, outline.radius)]), 0.0
    if isinstance(outline, HalfPlane) and outline.marker.body.is_ground:
        return "plane", np.array([0.0, 0.0, 1.0]), np.pi / 2
    if isinstance(outline, Segment) and not outline.thin:
        return "capsule", np.array([_value(state, outline.radius), _value(state, outline.length) / 2]), 0.0
    if isinstance(outline, PolygonEdges) and len(outline.points) == 4:
        (ax, ay), (bx, by), *_ = points = outline.points - np.mean(outline.points, axis=0)
        middle = np.max(np.abs(np.mean(outline.points, axis=0)))
        apart = np.abs([*(points[0] + points[2]), (bx - ax) * (ax + bx) + (by - ay) * (ay + by), middle])
        if np.max(apart) < NEGLIGIBLE * np.max(np.abs(points)):
            length, height = np.hypot(bx - ax, by - ay) / 2, np.hypot(bx + ax, by + ay) / 2
            return "box", np.array([length, height, height]), float(np.arctan2(by - ay, bx - ax))
    return None


def _value(state: State, size: Any) -> float:
    return float(size) if isinstance(size, int | float) else float(state[size])
