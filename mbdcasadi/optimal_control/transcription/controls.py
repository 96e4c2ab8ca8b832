"""Course of the inputs over an interval of the mesh: polynomials through values at given points."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import ModelError
from ...numerics.collocation import bernstein_coefficients, combine, lagrange_coefficients, powers
from ...numerics.lazy import cached_property

#: Values of ``control=``.
CONTROLS = ("polynomial", "linear", "constant")


@dataclass(frozen=True)
class InputBasis:
    """Inputs on an interval as polynomials.

    Their unknowns are values at the ends and at inner points or, if inputs are limited, Bernstein coefficients: between
    the limits if these are, so is the polynomial everywhere.
    """

    #: one of :data:`CONTROLS`
    name: str
    #: points, as ``tau`` from 0 to 1, whose values belong to the interval alone
    inner: tuple[float, ...]
    #: whether the values at both ends count too; they belong to the mesh points, so that the inputs are continuous
    joined: bool
    #: whether the unknowns are Bernstein coefficients
    limited: bool = False

    @property
    def taus(self) -> np.ndarray:
        """Points of the values (k,)."""
        return np.array([0.0, *self.inner, 1.0] if self.joined else self.inner)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Monomial coefficients of the polynomial of each unknown (k, k), one row for each."""
        return bernstein_coefficients(self.taus.size) if self.limited else lagrange_coefficients(self.taus)

    @property
    def bounded(self) -> bool:
        """True if an input keeps limits everywhere that its unknowns keep."""
        return self.limited or self.taus.size <= (2 if self.joined else 1)

    @cached_property
    def control_points(self) -> np.ndarray:
        """Bernstein coefficients of an input (k, k), one row for each, from its unknowns."""
        return np.linalg.solve(bernstein_coefficients(self.taus.size).T, self.coefficients.T)

    def unknowns(self, values: np.ndarray) -> np.ndarray:
        """Unknowns (…, k, n_u) of the inputs through values at :attr:`taus` (…, k, n_u)."""
        unknowns: np.ndarray = np.linalg.solve(self.weights(self.taus).T, values) if self.limited else values
        return unknowns

    def weights(self, tau: Any) -> Any:
        """Weight of each unknown in the input at a point (k,)."""
        return combine(self.coefficients, powers(tau, self.taus.size))

    def rate_weights(self, tau: Any) -> Any:
        """Weight of each unknown in the derivative by tau (k,)."""
        k = self.taus.size
        if k < 2:
            return np.zeros((k, 1))
        slopes = self.coefficients[:, 1:] * np.arange(1, k)
        return combine(slopes, powers(tau, k - 1))


def input_basis(control: str, inner: tuple[float, ...], joined: bool, *, rates: bool, limited: bool) -> InputBasis:
    """Return the basis for a kind of control; `inner` and `joined` are those that suit the transcription.

    Rates of inputs need inputs that are continuous.
    """
    if control == "linear":
        return InputBasis(control, (), True)
    if control == "constant":
        if rates:
            raise ModelError(
                'optimize: an input that is constant on the intervals has no rate; use control="linear" or "polynomial"'
            )
        return InputBasis(control, (0.5,), False)
    if rates and not joined:
        # of the degree that the stages determine: a higher one could move between them unseen
        inner, joined = tuple(np.linspace(0, 1, max(len(inner), 2))[1:-1].tolist()), True
    # joined ones keep their values: with coefficients the solver took twice the iterations and found worse optima
    return InputBasis(control, inner, joined, limited and not joined)
