"""Values of limits between the points at which a program holds them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ...model.conditions import Condition
from ...results.trajectory import Trajectory

#: Points of an interval at which limits are looked at, both ends included.
POINTS = 21
#: Distance from a limit, as a share of its size, within which the polynomials of an interval must come for the motion
#: itself to be looked at.
NEAR = 0.3


class Excess(NamedTuple):
    """A limit, the intervals near it (k,), times in these, s, and values there, above zero if passed (k, POINTS)."""

    limit: Condition
    intervals: np.ndarray
    times: np.ndarray
    values: np.ndarray


def intervals_near(excess: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the intervals whose polynomials come near a limit (k,).

    `excess` are the values of the limits by the polynomials (N, POINTS, limits), `sizes` those of the limits (limits,).
    """
    return np.flatnonzero(np.any(~(excess < -NEAR * sizes), axis=(1, 2)))


def excess_of_motion(
    motion: Trajectory, mesh_times: np.ndarray, near: np.ndarray, limits: Sequence[Condition]
) -> Iterator[Excess]:
    """Iterate over limits, with intervals whose polynomials come near one (k,)."""
    begin, length = mesh_times[near, None], np.diff(mesh_times)[near, None]
    # up to just before the next mesh point, since what jumps there belongs to the interval that ends
    times = np.minimum(begin + length * np.linspace(0, 1, POINTS), np.nextafter(begin + length, -np.inf))
    near_limits = motion.at(times.ravel())
    for limit in limits:
        values = near_limits[limit.expression].reshape(times.shape)
        yield Excess(limit, near, *_with_peaks(motion, limit, times, values))


def _with_peaks(
    motion: Trajectory, limit: Condition, times: np.ndarray, values: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Times and values of a limit (k, POINTS), the largest one of each interval at its peak between the points."""
    middle = np.clip(np.argmax(values, axis=1), 1, POINTS - 2)
    rows = np.arange(len(values))
    before, most, after = (values[rows, middle + shift] for shift in (-1, 0, 1))
    bend = 2 * most - before - after
    rows = np.flatnonzero((most >= np.maximum(before, after)) & (bend > 0))
    if not rows.size:
        return times, values
    shift = (after - before)[rows] / (2 * bend[rows])
    places, steps = middle[rows], times[rows, 1] - times[rows, 0]
    peaks = times[rows, places] + shift * steps
    at_peaks = motion.at(peaks)[limit.expression].ravel()
    higher = at_peaks > most[rows]
    times, values = times.copy(), values.copy()
    times[rows[higher], places[higher]], values[rows[higher], places[higher]] = peaks[higher], at_peaks[higher]
    return times, values
