"""The same optima, multipliers and failures by fatrop as by IPOPT, whatever joins the intervals."""

import signal
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest, swing_up

import mbdcasadi as mbd
from mbdcasadi.optimal_control.solve.solvers.fatrop import WatchedGradient


def both(problem, **options):
    """Solutions by IPOPT and by fatrop."""
    reference = mbd.optimize(problem, **options)
    solution = mbd.optimize(problem, solver="fatrop", **options)
    assert (reference.statistics.solver, solution.statistics.solver) == ("ipopt", "fatrop")
    assert solution.statistics.status == reference.statistics.status == "Solve_Succeeded"
    return reference, solution


def assert_same(reference, solution, tolerance=1e-6):
    """The same cost, rows and multipliers of the program."""
    assert solution.cost == pytest.approx(reference.cost, rel=tolerance)
    for name in ("lam_g", "lam_x", "rows"):
        mine, other = getattr(solution.answer, name), getattr(reference.answer, name)
        assert np.allclose(mine, other, atol=tolerance * np.max(np.abs(other), initial=1.0)), name
    for label, values in reference.costates.items():
        size = max(1.0, float(np.max(np.abs(values))))
        assert np.allclose(solution.costates[label], values, atol=100 * tolerance * size), label
    assert {limit.label for limit in solution.active_limits} == {limit.label for limit in reference.active_limits}


def test_least_energy_and_its_costates_in_closed_form():
    """Rest to rest of a mass over d in T: cost 12 m² d² / T³, which grows by 24 m² d / T³ a metre."""
    problem, _, _ = rest_to_rest(distance=2.0, duration=1.5, mass=3.0)
    solution = mbd.optimize(problem, intervals=10, solver="fatrop")
    assert solution.statistics.solver == "fatrop"
    assert solution.cost == pytest.approx(12 * 9 * 4 / 1.5**3, rel=1e-8)
    (pull,) = (value for label, value in solution.costates.items() if label.startswith("final: block.x"))
    assert abs(pull) == pytest.approx(24 * 9 * 2 / 1.5**3, rel=1e-6)


@pytest.mark.slow
def test_a_closed_loop_with_limits():
    """Projection at the mesh points, limits of the torque and of the speed."""
    f = crank_rocker(limit=2.0)
    assert_same(*both(half_turn(f, path=[f.crank.omega <= 9]), intervals=12), 1e-5)


def test_free_times_waypoints_and_free_parameters_are_states():
    """Variables of the whole motion: times of waypoints, a mass that is chosen, an integral."""
    u, mass = mbd.Input("u", lower=-9, upper=9), mbd.Parameter("mass", 1.0, lower=0.5, upper=3.0)
    block, mechanism = guided_block(mass, u, [mass])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=(0.5, 4.0),
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 2, block.vx == 0],
        waypoints=[mbd.Waypoint((0.1, 3.9), [block.x == 0.7])],
        free_parameters=[mass],
        terminal_cost=mbd.t + mbd.integral(u**2) / 50 + 1 / mass,
    )
    reference, solution = both(problem, intervals=8)
    assert_same(reference, solution, 1e-5)
    assert solution.parameters[mass] == pytest.approx(reference.parameters[mass], rel=1e-5)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the mesh of 10 intervals")
def test_conditions_between_start_and_end_are_carried_over_all_intervals():
    """A periodic motion: the start is free, and the end hangs on it."""
    f = crank_rocker()
    boundary = [
        mbd.at_end(f.o2.angle) == mbd.at_start(f.o2.angle) + 2 * np.pi,
        mbd.at_end(f.crank.omega) == mbd.at_start(f.crank.omega),
    ]
    reference, solution = both(half_turn(f, initial=[f.o2.angle == 0.5], final=[], boundary=boundary), intervals=10)
    assert solution.cost == pytest.approx(reference.cost, rel=1e-6)
    assert float(solution.trajectory.final[f.crank.omega]) == pytest.approx(
        float(solution.trajectory.initial[f.crank.omega]), rel=1e-9
    )


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:the mesh of 12 intervals")
def test_hermite_simpson_and_joined_inputs():
    """A scheme whose equations contain both ends of an interval."""
    f = crank_rocker()
    assert_same(*both(half_turn(f), intervals=12, transcription="hermite-simpson", control="linear"))


