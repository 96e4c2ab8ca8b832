"""Linear least squares: solutions and steps of least norm, and the projection of velocities onto linear constraints."""

from __future__ import annotations

import numpy as np

from .tolerances import DEPENDENT, EPSILON

#: Size of a row, relative to the largest one, below which it has no scale of its own.
FLAT = 1e-9


def largest(values: np.ndarray) -> float:
    """Largest absolute value, 0 of nothing."""
    return float(np.abs(values).max()) if values.size else 0.0


def least_norm(
    matrix: np.ndarray, right: np.ndarray, weights: np.ndarray | None = None, threshold: float = DEPENDENT
) -> np.ndarray:
    """Least-squares solution of ``A x = b`` of least norm ``x^T W x``, by singular values.

    Parameters
    ----------
    matrix : numpy.ndarray
        A (m, n), of any rank.
    right : numpy.ndarray
        b (m,), or one for each column (m, k).
    weights : numpy.ndarray, optional
        Positive diagonal of W (n,).
    threshold : float
        Singular values of ``A W^-1/2`` below this share of the largest one count as zero.
    """
    if weights is None:
        return np.linalg.lstsq(matrix, right, rcond=threshold)[0]
    root = np.sqrt(weights)
    solution = np.linalg.lstsq(matrix / root, right, rcond=threshold)[0]
    return (solution.T / root).T


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


def row_scale(jacobian: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Inverse of the size of each row in the metric of the weights: rows in metres and in radians then compare (m,)."""
    size = np.sqrt((jacobian * jacobian) @ (1 / weights))
    most = largest(size)
    if most**2 < np.finfo(float).tiny / EPSILON:
        return np.zeros(size.size)  # no row has a slope: no step is better than another
    return 1 / np.where(size > FLAT * most, size, most)


def least_norm_step(
    jacobian: np.ndarray,
    residual: np.ndarray,
    weights: np.ndarray,
    damping: float,
    scale: np.ndarray | None = None,
) -> np.ndarray:
    """Step that minimises ``|J d + r|² + damping |d|²``, rows of unit size, in the metric of the weights.

    By the normal equations, which are quicker than singular values. `scale` is the :func:`row_scale` of
    the Jacobian if it is known already.
    """
    scale = row_scale(jacobian, weights) if scale is None else scale
    if not scale.any():
        return np.zeros(weights.size)
    unit = jacobian * scale[:, None]
    over = unit / weights
    normal = over @ unit.T
    normal.flat[:: len(normal) + 1] += max(damping, 1e-13)
    return -over.T @ np.linalg.solve(normal, scale * residual)
