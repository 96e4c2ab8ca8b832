"""Forces on the mass of bodies: weight, and fields spread over a shape."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.tolerances import MET
from ..bodies import Body, Marker, as_body
from ..element import Element, cross
from ..geometry.quadrature import quadrature
from ..quantities import called, function_of, known_value, vector2, whole
from ..symbols import Vector

#: Free-fall acceleration, m/s².
GRAVITY = (0.0, -9.81)


class Gravity(Element):
    """Weight of every body: ``δW = m g · δr``; potential ``-m g · r``.

    Parameters
    ----------
    acceleration : (float, float), default (0, -9.81)
        Free-fall acceleration g, global axes, m/s²; may contain parameters.
    name : str, default "gravity"
        Its name.

    References
    ----------
    Haug 1989, section 6.1.
    """

    kind = "force"
    external = True

    def __init__(self, acceleration: Vector = GRAVITY, name: str = "gravity"):
        super().__init__(name)
        self.acceleration = vector2(acceleration, self.description, "acceleration")

    def acting_on(self, bodies: Sequence[Body]) -> Element:
        return _Weight(self, tuple(bodies))


class _Weight(Element):
    """Weight of the bodies of a mechanism."""

    kind = "force"
    external = True

    def __init__(self, gravity: Gravity, bodies: tuple[Body, ...]):
        super().__init__(gravity.name)
        loaded = [body for body in bodies if isinstance(body.mass, ca.SX) or body.mass != 0]
        self.virtual_work = tuple((body.position, body.mass * gravity.acceleration) for body in loaded)
        self.potential = -sum((ca.dot(force, r) for r, force in self.virtual_work), ca.SX(0))
        self.__dict__["bodies"] = bodies


class FieldForce(Element):
    """Force per unit mass over the shape of a body: ``δW = ∫ f(P) · δr^P dm``.

    The integral is a Gauss quadrature over the shape: exact for fields that
    are polynomials of low degree in the position, and accurate to many digits
    for smooth ones (gravity that varies with height, a turning frame, a magnet).

    Parameters
    ----------
    name : str
        Its name.
    body : Body
        Body with a shape over which its mass is spread evenly (``Body.from_shape``).
    field : callable
        ``field(point)`` returns the force per mass (2,), N/kg, global axes; `point` is a
        :class:`Marker` on the body, with ``.position``, ``.velocity``, ``.x``, ….
    order : int, default 4
        Quadrature points in each direction.

    Attributes
    ----------
    force : casadi.SX
        Resultant (2,), N.
    torque : casadi.SX
        Moment about the centre of mass, N m.

    Raises
    ------
    ModelError
        For a body without a shape, or with another centre of mass or inertia than the shape's.

    References
    ----------
    Haug 1989, section 6.1 (virtual work of forces distributed over a body).

    Examples
    --------
    The gravity gradient on a satellite::

        FieldForce("gravity", rod, lambda point: -MU * point.position / mbd.norm(point) ** 3)
    """

    kind = "force"
    external = True

    def __init__(self, name: str, body: Body, field: Callable[[Marker], Any], order: int = 4):
        super().__init__(name)
        self.body = as_body(body, self.description, "body")
        field = function_of(field, self.description, "field", "a point")
        order = whole(order, self.description, "order", 1, 20)
        if self.body.is_ground or self.body.shape is None:
            raise ModelError(
                f"{self.description}: body '{self.body.name}' has no shape over which its mass is spread; "
                "make it by Body.from_shape"
            )
        self._check_spread(self.body)
        local, weights = quadrature(self.body.shape, order)
        shares = weights / np.sum(weights)
        pairs = []
        for place, share in zip(local + self.body.shape_frame, shares, strict=True):
            point = Marker(self.body, ca.SX(ca.DM(place)), ca.SX(0))
            per_mass = vector2(called(field, self.description, "field", point), self.description, "field")
            pairs.append((point.position, float(share) * self.body.mass * per_mass))
        self.virtual_work = tuple(pairs)
        self.__dict__["bodies"] = (self.body,)
        self.force = sum((force for _, force in pairs), ca.SX(2, 1))
        self.torque = sum((cross(place - self.body.position, force) for place, force in pairs), ca.SX(0))

    def _check_spread(self, body: Body) -> None:
        _, centroid, square = body.shape.mass_properties(mass=1.0)  # type: ignore[union-attr]
        radius = np.sqrt(square)
        apart = np.hypot(*(centroid + body.shape_frame))
        if apart > MET * radius:
            raise ModelError(
                f"{self.description}: the centre of mass of body '{body.name}' is {apart:.4g} m from the centroid of "
                "its shape: its mass is not spread evenly; make it by Body.from_shape"
            )
        mass, inertia = known_value(body.mass), known_value(body.inertia)
        if mass is not None and inertia is not None and abs(inertia - mass * square) > MET * mass * square:
            raise ModelError(
                f"{self.description}: the inertia of body '{body.name}' is {inertia:.6g} kg m², and of its mass spread "
                f"evenly over its shape it would be {mass * square:.6g}; make it by Body.from_shape"
            )
