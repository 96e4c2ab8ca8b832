"""Soft limits: conditions that may be passed at a price."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def least_effort(limit, time):
    """Rest to rest over 1 in 1 s at the least integral of u² and of a price on max(v - limit, 0), by Pontryagin.

    Half of the symmetric motion: u falls to zero at 1/2, more slowly from the time on at which the limit is reached.
    Returned are the price of a second above the limit, the whole cost, what the limit costs, and the peak above it.
    """
    rest = 0.5 - time
    ways = [[rest * time, time**2 / 2], [rest * time**2 / 2 + rest**3 / 3, time**3 / 3]]
    above, below = np.linalg.solve(ways, [limit, 0.5 - limit * rest])
    at_limit, weight = above * rest, 2 * (below - above)
    effort = (((at_limit + below * time) ** 3 - at_limit**3) / below + above**2 * rest**3) / 3
    price = 2 * weight * above * rest**3 / 3
    return weight, 2 * effort + price, price, above * rest**2 / 2


def test_above_the_costate_it_is_the_hard_limit():
    """v rises by parabolas of 1/4 s; the costate is 4 v / t² = 76.8 all along."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    hard = mbd.optimize(problem.replace(path=[block.vx <= 1.2]), intervals=20)
    soft = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= 1.2, weight=100)]), intervals=20)
    assert hard.cost == pytest.approx(15.36, rel=1e-6) and soft.cost == pytest.approx(15.36, rel=1e-6)
    np.testing.assert_allclose(soft.trajectory[block.vx], hard.trajectory[block.vx], atol=1e-6)
    assert hard.costates["block.vx <= 1.2"][10] == pytest.approx(76.8, rel=1e-2)
    (use,) = soft.soft_limits
    assert repr(use) == "block.vx <= 1.2: holds" and use.cost == 0


def test_simulate_takes_the_inputs_that_act():
    """A solution stands for the inputs of the mechanism, and not for the amounts by which limits are passed."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    solution = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= 1.2, weight=100)]), intervals=10)
    mechanism = problem.given["mechanism"]
    run = mbd.simulate(mechanism, [0, 1], inputs=solution, initial=[block.x == 0, block.vx == 0])
    assert [run[block.x][-1], run[block.vx][-1]] == pytest.approx([1, 0], abs=1e-6)
    with pytest.raises(mbd.ModelError, match="which is not in the mechanism"):
        mbd.simulate(mechanism.replace(inputs=[mbd.Input("other")], forces=[]), [0, 1], inputs=solution)


@pytest.mark.parametrize("weight", [1e4, 1e6])
def test_a_large_weight_does_not_spoil_the_rest(weight):
    """Along the path, at a waypoint and at the end: the same motion and cost as with conditions that hold."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    along, there, end = (mbd.soft(c, weight=weight) for c in (block.vx <= 1.5, block.x == 0.45, block.x == 1))
    soft = problem.replace(path=[along], waypoints=[mbd.Waypoint(0.5, [there])], final=[block.vx == 0, end])
    hard = problem.replace(path=[block.vx <= 1.5], waypoints=[mbd.Waypoint(0.5, [block.x == 0.45])])
    assert mbd.optimize(soft, intervals=10).cost == pytest.approx(mbd.optimize(hard, intervals=10).cost, rel=1e-6)


@pytest.mark.parametrize(("limit", "time"), [(1.2, 0.275), (0.8, 0.15), (0.8, 0.125)])
def test_below_the_costate_it_is_passed(limit, time):
    """By the amount at which the price is worth it, at speeds below the mean too, which no motion can keep."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    weight, cost, price, most = least_effort(limit, time)
    solution = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= limit, weight=weight)]), intervals=40)
    assert solution.cost == pytest.approx(cost, rel=1e-6)
    (use,) = solution.soft_limits
    assert use.amount == pytest.approx(most, rel=1e-6) and use.time == pytest.approx(0.5)
    assert use.cost == pytest.approx(price, rel=1e-5)
    ((begin, end),) = use.spans
    assert begin == pytest.approx(time, abs=2e-3) and end == pytest.approx(1 - time, abs=2e-3)
    assert repr(use) == (
        f"block.vx <= {limit:g}: passed by up to {most:.3g} at {begin:.4g} … {end:.4g} s, at a cost of {use.cost:.4g}"
    )


def test_a_start_beyond_it():
    """A state that a hard limit would refuse slows down at a price; an instant has no time for it."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    soft = problem.replace(path=[mbd.soft(block.vx <= 1.2, weight=100)], initial=[block.x == 0, block.vx == 2])
    start = mbd.assemble(problem.mechanism, [block.x == 0, block.vx == 2])
    solution, same = (mbd.optimize(x, intervals=20) for x in (soft, soft.replace(initial=start)))
    assert same.cost == pytest.approx(solution.cost, rel=1e-9)
    assert solution.soft_limits[0].amount == pytest.approx(0.8, rel=1e-6) and solution.soft_limits[0].time == 0
    with pytest.raises(mbd.ModelError, match="no duration, and so no path="):
        mbd.Phase("touch", problem.mechanism, 0, path=[mbd.soft(block.vx <= 1, weight=1)])


