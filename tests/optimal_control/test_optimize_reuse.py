"""A problem solved again: other starts, other parameters, options, wrong arguments of optimize."""

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest, sprung_block

import mbdcasadi as mbd
from mbdcasadi.optimal_control.search.budgets import BUDGETS
from mbdcasadi.optimal_control.solve.solvers.ipopt import WARM_START, Ipopt


@pytest.fixture
def sprung():
    """A block on a spring whose stiffness is a parameter."""
    return sprung_block(3.0, 2.0)


def least_effort(stiffness, start, end, duration, speed=0.0):
    """Least integral of u² for x'' + k x = u between two states, by the Gramian of controllability."""
    from scipy.linalg import expm

    a, b = np.array([[0.0, 1.0], [-stiffness, 0.0]]), np.array([[0.0], [1.0]])
    block = expm(np.block([[-a, b @ b.T], [np.zeros((2, 2)), a.T]]) * duration)  # Van Loan 1978
    gramian = block[2:, 2:].T @ block[:2, 2:]
    gap = np.array([end, 0.0]) - expm(a * duration) @ np.array([start, speed])
    return float(gap @ np.linalg.solve(gramian, gap))


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_other_starts_and_parameters_reuse_what_was_compiled(sprung, transcription):
    """Against the Gramian; the compiled program and solver are the same objects, and building takes no time."""
    problem, _u, k, block = sprung
    settings = dict(intervals=16, transcription=transcription)
    rel = 1e-7 if transcription == "gauss-legendre" else 1e-4
    first = mbd.optimize(problem, **settings)
    assert first.cost == pytest.approx(least_effort(3.0, 0.0, 1.0, 2.0), rel=rel)
    built = dict(problem.compiled.programs)
    for stiffness, start, speed in ((3.0, 0.5, 0.0), (8.0, 0.0, 0.0), (0.5, -1.0, 2.0), (3.0, 0.0, 0.0)):
        again = mbd.optimize(
            problem, initial=[block.x == start, block.vx == speed], parameters={k: stiffness}, **settings
        )
        assert again.cost == pytest.approx(least_effort(stiffness, start, 1.0, 2.0, speed), rel=rel)
        assert problem.compiled.programs == built
        assert again.program is first.program
        assert again.trajectory.initial[block.x] == pytest.approx(start, abs=1e-12)
        assert again.verify().final_error < 1e-3


def test_a_state_as_the_start(sprung):
    """As a simulation hands it over in model-predictive control."""
    problem, _u, _k, block = sprung
    first = mbd.optimize(problem, intervals=16)
    built = dict(problem.compiled.programs)
    state = first.simulate().state(4)
    again = mbd.optimize(problem, intervals=16, initial=state, guess=first)
    exact = least_effort(3.0, state[block.x], 1.0, 2.0, state[block.vx])
    assert again.cost == pytest.approx(exact, rel=1e-6)
    third = mbd.optimize(problem, intervals=16, initial=first.simulate().state(6), guess=again)
    assert third.program is again.program is first.program
    assert problem.compiled.programs == built


@pytest.mark.slow
def test_closing_the_loop_on_a_linkage():
    """Horizon after horizon from the simulated state: no new program after the first two solves."""
    f = crank_rocker()
    problem = half_turn(f)
    solution = mbd.optimize(problem, intervals=20)
    states = [solution.simulate().state(k) for k in (2, 4, 6)]
    sizes = []
    for state in states:
        solution = mbd.optimize(problem, intervals=20, initial=state, guess=solution)
        sizes.append(len(problem.compiled.programs))
        assert solution.trajectory.initial[f.crank.phi] == pytest.approx(state[f.crank.phi], abs=1e-10)
    assert len(set(sizes)) == 1


def test_the_original_problem_is_left_alone(sprung):
    """initial= and parameters= are for one call."""
    problem, _u, k, block = sprung
    before = mbd.optimize(problem, intervals=8).cost
    mbd.optimize(problem, intervals=8, initial=[block.x == 0.7, block.vx == 0], parameters={k: 9.0})
    assert mbd.optimize(problem, intervals=8).cost == before
    assert k.value == 3.0
    with pytest.raises(AttributeError, match="does not change"):
        problem.duration = 3.0


def test_wrong_starts(sprung):
    """The same errors as in the problem."""
    problem, _u, _k, block = sprung
    for wrong in (3, "x", [True], [block.x], {}, [block.y == 0], [block.x == 0, block.x == 1]):
        with pytest.raises(mbd.ConditionError):
            mbd.optimize(problem, intervals=4, initial=wrong)
    stranger = mbd.Parameter("stranger", 1.0)
    with pytest.raises(mbd.ExpressionError, match="stranger"):
        mbd.optimize(problem, intervals=4, initial=[block.x == stranger])
    with pytest.raises(mbd.ModelError, match="state belongs"):
        mbd.optimize(problem, intervals=4, initial=mbd.assemble(crank_rocker().mechanism))


