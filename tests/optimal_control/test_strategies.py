"""The list of strategies of a search, and problems whose optima lie far from the usual guess."""

import casadi as ca
import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.motion.guess import Guess
from mbdcasadi.optimal_control.search.first_guesses import FirstGuesses


class FromTheEnd(mbd.Strategy):
    """Solve again from the best motion, and note what is seen."""

    name = "from the end"
    seen = None

    def applies(self, trials):
        return bool(trials.solved)

    def proposals(self, trials):
        motion = trials.solver.motion_of(trials.solved[0].last)
        FromTheEnd.seen = yield mbd.Proposal(motion, "again", 20)


def test_a_strategy_of_ones_own():
    """It proposes, sees the outcome, and is in the statistics; each attempt says how often its cost was found."""
    problem, *_ = rest_to_rest()
    solution = mbd.optimize(problem, search=[FirstGuesses(), FromTheEnd()])
    assert solution.cost == pytest.approx(12, rel=1e-9)
    assert FromTheEnd.seen.is_solution and FromTheEnd.seen.strategy == "from the end"
    assert [(start.description, start.found) for start in solution.statistics.starts] == [
        ("kinematic", 2),
        ("again", 2),
    ]


def _strategy(name, proposals=None):
    """A strategy that proposes what is given."""
    attributes = {"applies": lambda self, trials: True, "proposals": lambda self, trials: proposals}
    return type("Own", (mbd.Strategy,), attributes | ({"name": name} if name else {}))()


def test_what_is_no_proposal():
    """A guess is made by the package, and iterations are counted from zero."""
    for arguments, text in (
        ({"guess": {}, "iterations": 3}, "must be a Guess"),
        ({"iterations": -1}, "not be negative"),
    ):
        with pytest.raises(mbd.ModelError, match=text):
            mbd.Proposal(**({"guess": Guess((), np.zeros(0), "own"), "description": "own"} | arguments))


def test_what_is_no_list_of_strategies():
    """Each error says what to give."""
    problem, *_ = rest_to_rest()
    for search, text in (
        (3, "takes a sequence of strategies, got 3"),
        ([], "is empty"),
        (["first"], "takes strategies, got 'first'; give a Strategy"),
        ([FirstGuesses], r"give FirstGuesses\(\)"),
        ([None], "takes strategies, got None; give a Strategy"),
        ([_strategy(None)], "has no name"),
        ([_strategy("listed", [])], r"must yield Proposals, got \[\]"),
        ([_strategy("nothing", (None for _ in range(1)))], "must yield Proposals, got None"),
    ):
        with pytest.raises(mbd.ModelError, match=text):
            mbd.optimize(problem, search=search)


@pytest.mark.parametrize("strategy", mbd.STRATEGIES[1:])
def test_each_strategy_alone(strategy):
    """It solves a problem that is easy, or says that it proposes nothing."""
    problem, *_ = rest_to_rest(1.0, (0.5, 1.0), lower=-8, upper=8)
    try:
        assert mbd.optimize(problem, search=[strategy]).cost == pytest.approx(12, rel=1e-6)
    except mbd.OptimizationError as error:
        assert f"nothing was tried: no strategy of search= proposes a solve ({strategy.name})" in str(error)


def test_names_are_told_apart():
    """Each strategy has a name of its own, and is printed as what it is."""
    names = [strategy.name for strategy in mbd.STRATEGIES]
    assert len(set(names)) == len(names) and repr(mbd.STRATEGIES[0]) == "FirstGuesses()"


