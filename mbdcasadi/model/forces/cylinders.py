"""Hydraulic and pneumatic cylinders."""

from __future__ import annotations

import math

import casadi as ca

from ...numerics.lazy import cached_property
from ..bodies import Marker
from ..element import Element
from ..quantities import quantity
from ..symbols import Scalar, StateVariable, state_of
from ..validity import ValidityCondition
from .springs import TSDA

#: Standard atmosphere, Pa.
ATMOSPHERE = 101_325.0
#: Fraction of the volume in the middle position below which a chamber is considered empty.
_EMPTY = 1e-2


class Cylinder(TSDA):
    """Double-acting cylinder between two points, given its pressures.

    ``f = -(p A - p_r (A - A_r)) + c l̇``, tension positive: the pressure p on the
    full piston pushes the points apart, that on the rod's side pulls them
    together. Pressures are relative to the ambient pressure.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Its two eyes.
    bore : float or expression in parameters
        Diameter of the piston, m.
    rod : float or expression in parameters, default 0
        Diameter of the rod, m.
    pressure, rod_pressure : float or expression, default 0
        Pressure on the piston and on the rod side, Pa: numbers, inputs, states.
    damping : float or expression, default 0
        c, N s/m.

    Attributes
    ----------
    thrust : casadi.SX
        Force of the pressures, N; positive if it pushes the points apart.
    """

    kind = "cylinder"

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        bore: Scalar,
        rod: Scalar = 0.0,
        pressure: Scalar = 0.0,
        rod_pressure: Scalar = 0.0,
        damping: Scalar = 0.0,
    ):
        Element.__init__(self, name)  # the force depends on what is read first
        self.bore = self.read(bore, "bore", above=0.0, fixed=True)
        self.rod = self.read(rod, "rod", at_least=0.0, fixed=True)
        self.read(self.bore - self.rod, "bore less rod", above=0.0)
        self.area = math.pi / 4 * self.bore**2
        self.rod_area = math.pi / 4 * (self.bore**2 - self.rod**2)
        self.pressure = ca.SX(quantity(pressure, self.description, "pressure"))
        self.rod_pressure = ca.SX(quantity(rod_pressure, self.description, "rod_pressure"))
        self.thrust = self.pressure * self.area - self.rod_pressure * self.rod_area
        super().__init__(name, a, b, damping=damping, actuator=-self.thrust)


class HydraulicCylinder(Cylinder):
    """Double-acting cylinder whose pressures follow from the flow of oil.

    ``ṗ = β (q_p - A l̇) / (V0 + A (l - l0))`` on the piston side, and
    ``ṗ_r = β (q_r + A_r l̇) / (V0 - A_r (l - l0))`` on the rod side: two first-order
    states. The stiffness of the oil, some MN/m, gives the highest frequency.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Its two eyes.
    bore, rod : float or expression in parameters
        Diameters of piston and rod, m.
    middle_length : float or expression in parameters
        Length l0 at which the volume of both chambers is V0, m.
    volume : float or expression in parameters
        V0, including hoses, m³.
    flow, rod_flow : float or expression
        Flow into the chambers, m³/s: inputs, or a valve law in the pressures
        (which are then given as `pressures`).
    bulk_modulus : float or expression, default 1.4e9
        β, Pa.
    damping : float or expression, default 0
        c, N s/m.
    pressures : (StateVariable, StateVariable), optional
        States for the pressures on both sides, Pa; new ones by default.

    References
    ----------
    Merritt, *Hydraulic Control Systems*, 1967, section 6-1.
    """

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        bore: Scalar,
        rod: Scalar,
        middle_length: Scalar,
        volume: Scalar,
        flow: Scalar,
        rod_flow: Scalar = 0.0,
        bulk_modulus: Scalar = 1.4e9,
        damping: Scalar = 0.0,
        pressures: tuple[StateVariable, StateVariable] | None = None,
    ):
        p, p_rod = pressures or (state_of(self, f"{name}.pressure"), state_of(self, f"{name}.rod_pressure"))
        super().__init__(name, a, b, bore, rod, p, p_rod, damping)
        self.volume = self.read(volume, "volume", above=0.0, fixed=True)
        self.bulk_modulus = self.read(bulk_modulus, "bulk_modulus", above=0.0)
        self.middle_length = self.read(middle_length, "middle_length", above=0.0, fixed=True)
        self.flow = ca.SX(quantity(flow, self.description, "flow"))
        self.rod_flow = ca.SX(quantity(rod_flow, self.description, "rod_flow"))
        out = self.length - self.middle_length
        chamber, rod_chamber = self.volume + self.area * out, self.volume - self.rod_area * out
        rise = self.bulk_modulus * (self.flow - self.area * self.rate) / chamber
        rod_rise = self.bulk_modulus * (self.rod_flow + self.rod_area * self.rate) / rod_chamber
        self.validity_conditions = tuple(
            ValidityCondition(space / self.volume - _EMPTY, f"{self.description}: the chamber on the {side} is empty")
            for space, side in ((chamber, "piston's side"), (rod_chamber, "rod's side"))
        )
        self.rates = {p: rise, p_rod: rod_rise}


