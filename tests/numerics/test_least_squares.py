"""Steps of least norm: a sparse factorisation gives what a dense one gives."""

import numpy as np
import pytest

from mbdcasadi.numerics import least_squares
from mbdcasadi.numerics.least_squares import least_norm, least_norm_step


def banded(m, n):
    rng = np.random.default_rng(3)
    matrix = np.zeros((m, n))
    for row in range(m):
        first = row * n // m
        matrix[row, first : first + 4] = rng.standard_normal(matrix[row, first : first + 4].size)
    return matrix, rng.standard_normal(m), rng.uniform(0.5, 2.0, n)


@pytest.mark.parametrize("damping", [0.0, 1e-3])
def test_large_and_sparse(monkeypatch, damping):
    jacobian, residual, weights = banded(220, 330)
    assert jacobian.size > least_squares.LARGE
    found = least_norm_step(jacobian, residual, weights, damping)
    monkeypatch.setattr(least_squares, "LARGE", 10**9)
    np.testing.assert_allclose(found, least_norm_step(jacobian, residual, weights, damping), rtol=1e-8, atol=1e-10)


def test_large_step_is_the_least_one():
    """Of all steps that meet the rows, by singular values."""
    jacobian, residual, weights = banded(220, 330)
    step = least_norm_step(jacobian, residual, weights, 0.0)
    np.testing.assert_allclose(jacobian @ step, -residual, atol=1e-9)
    np.testing.assert_allclose(step, -least_norm(jacobian, residual, weights), atol=1e-9)
