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
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

#: Functions that switch when their operands compare: ``a - b`` is zero.
_COMPARE = (ca.OP_LT, ca.OP_LE, ca.OP_EQ, ca.OP_NE, ca.OP_FMIN, ca.OP_FMAX)
#: Functions that switch, or have no derivative, when their operand is zero.
_AT_ZERO = (ca.OP_FABS, ca.OP_SIGN, ca.OP_SQRT, ca.OP_LOG, ca.OP_INV)
#: Functions that switch when their operand is an integer.
_AT_INTEGERS = (ca.OP_FLOOR, ca.OP_CEIL)
#: Operations that switch. The values of comparisons are compared in their turn by and, or, not and if_else.
_SWITCHING = (
    *_COMPARE, *_AT_ZERO, *_AT_INTEGERS, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN, ca.OP_ATAN2, ca.OP_DIV,
    ca.OP_ASIN, ca.OP_ACOS, ca.OP_TAN, ca.OP_POW, ca.OP_CONSTPOW,
)  # fmt: skip
#: Operations that may bring a short transient about, when their operand is zero, or largest or smallest.
_TRANSIENT = (ca.OP_EXP, ca.OP_EXPM1, ca.OP_TANH, ca.OP_ERF, ca.OP_ATAN, ca.OP_DIV, ca.OP_INV)

#: Operations that switch with the motion.
_IN_STATE = (*_COMPARE, *_AT_INTEGERS, ca.OP_FABS, ca.OP_SIGN, ca.OP_COPYSIGN, ca.OP_FMOD, ca.OP_REMAINDER)
#: Operations by whose values geometry divides: the lengths of springs, and powers of these.
_OF_GEOMETRY = (ca.OP_SQRT, ca.OP_CONST, ca.OP_HYPOT) if hasattr(ca, "OP_HYPOT") else (ca.OP_SQRT, ca.OP_CONST)

#: Samples at first, and at most, on which a function of time that is not affine is looked over for roots.
FEWEST_SAMPLES, MOST_SAMPLES = 512, 2**18
#: Instants closer than this many units in the last place are one.
SAME_INSTANT = 32
#: Offset from an instant at which its sides are evaluated, relative to the distance of the next one.
SIDE = 1e-6
#: The same for the size of a jump that is known: limits of ``acos(cos(t))`` are rounded near to its corners.
AWAY_FROM_CORNERS = 1e-3
#: Relative jumps, of a value and of its first and second derivatives, that are more than rounding.
JUMP_TOLERANCES = (1e-11, 1e-8, 1e-7)
#: A transient counts as short below this share of the interval.
SHORT_TRANSIENT = 1 / 20
#: Steps in which a bracketed root is found to the last bit: by halving alone in the worst case.
_MOST_STEPS = 60


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
        Instants and durations (j, 2) of what is smooth and short: the peak of
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

    @property
    def jumps(self) -> np.ndarray:
        """Instants at which a value jumps."""
        return self.times[self.order == 0]

    def sides(self) -> tuple[np.ndarray, np.ndarray]:
        """Instants just before and just after, at which every comparison has the truth of that side."""
        return self.times - self.width, self.times + self.width


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
        zeros, integers, transients = _switches(self.parts, t, p) if timed.size else ([], [], [])
        # a quotient whose numerator depends on other symbols is no part, but has its poles in time
        divisors = _timed(_divisors(rest, names, parts), t) if timed.size else []
        zeros, transients = _distinct([*zeros, *divisors]), _distinct([*transients, *divisors])
        self._zeros = _Switches(zeros, t, p, integer=False)
        self._integers = _Switches(integers, t, p, integer=True)
        self._transients = _Switches(transients, t, p, integer=False)
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
            others = ca.vertcat(ca.SX(0, 1), *rest), np.random.default_rng(0).uniform(0.5, 1.5, len(rest))
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
        """Limits of ``f, f', f''`` of the expressions before and after instants, and what is rounding between them.

        Each (3, expressions, k). They are evaluated at a distance `side`, relative to that of the next instant.
        """
        return _sides(self._of_whole, p, start, times, end, side)


def _values(function: ca.Function, p: np.ndarray, times: np.ndarray) -> np.ndarray:
    return np.array([x.full() for x in function(times[None, :], p)])


