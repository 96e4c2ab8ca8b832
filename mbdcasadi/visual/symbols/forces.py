"""Applied forces and couples, and weights."""

from __future__ import annotations

from typing import ClassVar

import casadi as ca
import numpy as np

from ...model.forces.applied import Force, Torque
from ...model.forces.field import FieldForce, Gravity
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.forces.mass_flow import MassFlow
from ...model.forces.motors import DCMotor
from ...model.joints.lower_pairs import Revolute, Translational
from ..drawing import lines, scene
from ..drawing.loads import Load
from .base import Glyph, Hidden
from .lower_pairs import rubbing_edge
from .motions import pivot_of


class ForceGlyph(Glyph, of=(Force, MassFlow)):
    """A point where the force acts; the arrow, which is to scale, comes with the loads."""

    def draw(self) -> None:
        """Draw the point."""
        self.pen.dot(self.pen.on(self.element.markers[0]))

    def loads(self) -> list[Load]:
        """Return the force, which is drawn in any case."""
        return [Load(self.element.markers[0], self.element.force, "force", always=True)]

    def tooltip(self) -> dict[str, ca.SX]:
        """Return its components."""
        return {"force, x, N": self.element.force[0], "force, y, N": self.element.force[1]}


class TorqueGlyph(Glyph, of=(Torque, DCMotor)):
    """A ring about the pin that the couple turns; the arrow, which is to scale, comes with the loads."""

    readings: ClassVar = {"torque, N m": "torque"}

    def draw(self) -> None:
        """Draw the ring."""
        pivot = pivot_of(self.pen, self.element.body, self.element.bodies)
        if self.pen.is_new(self.pen.first(pivot.position), self.pen.arrows):
            self.pen.on(pivot).area("drive", lines.circle((0, 0), 1.1 * self.pen.unit), layer=scene.SLOT)

    def loads(self) -> list[Load]:
        """Return the couple, which is drawn in any case."""
        pivot = pivot_of(self.pen, self.element.body, self.element.bodies)
        return [Load(pivot, ca.SX(self.element.torque), "motion", always=True)]


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


class FrictionGlyph(Glyph, of=FrictionInJoint):
    """A brake shoe at the pin, or between the block and its guide."""

    def draw(self) -> None:
        """Draw the shoe."""
        pen, joint, u = self.pen, self.element.joint, self.pen.unit
        if not isinstance(joint, Translational):
            frame = pen.on(joint.b if joint.a.body.is_ground or not isinstance(joint, Revolute) else joint.a)
            inner, outer = (lines.arc(r * u, np.pi / 5, 0.6 * np.pi) for r in (0.7, 1.3))
            frame.area("rubber", np.vstack([outer, inner[::-1]]), layer=scene.PIN)
        else:
            frame = pen.on(joint.b if joint.a.body.is_ground else joint.a)
            edge = rubbing_edge(pen, joint)
            frame.area("rubber", lines.rectangle((-1.3 * u, edge), (1.3 * u, edge + 0.6 * u)), layer=scene.PIN)

    def loads(self) -> list[Load]:
        """Return no arrow: the load is in the tooltip."""
        return []

    def tooltip(self) -> dict[str, ca.SX]:
        """Return friction along the sliding, unless it is a multiplier that is not known."""
        if self.element.law.exact and not self.pen.sample.has_multipliers:
            return {}
        turns = isinstance(self.element.joint, Revolute)
        return {"friction, N m": self.element.torque} if turns else {"friction, N": self.element.force}
