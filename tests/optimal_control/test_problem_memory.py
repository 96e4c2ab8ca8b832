"""What is left of problems that are gone, and of solves that are over."""

import gc
import weakref

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.model import symbols


@pytest.fixture
def no_collector():
    """Without the cyclic garbage collector, which does not see the memory behind compiled functions."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.slow
def test_a_discarded_problem_leaves_nothing(no_collector):
    """Neither programs nor solvers nor solutions, at once."""
    f = crank_rocker()
    problem = half_turn(f, boundary=[mbd.at_end(f.rocker.omega) >= mbd.at_start(f.rocker.omega) - 5])
    solution = mbd.optimize(problem, intervals=8, tolerance=1e-3, starts=2)
    mbd.optimize(problem, intervals=8, initial=solution.state(0), guess=solution)
    left = [weakref.ref(x) for x in (problem, problem.phases[0], solution, solution.program, problem.compiled)]
    del problem, solution
    assert [x() for x in left] == [None] * 5


@pytest.mark.slow
def test_a_hundred_discarded_problems_leave_no_symbols():
    """Placeholders live as long as the expressions in which they stand."""
    problem, u, block = rest_to_rest(3.0, 2.0)

    def made(k):
        ends = [mbd.at_end(block.x * k) >= mbd.at_start(block.x) - 1, mbd.integral(u**2) <= 100 + k]
        return problem.replace(boundary=ends, terminal_cost=mbd.at_end(block.vx) * k)

    made(0)
    gc.collect()
    registered = len(symbols._ROLES)
    kept = len(problem.mechanism.cache)
    for k in range(1, 101):
        made(k)
    gc.collect()
    assert len(symbols._ROLES) == registered
    assert len(problem.mechanism.cache) <= kept + 5


def test_placeholders_outlive_the_names_that_made_them():
    """In an expression that is kept, and in the conditions of a problem that is gone."""
    problem, u, block = rest_to_rest(3.0, 2.0)
    effort = 2 * mbd.integral(u**2)
    far = mbd.OptimalControlProblem(
        problem.mechanism, 2.0, problem.initial, [block.vx == 0], boundary=[effort <= 12], terminal_cost=-block.x
    )
    boundary = far.boundary
    del far, effort
    gc.collect()
    again = problem.replace(
        final=[block.vx == 0], running_cost=0, terminal_cost=-mbd.at_end(block.x), boundary=boundary
    )
    assert mbd.optimize(again, intervals=8).cost == pytest.approx(-np.sqrt(6 * 8 / 12), rel=1e-6)


@pytest.mark.slow
def test_programs_and_solvers_of_one_problem_are_bounded():
    """Meshes, starts by other conditions, and options, as many as one likes."""
    problem, _, block = rest_to_rest(3.0, 2.0)
    for n in range(4, 34):
        solution = mbd.optimize(problem, intervals=n, initial=[block.x == 1e-3 * n, block.vx == 0])
    assert len(problem.compiled.programs) < 30
    first = solution.program
    for k in range(12):
        solution = mbd.optimize(problem, intervals=33, initial=solution.initial, options={"ipopt.max_iter": 500 + k})
    assert solution.program is first and first.solvers.idle < 12
