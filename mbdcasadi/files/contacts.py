"""Contacts of a model file: circles on bodies against the ground, by springs and dampers."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..model.bodies import ground
from ..model.element import Element
from ..model.expressions import fmax, if_else
from ..model.forces.contact.contact import Contact
from ..model.forces.contact.outlines import Circle, HalfPlane
from ..model.forces.friction.laws import FrictionLaw, Resistance
from ..model.immutable import Immutable
from ..model.symbols import StateVariable
from .elements import Part


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


class SpringDamper(Immutable):
    """``F = max(kn δ + cn δ̇, 0)``: a linear spring (kn, N/m) and damper (cn, N s/m) that push only."""

    def __init__(self, stiffness: float, damping: float):
        self.stiffness, self.damping = stiffness, damping

    def __call__(self, penetration: ca.SX, rate: ca.SX) -> ca.SX:
        """Normal force, N, at a penetration (m) and its rate (m/s)."""
        return fmax(self.stiffness * penetration + self.damping * rate, 0)

    def potential(self, penetration: ca.SX) -> Any:
        """Elastic energy, J."""
        return self.stiffness * fmax(penetration, 0) ** 2 / 2

    def __repr__(self) -> str:
        return f"SpringDamper({self.stiffness}, {self.damping})"


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
