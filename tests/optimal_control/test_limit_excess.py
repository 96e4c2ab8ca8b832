"""Limits between the points at which a program holds them."""

import warnings

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.motion.limit_excess import limit_values
from mbdcasadi.optimal_control.transcription.controls import input_basis


def fine(solution, points=201):
    """The motion at many points of every interval, without the mesh points themselves."""
    times = np.linspace(solution.mesh[:-1] + 1e-12, solution.mesh[1:] - 1e-12, points)
    return solution.trajectory.at(np.unique(times))


def least_time(**changes):
    """A block with unlike limits; the switch lies inside an interval."""
    problem, u, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-2, upper=5)
    return problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, **changes), u, block


@pytest.mark.parametrize("points", [(0.5,), (0.2, 0.8), (0.1, 0.5, 0.9), (0.0, 0.3, 0.6, 1.0)])
@pytest.mark.parametrize("joined", [False, True])
def test_control_points_enclose_a_polynomial(points, joined):
    inner = tuple(x for x in points if 0 < x < 1)
    for limited in (False, True):
        basis = input_basis("polynomial", inner, joined, rates=False, limited=limited)
        values = np.random.default_rng(3).normal(size=(7, basis.taus.size, 2))
        unknowns = basis.unknowns(values)
        through = np.einsum("kj,ikn->ijn", basis.weights(basis.taus), unknowns)
        np.testing.assert_allclose(through, values, atol=1e-12)
        control = np.einsum("jk,ikn->ijn", basis.control_points, unknowns)
        between = np.einsum("kj,ikn->ijn", basis.weights(np.linspace(0, 1, 101)), unknowns)
        assert np.all(between <= control.max(axis=1, keepdims=True) + 1e-12)
        assert np.all(between >= control.min(axis=1, keepdims=True) - 1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("degree", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("settings", [{}, {"transcription": "hermite-simpson"}, {"control": "linear"}])
def test_limits_of_an_input_hold_everywhere(degree, settings):
    """And no motion takes less than the least time T = sqrt(2 m d (1/F + 1/B))."""
    problem, u, _block = least_time()
    solution = mbd.optimize(problem, intervals=11, degree=degree, **settings)
    force = fine(solution)[u]
    assert np.max(force) <= 5 + 1e-7 and np.min(force) >= -2 - 1e-7
    exact = np.sqrt(2 * 2 * 4 * (1 / 5 + 1 / 2))
    assert exact * (1 - 1e-8) < solution.duration < 1.03 * exact
    assert max(solution.limit_excess.values()) < 1e-7


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_path_limits_of_inputs_hold_everywhere(transcription):
    """With a parameter in them, and with a factor."""
    peak = mbd.Parameter("peak", 4.0, lower=1.0, upper=5.0)
    problem, u, _block = rest_to_rest(4.0, 3.5, mass=2.0)
    problem = problem.replace(
        running_cost=1e-9 * u**2,
        terminal_cost=peak,
        path=[mbd.bounded(-peak, u, peak), 2 * u >= -4],
        free_parameters=[peak],
    )
    solution = mbd.optimize(problem, intervals=12, transcription=transcription)
    force, most = fine(solution)[u], solution.parameters[peak]
    assert np.max(force) <= most + 1e-6 and np.min(force) >= -2 - 1e-7
    # the brake is limited to 2 N: T = sqrt(2 m d (1/F + 1/2))
    exact = 1 / (3.5**2 / 16 - 1 / 2)
    assert exact * (1 - 1e-6) <= most < 1.1 * exact


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_limits_of_rates_hold_everywhere(transcription):
    problem, u, _block = rest_to_rest(1.0, 1.0, lower=-5, upper=5)
    fast = problem.replace(
        duration=(0.5, 5.0), running_cost=0, terminal_cost=mbd.t, path=[mbd.bounded(-14, u.rate, 14)]
    )
    solution = mbd.optimize(fast, intervals=9, transcription=transcription)
    motion = fine(solution)
    assert 14 * 0.999 < np.max(np.abs(motion[u.rate])) <= 14 + 1e-6 and np.max(np.abs(motion[u])) <= 5 + 1e-7


def test_a_limit_on_a_speed_is_held_at_more_points():
    """Four intervals pass it by 1.4 % between the points, if nothing is done."""
    problem, _u, block = least_time()
    solution = mbd.optimize(problem.replace(path=[block.vx <= 2]), intervals=4)
    assert solution.program.held == ((0, "block.vx <= 2", pytest.approx(0.3)),)
    assert np.max(fine(solution)[block.vx]) <= 2 * 1.002
    # d / V and half of the times that speeding up and braking take
    assert solution.duration > 4 / 2 + (2 * 2 / 5 + 2 * 2 / 2) / 2 - 1e-2


def test_what_is_left_over_is_a_warning_with_its_size():
    """On a coarse mesh the reaction between the stages is another one than the multipliers of the polynomials."""
    f = crank_rocker()
    load = mbd.norm(f.o4.reaction_on(f.rocker).force)
    problem = half_turn(f, path=[load <= 11.3])
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        solution = mbd.optimize(problem, intervals=10)
    most = np.max(fine(solution, 21)[load])
    texts = [str(w.message) for w in caught if "is passed by" in str(w.message)]
    assert most > 11.3 * 1.01 and len(texts) == 1
    amount = float(texts[0].split("is passed by ")[1].split(" ")[0])
    assert amount == pytest.approx(most - 11.3, rel=0.02) and "norm(O4.reaction_on(rocker).force) <= 11.3" in texts[0]


def test_points_at_which_limits_are_held_are_saved(tmp_path):
    problem, _u, block = least_time()
    problem = problem.replace(path=[block.vx <= 2])
    solution = mbd.optimize(problem, intervals=4)
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert solution.program.held and back.program.held == solution.program.held and back.duration == solution.duration
    again = mbd.optimize(problem, intervals=4, guess=solution)
    assert again.statistics.iterations <= 5 and again.duration == pytest.approx(solution.duration, rel=1e-6)


@pytest.mark.parametrize("written", [lambda v: v >= -1.6, lambda v: -v <= 1.6, lambda v: 1.6 >= -v])
def test_the_size_of_a_limit_does_not_depend_on_how_it_is_written(written):
    """It is the limit itself, 1.6 m/s, and not the typical speed of the problem; CasADi writes some with a minus."""
    problem, _, block = rest_to_rest(-1.0, 1.0)
    solution = mbd.optimize(problem.replace(path=[written(block.vx)]), intervals=20)
    (part,) = solution.phases
    assert limit_values(part, 10, 0.0)[1] == pytest.approx(1.6, rel=1e-3)
