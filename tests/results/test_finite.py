"""Values that do not exist, and trajectories without times."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.results.trajectory import Trajectory

body = mbd.Body("body", 2, 0.5, velocity=(1, 0, 0))
free = mbd.Mechanism(bodies=[body])
curve = mbd.spline(body.x, [0, 0.5, 1, 2], [0, 0.25, 1, 4], outside="error")


def test_a_motion_that_leaves_the_data_of_a_spline_says_when():
    """The first output beyond the end, instead of NaN."""
    motion = mbd.simulate(free, np.linspace(0, 3, 31))
    for expression in (curve, mbd.vertcat(body.x, curve), curve * body.inertia):
        with pytest.raises(mbd.ExpressionError, match=r"not finite at t = 2\.1 s.*spline") as error:
            motion[expression]
        assert error.value.time == pytest.approx(2.1)
    inside = mbd.simulate(free, np.linspace(0, 2, 21))[curve]
    np.testing.assert_allclose(inside, np.linspace(0, 2, 21) ** 2, atol=1e-7)


def test_a_state_says_so_too():
    """A spline that is left, the root of a negative number."""
    state = mbd.assemble(free, [body.x == 5], t=0.5)
    for expression in (curve, mbd.sqrt(-body.x), mbd.vertcat(1, curve)):
        with pytest.raises(mbd.ExpressionError, match=r"not finite at t = 0\.5 s"):
            state[expression]


def test_what_is_unknown_stays_nan():
    """Multipliers that an analysis does not know are no error of the expression."""
    held = free.replace(joints=[mbd.AbsoluteX("held", body.at(0, 0))])
    nothing = np.full((2, 1), np.nan)
    zero = np.zeros((2, 3))
    motion = Trajectory(held, [0, 1], zero, zero, zero, np.zeros((2, 0)), nothing, np.zeros((2, 0)), [])
    reaction = held.joint("held").reaction_on(body)
    assert np.all(np.isnan(motion[reaction.force[0]]))
    assert np.all(motion[body.x] == 0)
    assert np.isnan(motion.final[reaction.force[0]])
    with pytest.raises(mbd.ExpressionError, match="t = 0 s"):
        motion[mbd.log(body.x - 1)]  # nothing unknown in it


def test_a_trajectory_without_times():
    """Shapes are known, expressions have no values, and there is no first state."""
    held = free.replace(joints=[mbd.AbsoluteX("held", body.at(0, 0))])
    empty = Trajectory(held, [], [], [], [], [], [], [], [])
    assert empty.q.shape == (0, 3) and empty.lam.shape == (0, 1) and empty.inputs.shape == (0, 0)
    assert empty[body.x].shape == (0,) and empty[body.position].shape == (0, 2)
    assert empty[empty.equations.M].shape == (0, 3, 3)
    assert len(empty) == 0 and "no times" in repr(empty) and empty.drift.position == 0
    for ask in (lambda: empty.initial, lambda: empty.final, lambda: empty.at(0.0)):
        with pytest.raises(mbd.MechanismError, match="times"):
            ask()
