"""Values of limits between the points at which a program holds them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from ...model.conditions import Condition

#: Points of an interval at which limits are looked at, both ends included.
POINTS = 21
#: Distance from a limit, as a share of its size, within which the polynomials of an interval must come for the motion
#: itself to be looked at.
NEAR = 0.3
#: Values and sizes of all limits (k, limits) at points of intervals (k,), given as interval and tau.
ValuesAt = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]


class Excess(NamedTuple):
    """A limit, the intervals near it (k,), and points, values and sizes in these (k, POINTS).

    Values are above zero if the limit is passed, sizes those of the limit there, points `tau` from 0 to 1.
    """

    limit: Condition
    intervals: np.ndarray
    taus: np.ndarray
    values: np.ndarray
    sizes: np.ndarray


def larger_side(limit: Condition) -> ca.SX:
    """Return the size of the larger side of a limit; zero if it is no difference, or if a side is zero."""
    two = sides_of_limit(limit)
    if len(two) == 1 or any(side.is_zero() for side in two):
        return ca.SX(0)
    return ca.fmax(ca.fabs(two[0]), ca.fabs(two[1]))


def sides_of_limit(limit: Condition) -> list[ca.SX]:
    """Return both sides of a limit, or its expression if that is no difference."""
    expression = limit.expression
    while expression.op() == ca.OP_NEG:  # CasADi's form of -x + c
        expression = expression.dep(0)
    is_difference = expression.n_dep() == 2 and expression.op() in (ca.OP_SUB, ca.OP_ADD)
    return [expression.dep(0), expression.dep(1)] if is_difference else [expression]


def intervals_near(excess: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the intervals whose polynomials come near a limit (k,).

    `excess` are the values of the limits by the polynomials (N, POINTS, limits), `sizes` those of the limits (limits,).
    """
    return np.flatnonzero(np.any(~(excess < -NEAR * sizes), axis=(1, 2)))


def excess_of_motion(values_at: ValuesAt, near: np.ndarray, limits: Sequence[Condition]) -> Iterator[Excess]:
    """Iterate over limits, with intervals whose polynomials come near one (k,).

    The largest value of each interval is that at its peak between the points.
    """
    taus = np.tile(np.linspace(0, 1, POINTS), (near.size, 1))
    values, sizes = (x.reshape(*taus.shape, -1) for x in values_at(np.repeat(near, POINTS), taus.ravel()))
    peaks = [_peaks(values[:, :, place]) for place in range(len(limits))]
    rows, tau = (np.concatenate(parts) for parts in ([p[0] for p in peaks], [p[2] for p in peaks]))
    at_peaks = values_at(near[rows], tau) if rows.size else (np.zeros((0, len(limits))),) * 2
    first = 0
    for place, (limit, (rows, middle, tau)) in enumerate(zip(limits, peaks, strict=True)):
        found, size = (x[first : first + rows.size, place] for x in at_peaks)
        first += rows.size
        own = taus.copy(), values[:, :, place].copy(), sizes[:, :, place].copy()
        higher = found > own[1][rows, middle]
        for array, peak in zip(own, (tau, found, size), strict=True):
            array[rows[higher], middle[higher]] = peak[higher]
        yield Excess(limit, near, *own)


def _peaks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of values (k, POINTS) with a peak at their largest one, its place, and the point by a parabola."""
    middle = np.clip(np.argmax(values, axis=1), 1, POINTS - 2)
    rows = np.arange(len(values))
    before, most, after = (values[rows, middle + shift] for shift in (-1, 0, 1))
    bend = 2 * most - before - after
    rows = np.flatnonzero((most >= np.maximum(before, after)) & (bend > 0))
    places = middle[rows]
    return rows, places, (places + (after - before)[rows] / (2 * bend[rows])) / (POINTS - 1)
