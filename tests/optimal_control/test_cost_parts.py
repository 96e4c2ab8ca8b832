"""Positive parts and magnitudes in costs, without kinks."""

import warnings

import numpy as np
import pytest
from motions import pendulum, rest_to_rest
from scipy.optimize import brentq

import mbdcasadi as mbd
from mbdcasadi.optimal_control.motion import limit_excess
from mbdcasadi.optimal_control.motion.limit_excess import passed_limits
from mbdcasadi.optimal_control.solve import problem_solver


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


@pytest.mark.parametrize(("price", "x"), [(10.0, 10 / 24), (100.0, 1.0)])
def test_a_price_on_the_end(price, x):
    """Rest after x in 1 s costs 12 x², and k |x - 1| at the end: x = k / 24, or 1 if that is beyond."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    cost = price * mbd.absolute(block.x - 1)
    solution = mbd.optimize(problem.replace(final=[block.vx == 0], terminal_cost=cost), intervals=6)
    assert solution.cost == pytest.approx(12 * x**2 + price * (1 - x), rel=1e-6)
    assert solution.trajectory[block.x][-1] == pytest.approx(x, rel=1e-6)


@pytest.mark.parametrize("unit", [1e-4, 1e5])
def test_a_price_on_a_place_on_the_way(unit):
    """Out to x and back costs 192 x², and k max(0.3 - x, 0) on the way: x = k / 384; the same in any unit of costs."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    there = mbd.Waypoint(0.5, cost=unit * 20 * mbd.positive_part(0.3 - block.x))
    back = problem.replace(final=[block.x == 0, block.vx == 0], running_cost=unit * u**2, waypoints=[there])
    solution = mbd.optimize(back, intervals=6)
    x = 20 / 384
    assert solution.cost / unit == pytest.approx(192 * x**2 + 20 * (0.3 - x), rel=1e-5)
    (part,) = back.free_parameters
    assert solution.parameters[part] == pytest.approx(0.3 - x, rel=1e-4)
    assert back.replace(duration=2.0).free_parameters == back.free_parameters


def test_one_waypoint_twice():
    """The same object at two times has a part at each."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    there = mbd.Waypoint((0.2, 0.8), cost=20 * mbd.positive_part(0.3 - block.x))
    twice = problem.replace(waypoints=[there, there], running_cost=u**2)
    assert len(twice.free_parameters) == 2
    assert not problem.replace(waypoints=twice.waypoints[:0]).free_parameters


def test_a_part_of_the_old_cost_goes_with_it():
    """A replaced terminal cost leaves neither a parameter nor a condition behind."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    priced = problem.replace(terminal_cost=mbd.absolute(block.x - 1))
    assert len(priced.free_parameters) == 1 and len(priced.boundary) == 2
    plain = priced.replace(terminal_cost=block.x)
    assert not plain.free_parameters and not plain.boundary


def test_a_budget_of_fuel():
    """Least ``∫u²`` with ``∫|u|`` at most B: u = ± a (|1 - t| - s) before and after a time of coasting."""
    problem, u, block = rest_to_rest(1.0, 2.0)
    budget = 1.25

    def way(s):
        a = budget / (1 - s) ** 2
        return 2 * a * ((1 - s**3) / 3 - s * (1 - s**2) / 2)

    s = brentq(lambda s: way(s) - 1, 0.0, 0.9)
    exact = 2 / 3 * (budget / (1 - s) ** 2) ** 2 * (1 - s) ** 3
    saving = problem.replace(boundary=[mbd.integral(mbd.absolute(u)) <= budget])
    solution = mbd.optimize(saving, intervals=40)
    assert solution.cost == pytest.approx(exact, rel=1e-4)
    assert solution.trajectory[block.x][-1] == pytest.approx(1, abs=1e-8)
    assert len(saving.replace(duration=3.0).mechanism.inputs) == 2


