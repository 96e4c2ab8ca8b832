"""Large nonlinear least-squares problems whose unknowns meet their neighbours alone: Levenberg–Marquardt by bands."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

#: First damping, as a share of the curvature of the sum of squares over that of the metric.
FIRST_DAMPING = 1e-3
#: Factors by which the damping is raised and lowered, and shares of the promised decrease for these.
RAISED, LOWERED, POOR, GOOD = 3.0, 0.2, 0.1, 0.5
#: Length of the acceleration over that of the step up to which the step is taken, and the share of a step over which
#: the curvature is measured.
CURVED, PROBE = 0.75, 0.1
#: Largest number of dampings that are tried in turn.
DAMPINGS = 40


class Linearisation(ABC):
    """Residuals ``r`` at a place, and their Jacobian ``J``."""

    #: ``r`` (m,)
    residuals: np.ndarray

    @property
    @abstractmethod
    def normal(self) -> np.ndarray:
        """``J^T J`` as a lower band (width, n), as SciPy stores it."""

    @abstractmethod
    def times(self, step: np.ndarray) -> np.ndarray:
        """``J s`` (m,)."""

    @abstractmethod
    def transposed(self, values: np.ndarray) -> np.ndarray:
        """``J^T r`` (n,)."""


@dataclass(frozen=True)
class LeastSquaresEnd:
    """End of a minimisation.

    Attributes
    ----------
    x : numpy.ndarray
        Unknowns (n,).
    value : float
        Sum of the squared residuals; not finite if that of the first unknowns is none.
    iterations : int
        Steps that were taken.
    converged : bool
        True if the sum no longer fell.
    """

    x: np.ndarray
    value: float
    iterations: int
    converged: bool


def minimise(
    residuals: Callable[[np.ndarray], np.ndarray],
    linearised: Callable[[np.ndarray], Linearisation],
    metric: np.ndarray,
    x: np.ndarray,
    *,
    tolerance: float,
    limit: int,
    stopped: Callable[[], bool] = lambda: False,
) -> LeastSquaresEnd:
    """Minimise a sum of squares by Levenberg–Marquardt steps with geodesic acceleration.

    Parameters
    ----------
    residuals : callable
        ``r`` (m,) at unknowns.
    linearised : callable
        ``r`` and ``J`` there.
    metric : numpy.ndarray
        Matrix ``G`` in which steps are damped, as a lower band (width, n).
    x : numpy.ndarray
        First unknowns (n,).
    tolerance : float
        Decrease in a step, as a share of the sum, from which the sum falls no more.
    limit : int
        Largest number of steps.
    stopped : callable
        True if the user wants it to end.

    Returns
    -------
    LeastSquaresEnd

    Notes
    -----
    A step ``s`` solves ``(J^T J + lam G) s = -J^T r``. Half of the acceleration ``a``, which solves the same system
    with the second derivative of the residuals along ``s`` in place of ``r``, is added: in curved valleys far fewer
    steps are needed.

    References
    ----------
    Transtrum, Sethna, "Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization",
    arXiv:1201.5885, 2012.
    """
    at = linearised(x)
    value, damping = _squares(at.residuals), FIRST_DAMPING * np.sum(at.normal[0]) / np.sum(metric[0])
    if not np.isfinite(value):
        return LeastSquaresEnd(x, value, 0, False)
    for iteration in range(limit):
        slope, step = at.transposed(at.residuals), None
        for _ in range(DAMPINGS):
            if stopped():
                return LeastSquaresEnd(x, value, iteration, False)
            step = _step(residuals, at, metric, x, slope, damping)
            if step is not None and step.value < value:
                break
            damping *= RAISED
        else:
            return LeastSquaresEnd(x, value, iteration, True)
        assert step is not None
        share, x, fell = (value - step.value) / step.promised, x + step.change, value - step.value
        damping *= LOWERED if share > GOOD else 2.0 if share < POOR else 1.0
        if fell <= tolerance * value:
            return LeastSquaresEnd(x, step.value, iteration + 1, True)
        at, value = linearised(x), step.value
    return LeastSquaresEnd(x, value, limit, False)


@dataclass(frozen=True)
class _Step:
    change: np.ndarray
    #: sum of squares after it
    value: float
    #: by which the linearised residuals let it fall
    promised: float


def _step(
    residuals: Callable[[np.ndarray], np.ndarray],
    at: Linearisation,
    metric: np.ndarray,
    x: np.ndarray,
    slope: np.ndarray,
    damping: float,
) -> _Step | None:
    """The step of a damping; None if the residuals are too curved for it."""
    from scipy.linalg import LinAlgError, cho_solve_banded, cholesky_banded

    try:
        factor = cholesky_banded(at.normal + damping * metric, lower=True, check_finite=False)
    except LinAlgError:
        return None
    step = cho_solve_banded((factor, True), -slope, check_finite=False)
    straight = at.times(step)
    curvature = 2 / PROBE * ((residuals(x + PROBE * step) - at.residuals) / PROBE - straight)
    if not np.all(np.isfinite(curvature)):
        return None
    acceleration = cho_solve_banded((factor, True), -at.transposed(curvature), check_finite=False)
    length = _squares_in(metric, step)
    if not _squares_in(metric, acceleration) <= CURVED**2 * length:
        return None
    change = step + acceleration / 2
    after = _squares(residuals(x + change))
    return _Step(change, after if np.isfinite(after) else np.inf, -float(slope @ step) + damping * length)


def _squares(values: np.ndarray) -> float:
    return float(values @ values)


def _squares_in(metric: np.ndarray, x: np.ndarray) -> float:
    """``x^T G x`` of a lower band."""
    total = float(metric[0] @ x**2)
    for k in range(1, len(metric)):
        total += 2 * float(metric[k, :-k] @ (x[k:] * x[:-k]))
    return total
