"""Electric motors."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ..bodies import Body, bodies_of_couple, ground
from ..element import Element
from ..quantities import known_value, quantity
from ..symbols import Scalar, StateVariable, state_of


class DCMotor(Element):
    """Direct-current motor between a body and its housing.

    ``T = n K i`` with the current from ``L di/dt = V - R i - n K omega``: a
    first-order state. If the inductance is zero, the current follows at
    once, ``i = (V - n K omega) / R``, and the torque is a linear function of the
    speed. omega is the speed of the body relative to the housing, n the ratio
    of a gearbox in between.

    Parameters
    ----------
    name : str
        Its name.
    body : Body
        Body that it turns.
    voltage : float or expression
        V: a number, an input, a controller's output.
    constant : float or expression in parameters
        K, N m/A, which is also V s/rad.
    resistance : float or expression in parameters
        R, Ω.
    inductance : float or expression in parameters, default 0
        L, H.
    ratio : float or expression in parameters, default 1
        n, turns of the motor for one turn of the body.
    opposite : Body, default ground
        Body that carries the housing.
    current : float or StateVariable, default 0
        Current at the start, A, or the state variable to use; only with an inductance.

    Attributes
    ----------
    current, torque : casadi.SX
        Current, A, and couple on the body, N m.
    electric_power, heat : casadi.SX
        Power from the supply, and loss in the winding, W.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> wheel = mbd.Body("wheel", mass=1, inertia=0.01)
    >>> motor = mbd.DCMotor.from_line("motor", wheel, stall_torque=2.0, no_load_speed=100.0)
    """

    kind = "motor"

    def __init__(
        self,
        name: str,
        body: Body,
        voltage: Scalar,
        constant: Scalar,
        resistance: Scalar,
        inductance: Scalar = 0.0,
        ratio: Scalar = 1.0,
        opposite: Body = ground,
        current: Scalar = 0.0,
    ):
        super().__init__(name)
        self.body, self.opposite = bodies_of_couple(body, opposite, self.description)
        self.voltage = ca.SX(quantity(voltage, self.description, "voltage"))
        self.constant = self.read(constant, "constant", above=0.0, fixed=True)
        self.resistance = self.read(resistance, "resistance", above=0.0, fixed=True)
        without = known_value(quantity(inductance, self.description, "inductance", at_least=0.0, fixed=True)) == 0
        self.inductance = 0.0 if without else self.read(inductance, "inductance", above=0.0)
        self.ratio = quantity(ratio, self.description, "ratio", fixed=True)
        if known_value(self.ratio) == 0:
            raise ModelError(f"{self.description}: the ratio is zero, so that the motor would turn nothing")
        left = self.voltage - self.constant * self.ratio * (self.body.omega - self.opposite.omega)
        if not without:
            self.current = state_of(self, f"{name}.current", current)
            self.rates = {self.current: (left - self.resistance * self.current) / self.inductance}
        elif isinstance(current, StateVariable) or current != 0.0:
            raise ModelError(f"{self.description}: without inductance the current has no start; leave current= out")
        else:
            self.current = left / self.resistance
        self.torque = self.ratio * self.constant * self.current
        self.electric_power = self.voltage * self.current
        self.heat = self.resistance * self.current**2
        self.virtual_work = ((self.body.phi - self.opposite.phi, self.torque),)
        self.__dict__["bodies"] = (self.body, self.opposite)

    @classmethod
    def from_line(
        cls, name: str, body: Any, stall_torque: Any, no_load_speed: Any, command: Any = 1.0, opposite: Any = ground
    ) -> DCMotor:
        """Return a motor whose torque is linear in the speed: ``T = T0 (command - omega / omega0)``.

        Parameters
        ----------
        name : str
            Its name.
        body : Body
            Body that it turns.
        stall_torque, no_load_speed : float or expression in parameters
            T0 (N m) and omega0 (rad/s) at full command.
        command : float or expression, default 1
            Fraction of the full voltage, -1 … 1.
        opposite : Body, default ground
            Body that carries the housing.
        """
        what = f"{cls.kind} '{name}'"
        torque = quantity(stall_torque, what, "stall_torque", above=0.0)
        speed = quantity(no_load_speed, what, "no_load_speed", above=0.0)
        # at one volt: K = 1 V / omega0, and the stall current is T0 / K
        command = quantity(command, what, "command")
        return cls(name, body, command, 1 / speed, 1 / (torque * speed), opposite=opposite)