def test_wrong_parameters(sprung):
    """Named with what there is."""
    problem, u, k, _ = sprung
    for wrong in (3, "x", {3: 1}, {"k": 1}, {mbd.Parameter("z", 1.0): 1}, {u: 1}):
        with pytest.raises(mbd.ModelError, match="parameters="):
            mbd.optimize(problem, intervals=4, parameters=wrong)
    for wrong in ("a", np.nan, [1, 2], None):
        with pytest.raises(mbd.ModelError, match="'k'"):
            mbd.optimize(problem, intervals=4, parameters={k: wrong})


WRONG = [
    *[("intervals", x) for x in (0, 1, -1, 2.5, "4", True, None, np.nan, np.inf, [3, 4])],
    *[("degree", x) for x in (0, 6, 2.5, "3", None, True, [3])],
    *[("tolerance", x) for x in (0, -1, "a", np.nan, [1])],
    *[("guess", x) for x in (3, "x", [1])],
    *[("starts", x) for x in (0, -1, 2.5, [], True)],
    *[("transcription", x) for x in ("x", None, 3, ["gauss-legendre"], "hermite_simpson")],
    *[("control", x) for x in ("x", None, 3, ["linear"])],
    *[("options", x) for x in (3, "x", ["ipopt.tol"], {3: 4})],
    *[("progress", x) for x in ("yes", 3, None)],
]


@pytest.mark.parametrize(("argument", "wrong"), WRONG, ids=[f"{a}={w!r}" for a, w in WRONG])
def test_wrong_arguments_of_optimize(argument, wrong):
    """Refused by name, before anything is solved."""
    problem, *_ = rest_to_rest()
    with pytest.raises(mbd.ModelError, match=argument):
        mbd.optimize(problem, **({"intervals": 4} | {argument: wrong}))


def test_what_is_no_problem():
    """A mechanism is none."""
    for wrong in (3, None, rest_to_rest()[0].mechanism):
        with pytest.raises(mbd.ModelError, match="OptimalControlProblem"):
            mbd.optimize(wrong)


def test_options_pass_through():
    """Options of IPOPT take effect."""
    problem = half_turn(crank_rocker())
    loose = mbd.optimize(problem, intervals=10, options={"ipopt.tol": 1e-2, "ipopt.constr_viol_tol": 1e-2})
    tight = mbd.optimize(problem, intervals=10, options={"ipopt.tol": 1e-10})
    assert loose.statistics.iterations < tight.statistics.iterations
    with pytest.raises(mbd.OptimizationError, match="iterations"):
        mbd.optimize(problem, intervals=10, options={"ipopt.max_iter": 1})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "name"),
    [
        ({"nope": 1}, "nope"),
        ({"ipopt.nope": 1}, "nope"),
        ({"ipopt.max_iter": "a"}, "options"),
        ({"ipopt.max_iter": -3}, "options"),
        ({"ipopt.linear_solver": "ma99"}, "options"),
    ],
)
def test_wrong_options_are_refused(options, name):
    """With the solver's own words."""
    problem, *_ = rest_to_rest()
    with pytest.raises(mbd.ModelError, match=name):
        mbd.optimize(problem, intervals=4, options=options)
    assert mbd.optimize(problem, intervals=4).cost == pytest.approx(12.0)


def test_too_few_intervals_for_the_waypoints():
    """Two for each stretch of the way at least."""
    problem, _, block = rest_to_rest()
    via = problem.replace(waypoints=[mbd.Waypoint(0.5, [block.x == 0.3])])
    with pytest.raises(mbd.ModelError, match="intervals.*at least 4.*1 waypoint"):
        mbd.optimize(via, intervals=3)


def test_a_state_of_another_linkage_is_refused():
    """A pendulum of 0.4 m is no start for one of 0.6 m; nor is a state before its time."""
    u, length = mbd.Input("u"), mbd.Parameter("length", 0.4)
    bob = mbd.Body("bob", mass=1.0, inertia=0.1, pose=(0.4, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-length, 0))
    mechanism = mbd.Mechanism([bob], [pin], forces=[mbd.Torque("motor", bob, u)], inputs=[u], parameters=[length])
    state = mbd.assemble(mechanism, [bob.phi == 0])
    problem = mbd.OptimalControlProblem(mechanism, 1.0, state, [bob.phi == 1], running_cost=u**2)
    assert mbd.optimize(problem, intervals=6).cost > 0
    with pytest.raises(
        mbd.ConditionError, match=r"does not meet pin\.x: it is off by 0\.2; assemble it with the param"
    ):
        mbd.optimize(problem, intervals=6, parameters={length: 0.6})


def test_a_search_that_may_follow_gives_a_warm_start_no_more_iterations(monkeypatch):
    """The limit of the first solve, after which other starts are tried, is that of a start from nothing."""
    problem, *_ = rest_to_rest()
    limits = {}

    def noted(solver, begin, warmth, options, arguments):
        limits[warmth] = (solver.defaults | solver.warm_start[warmth] | options)["ipopt.max_iter"]
        return solve(solver, begin, warmth, options, arguments)

    solve = Ipopt._solve
    monkeypatch.setattr(Ipopt, "_solve", noted)
    solution = mbd.optimize(problem, intervals=10)
    assert limits == {"cold": BUDGETS.first}
    mbd.optimize(problem, intervals=10, guess=solution)
    assert limits["hot"] == WARM_START["hot"]["ipopt.max_iter"] < BUDGETS.first
