"""Elements with first-order states and no force: controllers, lags, energy meters.

Their outputs are expressions for torques, voltages and costs. They are listed
among the forces of the mechanism.
"""

from __future__ import annotations

import casadi as ca

from ..element import Element, refuse_kinds
from ..quantities import quantity
from ..symbols import Scalar, state_of

#: Kinds of symbols that the rate of a state must not depend on.
_UNKNOWN = ("acceleration",)


class PIController(Element):
    """Proportional–integral controller: ``output = k_p e + k_i ∫ e dt``.

    Parameters
    ----------
    name : str
        Its name.
    error : casadi.SX
        e: set point less controlled quantity, in positions, velocities, states, inputs and time.
    proportional, integral : float or expression in parameters
        k_p and k_i.
    initial : float or StateVariable, default 0
        Integral of the error at the start, or the state variable to use.

    Attributes
    ----------
    integrated : StateVariable
        ``∫ e dt``.
    output : casadi.SX
        Output of the controller.

    Examples
    --------
    A speed controller on the voltage of a motor::

        speed = PIController("speed", 50 - wheel.omega, proportional=0.2, integral=1.5)
        motor = DCMotor("motor", wheel, speed.output, constant=0.05, resistance=0.4)
        Mechanism(..., forces=[speed, motor])
    """

    kind = "controller"

    def __init__(self, name: str, error: Scalar, proportional: Scalar, integral: Scalar, initial: Scalar = 0.0):
        super().__init__(name)
        self.error = ca.SX(quantity(error, self.description, "error"))
        refuse_kinds(self.error, _UNKNOWN, self.description, "an error depends on positions and velocities")
        self.proportional = quantity(proportional, self.description, "proportional")
        self.integral = quantity(integral, self.description, "integral")
        self.integrated = state_of(self, f"{name}.integral", initial)
        self.rates = {self.integrated: self.error}
        self.output = self.proportional * self.error + self.integral * self.integrated


class FirstOrderLag(Element):
    """First-order lag: an actuator that follows its command by ``T ẏ + y = command``.

    Parameters
    ----------
    name : str
        Its name.
    command : float or expression
        Command: an input, the output of a controller.
    time_constant : float or expression in parameters
        T, s.
    initial : float or StateVariable, default 0
        Output at the start, or the state variable to use.

    Attributes
    ----------
    output : StateVariable
        y, in the unit of the command.
    """

    kind = "lag"

    def __init__(self, name: str, command: Scalar, time_constant: Scalar, initial: Scalar = 0.0):
        super().__init__(name)
        self.command = ca.SX(quantity(command, self.description, "command"))
        refuse_kinds(self.command, _UNKNOWN, self.description, "a command depends on positions and velocities")
        self.time_constant = self.read(time_constant, "time_constant", above=0.0)
        self.output = state_of(self, f"{name}.output", initial)
        self.rates = {self.output: (self.command - self.output) / self.time_constant}


class EnergyMeter(Element):
    """Integral of a power as a first-order state: ``Ė = power``.

    Parameters
    ----------
    name : str
        Its name.
    power : casadi.SX
        Power, W, in positions, velocities, states, inputs and time: ``tau * crank.omega``,
        ``motor.electric_power``.
    initial : float or StateVariable, default 0
        Energy at the start, J, or the state variable to use.

    Attributes
    ----------
    energy : StateVariable
        J.
    """

    kind = "energy meter"

    def __init__(self, name: str, power: Scalar, initial: Scalar = 0.0):
        super().__init__(name)
        self.power = ca.SX(quantity(power, self.description, "power"))
        refuse_kinds(self.power, _UNKNOWN, self.description, "a power depends on positions, velocities and forces")
        self.energy = state_of(self, f"{name}.energy", initial)
        self.rates = {self.energy: self.power}
