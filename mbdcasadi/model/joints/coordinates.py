"""Constraints on single coordinates of one marker, or between two."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..bodies import as_marker
from ..element import ConstraintElement
from ..quantities import in_radians, quantity, vector2
from .base import Joint
from .lower_pairs import distance_row


class _Absolute(ConstraintElement):
    """Base class: one coordinate of a marker has a given value."""

    kind = "constraint"
    _is_angle = False

    def __init__(self, name: str, marker: Any, value: Any = 0.0):
        what = f"constraint '{name}'"
        self.marker = as_marker(marker, what, "marker")
        self.value = quantity(value, what, "value")
        if self._is_angle:
            in_radians(self.value, what, "value")
        super().__init__(name, self._coordinate() - self.value, (), (self.marker,))

    def _coordinate(self) -> ca.SX:
        raise NotImplementedError


class AbsoluteX(_Absolute):
    """``Phi = x^P - C`` (1 row, m).

    Parameters
    ----------
    name : str
        Its name.
    marker : Marker
        The point P.
    value : float or expression in time and parameters, default 0
        C, m.

    References
    ----------
    Haug 1989, section 3.2.
    """

    def _coordinate(self) -> ca.SX:
        return self.marker.x


class AbsoluteY(_Absolute):
    """``Phi = y^P - C`` (1 row, m); parameters as for :class:`AbsoluteX`."""

    def _coordinate(self) -> ca.SX:
        return self.marker.y


class AbsoluteAngle(_Absolute):
    """``Phi = phi - C`` with the angle of the marker's x axis (1 row, rad); as :class:`AbsoluteX`."""

    _is_angle = True

    def _coordinate(self) -> ca.SX:
        return self.marker.angle


class AbsoluteDistance(ConstraintElement):
    """Distance of a marker from a fixed point: ``Phi = (d·d - C²) / (2 C)`` (1 row, m).

    Parameters
    ----------
    name : str
        Its name.
    marker : Marker
        Point P on a body; ``d = r^P - c``.
    point : (float, float)
        Fixed point c in the global frame, m.
    distance : float or expression in time and parameters
        C, m; not zero.

    References
    ----------
    Haug 1989, section 3.2.
    """

    kind = "constraint"

    def __init__(self, name: str, marker: Any, point: Any, distance: Any):
        what = f"constraint '{name}'"
        self.marker = as_marker(marker, what, "marker")
        self.point = vector2(point, what, "point")
        self.distance = distance
        row, self.limits = distance_row(what, self.marker.position - self.point, distance)
        super().__init__(name, row, (), (self.marker,))


class _Relative(Joint):
    """Base class: one coordinate of b less that of a has a given value."""

    _is_angle = False

    def __init__(self, name: str, a: Any, b: Any, value: Any):
        a, b = self.pair(name, a, b)
        what = f"constraint '{name}'"
        self.value = quantity(value, what, "value")
        if self._is_angle:
            in_radians(self.value, what, "value")
        super().__init__(name, a, b, self._coordinate(b) - self._coordinate(a) - self.value)

    @staticmethod
    def _coordinate(marker: Any) -> ca.SX:
        raise NotImplementedError


class RelativeX(_Relative):
    """``Phi = x^b - x^a - C``, global axes (1 row, m).

    The forces on the points are opposite and along the global x axis, not along the line
    that joins the points. The ground, whose axis defines the direction, takes the remaining couple.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points on two bodies.
    value : float or expression in time and parameters
        C, m.

    References
    ----------
    Haug 1989, section 3.3.
    """

    leans_on_ground = True

    @staticmethod
    def _coordinate(marker: Any) -> ca.SX:
        return marker.x


class RelativeY(_Relative):
    """``Phi = y^b - y^a - C``, global axes (1 row, m); parameters and couple as for :class:`RelativeX`."""

    leans_on_ground = True

    @staticmethod
    def _coordinate(marker: Any) -> ca.SX:
        return marker.y


class RelativeAngle(_Relative):
    """``Phi = phi_b - phi_a - C`` with the markers' angles (1 row, rad); as :class:`RelativeX`."""

    _is_angle = True

    @staticmethod
    def _coordinate(marker: Any) -> ca.SX:
        return marker.angle
