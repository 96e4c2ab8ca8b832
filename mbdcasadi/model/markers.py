"""Points with axes on bodies."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING, Any

import casadi as ca

from .immutable import HoldsSymbols, Immutable
from .rates import time_derivative

if TYPE_CHECKING:
    from .bodies import Body


def rotation(angle: Any) -> ca.SX:
    """Rotation matrix ``A(angle)`` (2, 2) from a rotated frame to the frame it is measured in."""
    c, s = ca.cos(ca.SX(angle)), ca.sin(ca.SX(angle))
    return ca.vertcat(ca.horzcat(c, -s), ca.horzcat(s, c))


class Marker(Immutable, HoldsSymbols):
    """A point with axes, fixed in the frame of a body.

    Made by :meth:`Body.at`. All attributes are expressions in the global frame.

    Attributes
    ----------
    body : Body
        The body that carries it.
    local : casadi.SX
        ``s'`` (2,), coordinates in the centroidal frame of the body, m.
    local_angle : casadi.SX
        Angle of its x axis in the body frame, rad.
    """

    def __init__(self, body: Body, local: ca.SX, local_angle: ca.SX):
        self.body = body
        self.local = local
        self.local_angle = local_angle

    @cached_property
    def position(self) -> ca.SX:
        """``r^P = r + A s'`` (2,), m."""
        return self.body.position + rotation(self.body.phi) @ self.local

    @cached_property
    def velocity(self) -> ca.SX:
        """Velocity (2,), m/s."""
        return time_derivative(self.position)

    @cached_property
    def acceleration(self) -> ca.SX:
        """Acceleration (2,), m/s²."""
        return time_derivative(self.velocity)

    @property
    def x(self) -> ca.SX:
        """First coordinate, m."""
        return self.position[0]

    @property
    def y(self) -> ca.SX:
        """Second coordinate, m."""
        return self.position[1]

    @property
    def vx(self) -> ca.SX:
        """First component of the velocity, m/s."""
        return self.velocity[0]

    @property
    def vy(self) -> ca.SX:
        """Second component of the velocity, m/s."""
        return self.velocity[1]

    @property
    def ax(self) -> ca.SX:
        """First component of the acceleration, m/s²."""
        return self.acceleration[0]

    @property
    def ay(self) -> ca.SX:
        """Second component of the acceleration, m/s²."""
        return self.acceleration[1]

    @property
    def angle(self) -> ca.SX:
        """Angle of the marker's x axis, rad."""
        return self.body.phi + self.local_angle

    @cached_property
    def angular_velocity(self) -> ca.SX:
        """Rate of :attr:`angle`, rad/s."""
        return time_derivative(self.angle)

    @cached_property
    def axes(self) -> ca.SX:
        """Matrix (2, 2) whose columns are the marker's axes."""
        return rotation(self.angle)

    @property
    def x_axis(self) -> ca.SX:
        """Unit vector (2,) along the marker's x axis."""
        return self.axes[:, 0]

    @property
    def y_axis(self) -> ca.SX:
        """Unit vector (2,) along the marker's y axis."""
        return self.axes[:, 1]

    def __repr__(self) -> str:
        return f"Marker({self.body.name!r}, {self.local[0]}, {self.local[1]}, angle={self.local_angle})"
