"""Every element of the catalogue, unchanged, in kinematics, inverse dynamics, simulation by IDAS and optimal control.

The motion of each machine is prescribed, its effort found in two ways and replayed;
then the machine is brought from rest to rest with least effort and verified.
"""

import numpy as np
import pytest
from machines import MACHINES

import mbdcasadi as mbd

#: Machines whose pose or states do not follow from the coordinate that is moved.
FROM_A_STATE = ("NonholonomicConstraint", "RollingOnCurve", "MassFlow")


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_prescribed_motion_and_its_replay(name):
    """Kinematics; effort of the driver; the input that takes its place; IDAS with that input gives the motion back."""
    m = MACHINES[name]()
    start = mbd.assemble(m.mechanism)
    course = m.by * mbd.step(mbd.t, 0, 0, 1.0, 1)
    driver = mbd.Driver("drive", m.s, course, relative_to=start)
    times = np.linspace(0, 1.0, 401)
    driven = m.mechanism.replace(drivers=[*m.mechanism.drivers, driver])
    moved = mbd.kinematics(driven, times)
    run = mbd.inverse_dynamics(driven, times)
    np.testing.assert_allclose(moved.q, run.q, atol=1e-9)
    assert moved[m.s][-1] - start[m.s] == pytest.approx(m.by)
    found = mbd.inverse_dynamics(m.mechanism, motion=run, efforts=[m.u])
    size = 1 + np.max(np.abs(run[driver.effort]))
    np.testing.assert_allclose(found[m.u], run[driver.effort], atol=1e-9 * size)
    effort = mbd.spline(mbd.t, times, found[m.u], outside="constant")
    replay = mbd.simulate(m.mechanism, times, initial=found.initial, inputs={m.u: effort})
    np.testing.assert_allclose(replay[m.s], run[m.s], atol=1e-4 * (1 + abs(m.by)))
    assert replay.drift.position < 1e-12 and replay.drift.velocity < 1e-11


@pytest.mark.slow
@pytest.mark.parametrize("name", MACHINES)
def test_least_effort_from_rest_to_rest(name):
    """Solved, and verified by IDAS with the solution's own inputs."""
    m = MACHINES[name]()
    start = mbd.assemble(m.mechanism)
    speed = mbd.time_derivative(m.s)
    rest = [m.s == start[m.s], speed == 0]
    problem = mbd.OptimalControlProblem(
        m.mechanism,
        duration=1.0,
        initial=start if name in FROM_A_STATE else rest,
        final=[m.s == start[m.s] + m.by, speed == 0],
        running_cost=m.u**2,
    )
    solution = mbd.optimize(problem, intervals=30)
    assert solution.trajectory[m.s][-1] == pytest.approx(start[m.s] + m.by, abs=1e-6)
    assert solution.verify().final_error < 1e-3
