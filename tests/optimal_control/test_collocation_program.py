"""A problem that is stated again in one process: what was compiled for the first one, with symbols of its own."""

from types import SimpleNamespace

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model import contents
from mbdcasadi.model.cache import Cache
from mbdcasadi.optimal_control.program import collocation_program
from mbdcasadi.optimal_control.transcription.gauss_legendre import GaussLegendre


def at_rest(block):
    """Conditions at the start."""
    return [block.x == 0, block.vx == 0]


def stated(
    mass=2.0, lower=-50.0, upper=50.0, end=1.0, track=1.2, duration=1.0, weight=1.0, stiffness=3.0, initial=at_rest
):
    """A block on a spring is pushed from rest to rest, on a bar that follows."""
    force, k = mbd.Input("force", lower=lower, upper=upper), mbd.Parameter("k", stiffness)
    block = mbd.Body("block", mass=mass, inertia=0.1)
    bar = mbd.Body("bar", mass=0.5, inertia=0.01, pose=(0, -0.5, -np.pi / 2))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    pin = mbd.Revolute("pin", block.at(0, 0), bar.at(-0.5, 0))
    push = mbd.Force("push", block.at(0, 0), (force - k * block.x, 0))
    system = mbd.Mechanism([block, bar], [guide, pin], forces=[mbd.Gravity(), push], inputs=[force], parameters=[k])
    problem = mbd.OptimalControlProblem(
        system,
        duration=duration,
        initial=[*initial(block), bar.phi == -np.pi / 2, bar.omega == 0],
        final=[block.x == end, block.vx == 0],
        path=[block.x <= track],
        running_cost=weight * force**2,
    )
    return SimpleNamespace(problem=problem, block=block, bar=bar, force=force, k=k, pin=pin)


def forget(monkeypatch):
    """As in a process that has solved nothing yet."""
    monkeypatch.setattr(contents, "_VALUES", Cache(contents.RECENT))
    monkeypatch.setattr(collocation_program, "_COMPILED", Cache(1))


@pytest.fixture
def nothing_kept(monkeypatch):
    """The same for a test."""
    forget(monkeypatch)


def solved(case, **settings):
    """Solution on a coarse mesh."""
    return mbd.optimize(case.problem, intervals=6, **settings)


def test_the_same_solution_in_symbols_of_its_own(nothing_kept):
    """To the last digit, by the same functions; the symbols of the first statement are foreign to the second."""
    first, second = stated(), stated()
    one, other = solved(first), solved(second)
    assert other.program.nlp is one.program.nlp and other.program is not one.program
    assert other.cost == one.cost and other.statistics.iterations == one.statistics.iterations
    quantities = [(case.bar.phi, case.force, case.pin.multipliers[0]) for case in (first, second)]
    for x, y in zip(*quantities, strict=True):
        assert np.array_equal(one.trajectory[x], other.trajectory[y])
        assert np.array_equal(one.trajectory.at([0.123])[x], other.trajectory.at([0.123])[y])
        with pytest.raises(mbd.ExpressionError, match="which the mechanism does not have"):
            other.trajectory[x]
    assert other.problem is second.problem and other.trajectory.mechanism is second.problem.mechanism
    assert set(other.inputs) == {second.force}
    assert [np.sum(x) for x in other.costates.values()] == [np.sum(x) for x in one.costates.values()]
    assert [(row.label, row.size) for row in other.program.rows] == [(row.label, row.size) for row in one.program.rows]


@pytest.mark.parametrize(
    "change",
    [
        {"mass": 2.5},
        {"upper": 8.0},
        {"lower": -8.0},
        {"end": 0.8},
        {"track": 1.0},
        {"duration": 1.1},
        {"weight": 2.0},
        {"stiffness": 4.0},
        {"initial": lambda b: [b.x == 0.1, b.vx == 0]},
        {"initial": lambda b: [b.x == 0, b.vx == 0.1]},
    ],
    ids=lambda change: next(iter(change)),
)
def test_another_problem_shares_nothing(nothing_kept, monkeypatch, change):
    """Its cost is the one that it has in a process of its own, and no other."""
    base = solved(stated())
    changed = solved(stated(**change))
    assert changed.program.nlp is not base.program.nlp
    forget(monkeypatch)
    alone = solved(stated(**change))
    assert alone.program.nlp is not changed.program.nlp and changed.cost == alone.cost
    assert np.array_equal(changed.trajectory.q, alone.trajectory.q)


@pytest.mark.slow
def test_starts_and_parameters_of_a_solve_are_its_own(nothing_kept):
    """A start in place of the stated one, and values of parameters, against problems that state them."""
    solved(stated())
    again = stated()
    hanging = [again.bar.phi == -np.pi / 2, again.bar.omega == 0]
    moved = solved(again, initial=[again.block.x == 0.1, again.block.vx == 0, *hanging])
    assert moved.cost == pytest.approx(solved(stated(initial=lambda b: [b.x == 0.1, b.vx == 0])).cost, rel=1e-9)
    third = stated()
    stiffer = mbd.optimize(third.problem, intervals=6, parameters={third.k: 5.0})
    assert stiffer.cost == pytest.approx(solved(stated(stiffness=5.0)).cost, rel=1e-9)
    assert solved(stated()).cost == pytest.approx(solved(stated()).cost, rel=1e-12)


FACTOR = 1.0


class Weighted(GaussLegendre):
    """Weights in the cost that a global changes."""

    def __init__(self, degree):
        super().__init__(degree)
        self.quadrature = FACTOR * self.quadrature


def test_a_transcription_of_the_users_own_is_not_shared(nothing_kept, monkeypatch):
    """It may read globals that have changed since."""
    light = solved(stated(), transcription=Weighted)
    monkeypatch.setitem(globals(), "FACTOR", 2.0)
    assert solved(stated(), transcription=Weighted).cost == pytest.approx(2 * light.cost, rel=1e-9)


def test_refusals_and_warnings_come_again(nothing_kept):
    """A contradiction, and a mesh that is too coarse."""
    for _ in range(2):
        with pytest.raises(mbd.ConditionError, match="contradict"):
            stated(end=2.0)
    for _ in range(2):
        with pytest.warns(mbd.MechanismWarning, match="too coarse"):
            mbd.optimize(stated(duration=8.0).problem, intervals=3)


def test_first_states_are_not_the_same_arrays(nothing_kept):
    """Who changes one changes it alone."""
    one, other = solved(stated()), solved(stated())
    one.state(0).q[:] = 7.0
    one.trajectory.q[:] = 7.0
    assert np.max(np.abs(solved(stated()).trajectory.q - other.trajectory.q)) == 0
