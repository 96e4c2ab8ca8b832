"""Tables in the place of comparisons have the same values and derivatives, and are faster."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.numerics.evaluation import Evaluator
from mbdcasadi.numerics.lookup import MANY, with_tables

X, Y = ca.SX.sym("x"), ca.SX.sym("y")
POINTS = np.linspace(-1, 2, 40) ** 3
DATA = np.cos(3 * POINTS)
DATA[-1] = DATA[0]
GRID = np.linspace(-2, 2, MANY + 4)
EXPRESSIONS = {
    **{
        f"{kind}, {outside}": mbd.spline(X, POINTS, DATA, kind=kind, outside=outside)
        for kind, outside in [
            ("cubic", "error"), ("cubic", "periodic"), ("monotone", "constant"), ("linear", "linear")
        ]
    },
    "two": mbd.spline(X, POINTS, DATA) * mbd.spline(Y * X, POINTS, DATA, outside="linear"),
    "surface": mbd.table(X, Y, GRID, GRID, np.sin(GRID[:, None]) * GRID, outside="linear"),
    "nested": mbd.spline(mbd.spline(X, POINTS, DATA), POINTS, DATA, outside="constant"),
    "strict": sum(ca.if_else(X > x, x, ca.if_else(X <= x + 0.1, Y, 0)) for x in POINTS),
    "logic": sum(ca.if_else(ca.logic_and(X < x, ca.logic_not(X >= -x)), ca.sqrt(x + 9), Y) for x in POINTS),
}  # fmt: skip


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_values_and_derivatives_are_the_same_bit_for_bit(name):
    expression = EXPRESSIONS[name]
    function = ca.Function("f", [X, Y], [expression, ca.gradient(expression, ca.vertcat(X, Y))], ["x", "y"], ["f", "g"])
    looked_up = with_tables(function)
    assert looked_up.is_a("MXFunction")
    assert (looked_up.name_in(), looked_up.name_out()) == (function.name_in(), function.name_out())
    border = np.r_[POINTS, POINTS + 0.1, GRID]
    x = np.r_[np.linspace(-3, 9, 500), border, np.nextafter(border, 9), np.nextafter(border, -9)]
    y = np.random.default_rng(1).uniform(-2, 2, x.size)
    for ours, theirs in zip(looked_up(x[None], y[None]), function(x[None], y[None]), strict=True):
        np.testing.assert_array_equal(ours.full(), theirs.full())


def test_derivatives_of_a_table_are_those_of_the_curve():
    function = with_tables(ca.Function("f", [X], [mbd.spline(X, POINTS, DATA)]))
    x = ca.MX.sym("x")
    slope = ca.Function("slope", [x], [ca.jacobian(function(x), x)])
    exact = ca.Function("slope", [X], [ca.jacobian(mbd.spline(X, POINTS, DATA), X)])
    at = np.linspace(-0.9, 7.9, 100)[None]
    np.testing.assert_allclose(slope(at).full(), exact(at).full(), rtol=1e-14)


def test_functions_with_few_comparisons_stay():
    few = ca.Function("few", [X], [mbd.spline(X, [0, 1, 2, 3], [0, 1, 0, 2])])
    assert with_tables(few) is few
    other = ca.Function("other", [X, Y], [sum(ca.if_else(X > k * Y, k, 0) for k in range(2 * MANY))])
    assert with_tables(other) is other
    assert with_tables(with_tables(few)) is few


def test_a_long_spline_costs_few_instructions():
    xs = np.linspace(0, 1, 500)
    function = ca.Function("f", [X, Y], [mbd.spline(X, xs, np.sin(xs)) * Y])
    looked_up = with_tables(function)
    assert function.n_instructions() > 5000
    assert looked_up.n_instructions() < 20
    np.testing.assert_array_equal(
        Evaluator(looked_up).rows(xs[:, None], np.ones((500, 1)))[0],
        Evaluator(function).rows(xs[:, None], np.ones((500, 1)))[0],
    )


def test_sparse_results_keep_their_pattern():
    column = ca.SX(3, 1)
    column[1] = mbd.spline(X, POINTS, DATA)
    looked_up = with_tables(ca.Function("f", [X], [column, X**2]))
    assert looked_up.sparsity_out(0) == column.sparsity()
    np.testing.assert_allclose(looked_up(POINTS[3])[0].full()[:, 0], [0, DATA[3], 0])