def brachiation():
    """From bar to bar by a motor in the elbow: the least known effort, 0.056, swings below the bar for 2.5 s."""
    u = mbd.Input("u", lower=-20, upper=20)
    a = mbd.Body("first", 1.0, 1 / 48, pose=(-0.15, -0.2, np.arctan2(-0.4, -0.3)))
    b = mbd.Body("second", 1.0, 1 / 48, pose=(-0.45, -0.2, np.arctan2(0.4, -0.3)))
    joints = [
        mbd.Revolute("hold", mbd.ground.at(0, 0), a.at(-0.25, 0)),
        mbd.Revolute("elbow", a.at(0.25, 0), b.at(-0.25, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Torque("motor", b, u, opposite=a)]
    mechanism, hand = mbd.Mechanism([a, b], joints, forces=forces, inputs=[u]), b.at(0.25, 0)
    rest = [a.omega == 0, b.omega == 0]
    first = [a.phi == np.arctan2(-0.4, -0.3), b.phi == np.arctan2(0.4, -0.3), *rest]
    last = [hand.x == 0.6, hand.y == 0, *rest]
    return mbd.OptimalControlProblem(mechanism, duration=(0.3, 3), initial=first, final=last, running_cost=u**2)


@pytest.mark.slow
def test_a_free_motion_leads_to_a_far_cheaper_swing():
    """The usual guesses lead to costs above 6."""
    assert mbd.optimize(brachiation(), search=mbd.STRATEGIES[:1]).cost > 6
    solution = mbd.optimize(brachiation())
    assert solution.cost < 0.06 and solution.verify().final_error < 1e-2
    assert mbd.optimize(brachiation(), starts=8).cost < 3


@pytest.mark.slow
def test_a_swing_is_pumped_in_the_least_number_of_swings():
    """To 1.2 rad in 8.9 s at least, as is known; the duration may be from 1 to 30 s."""
    legs = mbd.Input("f", lower=-500, upper=2500)
    rope = mbd.Body("rope", 0.0, 0.0, pose=(0, 0, -np.pi / 2 + 0.2))
    child = mbd.Body("child", 60.0, 0.0, pose=(2.25 * np.sin(0.2), -2.25 * np.cos(0.2), -np.pi / 2 + 0.2))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0, 0), rope.at(0, 0))
    slide = mbd.Translational("slide", rope.at(0, 0), child.at(0, 0))
    angle, r = rope.phi + np.pi / 2, slide.displacement
    forces = [mbd.Gravity(), mbd.GeneralizedForce("legs", [(r, -legs)])]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([rope, child], [pivot, slide], forces=forces, inputs=[legs]),
        duration=(1, 30),
        initial=[angle == 0.2, rope.omega == 0, r == 2.5, slide.speed == 0],
        path=[mbd.bounded(2.0, r, 2.5), mbd.bounded(-1.5, slide.speed, 1.5)],
        final=[angle == 1.2, rope.omega == 0],
        terminal_cost=mbd.t,
    )
    assert 8.85 < mbd.optimize(problem).duration < 9.0


@pytest.mark.slow
def test_a_motor_that_is_too_weak_to_lift_swings():
    """A rod swings up in 6 s by 2 N m, where 4.9 N m hold it out straight: as a transcription of its own finds it."""
    tau = mbd.Input("tau", lower=-2, upper=2)
    rod = mbd.Body("rod", 1.0, 1 / 12, pose=(0, -0.5, -np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    forces = [mbd.Gravity(), mbd.Torque("motor", rod, tau)]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([rod], [pin], forces=forces, inputs=[tau]),
        duration=6.0,
        initial=[rod.phi == -np.pi / 2, rod.omega == 0],
        final=[rod.phi == np.pi / 2, rod.omega == 0],
        running_cost=tau**2,
    )
    assert mbd.optimize(problem, search=mbd.STRATEGIES[:1]).cost == pytest.approx(3.7406, rel=1e-3)
    best = mbd.optimize(problem)
    assert best.cost == pytest.approx(_least_effort_of_a_rod(), rel=5e-4) and len(best.statistics.starts) > 2


def _least_effort_of_a_rod(count=400, duration=6.0):
    """Multiple shooting with even torques by Runge and Kutta, from angles that swing three times."""
    opti, h = ca.Opti(), duration / count
    state, torque = opti.variable(2, count + 1), opti.variable(1, count)

    def rates(x, u):
        return ca.vertcat(x[1], 3 * (u - 9.81 / 2 * ca.cos(x[0])))

    for k in range(count):
        x, u = state[:, k], torque[k]
        one = rates(x, u)
        two = rates(x + h / 2 * one, u)
        three = rates(x + h / 2 * two, u)
        four = rates(x + h * three, u)
        opti.subject_to(state[:, k + 1] == x + h / 6 * (one + 2 * two + 2 * three + four))
    opti.subject_to(opti.bounded(-2, torque, 2))
    opti.subject_to(state[:, 0] == [-np.pi / 2, 0])
    opti.subject_to(state[:, count] == [np.pi / 2, 0])
    angles = [-np.pi / 2, -2, -0.8, -2.8, 0, np.pi / 2]
    opti.set_initial(state[0, :], np.interp(np.linspace(0, 1, count + 1), np.linspace(0, 1, len(angles)), angles))
    opti.minimize(ca.sumsqr(torque) * h)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    return opti.solve().value(opti.f)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [-1.2, -1.5])
def test_least_time_on_a_steered_blade_is_that_of_the_cycloid(angle):
    """From the origin to (10, -5) m: r (a - sin a) = 10, r (1 - cos a) = 5, in a sqrt(r / g)."""
    turn = mbd.Input("turn", lower=-20, upper=20)
    sledge = mbd.Body("sledge", 1.0, 1.0, pose=(0, 0, angle))
    forces = [mbd.Gravity(), mbd.Torque("steer", sledge, turn)]
    mechanism = mbd.Mechanism([sledge], [mbd.KnifeEdge("blade", sledge.at(0, 0))], forces=forces, inputs=[turn])
    start = [sledge.x == 0, sledge.y == 0, sledge.vx == 0, sledge.vy == 0]
    end = [sledge.x == 10, sledge.y == -5]
    problem = mbd.OptimalControlProblem(mechanism, (0.5, 5), start, end, terminal_cost=mbd.t)
    assert 1.801295 * (1 - 1e-4) < mbd.optimize(problem).duration < 1.801295 * 1.002