def _sides(
    function: ca.Function, p: np.ndarray, start: float, times: np.ndarray, end: float, side: float = SIDE
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Limits on both sides, and what is rounding; see :meth:`TimeFunctions.sides`."""
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


class _Switches:
    """Functions ``g(t, p)`` whose roots are instants of switching; whose integer values, if `integer`."""

    def __init__(self, functions: Sequence[ca.SX], t: ca.SX, p: ca.SX, *, integer: bool):
        self.count = len(functions)
        self.integer = integer
        self.depth = 0
        if not functions:
            return
        column = ca.densify(ca.vertcat(*functions))
        level = _depths(column, t, p)
        self.depth = int(np.max(level))
        slope = ca.densify(ca.jacobian(column, t))
        curvature = ca.jacobian(slope, t)
        bent = set(np.flatnonzero(ca.which_depends(column, t, 2, True)).tolist())
        affine = np.array([k not in bent or ca.SX(curvature[k]).is_zero() for k in range(self.count)])
        self._groups = {
            (d, straight): ca.Function("switches", [t, p], [column[chosen], slope[chosen]])
            for d in range(self.depth + 1)
            for straight in (True, False)
            if (chosen := np.flatnonzero((level == d) & (affine == straight)).tolist())
        }
        self._curved = ca.Function("transients", [t, p], [column, slope, ca.densify(curvature)])

    def roots(self, level: int, p: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """Roots of the functions of one depth of nesting; between two borders those of lower depth do not switch."""
        roots = [np.zeros(0)]
        for straight, search in ((True, self._affine_roots), (False, self._sampled_roots)):
            if self.count and (level, straight) in self._groups:
                roots.append(search(self._groups[level, straight], p, borders))
        return np.concatenate(roots)

    def _affine_roots(self, function: ca.Function, p: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """Roots of functions that are affine between borders."""
        low, high = borders[:-1], borders[1:]
        middle = (low + high) / 2
        value, slope = (x.full() for x in function(middle[None, :], p))
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            root = middle - value / slope
            if not self.integer:
                inside = (root >= low) & (root <= high)
                root = root[inside]
                return root[np.isfinite(root)]
            half = np.abs(slope) * (high - low) / 2
            lowest, highest = np.ceil(value - half), np.floor(value + half)
        roots = []
        moving = np.isfinite(value) & np.isfinite(slope) & (slope != 0) & (highest >= lowest)
        for g, k in np.argwhere(moving):
            integers = np.arange(lowest[g, k], highest[g, k] + 1)
            roots.append(middle[k] + (integers - value[g, k]) / slope[g, k])
        return np.concatenate([np.zeros(0), *roots])

    def _sampled_roots(self, function: ca.Function, p: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """Roots of other functions: samples are made denser until no more of them appear."""
        count, known = FEWEST_SAMPLES, [-1, -2]
        while True:
            points = _samples(borders, count)
            value, slope = (x.full() for x in function(points[None, :], p))
            rows = [_Sampled(function, g, p, points, value[g], slope[g], self.integer) for g in range(len(value))]
            known.append(sum(row.count for row in rows))
            if known[-1] == known[-2] == known[-3] or count >= MOST_SAMPLES:
                return np.concatenate([row.roots() for row in rows])
            count *= 2

    def transients(self, p: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """Instants at which a function is zero, largest or smallest, and how long it takes to change by one (k, 2)."""
        if not self.count:
            return np.zeros((0, 2))
        points = _samples(borders, FEWEST_SAMPLES)
        value, slope, bend = (x.full() for x in self._curved(points[None, :], p))
        transients = [np.zeros((0, 2))]
        for g in range(self.count):
            for level, samples, rates in ((0, value[g], slope[g]), (1, slope[g], bend[g])):
                places = _Sampled(self._curved, g, p, points, samples, rates, level=level).crossings()
                if places.size:
                    rate = np.abs(self._curved(places[None, :], p)[level + 1].full()[g])
                    with np.errstate(divide="ignore"):
                        transients.append(np.column_stack([places, ((level + 1) / rate) ** (1 / (level + 1))]))
        return np.vstack(transients)


class _Sampled:
    """One row of a compiled column of functions and their derivatives, sampled over time.

    Parameters
    ----------
    function : casadi.Function
        ``(t, p) -> (values, first derivatives, …)``.
    row : int
        Index of the function.
    p : numpy.ndarray
        Values of the known symbols.
    points, value, slope : numpy.ndarray
        Samples (k,).
    integer : bool
        True to look for integer values instead of zeros.
    level : int
        Derivative of the function that is meant.
    """

    def __init__(
        self,
        function: ca.Function,
        row: int,
        p: np.ndarray,
        points: np.ndarray,
        value: np.ndarray,
        slope: np.ndarray,
        integer: bool = False,
        level: int = 0,
    ):
        self._function, self._row, self._p, self._level = function, row, p, level
        self._points, self._value, self._integer = points, value, integer
        with np.errstate(invalid="ignore", over="ignore"):
            if integer:
                self._passed = np.flatnonzero(np.abs(np.diff(np.floor(value))) > 0)
                self._dips = np.zeros(0, int)
            else:
                sign = np.sign(value)
                self._passed = np.flatnonzero(sign[:-1] * sign[1:] < 0)
                dips = (sign[:-1] * sign[1:] > 0) & (slope[:-1] * value[:-1] < 0) & (slope[1:] * value[1:] > 0)
                self._dips = np.flatnonzero(dips)

    @property
    def count(self) -> int:
        """Number of roots that the samples show."""
        return self._passed.size + self._dips.size

    def roots(self) -> np.ndarray:
        """Roots at which the sign changes, and at which zero is only touched."""
        return np.concatenate([self.crossings(), self._touching()])

    def crossings(self) -> np.ndarray:
        """Points at which the value changes its sign, or passes integers."""
        points, value, k = self._points, self._value, self._passed
        if not self._integer:
            inside = slice(1, -1)
            exact = points[inside][value[inside] == 0] if np.any(value) else np.zeros(0)
            return np.r_[exact, self._root(points[k], points[k + 1], value[k])]
        steps = np.floor(value)
        ends = [np.sort(steps[[i, i + 1]]) for i in k]
        integers = [np.arange(first + 1, last + 1) for first, last in ends]
        owner = np.repeat(k, [each.size for each in integers])
        target = np.concatenate([np.zeros(0), *integers])
        return self._root(points[owner], points[owner + 1], value[owner] - target, target)

    def _touching(self) -> np.ndarray:
        """Points at which the value reaches zero between two samples without a change of sign at these."""
        points, value, k = self._points, self._value, self._dips
        if not k.size:
            return np.zeros(0)
        low, high = points[k], points[k + 1]
        at_low, at_high = (self._evaluated(ends)[self._level + 1] for ends in (low, high))
        places = self._root(low, high, at_low, level=self._level + 1)
        there = self._evaluated(places)[self._level]
        curvature = np.abs(at_high - at_low) / (high - low)
        touched = np.abs(there) <= 1e-12 * curvature * (points[-1] - points[0]) ** 2
        through = ~touched & (there * value[k] < 0)
        before = self._root(low[through], places[through], value[k][through])
        behind = self._root(places[through], high[through], there[through])
        return np.r_[places[touched], before, behind]

    def _evaluated(self, points: np.ndarray) -> list[np.ndarray]:
        return [x.full()[self._row] for x in self._function(points[None, :], self._p)]

    def _root(
        self,
        low: np.ndarray,
        high: np.ndarray,
        at_low: np.ndarray,
        target: np.ndarray | float = 0.0,
        level: int | None = None,
    ) -> np.ndarray:
        """Roots in brackets, all at once, by Newton steps that stay inside, and halving (k,)."""
        level = self._level if level is None else level
        low, high, x = low.copy(), high.copy(), (low + high) / 2
        for _ in range(_MOST_STEPS if low.size else 0):
            values = self._evaluated(x)
            value = values[level] - target
            same = np.sign(value) == np.sign(at_low)
            low, high = np.where(same, x, low), np.where(same, high, x)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = value / values[level + 1] if len(values) > level + 1 else np.full(x.size, np.nan)
                aimed = x - step
            inside = (aimed > low) & (aimed < high)
            done = (value == 0) | (high - low <= 2 * np.spacing(np.abs(high)))
            done |= inside & (np.abs(step) <= np.spacing(np.abs(x)))
            if np.all(done):
                break
            x = np.where(done, x, np.where(inside, aimed, (low + high) / 2))
        return x


def _switches(parts: ca.SX, t: ca.SX, p: ca.SX) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
    """Functions that switch at zero, that switch at integers, and that bring a transient about."""
    function = ca.Function("parts", [t, p], [parts])
    nodes = function.instructions_sx()
    wanted = set(_SWITCHING) | set(_TRANSIENT)
    zeros, integers, transients = [], [], []
    for k, op in enumerate(map(function.instruction_id, range(function.n_instructions()))):
        if op not in wanted:
            continue
        node = nodes[k]
        a = node.dep(0)
        b = node.dep(1) if node.n_dep() > 1 else a
        if op in _COMPARE:
            zeros.append(a - b)
        elif op in _AT_ZERO:
            zeros.append(a)
        elif op in _AT_INTEGERS:
            integers.append(a)
        elif op in (ca.OP_FMOD, ca.OP_REMAINDER):
            integers.append(a / b - (0.5 if op == ca.OP_REMAINDER else 0.0))
        elif op in (ca.OP_COPYSIGN, ca.OP_DIV):
            zeros.append(b)
        elif op in (ca.OP_ATAN2, ca.OP_POW, ca.OP_CONSTPOW):
            zeros.append(a)
        elif op in (ca.OP_ASIN, ca.OP_ACOS):
            zeros.append(a * a - 1)
        elif op == ca.OP_TAN:
            zeros.append(ca.cos(a))
        if op in _TRANSIENT:
            transients.append(b if op == ca.OP_DIV else a)
    return _timed(zeros, t), _timed(integers, t), _timed(transients, t)


def state_switches(expressions: ca.SX, state: ca.SX, unknown: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Functions of a state at whose zeros expressions switch, and at whose zeros or extrema they may pass quickly.

    Parameters
    ----------
    expressions : casadi.SX
        Of any shape.
    state : casadi.SX
        Symbols on one of which a function must depend.
    unknown : casadi.SX
        Symbols on none of which it may depend.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> state_switches(ca.if_else(x > 2, ca.exp(-(x**2)), 0), x, ca.SX(0, 1))
    ([SX((2-x))], [SX((-sq(x)))])
    """
    symbols = ca.vertcat(ca.SX(0, 1), *ca.symvar(expressions))
    function = ca.Function("expressions", [symbols], [ca.vec(ca.densify(expressions))])
    nodes = function.instructions_sx()
    switches, transients = [], []
    for k, op in enumerate(map(function.instruction_id, range(function.n_instructions()))):
        if op not in _IN_STATE and op not in _TRANSIENT:
            continue
        node = nodes[k]
        operands = [node.dep(i) for i in range(node.n_dep())]
        if op in _COMPARE:
            switches.append(operands[0] - operands[1])
        elif op in (ca.OP_FABS, ca.OP_SIGN, ca.OP_COPYSIGN):
            switches.append(operands[-1])
        elif op in (*_AT_INTEGERS, ca.OP_FMOD, ca.OP_REMAINDER):
            whole = operands[0] if op in _AT_INTEGERS else operands[0] / operands[1]
            switches.append(ca.sin(np.pi * (whole + (0.5 if op == ca.OP_REMAINDER else 0.0))))
        elif operands[-1].op() not in _OF_GEOMETRY:
            transients.append(operands[-1])
    return _moving(switches, state, unknown), _moving(transients, state, unknown)


def _moving(functions: list[ca.SX], state: ca.SX, unknown: ca.SX) -> list[ca.SX]:
    """Those of the functions that depend on a state and on nothing unknown, each once."""
    functions = _distinct(functions)
    if not functions:
        return []
    column = ca.vertcat(*functions)
    moving = ca.which_depends(column, state, 1, True)
    blurred = ca.which_depends(column, unknown, 1, True) if unknown.numel() else [False] * len(functions)
    return [f for f, moves, blur in zip(functions, moving, blurred, strict=True) if moves and not blur]


def _divisors(rest: ca.SX, names: Sequence[ca.SX], parts: Sequence[ca.SX]) -> list[ca.SX]:
    """Those of the parts by which other expressions are divided."""
    known = {name.element_hash(): part for name, part in zip(names, parts, strict=True)}
    function = ca.Function("rest", ca.symvar(rest), [rest])
    nodes = function.instructions_sx()
    operations = map(function.instruction_id, range(function.n_instructions()))
    divisors = [nodes[k].dep(1) for k, op in enumerate(operations) if op == ca.OP_DIV]
    return [known[node.element_hash()] for node in divisors if node.element_hash() in known]


def _timed(functions: list[ca.SX], t: ca.SX) -> list[ca.SX]:
    """Those of the functions that depend on time, each once."""
    functions = _distinct(functions)
    flags = ca.which_depends(ca.vertcat(*functions), t, 1, True) if functions else []
    return [f for f, flag in zip(functions, flags, strict=True) if flag]


def _distinct(functions: list[ca.SX]) -> list[ca.SX]:
    return list({f.element_hash(): f for f in functions}.values())


def _depths(column: ca.SX, t: ca.SX, p: ca.SX) -> np.ndarray:
    """Number of operations that switch, nested in each of the functions (k,)."""
    function = ca.Function("depths", [t, p], [column])
    operations = list(map(function.instruction_id, range(function.n_instructions())))
    level = np.zeros(column.numel(), int)
    if not set(operations) & set(_SWITCHING):
        return level
    work: dict[int, int] = {}
    for k, op in enumerate(operations):
        places, to = function.instruction_input(k), function.instruction_output(k)
        if op in (ca.OP_INPUT, ca.OP_CONST):
            work[to[0]] = 0
        elif op == ca.OP_OUTPUT:
            level[to[1]] = work[places[0]]
        else:
            work[to[0]] = max(work[place] for place in places) + (op in _SWITCHING)
    return level


def _samples(borders: np.ndarray, count: int) -> np.ndarray:
    """Points of all intervals between borders, not evenly spaced, so that nothing periodic hides between them."""
    each = max(count // (borders.size - 1), 16)
    share = (np.arange(each) + np.random.default_rng(0).uniform(0.25, 0.75, each)) / each
    width = np.diff(borders)[:, None]
    return (borders[:-1, None] + width * np.r_[1e-9, share, 1 - 1e-9]).ravel()


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
