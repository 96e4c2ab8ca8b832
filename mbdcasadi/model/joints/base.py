"""Base classes and checks of joints between two markers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Body, Marker, as_body, markers_on_two
from ..element import ConstraintElement, at_poses
from ..rates import time_derivative
from ..symbols import check_name, values_of


class Joint(ConstraintElement):
    """A constraint between a marker on one body and a marker on another; base class of all joints.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        The markers.
    rows : casadi.SX
        ``Phi`` (k,), m or rad.
    row_labels : tuple of str, optional
        Meaning of each row, for messages.
    velocity_rows : casadi.SX, optional
        Rows at velocity level, m/s or rad/s.

    Attributes
    ----------
    a, b : Marker
        The markers.
    """

    kind = "joint"
    #: pairs of a coordinate along which b slides on a and metres of sliding for its unit; None for what does not slide
    sliding: Any = None

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        rows: ca.SX,
        row_labels: tuple[str, ...] = (),
        velocity_rows: ca.SX | None = None,
    ):
        self.a, self.b = a, b
        super().__init__(name, rows, row_labels, (a, b), velocity_rows)

    def pair(self, name: str, a: Any, b: Any, names: tuple[str, str] = ("a", "b")) -> tuple[Marker, Marker]:
        """Name the joint, and return its two markers; raise an error if they are not markers, or are on one body.

        Parameters
        ----------
        name : str
            Name of the joint.
        a, b : Marker
            The markers.
        names : (str, str), default ("a", "b")
            Names of the arguments by which the user gives them, for messages.
        """
        self.name = check_name(name, type(self).__name__)
        a, b = markers_on_two(a, b, self.description, names)
        self.refuse_beyond_coordinates(ca.vertcat(a.local, a.local_angle, b.local, b.local_angle))
        return a, b


def as_carrier(value: Any, a: Marker, b: Marker, what: str) -> Body:
    """Return the body that carries two shafts; raise an error if it is one of the two that turn."""
    carrier = as_body(value, what, "carrier")
    if not carrier.is_ground and (carrier is a.body or carrier is b.body):
        raise ModelError(
            f"{what}: carrier '{carrier.name}' is one of the two bodies that turn; "
            "name the body that carries both shafts"
        )
    return carrier


def from_estimate(expression: ca.SX) -> ca.SX:
    """Return an expression less its value at the estimated poses and ``t = 0``, which so give its phase."""
    return expression - at_poses(expression)


def relative_angle(a: Marker, b: Marker) -> ca.SX:
    """Return the angle of b relative to a, less the whole turns between the estimated poses.

    Joints constrain angles up to whole turns: a block at 2π on a guide at 0 is aligned,
    and the assembly must not turn it back.
    """
    angle = b.angle - a.angle
    return angle - 2 * np.pi * np.round(float(values_of(at_poses(angle))[0, 0]) / (2 * np.pi))


def sliding_speed(sliding: Any) -> ca.SX:
    """Return the speed at which surfaces slide, m/s, of pairs of a coordinate and metres of sliding for its unit."""
    return ca.SX(sum(ratio * time_derivative(coordinate) for coordinate, ratio in sliding))


class AlongLine:
    """Natural coordinate and its rate, for joints in which b moves along a's x axis."""

    a: Marker
    b: Marker

    @cached_property
    def displacement(self) -> ca.SX:
        """Position of b along a's x axis, m."""
        return ca.dot(self.a.x_axis, self.b.position - self.a.position)

    @cached_property
    def speed(self) -> ca.SX:
        """Rate of :attr:`displacement`, m/s."""
        return time_derivative(self.displacement)

    @property
    def sliding(self) -> Any:
        """The displacement, and 1."""
        return ((self.displacement, 1),)
