"""Motions that are too fast for a mesh: solved slowly first, then faster and faster."""

import numpy as np
import pytest
from keyboard import interrupted_in
from motions import rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.search import slow_first, trials
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver


@pytest.fixture
def speeds(monkeypatch):
    """Solutions are no motions on meshes of fewer than 80 intervals; limits of the speed of each solve, m/s."""

    def settled(_solver, one, _variant=None):
        return one, one.meshes[0].count >= 80

    for module in (trials, slow_first):
        monkeypatch.setattr(module, "is_lost", lambda solution: solution.meshes[0].count < 80)
        monkeypatch.setattr(module, "refine_if_coarse", settled)
    seen, solve = [], ProblemSolver.solve

    def recorded(solver, meshes, guess, **how):
        limits = how["variant"].speeds if "variant" in how else None
        seen.append(np.inf if limits is None else float(limits[0][0, 0]))
        return solve(solver, meshes, guess, **how)

    monkeypatch.setattr(ProblemSolver, "solve", recorded)
    return seen


def limit_speeds(monkeypatch, problem, speed):
    """The first limit of the speed of a block, m/s, on a mesh of 80 intervals of a second."""
    size = mbd.optimize(problem, intervals=80).phases[0].program.scales.q[0]
    monkeypatch.setattr(slow_first, "RESOLVED_STEP", speed / 80 / size)
    monkeypatch.setattr(slow_first, "GUESSED", 0.0)


def test_limits_of_speeds_rise_until_they_do_not_count(monkeypatch, speeds):
    """With 1.25 m/s the limit counts, with twice as much it does not: the motion reaches 1.5 m/s."""
    problem, _, block = rest_to_rest()
    limit_speeds(monkeypatch, problem, 1.25)
    speeds.clear()
    solution = mbd.optimize(problem)
    np.testing.assert_allclose(speeds, [np.inf, 1.25, 2.5, np.inf])
    assert solution.mesh.size - 1 == 80 and solution.cost == pytest.approx(12, rel=1e-8)
    assert np.max(solution.trajectory.at(solution.mesh)[block.vx]) == pytest.approx(1.5, rel=1e-6)


def test_a_rise_that_is_too_large_is_divided(monkeypatch, speeds):
    """If the solver fails with limits more than 1.9 times as high: the root of two comes in between."""
    problem, *_ = rest_to_rest()
    limit_speeds(monkeypatch, problem, 1.1)
    solve, seen = ProblemSolver.solve, []

    def too_far(solver, meshes, guess, **how):
        solution = solve(solver, meshes, guess, **how)
        if np.isfinite(speeds[-1]):
            seen.append(speeds[-1])
            if len(seen) > 1 and seen[-1] > 1.9 * seen[-2]:
                raise mbd.OptimizationError("made up", partial=solution)
        return solution

    monkeypatch.setattr(ProblemSolver, "solve", too_far)
    speeds.clear()
    assert mbd.optimize(problem).cost == pytest.approx(12, rel=1e-6)
    assert speeds[2] == pytest.approx(2.2) and speeds[3] == pytest.approx(1.1 * 2**0.5)


def test_a_motion_that_is_found_slowly_is_kept_after_ctrl_c(monkeypatch, speeds):
    """In the first solve of a refinement, with a force that is at its limit: not the solution that is no motion."""
    problem, *_ = rest_to_rest(lower=-5, upper=5)
    speeds.clear()
    mbd.optimize(problem)
    count = len(speeds)
    error = interrupted_in(monkeypatch, count, lambda: mbd.optimize(problem, tolerance=1e-6), ProblemSolver)
    assert error.partial.meshes[0].count >= 80


def test_guesses_end_after_so_much_work(monkeypatch, speeds):
    """If none leads to a motion: no further guess after as much work as the solves before."""
    for module in (trials, slow_first):
        monkeypatch.setattr(module, "is_lost", lambda _solution: True)
    problem, *_ = rest_to_rest()
    assert mbd.optimize(problem).cost == pytest.approx(12, rel=1e-8)
    several = sum(np.isfinite(speeds))
    assert several == 2 * (1 + slow_first.STARTS)
    speeds.clear()
    monkeypatch.setattr(slow_first, "WORK", 0)
    assert mbd.optimize(problem).cost == pytest.approx(12, rel=1e-8) and sum(np.isfinite(speeds)) < several / 2
