"""Loads of a drawing: arrows as long as forces are large, and curved ones for couples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...model.bodies import Marker
from ...numerics.tolerances import NEGLIGIBLE
from . import lines, scene
from .pen import Pen

#: The longest usual arrow and the radius of the largest usual couple, in parts of the picture's diagonal; the latter in
#: units at most, so that the couples of a chain of many links do not cover it.
ARROW, COUPLE, COUPLE_UNITS = 0.16, 0.07, 2.0
#: Arrows of a kind at one point that are drawn each for itself.
MOST_SEPARATE_LOADS = 3


@dataclass(frozen=True, eq=False)
class Load:
    """A force or a couple at a point.

    Attributes
    ----------
    place : Marker or casadi.SX
        Point on a body, or position (2,), m.
    value : casadi.SX
        Force (2,), N, or couple (1,), N m.
    style : str
        "force", "reaction", "weight", "velocity" or "motion" (of a drive).
    always : bool
        True if it is part of the symbol. Other loads are drawn on request, and form the group "loads".
    """

    place: Marker | ca.SX
    value: ca.SX
    style: str
    always: bool = False


def draw_loads(pen: Pen, loads: Sequence[tuple[Any, Load]]) -> dict[str, float]:
    """Draw arrows as long as forces are large, and curved ones for couples.

    Parameters
    ----------
    pen : Pen
        Pen to draw with.
    loads : sequence of (element, Load)
        Loads to draw.

    Returns
    -------
    dict of str to float
        Scale: newtons of an arrow, and newton metres of a curved one, of the size 1 m.
    """
    if not loads:
        return {}
    loads = _gathered(pen, loads)
    diagonal = scene.diagonal_of(pen.box())
    values = pen.sample.sizes(ca.vertcat(*[ca.norm_2(load.value) for _, load in loads]))
    couple = np.array([load.value.numel() == 1 for _, load in loads])
    values[:, ~np.isfinite(values).all(axis=0)] = 0.0  # not known, as forces of a current in kinematics
    scale = {}
    # rounding errors are not loads: a couple is compared with forces at the size of the picture
    noise = NEGLIGIBLE * float(np.max(values / np.where(couple, diagonal, 1.0)))
    turning = min(COUPLE, COUPLE_UNITS * pen.unit / diagonal)
    for kind, which, longest in (("N", ~couple, ARROW), ("N m", couple, turning)):
        largest = _usual_largest(values[:, which])
        if largest <= noise * (diagonal if kind == "N m" else 1.0):
            continue
        scale[kind] = largest / (longest * diagonal)
        for k in np.flatnonzero(which):
            if np.max(values[:, k]) > 1e-6 * largest:
                element, load = loads[int(k)]
                pen.item = pen.item_of(element)
                group = "" if load.always else "loads"
                (_couple if couple[k] else _arrow)(pen, load, 1 / scale[kind], kind, group)
    return scale


def draw_velocities(pen: Pen) -> dict[str, float]:
    """Draw the velocities of the centres of mass as arrows, which form the group "velocities".

    Returns
    -------
    dict of str to float
        Scale: metres per second of an arrow of 1 m.
    """
    bodies = pen.sample.mechanism.bodies
    speeds = pen.over(*[ca.norm_2(body.velocity) for body in bodies])
    diagonal, largest = scene.diagonal_of(pen.box()), _usual_largest(speeds)
    # a mechanism at rest may be set in motion: it then passes its own size in a second
    scale = (largest if largest > NEGLIGIBLE * diagonal else diagonal) / (ARROW * diagonal)
    for body in bodies:
        pen.item = pen.item_of(body)
        _arrow(pen, Load(body.at(0, 0), body.velocity, "velocity"), 1 / scale, "m/s", "velocities")
    return {"m/s": scale}


def _gathered(pen: Pen, loads: Sequence[tuple[Any, Load]]) -> list[tuple[Any, Load]]:
    """Loads, of which more than :data:`MOST_SEPARATE_LOADS` of a kind at one point of a body become their sum."""
    points: dict[tuple, list[tuple[Any, Load]]] = {}
    for element, load in loads:
        place, kind = load.place, (load.style, load.always, load.value.numel())
        moving = isinstance(place, Marker) and pen.number_of(place.body) is not None
        points.setdefault((*kind, place.body, str(place.local)) if moving else (id(load),), []).append((element, load))
    gathered: list[tuple[Any, Load]] = []
    for group in points.values():
        first = group[0][1]
        if len(group) > MOST_SEPARATE_LOADS:
            group = [(first.place.body, replace(first, value=ca.sum2(ca.horzcat(*[load.value for _, load in group]))))]
        gathered += group
    return gathered


def _usual_largest(sizes: np.ndarray) -> float:
    """Largest value of most times: a peak that passes in a moment would make all others short."""
    if not sizes.size:
        return 0.0
    peaks = sizes.max(axis=1)
    return float(min(peaks.max(), 3 * np.quantile(peaks, 0.75)) or peaks.max())


def _arrow(pen: Pen, load: Load, scale: float, unit: str, group: str) -> None:
    frame = pen.vector(load.place, load.value, scale, unit)
    frame.draw(load.style, lines.stretched([[0, 0], [0.84, 0]]), layer=scene.ARROW, group=group)
    head = lines.stretched([[1, 0], [0.8, 0.075], [0.8, -0.075]])
    frame.area(f"{load.style} head", head, layer=scene.ARROW, group=group)


def _couple(pen: Pen, load: Load, scale: float, unit: str, group: str) -> None:
    frame = pen.scaled(load.place, load.value, scale, unit)
    shaft, head = lines.arc_arrow(1.0, 0.42)
    frame.draw(load.style, lines.stretched(shaft), layer=scene.ARROW, group=group)
    frame.area(f"{load.style} head", lines.stretched(head), layer=scene.ARROW, group=group)
