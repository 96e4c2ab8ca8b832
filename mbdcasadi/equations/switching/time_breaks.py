"""Instants at which what depends on time alone switches: comparisons, splines, steps, absolute values.

An integrator with an adaptive step steps over what begins after rest and ends
again, unless it knows where to stop. The graph of an expression shows these
instants: each operation that switches (a comparison, ``fabs``, ``floor``,
``fmax`` …) is a function ``g(t, p)`` whose zeros, or whose integer values, are
looked for. If ``g`` is affine in time they are exact; else it is sampled,
and the roots are bisected.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...numerics.lazy import cached_property
from ...numerics.scattered import scattered
from .switch_functions import depending_on_time, distinct, divisors_among, time_switches
from .switch_times import SwitchTimes

#: Instants closer than this many units in the last place are one.
SAME_INSTANT = 32
#: Offset from an instant at which its sides are evaluated, relative to the distance of the next one.
SIDE = 1e-6
#: Relative offset for the size of a known jump: limits of ``acos(cos(t))`` are rounded near to its corners.
AWAY_FROM_CORNERS = 1e-3
#: Relative jumps, of a value and of its first and second derivatives, that are more than rounding.
JUMP_TOLERANCES = (1e-11, 1e-8, 1e-7)
#: A transient counts as short below this share of the interval.
SHORT_TRANSIENT = 1 / 20


@dataclass(frozen=True)
class TimeBreaks:
    """Instants at which functions of time switch.

    Attributes
    ----------
    times : numpy.ndarray
        Increasing, inside the interval (k,), s.
    order : numpy.ndarray of int
        Lowest derivative that jumps there (k,): 0 for the value itself, 1, 2,
        or 3 if all of these are continuous (the knot of a spline, the end of a ``step``).
    transients : numpy.ndarray
        Instants and durations (j, 2) of smooth, short changes: the peak of
        ``exp(-((t - 5)/w)**2)``, the middle of ``tanh((t - 5)/w)``.
    width : float
        Distance below which two instants are one, by rounding, s.
    """

    times: np.ndarray
    order: np.ndarray
    transients: np.ndarray
    width: float

    @classmethod
    def none(cls, width: float = 0.0) -> TimeBreaks:
        """No instants at all."""
        return cls(np.zeros(0), np.zeros(0, int), np.zeros((0, 2)), width)


def merge_breaks(parts: Sequence[TimeBreaks]) -> TimeBreaks:
    """Return the breaks of several functions as one; of the same instant the lowest order counts."""
    parts = [part for part in parts if part.times.size or part.transients.size]
    if len(parts) < 2:
        return parts[0] if parts else TimeBreaks.none()
    times, order = (np.concatenate([getattr(part, name) for part in parts]) for name in ("times", "order"))
    place = np.argsort(times, kind="stable")
    times, order = times[place], order[place]
    first = _first_of_each(times, parts[0].width)
    merged = np.minimum.reduceat(order, first) if times.size else order
    return TimeBreaks(times[first], merged, np.vstack([part.transients for part in parts]), parts[0].width)


class TimeFunctions:
    """Parts of expressions that depend on time and known symbols alone, and the instants at which they switch.

    Made once for expressions, evaluated for any values and interval.

    Parameters
    ----------
    expressions : casadi.SX
        Of any shape.
    t : casadi.SX
        Time.
    p : casadi.SX
        Symbols whose values are known (k,).
    others : (casadi.SX, numpy.ndarray), optional
        Other symbols with typical values, at which it is seen what jumps; other ones get values near to one.

    Examples
    --------
    >>> t, k = ca.SX.sym("t"), ca.SX.sym("k")
    >>> TimeFunctions(ca.if_else(t < k, 1, 0), t, k).breaks(np.array([2.0]), 0.0, 10.0).times.tolist()
    [2.0]
    """

    def __init__(self, expressions: ca.SX, t: ca.SX, p: ca.SX, others: tuple[ca.SX, np.ndarray] | None = None):
        self._t, self._p = t, p
        known = ca.vertcat(t, p)
        expressions = ca.vec(ca.densify(expressions))
        self._expressions, self._others = expressions, others
        rest, names, parts = ca.extract_parametric(expressions, known, {})
        column = ca.vertcat(ca.SX(0, 1), *[ca.vec(part) for part in parts])
        timed = np.flatnonzero(ca.which_depends(column, t, 1, True)) if column.numel() else np.zeros(0, int)
        #: maximal subexpressions in time and known symbols alone
        self.parts = column[timed.tolist()] if timed.size else ca.SX(0, 1)
        zeros, integers, transients = time_switches(self.parts, t) if timed.size else ([], [], [])
        # a quotient whose numerator depends on other symbols is not a part, but has its poles in time
        divisors = depending_on_time(divisors_among(rest, names, parts), t) if timed.size else []
        zeros, transients = distinct([*zeros, *divisors]), distinct([*transients, *divisors])
        #: functions of time and known symbols at whose zeros something switches (j,)
        self.switches = ca.vertcat(ca.SX(0, 1), *zeros, *[ca.sin(np.pi * whole) for whole in integers])
        self._zeros = SwitchTimes(zeros, t, p, integer=False)
        self._integers = SwitchTimes(integers, t, p, integer=True)
        self._transients = SwitchTimes(transients, t, p, integer=False)
        #: positions of the known symbols that occur in these
        self.used = np.flatnonzero(ca.which_depends(self.parts, p)) if timed.size and p.numel() else np.zeros(0, int)
        self._last: tuple[Any, TimeBreaks] | None = None

    @property
    def switch(self) -> bool:
        """True if anything may switch in time, or passes quickly."""
        return bool(self._zeros.count or self._integers.count or self._transients.count)

    def breaks(self, p: np.ndarray, start: float, end: float) -> TimeBreaks:
        """Return the instants between two times at values of the known symbols."""
        if not self.switch or not end > start:
            return TimeBreaks.none(resolution(start, end))
        key = (np.asarray(p, float)[self.used].tobytes(), start, end)
        if self._last is None or self._last[0] != key:
            self._last = (key, self._breaks(p, start, end))
        return self._last[1]

    def _breaks(self, p: np.ndarray, start: float, end: float) -> TimeBreaks:
        times = np.zeros(0)
        for level in range(1 + max(self._zeros.depth, self._integers.depth)):
            borders = np.r_[start, times, end]
            roots = [group.roots(level, p, borders) for group in (self._integers, self._zeros)]
            times = _unique(np.concatenate([times, *roots]), start, end)
        transients = self._transients.transients(p, np.r_[start, times, end])
        short = transients[:, 1] < SHORT_TRANSIENT * (end - start)
        return TimeBreaks(times, self.orders(p, start, times, end), transients[short], resolution(start, end))

    @cached_property
    def _whole(self) -> ca.SX:
        """The expressions as functions of time and known symbols, at typical values of the others."""
        if self._others is None:
            known = {symbol.element_hash() for symbol in ca.vertsplit(ca.vertcat(self._t, self._p))}
            rest = [symbol for symbol in ca.symvar(self._expressions) if symbol.element_hash() not in known]
            others = ca.vertcat(ca.SX(0, 1), *rest), 1 + scattered(len(rest)) / 2
        else:
            others = self._others
        return ca.substitute(self._expressions, others[0], ca.DM(others[1]))

    def _derivatives(self, expression: ca.SX) -> ca.Function:
        """``(t, p) -> (f, f', f'')``."""
        first = ca.jacobian(expression, self._t)
        columns = [ca.densify(x) for x in (expression, first, ca.jacobian(first, self._t))]
        return ca.Function("derivatives", [self._t, self._p], columns)

    @cached_property
    def _of_whole(self) -> ca.Function:
        return self._derivatives(self._whole)

    @cached_property
    def _of_parts(self) -> ca.Function:
        return self._derivatives(self.parts)

    def orders(self, p: np.ndarray, start: float, times: np.ndarray, end: float) -> np.ndarray:
        """Lowest derivative of any of the expressions that jumps at each instant (k,); see :class:`TimeBreaks`."""
        if not times.size:
            return np.zeros(0, int)
        left, right, rounding = self.sides(p, start, times, end)
        order = _orders(left, right, rounding)
        # if an expression has no value at the typical values of the other symbols, its parts must do
        unknown = np.any(np.isnan(left[0]) & np.isnan(right[0]), axis=0)
        if np.any(unknown):
            of_parts = _orders(*_sides(self._of_parts, p, start, times, end))
            order[unknown] = np.minimum(order, of_parts)[unknown]
        return order

    def values(self, p: np.ndarray, times: np.ndarray) -> np.ndarray:
        """``f, f', f''`` of the expressions at times (3, expressions, k)."""
        return _values(self._of_whole, p, times)

    def sides(
        self, p: np.ndarray, start: float, times: np.ndarray, end: float, side: float = SIDE
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Limits of ``f, f', f''`` of the expressions on both sides of instants, and their rounding errors.

        Each (3, expressions, k). They are evaluated at a distance `side`, relative to that of the next instant.
        """
        return _sides(self._of_whole, p, start, times, end, side)


def _values(function: ca.Function, p: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.array([x.full() for x in function(times[None, :], p)])


def _sides(
    function: ca.Function, p: np.ndarray, start: float, times: np.ndarray, end: float, side: float = SIDE
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Limits on both sides, and the rounding error; see :meth:`TimeFunctions.sides`."""
    borders = np.r_[start, times, end]
    gap = np.minimum(np.diff(borders)[:-1], np.diff(borders)[1:])
    width = resolution(start, end)
    offset = np.maximum(side * gap, width)
    points = [times - 2 * offset, times - offset, times + offset, times + 2 * offset]
    points += [borders[:-1] + share * np.diff(borders) for share in (0.2, 0.5, 0.8)]
    places = np.cumsum([part.size for part in points])[:-1]
    with np.errstate(invalid="ignore", over="ignore"):
        values = _values(function, p, np.concatenate(points))
        far, near, after, beyond, *_ = np.split(values, places, axis=2)
        scale = np.max(np.where(np.isfinite(values), np.abs(values), 0.0), axis=2)[:, :, None]
        left, right = _at_instant(near, far, -offset), _at_instant(after, beyond, offset)
        # the instant itself is rounded
        rounding = width * np.abs(np.concatenate([left[1:], np.zeros_like(left[:1])]))
    return left, right, np.array(JUMP_TOLERANCES)[:, None, None] * scale + rounding


def _orders(left: np.ndarray, right: np.ndarray, rounding: np.ndarray) -> np.ndarray:
    """Lowest derivative that jumps (k,), of limits on both sides."""
    order = np.full(left.shape[2], 3)
    with np.errstate(invalid="ignore"):
        jump = ~(np.abs(right - left) <= rounding) & ~(np.isnan(left) & np.isnan(right))
    for level in (2, 1, 0):
        order[np.any(jump[level], axis=0)] = level
    return order


def _at_instant(near: np.ndarray, far: np.ndarray, h: np.ndarray) -> np.ndarray:
    """``f, f', f''`` at an instant, extrapolated from those at the distances h and 2 h."""
    second = 2 * near[2] - far[2]
    slope = near[1] - h * (near[2] + second) / 2
    return np.array([near[0] - h * (near[1] + slope) / 2, slope, second])


def resolution(start: float, end: float) -> float:
    """Distance below which two instants of an interval are one, by rounding, s."""
    return SAME_INSTANT * float(np.spacing(max(abs(start), abs(end))))


def _first_of_each(times: np.ndarray, width: float) -> np.ndarray:
    """Places of sorted instants that differ from the one before."""
    return np.flatnonzero(np.diff(times, prepend=-np.inf) > width)


def _unique(times: np.ndarray, start: float, end: float) -> np.ndarray:
    """Distinct instants inside an interval, in order."""
    width = resolution(start, end)
    times = np.sort(times)
    times = times[(times > start + width) & (times < end - width)]
    return times[_first_of_each(times, width)]
