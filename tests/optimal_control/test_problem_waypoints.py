"""Conditions on the way: at given times, at free times, in what order."""

import itertools

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd


def least_cost_through(points, ends):
    """Least integral of x'' squared through (t, x) with rest at both ends: the natural-knot cubic spline."""
    from scipy.interpolate import CubicSpline

    t = np.array([0.0, *[p[0] for p in points], ends[0]])
    x = np.array([0.0, *[p[1] for p in points], ends[1]])
    spline = CubicSpline(t, x, bc_type="clamped")
    bend = spline.derivative(2)  # linear between the knots
    cost = 0.0
    for a, b in itertools.pairwise(t):
        first, last = bend(a), bend(b)
        cost += (b - a) * (first**2 + first * last + last**2) / 3
    return cost, spline


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_via_points_at_given_times_give_a_cubic_spline(transcription):
    """The least integral of u² through points is a clamped cubic spline; the force is continuous."""
    points = [(0.5, 2.0), (1.2, 1.0)]
    problem, u, block = rest_to_rest(3.0, 2.0)
    cost, spline = least_cost_through(points, (2.0, 3.0))
    via = problem.replace(waypoints=[mbd.Waypoint(t, [block.x == x]) for t, x in points])
    solution = mbd.optimize(via, intervals=12, transcription=transcription)
    assert solution.cost == pytest.approx(cost, rel=1e-9)
    assert solution.waypoint_times.tolist() == [0.5, 1.2]
    assert {0.5, 1.2} <= set(solution.mesh.tolist())
    times = np.linspace(0, 2, 101)
    motion = solution.trajectory.at(times)
    assert np.allclose(motion[block.x], spline(times), atol=1e-8)
    assert np.allclose(motion[u], spline(times, 2), atol=1e-6)


def test_a_waypoint_on_the_optimum_at_a_free_time_costs_nothing():
    """x = 1.5 is passed half way at 2.25 m/s: the cost stays 12 d² / T³, the time is found."""
    problem, _, block = rest_to_rest(3.0, 2.0)
    free = problem.replace(waypoints=[mbd.Waypoint((0.1, 1.9), [block.x == 1.5, block.vx == 2.25])])
    solution = mbd.optimize(free, intervals=16)
    assert solution.cost == pytest.approx(13.5, rel=1e-8)
    assert solution.waypoint_times == pytest.approx([1.0], abs=1e-6)
    other = problem.replace(waypoints=[mbd.Waypoint((0.1, 1.9), [block.x == 1.0])])
    assert mbd.optimize(other, intervals=16).cost == pytest.approx(13.5, rel=1e-8)


def test_the_best_time_of_a_waypoint_off_the_optimum():
    """Overshoot to x = 2 before the end at 1: the best of all fixed times, to first order."""
    from scipy.optimize import minimize_scalar

    best = minimize_scalar(lambda t: least_cost_through([(t, 2.0)], (2.0, 1.0))[0], bounds=(0.2, 1.8), method="bounded")
    problem, _, block = rest_to_rest(1.0, 2.0)
    free = problem.replace(waypoints=[mbd.Waypoint((0.2, 1.8), [block.x == 2.0])])
    solution = mbd.optimize(free, intervals=20)
    assert solution.cost == pytest.approx(best.fun, rel=1e-8)
    assert solution.waypoint_times[0] == pytest.approx(best.x, abs=1e-4)


def test_an_inequality_at_a_waypoint():
    """At half time x would be 1.5; asked to be 1.8 at least, it is 1.8."""
    problem, _, block = rest_to_rest(3.0, 2.0)
    cost, _ = least_cost_through([(1.0, 1.8)], (2.0, 3.0))
    solution = mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(1.0, [block.x >= 1.8])]), intervals=10)
    assert solution.cost == pytest.approx(cost, rel=1e-6)
    slack = mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(1.0, [block.x >= 1.2])]), intervals=10)
    assert slack.cost == pytest.approx(13.5, rel=1e-6)


def test_waypoints_in_free_duration():
    """Least time of a double integrator, stopped on the way: twice the time of half the way."""
    problem, _, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    halt = mbd.Waypoint((0.1, 8.0), [block.x == 2.0, block.vx == 0])
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, waypoints=[halt])
    solution = mbd.optimize(fast, intervals=40)
    each = 2 * np.sqrt(2 * 2 / 5)
    assert solution.duration == pytest.approx(2 * each, rel=1e-4)
    assert solution.waypoint_times == pytest.approx([each], rel=1e-4)


