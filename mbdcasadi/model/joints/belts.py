"""Linear relations between angles: belts, chains, and couplers of any ratio."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..bodies import Body, ground
from ..element import at_poses
from ..quantities import Limit, known_value, quantity, yes_or_no
from .base import Joint, as_carrier, pair


class Coupler(Joint):
    """Angle of b in a fixed ratio to the angle of a, both measured against a carrier.

    ``Phi = (phi_b - phi_c) - n (phi_a - phi_c) - C0`` (1 row, rad); C0 is what
    the expression has at the estimated poses. It transmits couples alone: what
    is between the shafts (a gearbox, a synchronous drive) leans on the carrier.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        On the two bodies that turn.
    ratio : float or expression in parameters
        n, speed of b to speed of a; negative where the sense is reversed, not zero.
    carrier : Body, default ground
        Body on which both shafts sit, and which takes the rest of the couples.

    Attributes
    ----------
    torque : casadi.SX
        Couple on b, N m; on a it is ``-n`` times that.
    """

    def __init__(self, name: str, a: Any, b: Any, ratio: Any, carrier: Body = ground):
        a, b = pair(name, a, b)
        what = f"joint '{name}'"
        self.ratio = quantity(ratio, what, "ratio", fixed=True)
        if known_value(self.ratio) == 0:
            raise ModelError(f"{what}: the ratio is zero, and b would not turn; hold it with a RelativeAngle")
        self.carrier = as_carrier(carrier, a, b, what)
        self.leans_on_ground = self.carrier.is_ground
        turned = (b.angle - carrier.phi) - self.ratio * (a.angle - carrier.phi)
        super().__init__(name, a, b, turned - at_poses(turned, [a.body, b.body, carrier]))

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on b, N m."""
        return -self.multipliers


class Belt(Joint):
    """Belt or chain over two pulleys, without slip.

    ``Phi = R_a (phi_a - phi_c) - R_b (phi_b - phi_c) - C0`` (1 row, m); + for a
    crossed belt. C0 is what the expression has at the estimated poses. The belt
    transmits couples; what its tension loads the bearings with depends on the
    preload, which is no part of the model: add it as a force where it matters.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Centres of the pulleys on their bodies.
    radius_a, radius_b : float or expression in parameters
        Radii, m.
    crossed : bool, default False
        Whether the belt crosses, so that the pulleys turn against each other.
    carrier : Body, default ground
        Body on which both pulleys are mounted, and which takes the rest of the couples.

    Attributes
    ----------
    tension_difference : casadi.SX
        Difference of the tensions of the two strands, N; positive turns a counter-clockwise.
    """

    def __init__(
        self, name: str, a: Any, b: Any, radius_a: Any, radius_b: Any, crossed: bool = False, carrier: Body = ground
    ):
        a, b = pair(name, a, b)
        what = f"joint '{name}'"
        limits: list[Limit] = []
        self.radius_a = quantity(radius_a, what, "radius_a", above=0.0, limits=limits, fixed=True)
        self.radius_b = quantity(radius_b, what, "radius_b", above=0.0, limits=limits, fixed=True)
        self.limits = tuple(limits)
        self.crossed = yes_or_no(crossed, what, "crossed")
        self.carrier = as_carrier(carrier, a, b, what)
        self.leans_on_ground = self.carrier.is_ground
        sign = 1 if self.crossed else -1
        wound = self.radius_a * (a.angle - carrier.phi) + sign * self.radius_b * (b.angle - carrier.phi)
        super().__init__(name, a, b, wound - at_poses(wound, [a.body, b.body, carrier]))

    @cached_property
    def tension_difference(self) -> ca.SX:
        """Difference of the tensions of the strands, N."""
        return -self.multipliers
