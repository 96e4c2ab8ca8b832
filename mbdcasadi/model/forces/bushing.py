"""Compliant joints."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..bodies import markers_on_two
from ..element import Element
from ..quantities import Limit, quantity
from ..rates import time_derivative


class Bushing(Element):
    """Elastic and damped connection of two markers: a rubber bearing, a compliant joint.

    With ``delta`` the position of b in the axes of a, and ``theta`` its angle
    against a: ``F = -(k delta + c deltȧ)`` on b in the axes of a, and the couple
    ``T = -(k_t theta + c_t thetȧ)``. ``δW = F · δdelta + T δtheta``, so that a gets
    what balances it, the moment of the force included.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        On two bodies; the stiffness goes along the axes of a.
    stiffness, damping : float, expression or pair of them, default 0
        By axis of a, or the same for both, N/m and N s/m.
    angular_stiffness, angular_damping : float or expression, default 0
        N m/rad and N m s/rad.

    Attributes
    ----------
    displacement, angle : casadi.SX
        ``delta`` (2,), m, and theta, rad, whole turns included.
    force : casadi.SX
        On b (2,), in the axes of a, N.
    torque : casadi.SX
        On b, N m.
    """

    kind = "bushing"

    def __init__(
        self,
        name: str,
        a: Any,
        b: Any,
        stiffness: Any = 0.0,
        damping: Any = 0.0,
        angular_stiffness: Any = 0.0,
        angular_damping: Any = 0.0,
    ):
        super().__init__(name)
        self.markers = self.a, self.b = markers_on_two(a, b, self.description)
        limits: list[Limit] = []

        def by_axis(value: Any, quantity_name: str) -> ca.SX:
            parts = list(value) if isinstance(value, list | tuple) else [value, value]
            if len(parts) != 2:
                raise ModelError(f"{self.description}: {quantity_name} takes one value or one by axis, got {value!r}")
            return ca.vertcat(
                *[
                    ca.SX(quantity(part, self.description, f"{quantity_name} {axis}", at_least=0.0, limits=limits))
                    for part, axis in zip(parts, "xy", strict=True)
                ]
            )

        self.stiffness, self.damping = by_axis(stiffness, "stiffness"), by_axis(damping, "damping")
        self.angular_stiffness = quantity(
            angular_stiffness, self.description, "angular_stiffness", at_least=0.0, limits=limits
        )
        self.angular_damping = quantity(
            angular_damping, self.description, "angular_damping", at_least=0.0, limits=limits
        )
        self.limits = tuple(limits)
        self.displacement = self.a.axes.T @ (self.b.position - self.a.position)
        self.angle = self.b.angle - self.a.angle
        self.virtual_work = ((self.displacement, self.force), (self.angle, self.torque))

    @cached_property
    def force(self) -> ca.SX:
        """Force on b in the axes of a (2,), N."""
        return -(self.stiffness * self.displacement + self.damping * time_derivative(self.displacement))

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on b, N m."""
        return -(self.angular_stiffness * self.angle + self.angular_damping * time_derivative(self.angle))

    @cached_property
    def potential(self) -> ca.SX:
        """Energy stored, J."""
        return 0.5 * (ca.dot(self.stiffness, self.displacement**2) + self.angular_stiffness * self.angle**2)
