"""The nearest solution of equations, with and without inequalities, on curves with known answers."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import brentq, nnls

from mbdcasadi.numerics.least_squares import least_norm_step
from mbdcasadi.numerics.nearest import multipliers_at, nearest, project_with_inequalities
from mbdcasadi.numerics.newton import refine_root, solve


def ellipse(x):
    """``x²/4 + y² = 1``."""
    return np.array([x[0] ** 2 / 4 + x[1] ** 2 - 1]), np.array([[x[0] / 2, 2 * x[1]]])


def nearest_on_ellipse(target, weights):
    """By the multiplier: ``w (x - target) + lam grad = 0``, for a target outside."""

    def point(lam):
        return np.array([target[0] / (1 + lam / (2 * weights[0])), target[1] / (1 + 2 * lam / weights[1])])

    return point(brentq(lambda lam: ellipse(point(lam))[0][0], 0, 1e4, xtol=1e-15, rtol=1e-15))


@pytest.mark.parametrize("weights", [(1.0, 1.0), (1.0, 30.0), (0.02, 1.0)])
@pytest.mark.parametrize("target", [(3.0, 1.0), (0.5, 4.0), (2.2, 0.1), (-3.0, 2.0)])
def test_the_nearest_point_of_an_ellipse(target, weights):
    """To 1e-10 of the closed form, far below where the distance is flat to rounding."""
    target, weights = np.array(target), np.array(weights)
    start = solve(ellipse, target + np.array([0.3, -0.2]), weights).x
    found = nearest(ellipse, start, target, weights)
    np.testing.assert_allclose(found, nearest_on_ellipse(target, weights), atol=1e-10)


def test_redundant_equations_do_no_harm():
    """The same row twice, and once more scaled."""

    def rows(x):
        value, slope = ellipse(x)
        return np.r_[value, value, 3 * value], np.vstack([slope, slope, 3 * slope])

    target, weights = np.array([2.5, 1.5]), np.ones(2)
    start = solve(rows, target, weights).x
    np.testing.assert_allclose(nearest(rows, start, target, weights), nearest_on_ellipse(target, weights), atol=1e-10)


def test_a_target_that_no_point_is_nearer_to():
    """The centre of a circle: the start stays, whatever the gradient of nothing is."""

    def circle(x):
        return np.array([x @ x - 1]), 2 * x[None, :]

    found = nearest(circle, np.array([0.6, 0.8]), np.zeros(2), np.ones(2))
    np.testing.assert_allclose(found, [0.6, 0.8], atol=1e-9)


def test_without_equations_the_target_is_nearest():
    """No rows at all."""
    found = nearest(lambda x: (np.zeros(0), np.zeros((0, 3))), np.zeros(3), np.array([1.0, 2, 3]), np.ones(3))
    np.testing.assert_allclose(found, [1, 2, 3], atol=1e-14)


def test_rows_without_slope_give_no_step():
    """Neither a step nor a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        step = least_norm_step(np.zeros((2, 3)), np.ones(2), np.ones(3), 0.0)
        outcome = solve(lambda x: (np.array([x @ x - 1]), 2 * x[None, :]), np.zeros(2), np.ones(2))
    np.testing.assert_array_equal(step, 0)
    assert not outcome.converged


def test_polishing_goes_down_to_rounding():
    """A root near 1e3, where a tolerance relative to the size of x would leave 1e-10."""
    x = refine_root(lambda x: (np.sin(x), np.diag(np.cos(x))), np.array([320 * np.pi + 1e-6]), np.ones(1))
    assert abs(np.sin(x[0])) <= 2e-13


# --- inequalities ----------------------------------------------------------------------
def within(matrix, right, target, weights, active=()):
    """Nearest point with ``matrix @ x <= right``, by the active set."""

    def meet(held):
        rows = matrix[list(held)]
        root = np.sqrt(weights)
        step = np.linalg.lstsq(rows / root, right[list(held)] - rows @ target, rcond=1e-11)[0]
        if held and np.max(np.abs(rows @ (target + step / root) - right[list(held)])) > 1e-9:
            raise ValueError
        return target + step / root

    def pushes(x, held):
        return multipliers_at(matrix[list(held)], x - target, weights)

    return project_with_inequalities(meet, lambda x: matrix @ x - right, pushes, active)


def test_a_constraint_that_another_implies_is_released():
    """x >= 1 and x + y >= 0.5, nearest to 0: the second binds first and lets go."""
    matrix, right = -np.array([[1.0, 0], [1, 1]]), -np.array([1.0, 0.5])
    np.testing.assert_allclose(within(matrix, right, np.zeros(2), np.ones(2)), [1, 0], atol=1e-12)
    np.testing.assert_allclose(within(matrix, right, np.zeros(2), np.ones(2), active=[0, 1]), [1, 0], atol=1e-12)


@pytest.mark.parametrize("seed", range(20))
def test_random_polyhedra(seed):
    """The conditions of Karush, Kuhn and Tucker hold, which for this convex problem one point alone meets."""
    rng = np.random.default_rng(seed)
    matrix, weights, target = rng.normal(size=(6, 8)), rng.uniform(0.2, 5, 8), rng.normal(size=8)
    right = matrix @ rng.normal(size=8) + rng.uniform(0, 0.2, 6)  # a point within exists
    found = within(matrix, right, target, weights)
    assert np.all(matrix @ found <= right + 1e-9)
    binding = matrix[matrix @ found >= right - 1e-9]
    # the pull towards the target is a sum of pushes outwards, none of them negative
    _, left_over = nnls(binding.T, -weights * (found - target)) if len(binding) else (None, found - target)
    assert np.linalg.norm(left_over) < 1e-7


def test_a_set_that_comes_round_ends():
    """None, instead of an endless search."""
    points = {(): 0.0, (0,): 1.0, (0, 1): 2.0, (1,): 3.0}
    values = {0.0: [1.0, 0.0], 1.0: [0.0, 1.0], 2.0: [0.0, 0.0], 3.0: [1.0, 0.0]}
    found = project_with_inequalities(
        lambda held: np.array([points[tuple(sorted(held))]]),
        lambda x: np.array(values[float(x[0])]),
        lambda x, held: np.array([-1.0 if k == 0 and len(held) == 2 else 1.0 for k in held]),
    )
    assert found is None


def test_a_solution_that_is_alone_is_there_at_once():
    """Two curves cross at a point: nothing to slide along, whatever the weights."""
    calls = []

    def crossing(x):
        calls.append(x)
        return np.array([x[0] ** 2 / 4 + x[1] ** 2 - 1, x[0] - x[1]]), np.array([[x[0] / 2, 2 * x[1]], [1.0, -1.0]])

    start = solve(crossing, np.array([1.0, 1.0]), np.ones(2)).x
    calls.clear()
    found = nearest(crossing, start, np.array([3.0, -2.0]), np.array([1.0, 1e-9]))
    np.testing.assert_allclose(found, np.full(2, np.sqrt(0.8)), rtol=1e-15)
    assert len(calls) < 10
