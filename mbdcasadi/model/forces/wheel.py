"""Wheels with elastic tyres on a road."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker, markers_on_two, rotation
from ..element import BEYOND_COORDINATES, refuse_kinds
from ..expressions import if_else
from ..quantities import function_of, value_of
from ..rates import time_derivative
from ..symbols import Scalar
from ..validity import Smoothing, ValidityCondition
from .friction.laws import FrictionLaw, Resistance, as_law
from .stops import OneSided


class Wheel(OneSided):
    """Wheel with an elastic tyre on a road, which it may leave.

    ``F = law(-gap, -gap rate)``, ``δW = F δgap`` with ``gap = y - h(x) - R``: the centre of the wheel at
    (x, y) in the axes of the base, the height h of the road under it, and the radius R of the tyre without load. F is
    the vertical force; on a slope the road pushes the wheel along its normal, and so back with ``F h'``. Friction acts
    along the road, as a function of the speed ``v + R (omega_wheel - omega_base)`` at which the tyre slides, with F as
    the load, and turns the wheel with the arm R.

    The tyre touches the road in one point under the centre: bumps are longer than the tyre's contact.

    Parameters
    ----------
    name : str
        Its name.
    wheel : Marker
        Centre of the wheel.
    base : Marker
        Frame of the road; its y axis points up.
    road : callable
        ``road(x)`` returns the height h, m, at a place x, a ``casadi.SX`` in m.
    radius : float or expression
        R, m.
    law : callable
        ``law(compression, rate)`` returns the vertical force, N: :class:`HuntCrossley`; while the tyre is off the road
        it is zero in any case.
    friction : FrictionLaw, optional
        ``Coulomb, Stribeck, LuGre, Viscous`` or a sum of them; without it the tyre slides freely.

    Attributes
    ----------
    gap, rate : casadi.SX
        Distance of the tyre from the road, m, negative if it is compressed, and its rate.
    normal_force, friction_force : casadi.SX
        Vertical force on the wheel, and friction on it along the road, towards +x, N.
    sliding_speed : casadi.SX
        Speed at which the tyre slides on the road, m/s.

    Raises
    ------
    ModelError
        For markers on one body, and friction that switches exactly.

    Examples
    --------
    A quarter of a car on a wavy road::

        wave = lambda x: 0.02 * mbd.sin(3 * x)
        tyre = mbd.HuntCrossley(2e5, exponent=1)
        mbd.Wheel("tyre", axle.at(0, 0), mbd.ground.at(0, 0), wave, radius=0.3, law=tyre)
    """

    kind = "wheel"

    def __init__(
        self,
        name: str,
        wheel: Marker,
        base: Marker,
        road: Callable[[ca.SX], Any],
        radius: Scalar,
        law: Callable[[Any, Any], Any],
        friction: FrictionLaw | None = None,
    ):
        super().__init__(name)
        base, wheel = markers_on_two(base, wheel, self.description, ("base", "wheel"))
        self.markers = (base, wheel)
        self.radius = self.read(radius, "radius", above=0.0)
        self.law = function_of(law, self.description, "law", "compression", "rate")
        self.laws = (self.law,)
        self.friction = None if friction is None else as_law(friction, self.description)
        if self.friction is not None and self.friction.exact:
            raise ModelError(
                f"{self.description}: DryFriction switches a row, which an elastic tyre does not have; use Coulomb, "
                "Stribeck or LuGre, or a RollingOnCurve"
            )
        rubs = () if self.friction is None else self.friction.limits
        self.limits = (*self.limits, *getattr(law, "limits", ()), *rubs)
        self.resolved_laws = () if self.friction is None else (self.friction,)
        self.road = function_of(road, self.description, "road", "the place")
        refuse_kinds(
            self.height(ca.SX.sym("x")),
            BEYOND_COORDINATES,
            self.description,
            "a road depends on the place, and on time",
        )
        self.gap = self.place[1] - self.height(self.place[0]) - self.radius
        self.rates: Mapping[Any, ca.SX] = self.resistance.rates
        turned = wheel.angle - base.angle
        self.virtual_work = (
            (self.gap, self.force),
            (self.place, self.friction_force * self.along),
            (turned, self.friction_force * self.radius),
        )
        flat = f"{self.description}: its law is too soft: the centre of the wheel is under the road; take a stiffer law"
        self.validity_conditions = (
            ValidityCondition(self.gap + self.radius, flat, shown=-self.gap, unit="m deep", between_outputs=True),
        )

    def height(self, x: Any) -> ca.SX:
        """Return the height of the road at a place, m."""
        return ca.SX(value_of(self.road, self.description, "road", ca.SX(x)))

    @cached_property
    def place(self) -> ca.SX:
        """Position of the centre of the wheel in the axes of the base (2,), m."""
        base, wheel = self.markers
        return rotation(-base.angle) @ (wheel.position - base.position)

    @cached_property
    def along(self) -> ca.SX:
        """Unit tangent of the road under the centre (2,), in the axes of the base."""
        x = ca.SX.sym("x")
        slope = ca.substitute(ca.jacobian(self.height(x), x), x, self.place[0])
        return ca.vertcat(1, slope) / ca.sqrt(1 + slope**2)

    @cached_property
    def sliding_speed(self) -> ca.SX:
        """Speed at which the tyre slides on the road, m/s."""
        base, wheel = self.markers
        turning = time_derivative(wheel.angle - base.angle)
        return ca.dot(self.along, time_derivative(self.place)) + self.radius * turning

    @property
    def normal_force(self) -> ca.SX:
        """Vertical force on the wheel, N."""
        return self.force

    @cached_property
    def resistance(self) -> Resistance:
        """Friction by the law; none while the tyre is off the road."""
        if self.friction is None:
            return Resistance(ca.SX(0))
        found = self.friction.resistance(self.name, self.sliding_speed, self.force)
        return replace(found, force=if_else(self.gap < 0, found.force, 0))

    @property
    def friction_force(self) -> ca.SX:
        """Friction on the wheel along the road, N."""
        return self.resistance.force

    @property
    def power(self) -> ca.SX:
        """Power of the friction, W."""
        return self.friction_force * self.sliding_speed

    @cached_property
    def smoothings(self) -> tuple[Smoothing, ...]:  # type: ignore[override]
        """Quantities that change within a short time: the force, and that times the smoothed sign of friction."""
        (load,) = super().smoothings
        if self.friction is None:
            return (load,)
        turn, course = "its friction's change of direction", load.expression
        turns = (Smoothing(course * e, 2.0, turn, self.friction.remedy, course) for e in self.resistance.smoothed)
        return (load, *turns)
