"""Feasible problems with tight limits, which the solver gives up at first, and problems that are infeasible."""

import casadi as ca
import numpy as np
import pytest
from motions import crank_rocker, half_turn, pendulum, rest_to_rest, swing_up

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.variant import WITHOUT_LIMITS
from mbdcasadi.optimal_control.search import closing_limits, least_violation
from mbdcasadi.optimal_control.search.budgets import Budgets
from mbdcasadi.optimal_control.search.closing_limits import ClosingLimits
from mbdcasadi.optimal_control.search.first_guesses import FirstGuesses
from mbdcasadi.optimal_control.search.least_violation import LeastViolation
from mbdcasadi.optimal_control.search.random_starts import LastStarts
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver

#: The first guesses, and limits that close in.
CLOSING = [FirstGuesses(), ClosingLimits()]


def cart_pole(limit, rail):
    """Kelly's cart-pole with another pole, on a rail of limited length."""
    force = mbd.Input("F", lower=-limit, upper=limit)
    cart = mbd.Body("cart", mass=1.0, inertia=0.1)
    pole = mbd.Body("pole", mass=0.3, inertia=0.0, pose=(0, -0.5, 0))
    mechanism = mbd.Mechanism(
        [cart, pole],
        [
            mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
            mbd.Revolute("pin", cart.at(0, 0), pole.at(0, 0.5)),
        ],
        forces=[mbd.Gravity(), mbd.GeneralizedForce("drive", [(cart.x, force)])],
        inputs=[force],
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[cart.x == 0, cart.vx == 0, pole.phi == 0, pole.omega == 0],
        final=[cart.x == 0.8, cart.vx == 0, pole.phi == np.pi, pole.omega == 0],
        path=[mbd.bounded(-rail, cart.x, rail)],
        running_cost=force**2,
    )
    return problem, cart, force


@pytest.mark.slow
def test_limits_close_in_on_a_cart():
    """The limits hold, the simulation arrives, and the stages are reported; a fresh solve from there confirms it."""
    problem, cart, force = cart_pole(8.0, 1.0)
    solution = mbd.optimize(problem, search=CLOSING)
    stages = solution.statistics.stages
    descriptions = [stage.description for stage in stages]
    assert descriptions[:2] == ["kinematic", "no limits"] and descriptions[-1].startswith("all limits, ")
    assert stages[0].status != "Solve_Succeeded" and stages[1].status == "Solve_Succeeded"
    assert solution.statistics.iterations >= sum(stage.iterations for stage in stages)
    motion = solution.trajectory.at(np.linspace(0, 2, 400))
    assert np.max(np.abs(motion[force])) <= 8 + 1e-6 and np.max(np.abs(motion[cart.x])) <= 1.01
    assert solution.verify().final_error < 2e-2
    assert mbd.optimize(problem, guess=solution).cost == pytest.approx(solution.cost, rel=1e-3)


@pytest.mark.slow
def test_a_least_time_without_limits_is_no_shorter_than_the_guess(monkeypatch):
    """Else forces have no end, and limits do not close in from there; 8 N move 1 kg by 1 m in ``2 / sqrt(8)`` s."""
    original, durations = ProblemSolver.solve, []

    def recorded(self, meshes, guess, **how):
        found = original(self, meshes, guess, **how)
        if how["variant"] is WITHOUT_LIMITS:
            durations.append(found.duration)
        return found

    monkeypatch.setattr(ProblemSolver, "solve", recorded)
    monkeypatch.setattr("mbdcasadi.optimal_control.search.search.BUDGETS", Budgets(first=1))  # the first solve fails
    problem, *_ = rest_to_rest(1.0, (0.01, 10.0), lower=-8, upper=8, running_cost=0, terminal_cost=mbd.t)
    solution = mbd.optimize(problem, search=CLOSING)
    assert durations[0] >= np.sqrt(0.01 * 10.0) - 1e-6
    assert solution.duration == pytest.approx(2 / np.sqrt(8), rel=1e-6)


@pytest.mark.slow
def test_limits_close_in_on_a_finer_mesh(monkeypatch):
    """If the mesh is coarse for the motion without limits, which may then not meet them on it at all."""
    monkeypatch.setattr(closing_limits, "is_coarse", lambda _solution: True)
    problem, cart, _force = cart_pole(8.0, 1.0)
    solution = mbd.optimize(problem, search=CLOSING)
    assert solution.statistics.stages[-1].intervals == 80
    assert np.max(np.abs(solution.trajectory.at(np.linspace(0, 2, 400))[cart.x])) <= 1.01


