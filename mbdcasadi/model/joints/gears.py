"""Transmissions: gears on any carrier, rack and pinion, rolling wheels, belts and couplers."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Body, Marker, ground, rotation
from ..element import at_poses
from ..quantities import known_value, quantity, yes_or_no
from ..rates import time_derivative
from ..symbols import Scalar, values_of
from ..validity import ValidityCondition
from .base import AlongLine, Joint, as_carrier, from_estimate

#: Relative tolerance of the centre distance against that of the pitch radii, in an assembled pose.
_CENTRES = 1e-3


class Gear(Joint):
    """Two gears in mesh, with their centres on the ground or on a moving carrier.

    ``Phi = R_a (phi_a - psi) ± R_b (phi_b - psi) - C0`` (1 row, m): the arcs
    that roll on each other, relative to the line of centres at the angle
    ``psi``; + for an external, - for an internal pair. Its virtual work is
    that of a force at the pitch point, which loads the bearings.
    The row is linear in the angles of the gears; ``psi`` is measured relative to
    the carrier, on which it is constant, and so has no branch cut after many
    turns. C0 is the value of the expression at the estimated poses, which set the
    phase when the gear is made.

    Other joints must hold the centres at the distance given by the radii.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Centres of the gears on their bodies; either body may be the ground (a fixed ring or sun).
    radius_a, radius_b : float or expression in parameters
        Pitch radii, m, both positive.
    internal : bool, default False
        True if the smaller gear runs inside the larger one, a ring.
    carrier : Body, default ground
        Body that carries both centres: an arm, in a planetary train.

    Raises
    ------
    ModelError
        For radii that are not positive, an internal pair of equal radii, and centres that
        coincide at the estimated poses.

    Notes
    -----
    Haug's row ``n(theta)·d = 0`` has the same Jacobian and ``gamma`` on the
    constraint, and a second, wrong root with the line of centres reversed.

    References
    ----------
    Haug 1989, section 3.4 (gear sets).

    Examples
    --------
    A planet between a fixed sun and an arm::

        Gear("mesh", mbd.ground.at(0, 0), planet.at(0, 0), 0.04, 0.02, carrier=arm)
    """

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        radius_a: Scalar,
        radius_b: Scalar,
        internal: bool = False,
        carrier: Body = ground,
    ):
        a, b = self.pair(name, a, b)
        what = self.description
        self.radius_a = self.read(radius_a, "radius_a", above=0.0, fixed=True)
        self.radius_b = self.read(radius_b, "radius_b", above=0.0, fixed=True)
        self.internal = yes_or_no(internal, what, "internal")
        self.carrier = as_carrier(carrier, a, b, what)
        sign = -1 if self.internal else 1
        distance = ca.fabs(ca.SX(self.radius_a) + sign * self.radius_b)
        if known_value(distance) == 0:
            raise ModelError(f"{what}: an internal pair needs two different radii, a gear and a larger ring")
        along = _line_of_centres(what, a, b, carrier)
        beyond = ca.atan2(along[1], along[0])
        rolled = self.radius_a * (a.angle - carrier.phi - beyond)
        rolled += sign * self.radius_b * (b.angle - carrier.phi - beyond)
        super().__init__(name, a, b, from_estimate(rolled))
        off = ca.norm_2(along) - distance
        apart = (
            f"{what}: the centres are not at the distance given by the pitch radii (the sum of both, for an internal "
            "pair the difference)"
        )
        turning = (
            f"{what}: the line of centres turns relative to carrier '{carrier.name}'; name the body that carries both "
            "centres as carrier="
        )
        self.validity_conditions = (
            ValidityCondition(_CENTRES - ca.fabs(off / distance), apart, shown=off, unit="m"),
            ValidityCondition(along[0] / distance, turning, fixed=beyond),
        )

    @cached_property
    def tooth_force(self) -> ca.SX:
        """Tangential force of b on a at the pitch point, N; positive turns a counter-clockwise."""
        return -self.multipliers


def _rolled(a: Marker, b: Marker, radius: Any) -> ca.SX:
    """Return the row of a wheel b that rolls along the x axis of a."""
    rolled = ca.dot(a.x_axis, b.position - a.position) + radius * (b.angle - a.angle)
    return from_estimate(rolled)


def _line_of_centres(what: str, a: Marker, b: Marker, carrier: Body) -> ca.SX:
    """Return the vector from a to b (2,) in axes on the carrier, the first along it at the estimated poses."""
    d = b.position - a.position
    estimate = values_of(at_poses(rotation(-carrier.phi) @ d)).ravel()
    if np.hypot(*estimate) <= 1e-12:
        raise ModelError(
            f"{what}: the centres coincide at the estimated poses, which then do not give the phase; "
            "give the bodies a pose= in which the gears mesh"
        )
    return rotation(-carrier.phi - float(np.arctan2(estimate[1], estimate[0]))) @ d


class RackAndPinion(Joint):
    """Pinion that rolls on a rack without slip.

    ``Phi = x_a · d + R (phi_b - phi_a) - C0`` (1 row, m) with ``d = r^b - r^a``;
    C0 is the value of the expression at the estimated poses. The pinion is above
    the rack's x axis: a counter-clockwise turn of a fixed pinion moves the rack
    towards +x. Other joints must hold the distance of the pinion from the rack.

    Parameters
    ----------
    name : str
        Its name.
    rack : Marker
        Point and x axis of the pitch line.
    pinion : Marker
        Centre of the pinion.
    radius : float or expression in parameters
        Pitch radius R, m.

    References
    ----------
    Haug 1989, section 3.4, eq. (3.4.10).
    """

    def __init__(self, name: str, rack: Marker, pinion: Marker, radius: Scalar):
        a, b = self.pair(name, rack, pinion, ("rack", "pinion"))
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        super().__init__(name, a, b, _rolled(a, b, self.radius))

    @cached_property
    def tooth_force(self) -> ca.SX:
        """Force of the pinion on the rack along the rack's x axis, N."""
        return ca.dot(self.reaction_on(self.a.body).force, self.a.x_axis)