class GasSpring(TSDA):
    """Enclosed gas column between two points: a pneumatic spring.

    ``p = p0 (V0 / V)^n`` with the volume ``V = A (l - l_d)``;
    ``f = -A (p - p_ambient) + c l̇``, tension positive.

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Its two ends.
    area : float or expression in parameters
        A, m².
    charged_length : float or expression in parameters
        Length l0 at which the gas has the pressure p0, m.
    pressure : float or expression in parameters
        p0, absolute, Pa.
    dead_length : float or expression in parameters, default 0
        Length l_d at which the volume is zero, m.
    exponent : float or expression, default 1.4
        Polytropic exponent n: 1 for slow (isothermal), 1.4 for fast (adiabatic) motion of air.
    ambient : float, default 101325
        Ambient pressure, Pa.
    damping : float or expression, default 0
        c, N s/m.
    """

    kind = "gas spring"

    def __init__(
        self,
        name: str,
        a: Marker,
        b: Marker,
        area: Scalar,
        charged_length: Scalar,
        pressure: Scalar,
        dead_length: Scalar = 0.0,
        exponent: Scalar = 1.4,
        ambient: Scalar = ATMOSPHERE,
        damping: Scalar = 0.0,
    ):
        Element.__init__(self, name)
        self.area = self.read(area, "area", above=0.0, fixed=True)
        self.charge = self.read(pressure, "pressure", above=0.0, fixed=True)
        self.exponent = self.read(exponent, "exponent", at_least=1.0)
        self.ambient = self.read(ambient, "ambient", at_least=0.0)
        self.dead_length = self.read(dead_length, "dead_length", at_least=0.0, fixed=True)
        self.column = self.read(charged_length - dead_length, "charged_length less dead_length", above=0.0, fixed=True)
        self._loss = self.read(damping, "damping", at_least=0.0)
        super().__init__(name, a, b, law=self._tension)
        within = "the length is below dead_length, at which the gas has no volume"
        self.validity_conditions = (
            ValidityCondition((self.length - self.dead_length) / self.column, f"{self.description}: {within}"),
        )

    @cached_property
    def pressure(self) -> ca.SX:
        """Pressure of the gas, absolute, Pa."""
        return self.charge * (self.column / (self.length - self.dead_length)) ** self.exponent

    def _tension(self, _length: ca.SX, rate: ca.SX) -> ca.SX:
        return -self.area * (self.pressure - self.ambient) + self._loss * rate

    @cached_property
    def potential(self) -> ca.SX:
        """Energy of the gas relative to the ambient pressure, zero at the charged length, J."""
        now, full = self.length - self.dead_length, self.column
        n, work = self.exponent, self.charge * self.area * full
        stored = -work * ca.log(now / full) if n == 1 else work / (n - 1) * ((full / now) ** (n - 1) - 1)
        return stored + self.ambient * self.area * (now - full)
