"""Outlines in contact: the points that touch at the estimated poses, and the checks of an outline for its follower."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.tolerances import NEGLIGIBLE
from ..bodies import Marker, rotation
from ..element import at_poses
from ..geometry.cam_outlines import CamOutline
from ..geometry.curves import Curve, least
from ..geometry.shapes import rotation_matrix
from ..quantities import Limit
from ..symbols import symbols_of, values_of


def _in_frame(a: Marker, vector: ca.SX) -> np.ndarray:
    """Return a global vector (2,) in the axes of marker a, at the estimated poses."""
    return values_of(at_poses(rotation(-a.angle) @ vector)).ravel()


def touching_place(outline: CamOutline, a: Marker, b: Marker) -> float:
    """Return the parameter at which the outline touches the line of the face, or comes closest, on the nearer side."""
    normal, origin = _in_frame(a, b.y_axis), _in_frame(a, b.position - a.position)

    def height(parameters: np.ndarray) -> np.ndarray:
        return normal @ outline.points_and_normals(parameters)[0] - normal @ origin

    below, above = least(height, outline), least(lambda p: -height(p), outline)
    return min(below, above, key=lambda place: abs(float(height(np.array([place]))[0])))


def nearest_place(curve: Curve, a: Marker, b: Marker, beside: float) -> float:
    """Return the parameter of the point nearest to b on a curve, or on the one parallel to it at a distance."""
    return least(_away(curve, a, b, beside), curve)


def _away(curve: Curve, a: Marker, b: Marker, beside: float) -> Callable[[np.ndarray], np.ndarray]:
    """Return the distance of b from points of the curve that is parallel to another at a distance, by parameters."""
    point = _in_frame(a, b.position - a.position)

    def away(parameters: np.ndarray) -> np.ndarray:
        points, normals = curve.points_and_normals(parameters)
        return np.hypot(*(points + beside * normals - point[:, None]))

    return away


def nearest_side(what: str, curve: Curve, a: Marker, b: Marker, radius: float) -> tuple[float, int]:
    """Return the parameter at which a wheel about b comes closest to touching a curve, and its side: 1 to the right."""
    places = {side: nearest_place(curve, a, b, side * radius) for side in (1, -1)}
    off = {side: float(_away(curve, a, b, side * radius)(np.array([x]))[0]) for side, x in places.items()}
    if abs(off[1] - off[-1]) <= NEGLIGIBLE * radius:
        raise ModelError(
            f"{what}: the centre of the wheel is on the curve at the estimated poses, which do not say on which side "
            "it rolls; give its body a pose= beside the curve"
        )
    side = min(off, key=off.__getitem__)
    return places[side], side


def touching_places(one: CamOutline, other: CamOutline, a: Marker, b: Marker) -> tuple[float, float]:
    """Return the parameters at which two outlines come closest with opposite outward normals."""
    offset = _in_frame(a, b.position - a.position)
    turn = float(values_of(at_poses(b.angle - a.angle))[0, 0])
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


def as_outline(outline: Any, what: str) -> CamOutline:
    if not isinstance(outline, CamOutline):
        raise ModelError(f"{what}: the outline must be a CamOutline, got {outline!r}")
    return outline


def _place(outline: Curve, k: int) -> str:
    (x,), (y,) = outline.points_and_normals(outline.samples[k : k + 1])[0]
    return f"the parameter {outline.samples[k]:.4g}, the point ({x:.4g}, {y:.4g}) m of the outline"


def _most_hollow(outline: Curve, side: int = 1) -> tuple[int, float]:
    """Return the sample of the least curvature (most concave) of an outline, and that curvature, 1/m.

    The side is 1 for a curve seen from the right of its tangent, as an outline is, and -1 from the left.
    """
    bends = side * outline.curvatures(outline.samples)
    k = int(np.argmin(bends))
    return k, float(bends[k])


def convex(what: str, outline: CamOutline) -> tuple[Limit, ...]:
    k, bend = _most_hollow(outline)
    if bend <= 1e-9 / outline.size:
        raise ModelError(
            f"{what}: a flat face cannot follow the outline at {_place(outline, k)}: its curvature is {bend:.4g} "
            "1/m, and it must be positive (convex) everywhere"
        )
    return _limits(what, "curvature of the outline", outline, outline.curvature)


def wide_enough(what: str, outline: Curve, radius: Any, part: str = "roller") -> tuple[Limit, ...]:
    """Return limits on hollows for a roller to the right of the tangent, or to the left if its radius is negative."""
    known = float(values_of(radius)[0, 0])
    k, bend = _most_hollow(outline, 1 if known >= 0 else -1)
    if 1 + abs(known) * bend <= 0:
        raise ModelError(
            f"{what}: the {part} of radius {abs(known):g} m does not fit into the hollow at {_place(outline, k)}: the "
            f"radius of curvature there is {-1 / bend:.4g} m; take a smaller {part}"
        )
    name = f"1 + {part} radius × curvature of the outline"
    return _limits(what, name, outline, lambda place: 1 + radius * outline.curvature(place))


def positive_radius(what: str, *outlines: CamOutline) -> tuple[Limit, ...]:
    """Return limits on the polar radius of outlines, for other values of the parameters."""
    return tuple(
        limit for outline in outlines for limit in _limits(what, "radius of the outline", outline, outline.radius)
    )


def _limits(what: str, name: str, outline: Curve, value: Callable[[float], Any]) -> tuple[Limit, ...]:
    """Return limits on a value that must be positive along an outline, if it depends on parameters."""
    if not symbols_of(value(0.1)):
        return ()
    places = outline.samples[:: len(outline.samples) // 90]
    return tuple(
        Limit(what, f"{name} at the parameter {place:.4g}", ca.SX(value(float(place))), above=0.0) for place in places
    )


def fitting(what: str, one: CamOutline, other: CamOutline) -> None:
    for first, second in ((one, other), (other, one)):
        k, bend = _most_hollow(first)
        sharpest = float(np.max(second.curvatures(second.samples)))
        if bend + sharpest <= 0:
            raise ModelError(
                f"{what}: no part of the other outline fits into the hollow at {_place(first, k)}: the radius of "
                f"curvature is {-1 / bend:.4g} m there, and the other's smallest one {1 / sharpest:.4g} m"
            )