class Rolling(AlongLine, Joint):
    """Wheel that rolls on a straight track without slip and without leaving it.

    ``Phi = [y_a · d - R, x_a · d + R (phi_b - phi_a) - C0]`` (2 rows, m) with
    ``d = r^b - r^a``, a on the surface and b the wheel: the wheel stays above the track's x axis at the distance
    of its radius, and advances by the arc that it rolls. C0 is the value of the
    expression at the estimated poses.

    The contact holds the wheel in both directions. Analyses warn if it would have to pull;
    compare ``friction_force`` with the available friction. For a circular track use a
    :class:`Gear` whose carrier is an arm between the centres; the arm needs no mass.

    Parameters
    ----------
    name : str
        Its name.
    wheel : Marker
        Centre of the wheel.
    surface : Marker
        Point and x axis of the track.
    radius : float or expression in parameters
        Radius R, m.

    References
    ----------
    Haug 1989, section 3.4 (rack and pinion, with the distance held).
    """

    sliding = None

    def __init__(self, name: str, wheel: Marker, surface: Marker, radius: Scalar):
        a, b = self.pair(name, surface, wheel, ("surface", "wheel"))
        self.radius = self.read(radius, "radius", above=0.0, fixed=True)
        above = ca.dot(a.y_axis, b.position - a.position) - self.radius
        super().__init__(name, a, b, ca.vertcat(above, _rolled(a, b, self.radius)), ("contact", "rolling"))
        leaving = "the normal force is negative: the wheel would leave the track, but the joint pulls it"
        self.validity_conditions = (ValidityCondition(self.normal_force, f"{self.description}: {leaving}"),)

    @property
    def normal_force(self) -> ca.SX:
        """Force of the track on the wheel along the track's y axis, N; negative if the track would have to pull."""
        return -self.multipliers[0]

    @property
    def friction_force(self) -> ca.SX:
        """Force of the track on the wheel along the track's x axis, N; it must not exceed the available friction."""
        return -self.multipliers[1]


