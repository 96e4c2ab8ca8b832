"""Forces and couples of a drawing: what acts where, found by the kind of the element."""

from __future__ import annotations

from dataclasses import dataclass
from functools import singledispatch
from typing import Any

import casadi as ca
import numpy as np

from ...model.drivers import Driver
from ...model.expressions import norm
from ...model.forces.applied import Force, Torque
from ...model.forces.contact.contact import Contact
from ...model.forces.field import FieldForce, Gravity
from ...model.forces.motors import DCMotor
from ...model.forces.springs import RSDA, TSDA, Bushing
from ...model.forces.stops import Rope
from ...results.columns import effort_unit, reaction_body
from ..symbols.constraints import pivot_of
from . import lines, scene
from .pen import Pen

#: The longest usual arrow and the radius of the largest usual couple, in parts of the picture's diagonal.
ARROW, COUPLE = 0.16, 0.07
#: Loads below this part of the largest are rounding errors.
NOISE = 1e-9


@dataclass(frozen=True, eq=False)
class Load:
    """A force or a couple at a point.

    Attributes
    ----------
    position : casadi.SX
        (2,), m.
    value : casadi.SX
        Force (2,), N, or couple (1,), N m.
    style : str
        "force", "reaction" or "weight".
    """

    position: ca.SX
    value: ca.SX
    style: str


@singledispatch
def loads(element: Any, pen: Pen) -> list[Load]:
    """Forces and couples that an element exerts, on the second of its bodies where it is a joint."""
    if not hasattr(element, "reaction_on") or not pen.sample.has_multipliers:
        return []
    body = reaction_body(element)
    if body is None:
        return []
    reaction = element.reaction_on(body)
    place, style = reaction.marker.position, "reaction"
    if isinstance(element, Driver):
        style = "force"
        if effort_unit(element) == "N m":
            place = pivot_of(pen, body, element.bodies)
    return [Load(place, reaction.force, style), Load(place, ca.SX(reaction.torque), style)]


@loads.register
def _force(element: Force, pen: Pen) -> list[Load]:
    return [Load(element.at.position, element.force, "force")]


@loads.register(Torque)
@loads.register(DCMotor)
def _torque(element: Any, pen: Pen) -> list[Load]:
    return [Load(pivot_of(pen, element.body, element.bodies), ca.SX(element.torque), "force")]


@loads.register(TSDA)
@loads.register(Rope)
def _spring(element: Any, pen: Pen) -> list[Load]:
    way = element.b.position - element.a.position
    tension = element.force * way / norm(way)
    ends = ((element.a, tension), (element.b, -tension))
    return [Load(marker.position, force, "force") for marker, force in ends if not marker.body.is_ground]


@loads.register
def _torsion_spring(element: RSDA, pen: Pen) -> list[Load]:
    marker, sign = (element.a, 1) if element.b.body.is_ground else (element.b, -1)
    return [Load(marker.position, sign * ca.SX(element.torque), "force")]


@loads.register
def _bushing(element: Bushing, pen: Pen) -> list[Load]:
    return [Load(element.b.position, element.a.axes @ element.force, "force")]


@loads.register
def _field(element: FieldForce, pen: Pen) -> list[Load]:
    return [Load(element.body.position, element.force, "force")]


@loads.register
def _contact(element: Contact, pen: Pen) -> list[Load]:
    return [Load(point, force, "force") for point, force in element.forces]


@loads.register
def _gravity(element: Gravity, pen: Pen) -> list[Load]:
    g = element.acceleration
    return [Load(body.position, ca.SX(body.mass) * g, "weight") for body in pen.sample.mechanism.bodies]


def draw_loads(pen: Pen, everything: bool) -> dict[str, float]:
    """Draw arrows as long as forces are large, and curved ones for couples.

    Parameters
    ----------
    pen : Pen
        What to draw with.
    everything : bool
        All loads; else those of :class:`Force` elements alone. The others form the group "loads".

    Returns
    -------
    dict of str to float
        Scale: newtons of an arrow, and newton metres of a curved one, of the size 1 m.
    """
    mechanism = pen.sample.mechanism
    elements = [*mechanism.joints, *mechanism.drivers, *mechanism.forces]
    found = [(e, load) for e in elements if everything or isinstance(e, Force) for load in loads(e, pen)]
    if not found:
        return {}
    box = pen.box()
    diagonal = float(np.hypot(*(box[1] - box[0])))
    values = pen.over(*[ca.norm_2(load.value) for _, load in found])
    couple = np.array([load.value.numel() == 1 for _, load in found])
    scale = {}
    # rounding errors of what is zero are no loads: a couple is compared with forces at the size of the picture
    noise = NOISE * float(np.max(values / np.where(couple, diagonal, 1.0)))
    for kind, which, longest in (("N", ~couple, ARROW), ("N m", couple, COUPLE)):
        largest = _usual_largest(values[:, which])
        if largest <= noise * (diagonal if kind == "N m" else 1.0):
            continue
        scale[kind] = largest / (longest * diagonal)
        for k in np.flatnonzero(which):
            if np.max(values[:, k]) > 1e-6 * largest:
                element, load = found[k]
                pen.item = pen.item_of(element)
                group = "" if isinstance(element, Force) else "loads"
                (_couple if couple[k] else _arrow)(pen, load, 1 / scale[kind], group)
    return scale


def _usual_largest(sizes: np.ndarray) -> float:
    """Largest value of most times: a peak that passes in a moment would make all others short."""
    if not sizes.size:
        return 0.0
    peaks = sizes.max(axis=1)
    return float(min(peaks.max(), 3 * np.quantile(peaks, 0.75)) or peaks.max())


def _arrow(pen: Pen, load: Load, scale: float, group: str) -> None:
    frame = pen.vector(load.position, load.value, scale)
    frame.draw(load.style, lines.stretched([[0, 0], [0.84, 0]]), layer=scene.ARROW, group=group)
    head = lines.stretched([[1, 0], [0.8, 0.075], [0.8, -0.075]])
    frame.area(f"{load.style} head", head, layer=scene.ARROW, group=group)


def _couple(pen: Pen, load: Load, scale: float, group: str) -> None:
    frame = pen.scaled(load.position, load.value, scale)
    shaft, head = lines.arc_arrow(1.0, 0.42)
    frame.draw(load.style, lines.stretched(shaft), layer=scene.ARROW, group=group)
    frame.area(f"{load.style} head", lines.stretched(head), layer=scene.ARROW, group=group)
