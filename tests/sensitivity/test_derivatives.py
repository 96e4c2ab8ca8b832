"""Derivatives of compiled functions in some directions, and adjoint."""

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.sensitivity.derivatives import Compiled, lengths_of

X = np.array([1.0, 2.0])
T = np.array([[0.5, -1.0, 2.0]])


@pytest.fixture
def compiled():
    """``(x, t) -> (x_0² t + x_1, x)`` at three times side by side."""
    x, t = ca.MX.sym("x", 2), ca.MX.sym("t", 1, 3)
    return Compiled(ca.Function("f", [x, t], [x[0] ** 2 * t + x[1], x]))


def test_changes_of_the_first_argument_alone(compiled):
    """One block of columns for each direction, as ``2 x_0 t`` and 1 say; the times stay as they are."""
    results = compiled(X, T)
    first, second = compiled.changes([X, T], results, np.eye(2))
    expected = np.hstack([2 * X[0] * T, np.ones((1, 3))])
    np.testing.assert_allclose(first.full(), expected, rtol=1e-14)
    np.testing.assert_allclose(second.full(), np.eye(2), rtol=1e-14)


def test_changes_of_all_arguments_add_up(compiled):
    """A direction in the state and in all times at once."""
    results = compiled(X, T)
    first, _ = compiled.changes([X, T], results, np.array([[1.0], [0.0]]), np.array([[1.0, 2.0, 3.0]]))
    np.testing.assert_allclose(first.full(), 2 * X[0] * T + X[0] ** 2 * np.array([[1, 2, 3]]), rtol=1e-14)


def test_adjoint_is_the_transpose_of_the_changes():
    """Of the first output alone: the others are not differentiated."""
    x = ca.MX.sym("x", 2)
    compiled = Compiled(ca.Function("f", [x], [ca.vertcat(x[0] * x[1], x[1] ** 3), ca.sqrt(x)]), 1)
    y, root = compiled(X)
    np.testing.assert_allclose(root.full().ravel(), np.sqrt(X), rtol=1e-14)
    weights = np.array([2.0, -1.0])
    slope = compiled.changes([X], [y], np.eye(2)).full()
    np.testing.assert_allclose(slope, [[2.0, 1.0], [0.0, 12.0]], rtol=1e-14)
    np.testing.assert_allclose(compiled.adjoint([X], y, weights), weights @ slope, rtol=1e-14)


def test_lengths_are_relative_changes():
    """As far as the largest value changes by itself, 1 at least."""
    directions = np.array([[1.0, 0.0], [0.0, 0.5]])
    np.testing.assert_array_equal(lengths_of(directions, np.array([1e6, 0.1])), [1e6, 1.0])
