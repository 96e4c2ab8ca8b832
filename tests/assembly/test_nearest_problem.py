"""The active set that poses and velocities share, against projections by hand."""

import numpy as np

import mbdcasadi as mbd
from mbdcasadi.assembly.nearest_problem import residuals_by_element


def test_one_limit_of_two_holds_a_pose():
    ball = mbd.Body("ball", mass=2, inertia=1, pose=(3, 0, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[ball]), [ball.x <= 1, ball.y <= 4])
    np.testing.assert_allclose(state.q, [1, 0, 0], atol=1e-9)


def test_two_limits_hold_a_pose_at_their_corner():
    ball = mbd.Body("ball", mass=2, inertia=1, pose=(3, 0, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[ball]), [ball.x <= 1, ball.x + ball.y <= 0])
    np.testing.assert_allclose(state.q, [1, -1, 0], atol=1e-9)


def test_two_limits_hold_a_velocity_at_their_corner():
    ball = mbd.Body("ball", mass=2, inertia=1, velocity=(3, 0, 5))
    state = mbd.assemble(mbd.Mechanism(bodies=[ball]), [ball.vx <= 1, ball.vx + ball.vy <= 0])
    np.testing.assert_allclose(state.v, [1, -1, 5], atol=1e-9)


def test_largest_residual_of_each_element():
    pin, slide = (mbd.Body(name, mass=1, inertia=1) for name in ("pin", "slide"))
    assert residuals_by_element([pin, pin, slide], np.array([1.0, -2.0, 3.0])) == {"slide": 3.0, "pin": 2.0}
