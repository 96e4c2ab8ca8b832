"""Path limits between the points at which a program holds them.

Limits of inputs hold everywhere, by the control points of their polynomials. Other limits are rows at stages and mesh
points; the polynomials of a motion may pass them in between. Rows are then added at the points of the intervals where
they do so most. What is left over is the error of the mesh: the motion passes a limit that its polynomials keep.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import casadi as ca
import numpy as np

from ...errors import warn
from ...model.conditions import Condition, stacked

if TYPE_CHECKING:
    from ..phase_solution import PhaseSolution
    from ..solution import Solution

#: Points of an interval at which limits are looked at, both ends included.
POINTS = 21
#: Share of its size by which a limit may be passed between the points at which it is held.
LIMIT_TOLERANCE = 1e-2
#: Distance from a limit, as a share of its size, within which the polynomials of an interval must come for the motion
#: itself to be looked at.
NEAR = 0.3
#: Largest number of times that points are added.
ROUNDS = 3


class PassedLimit(NamedTuple):
    """A limit that a solution passes in a phase: by how much, in its own unit and as a share of its size; when, s."""

    phase: int
    label: str
    amount: float
    share: float
    time: float


def points_to_hold(solution: Solution, tolerance: float = LIMIT_TOLERANCE) -> set[tuple[int, str, float]]:
    """Return phases, labels of limits and points of the intervals at which these should be held besides.

    Those at which the polynomials of the solution pass a limit most, by more than a share of its size.
    """
    points = set()
    for number, part in enumerate(solution.phases):
        if not part.mesh.count:  # a phase of no duration
            continue
        limits, excess = part.program.limits_at_points, _excess_of_polynomials(part)
        for limit, values in zip(limits, np.moveaxis(excess, 2, 0), strict=True):
            i, j = np.unravel_index(int(np.argmax(values)), values.shape)
            if values[i, j] > tolerance * _size(part, limit, part.time_at(int(i), int(j) / (POINTS - 1))):
                points |= {(number, limit.label, tau) for tau in _places(part, limit, values)}
    return points


def passed_limits(solution: Solution, tolerance: float = LIMIT_TOLERANCE) -> list[PassedLimit]:
    """Return the limits that the motion of a solution passes by more than a share of their sizes."""
    passed = []
    for number, part in enumerate(solution.phases):
        for limit, _, times, values in part.excess_of_motion:
            worst = np.unravel_index(int(np.argmax(values)), values.shape)
            time, amount = float(times[worst]), float(values[worst])
            share = amount / _size(part, limit, time) if amount > 0 else 0.0
            if share > tolerance:
                passed.append(PassedLimit(number, limit.label, amount, share, time))
    return passed


def shares_by_interval(part: PhaseSolution) -> np.ndarray:
    """Return the largest shares of their sizes by which limits are passed in each interval (N,)."""
    shares = np.zeros(part.mesh.count)
    for limit, intervals, times, values in part.excess_of_motion:
        most = np.argmax(values, axis=1)[:, None]
        amounts, at = (np.take_along_axis(x, most, axis=1).ravel() for x in (values, times))
        passed = [a / _size(part, limit, float(t)) if a > 0 else 0.0 for a, t in zip(amounts, at, strict=True)]
        shares[intervals] = np.maximum(shares[intervals], passed)
    return shares


def excess_of_motion(part: PhaseSolution) -> Iterator[tuple[Condition, np.ndarray, np.ndarray, np.ndarray]]:
    """Limits, intervals whose polynomials come near one, times in these, and values there, above zero if passed."""
    if not part.mesh.count:  # a phase of no duration
        return
    limits, excess = part.program.limits_at_points, _excess_of_polynomials(part)
    sizes = np.array([part.program.condition_sizes[c] for c in limits])
    near = np.flatnonzero(np.any(~(excess < -NEAR * sizes), axis=(1, 2)))
    if not near.size:
        return
    begin, length = part.mesh_times[near, None], np.diff(part.mesh_times)[near, None]
    # up to just before the next mesh point, since what jumps there belongs to the interval that ends
    times = np.minimum(begin + length * np.linspace(0, 1, POINTS), np.nextafter(begin + length, -np.inf))
    motion = part.trajectory.at(times.ravel())
    for limit in limits:
        yield limit, near, *_with_peaks(part, limit, times, motion[limit.expression].reshape(times.shape))


def _with_peaks(
    part: PhaseSolution, limit: Condition, times: np.ndarray, values: np.ndarray
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
    at_peaks = part.trajectory.at(peaks)[limit.expression].ravel()
    higher = at_peaks > most[rows]
    times, values = times.copy(), values.copy()
    times[rows[higher], places[higher]], values[rows[higher], places[higher]] = peaks[higher], at_peaks[higher]
    return times, values


def largest_share(solution: Solution) -> float:
    """Return the largest share of its size by which a limit is passed."""
    return max((limit.share for limit in passed_limits(solution, 0.0)), default=0.0)


def _excess_of_polynomials(part: PhaseSolution) -> np.ndarray:
    """Values of the limits by the polynomials of the transcription (N, POINTS, limits), negative if they hold."""
    program, count = part.program, part.mesh.count
    limits = program.limits_at_points
    if not limits:
        return np.zeros((count, POINTS, 0))
    k, tau = np.repeat(np.arange(count), POINTS), np.tile(np.linspace(0, 1, POINTS), count)
    (values,) = part.by_polynomials([stacked(limits)], k, tau)
    return values.T.reshape(count, POINTS, len(limits))


def _places(part: PhaseSolution, limit: Condition, values: np.ndarray) -> set[float]:
    """Points at which intervals pass a limit most (N, POINTS), if it is not held there yet."""
    taus = np.linspace(0, 1, POINTS)
    held = np.r_[0.0, 1.0, part.program.scheme.stages, part.program.held_at(limit)]
    free = np.min(np.abs(taus[:, None] - held), axis=1) > 0.5 / (POINTS - 1)
    inside, most = np.where(free, values, -np.inf), float(np.max(values))
    return {float(taus[np.argmax(row)]) for row in inside if np.max(row) > most / 2}


def _size(part: PhaseSolution, limit: Condition, time: float) -> float:
    """Size of a limit at a time: the larger of its two sides, or its typical size if one of them is zero by itself."""
    expression, typical = limit.expression, part.program.condition_sizes[limit]
    if expression.n_dep() != 2 or expression.op() not in (ca.OP_SUB, ca.OP_ADD):
        return typical
    sides = [expression.dep(0), expression.dep(1)]
    if any(side.is_zero() for side in sides):
        return typical
    return float(np.max(np.abs(part.trajectory.at(time)[ca.vertcat(*sides)]))) or typical


def warn_of_passed_limits(solution: Solution) -> None:
    """Warn of limits that a motion passes between the points at which they are held."""
    for limit in passed_limits(solution):
        warn(
            f"the limit {limit.label} is passed by {limit.amount:.3g} at t = {limit.time:.6g} s, between the points at "
            f"which it is held ({100 * limit.share:.2g} % of it); take more intervals=, or tolerance= for a mesh that "
            "is refined"
        )
