"""Drivers: constraints that prescribe a motion in time."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..errors import ModelError
from .element import BEYOND_COORDINATES, ConstraintElement, holds_coordinates, refuse_kinds
from .geometry.splines import expression_of
from .quantities import no_relation, quantity
from .symbols import Scalar
from .symbols import t as time


class Driver(ConstraintElement):
    """Prescribed motion: ``Phi = expression - value(t)`` (1 row).

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        Driven quantity: a scalar in coordinates (``joint.angle``, ``marker.x``), m or rad.
    value : float, expression in time and parameters, or spline of SciPy
        Its prescribed course, twice differentiable: ``20 * mbd.t``, a
        ``mbd.spline`` through data, a ``MotionProgram`` of the time.
    relative_to : State, optional
        State, such as :func:`assemble` returns, from which the motion continues: the course is then
        ``expression + value(t) - value(t_0)`` with the expression and the time ``t_0`` of that state.

    Attributes
    ----------
    effort : casadi.SX
        Force or torque that the driver supplies along `expression`, ``-lam``; its
        power is ``effort * time_derivative(expression)``.

    References
    ----------
    Haug 1989, section 3.5 (driving constraints).
    """

    kind = "driver"

    def __init__(self, name: str, expression: Scalar, value: Any, relative_to: Any = None):
        what = f"driver '{name}'"
        self.expression = ca.SX(no_relation(quantity(expression, what, "expression"), what, "expression"))
        course = ca.SX(quantity(expression_of(time, value), what, "value"))
        refuse_kinds(self.expression, BEYOND_COORDINATES, what, "a driver prescribes coordinates")
        beyond = ("position", *BEYOND_COORDINATES)
        refuse_kinds(course, beyond, what, "its value is a function of time and parameters")
        if not holds_coordinates(self.expression):
            raise ModelError(f"{what}: the expression {expression} depends on no coordinate")
        self.value = course
        if relative_to is not None:
            start = _at_state(self.expression, relative_to, what)
            self.value = course + start - ca.substitute(course, time, ca.SX(relative_to.t))
        super().__init__(name, self.expression - self.value)

    @property
    def effort(self) -> ca.SX:
        """Force (N) or torque (N m) that the driver supplies."""
        return -self.multipliers


def _at_state(expression: ca.SX, state: Any, what: str) -> float:
    """Return the value of the driven expression in a state."""
    try:
        return float(state[expression])
    except (TypeError, KeyError, IndexError):
        raise ModelError(f"{what}: relative_to must be a state, as assemble returns it, got {state!r}") from None
