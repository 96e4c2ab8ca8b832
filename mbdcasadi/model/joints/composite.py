"""Composite joints: massless links reduced to one row."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..quantities import Limit, known_value, quantity
from .base import AlongLine, Joint, pair


def distance_row(what: str, d: ca.SX, distance: Any) -> tuple[ca.SX, tuple[Limit, ...]]:
    """Row ``(d·d - C²) / (2 C)``: smooth at any pose, in metres, with a multiplier in newtons; and the limits of C."""
    limits: list[Limit] = []
    length = quantity(distance, what, "distance")
    if known_value(length) == 0:
        raise ModelError(f"{what}: the distance is zero, where the constraint is singular; use a Revolute")
    quantity(length, what, "distance", above=0.0, limits=limits)
    return (ca.sumsqr(d) - ca.SX(length) ** 2) / (2 * ca.SX(length)), tuple(limits)


class Distance(Joint):
    """Revolute–revolute composite: a massless rod of a given length between two points.

    ``Phi = (d·d - C²) / (2 C)`` with ``d = r^b - r^a`` (1 row, m). The rod pushes as well as it pulls.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points on two bodies.
    distance : float or expression in time and parameters
        Length C of the rod, m; not zero.

    Attributes
    ----------
    tension : casadi.SX
        Force of the rod, N: positive if it pulls its ends together, negative if it pushes them apart.

    Raises
    ------
    ModelError
        For a zero or negative distance.

    See Also
    --------
    Rope : elastic, and slack instead of pushing.

    References
    ----------
    Haug 1989, sections 3.3 and 3.3.2 (composite joints).
    """

    def __init__(self, name: str, a: Any, b: Any, distance: Any):
        a, b = pair(name, a, b)
        self.distance = distance
        row, self.limits = distance_row(f"joint '{name}'", b.position - a.position, distance)
        super().__init__(name, a, b, row)

    @cached_property
    def tension(self) -> ca.SX:
        """Force with which the rod pulls its ends together, N; negative if it pushes."""
        return self.multipliers


class PointOnLine(AlongLine, Joint):
    """Revolute–translational composite: b's point stays on a line of a, at an offset.

    ``Phi = y_a · d - offset`` with ``d = r^b - r^a`` (1 row, m).

    Parameters
    ----------
    name : str
        Its name.
    a : Marker
        Point and x axis of the line.
    b : Marker
        The point.
    offset : float or expression, default 0
        Distance of the point from the line, towards a's y axis, m.

    References
    ----------
    Haug 1989, section 3.3.2 (composite joints).
    """

    def __init__(self, name: str, a: Any, b: Any, offset: Any = 0.0):
        a, b = pair(name, a, b)
        self.offset = quantity(offset, f"joint '{name}'", "offset")
        row = ca.dot(a.y_axis, b.position - a.position) - self.offset
        super().__init__(name, a, b, row)
