"""Instants at which functions of time pass zero or a whole number.

If a function is affine in time they are exact; else it is sampled, and the roots are bisected.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...numerics.scattered import scattered
from .switch_functions import nesting_depths

#: Samples at first, and at most, on which a function of time that is not affine is looked over for roots.
FEWEST_SAMPLES, MOST_SAMPLES = 512, 2**18
#: Steps in which a bracketed root is found to the last bit: by halving alone in the worst case.
_MOST_STEPS = 60


class SwitchTimes:
    """Functions ``g(t, p)`` whose roots are instants of switching; whose integer values, if `integer`."""

    def __init__(self, functions: Sequence[ca.SX], t: ca.SX, p: ca.SX, *, integer: bool):
        self.count = len(functions)
        self.integer = integer
        self.depth = 0
        if not functions:
            return
        column = ca.densify(ca.vertcat(*functions))
        level = nesting_depths(column, t, p)
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
            rows = [SampledRoots(function, g, p, points, value[g], slope[g], self.integer) for g in range(len(value))]
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
                places = SampledRoots(self._curved, g, p, points, samples, rates, level=level).crossings()
                if places.size:
                    rate = np.abs(self._curved(places[None, :], p)[level + 1].full()[g])
                    with np.errstate(divide="ignore"):
                        transients.append(np.column_stack([places, ((level + 1) / rate) ** (1 / (level + 1))]))
        return np.vstack(transients)


class SampledRoots:
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


def _samples(borders: np.ndarray, count: int) -> np.ndarray:
    """Points of all intervals between borders, not evenly spaced, so that nothing periodic hides between them."""
    each = max(count // (borders.size - 1), 16)
    share = (np.arange(each) + 0.5 + scattered(each) / 4) / each
    width = np.diff(borders)[:, None]
    return (borders[:-1, None] + width * np.r_[1e-9, share, 1 - 1e-9]).ravel()
