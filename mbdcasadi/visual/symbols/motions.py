"""Prescribed motions and generalized forces: arrows along what they move."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from ...model.bodies import Marker
from ...model.drivers import Actuator, Driver
from ...model.forces.applied import GeneralizedForce
from ...model.joints.lower_pairs import Revolute
from ...model.rates import time_derivative
from ...results.columns import effort_unit, reaction_body
from ..drawing import lines, scene
from ..drawing.loads import Load
from ..drawing.pen import Pen
from .base import Glyph
from .springs import beside_others, cylinder, ends_of, tension


class DriverGlyph(Glyph, of=Driver):
    """A cylinder if a length is prescribed, else an arrow along the motion; the effort as a force."""

    @property
    def ends(self) -> tuple[Marker, Marker] | None:
        """The two points, if a length is prescribed."""
        return ends_of(self.element)

    def draw(self) -> None:
        """Draw the cylinder, or the arrow in the predominant direction of the motion."""
        driver, ends = self.element, self.ends
        if ends is not None:
            cylinder(self.pen, beside_others(self.pen, driver, *ends), driver.expression, 0.75, "motion")
            return
        speed = time_derivative(driver.value, self.pen.sample.mechanism)
        motion_arrow(self.pen, driver.expression, driver.bodies, sense(self.pen, speed))

    def loads(self) -> list[Load]:
        """Return the effort: at both ends of a length, and at the pin if it is a couple."""
        loads = [replace(load, style="force") for load in super().loads()]
        body, ends = reaction_body(self.element), self.ends
        if loads and ends is not None:
            return tension(*ends, -self.element.effort)
        if loads and body is not None and effort_unit(self.element) == "N m":
            pivot = pivot_of(self.pen, body, self.element.bodies)
            loads = [replace(load, place=pivot) for load in loads]
        return loads

    def tooltip(self) -> dict[str, ca.SX]:
        """Return the length, if one is prescribed, and the effort, if multipliers are known."""
        driver = self.element
        length = {"length, m": driver.expression} if self.ends is not None else {}
        if not self.pen.sample.has_multipliers or driver.multipliers.numel() != 1:
            return length
        return length | {f"effort, {effort_unit(driver)}": driver.effort}


class ActuatorGlyph(DriverGlyph, of=Actuator):
    """A cylinder with its stroke."""

    def tooltip(self) -> dict[str, ca.SX]:
        """Return length and stroke, and the force if multipliers are known."""
        actuator = self.element
        shown = {"length, m": actuator.length, "stroke, m": actuator.stroke}
        return shown | ({"tension, N": actuator.force} if self.pen.sample.has_multipliers else {})


class GeneralizedForceGlyph(Glyph, of=GeneralizedForce):
    """An arrow along the displacement of each pair."""

    def draw(self) -> None:
        """Draw the arrows."""
        for displacement, force in self.element.virtual_work:
            motion_arrow(self.pen, displacement, self.element.bodies, sense(self.pen, ca.sum1(force)))


def sense(pen: Pen, value: Any) -> float:
    """Return 1, or -1 if a scalar is negative on average."""
    return -1.0 if np.mean(pen.over(value)) < 0 else 1.0


def motion_arrow(pen: Pen, expression: Any, bodies: Any, sign: float) -> None:
    """Draw an arrow along what an expression moves first: straight for a position, curved for an angle."""
    moving = [body for body in bodies if not body.is_ground]
    slopes = [ca.jacobian(ca.sum1(ca.vec(ca.SX(expression))), body.q) for body in moving]
    for body, slope in zip(reversed(moving), reversed(slopes), strict=True):
        if slope[:2].nnz():
            _straight(pen, body, sign * slope)
            return
    if moving:
        turning(pen, moving[-1], moving, sign * sense(pen, slopes[-1][2]))


def _straight(pen: Pen, body: Any, slope: Any) -> None:
    u = pen.unit
    frame = pen.along(body.position, slope[:2])
    shaft, head = lines.arrow(3.2 * u, 1.3 * u)
    beside = np.array([0.0, 2.0 * u])
    frame.draw("motion", shaft + beside, layer=scene.ARROW)
    frame.area("motion head", head + beside, layer=scene.ARROW)


def turning(pen: Pen, body: Any, bodies: Any, sign: float) -> None:
    """Draw a curved arrow about the pin that connects the bodies, else about the centre of mass; once at a place."""
    u = pen.unit
    place = pivot_of(pen, body, bodies).position
    if not pen.is_new(pen.first(place), pen.arrows):
        return
    shaft, head = (points * [sign, 1.0] for points in lines.arc_arrow(1.9 * u, 1.1 * u))
    frame = pen.at(place)
    frame.draw("motion", shaft, layer=scene.ARROW)
    frame.area("motion head", head, layer=scene.ARROW)


def pivot_of(pen: Pen, body: Any, bodies: Any) -> Marker:
    """Return the point on a body about which it turns against others: a pin on the ground, if there is one."""
    pins = [j for j in pen.sample.mechanism.joints if isinstance(j, Revolute) and body in j.bodies]
    others = {b for b in bodies if b is not body}

    def rank(joint: Revolute) -> int:
        other = next(b for b in joint.bodies if b is not body)
        return 0 if other in others else 1 if other.is_ground else 2

    pin = min(pins, key=rank, default=None)
    return body.at(0, 0) if pin is None or rank(pin) == 2 else pin.marker_on(body)
