"""Rates of change of expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..errors import ExpressionError
from .symbols import Expression, as_expression, describe, role_of, symbols_of


def time_derivative(expression: Expression, mechanism: Any = None) -> ca.SX:
    """Return the rate of change of an expression, by the chain rule.

    ``de/dt = e_q v + e_v a + e_z ż + e_t``

    Parameters
    ----------
    expression : casadi.SX
        Any shape, in coordinates, velocities, first-order states, parameters and time.
    mechanism : Mechanism, optional
        Required if first-order states occur, whose rates it has.

    Returns
    -------
    casadi.SX
        Same shape. Velocities give accelerations, and inputs give ``Input.rate``, which
        exists in optimal control only.

    Raises
    ------
    ExpressionError
        If the expression contains an acceleration or a multiplier, whose rates are not known.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=1)
    >>> mbd.time_derivative(mbd.sin(arm.phi))
    SX((cos(arm.phi)*arm.omega))
    """
    expression = as_expression(expression, "time_derivative")
    rates = {} if mechanism is None else {s.element_hash(): r for s, r in mechanism.state_rates.items()}
    varying, rate = [], []
    for symbol in symbols_of(expression):
        role = role_of(symbol)
        if role is not None and role.kind == "parameter":
            continue
        its_rate = rates.get(symbol.element_hash(), None if role is None else role.rate)
        if its_rate is None:
            is_state = role is not None and role.kind == "state"
            hint = "; give the mechanism as second argument, or, in a force, write its rate out" if is_state else ""
            raise ExpressionError(f"time_derivative: the model does not know the rate of {describe(symbol)}{hint}")
        varying.append(symbol)
        rate.append(its_rate)
    if not varying:
        return ca.SX(*expression.shape)
    derivative = ca.jtimes(ca.vec(expression), ca.vertcat(*varying), ca.vertcat(*rate))
    return ca.reshape(derivative, *expression.shape)
