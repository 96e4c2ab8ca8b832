"""Mechanisms: what they hold, what they refuse, and elements that are written wrongly."""

from __future__ import annotations

import copy
import inspect

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd


def link(name="arm", **more):
    """A rod of one metre."""
    return mbd.Body(name, **({"mass": 1.0, "inertia": 1 / 12, "pose": (0.5, 0, 0)} | more))


arm, forearm = link("upper arm"), link("forearm", pose=(1.5, 0, 0))
shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), arm.at(-0.5, 0))
elbow = mbd.Revolute("elbow", arm.at(0.5, 0), forearm.at(-0.5, 0))
torque, stiffness, current = mbd.Input("torque"), mbd.Parameter("stiffness k", 10.0), mbd.StateVariable("current")


def refuses(make, *words, kind=mbd.MechanismError):
    """The call raises, and the message has every word."""
    with pytest.raises(kind) as error:
        make()
    missing = [w for w in words if w.lower() not in str(error.value).lower()]
    assert not missing, f"{error.value!s} does not say {missing}"


@pytest.fixture
def robot():
    """Two links with all sorts of parts."""
    return mbd.Mechanism(
        bodies=[arm, forearm],
        joints=[shoulder, elbow],
        drivers=[mbd.Driver("lift", shoulder.angle, 0.2 * mbd.t)],
        forces=[
            mbd.Gravity(),
            mbd.Torque("motor", forearm, current, opposite=arm),
            mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(0, 0), stiffness=stiffness),
        ],
        inputs=[torque],
        parameters=[stiffness],
        states={current: torque - current},
        name="robot",
    )


# --- what it holds -----------------------------------------------------------------------
def test_parts_are_tuples_in_the_order_given(robot):
    """Bodies, joints, drivers, forces, inputs, parameters, states."""
    assert robot.bodies == (arm, forearm)
    assert robot.joints == (shoulder, elbow)
    assert [d.name for d in robot.drivers] == ["lift"]
    assert [f.name for f in robot.forces] == ["gravity", "motor", "spring"]
    assert robot.inputs == (torque,) and robot.parameters == (stiffness,) and robot.states == (current,)
    assert robot.name == "robot"
    assert ca.is_equal(robot.state_rates[current], torque - current, 3)


def test_things_are_found_by_name(robot):
    """Bodies, joints (drivers among them), forces and inputs."""
    assert robot.body("forearm") is forearm
    assert robot.joint("elbow") is elbow
    assert robot.joint("lift") is robot.drivers[0]
    assert robot.force("motor") is robot.forces[1]
    assert robot.input("torque") is robot.inputs[0]


@pytest.mark.parametrize("kind", ["body", "joint", "force", "input"])
def test_a_name_that_is_not_there_is_refused(robot, kind):
    """The message says what there is."""
    there = {"body": "upper arm", "joint": "shoulder", "force": "spring", "input": "torque"}[kind]
    refuses(lambda: getattr(robot, kind)("nowhere"), "nowhere", kind, there)


def test_a_mechanism_does_not_change(robot):
    """Neither by assignment nor by changing the lists it was made from."""
    with pytest.raises(AttributeError, match="does not change"):
        robot.bodies = ()
    with pytest.raises(AttributeError, match="does not change"):
        elbow.rows = ca.SX(0)
    joints = [shoulder]
    pendulum = mbd.Mechanism(bodies=[arm], joints=joints)
    joints.append(elbow)
    assert pendulum.joints == (shoulder,)
    assert copy.deepcopy(robot) is robot


def test_replace_makes_a_new_mechanism_on_the_same_symbols(robot):
    """What is given is replaced, the rest stays; the old one is untouched."""
    free = robot.replace(drivers=[])
    assert free is not robot and free.drivers == () and len(robot.drivers) == 1
    assert free.bodies == robot.bodies and free.joints == robot.joints and free.forces == robot.forces
    assert free.inputs == robot.inputs and free.parameters == robot.parameters and free.name == "robot"
    assert ca.is_equal(free.state_rates[current], robot.state_rates[current])
    assert mbd.equations(free).lam.numel() == 4 and mbd.equations(robot).lam.numel() == 5
    assert robot.replace(name="other").name == "other"


