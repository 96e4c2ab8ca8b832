"""States and paths that need no iteration: conditions that are linear in independent coordinates.

If explicit constraints leave no rows, as for a cart with a pendulum, most
conditions give values of the independent coordinates. Then a state is the
solution of a linear system, and the path from one to the next a straight line.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.reduced import ReducedEquations, reduced_equations
from ...model.conditions import Condition, stacked
from ...numerics.least_squares import least_norm

#: Residual of a linear system up to which it counts as solved, relative to its terms.
LINEAR_TOLERANCE = 1e-12


def state_by_linear_conditions(
    numeric: NumericEquations, conditions: Sequence[Condition], t: float, z: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    """Coordinates and velocities (n,) that linear conditions decide at a time; None if they do not.

    They are linear in the independent coordinates of the reduced equations, if these leave no rows.
    """
    eom = _without_rows(numeric)
    if eom is None or not all(c.equality for c in conditions):
        return None
    x = ca.vertcat(eom.q, eom.v)
    system = _linear(eom, conditions, x)
    if system is None:
        return None
    matrix, right = (part.full() for part in system(t, 0, z, numeric.p))
    state, _, rank, _ = np.linalg.lstsq(matrix, -right.ravel(), rcond=None)
    if rank < x.numel() or not _is_solved(matrix, state, right.ravel()):
        return None
    w, rate = np.split(state[None, :], 2, axis=1)
    q, v = eom.states(np.array([t]), w, rate, z[None, :], numeric.p)
    return q[0], v[0]


def straight_path(
    numeric: NumericEquations, conditions: Sequence[Condition], q: np.ndarray, z: np.ndarray, times: np.ndarray
) -> np.ndarray | None:
    """Poses (k, n) at times (k + 1,) after the first one, from a pose to one that meets linear conditions.

    The shortest path in the metric of the inertias; None if conditions are not linear.
    """
    eom = _without_rows(numeric)
    system = None if eom is None else _linear(eom, conditions, eom.q)
    if eom is None or system is None:
        return None
    first = q[eom.independent]
    matrix, missing = (part.full() for part in system(times[-1], first, z, numeric.p))
    step = -least_norm(matrix, missing.ravel(), numeric.weights[eom.independent])
    if not _is_solved(matrix, step, missing.ravel()):
        return None
    fractions = (times[1:] - times[0]) / (times[-1] - times[0])
    places = first + fractions[:, None] * step
    return eom.states(times[1:], places, np.zeros(places.shape), np.tile(z, (len(places), 1)), numeric.p)[0]


def _without_rows(numeric: NumericEquations) -> ReducedEquations | None:
    """The reduced equations; None if rows are left."""
    eom = reduced_equations(numeric.eom)
    return None if eom.rows else eom


def _linear(eom: ReducedEquations, conditions: Sequence[Condition], x: ca.SX) -> ca.Function | None:
    """``(t, x, z, p) -> (J, r)`` of conditions ``r`` that are linear in x; None if they are not."""
    (rows,) = eom.of(stacked(conditions))
    slopes = ca.jacobian(rows, x)
    if ca.depends_on(slopes, ca.vertcat(eom.q, eom.v)):
        return None
    return ca.Function("linear", [eom.t, x, eom.z, eom.p], [ca.densify(slopes), ca.densify(rows)])


def _is_solved(matrix: np.ndarray, x: np.ndarray, right: np.ndarray) -> bool:
    """Return True if ``A x + r = 0`` up to rounding."""
    terms = 1 + np.abs(matrix) @ np.abs(x) + np.abs(right)
    return bool(np.all(np.abs(matrix @ x + right) <= LINEAR_TOLERANCE * terms))
