"""Periodic splines of degree five: points, smoothness over the seam, order of accuracy."""

import casadi as ca
import numpy as np
import pytest

from mbdcasadi.model.geometry.splines import closed_spline


def derivatives(xs, ys, places):
    """Value and five derivatives (6, n)."""
    x = ca.SX.sym("x")
    parts = [closed_spline(x, xs, ys)]
    for _ in range(5):
        parts.append(ca.jacobian(parts[-1], x))
    return ca.Function("f", [x], [ca.densify(ca.vertcat(*parts))])(np.asarray(places)[None, :]).full()


@pytest.fixture
def data():
    """Uneven points of a smooth periodic function of period 3, from 0.5 on."""
    rng = np.random.default_rng(2)
    xs = 0.5 + np.r_[0, np.cumsum(rng.uniform(0.5, 1.5, 12))]
    xs = 0.5 + (xs - 0.5) * 3 / (xs[-1] - 0.5)
    ys = np.exp(np.sin(2 * np.pi * xs / 3))
    ys[-1] = ys[0]
    return xs, ys


def test_meets_its_points_and_four_derivatives_are_continuous(data):
    """At every point, the seam included, from both sides; the fifth jumps."""
    xs, ys = data
    np.testing.assert_allclose(derivatives(xs, ys, xs)[0], ys, rtol=1e-13)
    before, after = derivatives(xs, ys, xs - 1e-9), derivatives(xs, ys, xs + 1e-9)
    for k in range(5):
        size = np.max(np.abs(derivatives(xs, ys, np.linspace(0.5, 3.5, 400))[k]))
        np.testing.assert_allclose(after[k], before[k], atol=1e-6 * size)
    assert np.max(np.abs(after[5] - before[5])) > 1
    np.testing.assert_allclose(derivatives(xs, ys, [1.1, 4.1, -10.9])[0], derivatives(xs, ys, [1.1] * 3)[0], rtol=1e-12)


def test_sixth_order_accurate():
    """Twice the points, 64 times less error."""
    places = np.linspace(0, 2 * np.pi, 501)
    errors = []
    for n in (16, 32, 64):
        xs = np.linspace(0, 2 * np.pi, n + 1)
        ys = np.exp(np.sin(xs))
        ys[-1] = ys[0]
        errors.append(np.max(np.abs(derivatives(xs, ys, places)[0] - np.exp(np.sin(places)))))
    assert errors[1] / errors[2] == pytest.approx(64, rel=0.2)
    assert errors[2] < 1e-7
