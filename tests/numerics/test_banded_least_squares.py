"""Levenberg–Marquardt steps by bands, against SciPy and closed forms."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares

from mbdcasadi.numerics.banded_least_squares import Linearisation, minimise


class Dense(Linearisation):
    """A dense Jacobian whose normal matrix is stored as a band of full width."""

    def __init__(self, residuals, jacobian):
        self.residuals, self._jacobian = residuals, jacobian

    @property
    def normal(self):
        return band(self._jacobian.T @ self._jacobian)

    def times(self, step):
        return self._jacobian @ step

    def transposed(self, values):
        return self._jacobian.T @ values


def band(matrix):
    size = len(matrix)
    return np.array([np.pad(np.diagonal(matrix, -k), (0, k)) for k in range(size)])


def valley(x):
    """Rosenbrock's function in many variables as residuals: a long curved valley with its end at 1, 1, …"""
    return np.concatenate([10 * (x[1:] - x[:-1] ** 2), 1 - x])


def slopes(x):
    n = x.size
    first = np.zeros((n - 1, n))
    first[np.arange(n - 1), np.arange(n - 1)] = -20 * x[:-1]
    first[np.arange(n - 1), np.arange(1, n)] = 10.0
    return np.vstack([first, -np.eye(n)])


def search(x, **options):
    settings = {"tolerance": 1e-14, "limit": 500} | options
    return minimise(valley, lambda x: Dense(valley(x), slopes(x)), band(np.eye(x.size)), x, **settings)


@pytest.mark.parametrize("size", [2, 6])
def test_the_end_of_a_curved_valley(size):
    start = np.tile([-1.2, 1.0], size // 2)
    end = search(start)
    reference = least_squares(valley, start, slopes, method="lm", xtol=1e-12, ftol=1e-14)
    assert end.converged and end.x == pytest.approx(reference.x, abs=1e-9) and end.value < 1e-18


def test_a_residual_that_stays():
    """The sum of squares of ``x² + 1`` and ``x - 3``: its slope is zero at the least value."""

    def residuals(x):
        return np.array([x[0] ** 2 + 1, x[0] - 3])

    def linearised(x):
        return Dense(residuals(x), np.array([[2 * x[0]], [1.0]]))

    end = minimise(residuals, linearised, np.ones((1, 1)), np.array([4.0]), tolerance=1e-15, limit=100)
    # 4 x³ + 6 x - 6 = 0
    root = next(r.real for r in np.roots([4, 0, 6, -6]) if abs(r.imag) < 1e-9)
    assert end.converged and end.x[0] == pytest.approx(root, abs=1e-6)


def test_a_linear_problem_takes_few_steps():
    matrix, right = np.random.default_rng(0).normal(size=(9, 4)), np.arange(9.0)
    end = minimise(
        lambda x: matrix @ x - right,
        lambda x: Dense(matrix @ x - right, matrix),
        band(np.eye(4)),
        np.zeros(4),
        tolerance=1e-12,
        limit=50,
    )
    assert end.x == pytest.approx(np.linalg.lstsq(matrix, right, rcond=None)[0], abs=1e-7) and end.iterations <= 6


def test_its_limit_and_the_wish_to_stop():
    start = np.array([-1.2, 1.0])
    few = search(start, limit=3)
    assert few.iterations == 3 and not few.converged and few.value < np.sum(valley(start) ** 2)
    stopped = search(start, stopped=lambda: True)
    assert stopped.iterations == 0 and not stopped.converged and np.array_equal(stopped.x, start)


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_a_start_without_a_value_is_no_minimum(value):
    end = minimise(
        lambda x: np.array([value]),
        lambda x: Dense(np.array([value]), np.ones((1, 1))),
        np.ones((1, 1)),
        np.ones(1),
        tolerance=1e-9,
        limit=20,
    )
    assert not end.converged and not np.isfinite(end.value)


def test_values_that_are_no_numbers_are_not_taken():
    """The square root has none below zero: steps that lead there are shortened."""

    def residuals(x):
        with np.errstate(invalid="ignore"):
            return np.sqrt(x) + 0.1

    def linearised(x):
        return Dense(residuals(x), np.array([[0.5 / np.sqrt(x[0])]]))

    end = minimise(residuals, linearised, np.ones((1, 1)), np.array([1.0]), tolerance=1e-9, limit=60)
    assert np.isfinite(end.value) and end.value < 1.1**2