def test_replace_checks_as_the_constructor_does(robot):
    """Unknown arguments and missing symbols."""
    refuses(lambda: robot.replace(joint=[]), "replace", "joint", "joints")
    refuses(lambda: robot.replace(parameters=[]), "stiffness k", "spring", "parameters")
    refuses(lambda: robot.replace(states=None), "current", "motor", "states")


def test_it_prints_what_it_is(robot):
    """Name and numbers of parts."""
    text = repr(robot)
    for words in ("robot", "2 bodies", "2 joints", "1 drivers", "3 forces", "1 inputs", "1 parameters", "1 states"):
        assert words in text


# --- what it refuses -------------------------------------------------------------------------
def test_names_occur_once():
    """Bodies, elements, symbols; the message names the name."""
    refuses(lambda: mbd.Mechanism(bodies=[arm, link("upper arm")]), "upper arm", "twice")
    refuses(lambda: mbd.Mechanism(bodies=[arm], joints=[shoulder, shoulder]), "shoulder", "twice")
    refuses(lambda: mbd.Mechanism(bodies=[arm], forces=[mbd.Gravity(), mbd.Gravity()]), "gravity", "twice")
    lift = mbd.Driver("shoulder", shoulder.angle, 0)
    refuses(lambda: mbd.Mechanism(bodies=[arm], joints=[shoulder], drivers=[lift]), "shoulder", "twice")
    refuses(lambda: mbd.Mechanism(bodies=[arm], inputs=[torque, mbd.Input("torque")]), "torque", "twice")
    refuses(lambda: mbd.Mechanism(bodies=[arm], inputs=[torque], parameters=[mbd.Parameter("torque", 1)]), "torque")


def test_bodies_must_be_listed():
    """A joint or a force on a body that is not there names both; also one of the same name."""
    refuses(lambda: mbd.Mechanism(bodies=[arm], joints=[elbow]), "elbow", "forearm", "bodies")
    motor = mbd.Torque("motor", forearm, 1.0)
    refuses(lambda: mbd.Mechanism(bodies=[arm], forces=[motor]), "motor", "forearm")
    push = mbd.Force("push", arm.at(0, 0), (0, 1), opposite=forearm)
    refuses(lambda: mbd.Mechanism(bodies=[arm], forces=[push]), "push", "forearm")
    refuses(lambda: mbd.Mechanism(bodies=[link("upper arm")], joints=[shoulder]), "shoulder", "another body")
    written = mbd.Constraint("written", arm.x - forearm.x)
    refuses(lambda: mbd.Mechanism(bodies=[arm], joints=[written]), "written", "forearm")


def test_a_mechanism_needs_bodies():
    """Moving ones, in a list."""
    refuses(lambda: mbd.Mechanism(bodies=[]), "body")
    refuses(lambda: mbd.Mechanism(bodies=[mbd.ground]), "ground", "moving")
    refuses(lambda: mbd.Mechanism(bodies=[shoulder]), "shoulder")


@pytest.mark.parametrize(
    ("lists", "words"),
    [
        ({"joints": [mbd.Gravity()]}, ["gravity", "forces="]),
        ({"drivers": [mbd.Gravity()]}, ["gravity", "forces="]),
        ({"forces": [shoulder]}, ["shoulder", "joints="]),
        ({"joints": [mbd.Driver("lift", shoulder.angle, 0)]}, ["lift", "drivers="]),
        ({"forces": [3]}, ["forces=", "3"]),
        ({"joints": [arm]}, ["joints=", "upper arm"]),
        ({"inputs": [stiffness]}, ["inputs=", "stiffness k"]),
        ({"parameters": [torque]}, ["parameters=", "torque"]),
        ({"inputs": [ca.SX.sym("u")]}, ["inputs="]),
        ({"states": {torque: 1.0}}, ["states=", "torque"]),
        ({"states": {current: arm.q}}, ["current", "scalar"]),
        ({"states": {current: float("nan")}}, ["current", "finite"]),
    ],
)
def test_parts_in_the_wrong_list_are_refused(lists, words):
    """The message names the part, and the list where it belongs."""
    refuses(lambda: mbd.Mechanism(bodies=[arm], **lists), *words)


