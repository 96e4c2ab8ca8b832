"""Ctrl-C at given instants of a search: the best solution so far is never lost."""

import signal
import sys
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from keyboard import interrupted_in
from motions import crank_rocker, guided_block, half_turn, rest_to_rest, swing_up

import mbdcasadi as mbd
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver

PACKAGE = str(Path(mbd.__file__).parent)


def interrupted_in_solve(monkeypatch, number, call):
    """The exception of a search with Ctrl-C in its n-th solve, counted from zero."""
    return interrupted_in(monkeypatch, number, call, ProblemSolver)


@cache
def costs_of_starts():
    """Costs of the four starts of a search that nothing interrupts."""
    return [start.cost for start in mbd.optimize(swing_up(8.0, 2.0)[0], intervals=12, starts=4).statistics.starts]


@pytest.mark.slow
@pytest.mark.parametrize("number", [1, 2, 3])
def test_the_best_of_the_starts_that_were_solved(monkeypatch, number):
    """Not the one under way, nor the last."""
    problem, costs = swing_up(8.0, 2.0)[0], costs_of_starts()  # several starts end at unlike costs
    solved = [cost for cost in costs[:number] if np.isfinite(cost)]
    assert solved and len(set(np.round(costs, 6))) > 1
    error = interrupted_in_solve(monkeypatch, number, lambda: mbd.optimize(problem, intervals=12, starts=4))
    assert error.partial.cost == pytest.approx(min(solved), rel=1e-12)
    assert "best solution" in str(error)


def test_without_a_solution_the_last_iterate(monkeypatch):
    problem, *_ = swing_up(8.0, 2.0)
    error = interrupted_in_solve(monkeypatch, 0, lambda: mbd.optimize(problem, intervals=12, starts=4))
    assert error.partial.statistics.status == "User_Requested_Stop" and "last iterate" in str(error)


@pytest.mark.slow
def test_the_finest_mesh_that_was_solved(monkeypatch):
    """In a refinement, whatever the costs on coarser meshes."""
    problem = half_turn(crank_rocker())
    whole = mbd.optimize(problem, intervals=6, tolerance=1e-9)
    meshes = [p.intervals for p in whole.statistics.passes]
    assert len(meshes) >= 3
    for number in range(1, len(meshes)):
        error = interrupted_in_solve(monkeypatch, number, lambda: mbd.optimize(problem, intervals=6, tolerance=1e-9))
        assert error.partial.mesh.size == meshes[number - 1] + 1
        assert error.partial.statistics.passes[-1].intervals == meshes[number - 1]


def test_the_last_step_of_a_continuation(monkeypatch):
    """With the parameter values that were reached."""
    u, k = mbd.Input("u"), mbd.Parameter("k", 3.0)
    spring = lambda b: [mbd.GeneralizedForce("spring", [(b.x, -k * b.x)])]  # noqa: E731
    block, mechanism = guided_block(1.0, u, parameters=[k], extra=spring)
    ends = dict(initial=[block.x == 0, block.vx == 0], final=[block.x == 1, block.vx == 0])
    problem = mbd.OptimalControlProblem(mechanism, duration=2.0, running_cost=u**2 + block.x**4, **ends)
    values = [3.0, 5.0, 9.0]
    single = [mbd.optimize(problem, intervals=8, parameters={k: value}).cost for value in values]
    for number in (1, 2):
        error = interrupted_in_solve(
            monkeypatch, number, lambda: mbd.optimize(problem, intervals=8, continuation={k: values}, starts=1)
        )
        assert error.partial.cost == pytest.approx(single[number - 1], rel=1e-7)
        assert [step.values["k"] for step in error.partial.statistics.steps] == values[:number]


class Instants:
    """Counts the calls of functions of the package after the first solve, and sends Ctrl-C at one of them."""

    def __init__(self, at=None):
        self.count, self.at, self.solved = 0, at, []

    def __call__(self, frame, event, _argument):
        if self.solved and event in ("call", "return") and frame.f_code.co_filename.startswith(PACKAGE):
            self.count += 1
            if self.count == self.at:
                sys.setprofile(None)
                signal.raise_signal(signal.SIGINT)

    def run(self, monkeypatch, call):
        """Result of a call, or the exception of Ctrl-C in it."""
        solve = ProblemSolver.solve

        def noting(solver, *arguments, **named):
            solution = solve(solver, *arguments, **named)
            self.solved.append(solution.cost)
            return solution

        with monkeypatch.context() as patched:
            patched.setattr(ProblemSolver, "solve", noting)
            sys.setprofile(self)
            try:
                return call()
            except KeyboardInterrupt as error:
                return error
            finally:
                sys.setprofile(None)


@pytest.mark.slow
@pytest.mark.parametrize("settings", [dict(starts=3), dict(tolerance=1e-7), dict(starts=2, tolerance=1e-7)])
def test_at_every_instant(monkeypatch, settings):
    """Between the solves, in the guesses, in the local errors: one of the solutions that were found is there."""
    problem, *_ = swing_up(8.0, 2.0)
    call = lambda: mbd.optimize(problem, intervals=12, **settings)  # noqa: E731
    call()
    whole = Instants()
    whole.run(monkeypatch, call)
    assert whole.count > 50 and len(whole.solved) >= 2
    for at in np.unique(np.linspace(1, whole.count - 20, 15).astype(int)).tolist():
        instant = Instants(at)
        error = instant.run(monkeypatch, call)
        assert isinstance(error, mbd.Interrupted), f"instant {at} of {whole.count}: {error!r}"
        costs = whole.solved[: len(instant.solved) + 1]
        if "starts" not in settings:
            costs = costs[-2:]  # the last solve may have ended without having returned
        assert any(error.partial.cost == pytest.approx(cost, rel=1e-9) for cost in costs), f"instant {at}"
        if "tolerance" not in settings:
            assert error.partial.cost <= min(instant.solved) * (1 + 1e-9)
    assert call().cost == pytest.approx(whole.solved[-1] if "tolerance" in settings else min(whole.solved), rel=1e-6)


def test_before_anything_is_solved(monkeypatch):
    """An Interrupted without a partial result, also where a problem is prepared, one that no other test has stated."""
    problem, *_ = rest_to_rest(1.739)

    def pressing(*_arguments):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr("mbdcasadi.optimal_control.program.setup.kinematic_path", pressing)
    with pytest.raises(mbd.Interrupted, match="no solution was found yet") as caught:
        mbd.optimize(problem, intervals=4)
    assert caught.value.partial is None
