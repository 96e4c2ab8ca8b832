"""Curvature of costs: exact for squares of linear terms, not negative for squares of others."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.linear.curvature import curvature


def value_of(cost, variables, at):
    """Curvature at a point."""
    return ca.Function("h", [variables], [curvature(cost, variables)])(at).full()


def test_quadratic_forms_are_exact():
    """Sums of squares of linear terms, with products between them, have their Hessian."""
    x = ca.SX.sym("x", 2)
    cost = 3 * (x[0] - 2) ** 2 + 2 * x[0] * x[1] - (-(x[1] ** 2)) / 2 + 2 * (x[0] ** 2)
    assert value_of(cost, x, [0.3, -0.4]) == pytest.approx(np.array([[10, 2], [2, 1.0]]))


def test_curvature_inside_a_square_is_left_out():
    """``(sin x)²`` has ``2 cos² x``, which is not negative where its second derivative is."""
    x = ca.SX.sym("x")
    assert value_of(5 * ca.sin(x) ** 2, x, 1.4).item() == pytest.approx(10 * np.cos(1.4) ** 2)


def test_squares_that_are_subtracted_keep_their_hessian():
    """A negative factor makes no square positive."""
    x = ca.SX.sym("x")
    assert value_of(2 * x - 3 * x**2, x, 1.0).item() == pytest.approx(-6)
