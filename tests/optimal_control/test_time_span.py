"""Times that are given, or free between limits with a guess."""

import copy
import pickle

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def test_a_range_with_a_guess_is_a_pair():
    """It unpacks and compares as one, and keeps its guess in copies."""
    span = mbd.between(1, 30, guess=9)
    assert span == (1, 30) and span.guess == 9 and repr(span) == "between(1, 30, guess=9)"
    assert pickle.loads(pickle.dumps(span)).guess == copy.deepcopy(span).guess == 9
    assert mbd.between(2, 2, guess=2) == (2, 2)


@pytest.mark.parametrize(
    "wrong", [(1, 30, 31), (1, 30, 0.5), (-1, 30, 9), (30, 1, 9), (0, 1, 0), ("1", 30, 9), (1, np.inf, 9), (1, 2, None)]
)
def test_a_guess_lies_within_finite_limits(wrong):
    lower, upper, guess = wrong
    with pytest.raises(mbd.ModelError, match=r"^between: "):
        mbd.between(lower, upper, guess=guess)


def first_times(problem):
    """Times of start, waypoints and end of the guess."""
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem, intervals=8, options={"ipopt.max_iter": 0})
    return caught.value.partial.phases[0].segment_times


def test_the_guess_is_the_first_duration():
    """Of a pair it is the geometric mean; the guess stays if the problem is replaced."""
    problem, *_ = rest_to_rest()
    free = problem.replace(duration=(0.5, 8.0), terminal_cost=mbd.t)
    assert first_times(free)[-1] == pytest.approx(2.0)
    guessed = free.replace(duration=mbd.between(0.5, 8.0, guess=0.7))
    assert first_times(guessed)[-1] == first_times(guessed.replace(terminal_cost=2 * mbd.t))[-1] == 0.7
    assert first_times(free)[-1] == pytest.approx(2.0), "problems of other guesses share no path"
    phase = guessed.phases[0]
    assert mbd.Phase("only", phase.mechanism, phase.span).span.typical == 0.7


def test_the_guess_is_the_first_time_of_a_waypoint():
    """A share of the duration: in one that is half as long it is half as late."""
    problem, *_ = rest_to_rest()
    via = problem.replace(duration=(0.5, 8.0), waypoints=[mbd.Waypoint(mbd.between(0.1, 8, guess=1.5))])
    assert first_times(via)[1] == pytest.approx(1.5)
    assert via.phases[0].segment_times(1.0)[1] == pytest.approx(0.75)
    late = via.replace(waypoints=[mbd.Waypoint(mbd.between(0.1, 8, guess=5))])
    with pytest.raises(mbd.ModelError, match=r"\[2.0\] leave no motion.*duration of 2 s; .*between"):
        mbd.optimize(late)


@pytest.mark.slow
def test_a_swing_is_pumped_up_in_least_time():
    """The mean of the range, 5.5 s, is too short to gain the height, and leads elsewhere; 8.92 s are known."""
    legs = mbd.Input("legs", lower=-500, upper=2500)
    rope = mbd.Body("rope", 0.0, 0.0, pose=(0, 0, -np.pi / 2 + 0.2))
    child = mbd.Body("child", 60.0, 0.0, pose=(2.25 * np.sin(0.2), -2.25 * np.cos(0.2), -np.pi / 2 + 0.2))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0, 0), rope.at(0, 0))
    slide = mbd.Translational("slide", rope.at(0, 0), child.at(0, 0))
    angle, length = rope.phi + np.pi / 2, slide.displacement
    forces = [mbd.Gravity(), mbd.GeneralizedForce("legs", [(length, -legs)])]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([rope, child], joints=[pivot, slide], forces=forces, inputs=[legs]),
        duration=mbd.between(1, 30, guess=9),
        initial=[angle == 0.2, rope.omega == 0, length == 2.5, slide.speed == 0],
        path=[mbd.bounded(2.0, length, 2.5), mbd.bounded(-1.5, slide.speed, 1.5)],
        final=[angle == 1.2, rope.omega == 0],
        terminal_cost=mbd.t,
    )
    assert mbd.optimize(problem).duration == pytest.approx(8.93, abs=0.05)
