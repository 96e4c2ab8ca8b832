"""Expressions in the words of the model."""

import pytest

import mbdcasadi as mbd
from mbdcasadi.model.conditions import read_conditions
from mbdcasadi.model.texts import text_of


@pytest.fixture
def crane():
    """A load that hangs from a car on an inclined rail."""
    car, load = mbd.Body("car", mass=2, inertia=1), mbd.Body("load", mass=1, inertia=0.1, pose=(0, -1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=0.3), car.at(0, 0, angle=0.3))
    return car, load, rail, mbd.Revolute("hang", car.at(0, 0), load.at(0, 1))


def test_reactions_are_named_as_they_were_asked_for(crane):
    """By element, body and component, in sums and products, whatever their sign in the multipliers."""
    car, load, rail, hang = crane
    force, moment, on_rail = hang.reaction_on(load).force, rail.reaction_on(car).torque, rail.reaction_on(car).force
    for expression, text in {
        force[1]: "hang.reaction_on(load).force[1]",
        -force[0]: "-hang.reaction_on(load).force[0]",
        2 * force[0] + load.x: "2*hang.reaction_on(load).force[0] + load.x",
        mbd.norm(force): "norm(hang.reaction_on(load).force)",
        mbd.norm(-force): "norm(hang.reaction_on(load).force)",
        moment**2: "rail.reaction_on(car).torque**2",
        mbd.norm(on_rail): "norm(rail.reaction_on(car).force)",
        mbd.norm(force) * on_rail[1]: "norm(hang.reaction_on(load).force)*rail.reaction_on(car).force[1]",
        rail.reaction_on(car).force_in_joint[1]: "rail.reaction_on(car).force_in_joint[1]",
        hang.impulse_on(load).force[0]: "hang.impulse_on(load).force[0]",
    }.items():
        assert text_of(expression) == text


def test_both_bodies_have_reactions_of_their_own(crane):
    """If both were asked for, each is named where it stands; the length is that of either."""
    car, load, _rail, hang = crane
    here, there = (hang.reaction_on(body).force for body in (car, load))
    assert text_of(here[0]) == "hang.reaction_on(car).force[0]"
    assert text_of(there[0]) == "hang.reaction_on(load).force[0]"
    assert text_of(mbd.norm(there)) in {f"norm(hang.reaction_on({body}).force)" for body in ("car", "load")}


def test_multipliers_are_those_of_an_element(crane):
    """Nobody asked for a reaction."""
    *_, rail, hang = crane
    assert text_of(hang.multipliers[1] + 2) == "hang.multipliers[1] + 2"
    assert text_of(rail.impulses[0]) == "rail.impulses[0]"
    with pytest.raises(mbd.ExpressionError, match=r"'hang.multipliers\[0\]'"):
        mbd.time_derivative(hang.multipliers[0])


def test_relations_and_lengths_that_vanish(crane):
    """Labels of conditions are made of the same texts."""
    _car, load, _rail, hang = crane
    force = hang.reaction_on(load).force
    labels = [c.label for c in read_conditions([mbd.bounded(-5, force[0], 5), mbd.norm(force) == 0])]
    assert labels[:2] == ["-5 <= hang.reaction_on(load).force[0]", "hang.reaction_on(load).force[0] <= 5"]
    assert labels[2].startswith("norm(hang.reaction_on(load).force) == 0, with ") and "lam" not in labels[2]