@pytest.mark.slow
def test_what_no_motion_can_keep():
    """The hard limit is refused, the soft one has a solution at any weight."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    with pytest.raises(mbd.OptimizationError, match="infeasible"):
        mbd.optimize(problem.replace(path=[block.vx <= 0.8]), intervals=10)
    solution = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= 0.8, weight=1e4)]), intervals=10)
    assert solution.soft_limits[0].amount >= 0.2


def test_a_small_excess_is_reported():
    """Of half a thousandth of the limit."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    weight, _cost, _price, most = least_effort(1.2, 0.25012)
    solution = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= 1.2, weight=weight)]), intervals=20)
    (use,) = solution.soft_limits
    assert use.spans and use.amount == pytest.approx(most, rel=0.1) and most < 6e-4


def test_sides_equalities_and_parameters():
    """Each side of a two-sided limit, and the magnitude of what an equality misses; a parameter as the weight."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    price = mbd.Parameter("price", 0.5)
    cart = problem.mechanism.replace(parameters=[price])
    path = [mbd.soft([mbd.bounded(-4, u, 5), block.vx == 1], weight=price)]
    solution = mbd.optimize(problem.replace(mechanism=cart, path=path), intervals=20)
    parts = mbd.positive_part(-4 - u) + mbd.positive_part(u - 5) + mbd.absolute(block.vx - 1)
    same = mbd.optimize(problem.replace(running_cost=u**2 + 0.5 * parts), intervals=20)
    assert solution.cost == pytest.approx(same.cost, rel=1e-6)
    uses = {use.label: use for use in solution.soft_limits}
    assert set(uses) == {"-4 <= u", "u <= 5", "block.vx == 1"}
    assert uses["-4 <= u"].amount == pytest.approx(2, abs=0.1) and uses["u <= 5"].amount == pytest.approx(1, abs=0.1)
    assert solution.cost == pytest.approx(
        solution.phases[0].integral(u**2) + sum(use.cost for use in solution.soft_limits), rel=1e-6
    )
    dearer = mbd.optimize(problem.replace(mechanism=cart, path=path), intervals=20, parameters={price: 5.0})
    assert dearer.soft_limits[0].cost > solution.soft_limits[0].cost


def test_at_a_waypoint():
    """Off the middle by d costs 192 d², and the rest of the way to the target its price."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    there = mbd.Waypoint(0.5, [mbd.soft(block.x == 0.7, weight=5)])
    solution = mbd.optimize(problem.replace(waypoints=[there]).replace(path=[block.vx <= 9]), intervals=6)
    off = 5 / 384
    assert solution.cost == pytest.approx(12 + 192 * off**2 + 5 * (0.2 - off), rel=1e-6)
    (use,) = solution.soft_limits
    assert use.label == "waypoint 1: block.x == 0.7" and use.spans == ((0.5, 0.5),)
    assert use.amount == pytest.approx(0.2 - off, rel=1e-6) and use.cost == pytest.approx(5 * (0.2 - off), rel=1e-6)


@pytest.mark.parametrize(("weight", "x"), [(10.0, 10 / 24), (100.0, 1.0)])
def test_at_the_end(weight, x):
    """Rest after x in 1 s costs 12 x², and its price what is missing to 1."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    nearly = problem.replace(final=[block.vx == 0, mbd.soft(block.x == 1, weight=weight)])
    for same in (nearly, nearly.replace(duration=1.0, running_cost=problem.running_cost)):
        solution = mbd.optimize(same, intervals=6)
        assert solution.cost == pytest.approx(12 * x**2 + weight * (1 - x), rel=1e-6)
        (use,) = solution.soft_limits
        assert use.label == "final: block.x == 1" and use.amount == pytest.approx(1 - x, rel=1e-6)
        assert use.cost == pytest.approx(weight * (1 - x), rel=1e-6)
    assert not nearly.replace(final=[block.vx == 0]).free_parameters


def test_ends_of_phases():
    """The first one half of the way, at a price; a state of no duration too."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    half = {"mechanism": problem.mechanism, "duration": 0.5, "running_cost": u**2}
    there = mbd.soft(block.x == 0.7, weight=5)
    start, end = [block.x == 0, block.vx == 0], [block.x == 1, block.vx == 0]
    other, off = mbd.Phase("in", **half, final=end), 5 / 384
    one, touch = mbd.Phase("out", **half, initial=start), mbd.Phase("touch", problem.mechanism, 0, final=there)
    for name, first in (("out", [mbd.Phase("out", **half, initial=start, final=there)]), ("touch", [one, touch])):
        solution = mbd.optimize(mbd.OptimalControlProblem(phases=[*first, other]), intervals=6)
        assert solution.cost == pytest.approx(12 + 192 * off**2 + 5 * (0.2 - off), rel=1e-6)
        (use,) = solution.soft_limits
        assert use.label == f"final: block.x == 0.7 in phase '{name}'" and use.time == 0.5
        assert use.amount == pytest.approx(0.2 - off, rel=1e-6)


