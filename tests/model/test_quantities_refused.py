"""What is no quantity, list, text or shape is refused by the element or function that is given it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

T = mbd.t


def _lever():
    lever = mbd.Body("lever", mass=1.0, inertia=0.1, pose=(0.5, 0, 0))
    return lever, mbd.Revolute("hinge", mbd.ground.at(0, 0), lever.at(-0.5, 0))


LEVER, HINGE = _lever()
GAIN = mbd.Parameter("gain", 1.0)
OUTLINE = mbd.CamOutline(lambda angle: 0.05 + 0.006 * mbd.cos(angle))
STIFF = mbd.HuntCrossley(1e5)
MODEL = mbd.Mechanism([LEVER], joints=[HINGE], forces=[mbd.Gravity()])
DRIVEN = MODEL.replace(drivers=[mbd.Driver("drive", HINGE.angle, 0.3 * T)])
MANY = {"none": None, "text": "x", "complex": 1j, "set": {1}, "MX": ca.MX.sym("m"), "array": np.array(1.0)}

#: What is given, and what the message says.
CASES = {
    "one coordinate of a marker": (lambda: LEVER.at(1), "body 'lever': a marker needs two coordinates.*got 1 alone"),
    "a pair as a coordinate": (lambda: LEVER.at((1, 2)), r"a marker needs two coordinates.*\(1, 2\) alone"),
    "a text as a shape": (lambda: mbd.Body("b", 1, 1, shape="disc"), "body 'b': shape must be a Disc.*'disc'"),
    "a number as a shape": (lambda: mbd.Body.from_shape("b", 2.0, mass=1.0), "body 'b': shape must be a Disc.*2.0"),
    "a number as a name": (lambda: mbd.Mechanism([LEVER], name=3), "name= must be a text, got 3"),
    "a number as a step": (lambda: mbd.step(T, 0, None, 1, 1), "step: y0 must be an expression or a finite number"),
    "NaN in a step": (lambda: mbd.step(T, 0, np.nan, 1, 1), "step: y0 must be an .* finite number, got nan"),
    "a text in if_else": (lambda: mbd.if_else(T > 0, "a", 1), "if_else takes a relation and two numbers"),
    "a text as a base": (lambda: mbd.positive_power("a", 2), "positive_power: base must be .* got 'a'"),
    "a list as a kind": (lambda: mbd.spline(T, [0, 1], [0, 1], kind=["linear"]), "spline: kind must be one of"),
    "a text as an argument": (lambda: mbd.spline("t", [0, 1], [0, 1], kind="linear"), "spline: x must be .* got 't'"),
    "a list as a law": (lambda: mbd.rise(1, 1, law=["3-4-5"]), "law must be one of"),
    "an array as a frame": (
        lambda: mbd.Force("f", LEVER.at(0, 0), (1, 0), frame=np.zeros(2)), "force 'f': frame must be one of"
    ),
    "an expression as a direction": (lambda: mbd.Event("e", LEVER.x, direction=LEVER.x), "'e': direction must be"),
    "a force without pairs": (lambda: mbd.GeneralizedForce("g", 3.0), "force 'g': pairs takes a list, got 3.0"),
    "a matrix of pairs": (lambda: mbd.GeneralizedForce("g", ca.DM([1, 2])), "force 'g': pairs takes a list"),
    "a function of time": (lambda: mbd.Driver("d", LEVER.x, lambda t: t), "an expression, .* not a Python function"),
    "no rows": (lambda: mbd.NonholonomicConstraint("n", []), "constraint 'n' is empty"),
    "a relation that is driven": (lambda: mbd.Driver("d", LEVER.x == 1, T), "driver 'd': expression is the relation"),
    "a relation as a gap": (lambda: mbd.EndStop("s", LEVER.x > 0, STIFF), "stop 's': gap is the relation"),
    "no mechanism": (lambda: mbd.shaking_force(None), "shaking_force takes a Mechanism, got None"),
    "the cam of a face": (
        lambda: mbd.CamFlatFollower("c", 1, LEVER.at(0, 0), OUTLINE), "joint 'c': cam must be a marker.*got 1"
    ),
    "a pinion": (lambda: mbd.RackAndPinion("r", LEVER.at(0, 0), 1, 0.1), "joint 'r': pinion must be a marker"),
    "a wheel": (lambda: mbd.Rolling("r", 1, mbd.ground.at(0, 0), 0.1), "joint 'r': wheel must be a marker"),
    "a name of another kind": (lambda: MODEL.body(np.zeros(2)), "there is no body array"),
    "a reaction on an array": (lambda: HINGE.reaction_on(np.zeros(2)), "joint 'hinge' does not act on"),
    "names of outputs": (
        lambda: mbd.linearize(MODEL, mbd.assemble(MODEL), outputs={1: LEVER.phi}),
        "outputs= takes .* texts as names, got the name 1",
    ),
    "an effort without a list": (
        lambda: mbd.inverse_dynamics(MODEL, [0, 1], motion={HINGE.angle: T}, efforts=3), "efforts= takes a list, got 3"
    ),
    "a text that is moved": (
        lambda: mbd.inverse_dynamics(MODEL, [0, 1], motion={"hinge": T}, efforts=[]), "got the key 'hinge'"
    ),
    "a tolerance of zero": (
        lambda: mbd.inverse_dynamics(MODEL, [0, 1], motion={HINGE.angle: T}, tolerance=0), "tolerance must be positive"
    ),
    "progress in words": (lambda: mbd.simulate(MODEL, [0, 1], progress="yes"), "progress must be True or False"),
    "progress of kinematics": (lambda: mbd.kinematics(DRIVEN, [0, 1], progress=1), "progress must be True or False"),
    "a compiler in words": (lambda: mbd.simulate(MODEL, [0, 1], jit="gcc"), "jit must be True or False, got 'gcc'"),
    "one sample for five times": (
        lambda: mbd.identify(
            MODEL.replace(parameters=[GAIN]), np.linspace(0, 1, 5), data={LEVER.phi: 1.0}, unknowns=[GAIN]
        ),
        "1 samples of 1 values are given for lever.phi at 5 times",
    ),
    "a number as a file": (lambda: mbd.animate(mbd.simulate(MODEL, [0, 0.1]), 3), "path= must be the name of a file"),
    "a number as axes": (lambda: mbd.draw(mbd.assemble(MODEL), axes=3), "axes= takes axes of Matplotlib, got 3"),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_an_argument_is_refused_in_words(case):
    call, words = CASES[case]
    with pytest.raises(mbd.MechanismError, match=words):
        call()


@pytest.mark.parametrize("value", MANY.values(), ids=MANY)
@pytest.mark.parametrize("argument", ["bodies", "joints", "drivers", "forces", "inputs", "parameters"])
def test_a_list_of_parts_is_a_list(argument, value):
    parts = {"bodies": [LEVER], "joints": [HINGE], argument: value}
    with pytest.raises(mbd.MechanismError, match=argument):
        mbd.Mechanism(**parts)


@pytest.mark.parametrize("value", [ca.MX.sym("m"), ca.DM([1, 2]), np.array(1.0), "x", {}], ids=str)
def test_conditions_are_a_list(value):
    with pytest.raises(mbd.ConditionError, match="conditions must be a list of relations"):
        mbd.assemble(MODEL, value)
