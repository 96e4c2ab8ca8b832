"""Constraints on single coordinates, and blades."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...model.joints.constraints import KnifeEdge
from ...model.joints.coordinates import AbsoluteAngle, AbsoluteDistance, AbsoluteX, AbsoluteY
from ..drawing import lines, scene
from ..drawing.pen import Pen
from .base import glyph
from .lower_pairs import block_on_rail


def roller(pen: Pen, marker: Any, angle: float) -> None:
    """A support on rollers, which leaves the direction across the angle free."""
    u = pen.unit
    frame = pen.at(marker.position, angle - np.pi / 2)
    frame.area("ground", [[0.32 * u, -0.4 * u], [-0.32 * u, -0.4 * u], [-1.1 * u, -1.5 * u], [1.1 * u, -1.5 * u]],
               layer=scene.GROUND)  # fmt: skip
    for x in (-0.65, 0.65):
        frame.area("pin", lines.circle((x * u, -1.9 * u), 0.38 * u, 24), layer=scene.GROUND)
    pen.hatched(frame, (-1.7 * u, -2.3 * u), (1.7 * u, -2.3 * u))
    pen.pin(pen.on(marker), 0.4)


@glyph.register
def absolute_x(joint: AbsoluteX, pen: Pen) -> None:
    """A support on rollers that go up and down; a pin on a stand if the other coordinate is held too."""
    _held(joint, pen, 0.0)


@glyph.register
def absolute_y(joint: AbsoluteY, pen: Pen) -> None:
    """A support on rollers; a pin on a stand if the other coordinate is held too."""
    _held(joint, pen, np.pi / 2)


@glyph.register
def absolute_angle(joint: AbsoluteAngle, pen: Pen) -> None:
    """A square that keeps its direction; nothing if a rail keeps it."""
    if any(other.marker.body is joint.marker.body for other in _of_kind(pen, (AbsoluteX, AbsoluteY))):
        return
    u = pen.unit
    frame = pen.on(joint.marker)
    frame.area("block", lines.rectangle((-0.8 * u, -0.8 * u), (0.8 * u, 0.8 * u)), layer=scene.SLOT)
    frame.draw("line", [[-0.8 * u, 0], [0.8 * u, 0]], [[0, -0.8 * u], [0, 0.8 * u]], layer=scene.SLOT)


def _of_kind(pen: Pen, kinds: tuple[type, ...]) -> list[Any]:
    return [joint for joint in pen.sample.mechanism.joints if isinstance(joint, kinds)]


def _held(joint: Any, pen: Pen, angle: float) -> None:
    """Draw the support that holds one coordinate of a point, by what else holds the same body."""
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


@glyph.register
def absolute_distance(joint: AbsoluteDistance, pen: Pen) -> None:
    """A thin link from a fixed point."""
    pen.between(joint.point, joint.marker.position).draw("link", lines.along([0, 1], 0), layer=scene.SLOT)
    fixed = pen.at(joint.point)
    pen.stand(fixed)
    pen.pin(fixed, 0.4)
    pen.pin(pen.on(joint.marker), 0.4)


@glyph.register
def knife_edge(joint: KnifeEdge, pen: Pen) -> None:
    """A thin wheel seen from above."""
    u = pen.unit
    frame = pen.on(joint.marker)
    frame.area("dot", lines.plate(np.array([[-1.2 * u, 0], [1.2 * u, 0]]), 0.28 * u), layer=scene.PIN)
