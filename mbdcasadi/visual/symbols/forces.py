"""Applied forces and couples, and weights."""

from __future__ import annotations

import casadi as ca

from ...model.forces.applied import Force, Torque
from ...model.forces.field import FieldForce, Gravity
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.forces.motors import DCMotor
from ..drawing.loads import Load
from .base import Glyph, Hidden
from .motions import pivot_of, sense, turning


class ForceGlyph(Glyph, of=Force):
    """A point where the force acts; the arrow, which is to scale, comes with the loads."""

    def draw(self) -> None:
        """Draw the point."""
        self.pen.dot(self.pen.on(self.element.at))

    def loads(self) -> list[Load]:
        """Return the force, which is drawn in any case."""
        return [Load(self.element.at, self.element.force, "force", always=True)]

    def tooltip(self) -> dict[str, ca.SX]:
        """Return its components."""
        return {"force, x, N": self.element.force[0], "force, y, N": self.element.force[1]}


class TorqueGlyph(Glyph, of=(Torque, DCMotor)):
    """A curved arrow about the pin that the couple turns."""

    def draw(self) -> None:
        """Draw the arrow."""
        turning(self.pen, self.element.body, self.element.bodies, sense(self.pen, self.element.torque))

    def loads(self) -> list[Load]:
        """Return the couple."""
        pivot = pivot_of(self.pen, self.element.body, self.element.bodies)
        return [Load(pivot, ca.SX(self.element.torque), "force")]

    def tooltip(self) -> dict[str, ca.SX]:
        """Return the couple."""
        return {"torque, N m": ca.SX(self.element.torque)}


class FieldForceGlyph(Hidden, of=FieldForce):
    """Arrow of a force at the centre of mass, with the loads alone."""

    def loads(self) -> list[Load]:
        """Return the resultant."""
        return [Load(self.element.body.at(0, 0), self.element.force, "force")]


class GravityGlyph(Hidden, of=Gravity):
    """Arrows of the weights, with the loads alone."""

    def loads(self) -> list[Load]:
        """Return the weight of each body."""
        g, bodies = self.element.acceleration, self.pen.sample.mechanism.bodies
        return [Load(body.at(0, 0), ca.SX(body.mass) * g, "weight") for body in bodies]


class FrictionGlyph(Hidden, of=FrictionInJoint):
    """Friction in a joint, which is drawn itself."""
