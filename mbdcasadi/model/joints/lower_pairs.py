"""Revolute, translational and rigid joints."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from ..rates import time_derivative
from .base import AlongLine, Joint, pair, relative_angle


class Revolute(Joint):
    """Pin joint: two points coincide.

    ``Phi = r_a + A_a s'_a - r_b - A_b s'_b`` (2 rows, m).

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points on two bodies.

    References
    ----------
    Haug 1989, section 3.3, eq. (3.3.10).
    """

    is_lower_pair = True

    def __init__(self, name: str, a: Any, b: Any):
        a, b = pair(name, a, b)
        super().__init__(name, a, b, a.position - b.position, ("x", "y"))

    @cached_property
    def angle(self) -> ca.SX:
        """Angle of b relative to a, rad; whole turns count."""
        return self.b.angle - self.a.angle

    @cached_property
    def angular_velocity(self) -> ca.SX:
        """Rate of :attr:`angle`, rad/s."""
        return time_derivative(self.angle)


class Translational(AlongLine, Joint):
    """Sliding joint: b moves along a's x axis and does not turn.

    ``Phi = [y_a · d, phi_b - phi_a - 2πk]`` with ``d = r^b - r^a`` (2 rows, m
    and rad). The second row is linear, so the block cannot flip over as it can
    with the textbook's ``y_a · x_b``; the whole number k is the one at the
    estimated poses.

    Parameters
    ----------
    name : str
        Its name.
    a : Marker
        Point and x axis of the guide.
    b : Marker
        Point and x axis of the block; the axes align.

    References
    ----------
    Haug 1989, section 3.3, eq. (3.3.13).
    """

    is_lower_pair = True

    def __init__(self, name: str, a: Any, b: Any):
        a, b = pair(name, a, b)
        across = ca.dot(a.y_axis, b.position - a.position)
        super().__init__(name, a, b, ca.vertcat(across, relative_angle(a, b)), ("normal", "angle"))


class Weld(Joint):
    """Rigid joint: points and axes coincide (3 rows: m, m, rad).

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points with axes on two bodies.
    """

    is_lower_pair = True

    def __init__(self, name: str, a: Any, b: Any):
        a, b = pair(name, a, b)
        rows = ca.vertcat(a.position - b.position, relative_angle(a, b))
        super().__init__(name, a, b, rows, ("x", "y", "angle"))