@pytest.mark.parametrize(
    "lists",
    [
        {"bodies": arm},
        {"bodies": [arm], "inputs": torque},
        {"bodies": [arm], "parameters": stiffness},
        {"bodies": [arm], "joints": shoulder},
        {"bodies": [arm], "forces": mbd.Gravity()},
        {"bodies": [arm], "states": [current]},
    ],
    ids=["bodies", "inputs", "parameters", "joints", "forces", "states"],
)
def test_a_single_part_in_place_of_a_list_is_refused(lists):
    """A forgotten pair of brackets gets an error of the package that names the argument."""
    argument = list(lists)[-1]
    refuses(lambda: mbd.Mechanism(**lists), f"{argument}= takes", kind=mbd.ModelError)


@pytest.mark.parametrize("parts", [None, 3, "arm", {"arm": arm}])
def test_what_is_no_list_of_parts_is_refused(parts):
    """The message names the argument and what was given; any iterable is a list."""
    refuses(lambda: mbd.Mechanism(bodies=parts), "bodies=", repr(parts), kind=mbd.ModelError)
    assert mbd.Mechanism(bodies=(b for b in (arm, forearm))).bodies == (arm, forearm)


# --- stray symbols ------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("lists", "words"),
    [
        (lambda: {"forces": [mbd.Torque("motor", arm, torque)]}, ["torque", "motor", "inputs"]),
        (lambda: {"forces": [mbd.Torque("motor", arm, current)]}, ["current", "motor", "states"]),
        (
            lambda: {"forces": [mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(0, 0), stiffness=stiffness)]},
            ["stiffness k", "spring", "parameters"],
        ),
        (lambda: {"forces": [mbd.Gravity((0, -stiffness))]}, ["stiffness k", "gravity", "parameters"]),
        (
            lambda: {"joints": [mbd.Revolute("pin", mbd.ground.at(stiffness, 0), arm.at(0, 0))]},
            ["stiffness k", "pin", "parameters"],
        ),
        (lambda: {"drivers": [mbd.Driver("lift", arm.phi, stiffness * mbd.t)]}, ["stiffness k", "lift", "parameters"]),
        (lambda: {"forces": [mbd.Torque("motor", arm, forearm.omega)]}, ["motor", "forearm.omega"]),
        (lambda: {"forces": [mbd.Torque("motor", arm, ca.SX.sym("stranger"))]}, ["motor", "stranger"]),
        (lambda: {"forces": [mbd.Torque("motor", arm, arm.alpha)]}, ["motor", "upper arm.alpha"]),
        (
            lambda: {"forces": [mbd.Torque("motor", arm, shoulder.reaction_on(arm).force[0])]},
            ["motor", "shoulder"],
        ),
        (lambda: {"states": {current: torque}}, ["current", "torque", "inputs"]),
        (lambda: {"states": {current: arm.ax}}, ["current", "upper arm.ax"]),
    ],
)
def test_a_symbol_that_is_not_listed_is_refused(lists, words):
    """The message names the symbol, the element that uses it, and the list it belongs to."""
    refuses(lambda: mbd.Mechanism(bodies=[arm], **lists()), *words, kind=mbd.ExpressionError)


def test_mass_holds_parameters_only():
    """Listed ones; neither an input nor a coordinate."""
    heavy = link("heavy", mass=stiffness)
    refuses(lambda: mbd.Mechanism(bodies=[heavy]), "heavy", "stiffness k", "parameters")
    assert mbd.Mechanism(bodies=[heavy], parameters=[stiffness]).parameters == (stiffness,)
    loaded = link("loaded", mass=torque)
    refuses(lambda: mbd.Mechanism(bodies=[loaded], inputs=[torque]), "loaded", "mass", "torque")
    growing = link("growing", inertia=arm.phi)
    refuses(lambda: mbd.Mechanism(bodies=[growing, arm]), "growing", "inertia", "phi")


