"""Poses that meet what a user gives of them, as nearly as the joints let them."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...assembly.pose import PoseProblem
from ...equations.numeric import NumericEquations
from ...model.conditions import Condition
from ...numerics.newton import solve

#: Steps of Newton's method to a pose from the one before, and back onto the joints.
ITERATIONS = 30


def given_poses(
    numeric: NumericEquations,
    expressions: Sequence[ca.SX],
    values: np.ndarray,
    times: np.ndarray,
    usual: np.ndarray,
    z: np.ndarray,
) -> np.ndarray:
    """Return poses (k, n) at times (k,) in which expressions in positions have values (k, m).

    The rest moves as in the `usual` poses (k, n): each pose is the nearest one to that before, moved by the usual
    change. Values that the joints do not allow are met in the sense of least squares; the joints are closed then.
    """
    conditions = [Condition(expression, True, "") for expression in expressions]
    place, weights, poses = PoseProblem(numeric, conditions, 0.0, z), numeric.projection_weights, usual.copy()
    q = usual[0]
    for k, t in enumerate(times.tolist()):
        place.t = t
        start = q + usual[k] - usual[max(k - 1, 0)]
        rows = place.rows_with(conditions, values[k])
        outcome = solve(rows, start, weights, iterations=ITERATIONS, step_limit=numeric.typical_step)
        if not outcome.converged:
            outcome = solve(place.rows_with([]), outcome.x, weights, iterations=ITERATIONS)
        q = poses[k] = outcome.x if outcome.converged else start
    return poses
