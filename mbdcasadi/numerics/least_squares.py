"""Linear least squares: solutions and steps of least norm, and the projection of velocities onto linear constraints."""

from __future__ import annotations

import casadi as ca
import numpy as np

from .tolerances import DEPENDENT, EPSILON, NEGLIGIBLE, RANK

#: Entries of a matrix, and share of them that are not zero, from which a sparse factorisation is quicker.
LARGE, SPARSE = 40_000, 0.05
#: Smallest damping of a step, for rows of unit size: rows may depend on each other.
SMALLEST_DAMPING = 1e-13


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


def least_norm_within(
    matrix: np.ndarray, right: np.ndarray, weights: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray | None:
    """Solution of ``A x = b`` of least ``x^T W x`` within limits (n,), or None if there is none.

    ``x = x_0 + Z y`` with the solution ``x_0`` without limits and the null space of A; y by :func:`least_distance`.

    Parameters
    ----------
    matrix, right : numpy.ndarray
        A (m, n) of full row rank, and b (m,).
    weights, lower, upper : numpy.ndarray
        Positive diagonal of W, and limits (n,), which may be infinite.
    """
    root = np.sqrt(weights)
    known = least_norm(matrix / root, right)
    sides = np.r_[lower * root - known, known - upper * root]
    size = 1 + largest(known)
    if np.all(sides <= NEGLIGIBLE * size):
        return np.clip(known / root, lower, upper)
    free = null_space(matrix / root)
    slopes, within = np.r_[free, -free], np.isfinite(sides)
    share = least_distance(slopes[within], sides[within] / size)
    if share is None:
        return None
    x = known + size * free @ share
    met = np.all(np.r_[lower * root - x, x - upper * root] <= NEGLIGIBLE * (size + largest(x)))
    return np.clip(x / root, lower, upper) if met else None


def least_distance(slopes: np.ndarray, sides: np.ndarray) -> np.ndarray | None:
    """The least y (n,) with ``S y >= c``, or None if there is none.

    Its dual is a problem of least squares that are not negative.

    Parameters
    ----------
    slopes, sides : numpy.ndarray
        S (m, n) and c (m,), of sizes near one.

    References
    ----------
    Lawson and Hanson 1974, chapter 23, algorithm LDP.
    """
    from scipy.optimize import nnls  # takes long to import

    system = np.c_[slopes, sides].T
    last = np.eye(len(system))[-1]
    shares, missing = nnls(system, last)
    rest = system @ shares - last
    return None if missing <= NEGLIGIBLE else -rest[:-1] / rest[-1]


def null_space(matrix: np.ndarray) -> np.ndarray:
    """Orthonormal directions in which no row of a matrix (m, n) changes (n, n - rank); rows are scaled to size one."""
    size = np.linalg.norm(matrix, axis=1, keepdims=True)
    _, values, directions = np.linalg.svd(matrix / np.where(size > 0, size, 1.0))
    return directions[np.sum(values > RANK * largest(values)) :].T


def project_velocity(
    jacobian: np.ndarray,
    right: np.ndarray,
    v: np.ndarray,
    weights: np.ndarray | None = None,
    sizes: np.ndarray | None = None,
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
    sizes : numpy.ndarray, optional
        Sizes of the velocities, by which a row has a slope or none; see :func:`row_scale` (n,).
    """
    missing = right - jacobian @ v
    if largest(missing) <= 4 * EPSILON * (1 + largest(v)):
        return v.copy()
    scale = row_scale(jacobian, np.ones(v.size) if weights is None else weights, sizes)
    return v + least_norm(jacobian * scale[:, None], missing * scale, weights)


def row_scale(jacobian: np.ndarray, weights: np.ndarray, sizes: np.ndarray | float | None = None) -> np.ndarray:
    """Inverse of the size of each row in the metric of the weights: rows in metres and in radians then compare (m,).

    With the `sizes` of the unknowns (n,) it is by these that a row has no slope, however light what others move is.
    """
    squares = jacobian * jacobian
    size = np.sqrt(squares @ (1 / weights))
    most = largest(size)
    if most**2 < np.finfo(float).tiny / EPSILON:
        return np.zeros(size.size)  # no row has a slope: no step is better than another
    slope = size if sizes is None or np.ndim(sizes) == 0 else np.sqrt(squares @ np.square(sizes))
    return 1 / np.where(slope > NEGLIGIBLE * largest(slope), size, most)


def least_norm_step(
    jacobian: np.ndarray, residual: np.ndarray, weights: np.ndarray, damping: float, scale: np.ndarray | None = None
) -> np.ndarray:
    """Step that minimises ``|J d + r|² + damping |d|²``, rows of unit size, in the metric of the weights.

    By the normal equations, which are quicker than singular values. `scale` is the :func:`row_scale` of
    the Jacobian if it is known already.
    """
    scale = row_scale(jacobian, weights) if scale is None else scale
    if not scale.any():
        return np.zeros(weights.size)
    if jacobian.size > LARGE:
        rows, columns = np.nonzero(jacobian)
        if rows.size < SPARSE * jacobian.size:
            return _sparse_step(jacobian, (rows, columns), residual, weights, max(damping, SMALLEST_DAMPING), scale)
    unit = jacobian * scale[:, None]
    over = unit / weights
    normal = over @ unit.T
    normal.flat[:: len(normal) + 1] += max(damping, SMALLEST_DAMPING)
    return -over.T @ np.linalg.solve(normal, scale * residual)


def _sparse_step(
    jacobian: np.ndarray,
    places: tuple[np.ndarray, np.ndarray],
    residual: np.ndarray,
    weights: np.ndarray,
    damping: float,
    scale: np.ndarray,
) -> np.ndarray:
    """Damped step for a large Jacobian with few entries, by a sparse factorisation."""
    m, n = jacobian.shape
    rows, columns = places
    values = jacobian[rows, columns] * scale[rows]
    unit, over = (
        ca.DM.triplet(rows.tolist(), columns.tolist(), ca.DM(entries), m, n)
        for entries in (values, values / weights[columns])
    )
    factors = ca.ldl(over @ unit.T + damping * ca.DM.eye(m))
    return -(over.T @ ca.ldl_solve(ca.DM(scale * residual), *factors)).full().ravel()
