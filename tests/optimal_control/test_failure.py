"""What is said where no optimum is found, and when the user stops the search."""

import os
import signal
import threading
import time

import casadi as ca
import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest, swing_up

import mbdcasadi as mbd
from mbdcasadi.optimal_control.solve.expressions import kinks_in


def failed(problem, **settings):
    """The error of a solve that must fail."""
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem, **settings)
    return caught.value


@pytest.mark.slow
def test_too_weak_a_motor():
    """The status in words, violations sorted, with label, unit, node and time; the last iterate."""
    problem, bob, _ = swing_up(0.1, 0.2)
    error = failed(problem, intervals=10)
    assert "infeasible" in str(error) and isinstance(error, mbd.MechanismError)
    found = error.largest_violations
    assert found and found == sorted(found, key=lambda v: -v.scaled)
    for violation in found:
        assert 0 <= violation.time <= 0.2 and violation.violation > 0
        assert violation.interval is None or 0 <= violation.interval < 10
        assert 0 <= violation.tau <= 1
        assert "bob" in violation.label or "pin" in violation.label
        assert str(violation).startswith(violation.label)
    first = error.conflict[0]
    assert error.time == first.time and str(first) in str(error)
    units = {
        "equation of motion of bob.phi": "N m",
        "continuity of bob.phi": "rad",
        "continuity of the velocity of bob.phi": "rad/s",
    }
    by_label = {row.label: row.unit for row in error.partial.program.rows}
    assert {k: by_label[k] for k in units} == units
    assert "equation of motion of bob.x" not in by_label  # the pin gives x and y
    partial = error.partial
    assert isinstance(partial, mbd.Solution) and partial.statistics.status == "Infeasible_Problem_Detected"
    assert partial.trajectory[bob.phi].size == 41 and partial.mesh.size == 11


def test_units_of_the_equations_of_a_loop():
    """A loop of pins is left with its angles, and with the pin that closes it."""
    program = mbd.optimize(half_turn(crank_rocker()), intervals=8).program
    by_label = {row.label: row.unit for row in program.rows}
    units = {
        "equation of motion of coupler.phi": "N m",
        "continuity of coupler.phi": "rad",
        "continuity of the velocity of coupler.phi": "rad/s",
        "constraint B.x": "m",
        "velocity equation of B.x": "m/s",
        "acceleration equation of B.x": "m/s²",
    }
    assert {k: by_label[k] for k in units} == units


@pytest.mark.slow
def test_the_time_of_a_violation():
    """A waypoint out of reach of the limits is named at its own time."""
    problem, _u, block = rest_to_rest(1.0, 1.0, lower=-8, upper=8)
    error = failed(problem.replace(waypoints=[mbd.Waypoint(0.25, [block.x == 3])]), intervals=8)
    labels = [v.label for v in error.largest_violations]
    assert any("waypoint 1" in label for label in labels) or all(v.time <= 0.25 for v in error.largest_violations)


def test_a_path_that_the_linkage_cannot_follow():
    """The rocker cannot turn round: nothing is solved."""
    f = crank_rocker()
    error = failed(half_turn(f, final=[f.rocker.phi == 4.5, f.rocker.omega == 0]), intervals=10)
    assert "another branch" in str(error) and error.largest_violations and error.partial is None


def test_out_of_iterations():
    """Said with the option that helps; the iterate that is left can be the next guess."""
    problem = half_turn(crank_rocker())
    error = failed(problem, intervals=20, options={"ipopt.max_iter": 3})
    assert "iterations" in str(error) and "max_iter" in str(error)
    assert error.partial.statistics.iterations == 3
    assert mbd.optimize(problem, intervals=20, guess=error.partial).cost > 0


def test_an_expression_that_is_not_finite():
    """The root of a negative number in the cost."""
    problem, _u, block = rest_to_rest()
    error = failed(problem.replace(running_cost=mbd.sqrt(block.x - 5)), intervals=4)
    assert "running_cost: sqrt(block.x - 5) is not finite at t = 0.0" in str(error) and "in the guess" in str(error)
    assert error.time == pytest.approx(0.25 * (0.5 - np.sqrt(0.15)))  # the first stage


def test_a_slope_that_is_not_finite():
    """The root of a speed that is zero has a value, but no slope."""
    problem, _u, block = rest_to_rest(distance=0.0)
    error = failed(problem.replace(running_cost=mbd.sqrt(block.vx)), intervals=4)
    assert "the slope of sqrt(" in str(error) and "is not finite at t" in str(error)


def test_what_else_may_not_be_finite():
    """A division by a way that is zero in the guess, at the end; nothing is said to be met."""
    problem, u, block = rest_to_rest(final=[])
    cost = mbd.integral(u**2) + 1 / mbd.at_end(block.x)
    error = failed(problem.replace(running_cost=0, terminal_cost=cost, path=[u <= 9]), intervals=4)
    assert "a division by zero" in str(error) and "look at terminal_cost, forces;" in str(error)
    assert "are met" not in str(error)


