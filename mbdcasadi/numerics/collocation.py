"""Gauss–Legendre collocation of second-order systems: points, weights, exact double integrals."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import Polynomial
from numpy.polynomial.legendre import leggauss


@dataclass(frozen=True)
class Gauss:
    """Coefficients on the unit interval, for values given at d Gauss points.

    Attributes
    ----------
    points : numpy.ndarray
        ``c`` (d,).
    weights : numpy.ndarray
        ``b`` (d,), of the integral over the interval.
    once : numpy.ndarray
        ``A`` (d, d): integrals of the Lagrange polynomials up to each point.
    twice : numpy.ndarray
        (d, d): their double integrals up to each point.
    weights_twice : numpy.ndarray
        (d,): their double integrals over the interval.
    at_start, at_end : numpy.ndarray
        (d,): their values at the ends of the interval.
    """

    points: np.ndarray
    weights: np.ndarray
    once: np.ndarray
    twice: np.ndarray
    weights_twice: np.ndarray
    at_start: np.ndarray
    at_end: np.ndarray

    @property
    def degree(self) -> int:
        """Number of points."""
        return self.points.size

    def basis(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Lagrange polynomials, their integrals and double integrals at shares of the interval, each (k, d)."""
        polynomials = _lagrange(self.points)
        levels = [polynomials, [p.integ() for p in polynomials], [p.integ(2) for p in polynomials]]
        return tuple(np.column_stack([p(shares) for p in level]) for level in levels)  # type: ignore[return-value]


def _lagrange(points: np.ndarray) -> list[Polynomial]:
    found = []
    for k, point in enumerate(points):
        others = np.delete(points, k)
        found.append(Polynomial.fromroots(others) / np.prod(point - others) if others.size else Polynomial([1.0]))
    return found


@lru_cache(maxsize=16)
def gauss(degree: int) -> Gauss:
    """Return the Gauss–Legendre coefficients with `degree` points; order ``2 degree``."""
    nodes, _ = leggauss(degree)
    points = (nodes + 1) / 2
    polynomials = _lagrange(points)
    integrals = [p.integ() for p in polynomials]
    double = [p.integ(2) for p in polynomials]
    return Gauss(
        points,
        np.array([p(1.0) for p in integrals]),
        np.column_stack([p(points) for p in integrals]),
        np.column_stack([p(points) for p in double]),
        np.array([p(1.0) for p in double]),
        np.array([p(0.0) for p in polynomials]),
        np.array([p(1.0) for p in polynomials]),
    )
