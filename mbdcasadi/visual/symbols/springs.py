"""Springs, dampers, cylinders and bushings."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...model.bodies import Marker, ground
from ...model.drivers import Actuator, Driver
from ...model.expressions import norm
from ...model.forces.cylinders import Cylinder, GasSpring
from ...model.forces.springs import RSDA, TSDA, Bushing
from ..drawing import lines, scene
from ..drawing.loads import Load
from ..drawing.pen import Frame, Pen
from .base import Glyph

#: Points and lengths that differ by less than this, m, in poses of the size 1 m are the same.
SAME = 1e-9


# --- between two points --------------------------------------------------------------------
def _there(value: Any) -> bool:
    return isinstance(value, ca.SX) or value != 0


class SpringDamperGlyph(Glyph, of=TSDA):
    """A zigzag, a damper, or both side by side; a cylinder if there is an actuator alone."""

    readings: ClassVar = {"length, m": "length", "tension, N": "force"}

    def draw(self) -> None:
        """Draw it between its ends."""
        element, u, pen = self.element, self.pen.unit, self.pen
        frame = self.beside_others()
        spring = element.law is not None or _there(element.stiffness)
        damper = _there(element.damping)
        if not (spring or damper):
            cylinder(pen, frame, element.length, 0.75)
        elif spring and damper:
            for side in (0.06, 0.94):
                frame.draw("spring", lines.along([side, side], [-1.0 * u, 1.0 * u]))
            frame.draw("spring", lines.along([0, 0.06], 0), lines.along([0.94, 1], 0))
            frame.draw("spring", _inner(lines.zigzag(0.6 * u, shift=1.0 * u)))
            _damper(pen, frame, -1.0 * u, 0.06)
        elif spring:
            frame.draw("spring", lines.zigzag(0.85 * u))
        else:
            _damper(pen, frame, 0.0, 0.0)

    def beside_others(self) -> Frame:
        """Return the frame from end to end, to the side if several elements connect the same points; with anchors."""
        return beside_others(self.pen, self.element, self.element.a, self.element.b)

    def loads(self) -> list[Load]:
        """Return the force on each end that is not on the ground."""
        return tension(self.element.a, self.element.b, self.element.force)


class CylinderGlyph(SpringDamperGlyph, of=Cylinder):
    """A barrel with a piston rod."""

    thickness = 0.9

    def draw(self) -> None:
        """Draw it between its ends."""
        cylinder(self.pen, self.beside_others(), self.element.length, self.thickness)


class GasSpringGlyph(CylinderGlyph, of=GasSpring):
    """A slender barrel with a piston rod."""

    thickness = 0.6


def tension(a: Marker, b: Marker, force: Any) -> list[Load]:
    """Forces on the ends that are not on the ground, of a tension between two points."""
    span = b.position - a.position
    pull = force * span / norm(span)
    return [Load(marker, load, "force") for marker, load in ((a, pull), (b, -pull)) if not marker.body.is_ground]


def beside_others(pen: Pen, element: Any, a: Marker, b: Marker) -> Frame:
    """Frame from end to end, with anchors; to the side of springs and actuators that connect the same points."""
    anchors(pen, a, b)
    frame = pen.between(a.position, b.position)
    mechanism = pen.sample.mechanism
    pairs = {other: (other.a, other.b) for other in mechanism.forces if isinstance(other, TSDA)}
    pairs |= {other: ends for other in mechanism.drivers if (ends := ends_of(other)) is not None}
    same = [other for other, (c, d) in pairs.items() if pen.at_one_place(a, c) and pen.at_one_place(b, d)]
    height = 2.3 * pen.unit * (same.index(element) - (len(same) - 1) / 2) if element in same else 0.0
    if height:
        for end in (0, 1):
            frame.draw("spring", lines.along([end, end], [0, height]))
        frame.shift = np.array([0.0, height])
    return frame


def ends_of(driver: Driver) -> tuple[Marker, Marker] | None:
    """Two points whose distance a driver prescribes; None if it prescribes something else.

    Of ``E = e²/2`` with ``e = |p_b - p_a|`` the derivative by ``r_b`` is the way between the points, and the second
    one by ``r_b`` and ``phi_b`` the arm of ``p_b`` turned by a right angle. What these points give is compared with
    ``e`` in some poses.
    """
    if isinstance(driver, Actuator):
        return driver.a, driver.b
    bodies = [body for body in reversed(driver.bodies) if not body.is_ground]
    if not 1 <= len(bodies) <= 2:
        return None
    half_square = driver.expression**2 / 2
    *first, body = bodies
    turned = ca.jacobian(ca.gradient(half_square, body.position), body.phi)
    b = body.position + ca.vertcat(turned[1], -turned[0])
    a = b - ca.gradient(half_square, body.position)
    on = [*first, ground][0]
    symbols = ca.symvar(ca.vertcat(driver.expression, *[part.q for part in bodies]))
    local = ca.vertcat(*[_turned_back(point - part.position, part) for point, part in ((a, on), (b, body))])
    function = ca.Function("ends", symbols, [local, driver.expression - ca.norm_2(b - a)])
    poses = np.random.default_rng(1).uniform(0.5, 1.5, (3, len(symbols)))  # of size 1 m, about which nothing is special
    places, errors = zip(*[[x.full().ravel() for x in function(*pose)] for pose in poses], strict=True)
    if not np.isfinite(places).all() or np.ptp(places, axis=0).max() > SAME or np.max(np.abs(errors)) > SAME:
        return None
    return Marker(on, ca.SX(places[0][:2]), ca.SX(0)), Marker(body, ca.SX(places[0][2:]), ca.SX(0))


def _turned_back(vector: ca.SX, body: Any) -> ca.SX:
    c, s = ca.cos(body.phi), ca.sin(body.phi)
    return ca.vertcat(c * vector[0] + s * vector[1], c * vector[1] - s * vector[0])


def _inner(points: np.ndarray) -> np.ndarray:
    """Points of a symbol between the two cross bars that a spring and a damper share."""
    points = points.copy()
    points[:, 1] = 0.06 + 0.88 * points[:, 1]
    return points


def _damper(pen: Pen, frame: Frame, height: float, margin: float) -> None:
    """A cup, open towards b, with a piston in it."""
    u = pen.unit
    h = 0.55 * u
    frame.draw(
        "damper",
        lines.along([margin, 0.34], height),
        lines.along([0.68, 0.34, 0.34, 0.68], np.array([h, h, -h, -h]) + height),
        lines.along([0.52, 0.52], np.array([0.7 * h, -0.7 * h]) + height),
        lines.along([0.52, 1 - margin], height),
    )


def cylinder(pen: Pen, frame: Frame, length: Any, height: float, rod_style: str = "link") -> None:
    """Barrel at a, rod at b: both of one size while the length changes, if the stroke leaves room for that."""
    u = pen.unit
    low, high = pen.span(length)
    barrel, h = 0.62 * low, height * u
    piston = min(max(0.15 * low, high - low), 0.92 * barrel)  # from a at the largest length
    frame.area("barrel", np.column_stack([np.array([0.02 * low, barrel, barrel, 0.02 * low]), np.zeros(4),
                                          np.array([-h, -h, h, h]), np.zeros(4)]))  # fmt: skip
    rod = piston - high if high - low > 1e-9 * high else 0.35 * low - high
    ends = np.array([[rod, 1, 0, 0], [0, 1, 0, 0]])
    frame.draw(rod_style, ends)
    frame.draw(rod_style, np.array([[rod, 1, -0.8 * h, 0], [rod, 1, 0.8 * h, 0]]))


def anchors(pen: Pen, a: Marker, b: Marker) -> None:
    """Points at both ends, on a wall if an end is on the ground and nothing else is drawn there."""
    for marker, other in ((a, b), (b, a)):
        pen.dot(pen.on(marker), 0.3)
        if marker.body.is_ground:
            _wall_behind(pen, marker, other)


def _wall_behind(pen: Pen, marker: Marker, other: Marker) -> None:
    u, frame = pen.unit, pen.on(marker)
    if not pen.is_new(pen.first(marker.position), pen.stands):
        return
    x, y = np.mean(pen.over(other.position - marker.position), axis=0)
    wall = Frame(pen, frame.number, frame.shift, float(np.arctan2(y, x)))
    pen.hatched(wall, (0, 1.7 * u), (0, -1.7 * u))


# --- about a point -----------------------------------------------------------------------------
class TorsionSpringGlyph(Glyph, of=RSDA):
    """A spiral about the pin."""

    readings: ClassVar = {"angle, rad": "angle", "couple, N m": "torque"}

    def draw(self) -> None:
        """Draw the spiral."""
        u = self.pen.unit
        points = lines.spiral(0.8 * u, 2.3 * u, 2.25)
        frame = self.pen.on(self.element.a)
        frame.draw("spring", np.vstack([points, points[-1:] + np.array([[0, -0.8 * u]])]))

    def loads(self) -> list[Load]:
        """Return the couple on one end that is not on the ground."""
        element = self.element
        marker, sign = (element.a, 1) if element.b.body.is_ground else (element.b, -1)
        return [Load(marker, sign * ca.SX(element.torque), "force")]


class BushingGlyph(Glyph, of=Bushing):
    """A ring of rubber about a pin."""

    def draw(self) -> None:
        """Draw the ring."""
        u, pen = self.pen.unit, self.pen
        frame = pen.on(self.element.a)
        frame.area("rubber", lines.circle((0, 0), 1.25 * u), lines.circle((0, 0), 0.5 * u, 32)[::-1], layer=scene.SLOT)
        if self.element.a.body.is_ground:
            pen.stand(frame)
        pen.dot(pen.on(self.element.b))

    def loads(self) -> list[Load]:
        """Return the force on the second body."""
        return [Load(self.element.b, self.element.a.axes @ self.element.force, "force")]