@pytest.mark.parametrize(
    ("function", "where"),
    [
        (lambda x: mbd.if_else(x > 1, x, 2 * x - 1), "passes zero"),
        (lambda x: mbd.if_else(x <= 0, 0, 3 * x), "passes zero"),
        (lambda x: 1 + mbd.fabs(x), "fabs(x) bends"),
        (lambda x: mbd.if_else(x > 0, x**2, 0), None),
        (lambda x: mbd.spline(x, [0, 1, 2, 4], [0, 1, 0, 3]), None),
        (lambda x: x**2, None),
        (lambda x: mbd.sign(x) * x, "x passes zero"),
        (lambda x: ca.floor(x), "x passes a whole number"),
        (lambda x: mbd.fmax(x, 0) ** 2, None),
        (lambda x: mbd.fmax(x, 0) ** 2 + mbd.fabs(x - 1), "fabs(x - 1) bends"),
        (lambda x: ca.atan2(x, 2), None),
    ],
)
def test_kinks_are_found_where_slopes_jump(function, where):
    found = kinks_in(ca.SX(function(ca.SX.sym("x"))))
    assert (where in found[0]) if where else not found


def test_a_kink_in_the_cost_ends_the_search_at_once():
    """No other guess helps a solver with derivatives, and the message does not have to wait."""
    problem, u, _block = rest_to_rest(lower=-5, upper=5)
    error = failed(problem.replace(running_cost=mbd.fabs(u)), intervals=6)
    assert "running_cost has a kink where fabs(u) bends" in str(error) and "mbd.absolute" in str(error)
    assert "tried:" not in str(error) and "infeasible" not in str(error)


@pytest.mark.slow
@pytest.mark.parametrize("place", ["terminal_cost", "running_cost"])
def test_a_cost_without_a_lower_bound(place):
    """As far as a free body can be pushed, or as fast: named after few iterations, as long as nothing limits it."""
    problem, u, block = rest_to_rest()
    free = problem.replace(final=(), running_cost=0).replace(**{place: -block.x})
    error = failed(free, intervals=10)
    assert "no lower bound" in str(error) and "infeasible" not in str(error) and "tried:" not in str(error)
    assert error.partial.statistics.iterations < 100 and error.partial.cost < -1e4
    limited = mbd.optimize(free.replace(path=[mbd.bounded(-2, u, 2)]), intervals=10)
    assert limited.cost == pytest.approx({"terminal_cost": -1, "running_cost": -1 / 3}[place], rel=1e-6)


@pytest.mark.slow
def test_a_kink_is_reported_after_few_iterations():
    """Before the solver runs out of the thousand that it has otherwise; a kink that is never met does no harm."""
    problem, u, block = rest_to_rest()
    error = failed(problem.replace(running_cost=mbd.fabs(u)), intervals=6)
    assert "has a kink where fabs(u) bends" in str(error) and error.partial.statistics.iterations <= 200
    harmless = mbd.optimize(problem.replace(running_cost=u**2 + mbd.fabs(block.x + 5)), intervals=6)
    assert harmless.cost == pytest.approx(17.5 - 1 / 2880, rel=1e-8)  # the magnitude is x + 5


@pytest.mark.slow
@pytest.mark.parametrize("function", [mbd.fabs, lambda x: mbd.fmax(x, 0)])
def test_a_cost_with_a_kink(function):
    """It is named, with the way to state it without, which works."""
    problem, u, block = rest_to_rest(lower=-5, upper=5)
    bent = problem.replace(running_cost=function(u * block.vx))
    error = failed(bent, intervals=6, options={"ipopt.max_iter": 60})
    assert "running_cost has a kink where f" in str(error) and "s >= x" in str(error)
    s = mbd.Input("s")
    mechanism = problem.mechanism.replace(inputs=[u, s])
    lower = -u * block.vx if function is mbd.fabs else 0
    smooth = problem.replace(mechanism=mechanism, running_cost=s, path=[s >= u * block.vx, s >= lower], duration=1.0)
    solution = mbd.optimize(smooth, intervals=12)
    # full force up to the speed v with v (T - v m / F) = d, and the brake: m v² / 2 each time
    work = ((5 - np.sqrt(5)) / 2) ** 2 / 2
    exact = 2 * work if function is mbd.fabs else work
    assert exact * (1 - 1e-6) < solution.cost < 1.02 * exact


@pytest.mark.parametrize("path", [lambda v: [mbd.bounded(2, v, 2)], lambda v: [v <= 2, v >= 2]])
def test_limits_with_nothing_between_them(path):
    """An equality is meant, and named."""
    problem, _u, block = rest_to_rest()
    with pytest.raises(mbd.ConditionError, match=r"path: .*2.* and .*2.* leave nothing between them; .*equality"):
        problem.replace(path=path(block.vx))


