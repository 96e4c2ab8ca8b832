"""Constraints, forces and contacts of a model file: one function builds each type."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..model.bodies import Body, Marker, ground
from ..model.drivers import Driver
from ..model.element import Element, at_poses
from ..model.expressions import if_else
from ..model.forces.applied import Force, Torque
from ..model.forces.contact.contact import Contact
from ..model.forces.contact.outlines import Circle, HalfPlane
from ..model.forces.friction.laws import FrictionLaw, Resistance
from ..model.forces.laws import SpringDamper
from ..model.forces.springs import RSDA, TSDA
from ..model.joints.base import Joint
from ..model.joints.coordinates import AbsoluteAngle, AbsoluteX, AbsoluteY, RelativeAngle, RelativeX, RelativeY
from ..model.joints.gears import RackAndPinion
from ..model.joints.lower_pairs import Distance, PointOnLine, Revolute, Translational
from ..model.quantities import called, function_of, vector2
from ..model.symbols import StateVariable, t
from .fields import Fields

Bodies = Mapping[int, Body]
#: Forces in place of Matlab files, by the names of these: ``function(t, q, v)`` of the body returns (2,), N.
FileForces = Mapping[str, Callable[..., Any]]
_FRAMES = {"GRF": "global", "LRF": "body"}


class Part:
    """Fields of a constraint, force or contact, with the bodies that it refers to."""

    def __init__(self, fields: Fields, name: str, bodies: Bodies, file_forces: FileForces):
        self.fields = fields
        self.name = name
        self.bodies = bodies
        self.file_forces = file_forces

    @property
    def _known_ids(self) -> str:
        return f"known ids are {', '.join(map(str, self.bodies))}"

    def body(self, key: str) -> Body:
        """Body by its id; the ground for 0 or none."""
        identity = self.fields.get(key, None)
        if identity is None or (identity == 0 and not isinstance(identity, bool)):
            return ground
        identity = self.fields.whole(key)
        if identity not in self.bodies:
            raise self.fields.refuse(f"{key} = {identity}, but no body has that id; {self._known_ids} (0: the ground)")
        return self.bodies[identity]

    def moving(self, key: str = "body1") -> Body:
        """Body by its id, not the ground."""
        body = self.body(key)
        if body.is_ground:
            said = f"{key} = {self.fields.get(key)}" if self.fields.has(key) else f"the field '{key}' is missing"
            raise self.fields.refuse(f"{said}, but it acts on a moving body; {self._known_ids}")
        return body

    def marker(self, number: int, angle: float = 0.0) -> Marker:
        """Point ``sP1`` of ``body1``, or ``sP2`` of ``body2``."""
        x, y = self.fields.numbers(f"sP{number}", 2)
        return self.body(f"body{number}").at(x, y, angle)

    def angle_marker(self, number: int) -> Marker:
        """Marker whose angle counts; its point is ignored."""
        x, y = self.fields.numbers(f"sP{number}", 2, (0.0, 0.0))
        return self.body(f"body{number}").at(x, y)


Builder = Callable[[Part], list[Element]]


def _prescribed(kind: Any, count: int) -> Builder:
    """Return the builder of a coordinate of one marker, or between two: a driver if its value depends on time."""

    def build(part: Part) -> list[Element]:
        if count == 1:
            part.moving()
        make = part.angle_marker if kind.coordinate == "angle" else part.marker
        markers = [make(k + 1) for k in range(count)]
        value = part.fields.function()
        if not ca.depends_on(value, t):
            return [kind(part.name, *markers, value)]
        first, *others = (getattr(marker, kind.coordinate) for marker in markers)
        return [Driver(part.name, others[0] - first if others else first, value)]

    return build


def _relative_distance(part: Part) -> list[Element]:
    a, b, value = part.marker(1), part.marker(2), part.fields.function()
    return [Distance(part.name, a, b, value)]


def _revolute(part: Part) -> list[Element]:
    part.fields.no_function()
    return [Revolute(part.name, part.marker(1), part.marker(2))]


def _translational(part: Part) -> list[Element]:
    part.fields.no_function()
    angles = [part.fields.direction(f"vP{k}") for k in (1, 2)]
    first, second = part.body("body1"), part.body("body2")
    apart = second.pose_estimate[2] + angles[1] - first.pose_estimate[2] - angles[0]
    if math.cos(apart) < 0:  # the file asks for parallel directions, and these point opposite ways
        angles[1] += math.pi
    return [Translational(part.name, part.marker(1, angles[0]), part.marker(2, angles[1]))]


def _rack_and_pinion(part: Part) -> list[Element]:
    fields = part.fields
    fields.no_function()
    start, end = (np.array(fields.numbers(key, 2)) for key in ("sP1", "sQ1"))
    along = end - start
    if not np.any(along):
        raise fields.refuse(f"sP1 and sQ1 are both {start.tolist()}; the rack needs a direction")
    rack = part.marker(1, math.atan2(along[1], along[0]))
    pinion, radius = part.marker(2), fields.number("R2", above=0.0)
    rolling: Joint
    if fields.has("theta1") or fields.has("theta2"):
        turn = fields.number("theta1") - fields.number("theta2") + 1.5 * math.pi
        rolling = _RackAndPinion(part.name, rack, pinion, radius, float(np.hypot(*along)) + radius * turn)
    else:
        rolling = RackAndPinion(part.name, rack, pinion, radius)
    return [rolling, PointOnLine(f"{part.name} centre distance", rack, pinion, radius)]


class _RackAndPinion(RackAndPinion):
    """Rack and pinion with the phase that the file states, up to whole turns of the pinion.

    With the marks Q on the rack and theta_1, theta_2 of the file:
    ``x_a · (r^b - r^Q) = R (phi_a + theta_1 - phi_b - theta_2 + 3π/2)``, and so
    ``x_a · d + R (phi_b - phi_a) = phase`` with ``phase = |PQ| + R (theta_1 - theta_2 + 3π/2)``.
    """

    def __init__(self, name: str, rack: Marker, pinion: Marker, radius: float, phase: float):
        a, b = self.pair(name, rack, pinion, ("rack", "pinion"))
        self.radius = radius
        rolled = ca.dot(a.x_axis, b.position - a.position) + radius * (b.body.phi - a.body.phi)
        turn = 2 * math.pi * radius
        phase += turn * round((float(at_poses(rolled)) - phase) / turn)
        Joint.__init__(self, name, a, b, rolled - phase)


def _frame(fields: Fields) -> str:
    frame = fields.text("frame")
    if frame.upper() not in _FRAMES:
        raise fields.refuse(f"frame must be GRF (global) or LRF (local), got '{frame}'")
    return _FRAMES[frame.upper()]


def _point_force(part: Part) -> list[Element]:
    frame = _frame(part.fields)
    part.moving()
    vector = [part.fields.function(key) for key in ("funX", "funY")]
    return [Force(part.name, part.marker(1), vector, frame=frame)]


def _point_force_of_file(part: Part) -> list[Element]:
    """Return a force that is Matlab code in the file, from the function that the user gives for it."""
    fields, body = part.fields, part.moving()
    code = matlab_name(fields)
    if code not in part.file_forces:
        raise fields.refuse(
            f"it is the Matlab code {code}.m, which is never run; give it as a function: "
            f'mbd.read_adm(…, forces={{"{code}": lambda t, q, v: (fx, fy)}})'
        )
    label = f'{fields.description}: forces["{code}"]'
    function = function_of(part.file_forces[code], fields.description, f'forces["{code}"]', "t", "q", "v")
    force = vector2(called(function, label, "its value", t, body.q, body.v), label, "its value")
    return [Force(part.name, part.marker(1), force, _frame(fields))]


def matlab_name(fields: Fields) -> str:
    """Return the name of the Matlab function in ``mfile``, without ``.m``."""
    return fields.text("mfile").removesuffix(".m")


def _torque(part: Part) -> list[Element]:
    return [Torque(part.name, part.moving(), part.fields.function())]


def _spring_law(part: Part) -> dict[str, Any]:
    return {
        "stiffness": part.fields.number("k"),
        "damping": part.fields.number("c"),
        "actuator": part.fields.function(default=0) if part.fields.get("fun", "NONE") != "NONE" else 0.0,
    }


def _rotational_spring(to_ground: bool) -> Builder:
    def build(part: Part) -> list[Element]:
        pair = (ground, part.moving()) if to_ground else (part.body("body1"), part.body("body2"))
        a, b = (body.at(0.0, 0.0) for body in pair)
        return [RSDA(part.name, a, b, free_angle=part.fields.number("theta0"), **_spring_law(part))]

    return build


def _translational_spring(part: Part) -> list[Element]:
    free_length = part.fields.number("l0")
    return [TSDA(part.name, part.marker(1), part.marker(2), free_length=free_length, **_spring_law(part))]


def circle_on_ground(part: Part) -> list[Element]:
    """Return the contact of a circle (centre ``sP1``, radius ``r``) with the ground ``y <= 0``."""
    fields, body = part.fields, part.moving("body")
    law = SpringDamper(fields.number("kn", above=0.0), fields.number("cn", at_least=0.0))
    stiffness, damping = fields.number("kt", at_least=0.0), fields.number("ct", at_least=0.0)
    if stiffness > 0 and damping == 0:
        raise fields.refuse("ct = 0 with kt > 0: the tangential spring relaxes by ct after lift-off; give a small ct")
    friction = TangentialSpring(stiffness, damping) if damping > 0 else None
    circle = Circle(body.at(*fields.numbers("sP1", 2)), fields.number("r", above=0.0))
    return [Contact(part.name, circle, HalfPlane(ground.at(0.0, 0.0)), law, friction)]


class TangentialSpring(FrictionLaw):
    """``F = -(kt u + ct v)``: a spring (kt, N/m) and damper (ct > 0, N s/m) along the surface, without sliding.

    The deflection u is a state: ``u̇ = v`` while the surfaces press on each other; after lift-off the spring relaxes
    against its damper, ``u̇ = -(kt/ct) u``. A file gives no coefficient of friction, and so nothing limits F.
    """

    def __init__(self, stiffness: float, damping: float):
        self.stiffness, self.damping = stiffness, damping

    def resistance(self, name: str, speed: ca.SX, load: ca.SX) -> Resistance:
        """Return the force against the motion while there is a load, with the deflection of the spring."""
        if self.stiffness == 0:
            return Resistance(if_else(load > 0, -self.damping * speed, 0))
        deflection = StateVariable(f"{name}.deflection")
        rate = if_else(load > 0, speed, -self.stiffness / self.damping * deflection)
        force = if_else(load > 0, -self.stiffness * deflection - self.damping * speed, 0)
        return Resistance(force, {deflection: rate})

    def __repr__(self) -> str:
        return f"TangentialSpring({self.stiffness}, {self.damping})"


CONSTRAINTS: dict[str, Builder] = {
    "AbsoluteX": _prescribed(AbsoluteX, 1),
    "AbsoluteY": _prescribed(AbsoluteY, 1),
    "AbsoluteAngle": _prescribed(AbsoluteAngle, 1),
    "RelativeX": _prescribed(RelativeX, 2),
    "RelativeY": _prescribed(RelativeY, 2),
    "RelativeAngle": _prescribed(RelativeAngle, 2),
    "RelativeDistance": _relative_distance,
    "RevoluteJoint": _revolute,
    "TranslationalJoint": _translational,
    "RackPinion": _rack_and_pinion,
}
FORCES: dict[str, Builder] = {
    "PointForce": _point_force,
    "PointForceFile": _point_force_of_file,
    "Torque": _torque,
    "RSDA1": _rotational_spring(to_ground=True),
    "RSDA2": _rotational_spring(to_ground=False),
    "TSDA": _translational_spring,
}
