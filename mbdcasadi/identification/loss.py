"""Loss functions of residuals, quadratic or robust against outliers."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import ModelError
from ..model.quantities import one_of
from ..model.symbols import number

#: Names of the losses, as ``scipy.optimize.least_squares`` calls them.
LOSSES = ("linear", "huber", "soft_l1")
#: Curvature of the loss of an outlier, relative to its slope, at least: it vanishes for "huber", and a step is then
#: decided by the other samples alone.
LEAST_CURVATURE = 0.05
#: Ratio of the standard deviation of normal noise to its median absolute value.
NORMAL = 1.4826


class Loss:
    """A loss ``C² rho(r²/C²)`` of residuals in standard deviations of the noise.

    Parameters
    ----------
    name : {"linear", "huber", "soft_l1"}
        ``rho(z)`` is z; z up to 1 and ``2 sqrt(z) - 1`` beyond; ``2 (sqrt(1 + z) - 1)``.
    scale : float
        C, the residual from which a sample counts as an outlier, in standard deviations.

    References
    ----------
    Huber, *Robust Statistics*, 1981, sections 7.6 and 7.8; Triggs et al., "Bundle adjustment", 1999, section 4.3.
    """

    def __init__(self, name: Any, scale: Any):
        self.name, self.scale = one_of(name, LOSSES, "identify", "loss"), number(scale, "identify", "f_scale")
        if self.scale <= 0:
            raise ModelError(f"identify: f_scale must be positive, got {self.scale}")

    @property
    def is_robust(self) -> bool:
        """True if outliers count less than by their squares."""
        return self.name != "linear"

    def _rho(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``rho``, ``rho'`` and ``rho''``."""
        if self.name == "linear":
            return z, np.ones(z.shape), np.zeros(z.shape)
        if self.name == "soft_l1":
            return 2 * (np.sqrt(1 + z) - 1), (1 + z) ** -0.5, -0.5 * (1 + z) ** -1.5
        outside = np.maximum(z, 1.0)
        inside = z <= 1
        return (
            np.where(inside, z, 2 * np.sqrt(outside) - 1),
            np.where(inside, 1.0, outside**-0.5),
            np.where(inside, 0.0, -0.5 * outside**-1.5),
        )

    def cost(self, residual: np.ndarray) -> float:
        """Sum of the losses; that of the squares for "linear"."""
        return float(self.scale**2 * np.sum(self._rho((residual / self.scale) ** 2)[0]))

    def factors(self, residual: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors of residuals and of rows of their Jacobian with which a least-squares step is a step of the loss."""
        z = (residual / self.scale) ** 2
        _, slope, bend = self._rho(z)
        curvature = np.sqrt(np.maximum(slope + 2 * z * bend, LEAST_CURVATURE * slope))
        return slope / curvature, curvature

    def variance(self, residual: np.ndarray, unknowns: int) -> float:
        """Variance of the noise as it counts for the covariance ``variance (J^T J)⁻¹`` of the unknowns.

        ``K² [sum psi² / (n - p)] / [mean psi']²`` with ``psi`` half the slope of
        the loss and ``K = 1 + p/n var(psi') / mean(psi')²``; the mean square of the
        residuals for "linear".
        """
        count = residual.size
        z = (residual / self.scale) ** 2
        _, slope, bend = self._rho(z)
        steepness = slope + 2 * z * bend
        mean = float(np.mean(steepness))
        correction = 1 + unknowns / count * float(np.var(steepness)) / mean**2
        return correction**2 * float(np.sum((slope * residual) ** 2)) / max(count - unknowns, 1) / mean**2

    def spread(self, residual: np.ndarray) -> float:
        """Standard deviation of residuals about zero; of a robust loss that of the inner half, if it is normal."""
        if not residual.size:
            return 0.0
        if self.is_robust:
            return NORMAL * float(np.median(np.abs(residual)))
        return float(np.sqrt(np.mean(residual**2)))


#: The squares.
LINEAR = Loss("linear", 1.0)
