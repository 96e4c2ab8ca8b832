"""A wheel that rolls without slip."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..element import at_poses
from ..quantities import Limit, quantity
from ..validity import ValidityCondition
from .base import AlongLine, Joint, pair


class Rolling(AlongLine, Joint):
    """Wheel that rolls on a straight track without slip and without leaving it.

    ``Phi = [y_a · d - R, x_a · d + R (phi_b - phi_a) - C0]`` (2 rows, m) with
    ``d = r^b - r^a``, a on the surface and b the wheel: the wheel stays above the track's x axis at the distance
    of its radius, and what it advances is what it unrolls. C0 is what the
    expression has at the estimated poses.

    The contact holds the wheel in both directions; where it would have to pull,
    or rub more than it can, analyses warn or ``friction_force`` tells. On a
    circular track a wheel is a :class:`Gear` whose carrier is an arm between
    the centres; the arm needs no mass.

    Parameters
    ----------
    name : str
        Its name.
    wheel : Marker
        Centre of the wheel.
    surface : Marker
        Point and x axis of the track.
    radius : float or expression in parameters
        Radius R, m.

    References
    ----------
    Haug 1989, section 3.4 (rack and pinion, with the distance held).
    """

    def __init__(self, name: str, wheel: Any, surface: Any, radius: Any):
        a, b = pair(name, surface, wheel)
        limits: list[Limit] = []
        self.radius = quantity(radius, f"joint '{name}'", "radius", above=0.0, limits=limits, fixed=True)
        self.limits = tuple(limits)
        d = b.position - a.position
        rolled = ca.dot(a.x_axis, d) + self.radius * (b.angle - a.angle)
        above = ca.dot(a.y_axis, d) - self.radius
        rows = ca.vertcat(above, rolled - at_poses(rolled, [a.body, b.body]))
        super().__init__(name, a, b, rows, ("contact", "rolling"))
        leaving = "the normal force is negative: the wheel would leave the track, and the joint pulled it"
        self.validity_conditions = (ValidityCondition(self.normal_force, f"{self.description}: {leaving}"),)

    @property
    def normal_force(self) -> ca.SX:
        """Force of the track on the wheel along the track's y axis, N; negative where the track would have to pull."""
        return -self.multipliers[0]

    @property
    def friction_force(self) -> ca.SX:
        """Force of the track on the wheel along the track's x axis, N; it rolls as long as the friction can hold it."""
        return -self.multipliers[1]
