"""Path limits between the points at which a program enforces them.

Limits of inputs hold everywhere, by the control points of their polynomials. Other limits are rows at stages and mesh
points; the polynomials of a motion may pass them in between. Rows are then added at the points of the intervals where
they do so most. What is left over is the error of the mesh: the motion passes a limit that its polynomials keep.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ...errors import warn
from ...model.conditions import Condition, stacked
from ...numerics.evaluation import Evaluator
from .phase_solution import PhaseSolution
from .solved_motion import SolvedMotion

#: Points of an interval at which limits are looked at, both ends included.
POINTS = 21
#: Distance from a limit, as a share of its size, within which the polynomials of an interval must come for the motion
#: itself to be looked at.
NEAR = 0.3
#: Share of its size by which a limit may be passed between the points at which it is enforced.
LIMIT_TOLERANCE = 1e-2
#: Largest number of times that points are added.
ROUNDS = 3


class Excess(NamedTuple):
    """A limit, the intervals near it (k,), and points, values and sizes in these (k, POINTS).

    Values are above zero if the limit is passed, sizes those of the limit there, points `tau` from 0 to 1.
    """

    limit: Condition
    intervals: np.ndarray
    taus: np.ndarray
    values: np.ndarray
    sizes: np.ndarray

    @property
    def shares(self) -> np.ndarray:
        """Largest value of each interval as a share of the size of the limit there; zero if it holds (k,)."""
        most = np.argmax(self.values, axis=1)[:, None]
        amounts, sizes = (np.take_along_axis(x, most, axis=1).ravel() for x in (self.values, self.sizes))
        shares: np.ndarray = np.maximum(amounts, 0.0) / sizes
        return shares


class PassedLimit(NamedTuple):
    """A limit that a solution passes in a phase: by how much, in its own unit and as a share of its size; when, s.

    If it defines the auxiliary input of a part of a cost, `missing` is the share of its integral that is missing.
    """

    phase: int
    label: str
    amount: float
    share: float
    time: float
    missing: float | None


# --- values ---------------------------------------------------------------------------------
def points_of(part: PhaseSolution) -> tuple[np.ndarray, np.ndarray]:
    """Return the points of all intervals at which limits are looked at: interval and tau, each (N POINTS,)."""
    return np.repeat(np.arange(part.mesh.count), POINTS), np.tile(np.linspace(0, 1, POINTS), part.mesh.count)


def excess_of_polynomials(part: PhaseSolution) -> np.ndarray:
    """Values of the limits by the polynomials (N, POINTS, k), negative if they hold."""
    return _on_grid(part)[0]


def _on_grid(part: PhaseSolution) -> list[np.ndarray]:
    """Values of the limits and of their larger sides by the polynomials, each (N, POINTS, limits)."""
    shape = part.mesh.count, POINTS, len(part.program.limits_at_points)
    if 0 in shape:
        return [np.zeros(shape), np.zeros(shape)]
    return part.cache.get_or_create(
        "limits on a grid", lambda: [x.reshape(shape) for x in _by_polynomials(part, *points_of(part))]
    )


def excess_of_motion(part: PhaseSolution) -> list[Excess]:
    """Limits that the motion comes near, with the intervals whose polynomials do; cached.

    The largest value of each interval is that at its peak between the points.
    """
    return part.cache.get_or_create("excess of motion", lambda: _excess_of_motion(part))


def _excess_of_motion(part: PhaseSolution) -> list[Excess]:
    limits = part.program.limits_at_points
    typical = np.array([part.program.condition_sizes[limit] for limit in limits])
    near = np.flatnonzero(np.any(~(excess_of_polynomials(part) < -NEAR * typical), axis=(1, 2)))
    if not near.size:
        return []
    taus = np.tile(np.linspace(0, 1, POINTS), (near.size, 1))
    if _is_by_polynomials(part):
        values, sizes = _with_sizes(part, *(x[near] for x in _on_grid(part)))
    else:
        values, sizes = (x.reshape(*taus.shape, -1) for x in limit_values(part, np.repeat(near, POINTS), taus.ravel()))
    peaks = [_peaks(values[:, :, place]) for place in range(len(limits))]
    rows, tau = (np.concatenate(parts) for parts in ([p[0] for p in peaks], [p[2] for p in peaks]))
    at_peaks = limit_values(part, near[rows], tau) if rows.size else (np.zeros((0, len(limits))),) * 2
    first, found = 0, []
    for place, (limit, (rows, middle, tau)) in enumerate(zip(limits, peaks, strict=True)):
        peak, size = (x[first : first + rows.size, place] for x in at_peaks)
        first += rows.size
        own = taus.copy(), values[:, :, place].copy(), sizes[:, :, place].copy()
        higher = peak > own[1][rows, middle]
        for array, there in zip(own, (tau, peak, size), strict=True):
            array[rows[higher], middle[higher]] = there[higher]
        found.append(Excess(limit, near, *own))
    return found


def _peaks(values: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows of values (k, POINTS) with a peak at their largest one, its place, and the point by a parabola."""
    middle = np.clip(np.argmax(values, axis=1), 1, POINTS - 2)
    rows = np.arange(len(values))
    before, most, after = (values[rows, middle + shift] for shift in (-1, 0, 1))
    bend = 2 * most - before - after
    rows = np.flatnonzero((most >= np.maximum(before, after)) & (bend > 0))
    places = middle[rows]
    return rows, places, (places + (after - before)[rows] / (2 * bend[rows])) / (POINTS - 1)


