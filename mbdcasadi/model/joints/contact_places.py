"""Where outlines and curves are touched at the estimated poses: the start of the contact parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..bodies import Marker, rotation
from ..element import at_poses
from ..geometry.cam_outlines import CamOutline
from ..geometry.curves import Curve, least
from ..geometry.shapes import rotation_matrix
from ..symbols import values_of


def _in_frame(a: Marker, vector: ca.SX, bodies: list) -> np.ndarray:
    """A global vector (2,) in the axes of marker a, at the estimated poses."""
    return values_of(at_poses(rotation(-a.angle) @ vector, bodies)).ravel()


def touching_place(outline: CamOutline, a: Marker, b: Marker) -> float:
    """Place where the outline touches the line of the face, or would do so: on the nearer side."""
    bodies = [a.body, b.body]
    normal, origin = _in_frame(a, b.y_axis, bodies), _in_frame(a, b.position - a.position, bodies)

    def height(parameters: np.ndarray) -> np.ndarray:
        return normal @ outline.points_and_normals(parameters)[0] - normal @ origin

    below, above = least(height, outline), least(lambda p: -height(p), outline)
    return min(below, above, key=lambda place: abs(float(height(np.array([place]))[0])))


def nearest_place(curve: Curve, a: Marker, b: Marker, beside: float) -> float:
    """Place on the curve, or on the one beside it, that is nearest to b."""
    point = _in_frame(a, b.position - a.position, [a.body, b.body])

    def away(parameters: np.ndarray) -> np.ndarray:
        points, normals = curve.points_and_normals(parameters)
        return np.hypot(*(points + beside * normals - point[:, None]))

    return least(away, curve)


def touching_places(one: CamOutline, other: CamOutline, a: Marker, b: Marker) -> tuple[float, float]:
    """Places at which two outlines are nearest to touching, their outward normals opposite."""
    bodies = [a.body, b.body]
    offset = _in_frame(a, b.position - a.position, bodies)
    turn = float(values_of(at_poses(b.angle - a.angle, bodies))[0, 0])
    matrix = rotation_matrix(turn)
    size = max(one.size, other.size)
    grids = [np.linspace(0, 2 * np.pi, 180, endpoint=False)] * 2
    step = grids[0][1]
    best = (0.0, 0.0)
    while step > 1e-10:
        p, n = one.points_and_normals(grids[0])
        p_other, n_other = (matrix @ x for x in other.points_and_normals(grids[1]))
        apart = np.sum((p[:, :, None] - p_other[:, None, :] - offset[:, None, None]) ** 2, axis=0)
        against = np.sum((n[:, :, None] + n_other[:, None, :]) ** 2, axis=0)
        k, j = np.unravel_index(np.argmin(apart + size**2 * against), apart.shape)
        best = float(grids[0][k]), float(grids[1][j])
        grids = [centre + step * np.linspace(-1, 1, 17) for centre in best]
        step /= 6
    return best
