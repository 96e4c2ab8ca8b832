"""Peaks of inputs at the start and the end, far shorter than the root of the tolerance: costs in closed form."""

import warnings

import numpy as np
import pytest
from motions import rest_to_rest
from test_refine import motor_at_rest, work_by_hand

import mbdcasadi as mbd

#: Inertia, turn, duration, limit of the voltage; constant, resistance, inductance.
MOTORS = {
    "a current that takes a five hundredth of the duration": ((0.05, 1.0, 1.2, 12.0), (0.7, 1.5, 0.06)),
    "with limits eight times as far": ((0.05, 1.0, 1.2, 96.0), (0.7, 1.5, 0.06)),
    "a current that takes a ten thousandth of the duration": (
        (0.01956451980942748, 1.948813667564896, 1.6402626813323127, 13.089929349554797),
        (1.414651492558539, 1.001587580128675, 0.029339695967953605),
    ),
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


@pytest.mark.parametrize(
    ("limit", "tolerance"),
    [(50.0, 1e-5), (300.0, 1e-5), (2e3, 1e-3), (2e3, 1e-5), (2e3, 1e-7), (2e4, 1e-3), (2e4, 1e-7)],
)
def test_a_speed_that_is_reached_at_once(limit, tolerance):
    """A block runs at 1 m/s but for its start and its stop: 2 / (3 a) for limits a, which hold for 1 / a.

    With 2000 m/s² the cost, which is these peaks alone, was 70 tolerances off without a word.
    """
    problem, _u, block = rest_to_rest(0.0, 3.0, lower=-limit, upper=limit)
    problem = problem.replace(final=[block.vx == 0], running_cost=(block.vx - 1) ** 2)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=tolerance)
    assert solution.cost == pytest.approx(2 / (3 * limit), rel=tolerance)


def test_peaks_that_are_not_found_on_a_coarse_mesh():
    """Of solutions that may all be far off the last one of the least cost is kept: 0.002 was for 0.00005."""
    problem, _u, block = rest_to_rest(0.0, 3.3, lower=-2e4, upper=2e4)
    problem = problem.replace(final=[block.vx == 0], running_cost=(block.vx - 1) ** 2)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message="the local errors meet the tolerance")
        solution = mbd.optimize(problem, intervals=15, tolerance=1e-7)
    assert solution.cost == pytest.approx(2 / 6e4, rel=0.2)


def test_a_finer_mesh_to_begin_with():
    """With 80 intervals the work was 3 tolerances off without a word."""
    problem, work = motor("a current that takes a ten thousandth of the duration")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        fine = mbd.optimize(problem, intervals=80, tolerance=1e-5)
    assert fine.cost == pytest.approx(work, rel=1e-5)


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