def test_an_unbounded_problem():
    """A cost without end: the error says what should be bounded."""
    problem, _u, block = rest_to_rest()
    error = failed(
        problem.replace(final=[], running_cost=0, terminal_cost=-block.x), intervals=4, options={"ipopt.max_iter": 200}
    )
    assert "diverge" in str(error) or "iterations" in str(error) or "bounded" in str(error)


def test_a_tolerance_that_cannot_be_met():
    """Below rounding: the refinement gives up before the mesh fills the memory, and keeps the finest solution."""
    problem, *_ = rest_to_rest(duration=1.0)
    spring = mbd.GeneralizedForce("spring", [(problem.mechanism.bodies[0].x, -mbd.sin(9 * mbd.t))])
    forced = problem.mechanism.replace(forces=[*problem.mechanism.forces, spring])
    with pytest.raises(mbd.MechanismError, match="tolerance") as caught:
        mbd.optimize(problem.replace(mechanism=forced), intervals=4, degree=2, tolerance=1e-17)
    assert isinstance(caught.value.partial, mbd.Solution)
    assert caught.value.partial.mesh.size < 5000


# --- Ctrl-C ---------------------------------------------------------------------------------------
def interrupt_when(ready):
    """A thread that sends Ctrl-C to this process once `ready` says so."""

    def send():
        while not ready.is_set():
            time.sleep(0.001)
        os.kill(os.getpid(), signal.SIGINT)

    thread = threading.Thread(target=send, daemon=True)
    thread.start()
    return thread


@pytest.mark.parametrize("settings", [dict(), dict(tolerance=1e-9), dict(starts=3)])
def test_ctrl_c_keeps_the_last_iterate(monkeypatch, settings):
    """Sent in the middle of a solve: Interrupted, a KeyboardInterrupt, with the iterate in .partial."""
    from mbdcasadi.optimal_control.solve.solvers.ipopt import SolverCallback

    ready, seen, original = threading.Event(), [], SolverCallback.eval_buffer

    def counting(self, *arguments):
        seen.append(1)
        if len(seen) == 3:
            ready.set()
            time.sleep(0.1)  # the signal arrives while the solver is at work
        return original(self, *arguments)

    monkeypatch.setattr(SolverCallback, "eval_buffer", counting)
    thread = interrupt_when(ready)
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(mbd.Interrupted) as caught:
        mbd.optimize(swing_up(2.0, 6.0)[0], intervals=60, **settings)
    ready.set()
    thread.join()
    assert isinstance(caught.value, KeyboardInterrupt)
    partial = caught.value.partial
    assert isinstance(partial, mbd.Solution) and 1 <= partial.statistics.iterations <= 6
    assert len(seen) <= 6, "the search ended soon after"
    assert np.all(np.isfinite(partial.trajectory.q))
    assert signal.getsignal(signal.SIGINT) is before


def test_a_solve_after_ctrl_c_runs(monkeypatch):
    """Nothing of the interruption is left in what was compiled."""
    from mbdcasadi.optimal_control.solve.solvers.ipopt import SolverCallback

    problem, *_ = rest_to_rest(3.0, 2.0)
    ready, original = threading.Event(), SolverCallback.eval_buffer

    def waiting(self, *arguments):
        ready.set()
        time.sleep(0.1)
        return original(self, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(SolverCallback, "eval_buffer", waiting)
        thread = interrupt_when(ready)
        with pytest.raises(mbd.Interrupted):
            mbd.optimize(problem, intervals=6)
        thread.join()
    assert mbd.optimize(problem, intervals=6).cost == pytest.approx(13.5, rel=1e-8)


@pytest.mark.slow
def test_progress_shows_iteration_cost_and_violation(capfd):
    """On standard error, only where it is asked for."""
    problem = half_turn(crank_rocker())
    solution = mbd.optimize(problem, intervals=8, progress=True)
    shown = capfd.readouterr()
    assert f"{solution.statistics.iterations + 1} iterations" in shown.err
    assert "cost" in shown.err and "violation" in shown.err
    mbd.optimize(problem, intervals=9)
    silent = capfd.readouterr()
    assert silent.out == "" and silent.err == ""


@pytest.mark.slow
def test_the_side_of_a_limit_that_is_missed_is_named():
    """Backwards by four metres in one second at 3 m/s at most: the lower side of the limit is broken."""
    problem, _, block = rest_to_rest(-4.0, 1.0)
    error = failed(problem.replace(path=[mbd.bounded(-3, block.vx, 5)]), intervals=8)
    labels = [violation.label for violation in error.largest_violations]
    assert "-3 <= block.vx" in labels or any("block.x" in label for label in labels)
    assert "block.vx <= 5" not in labels
