"""Constraints on single coordinates of one marker, or between two."""

from __future__ import annotations

from typing import Any, ClassVar

from ..bodies import Marker, as_marker
from ..element import ConstraintElement
from ..quantities import in_radians, quantity, vector2
from ..symbols import Scalar, Vector, check_name
from .base import Joint
from .lower_pairs import distance_row


class _Absolute(ConstraintElement):
    """Base class: one coordinate of a marker has a given value."""

    kind = "constraint"
    #: attribute of the marker that is constrained
    coordinate: ClassVar[str]

    def __init__(self, name: str, marker: Marker, value: Scalar = 0.0):
        what = f"constraint '{name}'"
        self.marker = as_marker(marker, what, "marker")
        self.value = _value(value, what, self.coordinate)
        super().__init__(name, getattr(self.marker, self.coordinate) - self.value, (), (self.marker,))


def _value(value: Any, what: str, coordinate: str) -> Any:
    """Return the value of a coordinate; warn of an angle in degrees."""
    value = quantity(value, what, "value")
    if coordinate == "angle":
        in_radians(value, what, "value")
    return value


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

    coordinate = "x"


class AbsoluteY(_Absolute):
    """``Phi = y^P - C`` (1 row, m); parameters as for :class:`AbsoluteX`."""

    coordinate = "y"


class AbsoluteAngle(_Absolute):
    """``Phi = phi - C`` with the angle of the marker's x axis (1 row, rad); as :class:`AbsoluteX`."""

    coordinate = "angle"


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

    def __init__(self, name: str, marker: Marker, point: Vector, distance: Scalar):
        self.name = check_name(name, type(self).__name__)
        self.marker = as_marker(marker, self.description, "marker")
        self.point = vector2(point, self.description, "point")
        self.distance = distance
        row = distance_row(self, self.marker.position - self.point, distance)
        super().__init__(name, row, (), (self.marker,))


class _Relative(Joint):
    """Base class: one coordinate of b less that of a has a given value."""

    #: attribute of the markers that is constrained
    coordinate: ClassVar[str]

    def __init__(self, name: str, a: Marker, b: Marker, value: Scalar):
        a, b = self.pair(name, a, b)
        self.value = _value(value, f"constraint '{name}'", self.coordinate)
        super().__init__(name, a, b, getattr(b, self.coordinate) - getattr(a, self.coordinate) - self.value)


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

    coordinate = "x"
    leans_on_ground = True


class RelativeY(_Relative):
    """``Phi = y^b - y^a - C``, global axes (1 row, m); parameters and couple as for :class:`RelativeX`."""

    coordinate = "y"
    leans_on_ground = True


class RelativeAngle(_Relative):
    """``Phi = phi_b - phi_a - C`` with the markers' angles (1 row, rad); as :class:`RelativeX`."""

    coordinate = "angle"
