"""Numbers and expressions given by the user, checked where they enter."""

from __future__ import annotations

import math
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from .symbols import Parameter, number


def known_value(value: Any) -> float | None:
    """Number behind a constant, a parameter or a plain number; None for other expressions."""
    if isinstance(value, Parameter):
        return value.value
    if isinstance(value, ca.SX):
        return float(value) if value.is_constant() and value.numel() == 1 else None
    return float(value)


def quantity(
    value: Any,
    what: str,
    name: str,
    *,
    at_least: float | None = None,
    above: float | None = None,
) -> float | ca.SX:
    """Return a scalar quantity: a float where it is a number, else the expression.

    Parameters
    ----------
    value : float or casadi.SX
        What the user gave.
    what, name : str
        Element and quantity, for the message.
    at_least, above : float, optional
        Limits of the value, where the number behind it is known.

    Raises
    ------
    ModelError
        For what is no scalar, not finite or out of its limits.
    """
    if isinstance(value, ca.MX):
        raise ModelError(f"{what}: {name} is a casadi.MX; the model is written in casadi.SX")
    if not isinstance(value, ca.SX):
        if isinstance(value, ca.DM | np.ndarray):
            array = value.full() if isinstance(value, ca.DM) else value
            if array.size != 1:
                raise ModelError(f"{what}: {name} must be a scalar, got an array of {array.size} values")
            value = array.reshape(-1)[0]
        value = number(value, what, name)
    elif value.numel() != 1:
        raise ModelError(f"{what}: {name} must be a scalar, got an expression of shape {value.shape}")
    known = known_value(value)
    if known is not None:
        if not math.isfinite(known):
            raise ModelError(f"{what}: {name} must be finite, got {known}")
        if at_least is not None and known < at_least:
            raise ModelError(f"{what}: {name} must be at least {at_least:g}, got {known}")
        if above is not None and known <= above:
            raise ModelError(f"{what}: {name} must be above {above:g}, got {known}")
    if isinstance(value, ca.SX) and not isinstance(value, Parameter) and known is not None:
        return known
    return value


def vector2(value: Any, what: str, name: str) -> ca.SX:
    """Return a plane vector (2,) as an expression."""
    if isinstance(value, ca.SX | ca.DM):
        parts = list(ca.vertsplit(ca.vec(ca.SX(value)))) if value.numel() == 2 else []
    else:
        try:
            parts = list(value)
        except TypeError:
            parts = []
    if len(parts) != 2:
        raise ModelError(f"{what}: {name} must have two components, got {value!r}")
    return ca.vertcat(*[ca.SX(quantity(p, what, f"{name} {axis}")) for p, axis in zip(parts, "xy", strict=True)])


def triple(value: Any, what: str, name: str, form: str) -> np.ndarray:
    """Return three finite numbers as an array (3,)."""
    try:
        values = [number(v, what, name) for v in value]
    except TypeError:
        raise ModelError(f"{what}: {name} must be three numbers {form}, got {value!r}") from None
    if len(values) != 3:
        raise ModelError(f"{what}: {name} must be three numbers {form}, got {len(values)} of them: {value!r}")
    return np.array(values)
