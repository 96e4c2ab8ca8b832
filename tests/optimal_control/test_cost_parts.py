"""Positive parts and magnitudes in running costs, without kinks."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


@pytest.mark.slow
@pytest.mark.parametrize("part", [mbd.absolute, mbd.positive_part])
def test_the_work_of_a_motor(part):
    """Full force up to the speed v with v (T - v m / F) = d, and the brake: m v² / 2 each time."""
    problem, u, block = rest_to_rest(duration=1.0, lower=-5, upper=5)
    solution = mbd.optimize(problem.replace(running_cost=part(u * block.vx)), intervals=20)
    work = ((5 - np.sqrt(5)) / 2) ** 2 / 2
    exact = 2 * work if part is mbd.absolute else work
    assert exact * (1 - 1e-6) < solution.cost < 1.01 * exact
    assert solution.verify().final_error < 1e-6


def test_least_fuel():
    """The integral of |u| from rest to rest over d in T with |u| <= F: 2 F t with t (T - t) = d m / F."""
    problem, u, _block = rest_to_rest(1.0, 2.0, lower=-2, upper=2)
    t = 1 - np.sqrt(1 - 0.5)
    solution = mbd.optimize(problem.replace(running_cost=3 * mbd.absolute(u) + 1), intervals=40)
    assert solution.cost == pytest.approx(3 * 2 * 2 * t + 2, rel=2e-3)
    assert solution.cost > 3 * 2 * 2 * t + 2 - 1e-6


def test_a_part_twice_is_one_input():
    """The same part in two places; the mechanism of the user keeps its inputs."""
    problem, u, _block = rest_to_rest()
    part = mbd.absolute(u)
    both = problem.replace(running_cost=part + 2 * part)
    assert len(problem.mechanism.inputs) == 1 and len(both.mechanism.inputs) == 2
    assert both.mechanism.inputs[1].label == "absolute(u)"
    assert len(both.replace(duration=3.0).mechanism.inputs) == 2


def test_the_motion_goes_on_with_the_model_of_the_user():
    """Simulated with the inputs of the solution that the mechanism has."""
    problem, u, block = rest_to_rest(1.0, 2.0, lower=-2, upper=2)
    solution = mbd.optimize(problem.replace(running_cost=mbd.absolute(u)), intervals=10)
    motion = mbd.simulate(
        problem.mechanism, solution.mesh, initial=[block.x == 0, block.vx == 0], inputs={u: solution.inputs[u]}
    )
    assert motion.final[block.x] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("where", ["terminal_cost", "boundary", "path", "integral"])
def test_elsewhere_it_is_refused(where):
    """With the place where it belongs."""
    problem, u, _block = rest_to_rest()
    part = mbd.absolute(u)
    changes = {
        "terminal_cost": {"terminal_cost": part},
        "boundary": {"boundary": [part <= 1]},
        "path": {"path": [part <= 1]},
        "integral": {"terminal_cost": mbd.integral(part)},
    }
    with pytest.raises(mbd.ExpressionError, match=r"absolute\(u\), which belongs in running_cost="):
        problem.replace(**changes[where])


def test_the_message_of_a_kink_leads_there():
    """For fabs and fmax in a cost."""
    problem, u, block = rest_to_rest(lower=-5, upper=5)
    with pytest.raises(mbd.OptimizationError, match=r"mbd\.absolute\(x\) and mbd\.positive_part\(x\)"):
        mbd.optimize(problem.replace(running_cost=mbd.fabs(u * block.vx)), intervals=6, options={"ipopt.max_iter": 60})
