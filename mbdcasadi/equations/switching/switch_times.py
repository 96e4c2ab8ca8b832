"""Instants at which functions of time pass zero or a whole number.

If a function is affine in time they are exact; else it is sampled, and the roots are bisected.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...numerics.roots import TO_ROUNDING, narrowed_roots, sign_changes
from ...numerics.scattered import scattered
from .switch_functions import nesting_depths

#: Samples, at first and at most, between which the roots of a function of time that is not affine are looked for.
FEWEST_SAMPLES, MOST_SAMPLES = 512, 2**18


class SwitchTimes:
    """Functions ``g(t, p)`` whose roots are instants of switching; whose integer values, if `integer`."""

    def __init__(self, functions: Sequence[ca.SX], t: ca.SX, p: ca.SX, *, integer: bool):
        self.count = len(functions)
        self.integer = integer
        self.depth = 0
        if not functions:
            return
        column = ca.densify(ca.vertcat(*functions))
        level = nesting_depths(column)
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
            roots = SampledRoots(function, p, _samples(borders, count), integer=self.integer)
            known.append(roots.count)
            if known[-1] == known[-2] == known[-3] or count >= MOST_SAMPLES:
                return roots.roots()
            count *= 2

    def transients(self, p: np.ndarray, borders: np.ndarray) -> np.ndarray:
        """Instants at which a function is zero, largest or smallest, and how long it takes to change by one (k, 2)."""
        if not self.count:
            return np.zeros((0, 2))
        points, transients = _samples(borders, FEWEST_SAMPLES), [np.zeros((0, 2))]
        for level in (0, 1):
            rows, places = SampledRoots(self._curved, p, points, level=level).crossings()
            if places.size:
                rate = np.abs(_evaluated(self._curved, p, rows, places)[level + 1])
                with np.errstate(divide="ignore"):
                    transients.append(np.column_stack([places, ((level + 1) / rate) ** (1 / (level + 1))]))
        return np.vstack(transients)


class SampledRoots:
    """Roots of a compiled column of functions, or of their derivatives, sampled over time.

    Parameters
    ----------
    function : casadi.Function
        ``(t, p) -> (values, first derivatives, …)``.
    p : numpy.ndarray
        Values of the known symbols.
    points : numpy.ndarray
        Times of the samples (k,).
    integer : bool
        True to look for integer values instead of zeros.
    level : int
        Derivative of the functions that is meant.
    """

    def __init__(
        self, function: ca.Function, p: np.ndarray, points: np.ndarray, *, integer: bool = False, level: int = 0
    ):
        self._function, self._p, self._points, self._integer, self._level = function, p, points, integer, level
        value, slope = (x.full() for x in function(points[None, :], p)[level : level + 2])
        self._value = value
        self._dips = np.nonzero(np.zeros((0, 0)))
        with np.errstate(invalid="ignore", over="ignore"):
            if integer:
                self._passed, self._zeros = np.nonzero(np.abs(np.diff(np.floor(value))) > 0), self._dips
            else:
                self._passed, self._zeros = sign_changes(value)
                same = np.sign(value[:, :-1]) * np.sign(value[:, 1:]) > 0
                falls, rises = (slope * value)[:, :-1] < 0, (slope * value)[:, 1:] > 0
                self._dips = np.nonzero(same & falls & rises)

    @property
    def count(self) -> int:
        """Number of roots that the samples show."""
        return self._passed[0].size + self._dips[0].size

    def roots(self) -> np.ndarray:
        """Roots at which the sign changes, and at which zero is only touched."""
        return np.concatenate([self.crossings()[1], self._touching()])

    def crossings(self) -> tuple[np.ndarray, np.ndarray]:
        """Rows and times at which values change their sign, or pass integers (k,)."""
        (rows, k), (zero_rows, zeros) = self._passed, self._zeros
        target = np.zeros(k.size)
        if self._integer:
            steps = np.floor(self._value)
            ends = np.sort([steps[rows, k], steps[rows, k + 1]], axis=0)
            owner = np.repeat(np.arange(k.size), (ends[1] - ends[0]).astype(int))
            target = np.concatenate([np.zeros(0), *(np.arange(first + 1, last + 1) for first, last in ends.T)])
            rows, k = rows[owner], k[owner]
        roots = self._root(rows, self._points[k], self._points[k + 1], self._value[rows, k] - target, target)
        return np.r_[zero_rows, rows], np.r_[self._points[zeros], roots]

    def _touching(self) -> np.ndarray:
        """Points at which values reach zero between two samples without a change of sign at these."""
        points, (rows, k), level = self._points, self._dips, self._level
        if not k.size:
            return np.zeros(0)
        low, high, before = points[k], points[k + 1], self._value[rows, k]
        at_low, at_high = (_evaluated(self._function, self._p, rows, ends)[level + 1] for ends in (low, high))
        places = self._root(rows, low, high, at_low, level=level + 1)
        there = _evaluated(self._function, self._p, rows, places)[level]
        curvature = np.abs(at_high - at_low) / (high - low)
        touched = np.abs(there) <= 1e-12 * curvature * (points[-1] - points[0]) ** 2
        through = ~touched & (there * before < 0)
        ahead = self._root(rows[through], low[through], places[through], before[through])
        behind = self._root(rows[through], places[through], high[through], there[through])
        return np.r_[places[touched], ahead, behind]

    def _root(
        self,
        rows: np.ndarray,
        low: np.ndarray,
        high: np.ndarray,
        at_low: np.ndarray,
        target: np.ndarray | float = 0.0,
        level: int | None = None,
    ) -> np.ndarray:
        """Roots of a derivative less a target in brackets (k,)."""
        level = self._level if level is None else level

        def functions(x: np.ndarray) -> np.ndarray:
            each, m = np.repeat(rows, x.shape[1]), x.shape
            return _evaluated(self._function, self._p, each, x.ravel())[level].reshape(m) - np.reshape(target, (-1, 1))

        return narrowed_roots(functions, low, high, at_low, TO_ROUNDING)


def _evaluated(function: ca.Function, p: np.ndarray, rows: np.ndarray, points: np.ndarray) -> list[np.ndarray]:
    """One row of each result of a function at each of some points (k,)."""
    return [x.full()[rows, np.arange(points.size)] for x in function(points[None, :], p)]


def _samples(borders: np.ndarray, count: int) -> np.ndarray:
    """Points of all intervals between borders, not evenly spaced, so that nothing periodic hides between them."""
    each = max(count // (borders.size - 1), 16)
    share = (np.arange(each) + 0.5 + scattered(each) / 4) / each
    width = np.diff(borders)[:, None]
    return (borders[:-1, None] + width * np.r_[1e-9, share, 1 - 1e-9]).ravel()
