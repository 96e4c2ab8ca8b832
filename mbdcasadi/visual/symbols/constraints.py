"""Symbols of constraints on single coordinates, of blades, and of motions that are prescribed."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...model.drivers import Driver
from ...model.forces.applied import GeneralizedForce
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.joints.constraints import KnifeEdge
from ...model.joints.coordinates import AbsoluteAngle, AbsoluteDistance, AbsoluteX, AbsoluteY
from ...model.joints.lower_pairs import Revolute
from ...model.symbols import t
from ..drawing import lines, scene
from ..drawing.pen import Pen
from .base import nothing, symbol
from .lower_pairs import block_on_rail


def roller(pen: Pen, marker: Any, angle: float) -> None:
    """A support on rollers, which leaves the way across the angle free."""
    u = pen.unit
    frame = pen.at(marker.position, angle - np.pi / 2)
    frame.area("ground", [[0.32 * u, -0.4 * u], [-0.32 * u, -0.4 * u], [-1.1 * u, -1.5 * u], [1.1 * u, -1.5 * u]],
               layer=scene.GROUND)  # fmt: skip
    for x in (-0.65, 0.65):
        frame.area("pin", lines.circle((x * u, -1.9 * u), 0.38 * u, 24), layer=scene.GROUND)
    pen.hatched(frame, (-1.7 * u, -2.3 * u), (1.7 * u, -2.3 * u))
    pen.pin(pen.on(marker), 0.4)


@symbol.register
def absolute_x(joint: AbsoluteX, pen: Pen) -> None:
    """A support on rollers that go up and down; a pin on a stand, where the other coordinate is held too."""
    _held(joint, pen, 0.0)


@symbol.register
def absolute_y(joint: AbsoluteY, pen: Pen) -> None:
    """A support on rollers that go to and fro; a pin on a stand, where the other coordinate is held too."""
    _held(joint, pen, np.pi / 2)


@symbol.register
def absolute_angle(joint: AbsoluteAngle, pen: Pen) -> None:
    """A square that keeps its direction; nothing where a rail keeps it."""
    if any(other.marker.body is joint.marker.body for other in _of_kind(pen, (AbsoluteX, AbsoluteY))):
        return
    u = pen.unit
    frame = pen.on(joint.marker)
    frame.area("block", lines.rectangle((-0.8 * u, -0.8 * u), (0.8 * u, 0.8 * u)), layer=scene.SLOT)
    frame.draw("line", [[-0.8 * u, 0], [0.8 * u, 0]], [[0, -0.8 * u], [0, 0.8 * u]], layer=scene.SLOT)


def _of_kind(pen: Pen, kinds: tuple[type, ...]) -> list[Any]:
    return [joint for joint in pen.sample.mechanism.joints if isinstance(joint, kinds)]


def _held(joint: Any, pen: Pen, angle: float) -> None:
    """What holds one coordinate of a point, by what else holds the same body."""
    marker = joint.marker
    partner = AbsoluteY if isinstance(joint, AbsoluteX) else AbsoluteX
    still = np.ptp(pen.over(marker.position), axis=0).max() <= 1e-6 * pen.unit
    if still and any(pen.at_one_place(marker, other.marker) for other in _of_kind(pen, (partner,))):
        frame = pen.at(marker.position)
        pen.stand(frame)
        pen.pin(frame)
    elif any(other.marker.body is marker.body for other in _of_kind(pen, (AbsoluteAngle,))):
        low, high = pen.span(marker.position[0 if angle else 1])
        block_on_rail(pen, marker, pen.at(joint_line(marker, angle), angle - np.pi / 2), low, high)
    else:
        roller(pen, marker, angle)


def joint_line(marker: Any, angle: float) -> Any:
    """Foot of a marker on the axis along which it is free."""
    return ca.vertcat(0, marker.y) if angle else ca.vertcat(marker.x, 0)


@symbol.register
def absolute_distance(joint: AbsoluteDistance, pen: Pen) -> None:
    """A thin link from a fixed point."""
    pen.between(joint.point, joint.marker.position).draw("link", lines.along([0, 1], 0), layer=scene.SLOT)
    fixed = pen.at(joint.point)
    pen.stand(fixed)
    pen.pin(fixed, 0.4)
    pen.pin(pen.on(joint.marker), 0.4)


@symbol.register
def knife_edge(joint: KnifeEdge, pen: Pen) -> None:
    """A thin wheel seen from above."""
    u = pen.unit
    frame = pen.on(joint.marker)
    frame.area("dot", lines.plate(np.array([[-1.2 * u, 0], [1.2 * u, 0]]), 0.28 * u), layer=scene.PIN)


# --- what moves or is moved -----------------------------------------------------------------
@symbol.register
def driver(element: Driver, pen: Pen) -> None:
    """An arrow along the motion that is prescribed, the way it mostly goes."""
    motion_arrow(pen, element.expression, element.bodies, sense(pen, ca.jacobian(element.value, t)))


@symbol.register
def generalized_force(element: GeneralizedForce, pen: Pen) -> None:
    """An arrow along the displacement of each pair."""
    for displacement, force in element.virtual_work:
        motion_arrow(pen, displacement, element.bodies, sense(pen, ca.sum1(force)))


def sense(pen: Pen, value: Any) -> float:
    """1, or -1 where a scalar is negative for the most part."""
    return -1.0 if np.mean(pen.over(value)) < 0 else 1.0


def motion_arrow(pen: Pen, expression: Any, bodies: Any, way: float) -> None:
    """An arrow along what an expression moves first: straight for a place, curved for an angle."""
    moving = [body for body in bodies if not body.is_ground]
    slopes = [ca.jacobian(ca.sum1(ca.vec(ca.SX(expression))), body.q) for body in moving]
    for body, slope in zip(reversed(moving), reversed(slopes), strict=True):
        if slope[:2].nnz():
            _straight(pen, body, way * slope)
            return
    if moving:
        turning(pen, moving[-1], moving, way * sense(pen, slopes[-1][2]))


def _straight(pen: Pen, body: Any, slope: Any) -> None:
    u = pen.unit
    frame = pen.along(body.position, slope[:2])
    shaft, head = lines.arrow(3.2 * u, 1.3 * u)
    beside = np.array([0.0, 2.0 * u])
    frame.draw("motion", shaft + beside, layer=scene.ARROW)
    frame.area("motion head", head + beside, layer=scene.ARROW)


def turning(pen: Pen, body: Any, bodies: Any, way: float) -> None:
    """A curved arrow about the pin that connects the bodies, else about the centre of mass; once at a place."""
    u = pen.unit
    place = pivot_of(pen, body, bodies)
    if not pen.is_new(pen.first(place), pen.arrows):
        return
    shaft, head = (points * [way, 1.0] for points in lines.arc_arrow(1.9 * u, 1.1 * u))
    frame = pen.at(place)
    frame.draw("motion", shaft, layer=scene.ARROW)
    frame.area("motion head", head, layer=scene.ARROW)


def pivot_of(pen: Pen, body: Any, bodies: Any) -> Any:
    """Position of the pin about which a body turns against others: the ground's, where there is one."""
    pins = [j for j in pen.sample.mechanism.joints if isinstance(j, Revolute) and body in j.bodies]
    others = {b for b in bodies if b is not body}

    def rank(joint: Revolute) -> int:
        other = next(b for b in joint.bodies if b is not body)
        return 0 if other in others else 1 if other.is_ground else 2

    found = min(pins, key=rank, default=None)
    return body.position if found is None or rank(found) == 2 else found.marker_on(body).position


symbol.register(FrictionInJoint, nothing)
