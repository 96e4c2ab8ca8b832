"""Derivatives backwards in time of an integrator over one piece, against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.integrators.compiled import Clock, Dae
from mbdcasadi.integrators.failures import reason_of
from mbdcasadi.integrators.reversible import ReversibleIntegrator


def decaying():
    """``x' = -a x + b t + u``: a system of two parameters, of which one is carried or both."""
    clock = Clock()
    x, p, u = ca.SX.sym("x"), ca.SX.sym("p", 2), ca.SX.sym("u")
    return Dae(clock, x, ca.SX(0, 1), p, u, -p[0] * x + p[1] * clock.t + u, ca.SX(0, 1))


def exact(x, start, length, a, b, u):
    """The state at the end of a piece."""
    end = start + length
    forced = [b * (a * time - 1) / a**2 + u / a for time in (start, end)]
    return forced[1] + (x - forced[0]) * np.exp(-a * length)


def test_derivatives_by_start_length_parameters_and_inputs():
    function = ReversibleIntegrator(decaying(), mbd.IDAS(), [0, 1]).function(np.array([0.25, 1.0]))
    x0, p, u = ca.MX.sym("x0", 2), ca.MX.sym("p", 4), ca.MX.sym("u")
    end = function(x0=x0, p=p, u=u)["xf"][0, -1]
    slopes = ca.Function("slopes", [x0, p, u], [end, *(ca.gradient(end, s) for s in (x0, p, u))])
    values = np.array([0.7, 0.3, 2.0, 0.9, 1.7, -0.4])
    given = [[values[0], 0.0], values[1:5], values[5]]
    reached, *found = slopes(*given)
    assert float(reached) == pytest.approx(exact(*values), abs=1e-8)
    found = np.r_[found[0].full()[0], found[1].full().ravel(), found[2].full().ravel()]
    step = 1e-6 * np.eye(6)
    wanted = [(exact(*(values + e)) - exact(*(values - e))) / 2e-6 for e in step]
    np.testing.assert_allclose(found, wanted, rtol=1e-7, atol=1e-7)


def test_the_clock_and_the_outputs_are_those_of_the_piece():
    function = ReversibleIntegrator(decaying(), mbd.IDAS(), []).function(np.array([0.5, 1.0]), least_steps=10)
    states = function(x0=[1, 0], p=[0.3, 2, 0.9, 1.7], u=0.0)["xf"].full()
    np.testing.assert_allclose(states[1], [0.5, 1.0], atol=1e-9)
    np.testing.assert_allclose(states[0, 0], exact(1, 0.3, 1, 0.9, 1.7, 0), atol=1e-8)


def test_reasons_are_plain_words():
    assert "as many steps as it may" in reason_of(
        RuntimeError('x.cpp:620: IDASolveB returned "IDA_TOO_MUCH_WORK". See')
    )
    assert reason_of(RuntimeError("first\nlast")) == "last"
