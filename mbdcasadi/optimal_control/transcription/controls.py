"""Course of the inputs over an interval of the mesh: polynomials through values at given points."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...errors import ModelError
from ...numerics.collocation import combine, lagrange_coefficients, powers

#: Values of ``control=``.
CONTROLS = ("polynomial", "linear", "constant")


@dataclass(frozen=True)
class InputBasis:
    """Inputs on an interval as the polynomial through values at its ends and at inner points.

    Attributes
    ----------
    name : str
        One of :data:`CONTROLS`.
    inner : tuple of float
        Points, as ``tau`` from 0 to 1, whose values belong to the interval alone.
    joined : bool
        Whether the values at both ends count too; they belong to the mesh
        points, so that the inputs are continuous.
    """

    name: str
    inner: tuple[float, ...]
    joined: bool

    @property
    def taus(self) -> np.ndarray:
        """Points of the values (k,)."""
        return np.array([0.0, *self.inner, 1.0] if self.joined else self.inner)

    @cached_property
    def coefficients(self) -> np.ndarray:
        """Monomial coefficients of the Lagrange polynomials (k, k), one row for each value."""
        return lagrange_coefficients(self.taus)

    def weights(self, tau: Any) -> Any:
        """Weight of each value in the input at a point (k,)."""
        return combine(self.coefficients, powers(tau, self.taus.size))

    def rate_weights(self, tau: Any) -> Any:
        """Weight of each value in the derivative by tau (k,)."""
        k = self.taus.size
        if k < 2:
            return np.zeros((k, 1))
        slopes = self.coefficients[:, 1:] * np.arange(1, k)
        return combine(slopes, powers(tau, k - 1))


def input_basis(control: str, inner: tuple[float, ...], joined: bool, *, rates: bool) -> InputBasis:
    """Return the basis for a kind of control.

    Parameters
    ----------
    control : str
        One of :data:`CONTROLS`.
    inner, joined : tuple of float, bool
        The polynomial that suits the transcription.
    rates : bool
        Whether the problem contains rates of inputs: these must then be continuous.
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
    return InputBasis(control, inner, joined)