@pytest.mark.parametrize(
    ("where", "arguments"),
    [
        ("boundary", lambda part: {"boundary": [part <= 1]}),
        ("path", lambda part: {"path": [part <= 1]}),
        ("path", lambda part: {"running_cost": mbd.positive_part(part)}),
    ],
)
def test_elsewhere_it_is_refused(where, arguments):
    """With the place where it belongs."""
    problem, u, _block = rest_to_rest()
    with pytest.raises(mbd.ExpressionError, match=rf"{where}: .*absolute\(u\), which belongs in a cost"):
        problem.replace(**arguments(mbd.absolute(u)))


@pytest.mark.parametrize(
    "arguments",
    [
        lambda part: {"running_cost": 1 - part},
        lambda part: {"terminal_cost": -2 * part},
        lambda part: {"terminal_cost": -mbd.integral(part)},
        lambda part: {"boundary": [mbd.integral(part) >= 1]},
        lambda part: {"waypoints": [mbd.Waypoint(0.5, cost=-part)]},
    ],
)
def test_what_falls_with_a_part_is_refused(arguments):
    """Its symbol is at least the part, not the part: a cost that falls with it would have no minimum."""
    problem, u, _block = rest_to_rest()
    with pytest.raises(mbd.ExpressionError, match=r"falls with absolute\(u\)"):
        problem.replace(**arguments(mbd.absolute(u)))


def test_an_integral_of_a_part_has_no_prescribed_value():
    """For the same reason."""
    problem, u, _block = rest_to_rest()
    with pytest.raises(mbd.ExpressionError, match="prescribes an integral with positive_part or absolute"):
        problem.replace(boundary=[mbd.integral(mbd.absolute(u)) == 1])


def test_the_message_of_a_kink_leads_there():
    """For fabs and fmax in a cost."""
    problem, u, block = rest_to_rest(lower=-5, upper=5)
    with pytest.raises(mbd.OptimizationError, match=r"mbd\.absolute\(x\) and mbd\.positive_part\(x\)"):
        mbd.optimize(problem.replace(running_cost=mbd.fabs(u * block.vx)), intervals=6, options={"ipopt.max_iter": 60})


@pytest.mark.slow
def test_a_part_that_falls_short_for_an_instant_is_no_warning():
    """Where the power changes its sign, its part is passed by all of itself, which is little of its size."""
    bob, tau, mechanism = pendulum()
    power, start, end = tau * bob.omega, [bob.phi == 0, bob.omega == 0], [bob.phi == 0.5, bob.omega == 0]
    cost = mbd.positive_part(power) + 0.01 * tau**2
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(mbd.OptimalControlProblem(mechanism, 1.5, start, end, running_cost=cost), intervals=10)
    shares = (np.arange(400) + 0.5) / 400
    motion = solution.trajectory.at((solution.mesh[:-1, None] + np.diff(solution.mesh)[:, None] * shares).ravel())

    def integral(values):
        return np.sum(np.diff(solution.mesh) * np.mean(values.reshape(-1, 400), axis=1))

    supplied = integral(np.maximum(motion[power], 0))
    assert solution.cost == pytest.approx(supplied + 0.01 * integral(motion[tau] ** 2), rel=1e-3)
    assert not passed_limits(solution)
    (passed,) = (limit for limit in passed_limits(solution, 0.0) if limit.missing is not None)
    part = next(c for c in solution.phases[0].program.limits_at_points if c.label == passed.label)
    missing = integral(np.maximum(motion[part.expression], 0)) / supplied
    values = motion[part.expression]
    assert passed.amount == pytest.approx(np.max(values), rel=0.01)
    assert 0 < np.max(values) < 0.02 * np.max(np.abs(motion[power]))
    assert passed.missing == pytest.approx(missing, rel=0.2) and missing < 3e-3


def test_a_part_that_falls_short_is_a_warning_with_what_is_missing(monkeypatch):
    monkeypatch.setattr(problem_solver, "ROUNDS", 0)
    monkeypatch.setattr(limit_excess, "LIMIT_TOLERANCE", 5e-3)
    problem, u, block = rest_to_rest(1.0, 1.0, lower=-8, upper=8)
    work = problem.replace(running_cost=mbd.absolute(u * block.vx) + 1e-3 * u**2)
    with pytest.warns(mbd.MechanismWarning, match=r"\(so that 0.56 % of its integral are missing in the cost\)"):
        mbd.optimize(work, intervals=5)
