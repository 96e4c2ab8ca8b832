"""Extrema of quantities over a motion, between its outputs too."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..model.symbols import as_expression
from ..numerics.tolerances import ACCURACY
from .motion import Motion
from .state import State

#: Parts into which the time around a candidate is divided, and how often: to a part in 10⁹ of that between two knots.
NARROWER, ROUNDS = 16, 10
#: Values that are evaluated at once.
CHUNK = 20_000
#: By how much a value between three others may exceed them, in their second difference: of a parabola 1/8.
GAIN = 2.0


class Extremum:
    """The largest or smallest value of a quantity over a motion.

    Attributes
    ----------
    value : float
        The value.
    t : float
        Its time, s: the first one if it is reached several times; of a value just after a jump the next number.
    """

    def __init__(self, motion: Motion, t: float, value: float):
        self._motion, self.t, self.value = motion, t, value

    @property
    def state(self) -> State:
        """State at that time."""
        return self._motion.at(self.t).state(0)

    def __repr__(self) -> str:
        return f"{self.value:.6g} at t = {self.t:.6g} s"


def extremum(motion: Motion, expression: Any, sign: int, what: str) -> Extremum:
    """Find the largest value of an expression over a motion, or for sign -1 the smallest.

    Raises
    ------
    MechanismError
        For other than a scalar, and for one that has no value at any time.
    """
    expression = as_expression(expression, f"motion.{what}(…)")
    if expression.numel() != 1:
        raise MechanismError(f"motion.{what} takes a scalar, got an expression of shape {expression.shape}; take norm")
    if not len(motion):
        raise MechanismError(f"motion.{what}: the trajectory holds no times")
    _ = motion.knots  # which one that was made from arrays alone does not have
    t, values = motion.fine.t, sign * motion.fine[expression]
    if np.all(np.isnan(values)):
        raise MechanismError(f"motion.{what}: the expression has no value at any time of the motion")
    values = np.where(np.isnan(values), -np.inf, values)
    jumps = np.diff(t) <= 4 * np.spacing(np.abs(t[1:]))
    low = np.where(np.r_[True, jumps], t, np.r_[t[0], t[:-1]])
    high = np.where(np.r_[jumps, True], t, np.r_[t[1:], t[-1]])
    best, found = _best(t, values)
    before, after = np.r_[-np.inf, values[:-1]], np.r_[values[1:], -np.inf]
    peaks = (low == t) | (values >= before)
    peaks &= (high == t) | (values >= after)
    near = np.where(low == t, values, before), np.where(high == t, values, after)
    with np.errstate(invalid="ignore"):
        gain = np.nan_to_num(GAIN * (2 * values - near[0] - near[1]), nan=0.0)
    open_ = peaks & (values + gain > best) & (high > low)
    low, high = low[open_], high[open_]
    for _ in range(ROUNDS):
        if not low.size:
            break
        grid = low[:, None] + np.arange(NARROWER + 1) / NARROWER * (high - low)[:, None]
        heights = _values(motion, expression, sign, grid.ravel()).reshape(grid.shape)
        heights = np.where(np.isnan(heights), -np.inf, heights)
        place = np.argmax(heights, axis=1)
        rows = np.arange(low.size)
        peak = heights[rows, place]
        left, right = np.maximum(place - 1, 0), np.minimum(place + 1, NARROWER)
        now = _best(grid[rows, place], peak)
        if now[0] > best:
            best, found = now
        low, high = grid[rows, left], grid[rows, right]
        with np.errstate(invalid="ignore"):
            gain = np.nan_to_num(GAIN * (2 * peak - heights[rows, left] - heights[rows, right]), nan=0.0)
        open_ = (peak + gain > best * (1 - ACCURACY * np.sign(best))) & (high > low)
        low, high = low[open_], high[open_]
    return Extremum(motion, found, float(np.atleast_1d(motion.at(found)[expression])[0]))


def _best(t: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """Largest value, and the first time at which it is reached."""
    best = float(np.max(values))
    return best, float(t[np.argmax(values >= best - ACCURACY * abs(best))])


def _values(motion: Motion, expression: ca.SX, sign: int, times: np.ndarray) -> np.ndarray:
    """Values at times, of which no others need be known."""
    order = np.argsort(times, kind="stable")
    values = np.empty(times.size)
    for k in range(0, times.size, CHUNK):
        some = order[k : k + CHUNK]
        values[some] = sign * motion.at(times[some])[expression]
    return values
