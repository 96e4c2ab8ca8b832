"""Conditions at times between the start and the end of a motion."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..errors import ModelError
from ..model.conditions import Condition, read_conditions
from ..model.immutable import Immutable
from ..model.symbols import number


def time_span(value: Any, what: str, name: str) -> tuple[float, float]:
    """A time or a span of times as ``(lower, upper)``."""
    if isinstance(value, ca.SX):
        raise ModelError(
            f"{what}: {name} is a number or a pair (lower, upper), not an expression; a pair is free between"
        )
    try:
        low, high = value
    except TypeError:
        low = high = value
    except ValueError:
        raise ModelError(f"{what}: {name} is a number or a pair (lower, upper), got {value!r}") from None
    low, high = number(low, what, name), number(high, what, name)
    if low < 0 or high < low or high == 0:
        raise ModelError(f"{what}: {name} must be positive and the limits in order, got {value!r}")
    return low, high


class Waypoint(Immutable):
    """Conditions that a motion meets on its way.

    Parameters
    ----------
    time : float or (float, float)
        When, s; two numbers: free between them.
    conditions : sequence of relations, default ()
        In any expression of the model; accelerations, reactions and inputs are
        those just before that time. Without conditions a mesh point is put there,
        such as where an input jumps.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> cart = mbd.Body("cart", mass=1, inertia=1)
    >>> mbd.Waypoint((0.2, 0.8), [cart.x == 0.5, cart.y >= 0.1])
    Waypoint(0.2 … 0.8 s: cart.x == 0.5, 0.1 <= cart.y)
    """

    def __init__(self, time: Any, conditions: Any = ()):
        self.time = time_span(time, "Waypoint", "time")
        self.conditions: tuple[Condition, ...] = read_conditions(conditions)

    def __repr__(self) -> str:
        low, high = self.time
        time = f"{low:g} s" if low == high else f"{low:g} … {high:g} s"
        return f"Waypoint({time}{': ' if self.conditions else ''}{', '.join(c.label for c in self.conditions)})"
