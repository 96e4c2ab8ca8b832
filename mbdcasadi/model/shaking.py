"""Force and moment of a mechanism on its foundation."""

from __future__ import annotations

import casadi as ca

from ..errors import ModelError
from .element import applied_load, constraint_load, cross
from .mechanism import Mechanism
from .quantities import vector2
from .symbols import Vector


class ShakingForce:
    """Force and moment of a whole mechanism on the ground, as expressions.

    The sum of what joints, drivers and forces exert on the ground, the reactions of applied forces and couples
    that name no other body included. Weight and field forces come from outside: the ground does not take their
    reaction, but carries them through the joints. With the gravity g the sum is, by Newton's law of all bodies,
    ``Σ m (g - a)``, and about the point P ``Σ (r - r_P) × m (g - a) - J' α``.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    point : (float, float), default (0, 0)
        Point about which the moment is taken, m.

    Attributes
    ----------
    force : casadi.SX
        (2,), global axes, N.
    moment : casadi.SX
        About the point, N m.
    """

    def __init__(self, mechanism: Mechanism, point: Vector = (0.0, 0.0)):
        if not isinstance(mechanism, Mechanism):
            raise ModelError(f"shaking_force takes a Mechanism, got {mechanism!r}")
        self.mechanism, self.point = mechanism, vector2(point, "shaking_force", "point")
        load, self.force, self.moment = _internal_load(mechanism), ca.SX(2, 1), ca.SX(0)
        for k, body in enumerate(mechanism.bodies):
            on_body = load[3 * k : 3 * k + 3]
            self.force -= on_body[:2]
            self.moment -= on_body[2] + cross(body.position - self.point, on_body[:2])


def shaking_force(mechanism: Mechanism, point: Vector = (0.0, 0.0)) -> ShakingForce:
    """Return the force and moment of a mechanism on the ground.

    Parameters
    ----------
    mechanism : Mechanism
        The mechanism.
    point : (float, float), default (0, 0)
        Point about which the moment is taken, m.

    Returns
    -------
    ShakingForce
        ``.force`` and ``.moment`` as expressions.
    """
    return ShakingForce(mechanism, point)


def _internal_load(mechanism: Mechanism) -> ca.SX:
    """Generalised force on the moving bodies of every element whose reaction the ground takes."""
    q = ca.vertcat(*[body.q for body in mechanism.bodies])
    v = ca.vertcat(*[body.v for body in mechanism.bodies])
    load = ca.SX(q.numel(), 1)
    for element in mechanism.elements:
        if getattr(element, "external", False):
            continue
        load += constraint_load(element, element.multipliers, q, v) + applied_load(element, q)
    return load
