"""Spring–damper–actuators between two points or two angles, bushings, and laws from data."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ...errors import ModelError, warn
from ...numerics.lazy import cached_property
from ..bodies import Marker, markers_on_two
from ..element import Element
from ..expressions import norm
from ..geometry.splines import spline, spline_integral
from ..immutable import Immutable
from ..quantities import function_of, known_value, quantity, value_of
from ..rates import time_derivative
from ..symbols import Numbers, Scalar, Vector
from .laws import stored_energy


class _SpringDamper(Element):
    """Base class of the translational and the rotational element: the law of the force in one coordinate."""

    kind = "spring"

    def __init__(
        self, name: str, a: Any, b: Any, stiffness: Any, free: Any, damping: Any, actuator: Any, law: Callable | None
    ):
        super().__init__(name)
        self.markers = self.a, self.b = markers_on_two(a, b, self.description)
        self.stiffness = self._coefficient(stiffness, "stiffness", "drives the bodies away from where it is at rest")
        self.damping = self._coefficient(damping, "damping", "adds energy to the motion")
        self.actuator = quantity(actuator, self.description, "actuator")
        self.free = quantity(free, self.description, self._free_name)
        if law is not None and any(not isinstance(x, ca.SX) and x != 0 for x in (self.stiffness, self.damping)):
            raise ModelError(
                f"{self.description}: stiffness and damping belong to the linear law; give neither of them with law="
            )
        self.law = None if law is None else function_of(law, self.description, "law", *self._law_arguments)
        self.virtual_work = ((self._coordinate, -self._effort),)

    def _coefficient(self, value: Any, name: str, effect: str) -> Any:
        """A coefficient of the linear law, with a warning if it is negative: a wrong sign more often than a device."""
        value = quantity(value, self.description, name)
        known = known_value(value)
        if known is not None and known < 0:
            meant = "if that is meant, give the force by law="
            warn(f"{self.description}: {name} = {known:g} is negative and {effect}; {meant}")
        return value

    _free_name = "free_length"
    _law_arguments: tuple[str, ...] = ("length", "rate")

    @property
    def _coordinate(self) -> ca.SX:
        raise NotImplementedError

    @cached_property
    def rate(self) -> ca.SX:
        """Rate of the length (m/s) or of the angle (rad/s)."""
        return time_derivative(self._coordinate)

    @cached_property
    def _effort(self) -> ca.SX:
        if self.law is not None:
            force = value_of(self.law, self.description, "law", self._coordinate, self.rate)
            return ca.SX(force) + self.actuator
        return self.stiffness * (self._coordinate - self.free) + self.damping * self.rate + self.actuator

    @cached_property
    def potential(self) -> ca.SX:
        """Energy stored in the spring, J; zero for a law without ``potential(length)``."""
        if self.law is not None:
            return stored_energy(self.law, self._coordinate)
        return ca.SX(0.5 * self.stiffness * (self._coordinate - self.free) ** 2)


class TSDA(_SpringDamper):
    """Translational spring–damper–actuator between two points.

    ``f = k (l - l0) + c l̇ + actuator``, tension positive; ``δW = -f δl``.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Points on two bodies.
    stiffness, free_length, damping, actuator : float or expression, default 0
        k (N/m), l0 (m), c (N s/m) and an added tension (N).
    law : callable, optional
        ``law(length, rate)`` returns the tension instead of ``k (l - l0) + c l̇``; see also ``DataLaw``.

    Attributes
    ----------
    length, rate, force : casadi.SX
        Distance of the points (m), its rate (m/s), tension (N).

    References
    ----------
    Haug 1989, section 6.2, eqs. (6.2.1)–(6.2.5).
    """

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        stiffness: Scalar = 0.0,
        free_length: Scalar = 0.0,
        damping: Scalar = 0.0,
        actuator: Scalar = 0.0,
        law: Callable[[ca.SX, ca.SX], Any] | None = None,
    ):
        super().__init__(name, a, b, stiffness, free_length, damping, actuator, law)

    @cached_property
    def length(self) -> ca.SX:
        """Distance between the points, m."""
        return norm(self.b.position - self.a.position)

    @property
    def _coordinate(self) -> ca.SX:
        return self.length

    @property
    def free_length(self) -> Any:
        """Length without force, m."""
        return self.free

    @property
    def force(self) -> ca.SX:
        """Tension, N."""
        return self._effort


class RSDA(_SpringDamper):
    """Rotational spring–damper–actuator between two bodies.

    ``n = k (theta - theta0) + c thetȧ + actuator`` pulls b back towards a;
    ``δW = -n δtheta`` with the angle theta of b relative to a. Whole turns count.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Markers on two bodies; their angles count.
    stiffness, free_angle, damping, actuator : float or expression, default 0
        k (N m/rad), theta0 (rad), c (N m s/rad) and an added couple (N m).
    law : callable, optional
        ``law(angle, rate)`` returns the couple instead of the linear one.

    Attributes
    ----------
    angle, rate, torque : casadi.SX
        Relative angle (rad), its rate (rad/s), couple (N m).

    References
    ----------
    Haug 1989, section 6.2, eqs. (6.2.8)–(6.2.10).
    """

    _free_name = "free_angle"
    _law_arguments = ("angle", "rate")

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        stiffness: Scalar = 0.0,
        free_angle: Scalar = 0.0,
        damping: Scalar = 0.0,
        actuator: Scalar = 0.0,
        law: Callable[[ca.SX, ca.SX], Any] | None = None,
    ):
        super().__init__(name, a, b, stiffness, free_angle, damping, actuator, law)

    @cached_property
    def angle(self) -> ca.SX:
        """Angle of b relative to a, rad."""
        return self.b.angle - self.a.angle

    @property
    def _coordinate(self) -> ca.SX:
        return self.angle

    @property
    def free_angle(self) -> Any:
        """Angle without couple, rad."""
        return self.free

    @property
    def torque(self) -> ca.SX:
        """Couple that pulls b back towards a, N m."""
        return self._effort


class Bushing(Element):
    """Elastic and damped connection of two markers: a rubber bearing, a compliant joint.

    With ``delta`` the position of b in the axes of a, and ``theta`` its angle
    against a: ``F = -(k delta + c deltȧ)`` on b in the axes of a, and the couple
    ``T = -(k_t theta + c_t thetȧ)``. ``δW = F · δdelta + T δtheta``, so that the force and
    couple on a balance those on b, the moment of the force included.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Markers on two bodies; the stiffness acts along the axes of a.
    stiffness, damping : float, expression or pair of them, default 0
        One value for each axis of a, or one for both, N/m and N s/m.
    angular_stiffness, angular_damping : float or expression, default 0
        N m/rad and N m s/rad.

    Attributes
    ----------
    displacement, angle : casadi.SX
        ``delta`` (2,), m, and theta, rad, whole turns included.
    force : casadi.SX
        On b (2,), in the axes of a, N.
    torque : casadi.SX
        On b, N m.
    """

    kind = "bushing"

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        stiffness: Scalar | Vector = 0.0,
        damping: Scalar | Vector = 0.0,
        angular_stiffness: Scalar = 0.0,
        angular_damping: Scalar = 0.0,
    ):
        super().__init__(name)
        self.markers = self.a, self.b = markers_on_two(a, b, self.description)

        def by_axis(value: Any, quantity_name: str) -> ca.SX:
            parts = list(value) if isinstance(value, list | tuple) else [value, value]
            if len(parts) != 2:
                raise ModelError(
                    f"{self.description}: {quantity_name} takes one value, or one for each axis, got {value!r}"
                )
            return ca.vertcat(
                *[
                    ca.SX(self.read(part, f"{quantity_name} {axis}", at_least=0.0))
                    for part, axis in zip(parts, "xy", strict=True)
                ]
            )

        self.stiffness, self.damping = by_axis(stiffness, "stiffness"), by_axis(damping, "damping")
        self.angular_stiffness = self.read(angular_stiffness, "angular_stiffness", at_least=0.0)
        self.angular_damping = self.read(angular_damping, "angular_damping", at_least=0.0)
        self.displacement = self.a.axes.T @ (self.b.position - self.a.position)
        self.angle = self.b.angle - self.a.angle
        self.virtual_work = ((self.displacement, self.force), (self.angle, self.torque))

    @cached_property
    def force(self) -> ca.SX:
        """Force on b in the axes of a (2,), N."""
        return -(self.stiffness * self.displacement + self.damping * time_derivative(self.displacement))

    @cached_property
    def torque(self) -> ca.SX:
        """Couple on b, N m."""
        return -(self.angular_stiffness * self.angle + self.angular_damping * time_derivative(self.angle))

    @cached_property
    def potential(self) -> ca.SX:
        """Energy stored, J."""
        return 0.5 * (ca.dot(self.stiffness, self.displacement**2) + self.angular_stiffness * self.angle**2)


class DataLaw(Immutable):
    """Force over displacement, and over its rate, through data points: a ``law=`` for a TSDA or RSDA.

    ``f = s(x - x_0) + c ẋ``, or with a second curve ``s(x - x_0) + d(ẋ)``.

    Parameters
    ----------
    displacements, forces : sequence of float
        Points of the spring: length less `free` (m) and tension (N), or angle (rad) and couple (N m).
    rates, damping_forces : sequence of float, optional
        Points of the damper: rate (m/s, rad/s) and force.
    damping : float or expression, default 0
        Additional linear damping, N s/m.
    free : float or expression, default 0
        x_0, the length (or angle) of zero displacement.
    kind : {"monotone", "cubic", "linear"}, default "monotone"
        Kind of the curves; see :func:`spline`. Monotone curves do not overshoot the data.
    outside : {"linear", "error", "constant"}, default "linear"
        Continuation of the curves beyond the data.

    Examples
    --------
    A progressive spring of free length 0.3 m::

        TSDA("spring", a, b, law=DataLaw([-0.05, 0, 0.05], [-400, 0, 150], free=0.3))
    """

    def __init__(
        self,
        displacements: Numbers,
        forces: Numbers,
        rates: Numbers | None = None,
        damping_forces: Numbers | None = None,
        damping: Scalar = 0.0,
        free: Scalar = 0.0,
        kind: str = "monotone",
        outside: str = "linear",
    ):
        what = "DataLaw"
        if (rates is None) != (damping_forces is None):
            raise ModelError(f"{what}: a damper needs both rates and damping_forces, and only one of them is given")
        self._curve = displacements, forces, kind, outside
        self._damper: tuple[Any, ...] | None = None if rates is None else (rates, damping_forces, kind, outside)
        self.damping = quantity(damping, what, "damping")
        self.free = quantity(free, what, "free")
        self(ca.SX.sym("x"), ca.SX.sym("rate"))  # raises an error for bad data

    def __call__(self, length: ca.SX, rate: ca.SX) -> ca.SX:
        """Tension (N) or couple (N m)."""
        force = spline(length - self.free, *self._curve) + self.damping * rate
        return force if self._damper is None else force + spline(rate, *self._damper)

    def potential(self, length: ca.SX) -> ca.SX:
        """Energy of the spring, zero at the first point of the data, J."""
        return spline_integral(length - self.free, *self._curve)