# --- elements that are written wrongly --------------------------------------------------------------
@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: mbd.Revolute("pin", arm, forearm.at(0, 0)), ["pin", "marker", "upper arm", ".at(x, y)"]),
        (lambda: mbd.Revolute("pin", arm.at(0, 0), arm.at(1, 0)), ["pin", "upper arm", "itself"]),
        (lambda: mbd.Revolute("pin", mbd.ground.at(0, 0), mbd.ground.at(1, 0)), ["pin", "ground"]),
        (lambda: mbd.Revolute("", arm.at(0, 0), forearm.at(0, 0)), ["name"]),
        (lambda: mbd.Distance("ram", arm.at(0, 0), forearm.at(0, 0), 0.0), ["ram", "zero", "Revolute"]),
        (lambda: mbd.Distance("ram", arm.at(0, 0), forearm.at(0, 0), -0.1), ["ram", "distance", "-0.1"]),
        (lambda: mbd.Distance("ram", arm.at(0, 0), forearm.at(0, 0), mbd.Parameter("L", 0)), ["ram", "zero"]),
        (lambda: mbd.Distance("ram", arm.at(0, 0), forearm.at(0, 0), float("nan")), ["ram", "distance", "nan"]),
        (lambda: mbd.AbsoluteDistance("ram", arm.at(0, 0), (0, 0), 0.0), ["ram", "zero"]),
        (lambda: mbd.AbsoluteDistance("ram", arm.at(0, 0), (0, 0, 0), 1.0), ["ram", "point", "two"]),
        (lambda: mbd.AbsoluteX("held", arm, 1.0), ["held", "marker"]),
        (lambda: mbd.AbsoluteX("held", arm.at(0, 0), "left"), ["held", "value", "left"]),
        (lambda: mbd.RackAndPinion("mesh", arm.at(0, 0), forearm.at(0, 0), 0.0), ["mesh", "radius", "0"]),
        (lambda: mbd.RackAndPinion("mesh", arm.at(0, 0), forearm.at(0, 0), -1.0), ["mesh", "radius", "-1"]),
        (lambda: mbd.PointOnLine("slot", arm.at(0, 0), forearm.at(0, 0), arm.q), ["slot", "offset", "scalar"]),
        (lambda: mbd.AbsoluteX("held", arm.at(0, 0), arm.vy), ["held", "velocity", "upper arm.vy"]),
        (lambda: mbd.AbsoluteX("held", arm.at(0, 0), torque), ["held", "input", "torque"]),
        (lambda: mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(current, 0)), ["pin", "state", "current"]),
        (lambda: mbd.Distance("ram", arm.at(0, 0), forearm.at(0, 0), 1 + torque), ["ram", "input", "torque"]),
        (lambda: mbd.Constraint("written", arm.vx), ["written", "velocity", "upper arm.vx"]),
        (lambda: mbd.Constraint("written", arm.x - torque), ["written", "input", "torque"]),
        (lambda: mbd.Constraint("written", mbd.t), ["written", "no coordinate"]),
        (lambda: mbd.Constraint("written", 3.0), ["written", "no coordinate"]),
        (lambda: mbd.Constraint("written", "x"), ["written", "expression", "'x'"]),
        (lambda: mbd.Constraint("written", [arm.x, None]), ["written", "expression", "None"]),
        (lambda: mbd.Constraint("written", arm.x == 1), ["written", "relation", "zero"]),
        (lambda: mbd.Constraint("written", ca.logic_and(arm.x < 1, arm.y < 1)), ["written", "relation", "zero"]),
        (lambda: mbd.Constraint("written", []), ["written", "no coordinate"]),
        (lambda: mbd.Driver("lift", arm.position, 1.0), ["lift", "scalar"]),
        (lambda: mbd.Driver("lift", arm.omega, 1.0), ["lift", "velocity", "upper arm.omega"]),
        (lambda: mbd.Driver("lift", arm.phi, arm.x), ["lift", "position", "upper arm.x"]),
        (lambda: mbd.Driver("lift", arm.phi, torque), ["lift", "input", "torque"]),
        (lambda: mbd.Driver("lift", mbd.t, 1.0), ["lift", "no coordinate"]),
        (lambda: mbd.Driver("lift", arm.phi, float("nan")), ["lift", "value", "nan"]),
        (lambda: mbd.Force("push", arm, (0, 1)), ["push", "marker"]),
        (lambda: mbd.Force("push", arm.at(0, 0), 5.0), ["push", "vector", "two"]),
        (lambda: mbd.Force("push", arm.at(0, 0), (0, 1, 2)), ["push", "vector", "two"]),
        (lambda: mbd.Force("push", arm.at(0, 0), (0, float("nan"))), ["push", "vector", "nan"]),
        (lambda: mbd.Force("push", arm.at(0, 0), (0, 1), frame="local"), ["push", "frame", "local"]),
        (lambda: mbd.Force("push", arm.at(0, 0), (0, 1), opposite=forearm.at(0, 0)), ["push", "opposite", "body"]),
        (lambda: mbd.Force("push", arm.at(0, 0), (0, 1), opposite=arm), ["push", "upper arm", "nothing"]),
        (lambda: mbd.Force("push", mbd.ground.at(0, 0), (0, 1)), ["push", "ground", "nothing"]),
        (lambda: mbd.Torque("motor", mbd.ground, 1.0), ["motor", "ground", "nothing"]),
        (lambda: mbd.Torque("motor", arm, 1.0, opposite=arm), ["motor", "upper arm", "nothing"]),
        (lambda: mbd.Torque("motor", arm.at(0, 0), 1.0), ["motor", "body"]),
        (lambda: mbd.Torque("motor", arm, arm.q), ["motor", "value", "scalar"]),
        (lambda: mbd.TSDA("spring", arm.at(0, 0), arm.at(1, 0)), ["spring", "upper arm", "itself"]),
        (lambda: mbd.TSDA("spring", arm, forearm.at(1, 0)), ["spring", "marker"]),
        (lambda: mbd.TSDA("spring", arm.at(0, 0), forearm.at(0, 0), stiffness="hard"), ["spring", "stiffness", "hard"]),
        (
            lambda: mbd.TSDA("spring", arm.at(0, 0), forearm.at(0, 0), stiffness=1, law=lambda x, r: x),
            ["spring", "law", "stiffness"],
        ),
        (lambda: mbd.TSDA("spring", arm.at(0, 0), forearm.at(0, 0), law=3.0), ["spring", "law", "length and rate"]),
        (lambda: mbd.RSDA("spring", arm.at(0, 0), forearm.at(0, 0), law=lambda x, r: arm.q), ["spring", "law"]),
        (lambda: mbd.GeneralizedForce("belt", []), ["belt", "pair"]),
        (lambda: mbd.GeneralizedForce("belt", [(arm.x,)]), ["belt", "pairs"]),
        (lambda: mbd.GeneralizedForce("belt", [(arm.position, 1.0)]), ["belt", "2", "1"]),
        (lambda: mbd.GeneralizedForce("belt", [(arm.vx, 1.0)]), ["belt", "velocity", "upper arm.vx"]),
        (lambda: mbd.Gravity(9.81), ["gravity", "two"]),
    ],
)
def test_an_element_that_is_written_wrongly_is_refused(make, words):
    """The message names the element and what is wrong with it."""
    refuses(make, *words)


