"""Path conditions that prescribe a motion: the torque is that of inverse dynamics."""

import numpy as np
import pytest
from motions import crank_rocker, half_turn

import mbdcasadi as mbd

T = 0.6
S = mbd.t / T
BLEND = 10 * S**3 - 15 * S**4 + 6 * S**5


def torque_error(f, expression, value, problem=None, **settings):
    """Largest difference from the torque of inverse dynamics, relative to its peak; the solution."""
    problem = problem or half_turn(f)
    prescribed = problem.replace(initial=[], final=[], path=[expression == value], running_cost=0)
    solution = mbd.optimize(prescribed, **settings)
    times = np.linspace(0, T, 61)
    reference = mbd.inverse_dynamics(problem.mechanism, times, motion={expression: value}, efforts=[f.tau])
    torque = reference[f.tau]
    error = np.max(np.abs(solution.trajectory.at(times)[f.tau] - torque)) / np.max(np.abs(torque))
    assert np.allclose(solution.trajectory.at(times).q, reference.q, atol=1e-6)
    return error, solution


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        (dict(intervals=40, degree=5), 1e-6),
        (dict(intervals=220), 1e-6),
        (dict(intervals=40), 5e-4),
        (dict(intervals=120, transcription="hermite-simpson"), 1e-6),
    ],
)
def test_a_crank(settings, limit):
    """Half a turn at the actuator itself."""
    f = crank_rocker()
    error, solution = torque_error(f, f.crank.phi, 0.5 + np.pi * BLEND, **settings)
    assert error <= limit
    assert solution.verify().final_error < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("settings", "limit"),
    [
        (dict(intervals=40, degree=5), 1e-6),
        (dict(intervals=120), 1e-6),
        (dict(intervals=120, transcription="hermite-simpson"), 1e-6),
    ],
)
def test_an_output_link(settings, limit):
    """The rocker's motion is prescribed; the motor is at the crank."""
    f = crank_rocker()
    ends = [float(mbd.assemble(f.mechanism, [f.crank.phi == a])[f.rocker.phi]) for a in (0.9, 1.9)]
    error, _ = torque_error(f, f.rocker.phi, ends[0] + (ends[1] - ends[0]) * BLEND, **settings)
    assert error <= limit


@pytest.mark.slow
def test_a_point_of_the_coupler():
    """One coordinate of a point on the coupler, far from the actuator."""
    f = crank_rocker()
    point = f.coupler.at(0.03, 0.08)
    ends = [float(mbd.assemble(f.mechanism, [f.crank.phi == a])[point.x]) for a in (0.6, 1.6)]
    error, _ = torque_error(f, point.x, ends[0] + (ends[1] - ends[0]) * BLEND, intervals=60, degree=5)
    assert error <= 1e-6


@pytest.mark.slow
def test_a_speed():
    """A speed prescribed, linear in velocities: the crank turns evenly from its angle."""
    f = crank_rocker()
    problem = half_turn(f).replace(initial=[f.crank.phi == 0.5], final=[], path=[f.crank.omega == 4.0], running_cost=0)
    solution = mbd.optimize(problem, intervals=40, degree=5)
    times = np.linspace(0, T, 61)
    reference = mbd.inverse_dynamics(f.mechanism, times, motion={f.crank.phi: 0.5 + 4.0 * mbd.t}, efforts=[f.tau])
    torque = reference[f.tau]
    assert np.allclose(solution.trajectory.at(times)[f.tau], torque, atol=1e-6 * np.max(np.abs(torque)))


def test_two_inputs_follow_a_path():
    """A two-link arm draws a straight line: both torques are those of inverse dynamics."""
    torques = mbd.Input("t1"), mbd.Input("t2")
    upper = mbd.Body("upper", mass=2.0, inertia=2 * 0.5**2 / 12, pose=(0.2, 0.15, 0.6))
    fore = mbd.Body("fore", mass=1.0, inertia=0.4**2 / 12, pose=(0.5, 0.2, -0.6))
    joints = [
        mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.25, 0)),
        mbd.Revolute("elbow", upper.at(0.25, 0), fore.at(-0.2, 0)),
    ]
    motors = [mbd.Torque("m1", upper, torques[0]), mbd.Torque("m2", fore, torques[1], opposite=upper)]
    arm = mbd.Mechanism(bodies=[upper, fore], joints=joints, forces=[mbd.Gravity(), *motors], inputs=list(torques))
    tip = fore.at(0.2, 0)
    line = {tip.x: 0.6 + 0.15 * BLEND, tip.y: 0.1 + 0.3 * BLEND}
    problem = mbd.OptimalControlProblem(arm, duration=T, path=[e == value for e, value in line.items()], running_cost=0)
    solution = mbd.optimize(problem, intervals=40, degree=5)
    times = np.linspace(0, T, 61)
    reference = mbd.inverse_dynamics(arm, times, motion=line, efforts=list(torques))
    for u in torques:
        error = np.max(np.abs(solution.trajectory.at(times)[u] - reference[u])) / np.max(np.abs(reference[u]))
        assert error <= 1e-6


def test_a_start_off_the_prescribed_motion():
    """Refused with the amount, in place and in rate."""
    f = crank_rocker()
    path = [f.crank.phi == 0.5 + 2 * mbd.t]
    for initial, words in (
        ([f.crank.phi == 0.7, f.crank.omega == 2], "together with the path conditions"),
        ([f.crank.phi == 0.5, f.crank.omega == 0], "rate"),
    ):
        problem = half_turn(f, initial=initial, final=[], path=path, running_cost=0)
        with pytest.raises(mbd.MechanismError, match=words):
            mbd.optimize(problem, intervals=10)
