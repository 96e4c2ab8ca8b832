"""Replays of solutions by simulation, also those that stop on the way."""

import numpy as np
import pytest

import mbdcasadi as mbd


def upright(duration=8.0):
    """A pendulum that is brought upright and held there, by a motor whose law has data up to one radian."""
    tau = mbd.Input("tau", lower=-20, upper=20)
    bob = mbd.Body("bob", mass=1.0, inertia=0.1, pose=(0, 1, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, -1))
    share = mbd.spline(pin.angle, np.linspace(-1, 1, 5), np.ones(5), outside="error")
    forces = [mbd.Gravity(), mbd.Torque("motor", bob, tau * share)]
    mechanism = mbd.Mechanism([bob], joints=[pin], forces=forces, inputs=[tau])
    start, end = [pin.angle == 0.3, bob.omega == 0], [pin.angle == 0, bob.omega == 0]
    return bob, mbd.OptimalControlProblem(mechanism, duration, start, end, running_cost=tau**2)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the motion is unstable")
def test_a_replay_that_stops():
    """The pole falls without feedback, out of the data of the motor: up to there the replay is reported."""
    bob, problem = upright()
    solution = mbd.optimize(problem, intervals=20)
    check = solution.verify()
    assert isinstance(check.stopped, mbd.MechanismError) and "spline outside its data" in str(check.stopped)
    fallen = check.trajectory.final
    assert 1 < fallen.t <= check.stopped.time < 8 and 0.05 < abs(fallen[bob.phi]) < 1.01
    assert check.final_error == np.inf and 0 < check.largest_deviation < 2 and check.defects.shape == (20, 2)
    assert f"stopped after t = {fallen.t:.6g} s" in repr(check) and "by idas" in repr(check).lower()


def test_a_replay_that_does_not():
    """In half a second nothing has grown."""
    check = mbd.optimize(upright(0.5)[1], intervals=10).verify()
    assert check.stopped is None and check.final_error < 1e-5
    assert "stopped" not in repr(check)