def test_vectors_of_expressions_may_be_lists():
    """A Constraint takes a list of rows as it takes a column."""
    column = mbd.Constraint("column", mbd.vertcat(arm.x, arm.y - 1))
    rows = mbd.Constraint("rows", [arm.x, arm.y - 1])
    assert rows.rows.shape == column.rows.shape == (2, 1)
    assert ca.is_equal(rows.rows, column.rows, 3)
    other = mbd.Constraint("array", np.array([arm.x, arm.y - 1], dtype=object))
    assert ca.is_equal(other.rows, column.rows, 3)


def test_row_names_say_what_a_row_holds(robot):
    """Element and row; a single row has the name of its element."""
    assert mbd.equations(robot).row_names == ("shoulder.x", "shoulder.y", "elbow.x", "elbow.y", "lift")
    weld = mbd.Weld("weld", arm.at(0, 0), forearm.at(0, 0))
    assert weld.row_names == ("weld.x", "weld.y", "weld.angle")
    guide = mbd.Translational("guide", arm.at(0, 0), forearm.at(0, 0))
    assert guide.row_names == ("guide.normal", "guide.angle")
    assert mbd.Constraint("two", arm.position - forearm.position).row_names == ("two.0", "two.1")


def test_elements_know_their_bodies():
    """The ground included where it takes part."""
    assert shoulder.bodies == (mbd.ground, arm)
    assert elbow.bodies == (arm, forearm)
    assert mbd.AbsoluteX("held", arm.at(0, 0)).bodies == (arm, mbd.ground)
    assert mbd.RelativeX("apart", arm.at(0, 0), forearm.at(0, 0), 1).bodies == (arm, forearm, mbd.ground)
    assert mbd.RelativeAngle("turned", arm.at(0, 0), forearm.at(0, 0), 1).bodies == (arm, forearm)
    assert set(mbd.Driver("lift", elbow.angle, 0).bodies) == {arm, forearm, mbd.ground}
    belt = mbd.GeneralizedForce("belt", [(arm.phi - forearm.phi, 1.0)])
    assert set(belt.bodies) == {arm, forearm, mbd.ground}


