"""A place where two outlines may touch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ...expressions import if_else, norm


@dataclass(frozen=True, eq=False)
class Touch:
    """One place where two outlines may touch.

    Attributes
    ----------
    gap : casadi.SX
        Distance of the surfaces, m; negative where they penetrate.
    normal : casadi.SX
        Unit vector (2,) from the second to the first outline.
    point : casadi.SX
        Where the force acts (2,), m.
    reach : casadi.SX, optional
        Depth beyond which the outlines have no meaning, m: half of that at which their middles meet; None if they
        may penetrate by any depth.
    """

    gap: ca.SX
    normal: ca.SX
    point: ca.SX
    reach: ca.SX | None = None

    def reversed(self) -> Touch:
        """The same with the outlines exchanged."""
        return replace(self, normal=-self.normal)


def between_discs(centre: ca.SX, radius: Any, other: ca.SX, other_radius: Any) -> Touch:
    """Two discs."""
    apart = centre - other
    distance = norm(apart)
    # concentric discs have no normal: any will do, and no division by zero
    together = distance == 0
    normal = if_else(together, ca.DM([0, 1]), apart / if_else(together, 1, distance))
    reach = (ca.SX(radius) + other_radius) / 2
    return Touch(distance - radius - other_radius, normal, other + normal * other_radius, reach)


def share_along(point: ca.SX, first: ca.SX, along: ca.SX) -> ca.SX:
    """Where a point is beside a segment, from its first end along it: 0 at that end and 1 at the other."""
    return ca.dot(point - first, along) / ca.sumsqr(along)


def nearest_point(point: ca.SX, first: ca.SX, second: ca.SX) -> ca.SX:
    """Nearest point of a segment."""
    along = second - first
    share = share_along(point, first, along)
    share = if_else(share > 0, if_else(share < 1, share, 1), 0)
    return first + share * along
