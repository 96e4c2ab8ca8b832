"""What a wrong problem gets when it is made: an error that names the culprit."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def good():
    """A problem, its input and its body."""
    return rest_to_rest()


def refuses(call, *words, kind=mbd.MechanismError):
    """The call raises an error of the package that contains every word."""
    with pytest.raises(kind) as caught:
        call()
    text = str(caught.value).lower()
    assert all(word.lower() in text for word in words), caught.value


def test_the_mechanism_must_be_one():
    """Not None, not a body, not nothing."""
    for wrong in (None, "linkage", 3):
        refuses(lambda wrong=wrong: mbd.OptimalControlProblem(wrong, 1.0), "Mechanism", kind=mbd.ModelError)


@pytest.mark.parametrize(
    "wrong",
    [0, -1, np.nan, np.inf, "1", None, (1, 2, 3), (0, 0), (2, 1), (np.nan, 1), (0, np.inf), (-1, 2), {}, (), mbd.t],
)
def test_a_duration_is_positive_or_a_pair_in_order(good, wrong):
    """Numbers only, finite, the lower one first."""
    refuses(lambda: good[0].replace(duration=wrong), "duration", kind=mbd.ModelError)


@pytest.mark.parametrize("quantity", ["position", "velocity", "state"])
@pytest.mark.parametrize("end", ["initial", "final"])
def test_a_state_beyond_a_limit(end, quantity):
    """Named at once, by its amount, as for relations; just within, the problem is solved."""
    u, z = mbd.Input("u"), mbd.StateVariable("z", lower=-3, upper=3)
    block, mechanism = guided_block(1.0, u, states={z: u})
    limited = {"position": block.x, "velocity": block.vx, "state": z}[quantity]
    path = [] if quantity == "state" else [mbd.bounded(-3, limited, 3)]
    problem = mbd.OptimalControlProblem(mechanism, 1.0, path=path, running_cost=u**2)
    for value, others in ((3.25, True), (2.75, False)):
        values = {block.x: 0.0, block.vx: 0.0, z: 0.0} | {limited: value}
        state = mbd.assemble(mechanism, [key == number for key, number in values.items()])
        if others:
            refuses(lambda state=state: mbd.optimize(problem.replace(**{end: state}), intervals=4), end, "<= 3", "0.25")
        else:
            mbd.optimize(problem.replace(**{end: state}), intervals=4)


@pytest.mark.parametrize("argument", ["initial", "final", "path", "boundary"])
def test_conditions_are_relations(good, argument):
    """What is no list of relations is refused in every argument that takes conditions."""
    problem, _, block = good
    for wrong in (None, 3, "x", block.x, [block.x], [True], [False], [None], {block.x: 0}):
        refuses(lambda w=wrong: problem.replace(**{argument: w}), "relation", kind=mbd.ConditionError)
    refuses(lambda: problem.replace(**{argument: [block.x != 0]}), "!=", kind=mbd.ConditionError)
    for value in (np.nan, np.inf):
        refuses(lambda v=value: problem.replace(**{argument: [block.x == v]}), "finite", kind=mbd.ConditionError)


@pytest.mark.parametrize("argument", ["initial", "final", "path", "boundary"])
def test_unknown_symbols_in_conditions(good, argument):
    """Parameters, inputs and bodies that the mechanism does not have are named."""
    problem, _, block = good
    parameter, force, body = mbd.Parameter("stranger", 1.0), mbd.Input("gust"), mbd.Body("other", mass=1, inertia=1)
    for left, name in ((parameter, "stranger"), (force, "gust"), (body.x, "other.x"), (force.rate, "gust")):
        refuses(lambda e=left: problem.replace(**{argument: [block.x == e]}), argument, name, kind=mbd.ExpressionError)
    if argument != "boundary":
        for placeholder in (mbd.at_end(block.x), mbd.at_start(block.x), mbd.integral(block.x)):
            refuses(
                lambda p=placeholder: problem.replace(**{argument: [p == 1]}),
                "belongs in boundary",
                kind=mbd.ExpressionError,
            )
    else:
        refuses(lambda: problem.replace(boundary=[mbd.at_end(body.x) == 1]), "other.x", kind=mbd.ExpressionError)


@pytest.mark.parametrize("argument", ["running_cost", "terminal_cost"])
def test_costs_are_scalars_of_the_model(good, argument):
    """One finite number or expression, of symbols that the mechanism has."""
    problem, _, block = good
    for wrong in (None, "x", [1, 2], {}, np.nan, np.inf, np.array([1.0, 2.0]), mbd.vertcat(block.x, block.y)):
        refuses(lambda w=wrong: problem.replace(**{argument: w}), argument, kind=mbd.ModelError)
    stranger = mbd.Parameter("stranger", 1.0)
    refuses(lambda: problem.replace(**{argument: stranger}), argument, "stranger", kind=mbd.ExpressionError)
    if argument == "running_cost":
        refuses(lambda: problem.replace(running_cost=mbd.integral(block.x)), "belongs", kind=mbd.ExpressionError)
        refuses(lambda: problem.replace(running_cost=mbd.at_end(block.x)), "belongs", kind=mbd.ExpressionError)
    else:
        refuses(lambda: problem.replace(terminal_cost=mbd.integral(stranger)), "stranger", kind=mbd.ExpressionError)


@pytest.mark.parametrize("argument", ["running_cost", "terminal_cost"])
def test_a_relation_is_no_cost(good, argument):
    """``x <= 3`` is a condition; as a cost it would be 0 or 1."""
    problem, _, block = good
    refuses(lambda: problem.replace(**{argument: block.x <= 3}), argument, "relation")


def test_free_parameters_are_a_list_of_parameters(good):
    """No number, no input, none twice, and the value within the limits."""
    problem, u, block = good
    k = mbd.Parameter("k", 1.0)
    for wrong in (3, "x", None, k, [3], [u], [block.x]):
        refuses(lambda w=wrong: problem.replace(free_parameters=w), "free_parameters", kind=mbd.ModelError)
    refuses(lambda: problem.replace(free_parameters=[k, k]), "k", "twice", kind=mbd.ModelError)
    refuses(lambda: mbd.Parameter("k", 3.0, lower=4, upper=5), "k", "3")
    refuses(lambda: mbd.Parameter("k", 3.0, lower=5, upper=4), "k", "lower")


def test_there_must_be_something_to_optimise(good):
    """Neither inputs nor free parameters nor free times, from a start that is given whole."""
    problem = good[0]
    still = problem.mechanism.replace(forces=[], inputs=[])
    refuses(lambda: problem.replace(mechanism=still, running_cost=0), "nothing to optimise", kind=mbd.ModelError)
    problem.replace(mechanism=still, running_cost=0, duration=(0.5, 1.0))
    problem.replace(mechanism=still, running_cost=0, initial=())


def test_conditions_that_contradict_each_other(good):
    """At the start, at the end, along the path, at waypoints, between both ends."""
    problem, u, block = good
    both = [block.x == 0, block.x == 1]
    for argument in ("initial", "final"):
        refuses(lambda a=argument: problem.replace(**{a: both}), argument, "contradict", kind=mbd.ConditionError)
    for path in (both, [block.x <= 1, block.x >= 2], [u <= 1, 2 <= u], [block.x == mbd.t, block.x == mbd.t + 1]):
        refuses(lambda p=path: problem.replace(path=p), "path", "contradict", kind=mbd.ConditionError)
    f = crank_rocker()
    far = [f.crank.phi == 0.5, f.rocker.phi == 1.0]
    refuses(lambda: half_turn(f, initial=far), "initial", "contradict", "rocker.phi == 1", kind=mbd.ConditionError)


def test_conditions_at_an_end_that_contradict_the_path(good):
    """A start above what the path allows cannot be."""
    problem, _, block = good
    for path, words in (
        ([block.x <= -1], ("initial", "path", "block.x <= -1")),
        ([block.x <= 0.5], ("final", "path", "block.x <= 0.5")),
        ([block.vx >= 0.5], ("initial", "path", "block.vx")),
    ):
        refuses(lambda p=path: problem.replace(path=p), *words, kind=mbd.ConditionError)


def test_path_limits_against_the_limits_of_an_input():
    """A path condition above the input's own limit leaves nothing."""
    problem, u, _ = rest_to_rest(lower=-1, upper=1)
    refuses(lambda: problem.replace(path=[u >= 2]), "path", "u <= 1", kind=mbd.ConditionError)


