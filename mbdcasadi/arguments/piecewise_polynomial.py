"""Inputs that are polynomials piece by piece, as optimal control finds them, also as gains of a feedback."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..errors import ModelError
from ..numerics.tolerances import NEGLIGIBLE


class PiecewisePolynomial:
    """A function of time given by a polynomial on each interval.

    ``u(t) = Σ_k c[i, k] (t - breaks[i])^k`` for ``breaks[i] <= t < breaks[i + 1]``.

    Parameters
    ----------
    breaks : array_like
        Ends of the intervals, increasing (N + 1,), s.
    coefficients : array_like
        (N, degree + 1), lowest power first.
    """

    def __init__(self, breaks: np.ndarray, coefficients: np.ndarray):
        self.breaks = np.asarray(breaks, float)
        self.coefficients = np.atleast_2d(np.asarray(coefficients, float))
        if self.breaks.ndim != 1 or np.any(np.diff(self.breaks) <= 0):
            raise ModelError("PiecewisePolynomial: breaks must increase")
        if self.coefficients.shape[0] != self.breaks.size - 1:
            raise ModelError(
                f"PiecewisePolynomial: {self.coefficients.shape[0]} rows of coefficients "
                f"for {self.breaks.size - 1} intervals"
            )

    @property
    def terms(self) -> int:
        """Coefficients of each polynomial."""
        return self.coefficients.shape[1]

    def interval(self, times: np.ndarray) -> np.ndarray:
        """Interval in which each time lies; the later one at a break, and as near before it as times count as one."""
        slack = NEGLIGIBLE * (self.breaks[-1] - self.breaks[0])
        index = np.searchsorted(self.breaks, np.asarray(times, float) + slack, side="right") - 1
        return np.clip(index, 0, self.breaks.size - 2)

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Values at times."""
        times = np.asarray(times, float)
        k = self.interval(times)
        since = times - self.breaks[k]
        value = np.zeros_like(since)
        for power in range(self.terms - 1, -1, -1):
            value = value * since + self.coefficients[k, power]
        return value


class PolynomialFeedback(PiecewisePolynomial):
    """An input ``Σ_j k_j(t) e_j`` with gains that are polynomials on each interval.

    Parameters
    ----------
    breaks : array_like
        Ends of the intervals, increasing (N + 1,), s.
    coefficients : array_like
        Of the gains, one after the other (N, m (degree + 1)), lowest power first.
    factors : casadi.SX
        What they multiply (m,), in positions, velocities, first-order states and parameters.
    """

    def __init__(self, breaks: np.ndarray, coefficients: np.ndarray, factors: Any):
        super().__init__(breaks, coefficients)
        self.factors = ca.SX(factors)

    def __call__(self, times: np.ndarray) -> np.ndarray:
        """Gains at times (…, m)."""
        return np.stack([part(times) for part in self.gains], axis=-1)

    @property
    def gains(self) -> list[PiecewisePolynomial]:
        """The gains one by one."""
        blocks = np.split(self.coefficients, self.factors.numel(), axis=1)
        return [PiecewisePolynomial(self.breaks, block) for block in blocks]
