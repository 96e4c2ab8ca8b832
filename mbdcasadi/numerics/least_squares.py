"""Nonlinear equations by damped Gauss–Newton steps of least norm."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: ``x -> (residual, jacobian)``.
Equations = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

#: Residuals below this times ``1 + max|x|`` count as zero.
ACCURACY = 1e-13
#: Size of a row, relative to the largest one, below which it has no scale of its own.
FLAT = 1e-9
#: Rounding of one operation.
EPSILON = float(np.finfo(float).eps)


@dataclass(frozen=True)
class Outcome:
    """Result of a solve.

    Attributes
    ----------
    x : numpy.ndarray
        Where it ended.
    residual : numpy.ndarray
        Left over there.
    converged : bool
        Whether the residual is zero to rounding.
    """

    x: np.ndarray
    residual: np.ndarray
    converged: bool


def largest(values: np.ndarray) -> float:
    """Largest absolute value, 0 of nothing."""
    return float(np.abs(values).max()) if values.size else 0.0


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

    `scale` is the :func:`row_scale` of the Jacobian where it is known already.
    """
    scale = row_scale(jacobian, weights) if scale is None else scale
    if not scale.any():
        return np.zeros(weights.size)
    unit = jacobian * scale[:, None]
    over = unit / weights
    normal = over @ unit.T
    normal.flat[:: len(normal) + 1] += max(damping, 1e-13)
    return -over.T @ np.linalg.solve(normal, scale * residual)


def solve(
    equations: Equations,
    start: np.ndarray,
    weights: np.ndarray,
    *,
    iterations: int = 60,
    step_limit: float | np.ndarray = np.inf,
) -> Outcome:
    """Solve ``r(x) = 0`` from a start, each step of least norm in the metric of the weights.

    Damping (Levenberg–Marquardt) is raised while a step does not reduce the
    residual, so that a system without a solution ends in a least-squares point.

    Parameters
    ----------
    equations : callable
        ``x -> (residual, jacobian)``.
    start : numpy.ndarray
        (n,).
    weights : numpy.ndarray
        Positive metric (n,).
    iterations : int
        Largest number of steps.
    step_limit : float or numpy.ndarray
        Largest change of an entry in one step; one for all, or by entry (n,).
    """
    x = np.array(start, float)
    residual, jacobian = equations(x)
    scale = row_scale(jacobian, weights)
    damping = 0.0
    for _ in range(iterations):
        goal = ACCURACY * (1 + largest(x))
        if largest(residual) <= goal:
            return Outcome(x, residual, True)
        step = least_norm_step(jacobian, residual, weights, damping, scale)
        step *= 1.0 / max(largest(step / step_limit), 1.0)
        new_residual, new_jacobian = equations(x + step)
        size, new_size = (float((scaled := scale * r) @ scaled) for r in (residual, new_residual))
        if np.isfinite(new_size) and new_size < size:
            stalled = new_size > (1 - 1e-12) * size and damping > 0
            x, residual, jacobian = x + step, new_residual, new_jacobian
            scale = row_scale(jacobian, weights)
            damping = 0.0 if damping < 1e-6 else damping / 10
            if stalled:
                break
        elif largest(step) <= 1e-14 * (1 + largest(x)) or damping > 1e8:
            break
        else:
            damping = max(10 * damping, 1e-6)
    return Outcome(x, residual, largest(residual) <= 1e3 * ACCURACY * (1 + largest(x)))


def polish(equations: Equations, x: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Newton steps from a solution for as long as they halve the residual: to rounding, whatever the size of x."""
    residual, jacobian = equations(x)
    for _ in range(5):
        trial = x + least_norm_step(jacobian, residual, weights, 0.0)
        new_residual, new_jacobian = equations(trial)
        if not largest(new_residual) < largest(residual):
            return x
        settled = largest(new_residual) > largest(residual) / 2
        x, residual, jacobian = trial, new_residual, new_jacobian
        if settled:
            return x
    return x
