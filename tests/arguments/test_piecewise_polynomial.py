"""Inputs that are polynomials piece by piece."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.arguments.piecewise_polynomial import PiecewisePolynomial


def test_time_just_before_a_break():
    """A time that counts as that of the break belongs to the piece that begins there, also where a run restarts."""
    step = PiecewisePolynomial([0.0, 1.0, 3.0], [[1.0], [-2.0]])
    np.testing.assert_array_equal(step.interval([0.0, 0.999, 1 - 1e-10, 1.0, 3.0]), [0, 0, 1, 1, 1])
    force = mbd.Input("force")
    cart = mbd.Body("cart", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    model = mbd.Mechanism([cart], [rail], forces=[mbd.Force("push", cart.at(0, 0), (force, 0))], inputs=[force])
    half = mbd.Event("half a metre", cart.x - 0.5 * (1 - 1e-11), direction=1, reset={cart.vx: 1.0})
    motion = mbd.simulate(model, [0, 3], initial=[cart.x == 0, cart.vx == 0], inputs={force: step}, events=[half])
    assert motion.final[cart.vx] == pytest.approx(1 - 2 * 2, abs=1e-8)
