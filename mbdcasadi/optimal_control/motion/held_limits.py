"""Path limits between the points at which a program holds them.

Limits of inputs hold everywhere, by the control points of their polynomials. Other limits are rows at stages and mesh
points; the polynomials of a motion may pass them in between. Rows are then added at the points of the intervals where
they do so most. What is left over is the error of the mesh: the motion passes a limit that its polynomials keep.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import warn
from ...model.conditions import Condition
from .limit_excess import POINTS, sides_of_limit
from .phase_solution import PhaseSolution
from .solved_motion import SolvedMotion

#: Share of its size by which a limit may be passed between the points at which it is held.
LIMIT_TOLERANCE = 1e-2
#: Largest number of times that points are added.
ROUNDS = 3


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


def points_to_hold(solution: SolvedMotion, tolerance: float = LIMIT_TOLERANCE) -> set[tuple[int, str, float]]:
    """Return phases, labels of limits and points of the intervals at which these should be held besides.

    Those at which the polynomials of the solution pass a limit most, by more than a share of its size.
    """
    points = set()
    for number, part in enumerate(solution.phases):
        if not part.mesh.count:  # a phase of no duration
            continue
        limits, excess = part.program.limits_at_points, part.excess_of_polynomials
        for place, (limit, values) in enumerate(zip(limits, np.moveaxis(excess, 2, 0), strict=True)):
            i, j = np.unravel_index(int(np.argmax(values)), values.shape)
            if values[i, j] > tolerance * part.limit_values(i, j / (POINTS - 1))[1][0, place]:
                points |= {(number, limit.label, tau) for tau in _places(part, limit, values)}
    return points


def passed_limits(solution: SolvedMotion, tolerance: float = LIMIT_TOLERANCE) -> list[PassedLimit]:
    """Return the limits that the motion of a solution passes by more than a share of their sizes."""
    passed = []
    for number, part in enumerate(solution.phases):
        for excess in part.excess_of_motion:
            limit, values = excess.limit, excess.values
            worst = np.unravel_index(int(np.argmax(values)), values.shape)
            amount = float(values[worst])
            share = amount / float(excess.sizes[worst]) if amount > 0 else 0.0
            if share > tolerance:
                times = part.times_at(excess.intervals[:, None], excess.taus)
                missing = _missing(part, limit, times, values) if limit.definition else None
                passed.append(PassedLimit(number, limit.label, amount, share, float(times[worst]), missing))
    return passed


def largest_share(solution: SolvedMotion) -> float:
    """Return the largest share of its size by which a limit is passed."""
    return max((limit.share for limit in passed_limits(solution, 0.0)), default=0.0)


def _places(part: PhaseSolution, limit: Condition, values: np.ndarray) -> set[float]:
    """Points at which intervals pass a limit most (N, POINTS), if it is not held there yet."""
    taus = np.linspace(0, 1, POINTS)
    held = np.r_[0.0, 1.0, part.program.scheme.stages, part.program.held_at(limit)]
    free = np.min(np.abs(taus[:, None] - held), axis=1) > 0.5 / (POINTS - 1)
    inside, most = np.where(free, values, -np.inf), float(np.max(values))
    return {float(taus[np.argmax(row)]) for row in inside if np.max(row) > most / 2}


def _missing(part: PhaseSolution, limit: Condition, times: np.ndarray, values: np.ndarray) -> float:
    """Integral of what a limit is passed by, as a share of that of its larger side."""
    motion = part.trajectory
    larger = np.max(np.abs([motion[side] for side in sides_of_limit(limit)]), axis=0)
    short = _integral(np.maximum(values, 0.0), times)
    return short / _integral(larger, motion.t) if short else 0.0


def _integral(values: np.ndarray, times: np.ndarray) -> float:
    """Sum of the integrals of values at times, rows of their own if there are several, by the trapezoidal rule."""
    return float(np.sum(np.diff(times) * (values[..., 1:] + values[..., :-1]) / 2))


def warn_of_passed_limits(solution: SolvedMotion) -> None:
    """Warn of limits that a motion passes between the points at which they are held.

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
