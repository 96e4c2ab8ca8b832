"""Wheels on curves: roads, valleys, the tracks of cams."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..expressions import norm
from ..geometry.curves import Curve
from ..quantities import yes_or_no
from ..symbols import Coordinate, Scalar, values_of
from .base import sliding_speed
from .cams import Pressed, as_curve, within_ends
from .outline_contact import nearest_side, wide_enough


class RollingOnCurve(Pressed):
    """Wheel that rolls on a curve without slip and without leaving it.

    ``Phi = r^a + A_a (s'(alpha) + σ R n'(alpha)) - r^b`` (2 rows, m) and
    ``|g'| (1 + σ R κ) dalpha/dt - σ R (omega_b - omega_a) = 0`` (1 row, m/s): the
    centre of the wheel keeps the distance R from the curve along its normal n', to the
    side σ = ±1 on which it is at the estimated poses (+1 to the right of the tangent
    g'), and the point of the wheel at the contact has the velocity of the curve's body;
    κ is the curvature. One coordinate ``alpha`` without inertia.

    The contact holds the wheel in both directions. Analyses warn if it would have to pull;
    the event that ``lift_off()`` returns ends a run there.

    Parameters
    ----------
    name : str
        Its name.
    wheel : Marker
        Centre of the wheel.
    base : Marker
        Frame of the curve.
    curve : Curve
        Open or closed curve, with hollows wider than the wheel. Analyses warn if the wheel leaves the ends of
        an open one.
    radius : float or expression in parameters
        Radius R of the wheel, m.
    slips : bool, default False
        True leaves the row of rolling out: the wheel stays on the curve and slips on it. A :class:`JointFriction` in
        the joint then acts at the contact; with :class:`DryFriction` it rolls without slip as long as friction
        suffices.

    Attributes
    ----------
    parameter : Coordinate
        Parameter of the contact point on the curve.
    contact_point : casadi.SX
        The contact point (2,), global, m.

    Raises
    ------
    ModelError
        For a hollow too narrow for the wheel, and a centre on the curve at the estimated poses, which does not say on
        which side the wheel rolls.

    Examples
    --------
    A disc in a valley::

        valley = mbd.Curve(lambda s: (s, s**2), -1, 1)
        mbd.RollingOnCurve("wheel", disc.at(0, 0), mbd.ground.at(0, 0), valley, radius=0.1)
    """

    part = "wheel"

    def __init__(self, name: str, wheel: Marker, base: Marker, curve: Curve, radius: Scalar, slips: bool = False):
        a, b = self.a, self.b = self.pair(name, base, wheel, ("base", "wheel"))
        what = self.description
        self.curve, self.slips = as_curve(curve, what), yes_or_no(slips, what, "slips")
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        start, self.side = nearest_side(what, curve, a, b, float(values_of(self.radius)[0, 0]))
        self.limits = (*self.limits, *wide_enough(what, curve, self.side * self.radius, "wheel"))
        self.parameter = Coordinate(f"{name}.parameter", start, curve.span)
        self.coordinates = (self.parameter,)
        self.contact_point = a.position + a.axes @ curve.point(self.parameter)
        centre = a.position + a.axes @ curve.beside(self.parameter, self.side * self.radius)
        rolls = None if self.slips else sliding_speed(self.sliding)
        super().__init__(name, a, b, centre - b.position, ("x", "y", "rolling")[: 2 if self.slips else 3], rolls)
        self.validity_conditions += within_ends(what, curve, self.parameter, "wheel")

    @property
    def sliding(self) -> Any:
        """Parameter and angle of the wheel, with the metres by which their units move the wheel along the tangent."""
        rolled = self.side * self.radius
        along = norm(self.curve.tangent(self.parameter)) * (1 + rolled * self.curve.curvature(self.parameter))
        return (self.parameter, along), (self.b.angle - self.a.angle, -rolled)

    @cached_property
    def normal_force(self) -> ca.SX:
        """Force of the curve on the wheel along the normal, N; negative if the curve would have to pull."""
        return self.side * ca.dot(self.multipliers[:2], self.a.axes @ self.curve.normal(self.parameter))

    @cached_property
    def friction_force(self) -> ca.SX:
        """Force of the curve on the wheel along the tangent, N; it must not exceed the available friction."""
        tangent = self.curve.tangent(self.parameter)
        return ca.dot(self.multipliers[:2], self.a.axes @ (tangent / norm(tangent)))
