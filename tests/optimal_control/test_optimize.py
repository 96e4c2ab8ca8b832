"""Optimal control against closed forms, published optima and the laws of the method."""

import numpy as np
import pytest
from motions import four_bar, guided_block, rest_to_rest

import mbdcasadi as mbd


def test_least_energy_is_linear_in_time():
    """Rest to rest of a unit mass over d in T: u = 6 d / T² - 12 d t / T³, cost 12 d² / T³."""
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    solution = mbd.optimize(
        mbd.OptimalControlProblem(
            mechanism,
            duration=2.0,
            initial=[block.x == 0, block.vx == 0],
            final=[block.x == 3, block.vx == 0],
            running_cost=u**2,
        ),
        intervals=10,
    )
    assert solution.cost == pytest.approx(12 * 9 / 8, rel=1e-9)
    times = np.linspace(0, 2, 41)
    assert np.allclose(solution.trajectory.at(times)[u], 4.5 - 4.5 * times, atol=1e-7)
    assert solution.verify().final_error < 1e-8


def test_least_time_is_bang_bang():
    """A mass m over d with |u| <= F takes 2 sqrt(m d / F)."""
    u = mbd.Input("u", lower=-5, upper=5)
    block, mechanism = guided_block(2.0, u)
    solution = mbd.optimize(
        mbd.OptimalControlProblem(
            mechanism,
            duration=(0.5, 10.0),
            initial=[block.x == 0, block.vx == 0],
            final=[block.x == 4, block.vx == 0],
            terminal_cost=mbd.t,
        ),
        intervals=50,
    )
    assert solution.duration == pytest.approx(2 * np.sqrt(2 * 4 / 5), rel=1e-3)
    values = solution.trajectory[u]
    assert np.mean(np.abs(np.abs(values) - 5) < 1e-3) > 0.9
    assert np.max(np.abs(values)) < 5 + 1e-6


def test_integral_in_a_boundary_condition_and_a_parameter_of_its_own():
    """Least peak force for a given impulse: the force is constant."""
    u, peak = mbd.Input("u"), mbd.Parameter("peak", 5.0, lower=0.0)
    block, mechanism = guided_block(1.0, u)
    solution = mbd.optimize(
        mbd.OptimalControlProblem(
            mechanism,
            duration=2.0,
            initial=[block.x == 0, block.vx == 0],
            path=[u <= peak],
            boundary=[mbd.integral(u) == 3.0],
            terminal_cost=peak,
            free_parameters=[peak],
        ),
        intervals=8,
    )
    assert solution.parameters[peak] == pytest.approx(1.5, abs=1e-5)
    assert solution.trajectory.final[block.vx] == pytest.approx(3.0, abs=1e-8)


def test_a_design_parameter_is_optimised_with_the_motion():
    """A spring tuned to half a swing in the time given carries the mass over without any force."""
    u, k = mbd.Input("u"), mbd.Parameter("k", 3.0, lower=0.1, upper=50.0)
    block, mechanism = guided_block(
        1.0,
        u,
        parameters=[k],
        extra=lambda b: [mbd.GeneralizedForce("spring", [(b.x, -k * b.x)])],
    )
    solution = mbd.optimize(
        mbd.OptimalControlProblem(
            mechanism,
            duration=1.0,
            initial=[block.x == 1, block.vx == 0],
            final=[block.x == -1, block.vx == 0],
            running_cost=u**2,
            free_parameters=[k],
        ),
        intervals=10,
    )
    assert solution.parameters[k] == pytest.approx(np.pi**2, rel=1e-4)
    assert solution.cost < 1e-7