def test_natural_coordinates_of_joints():
    """Angle and rate of a pin, displacement and speed of a guide, of either kind."""
    q = np.array([0.2, 0.4, 0.5, 1.0, -0.3, 1.4])
    v = np.array([1.0, -2.0, 0.5, 0.3, 0.7, -1.1])
    pin = mbd.Revolute("pin", arm.at(0, 0, angle=0.2), forearm.at(0, 0, angle=0.7))
    a, b = arm.at(0.1, 0.2, angle=0.2), forearm.at(-0.3, 0.1)
    guide, slot = mbd.Translational("guide", a, b), mbd.PointOnLine("slot", a, b)
    symbols = [ca.vertcat(arm.q, forearm.q), ca.vertcat(arm.v, forearm.v)]
    values = ca.Function(
        "f", symbols, [pin.angle, pin.angular_velocity, guide.displacement, guide.speed, slot.displacement, slot.speed]
    )(q, v)

    def way(q):
        A, B = (np.array([[np.cos(p), -np.sin(p)], [np.sin(p), np.cos(p)]]) for p in (q[2], q[5]))
        d = q[3:5] + B @ [-0.3, 0.1] - q[:2] - A @ [0.1, 0.2]
        return d @ [np.cos(q[2] + 0.2), np.sin(q[2] + 0.2)]

    h = 1e-6
    speed = (way(q + h * v) - way(q - h * v)) / (2 * h)
    np.testing.assert_allclose([float(x) for x in values], [1.4, -1.6, way(q), speed, way(q), speed], atol=1e-8)


def test_classes_tell_their_arguments():
    """To help and to editors."""
    assert list(inspect.signature(mbd.Coupler).parameters) == ["name", "a", "b", "ratio", "carrier"]
    assert inspect.signature(mbd.Belt).parameters["crossed"].default is False
    assert list(inspect.signature(mbd.Mechanism).parameters)[:2] == ["bodies", "joints"]


def test_a_rate_that_is_given_twice():
    """By the mechanism and by the element that owns the state."""
    wheel = mbd.Body("wheel", mass=1, inertia=1)
    current = mbd.StateVariable("current")
    motor = mbd.DCMotor("motor", wheel, 6.0, constant=0.1, resistance=1.0, inductance=0.1, current=current)
    with pytest.raises(mbd.ModelError, match="motor 'motor': the rate of state variable 'current' is given twice"):
        mbd.Mechanism(bodies=[wheel], forces=[motor], states={current: -current})


def test_values_of_a_mechanism_take_the_place_of_those_of_its_parts():
    """Other dimensions and another pose on the same symbols, in every analysis; what is not of the model is refused."""
    length = mbd.Parameter("length", 1.0)
    bar = mbd.Body("bar", 1.0, length**2 / 12, pose=(0.5, 0.0, 0.0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bar.at(-length / 2, 0))
    short = mbd.Mechanism([bar], [pin], forces=[mbd.Gravity()], parameters=[length])
    long = short.replace(values={length: 2.0, bar.x: np.cos(1.0), bar.y: np.sin(1.0), bar.phi: 1.0})
    state = mbd.assemble(long)
    assert state[bar.phi] == pytest.approx(1.0) and state[bar.x] == pytest.approx(np.cos(1.0))
    motion = mbd.simulate(long, [0.0, 0.1])
    assert np.all(motion[length] == 2.0) and mbd.assemble(short)[bar.x] == pytest.approx(0.5)
    assert mbd.simulate(long, [0.0, 0.1], parameters={length: 3.0})[length][0] == 3.0
    assert long.replace(name="other").values == long.values and short.values == {}
    for wrong in ({mbd.Parameter("other", 1.0): 2.0}, {"length": 2.0}, {bar.vx: 1.0}):
        with pytest.raises(mbd.ModelError, match="values= takes parameters and coordinates of the mechanism"):
            short.replace(values=wrong)
    with pytest.raises(mbd.ModelError, match="value must be a number"):
        short.replace(values={length: "2"})
    with pytest.raises(mbd.ModelError, match=r"values= takes \{parameter or coordinate: number\}"):
        short.replace(values=[length])
