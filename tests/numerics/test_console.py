"""Calls of compiled code for many points, of which some meet singular matrices."""

import os
import signal
import time

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.numerics.console import call_each, is_singular, keyboard_interrupts

x, y = ca.MX.sym("x", 2), ca.MX.sym("y")
MATRIX = ca.blockcat([[x[0], 1], [1, x[1]]])
SOLVE = ca.Function("f", [x, y], [ca.solve(MATRIX, ca.vertcat(1, y), "csparse"), y])


def roots():
    """Root of ``a u² = b`` by Newton's method: singular at u = 0, without a root if b is negative."""
    u, a, b = ca.MX.sym("u"), ca.MX.sym("a"), ca.MX.sym("b")
    residual = ca.Function("r", [u, a, b], [a * u**2 - b])
    options = {"linear_solver": "csparse", "error_on_fail": False, "max_iter": 50}
    root = ca.rootfinder("root", "newton", residual, options)
    return ca.Function("root", [u, a, b], [root(u, a, b)])


@pytest.mark.parametrize("count", [1, 2, 7, 64])
def test_singular_points_are_nan_and_the_others_right(count):
    generator = np.random.default_rng(count)
    diagonal = generator.uniform(2, 3, (2, count))
    singular = generator.uniform(size=count) < 0.3
    diagonal[:, singular] = [[0.5], [2.0]]
    found, given = call_each(SOLVE, diagonal, 3.0)
    assert found.shape == (2, count) and given.shape == (1, count)
    assert np.all(np.isnan(found[:, singular]))
    a, b = diagonal[:, ~singular]
    np.testing.assert_allclose(found[:, ~singular], np.array([b - 3, 3 * a - 1]) / (a * b - 1))


def test_root_finders_count_as_well():
    u, a, b = np.array([[1.0, 0.0, 2.0]]), 1.0, np.array([[4.0, 4.0, 9.0]])
    np.testing.assert_allclose(call_each(roots(), u, a, b)[0], [[2.0, np.nan, 3.0]])


def test_other_errors_are_raised():
    with pytest.raises(RuntimeError):
        call_each(SOLVE, np.ones((3, 2)), 1.0)
    assert not is_singular(ValueError("singular"))
    assert is_singular(RuntimeError("CsparseInterface::prepare: factorization failed, check if Jacobian is singular"))


def test_points_without_entries():
    nothing = ca.SX.sym("n", 0)
    function = ca.Function("f", [nothing, ca.SX.sym("m", 2)], [ca.SX(0, 1), ca.SX(3)])
    empty, constant = call_each(function, np.zeros((0, 5)), np.ones((2, 5)))
    assert empty.shape == (0, 5)
    np.testing.assert_array_equal(constant, np.full((1, 5), 3.0))


@pytest.mark.skipif(os.name != "posix", reason="signals as on POSIX")
@pytest.mark.parametrize("swallowed_as", [None, RuntimeError])
def test_ctrl_c_that_is_swallowed_comes_back(swallowed_as):
    """CasADi's conversions turn Ctrl-C into another error, or into nothing."""

    def swallowing() -> None:
        try:
            os.kill(os.getpid(), signal.SIGINT)
            time.sleep(5)
        except KeyboardInterrupt:
            if swallowed_as is not None:
                raise swallowed_as("not what it was") from None

    with pytest.raises(KeyboardInterrupt), keyboard_interrupts("test"):
        swallowing()
    with pytest.raises(ValueError, match="another"), keyboard_interrupts("test"):
        raise ValueError("another")
