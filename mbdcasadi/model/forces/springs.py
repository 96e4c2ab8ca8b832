"""Spring–damper–actuators between two points or two angles."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property
from typing import Any

import casadi as ca

from ...errors import ModelError
from ..bodies import markers_on_two
from ..element import Element
from ..expressions import norm
from ..quantities import function_of, quantity
from ..rates import time_derivative
from .laws import stored_energy


class _SpringDamper(Element):
    """What the translational and the rotational element share: the law of the force in one coordinate."""

    kind = "spring"

    def __init__(
        self, name: str, a: Any, b: Any, stiffness: Any, free: Any, damping: Any, actuator: Any, law: Callable | None
    ):
        super().__init__(name)
        self.markers = self.a, self.b = markers_on_two(a, b, self.description)
        self.stiffness = quantity(stiffness, self.description, "stiffness")
        self.damping = quantity(damping, self.description, "damping")
        self.actuator = quantity(actuator, self.description, "actuator")
        self.free = quantity(free, self.description, self._free_name)
        if law is not None and any(not isinstance(x, ca.SX) and x != 0 for x in (self.stiffness, self.damping)):
            raise ModelError(
                f"{self.description}: stiffness and damping belong to the linear law; with law= give neither"
            )
        self.law = None if law is None else function_of(law, self.description, "law", *self._law_arguments)
        self.virtual_work = ((self._coordinate, -self._effort),)

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
            force = quantity(self.law(self._coordinate, self.rate), self.description, "law")
            return ca.SX(force) + self.actuator
        return self.stiffness * (self._coordinate - self.free) + self.damping * self.rate + self.actuator

    @cached_property
    def potential(self) -> ca.SX:
        """Energy stored in the spring, J; zero for a law of its own that has no ``potential(length)``."""
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
        a: Any,
        b: Any,
        stiffness: Any = 0.0,
        free_length: Any = 0.0,
        damping: Any = 0.0,
        actuator: Any = 0.0,
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
        a: Any,
        b: Any,
        stiffness: Any = 0.0,
        free_angle: Any = 0.0,
        damping: Any = 0.0,
        actuator: Any = 0.0,
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
