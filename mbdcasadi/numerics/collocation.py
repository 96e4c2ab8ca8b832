"""Polynomials of collocation on the unit interval: Gauss–Legendre points, Lagrange bases, their integrals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from math import comb
from typing import Any

import casadi as ca
import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss

from .lazy import cached_property


def powers(share: Any, count: int) -> Any:
    """``1, s, s², …`` as a column; of numbers (count, k), or of a CasADi expression."""
    if isinstance(share, ca.SX):
        return ca.vertcat(ca.SX(0, 1), *[share**k for k in range(count)])
    return np.asarray(share, float).reshape(1, -1) ** np.arange(count)[:, None]


def combine(coefficients: np.ndarray, base: Any) -> Any:
    """Product of a constant matrix with powers of numbers, or of a CasADi expression."""
    return ca.DM(coefficients) @ base if isinstance(base, ca.SX) else coefficients @ base


def lagrange_coefficients(points: np.ndarray) -> np.ndarray:
    """Monomial coefficients of the Lagrange polynomials on points (k, k): one row for each, lowest power first."""
    return np.linalg.inv(np.vander(points, increasing=True)).T if len(points) else np.zeros((0, 0))


def bernstein_coefficients(count: int) -> np.ndarray:
    """Monomial coefficients of the Bernstein polynomials on the unit interval (k, k): one row for each.

    A polynomial lies between the least and the largest of its Bernstein coefficients, its control points.
    """
    rows = [[comb(count - 1, i) * comb(count - 1 - i, j - i) * (-1.0) ** (j - i) if j >= i else 0.0
             for j in range(count)] for i in range(count)]  # fmt: skip
    return np.array(rows).reshape(count, count)


@dataclass(frozen=True)
class Gauss:
    """Gauss–Legendre points on the unit interval and the polynomials through values there.

    Attributes
    ----------
    points : numpy.ndarray
        ``c`` (d,).
    weights : numpy.ndarray
        ``b`` (d,), of the integral over the interval.
    """

    points: np.ndarray
    weights: np.ndarray

    @property
    def degree(self) -> int:
        """Number of points."""
        return self.points.size

    @cached_property
    def _levels(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coefficients of the Lagrange polynomials, their integrals and double integrals, each (d, d + 2)."""
        polynomials = [Polynomial(row) for row in lagrange_coefficients(self.points)]
        levels = [polynomials, [p.integ() for p in polynomials], [p.integ(2) for p in polynomials]]
        width = self.degree + 2
        padded = [np.array([np.pad(p.coef, (0, width - p.coef.size)) for p in level]) for level in levels]
        return padded[0], padded[1], padded[2]

    def basis(self, share: Any) -> tuple[Any, Any, Any]:
        """Lagrange polynomials, their integrals and double integrals at a share of the interval.

        Each (d, k) for k numbers, or (d,) for a CasADi expression.
        """
        base = powers(share, self.degree + 2)
        value, once, twice = (combine(level, base) for level in self._levels)
        return value, once, twice


@lru_cache(maxsize=16)
def gauss(degree: int) -> Gauss:
    """Return the Gauss–Legendre points with their weights; order ``2 degree``."""
    nodes, weights = leggauss(degree)
    return Gauss((nodes + 1) / 2, weights / 2)
