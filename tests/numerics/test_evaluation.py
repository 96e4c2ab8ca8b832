"""Compiled functions through buffers, against CasADi's own calls."""

import casadi as ca
import numpy as np
import pytest
from threads import together

from mbdcasadi.numerics.evaluation import Evaluator

x, y = ca.SX.sym("x", 3), ca.SX.sym("y", 2)
RESULTS = [x * ca.sum1(y), ca.jacobian(ca.vertcat(x[0] ** 2 * y[1], x[2]), x), ca.SX(0, 1), ca.SX(2, 3), ca.dot(x, x)]
FUNCTION = ca.Function("f", [x, y], RESULTS)


def test_values_and_shapes():
    """Dense, sparse, empty and structurally zero results."""
    at = [0.3, -1.2, 2.0], [0.7, 5.0]
    for found, wanted in zip(Evaluator(FUNCTION)(*at), FUNCTION(*at), strict=True):
        np.testing.assert_array_equal(found, wanted.full())


def test_results_are_kept():
    """A later call does not write into what an earlier one returned."""
    evaluate = Evaluator(FUNCTION)
    first = evaluate([1, 2, 3], [1, 1])[0]
    evaluate([5, 5, 5], [1, 1])
    np.testing.assert_array_equal(first.ravel(), [2, 4, 6])


def test_each_thread_has_its_own_buffers():
    """Threads that share a function do not see each other's arguments."""
    evaluate, wrong = Evaluator(FUNCTION), []

    def run(number: int) -> None:
        for k in range(3000):
            found = evaluate([number, k, -k], [1, 1])[0].ravel()
            if not np.array_equal(found, [2 * number, 2 * k, -2 * k]):
                wrong.append((number, k, found))

    together([lambda number=number: run(number) for number in range(4)])
    assert not wrong


@pytest.mark.parametrize("arguments", [([1, 2], [3, 4]), ([1, 2, 3],), ([1, 2, 3], [4, 5], [6])])
def test_arguments_that_do_not_fit_are_refused(arguments):
    """Wrong lengths, too few, too many."""
    with pytest.raises(ValueError):
        Evaluator(FUNCTION)(*arguments)


@pytest.mark.parametrize("short", [0, 1000])
@pytest.mark.parametrize("count", [0, 1, 2, 3, 15, 16, 17, 33, 300])
def test_many_points(count, short, monkeypatch):
    """By row what CasADi gives by column, some arguments the same at all points; of short functions and of others."""
    monkeypatch.setattr("mbdcasadi.numerics.evaluation.SHORT", short)
    rng = np.random.default_rng(count)
    points, shared = rng.standard_normal((count, 3)), [0.7, 5.0]
    found = Evaluator(FUNCTION).rows(points, shared)
    for k, point in enumerate(points):
        for rows, wanted in zip(found, FUNCTION(point, shared), strict=True):
            np.testing.assert_array_equal(rows[k], wanted.full().ravel(order="F"))
    assert [rows.shape for rows in found] == [(count, 3), (count, 6), (count, 0), (count, 6), (count, 1)]


def test_many_points_with_arguments_of_their_own():
    """Arguments that vary stay beside each other, and what was returned is kept."""
    evaluate, points, factors = Evaluator(FUNCTION), np.arange(60.0).reshape(20, 3), np.arange(40.0).reshape(20, 2)
    first = evaluate.rows(points, factors)[0]
    evaluate.rows(-points, factors)
    np.testing.assert_array_equal(first, points * np.sum(factors, axis=1)[:, None])
