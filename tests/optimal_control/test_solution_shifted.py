"""A solution from a later time on, as a guess: variables and multipliers of later intervals."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def steered(duration=2.0, **settings):
    """A block that is pushed towards 1 m, with a limit of its speed."""
    problem, u, block = rest_to_rest()
    cost = (block.x - 1) ** 2 + 0.01 * u**2
    problem = problem.replace(duration=duration, final=(), running_cost=cost, path=[block.vx <= 1.2])
    return problem, block, mbd.optimize(problem, **settings)


@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
def test_a_shift_by_intervals_is_that_of_the_motion(control):
    """Moved by whole intervals as by evaluation; the last interval stays, from the end of the motion on."""
    problem, _block, solution = steered(intervals=20, control=control)
    (part,) = solution.phases
    program = part.program
    later = solution.shifted(0.3).as_guess(problem)
    sampled = later.variables(solution.program, solution.meshes)
    whole = later.iterate.x[: 17 * program.stride]
    assert whole == pytest.approx(sampled[: 17 * program.stride], abs=1e-6)
    assert later.iterate.x[program.point_index(20)] == pytest.approx(sampled[program.point_index(20)], abs=1e-9)


def test_a_shift_between_mesh_points_is_evaluated():
    problem, _block, solution = steered(intervals=20)
    later = solution.shifted(0.33).as_guess(problem)
    assert np.array_equal(later.iterate.x, later.variables(solution.program, solution.meshes))


def test_multipliers_are_those_of_later_intervals():
    """Of rows and of variables; those of the last interval stay."""
    problem, _block, solution = steered(intervals=20)
    iterate, answer = solution.shifted(0.3).as_guess(problem).iterate, solution.answer
    count = solution.program.blocks[0].piece.rows.numel()
    rows, later = (x[: 20 * count].reshape(20, count) for x in (answer.lam_g, iterate.lam_g))
    assert np.any(rows) and np.array_equal(later[:17], rows[3:]) and np.array_equal(later[17:], rows[[-1] * 3])
    assert np.array_equal(iterate.lam_g[20 * count :], answer.lam_g[20 * count :])


@pytest.mark.slow
def test_horizons_that_follow_each_other_take_few_iterations():
    """A plan that goes on as the last one says is nearly found already, while the limit of the speed is active, too."""
    problem, block, plan = steered(intervals=40)
    for _ in range(8):
        state = plan.trajectory.at([0.0, 0.05]).final
        plan = mbd.optimize(problem, initial=state, guess=plan.shifted(0.05), intervals=40)
        assert plan.statistics.iterations <= 6
        alone = mbd.optimize(problem.replace(initial=state), intervals=40)
        assert plan.cost == pytest.approx(alone.cost, rel=1e-6)
    assert plan.trajectory.maximum(block.vx).value <= 1.2 * 1.01
