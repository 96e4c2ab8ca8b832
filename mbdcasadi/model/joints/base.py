"""What joints between two markers share."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ..bodies import Body, Marker, as_body, markers_on_two
from ..element import ConstraintElement, at_poses
from ..rates import time_derivative
from ..symbols import symbols_of


class Joint(ConstraintElement):
    """A constraint between a marker on a first and a marker on a second body.

    Attributes
    ----------
    a, b : Marker
        The markers.
    """

    kind = "joint"

    def __init__(self, name: str, a: Marker, b: Marker, rows: ca.SX, row_labels: tuple[str, ...] = ()):
        self.a, self.b = a, b
        super().__init__(name, rows, row_labels, (a, b))


def pair(name: str, a: Any, b: Any) -> tuple[Marker, Marker]:
    """Check the two markers of a joint: they must sit on two bodies."""
    return markers_on_two(a, b, f"joint '{name}'")


def as_carrier(value: Any, a: Marker, b: Marker, what: str) -> Body:
    """Check the body that carries two shafts: a third one."""
    carrier = as_body(value, what, "carrier")
    if not carrier.is_ground and (carrier is a.body or carrier is b.body):
        raise ModelError(
            f"{what}: carrier '{carrier.name}' is one of the two bodies that turn; "
            "name the body that carries both shafts"
        )
    return carrier


def relative_angle(a: Marker, b: Marker) -> ca.SX:
    """Angle of b relative to a, less the whole turns that the estimated poses are apart.

    Joints hold angles up to whole turns: a block whose pose says 2π on a guide
    whose pose says 0 is aligned, and must not be turned back by the assembly.
    """
    angle = b.angle - a.angle
    estimate = at_poses(angle, [a.body, b.body])
    turns = 0.0 if symbols_of(estimate) else np.round(float(estimate) / (2 * np.pi))
    return angle - 2 * np.pi * turns


class AlongLine:
    """Natural coordinate, and its rate, of joints in which b moves along a's x axis."""

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
