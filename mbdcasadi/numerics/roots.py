"""Roots of functions between two points, and signs of functions between samples."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np

#: Fraction of its change over an interval by which a parabola through samples must come near to zero.
TOUCHES = 0.1
#: Width to which brackets of roots and of extrema are narrowed, relative to the first one.
OF_ROOTS, OF_EXTREMA = 2.0**-28, 2.0**-19
#: That by which nothing but rounding is left.
TO_ROUNDING = 2.0**-56
#: Parts into which brackets are cut, at least and at most, and points of all of them that one call evaluates, which
#: costs as much as some hundred of them.
FEWEST_PARTS, MOST_PARTS, AT_ONCE = 4, 16, 4096

#: ``points -> values``, of the shape of the points (k, m): by row one of k functions of one variable.
Functions = Callable[[np.ndarray], np.ndarray]


def bracketed_root(
    function: Callable[[np.ndarray], np.ndarray],
    low: float,
    high: float,
    at_low: float,
    at_high: float,
    accuracy: float | None = None,
) -> float:
    """Return the point right of the root of a function that changes sign.

    Regula falsi (Illinois variant), with a halving wherever five steps have
    not halved the bracket. SciPy's ``brentq`` and ``toms748`` take as many
    evaluations (7.9 and 8.6 for 7.5 here, on the same functions), but evaluate
    the ends again, each of which may be an integration, return a point on
    either side of the root, and take longer to be imported than a run of an
    ordinary mechanism.

    Parameters
    ----------
    function : callable
        ``points (1,) -> values (1,)``, continuous; ``at_low`` and ``at_high``, its values at the ends, differ in sign.
    accuracy : float, optional
        Largest width of the bracket that is left; rounding if left out.
    """
    accuracy = 4e-16 * max(abs(low), abs(high)) + 1e-13 * (high - low) if accuracy is None else accuracy
    side, widths = 0, [float("inf")] * 5
    for _ in range(200):
        if high - low <= accuracy or at_high == 0:
            break
        middle = (low * at_high - high * at_low) / (at_high - at_low)
        if not low < middle < high or high - low > widths[-5] / 2:
            middle = (low + high) / 2
        if not low < middle < high:
            break
        value = float(function(np.array([middle]))[0])
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
        widths.append(high - low)
    return high


def narrowed_roots(
    functions: Functions, low: np.ndarray, high: np.ndarray, at_low: np.ndarray, width: float = OF_ROOTS
) -> np.ndarray:
    """Return roots of sampled functions in brackets, all at once; of several the first (k,).

    Where a call costs as much as a hundred points, cutting brackets into many parts takes less time than halving.

    Parameters
    ----------
    low, high : numpy.ndarray
        Ends of the brackets (k,).
    at_low : numpy.ndarray
        Values at their beginnings (k,), whose signs differ from those at their ends.
    width : float
        Width to which the brackets are narrowed, relative to the first ones.
    """

    def first(values: np.ndarray) -> np.ndarray:
        same = np.sign(values) == np.sign(at_low)[:, None]
        return np.argmin(np.column_stack([same, np.zeros(len(same), bool)]), axis=1)

    return _narrowed(functions, low, high, first, 1, width)


def narrowed_extrema(functions: Functions, low: np.ndarray, high: np.ndarray, sign: np.ndarray) -> np.ndarray:
    """Return extrema of sampled functions in brackets, all at once, to ``2^-19`` of these (k,).

    Parameters
    ----------
    sign : numpy.ndarray
        1 for a maximum, -1 for a minimum (k,).
    """

    def first(values: np.ndarray) -> np.ndarray:
        heights = sign[:, None] * values
        return np.argmax(np.where(np.isnan(heights), -np.inf, heights), axis=1)

    return _narrowed(functions, low, high, first, 2, OF_EXTREMA)


def _narrowed(
    functions: Functions,
    low: np.ndarray,
    high: np.ndarray,
    first: Callable[[np.ndarray], np.ndarray],
    count: int,
    width: float,
) -> np.ndarray:
    """Middles of brackets that are cut into parts again and again (k,).

    Parameters
    ----------
    first : callable
        By the values between the parts (k, parts - 1), the first part to keep (k,).
    count : int
        Number of parts to keep.
    width : float
        Width of the brackets at the end, relative to the first one.
    """
    parts = int(np.clip(AT_ONCE // max(low.size, 1), FEWEST_PARTS, MOST_PARTS))
    inside, left = np.arange(1, parts), 1.0
    while low.size and left > width:
        step = (high - low) / parts
        chosen = first(functions(low[:, None] + step[:, None] * inside))
        low = low + chosen * step
        high, left = low + count * step, left * count / parts
    return (low + high) / 2


class Levels:
    """Levels that several sampled functions pass.

    Parameters
    ----------
    levels : sequence of sequence of float
        Those of each function, at least one.
    """

    def __init__(self, levels: Sequence[Sequence[float]]):
        self._levels = [np.unique(own) for own in levels]
        self._sorted = np.concatenate([np.zeros(0), *self._levels])
        sizes = np.array([own.size for own in self._levels], int)
        self._starts, self._several = np.cumsum(sizes) - sizes, np.flatnonzero(sizes > 1)

    def passed(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rows and places of samples (rows, k) between which and the next a level is passed, and that level (n,)."""
        above = values > self._sorted[self._starts, None]
        may_pass = above[:, :-1] != above[:, 1:]
        may_pass[self._several] = True
        rows, places = np.nonzero(may_pass)
        own, levels = self.between(rows, values[rows, places], values[rows, places + 1])
        return rows[own], places[own], levels

    def met(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows and places of inner samples (rows, k) at a level; none of a row that is the same everywhere."""
        at_level = values[:, 1:-1] == self._sorted[self._starts, None]
        for k in self._several:
            at_level[k] = np.isin(values[k, 1:-1], self._levels[k])
        rows, places = np.nonzero(at_level & np.any(values != values[:, :1], axis=1)[:, None])
        return rows, places + 1

    def between(self, rows: np.ndarray, begin: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Places of two values of some functions, each (k,), between which levels are, and the levels (n,)."""
        first = self._count(rows, np.minimum(begin, end), "right")
        counts = np.maximum(self._count(rows, np.maximum(begin, end), "left") - first, 0)
        own = np.repeat(np.arange(rows.size), counts)
        number = np.arange(own.size) - np.repeat(np.cumsum(counts) - counts, counts) + first[own]
        return own, self._sorted[self._starts[rows[own]] + number]

    def _count(self, rows: np.ndarray, values: np.ndarray, side: Literal["left", "right"]) -> np.ndarray:
        """Number of levels below values of functions, or not above them (k,)."""
        first = self._sorted[self._starts[rows]]
        count = (first < values if side == "left" else first <= values).astype(int)
        for k in self._several:
            count[rows == k] = self._levels[k].searchsorted(values[rows == k], side)
        return count


def sign_changes(values: np.ndarray) -> tuple[tuple[np.ndarray, ...], tuple[np.ndarray, ...]]:
    """Return rows and places of values (rows, k) between which and the next the sign changes, and those of inner zeros.

    A row that is zero everywhere has none.
    """
    sign = np.sign(values)
    rows, places = np.nonzero((values[:, 1:-1] == 0) & np.any(values != 0, axis=1)[:, None])
    return np.nonzero(sign[:, :-1] * sign[:, 1:] < 0), (rows, places + 1)


def nears_zero(before: np.ndarray, after: np.ndarray, length: np.ndarray | float, bend: np.ndarray) -> np.ndarray:
    """Return True for parabolas with an extremum within an interval that is beyond zero, or near to it.

    Parameters
    ----------
    before, after : numpy.ndarray
        Values at the ends of the intervals.
    length : float or numpy.ndarray
        Lengths of the intervals.
    bend : numpy.ndarray
        Half of the second derivatives.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # without curvature, or beyond all numbers, there is no extremum
        rise = (after - before) / length - bend * length
        place = -rise / (2.0 * bend)
        extreme = before + rise * place / 2.0
        change = np.abs(after - before) + np.abs(bend) * length**2
        near: np.ndarray = (place > 0.0) & (place < length) & (extreme * np.sign(before) < TOUCHES * change)
    return near


def may_touch(times: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Return True for intervals (k, n) in which functions may pass zero and come back, by parabolas through samples.

    Parameters
    ----------
    times, values : numpy.ndarray
        Samples (k + 1,), (k + 1, n), of which three neighbouring ones give a parabola.
    """
    near = np.zeros((times.size - 1, values.shape[1]), bool)
    h = np.diff(times)[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):  # of an interval of no length there is no parabola
        bends = np.diff(np.diff(values, axis=0) / h, axis=0) / (h[1:] + h[:-1])
    for part in (slice(0, -1), slice(1, None)):
        near[part] |= nears_zero(values[:-1][part], values[1:][part], h[part], bends)
    touched: np.ndarray = near & (values[:-1] != 0) & (np.sign(values[:-1]) == np.sign(values[1:]))
    return touched
