"""Peaks of inputs at the start and the end, far shorter than the root of the tolerance: costs in closed form."""

import warnings

import numpy as np
import pytest
from motions import rest_to_rest
from test_refinement import motor_at_rest, work_by_hand

import mbdcasadi as mbd

#: Inertia, turn, duration, limit of the voltage; constant, resistance, inductance.
MOTORS = {
    "a current that takes a five hundredth of the duration": ((0.05, 1.0, 1.2, 12.0), (0.7, 1.5, 0.06)),
    "with limits eight times as far": ((0.05, 1.0, 1.2, 96.0), (0.7, 1.5, 0.06)),
    "a cost of a millionth of its typical size": (
        (0.01917431484578888, 1.5792661581437446, 1.8787067978813905, 14.572045929530471),
        (1.32873003128606, 1.5160688209643318, 0.027217747712388333),
    ),
}


def motor(name):
    """The problem of a motor, and its least work."""
    (inertia, turn, duration, limit), values = MOTORS[name]
    electric = dict(zip(("constant", "resistance", "inductance"), values, strict=True))
    wheel = mbd.Body("wheel", mass=1.0, inertia=inertia)
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0))
    problem = motor_at_rest(wheel, shaft, turn, duration, limit, **electric)
    return problem, work_by_hand(inertia, turn, duration, limit, **electric)


@pytest.mark.parametrize("name", MOTORS)
def test_least_work_of_a_motor(name):
    """The voltage brings the current onto its course, and off it, at its limit."""
    problem, work = motor(name)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=1e-5)
    assert solution.cost == pytest.approx(work, rel=1e-5)


@pytest.mark.parametrize("limit", [50.0, 300.0])
def test_a_speed_that_is_reached_at_once(limit):
    """A block runs at 1 m/s but for its start and its stop: 2 / (3 a) for limits a, which hold for 1 / a."""
    problem, _u, block = rest_to_rest(0.0, 3.0, lower=-limit, upper=limit)
    problem = problem.replace(final=[block.vx == 0], running_cost=(block.vx - 1) ** 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=1e-5)
    assert solution.cost == pytest.approx(2 / (3 * limit), rel=1e-5)


def test_costates_of_a_cost_that_is_raised_are_its_own():
    """Half a turn less costs less by the costate of the end, by references for two turns beside it."""
    name = "a cost of a millionth of its typical size"
    (inertia, turn, duration, limit), values = MOTORS[name]
    electric = dict(zip(("constant", "resistance", "inductance"), values, strict=True))
    step = 1e-3 * turn
    more, less = (work_by_hand(inertia, turn + change, duration, limit, **electric) for change in (step, -step))
    problem, _work = motor(name)
    costates = mbd.optimize(problem, tolerance=1e-5).costates
    (end,) = [value for label, value in costates.items() if label.startswith("final: wheel.phi")]
    assert np.abs(end) == pytest.approx((more - less) / (2 * step), rel=1e-4)


def test_fatrop_finds_a_cost_far_below_its_size_as_precisely():
    """It does not raise a cost: its tolerance is as much tighter."""
    problem, work = motor("with limits eight times as far")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=1e-5, solver="fatrop")
    assert solution.cost == pytest.approx(work, rel=1e-5)
