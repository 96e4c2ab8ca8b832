"""One place at which two outlines may touch: its motion, and the work of forces there."""

from __future__ import annotations

import casadi as ca

from ....errors import ModelError
from ....numerics.lazy import cached_property
from ...bodies import Marker
from ...element import BEYOND_COORDINATES, refuse_kinds, work_at
from ...rates import time_derivative
from .outlines import Outline
from .touching import Touch


class Place:
    """One place of contact of two outlines.

    Attributes
    ----------
    touch : Touch
        Gap, normal and point.
    tangent : casadi.SX
        The normal, turned clockwise by a right angle (2,).
    """

    def __init__(self, touch: Touch, a: Outline, b: Outline):
        self.touch, self._a, self._b = touch, a.marker, b.marker
        self.tangent = ca.vertcat(touch.normal[1], -touch.normal[0])

    @property
    def held(self) -> ca.SX:
        """Distance that stays zero while the place is closed, m."""
        return self.touch.gap if self.touch.height is None else self.touch.height

    @cached_property
    def _relative(self) -> ca.SX:
        return _speed_at(self._a, self.touch.point) - _speed_at(self._b, self.touch.point)

    @cached_property
    def normal_speed(self) -> ca.SX:
        """Speed at which the surfaces part, m/s."""
        return ca.dot(self.touch.normal, self._relative)

    @cached_property
    def sliding_speed(self) -> ca.SX:
        """Speed of a's surface relative to b's along the tangent, m/s."""
        return ca.dot(self.tangent, self._relative)

    def force(self, normal: ca.SX, along: ca.SX) -> ca.SX:
        """Force (2,) on a, N, from its parts along the normal and the tangent."""
        return normal * self.touch.normal + along * self.tangent

    def work_of(self, force: ca.SX) -> tuple[tuple[ca.SX, ca.SX], ...]:
        """Virtual work of a force (2,) on a, and its opposite on b."""
        return tuple(
            pair
            for marker, load in ((self._a, force), (self._b, -force))
            for pair in work_at(marker.body, self.touch.point, load)
        )


def check_outlines(a: Outline, b: Outline, what: str) -> None:
    """Raise an error for anything but two outlines on two bodies, which move over these with time alone."""
    for outline in (a, b):
        if not isinstance(outline, Outline):
            raise ModelError(f"{what}: takes outlines such as Circle(marker, radius), got {outline!r}")
        refuse_kinds(
            ca.vertcat(outline.marker.local, outline.marker.local_angle),
            ("position", *BEYOND_COORDINATES),
            f"{what}: the place of {outline.description}",
            "an outline moves over its body with time alone, since nothing else would feel the contact; put it on "
            "a body of its own, which may be massless",
        )
    if a.marker.body is b.marker.body:
        raise ModelError(f"{what}: both outlines are on body '{a.marker.body.name}'; they must be on two bodies")


def _speed_at(marker: Marker, point: ca.SX) -> ca.SX:
    """Return the velocity of the outline at a place (2,), m/s: it moves with its marker, on the body or over it."""
    body = marker.body
    over = body.axes @ time_derivative(marker.local) + _turning(
        marker.position, time_derivative(marker.local_angle), point
    )
    return over if body.is_ground else body.velocity + _turning(body.position, body.omega, point) + over


def _turning(centre: ca.SX, rate: ca.SX, point: ca.SX) -> ca.SX:
    arm = point - centre
    return rate * ca.vertcat(-arm[1], arm[0])
