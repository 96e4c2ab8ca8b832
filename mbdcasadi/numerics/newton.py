"""Newton's method by singular values, for systems in which stiff and soft directions meet."""

from __future__ import annotations

import numpy as np

from .least_squares import ACCURACY, Equations, largest

#: Singular values below this share of the largest one do not count.
SMALLEST = 1e-14


def settle(
    equations: Equations,
    start: np.ndarray,
    weights: np.ndarray,
    iterations: int = 100,
    smallest: float = SMALLEST,
    step_limit: float | np.ndarray = np.inf,
) -> np.ndarray | None:
    """Solve ``r(x) = 0`` to rounding by Newton steps of least norm; None where they do not settle.

    The normal equations, which are quicker, lose directions that are softer
    than the stiffest one by more than six orders of magnitude; these do not.

    Parameters
    ----------
    equations : callable
        ``x -> (residual, jacobian)``, rows scaled.
    start : numpy.ndarray
        (n,).
    weights : numpy.ndarray
        Positive metric (n,).
    iterations : int
        Largest number of steps.
    smallest : float
        Singular values below this share of the largest one do not count.
    step_limit : float or numpy.ndarray
        Largest change of an entry in one step; one for all, or by entry (n,).
    """
    root = np.sqrt(weights)
    x = np.array(start, float)
    residual, jacobian = equations(x)
    for _ in range(iterations):
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
            return None
        step = -np.linalg.lstsq(jacobian / root, residual, rcond=smallest)[0] / root
        step *= 1.0 / max(largest(step / step_limit), 1.0)
        share, size = 1.0, float(residual @ residual)
        while True:
            new_residual, new_jacobian = equations(x + share * step)
            new_size = float(new_residual @ new_residual)
            if new_size < size or share < 1e-4:
                break
            share /= 2
        if not new_size < size:
            break
        x, residual, jacobian = x + share * step, new_residual, new_jacobian
    return x if largest(residual) <= 1e3 * ACCURACY * (1 + largest(x)) else None