class Coupler(Joint):
    """Angle of b in a fixed ratio to the angle of a, both measured against a carrier.

    ``Phi = (phi_b - phi_c) - n (phi_a - phi_c) - C0`` (1 row, rad); C0 is the value of
    the expression at the estimated poses. It transmits couples only; the carrier supports
    the gearbox or synchronous drive between the shafts.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        On the two bodies that turn.
    ratio : float or expression in parameters
        n, speed of b over speed of a; negative if the sense is reversed, not zero.
    carrier : Body, default ground
        Body that carries both shafts, and takes the rest of the couples.

    Attributes
    ----------
    torque : casadi.SX
        Couple on b, N m; on a it is ``-n`` times that.
    """

    def __init__(self, name: str, a: Marker, b: Marker, ratio: Scalar, carrier: Body = ground):
        a, b = self.pair(name, a, b)
        what = self.description
        self.ratio = quantity(ratio, what, "ratio", fixed=True)
        if known_value(self.ratio) == 0:
            raise ModelError(f"{what}: the ratio is zero, so that b would not turn; use a RelativeAngle")
        self.carrier = as_carrier(carrier, a, b, what)
        self.leans_on_ground = self.carrier.is_ground
        turned = (b.angle - carrier.phi) - self.ratio * (a.angle - carrier.phi)
        super().__init__(name, a, b, from_estimate(turned))

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on b, N m."""
        return -self.multipliers


class Belt(Joint):
    """Belt or chain over two pulleys, without slip.

    ``Phi = R_a (phi_a - phi_c) - R_b (phi_b - phi_c) - C0`` (1 row, m); + for a
    crossed belt. C0 is the value of the expression at the estimated poses. The belt
    transmits couples; an :class:`ElasticBelt` loads the bearings with both strands and
    its pretension.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Centres of the pulleys on their bodies.
    radius_a, radius_b : float or expression in parameters
        Radii, m.
    crossed : bool, default False
        True if the belt crosses, so that the pulleys turn in opposite directions.
    carrier : Body, default ground
        Body on which both pulleys are mounted, and which takes the rest of the couples. ``check`` and runs report
        a pulley whose centre moves relative to it.

    Attributes
    ----------
    tension_difference : casadi.SX
        Difference of the tensions of the two strands, N; positive turns a counter-clockwise.
    """

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        radius_a: Scalar,
        radius_b: Scalar,
        crossed: bool = False,
        carrier: Body = ground,
    ):
        a, b = self.pair(name, a, b)
        what = self.description
        self.radius_a = self.read(radius_a, "radius_a", above=0.0, fixed=True)
        self.radius_b = self.read(radius_b, "radius_b", above=0.0, fixed=True)
        self.crossed = yes_or_no(crossed, what, "crossed")
        self.carrier = as_carrier(carrier, a, b, what)
        self.leans_on_ground = self.carrier.is_ground
        sign = 1 if self.crossed else -1
        wound = self.radius_a * (a.angle - carrier.phi) + sign * self.radius_b * (b.angle - carrier.phi)
        super().__init__(name, a, b, from_estimate(wound))
        self.validity_conditions = (self._stays_on_carrier(a), self._stays_on_carrier(b))

    def _stays_on_carrier(self, pulley: Marker) -> ValidityCondition:
        """The centre of a pulley does not move over the carrier."""
        carrier = self.carrier
        centre = rotation(-carrier.phi) @ (pulley.position - carrier.position)
        moves = (
            f"{self.description}: the centre of pulley '{pulley.body.name}' moves relative to carrier "
            f"'{carrier.name}', and the belt does not take that; hold both pulleys by joints with one body and name it "
            "as carrier="
        )
        speed = ca.norm_2(time_derivative(centre))
        return ValidityCondition(-speed, moves, fixed=centre, shown=speed, unit="m/s")

    @cached_property
    def tension_difference(self) -> ca.SX:
        """Difference of the tensions of the strands, N."""
        return -self.multipliers
