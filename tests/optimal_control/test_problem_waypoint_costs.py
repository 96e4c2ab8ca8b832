"""Costs at waypoints."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


@pytest.mark.parametrize("time", [0.5, (0.5, 0.5)])
def test_a_price_on_a_place(time):
    """Out to x and back in 1 s: 12 x² / 0.5³ each way, and with w (x - p)² least at x = w p / (192 + w)."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    weight, place = 100.0, 0.3
    there = mbd.Waypoint(time, cost=weight * (block.x - place) ** 2)
    solution = mbd.optimize(problem.replace(final=[block.x == 0, block.vx == 0], waypoints=[there]), intervals=8)
    x = weight * place / (192 + weight)
    assert solution.trajectory.at(np.array([0.5]))[block.x] == pytest.approx(x, rel=1e-6)
    assert solution.cost == pytest.approx(192 * x**2 + weight * (x - place) ** 2, rel=1e-6)


def test_a_price_on_a_time():
    """Of a free time: the way out takes as long as the price on its time allows; both ways take T³ = 12 / E each."""
    problem, _u, block = rest_to_rest(1.0, 2.0)
    stop = [block.x == 1, block.vx == 0]
    there = mbd.Waypoint((0.2, 1.8), stop, cost=20 * mbd.t)
    back = problem.replace(final=[block.x == 0, block.vx == 0], waypoints=[there])
    solution = mbd.optimize(back, intervals=10)
    times = np.linspace(0.3, 1.7, 200001)
    total = 12 / times**3 + 12 / (2 - times) ** 3 + 20 * times
    assert solution.cost == pytest.approx(np.min(total), rel=1e-6)
    assert solution.waypoint_times[0] == pytest.approx(times[np.argmin(total)], abs=1e-3)


def test_what_is_not_a_cost():
    """Relations are refused, and symbols of others, with the place."""
    problem, _u, block = rest_to_rest()
    with pytest.raises(mbd.ExpressionError, match="cost of a waypoint is the relation"):
        mbd.Waypoint(0.5, cost=block.x <= 1)
    stranger = mbd.Body("stranger", mass=1, inertia=1)
    with pytest.raises(mbd.ExpressionError, match=r"cost of waypoint 1 contains .*stranger\.x"):
        problem.replace(waypoints=[mbd.Waypoint(0.5, cost=stranger.x)])
    with pytest.raises(mbd.ExpressionError, match="cost of waypoint 1"):
        problem.replace(waypoints=[mbd.Waypoint(0.5, cost=mbd.at_end(block.x))])