def test_phases_name_theirs(tmp_path):
    """Two halves of the way, of which one has the limit; read again from a file."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    start, half = {"initial": [block.x == 0, block.vx == 0]}, {"duration": 0.5, "running_cost": u**2}
    one = mbd.Phase("out", problem.mechanism, **start, **half, path=[mbd.soft(block.vx <= 1, weight=4)])
    other = mbd.Phase("in", problem.mechanism, final=[block.x == 1, block.vx == 0], **half)
    both = mbd.OptimalControlProblem(phases=[one, other])
    solution = mbd.optimize(both, intervals=10)
    (use,) = solution.soft_limits
    assert use.label == "block.vx <= 1 in phase 'out'" and 0.1 < use.amount < 0.5 and use.spans[-1][1] <= 0.5
    solution.save(tmp_path / "solution.npz")
    assert mbd.read_solution(tmp_path / "solution.npz", both).soft_limits == [use]


def test_replaced_arguments_keep_what_they_do_not_concern():
    """Conditions of the path take their soft limits with them, parts of the cost theirs."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    soft = problem.replace(path=[block.vx <= 9, mbd.soft(block.vx <= 1.2, weight=10)])
    longer = soft.replace(duration=1.1)
    assert longer.mechanism is soft.mechanism and longer.phases[0].soft_limits
    dear = mbd.optimize(soft.replace(running_cost=2 * u**2), intervals=20)
    cheap = mbd.optimize(problem.replace(path=[mbd.soft(block.vx <= 1.2, weight=5)]), intervals=20)
    assert dear.cost == pytest.approx(2 * cheap.cost, rel=1e-6) and len(dear.soft_limits) == 1
    plain = soft.replace(path=())
    assert plain.mechanism is problem.mechanism and not mbd.optimize(plain, intervals=4).soft_limits
    spent = problem.replace(running_cost=mbd.absolute(u)).replace(path=[mbd.bounded(-8, u, 8)])
    assert mbd.optimize(spent, intervals=10).cost == pytest.approx(16 * (0.5 - np.sqrt(0.25 - 1 / 8)), rel=2e-2)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda x, k: mbd.soft(x <= 1, weight=0), mbd.ModelError, "soft: weight must be above 0"),
        (lambda x, k: mbd.soft(x <= 1, weight=np.inf), mbd.ModelError, "soft: weight must be finite"),
        (lambda x, k: mbd.soft(x <= 1, weight=x), mbd.ExpressionError, "soft: weight depends on"),
        (lambda x, k: mbd.soft(x, weight=1), mbd.ConditionError, "is not a relation"),
        (lambda x, k: mbd.soft(k <= 1, weight=1), mbd.ConditionError, "k <= 1 contains nothing that a motion changes"),
        (
            lambda x, k: mbd.Waypoint(1, [mbd.soft(x <= 1, weight=1), x]),
            mbd.ConditionError,
            "condition 2 .* not a relation",
        ),
        (lambda x, k: mbd.soft(mbd.t <= 1, weight=1), mbd.ConditionError, "contains nothing that a motion changes"),
    ],
)
def test_bad_soft_limits(make, error, message):
    """With the quantity that is wrong."""
    _problem, _u, block = rest_to_rest(1.0, 1.0)
    with pytest.raises(error, match=message):
        make(block.x, mbd.Parameter("k", 1.0))


@pytest.mark.parametrize("where", ["initial", "boundary"])
def test_where_it_does_not_belong(where):
    """With the place where it does."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    with pytest.raises(mbd.ConditionError, match=r"soft\(block.x <= 1, weight=2\), which belongs in path="):
        problem.replace(**{where: [mbd.soft(block.x <= 1, weight=2)]})
