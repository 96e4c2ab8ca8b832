"""Drivers: constraints that prescribe a motion in time, or one that follows first-order states."""

from __future__ import annotations

from typing import Any, ClassVar

import casadi as ca

from ..errors import ModelError
from .bodies import Marker, markers_on_two
from .element import BEYOND_COORDINATES, ConstraintElement, holds_coordinates, refuse_kinds
from .expressions import distance
from .geometry.splines import expression_of
from .quantities import no_relation, quantity
from .symbols import Scalar, check_name
from .symbols import t as time

#: Remedy for an input that would have to be differentiated.
BEFORE_AN_INPUT = (
    "a servo needs two time derivatives of its value, and an input has none: put states before it, as in "
    "states={position: velocity, velocity: command}"
)


class Driver(ConstraintElement):
    """Prescribed motion: ``Phi = expression - value(t, z)`` (1 row).

    A servo follows states: with ``states={position: velocity, velocity: command}`` of the mechanism and `position` as
    the value the acceleration is an input, and a third state would make it the jerk. The two time derivatives of the
    value follow from the rates of the states; an input may occur in the second one at the earliest.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        Driven quantity: a scalar in coordinates (``joint.angle``, ``marker.x``), m or rad.
    value : float, expression in time, states and parameters, or spline of SciPy
        Its prescribed course, twice differentiable: ``20 * mbd.t``, a
        ``mbd.spline`` through data, a ``MotionProgram`` of the time, a ``StateVariable``.
    relative_to : State, optional
        State, such as :func:`assemble` returns, from which the motion continues: the course is then
        ``expression + value(t) - value(t_0)`` with the expression and the time ``t_0`` of that state. For a course
        in time alone: states have starts of their own.

    Attributes
    ----------
    effort : casadi.SX
        Force or torque that the driver supplies along `expression`, ``-lam``; its
        power is ``effort * time_derivative(expression)``.

    Raises
    ------
    ModelError, ExpressionError
        If the expression moves nothing, or the value depends on coordinates or on an input itself.

    References
    ----------
    Haug 1989, section 3.5 (driving constraints).
    """

    kind = "driver"
    #: name of the argument that holds the course, in messages
    course: ClassVar[str] = "value"

    def __init__(self, name: str, expression: Scalar, value: Any, relative_to: Any = None):
        what = f"{self.kind} '{name}'"
        self.expression = ca.SX(no_relation(quantity(expression, what, "expression"), what, "expression"))
        course = ca.SX(quantity(expression_of(time, value), what, self.course))
        refuse_kinds(self.expression, BEYOND_COORDINATES, what, "a driver prescribes coordinates")
        refuse_kinds(course, ("input",), what, BEFORE_AN_INPUT)
        beyond = ("position", "velocity", "acceleration", "multiplier")
        refuse_kinds(course, beyond, what, f"its {self.course} is a function of time, states and parameters")
        if not holds_coordinates(self.expression):
            raise ModelError(f"{what}: the expression {expression} depends on no coordinate")
        self.value = course
        if relative_to is not None:
            refuse_kinds(
                course, ("state",), what, "relative_to= is for courses in time; a state has a start of its own"
            )
            start = _at_state(self.expression, relative_to, what)
            self.value = course + start - ca.substitute(course, time, ca.SX(relative_to.t))
        super().__init__(name, self.expression - self.value)

    def refuse_beyond_coordinates(self, expression: Any) -> None:
        """Nothing is left to refuse: both sides have been looked at, and the value may follow states."""

    @property
    def effort(self) -> ca.SX:
        """Force (N) or torque (N m) that the driver supplies."""
        return -self.multipliers


class Actuator(Driver):
    """Linear actuator whose length is prescribed: ``Phi = |r^b - r^a| - length(t)`` (1 row, m).

    Parameters
    ----------
    name : str
        Its name.
    a, b : Marker
        Its two eyes, on two bodies.
    length : float, expression in time, states and parameters, or spline of SciPy
        Prescribed distance of the eyes, twice differentiable, m; positive.
    relative_to : State, optional
        State from which the motion continues, as for :class:`Driver`.

    Attributes
    ----------
    length : casadi.SX
        Distance of the eyes, m.
    stroke : casadi.SX
        Part by which it is longer than its prescribed length at ``t = 0``, m; zero if that follows states.
    force : casadi.SX
        Its force along the line of the eyes, N: tension positive, as for :class:`TSDA`. What it pushes with is
        :attr:`effort`, the negative; the power is ``-force * time_derivative(length)``.

    Raises
    ------
    ModelError
        If the two eyes are on one body, or the length is not positive.

    See Also
    --------
    TSDA : its force is given, as `actuator`, and the length follows.
    Cylinder : the force follows from pressures.
    """

    kind = "actuator"
    course = "length"

    def __init__(self, name: str, a: Marker, b: Marker, length: Any, relative_to: Any = None):
        self.name = check_name(name, type(self).__name__)
        self.a, self.b = markers_on_two(a, b, self.description)
        self.length = distance(self.a, self.b)
        super().__init__(name, self.length, length, relative_to)
        self.read(self.value, "length", above=0.0)
        self.markers = (self.a, self.b)
        self.stroke = self.length - ca.substitute(self.value, time, ca.SX(0))

    @property
    def force(self) -> ca.SX:
        """Force with which it pulls its eyes together, N; negative if it pushes."""
        return self.multipliers


def _at_state(expression: ca.SX, state: Any, what: str) -> float:
    """Return the value of the driven expression in a state."""
    try:
        return float(state[expression])
    except (TypeError, KeyError, IndexError):
        raise ModelError(f"{what}: relative_to must be a state, as assemble returns it, got {state!r}") from None
