"""A root of a scalar function between two points."""

from __future__ import annotations

from collections.abc import Callable


def bracketed_root(
    function: Callable[[float], float], low: float, high: float, at_low: float, at_high: float, accuracy: float
) -> float:
    """Return the point right of the root of a function that changes sign (ITP-safe regula falsi, Illinois variant).

    Parameters
    ----------
    function : callable
        Continuous; ``at_low`` and ``at_high``, its values at the ends, differ in sign.
    accuracy : float
        Largest width of the bracket that is left.
    """
    side = 0
    for _ in range(100):
        if high - low <= accuracy or at_high == 0:
            break
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < middle < high:
            middle = (low + high) / 2
        value = function(middle)
        if value == 0 or (value > 0) == (at_high > 0):
            high, at_high = middle, value
            if side == 1:
                at_low /= 2
            side = 1
        else:
            low, at_low = middle, value
            if side == -1:
                at_high /= 2
            side = -1
    return high
