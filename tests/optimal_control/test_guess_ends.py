"""Starts, ends and guesses that follow from what a problem says: places, speeds, branches."""

import math

import numpy as np
import pytest
from motions import crank_rocker, half_turn, pendulum

import mbdcasadi as mbd


@pytest.mark.slow
@pytest.mark.parametrize("at_top", ["place", "place and speed", "height"])
def test_a_pendulum_goes_to_the_top_however_that_is_said(at_top):
    """Both coordinates of a point on a circle say one thing, but on one branch alone."""
    bob, tau, mechanism = pendulum(length=0.5, inertia=1 / 12)
    final = {
        "place": [bob.position == (0, 0.5), bob.omega == 0],
        "place and speed": [bob.position == (0, 0.5), bob.velocity == (0, 0)],
        "height": [bob.y == 0.5, bob.omega == 0],
    }[at_top]
    problem = mbd.OptimalControlProblem(
        mechanism, duration=1.0, initial=[bob.x == 0, bob.omega == 0], final=final, running_cost=tau**2
    )
    solution = mbd.optimize(problem)
    assert solution.trajectory.final[bob.y] == pytest.approx(0.5, abs=1e-9)
    assert solution.trajectory.initial[bob.y] == pytest.approx(-0.5, abs=1e-9)
    assert solution.verify().final_error < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("speed", [5.0, 20.0])
def test_a_crank_is_kept_at_a_speed_from_a_pose_alone(speed):
    """The speed at the start and the guess follow the path condition."""
    f = crank_rocker(limit=200.0)
    problem = half_turn(f, initial=[f.crank.phi == 0.5], final=[], path=[f.crank.omega == speed])
    solution = mbd.optimize(problem)
    speeds = solution.trajectory[f.crank.omega]
    assert speeds[:: solution.points_per_interval] == pytest.approx(speed, rel=1e-10)
    assert speeds == pytest.approx(speed, rel=1e-4)
    assert solution.statistics.iterations < 15


def test_a_moving_start_without_a_goal_coasts():
    """The least effort is none."""
    f = crank_rocker()
    problem = half_turn(f, initial=[f.crank.phi == 0.5, f.crank.omega == 20], final=[])
    solution = mbd.optimize(problem)
    assert solution.cost < 1e-12 and solution.statistics.iterations < 10


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.2, 0.4, 0.9, 1.4, 1.9])
@pytest.mark.parametrize("length", [0.3, 1.0])
def test_a_height_that_is_reached_at_the_top_alone(start, length):
    """There the condition has no slope: it is met, at the cost of the one on the angle."""
    bob, tau = mbd.Body("bob", mass=0.5, inertia=0.01, pose=(0, -length, 0)), mbd.Input("tau")
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))
    forces = [mbd.Gravity(), mbd.Torque("motor", bob, tau)]
    mechanism = mbd.Mechanism([bob], [pin], forces=forces, inputs=[tau])
    costs = []
    for top in (bob.y == length, bob.phi == math.pi):
        problem = mbd.OptimalControlProblem(
            mechanism, 1.0, [bob.phi == start, bob.omega == 0], [top, bob.omega == 0], running_cost=tau**2
        )
        solution = mbd.optimize(problem, intervals=12)
        assert solution.trajectory.final[bob.y] == pytest.approx(length, abs=1e-9)
        costs.append(solution.cost)
    assert costs[0] == pytest.approx(costs[1], rel=1e-6)


@pytest.mark.parametrize(
    "write", [lambda tip, place: mbd.distance(tip, place) == 0, lambda tip, place: mbd.distance(tip, place) <= 0]
)
def test_a_tip_that_meets_a_place_with_a_free_length(write):
    """The same optimum as with the two coordinates of the place."""
    length, torque = mbd.Parameter("length", 1.0, lower=0.5, upper=1.5), mbd.Input("torque", lower=-30, upper=30)
    bar = mbd.Body("bar", mass=1.0, inertia=0.1, pose=(1, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-1 * length, 0))
    model = mbd.Mechanism(
        [bar],
        joints=[pin],
        forces=[mbd.Gravity(), mbd.Torque("motor", bar, torque)],
        inputs=[torque],
        parameters=[length],
    )
    x, y = 0.9 * np.cos(1), 0.9 * np.sin(1)
    rest = bar.omega == 0
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        running_cost=torque**2,
        initial=[pin.angle == 0, rest],
        final=[bar.x == x, bar.y == y, rest],
        free_parameters=[length],
    )
    best = mbd.optimize(problem, intervals=20)
    met = mbd.optimize(problem.replace(final=[write(bar.at(0, 0), mbd.ground.at(x, y)), rest]), intervals=20)
    assert met.cost == pytest.approx(best.cost, rel=1e-8)
    assert met.parameters[length] == pytest.approx(0.9, rel=1e-8)