def test_a_warm_start_needs_few_iterations():
    """Fatrop takes no multipliers, and estimates them from the solution that it is given."""
    problem, *_ = swing_up(8.0, 2.0)
    first = mbd.optimize(problem, intervals=16, solver="fatrop")
    second = mbd.optimize(problem, intervals=16, solver="fatrop", guess=first)
    assert second.cost == pytest.approx(first.cost, rel=1e-9)
    assert second.statistics.solver == "fatrop" and second.statistics.iterations <= 4


def test_what_fatrop_does_not_solve_goes_to_ipopt():
    """With the run of fatrop among the stages, and the options of each for itself."""
    problem, *_ = swing_up(8.0, 2.0)
    options = {"fatrop.max_iter": 2, "ipopt.mu_max": 0.5}
    solution = mbd.optimize(problem, intervals=16, solver="fatrop", options=options)
    assert solution.statistics.solver == "ipopt"
    (stage,) = solution.statistics.stages
    assert stage.description == "fatrop" and stage.iterations <= 3 and stage.status != "Solve_Succeeded"
    expected = mbd.optimize(problem, intervals=16, options={"ipopt.mu_max": 0.5})
    assert solution.cost == expected.cost and solution.statistics.iterations == expected.statistics.iterations


@pytest.mark.slow
def test_failures_say_the_same():
    """A block that cannot get there in time."""
    problem, *_ = rest_to_rest(3.0, 2.0, lower=-1, upper=1)
    texts = []
    for solver in ("ipopt", "fatrop"):
        with pytest.raises(mbd.OptimizationError) as caught:
            mbd.optimize(problem, intervals=6, solver=solver)
        texts.append([(c.label, round(c.violation, 6)) for c in caught.value.conflict])
    assert texts[0] and texts[0] == texts[1]


def test_unknown_solvers_and_options_are_refused():
    """Also those that fatrop reads only as it begins."""
    problem, *_ = rest_to_rest()
    with pytest.raises(mbd.ModelError, match=r"solver must be one of ipopt, fatrop, got 'snopt'"):
        mbd.optimize(problem, intervals=4, solver="snopt")
    with pytest.raises(mbd.ModelError, match="refuses the options"):
        mbd.optimize(problem, intervals=4, solver="fatrop", options={"fatrop.no_such": 1})
    with pytest.raises(mbd.ModelError, match="refuses the options"):
        mbd.optimize(problem, intervals=4, options={"fatrop.max_iter": 1})


def test_interrupted_with_the_last_iterate(monkeypatch):
    """Ctrl-C in the third iteration: fatrop stops there, and IPOPT does not begin."""
    problem, *_ = swing_up(8.0, 2.0)
    calls, original = [], WatchedGradient.eval

    def pressing(self, arguments):
        calls.append(0)
        if len(calls) == 3:
            signal.raise_signal(signal.SIGINT)
        return original(self, arguments)

    monkeypatch.setattr(WatchedGradient, "eval", pressing)
    with pytest.raises(mbd.Interrupted, match=r"the last iterate is in \.partial") as caught:
        mbd.optimize(problem, intervals=16, solver="fatrop")
    assert len(calls) == 3 and caught.value.partial.statistics.iterations == 2
    assert np.all(np.isfinite(caught.value.partial.trajectory.q))
    assert mbd.optimize(problem, intervals=16, solver="fatrop").statistics.solver == "fatrop"


def test_progress_is_shown(capfd):
    """Iterations, cost and violation, as with IPOPT."""
    problem, *_ = rest_to_rest()
    mbd.optimize(problem, intervals=4, solver="fatrop", progress=True)
    assert "largest scaled violation" in capfd.readouterr().err


@pytest.mark.slow
def test_several_starts_in_processes():
    """Fatrop's functions travel."""
    problem, *_ = swing_up(8.0, 2.0)
    expected = mbd.optimize(problem, intervals=16, starts=3, solver="fatrop")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
        found = mbd.optimize(problem, intervals=16, starts=3, solver="fatrop", executor=executor)
    assert found.cost == pytest.approx(expected.cost, rel=1e-9)
    assert found.statistics.solver == expected.statistics.solver == "fatrop"


def test_a_file_keeps_the_solver(tmp_path):
    """The statistics of a solution that is read again name it."""
    problem, *_ = rest_to_rest()
    solution = mbd.optimize(problem, intervals=4, solver="fatrop")
    solution.save(tmp_path / "solution.npz")
    read = mbd.read_solution(tmp_path / "solution.npz", problem)
    assert read.statistics == solution.statistics and read.statistics.solver == "fatrop"
