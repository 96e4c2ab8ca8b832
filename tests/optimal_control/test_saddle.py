"""Saddles: the cost has no slope there, but falls nearby; what is found from there is known in closed form."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, pendulum, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.search import saddle


def pushed(limit=1.0, **demands):
    """A block of 1 kg that begins at rest, pushed for 1 s by a force with a limit, N."""
    force = mbd.Input("force", lower=-limit, upper=limit)
    block, mechanism = guided_block(1.0, force)
    start = [block.x == 0, block.vx == 0]
    made = {name: value(block, force) for name, value in demands.items()}
    return mbd.OptimalControlProblem(mechanism, 1.0, initial=start, **made), block, force


@pytest.mark.parametrize(
    ("demands", "least"),
    [
        ({"terminal_cost": lambda block, force: -(block.x**2)}, -1 / 4),
        ({"running_cost": lambda block, force: -(block.vx**2)}, -1 / 3),
        ({"waypoints": lambda block, force: [mbd.Waypoint(0.5, cost=-(block.x**2))]}, -1 / 64),
    ],
)
def test_a_saddle_is_left(demands, least):
    """The block gets as far, or as fast, as 1 N brings it; at rest the cost is the greatest of all."""
    problem, *_ = pushed(**demands)
    for starts in (None, 1):
        solution = mbd.optimize(problem, starts=starts)
        assert solution.cost == pytest.approx(least, rel=1e-6) and solution.statistics.at_saddle is False
        assert solution.statistics.starts[0].cost == pytest.approx(0, abs=1e-9)


def test_a_saddle_of_several_phases_is_left():
    """The same push in two phases."""
    problem, block, _ = pushed()
    first = mbd.Phase("first", problem.mechanism, 0.5, initial=problem.initial)
    second = mbd.Phase("second", problem.mechanism.replace(), 0.5)
    far = mbd.OptimalControlProblem(phases=[first, second], terminal_cost=-(block.x**2))
    assert mbd.optimize(far).cost == pytest.approx(-1 / 4, rel=1e-6)


@pytest.mark.parametrize("limit", [np.inf, 10.0])
def test_a_saddle_of_a_parameter_is_left(limit):
    """The solver stays at the value 0 of a parameter that is best at its limits; with limits of the force a search
    leads there."""
    k = mbd.Parameter("k", 0.0, lower=-1, upper=1)
    problem, *_ = rest_to_rest(lower=-limit, upper=limit, terminal_cost=-(k**2), free_parameters=[k])
    solution = mbd.optimize(problem)
    assert solution.cost == pytest.approx(12 - 1, rel=1e-6) and abs(solution.parameters[k]) == pytest.approx(1)


def test_the_least_duration_is_no_saddle():
    """Nothing but the duration counts, which is at its limit; any torque within its limits is as good."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f, duration=(0.6, 2), running_cost=0, terminal_cost=mbd.t), intervals=10)
    assert solution.duration == pytest.approx(0.6) and solution.statistics.at_saddle is False


def test_a_cost_without_lower_bound_from_a_saddle():
    """An effort of at least 3 x² is too small a price for what x² brings, and at rest the cost is zero."""
    demands = {"running_cost": lambda block, force: force**2 / 10, "terminal_cost": lambda block, force: -(block.x**2)}
    problem, *_ = pushed(limit=np.inf, **demands)
    with pytest.raises(mbd.OptimizationError, match="no lower bound"):
        mbd.optimize(problem)


def test_a_pendulum_that_hangs_is_swung_as_high_as_it_gets():
    """A simulation with the torque that was found gets there, and rectangular torques do not get higher."""
    bob, tau, mechanism = pendulum(limit=2)
    start = [bob.phi == 0, bob.omega == 0]
    solution = mbd.optimize(mbd.OptimalControlProblem(mechanism, 3.0, initial=start, terminal_cost=-bob.y))
    times = np.linspace(0, 3, 301)
    replayed = solution.verify()
    assert replayed.final_error < 1e-4
    for first in np.linspace(0.2, 1.4, 7):
        switches = first + (3 - first) / 2 * np.arange(2)
        torque = 2 * (-1.0) ** np.searchsorted(switches, times)
        assert -mbd.simulate(mechanism, times, initial=start, inputs={tau: torque}).final[bob.y] > solution.cost - 1e-6


def test_no_saddle_is_seen_where_inputs_are_not_decided():
    """The least time does not depend on a second input, and the cost neither rises nor falls with it."""
    force, idle = mbd.Input("force", lower=-1, upper=1), mbd.Input("idle")
    block, mechanism = guided_block(1.0, force)
    problem = mbd.OptimalControlProblem(
        mechanism.replace(inputs=[force, idle]),
        (0.1, 5),
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem)
    assert solution.cost == pytest.approx(2, rel=1e-6)
    assert solution.statistics.at_saddle is False and not solution.statistics.starts


def test_a_saddle_that_is_not_left_is_reported(monkeypatch):
    """If no solve from nearby succeeds, the solution comes with a warning."""
    monkeypatch.setattr(saddle, "STEP", 0.0)
    problem, *_ = pushed(terminal_cost=lambda block, force: -(block.x**2))
    with pytest.warns(mbd.MechanismWarning, match="is a saddle"):
        solution = mbd.optimize(problem)
    assert solution.statistics.at_saddle and solution.cost == pytest.approx(0, abs=1e-9)
