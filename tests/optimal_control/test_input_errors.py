"""Errors of the inputs to the tolerance, against closed forms at random times."""

import warnings

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.refinement.input_error import input_errors


def damped(rate, **changes):
    """A block moved by 1 m in 1 s with the least integral of u² + (rate v)²: v'' = rate² v - c."""
    problem, u, block = rest_to_rest(1.0, 1.0, **changes)
    peak = 1 / (1 - np.tanh(rate / 2) / (rate / 2))
    return (
        problem.replace(running_cost=u**2 + (rate * block.vx) ** 2),
        u,
        lambda t: -peak * rate * np.sinh(rate * (t - 0.5)) / np.cosh(rate / 2),
    )


def off(solution, u, exact):
    """Errors of an input at random times as shares of its largest value."""
    times = np.random.default_rng(3).uniform(0, solution.duration, 2000)
    return np.abs(solution.trajectory.at(times)[u] - exact(times)) / np.max(np.abs(exact(times)))


@pytest.mark.parametrize(("tolerance", "degree"), [(1e-4, 3), (1e-6, 3), (1e-6, 5)])
def test_steep_inputs_are_found_to_the_tolerance(tolerance, degree):
    """The local errors are small from the start: the states are polynomials almost."""
    problem, u, exact = damped(20.0)
    solution = mbd.optimize(problem, intervals=10, degree=degree, tolerance=tolerance)
    assert len(solution.statistics.passes) > 1 and solution.statistics.passes[0].error <= tolerance
    assert np.max(off(solution, u, exact)) < 2 * tolerance


@pytest.mark.parametrize("settings", [{"degree": 2}, {}, {"degree": 5}, {"transcription": "hermite-simpson"}])
def test_the_estimate_is_the_error(settings):
    """To a tenth for Gauss–Legendre, whose values at the stages are precise; to a half for continuous inputs."""
    problem, u, exact = damped(5.0)
    solution = mbd.optimize(problem, intervals=20, **settings)
    error, estimate = np.max(off(solution, u, exact)), np.max(input_errors(solution.phases[0]))
    assert estimate == pytest.approx(error, rel=0.5 if "transcription" in settings else 0.15)


@pytest.mark.parametrize("control", ["linear", "constant"])
def test_a_course_that_was_chosen_is_left_alone(control):
    problem, *_ = damped(5.0)
    solution = mbd.optimize(problem, intervals=10, control=control, tolerance=1e-3)
    assert not np.any(input_errors(solution.phases[0])) and solution.mesh.size == 11


def turning_back(size):
    """Bryson and Ho, Applied Optimal Control, 3.11, with its optimal input, which has kinks at 3 l and 1 - 3 l."""
    problem, u, block = rest_to_rest(0.0, 1.0)
    problem = problem.replace(
        initial=[block.x == 0, block.vx == 1],
        final=[block.x == 0, block.vx == -1],
        path=[block.x <= size],
        running_cost=u**2 / 2,
    )
    return problem, u, lambda t: -2 / (3 * size) * np.maximum(1 - np.minimum(t, 1 - t) / (3 * size), 0)


def test_an_input_at_a_limit_of_a_position():
    """Kinks lie between the mesh points: they are found without a warning."""
    size = 0.0937
    problem, u, exact = turning_back(size)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, intervals=20, tolerance=1e-6)
    assert solution.cost == pytest.approx(4 / (9 * size), rel=1e-8)
    errors = off(solution, u, exact)
    assert np.mean(errors > 1e-6) < 0.03 and not solution.meshes[0].moving


def test_a_kink_that_a_neighbour_does_not_show():
    """Of 20 intervals the one with the kink at 0.06 s agrees with a neighbour by chance, which it has led astray."""
    size = 0.02
    problem, u, exact = turning_back(size)
    solution = mbd.optimize(problem, intervals=20, tolerance=1e-4)
    errors = off(solution, u, exact)
    assert np.mean(errors > 1e-4) < 0.02 and solution.cost == pytest.approx(4 / (9 * size), rel=1e-7)


def test_inputs_that_are_not_found_are_reported(monkeypatch):
    """One pass leaves the mesh as it is."""
    monkeypatch.setattr("mbdcasadi.optimal_control.refinement.refine.PASSES", 1)
    problem, *_ = damped(20.0)
    with pytest.warns(mbd.MechanismWarning, match=r"meet the tolerance 1e-06, but not the inputs, which are off by"):
        mbd.optimize(problem, intervals=10, tolerance=1e-6)