def limit_values(part: PhaseSolution, k: Any, tau: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return values and sizes of the limits by the motion at points of intervals, each (k, limits).

    A size is the larger of the sides, or the typical one if one of them is zero.
    """
    k, tau = np.atleast_1d(k), np.atleast_1d(tau)
    return _with_sizes(part, *(_by_polynomials if _is_by_polynomials(part) else _by_motion)(part, k, tau))


def _is_by_polynomials(part: PhaseSolution) -> bool:
    """True if limits are those of the polynomials, since nothing moves these onto constraints."""
    limits = part.program.limits_at_points
    return not part.program.scheme.eom.rows and not any(c.depends_on("acceleration", "multiplier") for c in limits)


def _with_sizes(part: PhaseSolution, values: np.ndarray, sides: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values of limits, with their sizes by the larger sides (…, limits).

    Both sides of what defines an auxiliary input may vanish together, as those of a soft limit do where it holds: what
    they are there is no size, and the largest one on the way is the least.
    """
    limits = part.program.limits_at_points
    typical = np.array([part.program.condition_sizes[c] for c in limits])
    largest = np.max(_on_grid(part)[1], axis=(0, 1), initial=0.0)
    least = np.where([c.definition for c in limits], largest, 0.0)
    return values, np.where(sides > 0, np.maximum(sides, least), typical)


def _by_polynomials(part: PhaseSolution, k: np.ndarray, tau: np.ndarray) -> list[np.ndarray]:
    """Values of the limits and of their larger sides at points of intervals, each (k, limits)."""
    cache = part.program.scheme.constraints.cache
    evaluator = cache.get_or_create("limits", lambda: part.evaluator(_limits_and_sides(part)))
    return list(evaluator.rows(*part.polynomials.unknowns(k, tau), part.extra))


def _by_motion(part: PhaseSolution, k: np.ndarray, tau: np.ndarray) -> list[np.ndarray]:
    # up to just before the next mesh point, since what jumps there belongs to the interval that ends
    times = np.minimum(part.times_at(k, tau), np.nextafter(part.mesh_times[k + 1], -np.inf))
    motion, cache = part.trajectory.at(times), part.program.scheme.constraints.cache
    *states, p = motion.arguments

    def evaluator() -> Evaluator:
        return Evaluator(ca.Function("limits", part.program.arguments, list(map(ca.densify, _limits_and_sides(part)))))

    of_motion = cache.get_or_create("limits of a motion", evaluator)
    values, sides = of_motion.rows(*states, part.polynomials.input_rates(times), p, part.extra)
    if np.isnan(values).any():
        motion[stacked(part.program.limits_at_points)]  # an error that names the expression
    return [values, sides]


def _limits_and_sides(part: PhaseSolution) -> list[ca.SX]:
    limits = part.program.limits_at_points
    return [stacked(limits), ca.vertcat(ca.SX(0, 1), *map(_larger_side, limits))]


def _larger_side(limit: Condition) -> ca.SX:
    """Size of the larger side of a limit; zero if it is no difference, or if a side is zero."""
    two = _sides(limit)
    if len(two) == 1 or any(side.is_zero() for side in two):
        return ca.SX(0)
    return ca.fmax(ca.fabs(two[0]), ca.fabs(two[1]))


def _sides(limit: Condition) -> list[ca.SX]:
    """Both sides of a limit, or its expression if that is no difference."""
    expression = limit.expression
    while expression.op() == ca.OP_NEG:  # CasADi's form of -x + c
        expression = expression.dep(0)
    is_difference = expression.n_dep() == 2 and expression.op() in (ca.OP_SUB, ca.OP_ADD)
    return [expression.dep(0), expression.dep(1)] if is_difference else [expression]


# --- limits that are passed -----------------------------------------------------------------
def points_to_hold(solution: SolvedMotion, tolerance: float = LIMIT_TOLERANCE) -> set[tuple[int, str, float]]:
    """Return phases, labels of limits and points of the intervals at which these should be enforced besides.

    Those at which the polynomials of the solution pass a limit most, by more than a share of its size.
    """
    points = set()
    for number, part in enumerate(solution.phases):
        if not part.mesh.count:  # a phase of no duration
            continue
        excess = excess_of_polynomials(part)
        for place, limit in enumerate(part.program.limits_at_points):
            values = excess[:, :, place]
            i, j = np.unravel_index(int(np.argmax(values)), values.shape)
            if values[i, j] > tolerance * limit_values(part, i, j / (POINTS - 1))[1][0, place]:
                points |= {(number, limit.label, tau) for tau in _places(part, limit, values)}
    return points


def passed_limits(solution: SolvedMotion, tolerance: float = LIMIT_TOLERANCE) -> list[PassedLimit]:
    """Return the limits that the motion of a solution passes by more than a share of their sizes."""
    passed = []
    for number, part in enumerate(solution.phases):
        for excess in excess_of_motion(part):
            worst = np.unravel_index(int(np.argmax(excess.values)), excess.values.shape)
            share = float(excess.shares[worst[0]])
            if share > tolerance:
                time = float(part.times_at(excess.intervals[worst[0]], excess.taus[worst]))
                missing = _missing(part, excess) if excess.limit.definition else None
                passed.append(
                    PassedLimit(number, excess.limit.label, float(excess.values[worst]), share, time, missing)
                )
    return passed


def largest_share(solution: SolvedMotion) -> float:
    """Return the largest share of its size by which a limit is passed."""
    return max((limit.share for limit in passed_limits(solution, 0.0)), default=0.0)


def _places(part: PhaseSolution, limit: Condition, values: np.ndarray) -> set[float]:
    """Points at which intervals pass a limit most (N, POINTS), if it is not enforced there yet."""
    taus = np.linspace(0, 1, POINTS)
    enforced = np.r_[0.0, 1.0, part.program.scheme.stages, part.program.enforced_at(limit)]
    free = np.min(np.abs(taus[:, None] - enforced), axis=1) > 0.5 / (POINTS - 1)
    inside, most = np.where(free, values, -np.inf), float(np.max(values))
    return {float(taus[np.argmax(row)]) for row in inside if np.max(row) > most / 2}


def _missing(part: PhaseSolution, excess: Excess) -> float:
    """Integral of what a limit is passed by, as a share of that of its larger side."""
    from scipy.integrate import trapezoid

    times, motion = part.times_at(excess.intervals[:, None], excess.taus), part.trajectory
    short = float(np.sum(trapezoid(np.maximum(excess.values, 0.0), times)))
    larger = np.max(np.abs([motion[side] for side in _sides(excess.limit)]), axis=0)
    return short / float(trapezoid(larger, motion.t)) if short else 0.0


def limit_excess(solution: SolvedMotion) -> dict[str, float]:
    """Amounts by which limits are passed between the points at which they are enforced, by label."""
    excess: dict[str, float] = {}
    for part in solution.phases:
        if part.limits:
            motion = part.trajectory.at(np.unique(part.times_at(*points_of(part))))
            for limit in part.limits:
                here = max(float(np.max(motion[limit.expression])), 0.0)
                excess[limit.label] = max(here, excess.get(limit.label, 0.0))
    return excess


def warn_of_passed_limits(solution: SolvedMotion) -> None:
    """Warn of limits that a motion passes between the points at which they are enforced.

    Of those that define the auxiliary input of a part of a cost only if its integral falls short.
    """
    for limit in passed_limits(solution):
        if limit.missing is None:
            share = f"{100 * limit.share:.2g} % of it"
        elif limit.missing > LIMIT_TOLERANCE:
            share = f"so that {100 * limit.missing:.2g} % of its integral are missing in the cost"
        else:
            continue
        warn(
            f"the limit {limit.label} is passed by {limit.amount:.3g} at t = {limit.time:.6g} s, between the points at "
            f"which it is held ({share}); take more intervals=, or tolerance= for a mesh that is refined"
        )