@pytest.mark.parametrize("argument", ["initial", "final"])
def test_conditions_that_the_constraints_already_fix(good, argument):
    """The guide fixes y, phi and their rates."""
    problem, _, block = good
    for condition in (block.y == 0, block.y == 1, block.phi == 0, block.vy == 0, block.omega == 0):
        refuses(
            lambda c=condition: problem.replace(**{argument: [c]}),
            argument,
            "decided by the constraints",
            kind=mbd.ConditionError,
        )


def test_path_equalities_that_the_constraints_already_fix(good):
    """The guide fixes y, at whatever value is asked."""
    problem, _, block = good
    for condition in (block.y == 1, block.y == 0):
        refuses(lambda c=condition: problem.replace(path=[c]), "path", "constraints", kind=mbd.ConditionError)


def test_limits_the_wrong_way_round(good):
    """Of two-sided conditions, of inputs and of states."""
    _, u, block = good
    refuses(lambda: mbd.bounded(2, block.x, 1), "lower", "upper")
    refuses(lambda: mbd.Input("v", lower=1, upper=-1), "v", "lower")
    refuses(lambda: mbd.StateVariable("z", lower=1, upper=-1), "z", "lower")
    refuses(lambda: good[0].replace(path=[mbd.bounded(mbd.t, u, mbd.t - 1)]), "contradict", kind=mbd.ConditionError)


def test_replace_names_what_it_does_not_know(good):
    """A misspelt argument is listed with those that there are."""
    refuses(lambda: good[0].replace(mesh=3), "mesh", "duration", kind=mbd.ModelError)


def test_a_state_of_another_mechanism(good):
    """States belong to their mechanism, whatever the number of coordinates."""
    problem = good[0]
    linkage = mbd.assemble(crank_rocker().mechanism)
    twin = mbd.assemble(guided_block(1.0, mbd.Input("w"))[1])
    for argument in ("initial", "final"):
        refuses(lambda a=argument: problem.replace(**{a: linkage}), "state belongs to", kind=mbd.ModelError)
    for argument in ("initial", "final"):
        refuses(lambda a=argument: problem.replace(**{a: twin}), "state belongs to", kind=mbd.ModelError)
    # a mechanism with other forces on the same bodies has the same coordinates
    sibling = mbd.assemble(problem.mechanism.replace(forces=[], inputs=[]))
    problem.replace(initial=sibling)


def test_contradictions_between_both_ends(good):
    """Boundary conditions that leave nothing between them."""
    problem, _, block = good
    ends = [mbd.at_end(block.x) == 1, mbd.at_end(block.x) == 2]
    refuses(lambda: problem.replace(boundary=ends), "contradict", "at_end(block.x) == 2", kind=mbd.ConditionError)