def test_a_periodic_motion_ties_the_end_to_the_start():
    """A block driven round a cycle of free start: the end repeats the start."""
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    solution = mbd.optimize(
        mbd.OptimalControlProblem(
            mechanism,
            duration=2.0,
            initial=[block.x == 0],
            boundary=[
                mbd.at_end(block.x) == mbd.at_start(block.x) + 1,
                mbd.at_end(block.vx) == mbd.at_start(block.vx),
            ],
            running_cost=u**2,
        ),
        intervals=8,
    )
    assert solution.trajectory.initial[block.vx] == pytest.approx(0.5, abs=1e-6)
    assert solution.cost < 1e-9


@pytest.mark.slow
def test_closed_loop_stays_closed_and_replays():
    """The four-bar: constraints at mesh points to rounding, IDAS gives the motion back."""
    problem, _tau, _ = four_bar()
    solution = mbd.optimize(problem, intervals=40)
    assert solution.statistics.iterations <= 12
    phi = np.array([solution.state(k)[problem.equations.Phi] for k in range(41)])
    assert np.max(np.abs(phi)) <= 1e-11
    replay = solution.verify()
    assert replay.final_error < 1e-5 and replay.drift < 1e-11
    assert np.max(replay.defects) < 1e-7
    assert max(solution.limit_excess.values()) == 0.0


def test_mesh_refinement_reaches_the_tolerance():
    """Every interval of the refined mesh is as accurate as asked."""
    problem, *_ = four_bar()
    solution = mbd.optimize(problem, intervals=8, tolerance=1e-7)
    assert solution.mesh_error <= 1e-7 and solution.mesh.size > 9


def test_another_start_uses_what_was_compiled():
    """The same program serves another start; it is not built again."""
    problem, _u, block = rest_to_rest(3.0, 2.0)
    mbd.optimize(problem, intervals=10)
    built = dict(problem.compiled.programs)
    second = mbd.optimize(problem, intervals=10, initial=[block.x == 1, block.vx == 0])
    assert second.cost == pytest.approx(12 * 4 / 8, rel=1e-8)
    assert problem.compiled.programs == built


@pytest.mark.slow
def test_an_infeasible_problem_says_which_demand():
    """Too little force for the way: the error names an equation, a time, and keeps the last iterate."""
    u = mbd.Input("u", lower=-0.1, upper=0.1)
    block, mechanism = guided_block(1.0, u)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 5, block.vx == 0],
        running_cost=u**2,
    )
    with pytest.raises(mbd.MechanismError, match="infeasible") as caught:
        mbd.optimize(problem, intervals=5)
    worst = caught.value.largest_violations[0]
    assert "block" in worst.label and 0 <= worst.time <= 1
    assert caught.value.partial is not None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"duration": -1.0}, "duration"),
        ({"duration": (2.0, 1.0)}, "duration"),
        ({"initial": [True]}, "relation"),
        ({"running_cost": mbd.Parameter("stranger", 1.0)}, "stranger"),
        ({"path": [mbd.at_end(mbd.t) <= 3]}, "boundary"),
        ({"mesh": 3}, "mesh"),
    ],
)
def test_a_wrong_problem_is_refused_when_it_is_made(changes, words):
    """Unknown symbols, limits the wrong way round, what is no relation."""
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    good = mbd.OptimalControlProblem(mechanism, duration=1.0, initial=[block.x == 0], running_cost=u**2)
    with pytest.raises(mbd.MechanismError, match=words):
        good.replace(**changes)


def test_numbers_and_lists_of_starts():
    """Any integer is a number; a list takes the place of `guess`, and is not given beside it."""
    problem, *_ = rest_to_rest()
    first = mbd.optimize(problem, intervals=5, starts=np.int64(2))
    assert len(first.statistics.starts) == 2
    wrong = {
        "starts must be at least 1, got 0": {"starts": 0},
        "a number or a list of guesses, got 2.5": {"starts": 2.5},
        "starts= is an empty list": {"starts": []},
        "put that of guess= into it": {"starts": [None], "guess": first},
    }
    for message, arguments in wrong.items():
        with pytest.raises(mbd.ModelError, match=message):
            mbd.optimize(problem, intervals=5, **arguments)
