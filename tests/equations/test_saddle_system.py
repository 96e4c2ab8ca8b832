"""The saddle system of rows in a metric, against dense linear algebra."""

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_case

import mbdcasadi as mbd
from mbdcasadi.equations.dynamics import dynamics_saddle
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.equations.saddle import ON_THE_WAY, REPORTED, SHIFTED, Saddle


def numbers(*expressions):
    """Values of constant expressions."""
    return [np.squeeze(ca.DM(ca.evalf(x)).full()) for x in expressions]


def system(seed, n=7, m=4, dependent=0):
    """A metric (n,), rows (m, n) of which some repeat others, and right sides."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(m, n))
    rows = np.vstack([rows, rng.normal(size=(dependent, m)) @ rows])
    return rng.uniform(0.5, 2, n), rows, rng.normal(size=n), rng.normal(size=m + dependent)


def block(metric, rows):
    """The matrix of the system."""
    return np.block([[metric, rows.T], [rows, np.zeros((len(rows), len(rows)))]])


def straight(rows):
    """No row is in rad."""
    return np.zeros(len(rows), bool)


@pytest.mark.parametrize("is_matrix", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_solution_and_projection(seed, is_matrix):
    """A diagonal metric, or any that is positive."""
    metric, rows, load, right = system(seed)
    metric = np.diag(metric) + is_matrix * 0.1 * np.ones((7, 7))
    saddle = Saddle(ca.SX(ca.DM(metric if is_matrix else np.diag(metric))), ca.SX(ca.DM(rows)), straight(rows))
    x, lam = numbers(*saddle.solve(ca.SX(ca.DM(load)), ca.SX(ca.DM(right))))
    np.testing.assert_allclose(np.r_[x, lam], np.linalg.solve(block(metric, rows), np.r_[load, right]), atol=1e-12)
    (change,) = numbers(saddle.project(ca.SX(ca.DM(right))))
    exact = np.linalg.solve(block(metric, rows), np.r_[np.zeros(7), right])[:7]
    np.testing.assert_allclose(change, exact, atol=1e-12)


def test_several_right_sides_at_once():
    """By column."""
    metric, rows, _, _ = system(0)
    rng = np.random.default_rng(1)
    loads, rights = rng.normal(size=(7, 3)), rng.normal(size=(4, 3))
    saddle = Saddle(ca.SX(ca.DM(metric)), ca.SX(ca.DM(rows)), straight(rows))
    x, lam = numbers(*saddle.solve(ca.SX(ca.DM(loads)), ca.SX(ca.DM(rights))))
    exact = np.linalg.solve(block(np.diag(metric), rows), np.vstack([loads, rights]))
    np.testing.assert_allclose(np.vstack([x, lam]), exact, atol=1e-12)


def test_without_rows():
    """Loads over masses."""
    saddle = Saddle(ca.SX(ca.DM([2, 4])), ca.SX(0, 2), np.zeros(0, bool))
    x, lam = saddle.solve(ca.SX(ca.DM([1, 1])), ca.SX(0, 1))
    assert numbers(x)[0] == pytest.approx([0.5, 0.25]) and lam.numel() == 0


@pytest.mark.parametrize("refinement", [ON_THE_WAY, REPORTED])
def test_dependent_rows_share_their_load(refinement):
    """Multipliers of least norm, by the pseudo-inverse, to rounding; the solution is that of independent rows."""
    metric, rows, load, _ = system(2, dependent=2)
    right = rows @ np.random.default_rng(3).normal(size=7)
    saddle = Saddle(ca.SX(ca.DM(metric)), ca.SX(ca.DM(rows)), straight(rows), refinement)
    x, lam = numbers(*saddle.solve(ca.SX(ca.DM(load)), ca.SX(ca.DM(right))))
    schur = rows @ np.diag(1 / metric) @ rows.T
    exact = np.linalg.pinv(schur, rcond=1e-10) @ (rows @ (load / metric) - right)
    np.testing.assert_allclose(lam, exact, atol=1e-9)
    np.testing.assert_allclose(rows @ x, right, atol=1e-9)


def test_one_shifted_step_is_short_near_a_singular_pose():
    """A small residual in nearly dependent rows moves coordinates little; unshifted it would throw them."""
    rows = np.array([[1.0, 0.0], [1.0, 1e-6]])
    residual = ca.SX(ca.DM([0.0, 1e-6]))
    steps = [
        numbers(Saddle(ca.SX.ones(2), ca.SX(ca.DM(rows)), straight(rows), how).project(residual))[0]
        for how in (SHIFTED, None)
    ]
    assert np.max(np.abs(steps[0])) < 1e-5 and np.max(np.abs(steps[1])) > 0.1


@pytest.mark.parametrize("angle", [0.5, 0.1, 0.01, 1e-4])
def test_the_pivot_falls_with_the_square_of_the_distance(angle):
    """Two rows of any lengths at an angle: ``sin² angle``."""
    rows = np.array([[3.0, 0.0], [0.2 * np.cos(angle), 0.2 * np.sin(angle)]])
    saddle = Saddle(ca.SX.ones(2), ca.SX(ca.DM(rows)), straight(rows))
    assert numbers(saddle.pivot())[0] == pytest.approx(np.sin(angle) ** 2, rel=1e-7)


@pytest.mark.parametrize("seed", range(6))
def test_determinant_of_the_system(seed):
    """``det W det(-S)``, as of all equations for accelerations and multipliers."""
    case = random_case(seed)
    eom = mbd.equations(case.mechanism)
    numeric = NumericEquations(eom, eom.parameter_values)
    schur = ca.Function("schur", [eom.t, eom.q, eom.p], [dynamics_saddle(eom, numeric.augmentation).schur])
    rows = eom.jacobian(0.0, case.pose, eom.parameter_values)[0].full()
    sign, size = np.linalg.slogdet(block(np.diag(numeric.mass), rows))
    own_sign, own_size = np.linalg.slogdet(-schur(0.0, case.pose, eom.parameter_values).full())
    assert own_sign == sign and own_size + np.sum(np.log(numeric.mass)) == pytest.approx(size, rel=1e-9)


def test_factors_of_a_mechanism_are_made_once():
    """One system serves forward dynamics, pivots and variations."""
    eom = mbd.equations(random_case(0).mechanism)
    numeric = NumericEquations(eom, eom.parameter_values)
    assert numeric.saddle() is numeric.saddle()
    assert numeric.saddle(ON_THE_WAY) is not numeric.saddle()
