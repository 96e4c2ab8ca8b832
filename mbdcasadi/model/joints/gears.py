"""Joints that roll: toothed elements (gears, belts and rolling contact come beside them here)."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from ..elements import at_poses
from ..quantities import Limit, quantity
from .base import Joint, pair


class RackAndPinion(Joint):
    """Pinion that rolls on a rack without slip.

    ``Phi = x_a · d + R (phi_b - phi_a) - C0`` (1 row, m) with ``d = r^b - r^a``;
    C0 is what the expression has at the estimated poses. The pinion sits above
    the rack's x axis: a counter-clockwise turn of a fixed pinion moves the rack
    towards +x. The distance of the pinion from the rack is held by other joints.

    Parameters
    ----------
    name : str
        Its name.
    rack : Marker
        Point and x axis of the pitch line.
    pinion : Marker
        Centre of the pinion.
    radius : float or expression in parameters
        Pitch radius R, m.

    References
    ----------
    Haug 1989, section 3.4, eq. (3.4.10).
    """

    def __init__(self, name: str, rack: Any, pinion: Any, radius: Any):
        a, b = pair(name, rack, pinion)
        limits: list[Limit] = []
        self.radius = quantity(radius, f"joint '{name}'", "radius", above=0.0, limits=limits)
        self.limits = tuple(limits)
        rolled = ca.dot(a.x_axis, b.position - a.position) + self.radius * (b.angle - a.angle)
        super().__init__(name, a, b, rolled - at_poses(rolled, [a.body, b.body]))

    @cached_property
    def tooth_force(self) -> ca.SX:
        """Force of the pinion on the rack along the rack's x axis, N."""
        return ca.dot(self.reaction_on(self.a.body).force, self.a.x_axis)
