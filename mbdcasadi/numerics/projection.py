"""Projection of velocities onto linear constraints."""

from __future__ import annotations

import numpy as np

from .least_squares import largest, least_norm
from .tolerances import DEPENDENT, EPSILON


def project_velocity(
    jacobian: np.ndarray,
    right: np.ndarray,
    v: np.ndarray,
    weights: np.ndarray | None = None,
    *,
    threshold: float = DEPENDENT,
) -> np.ndarray:
    """Velocity nearest to a given one that meets ``J v = b``, in the metric of the weights.

    With the masses as weights that is the velocity after an impulse of the constraints. Rows may depend on each
    other; if they contradict each other, they are met as nearly as can be.

    Parameters
    ----------
    jacobian, right : numpy.ndarray
        Rows J (m, n) and right sides b (m,).
    v : numpy.ndarray
        The given velocity (n,).
    weights : numpy.ndarray, optional
        Positive metric (n,).
    threshold : float
        Singular values below this share of the largest one count as zero.
    """
    missing = right - jacobian @ v
    if largest(missing) <= 4 * EPSILON * (1 + largest(v)):
        return v.copy()
    return v + least_norm(jacobian, missing, weights, threshold)
