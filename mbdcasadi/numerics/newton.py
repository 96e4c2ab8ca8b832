"""Newton's method, for square systems and others: steps of least norm, damped, and a line search.

====================  =====================================================================
:func:`solve`         Gauss–Newton with damping: from far away, and to a least-squares point
:func:`newton`        by singular values and a line search: stiff and soft directions meet
:func:`refine_root`   a few more steps from a solution, down to rounding
====================  =====================================================================

Accuracies are relative. A residual counts as zero when it is rounding beside
the terms of which it is the difference, ``|J| (|x| + s)`` with the
sizes s that the unknowns typically have: micrometres are solved for as well as metres.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from .least_squares import largest, least_norm, least_norm_step, row_scale
from .tolerances import ACCURACY, CONVERGED, SMALLEST_SHARE

#: ``x -> (residual, jacobian)``.
Equations = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]

#: Singular values below this share are not directions for :func:`newton`.
SMALLEST_SINGULAR_VALUE = 1e-14

T = TypeVar("T")


@dataclass(frozen=True)
class Outcome:
    """Result of a solve.

    Attributes
    ----------
    x : numpy.ndarray
        Last iterate.
    residual : numpy.ndarray
        Residual there.
    converged : bool
        True if the residual is zero to rounding.
    """

    x: np.ndarray
    residual: np.ndarray
    converged: bool


class _Terms:
    """Size of the terms of which residuals are differences; the largest one met so far counts."""

    def __init__(self, sizes: np.ndarray | float):
        self._sizes = sizes
        self._largest: np.ndarray | float = 0.0

    def relative(self, x: np.ndarray, residual: np.ndarray, jacobian: np.ndarray) -> float:
        """Largest residual, relative to its terms."""
        self._largest = np.maximum(self._largest, np.abs(jacobian) @ (np.abs(x) + self._sizes))
        size = np.where(self._largest > 0, self._largest, 1.0)
        return largest(residual / size)


def backtrack(attempt: Callable[[float], T | None], smallest: float = SMALLEST_SHARE) -> T | None:
    """Return the result of the first share of a step that is accepted, of 1, 1/2, 1/4 …; None if none is.

    Parameters
    ----------
    attempt : callable
        Takes a share, returns the result, or None to have the share halved.
    smallest : float
        Smallest share that is tried.
    """
    share = 1.0
    while share >= smallest:
        result = attempt(share)
        if result is not None:
            return result
        share /= 2
    return None


def solve(
    equations: Equations,
    start: np.ndarray,
    weights: np.ndarray,
    *,
    sizes: np.ndarray | float = 1.0,
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
    sizes : numpy.ndarray or float
        Sizes that the unknowns typically have (n,).
    iterations : int
        Largest number of steps.
    step_limit : float or numpy.ndarray
        Largest change of an entry in one step; one for all, or by entry (n,).
    """
    x = np.array(start, float)
    residual, jacobian = equations(x)
    scale = row_scale(jacobian, weights, sizes)
    terms = _Terms(sizes)
    damping = 0.0
    for _ in range(iterations):
        if terms.relative(x, residual, jacobian) <= ACCURACY:
            return Outcome(x, residual, True)
        step = least_norm_step(jacobian, residual, weights, damping, scale)
        step *= 1.0 / max(largest(step / step_limit), 1.0)
        new_residual, new_jacobian = equations(x + step)
        size, new_size = (float((scaled := scale * r) @ scaled) for r in (residual, new_residual))
        if np.isfinite(new_size) and new_size < size:
            stalled = new_size > (1 - 1e-12) * size and damping > 0
            x, residual, jacobian = x + step, new_residual, new_jacobian
            scale = row_scale(jacobian, weights, sizes)
            damping = 0.0 if damping < 1e-6 else damping / 10
            if stalled:
                break
        elif largest(step / sizes) <= 1e-14 * (1 + largest(x / sizes)) or damping > 1e8:
            break
        else:
            damping = max(10 * damping, 1e-6)
    return Outcome(x, residual, terms.relative(x, residual, jacobian) <= CONVERGED)


def newton(
    equations: Equations,
    start: np.ndarray,
    weights: np.ndarray,
    *,
    iterations: int = 100,
    smallest: float = SMALLEST_SINGULAR_VALUE,
    step_limit: float | np.ndarray = np.inf,
) -> np.ndarray | None:
    """Solve ``r(x) = 0`` to rounding by Newton steps of least norm; None if they do not converge.

    The normal equations of :func:`solve`, which are quicker, lose directions that are softer
    than the stiffest one by more than six orders of magnitude; these do not.

    Parameters
    ----------
    equations : callable
        ``x -> (residual, jacobian)``, rows without a unit.
    start : numpy.ndarray
        (n,).
    weights : numpy.ndarray
        Positive metric (n,), in which unknowns have no unit.
    iterations : int
        Largest number of steps.
    smallest : float
        Singular values below this share of the largest one do not count.
    step_limit : float or numpy.ndarray
        Largest change of an entry in one step; one for all, or by entry (n,).
    """
    x = np.array(start, float)
    residual, jacobian = equations(x)
    for _ in range(iterations):
        if not (np.all(np.isfinite(residual)) and np.all(np.isfinite(jacobian))):
            return None
        step = -least_norm(jacobian, residual, weights, smallest)
        step *= 1.0 / max(largest(step / step_limit), 1.0)
        size = float(residual @ residual)

        def shorter(share: float, x=x, step=step, size=size) -> tuple[np.ndarray, ...] | None:
            trial = x + share * step
            accepted = equations(trial)
            return (trial, *accepted) if float(accepted[0] @ accepted[0]) < size else None

        accepted = backtrack(shorter)
        if accepted is None:
            break
        x, residual, jacobian = accepted
    return x if largest(residual) <= CONVERGED * (1 + largest(np.sqrt(weights) * x)) else None


def refine_root(
    equations: Equations, x: np.ndarray, weights: np.ndarray, *, sizes: np.ndarray | float = 1.0
) -> np.ndarray:
    """Newton steps from a solution for as long as they halve the residual: to rounding, whatever the size of x."""
    residual, jacobian = equations(x)
    terms = _Terms(sizes)
    size = terms.relative(x, residual, jacobian)
    for _ in range(5 if size > 0 else 0):
        trial = x + least_norm_step(jacobian, residual, weights, 0.0, row_scale(jacobian, weights, sizes))
        new_residual, new_jacobian = equations(trial)
        new_size = terms.relative(x, new_residual, new_jacobian)
        if not new_size < size:
            return x
        converged = new_size > size / 2
        x, residual, jacobian, size = trial, new_residual, new_jacobian, new_size
        if converged:
            return x
    return x