@pytest.mark.slow
@pytest.mark.parametrize("search", [mbd.STRATEGIES, [FirstGuesses(), LastStarts()]])
def test_a_weak_motor_swings_a_pendulum_up(search):
    """A motor of 2 N m cannot lift the bob at once: limits do not close in on the one swing of a strong motor.

    It swings up by the whole search, and from random starts alone.
    """
    problem, bob, tau = swing_up(2.0, 6.0)
    with pytest.raises(mbd.OptimizationError):
        mbd.optimize(problem, options={"ipopt.max_iter": 15})  # the user's own end of the search
    solution = mbd.optimize(problem, search=search)
    assert np.max(np.abs(solution.trajectory.at(np.linspace(0, 6, 500))[tau])) <= 2 + 1e-6
    assert np.ptp(np.sign(solution.trajectory[bob.omega])) == 2  # it swings back
    assert solution.verify().final_error < 0.05


def test_a_turn_that_the_time_does_not_allow():
    """Half a turn in 0.2 s by 0.1 N m: the limit is in conflict with the end; both are named with sizes.

    A motor of ``4 π / T²`` one way and then the other makes half a turn without gravity, which is 3 % of it.
    """
    problem, *_ = swing_up(0.1, 0.2)
    with pytest.raises(
        mbd.OptimizationError, match="seems infeasible: .* the least violation of all its demands together"
    ) as caught:
        mbd.optimize(problem, intervals=10)
    conflict = caught.value.conflict
    assert {violation.label for violation in conflict[:2]} == {"tau <= 0.1", "tau >= -0.1"}
    wider = np.mean([violation.violation for violation in conflict[:2]])
    assert wider == pytest.approx(4 * np.pi / 0.2**2 - 0.1, rel=0.05)
    assert conflict[2].label == "final: bob.phi == 3.14159" and conflict[2].time == pytest.approx(0.2)
    assert 3 < conflict[2].violation < np.pi and conflict[2].unit == "rad"
    said = str(caught.value)
    assert all(str(violation) in said for violation in conflict[:3]) and said.index("tau <= 0.1") < said.index("final")


@pytest.mark.slow
def test_a_conflict_of_known_size():
    """Full force of 8 N for 0.25 s moves 1 kg by 0.25 m: a waypoint at 3 m is missed by 2.75 m."""
    problem, _, block = rest_to_rest(1.0, 1.0, lower=-8, upper=8)
    with pytest.raises(mbd.OptimizationError, match="infeasible") as caught:
        mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(0.25, [block.x == 3])]), intervals=8)
    *limits, violation = caught.value.conflict
    assert violation.label == "waypoint 1: block.x == 3" and violation.unit == "m"
    assert violation.violation == pytest.approx(2.75, rel=1e-6)
    # without the waypoint missed, 3 m in 0.25 s take 96 N
    assert {limit.label for limit in limits} == {"u <= 8", "u >= -8"}
    assert max(limit.violation for limit in limits) >= 88 * (1 - 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("unit", [None, "N"])
def test_limits_that_would_have_to_be_wider_come_first(unit):
    """A force of 3.8 N for 4 N: both sides are named, each by 0.2 N, with the unit of the input if it has one."""
    problem, *_ = rest_to_rest(lower=-3.8, upper=3.8, unit=unit)
    with pytest.raises(mbd.OptimizationError, match=r"met with wider limits: u .* by 0\.2.*violated then: ") as caught:
        mbd.optimize(problem, intervals=20)
    first, second = caught.value.conflict[:2]
    assert {first.label, second.label} == {"u <= 3.8", "u >= -3.8"} and first.unit == (unit or "")
    assert first.violation == pytest.approx(0.2, rel=1e-5) and second.violation == pytest.approx(0.2, rel=1e-5)
    assert "units of the condition" not in str(caught.value)


@pytest.mark.slow
def test_both_sides_of_a_limit_widen_together():
    """The least violation of a limit of speed of 0.5 m/s for a mean of 1 m/s, there and back, is 0.5 m/s a side."""
    problem, _u, block = rest_to_rest(0.0, 2.0)
    limited = problem.replace(path=[mbd.bounded(-0.5, block.vx, 0.5)], waypoints=[mbd.Waypoint(1.0, [block.x == 1])])
    with pytest.raises(mbd.OptimizationError, match="wider limits") as caught:
        mbd.optimize(limited, intervals=20)
    wider = {violation.label: violation for violation in caught.value.conflict[:2]}
    assert set(wider) == {"block.vx <= 0.5", "-0.5 <= block.vx"}
    for violation in wider.values():
        assert 0.5 < violation.violation < 0.7 and violation.unit == "m/s"  # a start from rest takes longer


@pytest.mark.slow
def test_reactions_have_the_names_of_their_joints():
    """A pin that carries half the weight that hangs on it: the limit is named as it was written."""
    bob, tau, mechanism = pendulum()
    pin = mechanism.joints[0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        0.5,
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == 0.1, bob.omega == 0],
        path=[mbd.norm(pin.reaction_on(bob).force) <= 0.5 * 9.81],
        running_cost=tau**2,
    )
    with pytest.raises(mbd.OptimizationError, match="infeasible") as caught:
        mbd.optimize(problem, intervals=10)
    said = str(caught.value)
    assert "norm(pin.reaction_on(bob).force) <= 4.905" in said and ".lam" not in said
    assert (
        caught.value.conflict[0].violation == pytest.approx(0.5 * 9.81, rel=0.2)
        and caught.value.conflict[0].unit == "N"
    )


