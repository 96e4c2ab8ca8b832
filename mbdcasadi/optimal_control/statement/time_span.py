"""Times that are given, or free between limits."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ...model.symbols import number


class TimeSpan(tuple[float, float]):
    """Limits of a time, s, and the value to begin with, if one was given."""

    guess: float | None

    def __new__(cls, limits: tuple[float, float], guess: float | None = None) -> TimeSpan:
        """Make it of the lower and the upper limit."""
        span = super().__new__(cls, limits)
        span.guess = guess
        return span

    @property
    def typical(self) -> float:
        """The time to begin with, s: the guess, or else the geometric mean of the limits."""
        low, high = self
        if self.guess is not None:
            return self.guess
        return high if low == high else (low * high) ** 0.5 if low > 0 else high / 2

    def __repr__(self) -> str:
        low, high = self
        return f"({low:g}, {high:g})" if self.guess is None else f"between({low:g}, {high:g}, guess={self.guess:g})"


def between(lower: float, upper: float, *, guess: float) -> TimeSpan:
    """Return a time that is free between limits, with a guess, for a duration or the time of a waypoint.

    Optimal control begins there; a plain pair ``(lower, upper)`` begins at the geometric mean, waypoints evenly spaced.

    Parameters
    ----------
    lower, upper : float
        Limits, s.
    guess : float
        Time to begin with, s, within the limits.

    Returns
    -------
    TimeSpan
        ``(lower, upper)``, with the attribute ``guess``.

    Raises
    ------
    ModelError
        If the guess lies outside the limits.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.between(1, 30, guess=9)
    between(1, 30, guess=9)
    """
    low, high, first = (
        number(value, "between", name) for value, name in ((lower, "lower"), (upper, "upper"), (guess, "guess"))
    )
    if not 0 <= low <= first <= high or first == 0:
        raise ModelError(
            f"between: the guess must be positive and within the limits, got {guess!r} for {lower!r} … {upper!r} s"
        )
    return TimeSpan((low, high), first)


def time_span(value: Any, what: str, name: str, *, instant: bool = False) -> TimeSpan:
    """Return a time or a range of times, s; `instant` allows a duration of 0."""
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
    if instant and low == high == 0:
        return TimeSpan((0.0, 0.0))
    if low < 0 or high < low or high == 0:
        raise ModelError(f"{what}: {name} must be positive and the limits in order, got {value!r}")
    return TimeSpan((low, high), value.guess if isinstance(value, TimeSpan) else None)


def span_text(span: tuple[float, float]) -> str:
    """Return a time, or a range of times, in words."""
    low, high = span
    return f"{low:g} s" if low == high else f"{low:g} … {high:g} s"
