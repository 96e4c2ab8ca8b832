"""What an outline must be like for a follower, and the message where it is not: undercutting, with the place."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ...errors import ModelError
from ..geometry.cam_outlines import CamOutline
from ..geometry.curves import Curve
from ..quantities import Limit, quantity
from ..symbols import symbols_of, values_of


def as_outline(outline: Any, what: str) -> CamOutline:
    if not isinstance(outline, CamOutline):
        raise ModelError(f"{what}: the outline must be a CamOutline, got {outline!r}")
    return outline


def _place(outline: Curve, k: int) -> str:
    (x,), (y,) = outline.points_and_normals(outline.samples[k : k + 1])[0]
    return f"the parameter {outline.samples[k]:.4g}, the point ({x:.4g}, {y:.4g}) m of the outline"


def _most_hollow(outline: CamOutline) -> tuple[int, float]:
    """Sample at which the outline is bent inwards most, or outwards least, and its curvature there, 1/m."""
    bends = outline.curvatures(outline.samples)
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


def wide_enough(what: str, outline: CamOutline, radius: Any) -> tuple[Limit, ...]:
    known = float(values_of(radius)[0, 0])
    k, bend = _most_hollow(outline)
    if 1 + known * bend <= 0:
        raise ModelError(
            f"{what}: the roller of radius {known:g} m does not fit into the hollow at {_place(outline, k)}: the "
            f"radius of curvature there is {-1 / bend:.4g} m; take a smaller roller"
        )
    name = "1 + roller radius × curvature of the outline"
    return _limits(what, name, outline, lambda place: 1 + radius * outline.curvature(place))


def positive_radius(what: str, *outlines: CamOutline) -> tuple[Limit, ...]:
    """Limits on the polar radius of outlines at other values of the parameters; their own were checked before."""
    return tuple(
        limit for outline in outlines for limit in _limits(what, "radius of the outline", outline, outline.radius)
    )


def _limits(what: str, name: str, outline: CamOutline, value: Callable[[float], Any]) -> tuple[Limit, ...]:
    """What must stay positive at places of the outline for other values of the parameters, where it depends on any."""
    limits: list[Limit] = []
    if symbols_of(value(0.1)):
        for place in outline.samples[:: len(outline.samples) // 90]:
            quantity(value(float(place)), what, f"{name} at the parameter {place:.4g}", above=0.0, limits=limits)
    return tuple(limits)


def fitting(what: str, one: CamOutline, other: CamOutline) -> None:
    for first, second in ((one, other), (other, one)):
        k, bend = _most_hollow(first)
        sharpest = float(np.max(second.curvatures(second.samples)))
        if bend + sharpest <= 0:
            raise ModelError(
                f"{what}: no part of the other outline fits into the hollow at {_place(first, k)}: the radius of "
                f"curvature is {-1 / bend:.4g} m there, and the other's smallest one {1 / sharpest:.4g} m"
            )