@pytest.mark.slow
def test_a_linkage_goes_through_its_waypoints():
    """Rocker and crank of a four-bar pass the poses that are asked, and IDAS agrees."""
    f = crank_rocker()
    via = half_turn(
        f, waypoints=[mbd.Waypoint(0.2, [f.o2.angle == 1.2]), mbd.Waypoint((0.3, 0.5), [f.o2.angle == 2.5])]
    )
    solution = mbd.optimize(via, intervals=36)
    at = solution.trajectory.at(solution.waypoint_times)
    assert at[f.o2.angle] == pytest.approx([1.2, 2.5], abs=1e-9)
    assert 0.3 <= solution.waypoint_times[1] <= 0.5
    assert solution.verify().final_error < 1e-5
    assert solution.cost > mbd.optimize(half_turn(f), intervals=36).cost


@pytest.mark.parametrize("wrong", [0, -1, np.nan, np.inf, "a", None, (1, 2, 3), (2, 1), (0.0, 0.0), mbd.t])
def test_the_time_of_a_waypoint(wrong):
    """Positive, finite, limits in order."""
    block = mbd.Body("block", mass=1, inertia=1)
    with pytest.raises(mbd.ModelError, match="Waypoint: time"):
        mbd.Waypoint(wrong, [block.x == 1])


def test_the_conditions_of_a_waypoint():
    """Relations, of symbols that the mechanism has."""
    problem, _, block = rest_to_rest()
    for wrong in (None, 3, "x", [block.x], [True], {}):
        with pytest.raises(mbd.ConditionError):
            mbd.Waypoint(0.5, wrong)
    stranger = mbd.Parameter("stranger", 1.0)
    with pytest.raises(mbd.ExpressionError, match="waypoint 1.*stranger"):
        problem.replace(waypoints=[mbd.Waypoint(0.5, [block.x == stranger])])
    with pytest.raises(mbd.ExpressionError, match="waypoint 1.*belongs"):
        problem.replace(waypoints=[mbd.Waypoint(0.5, [mbd.at_end(block.x) == 1])])


def test_a_waypoint_without_conditions_is_a_mesh_point():
    """At its time, given or found: where a bang-bang force with unequal limits switches."""
    problem, _u, _block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-2, upper=5)
    fast = problem.replace(
        duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, waypoints=[mbd.Waypoint((0.2, 5.0), [])]
    )
    solution = mbd.optimize(fast, intervals=10, control="constant")
    exact = np.sqrt(2 * 2 * 4 * (1 / 5 + 1 / 2))
    assert solution.duration == pytest.approx(exact, rel=1e-6)
    assert np.min(np.abs(solution.mesh - exact * 2 / 7)) < 1e-5 * exact
    fixed = mbd.optimize(problem.replace(duration=5.0, waypoints=[mbd.Waypoint(0.37, [])]), intervals=5)
    assert np.min(np.abs(fixed.mesh - 0.37)) < 1e-15
    assert fixed.mesh[0] == 0  # the first segment is much shorter than an interval, and keeps one


def test_waypoints_are_a_list_in_the_order_of_time():
    """Not before each other, not after the end."""
    problem, _, block = rest_to_rest()

    def at(*times):
        return [mbd.Waypoint(t, [block.x == 0.5]) for t in times]

    for wrong in (3, None, "x", [3], [None], at(0.5)[0]):
        with pytest.raises(mbd.ModelError, match="waypoints="):
            problem.replace(waypoints=wrong)
    for times, words in (
        ((0.5, 0.5), "waypoint 2"),
        ((0.6, 0.5), "waypoint 2"),
        (((0.2, 0.5), (0.1, 0.2)), "waypoint 2"),
        (((0.3, 0.5), 0.3), "waypoint 2"),
        ((1.0,), "waypoint 1.*end"),
        ((1.5,), "waypoint 1.*end"),
        (((1.2, 1.5),), "waypoint 1.*end"),
    ):
        with pytest.raises(mbd.ModelError, match=words):
            problem.replace(waypoints=at(*times))


def test_contradictions_at_a_waypoint():
    """Told when the problem is made: against each other, against the joints, against the path."""
    problem, _, block = rest_to_rest()
    for conditions in ([block.x == 0, block.x == 1], [block.y == 0], [block.y == 3]):
        with pytest.raises(mbd.ConditionError, match="waypoint 1"):
            problem.replace(waypoints=[mbd.Waypoint(0.5, conditions)])
    with pytest.raises(mbd.ConditionError, match="waypoint 1"):
        problem.replace(path=[block.x <= 1.5], waypoints=[mbd.Waypoint(0.5, [block.x == 2])])
