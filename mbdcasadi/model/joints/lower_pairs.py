"""Revolute, translational and rigid joints, and composite joints in place of a massless link."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import ConstraintElement
from ..quantities import known_value, quantity
from ..rates import time_derivative
from ..symbols import Scalar
from .base import AlongLine, Joint, relative_angle


def _place(marker: Marker) -> ca.SX:
    """Position of a marker, whose negative coordinates are factors that are subtracted.

    Both ends of a bar then share what their rows, the derivatives of these and their reactions repeat.
    """
    body, local = marker.body, ca.vertsplit(marker.local)
    is_negative = [x.is_constant() and float(x) < 0 for x in local]
    if all(is_negative):
        return body.position - body.axes @ -marker.local
    columns = zip(ca.horzsplit(body.axes), local, is_negative, strict=True)
    first, second = (-(axis * -x) if negative else axis * x for axis, x, negative in columns)
    return body.position + (first + second)


class LowerPair(Joint):
    """Base class of pins, slides and welds: the rows of a tree of them are regular in every pose."""


class Revolute(LowerPair):
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

    def __init__(self, name: str, a: Marker, b: Marker):
        a, b = self.pair(name, a, b)
        super().__init__(name, a, b, _place(a) - _place(b), ("x", "y"))

    @cached_property
    def angle(self) -> ca.SX:
        """Angle of b relative to a, rad; whole turns count."""
        return self.b.angle - self.a.angle

    @cached_property
    def angular_velocity(self) -> ca.SX:
        """Rate of :attr:`angle`, rad/s."""
        return time_derivative(self.angle)


class Translational(AlongLine, LowerPair):
    """Sliding joint: b moves along a's x axis and does not turn.

    ``Phi = [y_a · d, phi_b - phi_a - 2πk]`` with ``d = r^b - r^a`` (2 rows, m
    and rad). The second row is linear, so the block cannot flip over as it can
    with the textbook's ``y_a · x_b``; the integer k is that of the
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

    def __init__(self, name: str, a: Marker, b: Marker):
        a, b = self.pair(name, a, b)
        across = ca.dot(a.y_axis, b.position - a.position)
        super().__init__(name, a, b, ca.vertcat(across, relative_angle(a, b)), ("normal", "angle"))


class Weld(LowerPair):
    """Rigid joint: points and axes coincide (3 rows: m, m, rad).

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points with axes on two bodies.
    """

    def __init__(self, name: str, a: Marker, b: Marker):
        a, b = self.pair(name, a, b)
        rows = ca.vertcat(_place(a) - _place(b), relative_angle(a, b))
        super().__init__(name, a, b, rows, ("x", "y", "angle"))


def distance_row(element: ConstraintElement, d: ca.SX, distance: Any) -> ca.SX:
    """Return the row ``(d·d - C²) / (2 C)`` of an element, m with a multiplier in N, smooth at any pose."""
    if known_value(quantity(distance, element.description, "distance")) == 0:
        raise ModelError(
            f"{element.description}: the distance is zero, at which the constraint is singular; use a Revolute"
        )
    length = ca.SX(element.read(distance, "distance", above=0.0))
    return (ca.sumsqr(d) - length**2) / (2 * length)


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

    def __init__(self, name: str, a: Marker, b: Marker, distance: Scalar):
        a, b = self.pair(name, a, b)
        self.distance = distance
        super().__init__(name, a, b, distance_row(self, b.position - a.position, distance))

    @cached_property
    def tension(self) -> ca.SX:
        """Force with which the rod pulls its ends together, N; negative if it pushes."""
        return self.multipliers


class PointOnLine(AlongLine, Joint):
    """Revolute–translational composite: a point of b stays on a line of a, at an offset.

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

    def __init__(self, name: str, a: Marker, b: Marker, offset: Scalar = 0.0):
        a, b = self.pair(name, a, b)
        self.offset = quantity(offset, self.description, "offset")
        row = ca.dot(a.y_axis, b.position - a.position) - self.offset
        super().__init__(name, a, b, row)

    @property
    def normal_force(self) -> ca.SX:
        """Force of the line on the point along a's y axis, N."""
        return -self.multipliers[0]