def test_a_component_that_the_joints_decide_is_named():
    """A slider that is to meet a place on its own line: the other component is what the user has to state."""
    force = mbd.Input("force")
    block = mbd.Body("block", mass=2.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    model = mbd.Mechanism(
        [block], joints=[guide], forces=[mbd.Force("push", block.at(0, 0), (force, 0))], inputs=[force]
    )
    with pytest.raises(
        mbd.ConditionError, match=r"block.y = 0 is already decided .*; state the other components alone"
    ):
        mbd.OptimalControlProblem(
            model,
            duration=1.0,
            running_cost=force**2,
            initial=[block.x == 0, block.vx == 0],
            final=[mbd.distance(block, mbd.ground.at(1, 0)) == 0, block.vx == 0],
        )


def test_steady_vibration_under_a_periodic_force():
    """Without inputs the start is what is found: amplitude and phase of a block on a spring (closed form)."""
    mass, stiffness, damping, force, frequency = 2.0, 90.0, 3.0, 5.0, 4.0
    block = mbd.Body("block", mass=mass, inertia=1)
    ends = mbd.ground.at(-1, 0), block.at(0, 0)
    spring = mbd.TSDA("spring", *ends, stiffness=stiffness, damping=damping, free_length=1.0)
    push = mbd.Force("push", block.at(0, 0), (force * mbd.cos(frequency * mbd.t), 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    model = mbd.Mechanism([block], [guide], forces=[spring, push])
    again = [mbd.at_end(s) == mbd.at_start(s) for s in (block.x, block.vx)]
    steady = mbd.optimize(mbd.OptimalControlProblem(model, 2 * np.pi / frequency, boundary=again), intervals=40)
    amplitude = force / (stiffness - mass * frequency**2 + 1j * damping * frequency)
    assert steady.trajectory.initial[block.x] == pytest.approx(amplitude.real, rel=1e-6)
    assert steady.trajectory.initial[block.vx] == pytest.approx((1j * frequency * amplitude).real, rel=1e-6)


def test_the_launch_that_hits_a_mark():
    """No input, a given duration, and two points: the speed at the start is x / T and y / T + g T / 2."""
    ball = mbd.Body("ball", mass=1, inertia=1)
    flight = mbd.Mechanism([ball], forces=[mbd.Gravity()])
    places = {"initial": [ball.x == 0, ball.y == 0, ball.phi == 0, ball.omega == 0], "final": [ball.position == (3, 1)]}
    launch = mbd.optimize(mbd.OptimalControlProblem(flight, 0.8, **places)).trajectory.initial
    expected = 3 / 0.8, 1 / 0.8 + 0.4 * 9.81
    assert (launch[ball.vx], launch[ball.vy]) == pytest.approx(expected, rel=1e-9)


def test_more_demands_than_unknowns_of_a_passive_motion():
    """The solver does not begin: no iteration is reported, and nothing about an iterate."""
    ball = mbd.Body("ball", mass=1, inertia=1)
    flight = mbd.Mechanism([ball], forces=[mbd.Gravity()])
    start = [mbd.at_start(symbol) == 0 for symbol in (ball.x, ball.y, ball.phi, ball.vx, ball.vy, ball.omega)]
    problem = mbd.OptimalControlProblem(flight, 0.8, boundary=start, final=[ball.x == 1])
    with pytest.raises(mbd.OptimizationError, match="leave one of them out.*free; after 0 iterations") as caught:
        mbd.optimize(problem, intervals=5)
    assert " met " not in str(caught.value)