@pytest.mark.slow
def test_a_pose_out_of_reach():
    """A rocker that cannot turn round misses its angle by as much as the linkage does."""
    f = crank_rocker()
    problem = half_turn(f, final=[f.rocker.phi == 4.5, f.rocker.omega == 0])
    with pytest.raises(mbd.OptimizationError, match="infeasible") as caught:
        mbd.optimize(problem, intervals=10)
    (violation,) = caught.value.conflict
    angles = [mbd.assemble(f.mechanism, [f.crank.phi == x])[f.rocker.phi] for x in np.linspace(0, 2 * np.pi, 60)]
    assert violation.label == "final: rocker.phi == 4.5"
    assert violation.violation == pytest.approx(4.5 - max(angles), abs=1e-2)


@pytest.mark.slow
def test_what_was_not_proven_is_not_said(monkeypatch):
    """If the least violation ends above zero from too few starts, the problem is not called infeasible."""
    monkeypatch.setattr(least_violation, "STARTS", 6)
    problem, _, block = rest_to_rest(1.0, 1.0, lower=-8, upper=8)
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(0.25, [block.x == 3])]), intervals=8)
    assert "infeasible" not in str(caught.value) and "may still have" in str(caught.value)
    assert "all conditions could be met with wider limits: u " in str(caught.value)
    assert not caught.value.conflict


@pytest.mark.slow
def test_a_feasible_problem_with_a_kink_is_not_called_infeasible():
    """The solver stops at the kink, at a motion that meets all demands, while the least violations end above zero."""
    problem, _, tau = swing_up(8.0, 2.0)
    assert mbd.optimize(problem, intervals=20).cost > 0
    with pytest.raises(mbd.OptimizationError, match="kink") as caught:
        mbd.optimize(problem.replace(running_cost=ca.fabs(tau)), intervals=20)
    assert "infeasible" not in str(caught.value) and not caught.value.conflict


@pytest.mark.slow
def test_ctrl_c_between_the_stages(monkeypatch):
    """A search that is stopped has no solution; its last iterate is kept, and passes limits."""
    original = ProblemSolver.solve

    def stopped(self, meshes, guess, **how):
        found = original(self, meshes, guess, **how)
        if how["variant"] is WITHOUT_LIMITS:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(ProblemSolver, "solve", stopped)
    problem, _, force = cart_pole(8.0, 1.0)
    with pytest.raises(mbd.Interrupted, match="last iterate") as caught:
        mbd.optimize(problem, search=CLOSING)
    assert np.max(np.abs(caught.value.partial.trajectory[force])) > 8


@pytest.mark.slow
def test_stages_are_kept_in_files(tmp_path):
    """As the rest of the statistics."""
    problem, *_ = cart_pole(8.0, 1.0)
    solution = mbd.optimize(problem, search=CLOSING)
    solution.save(tmp_path / "solution.npz")
    assert mbd.read_solution(tmp_path / "solution.npz", problem).statistics.stages == solution.statistics.stages


@pytest.mark.slow
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
def test_the_least_violation_is_that_of_the_force(control):
    """Rest to rest over 1 m in 1 s takes a peak of 4 N; with 3 N, force, way and speed are missed by least together."""
    problem, *_ = rest_to_rest(1.0, 1.0, lower=-3, upper=3)
    with pytest.raises(mbd.OptimizationError, match="infeasible") as caught:
        mbd.optimize(problem, intervals=8, control=control)
    labels = {violation.label for violation in caught.value.conflict}
    assert labels and labels <= {"u <= 3", "u >= -3", "final: block.x == 1", "final: block.vx == 0"}


@pytest.mark.slow
def test_the_least_violation_does_not_depend_on_its_start(monkeypatch):
    """7.6 N move 2 kg by 0.95 m in 1 s where 8 N move them by 1 m: from all five starts the end is missed by 0.05 m."""
    original, totals = ProblemSolver.least_violation, []

    def recorded(self, meshes, guess, limit, nearness, cost_weight=0.0, *, limits_alone=False):
        result = original(self, meshes, guess, limit, nearness, cost_weight, limits_alone=limits_alone)
        if not cost_weight and not limits_alone:
            totals.append((nearness, sum(result[1].values())))
        return result

    monkeypatch.setattr(ProblemSolver, "least_violation", recorded)
    problem, _u, _block = rest_to_rest(1.0, 1.0, lower=-3.8, upper=3.8)
    with pytest.raises(mbd.OptimizationError, match="seems infeasible: .* from 5 starts") as caught:
        mbd.optimize(problem, intervals=40)
    violation = caught.value.conflict[-1]
    assert violation.label == "final: block.x == 1" and violation.violation == pytest.approx(0.05, rel=1e-3)
    last = [total for nearness, total in totals if nearness == closing_limits.NEARNESS]
    assert len(last) == 5 and max(last) <= min(last) * (1 + 1e-3)


@pytest.mark.slow
def test_several_least_violations_are_no_evidence(monkeypatch):
    """Starts that end in different least violations show that there are several, and perhaps one of zero."""
    factors = [1.0] * 5 + [1.0, 1.0, 1.2, 1.2, 1.4, 1.4, 1.6, 1.6, 1.8, 1.8]
    original, factor = ProblemSolver.least_violation, iter(factors)

    def scattered(self, *arguments, **more):
        solution, slacks, succeeded = original(self, *arguments, **more)
        if more.get("limits_alone"):
            return solution, slacks, succeeded
        by = 1.5 if arguments[4] else float(next(factor))  # with penalties there is a weight of the cost
        return solution, {label: by * slack for label, slack in slacks.items()}, succeeded

    monkeypatch.setattr(ProblemSolver, "least_violation", scattered)
    problem, *_ = rest_to_rest(1.0, 1.0, lower=-3.8, upper=3.8)
    with pytest.raises(mbd.OptimizationError, match="may still have one") as caught:
        mbd.optimize(problem, intervals=10, search=[FirstGuesses(), LeastViolation()])
    assert "infeasible" not in str(caught.value) and not caught.value.conflict


@pytest.mark.slow
def test_a_limit_of_an_impulse_alone_is_named():
    """1 kg over 1 m from rest to rest in 1 s with 20 N at most takes 2 √(...) N s; the rows of the magnitude hold."""
    problem, u, _ = rest_to_rest(1.0, 1.0, lower=-20, upper=20)
    limited = problem.replace(boundary=[mbd.integral(mbd.absolute(u)) <= 1.0])
    with pytest.raises(mbd.OptimizationError, match="wider limits: boundary: integral") as caught:
        mbd.optimize(limited, intervals=20)
    limit = caught.value.conflict[0]
    # 20 t (1 - t) = 1: the force acts for t at either end
    least = 2 * 20 * (1 - np.sqrt(1 - 4 / 20)) / 2
    assert limit.label.startswith("boundary: integral") and limit.violation == pytest.approx(least - 1, rel=0.02)
    assert not any("absolute" in other.label for other in caught.value.conflict[1:])
    assert "least met is" not in str(caught.value)
