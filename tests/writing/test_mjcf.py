"""Mechanisms as files of MuJoCo, which are read again as the same."""

import re

import numpy as np
import pytest

import mbdcasadi as mbd

GROUND = mbd.ground
LEFT_OUT = "ignore:write_mjcf. left out the laws of contacts"


def again(mechanism, folder, **options):
    mbd.write_mjcf(mechanism, folder / "m.xml")
    return mbd.read_mjcf(folder / "m.xml", **options)


def coordinates(mechanism, name):
    """A coordinate of a joint and its rate; of bodies that are free, those of the body."""
    if any(joint.name == name for joint in mechanism.joints):
        joint = mechanism.joint(name)
        return (joint.angle, joint.angular_velocity) if hasattr(joint, "angle") else (joint.displacement, joint.speed)
    body = mechanism.body(name.split()[0])
    return {"x": (body.x, body.vx), "y": (body.y, body.vy), "angle": (body.phi, body.omega)}[name.split()[1]]


def shared(one, other, name):
    return zip(coordinates(one, name), coordinates(other, name), strict=True)


def compare(mechanism, other, start, names, inputs=()):
    """Places and accelerations of all bodies in the same state are the same."""
    state = mbd.assemble(mechanism, start, inputs=dict(zip(mechanism.inputs, inputs, strict=True)))
    pairs = [pair for name in names for pair in shared(other, mechanism, name)]
    given = dict(zip(other.inputs, inputs, strict=True))
    found = mbd.assemble(other, [mine == state[theirs] for mine, theirs in pairs], inputs=given)
    for body in other.bodies:
        known = mechanism.body(body.name)
        assert found[body.position] == pytest.approx(state[known.position], abs=1e-12)
        assert found[body.a] == pytest.approx(state[known.a], rel=1e-9, abs=1e-9)


def crane():
    """Trees, bodies without joints, couplings, springs and actuators of all kinds."""
    cart, arm, fore = (mbd.Body(name, 2.0, 0.1, pose) for name, pose in
                       (("cart", (0.3, 0.5, 0)), ("arm", (0.7, 0.9, 0.8)), ("fore", (1.1, 1.2, 0.2))))  # fmt: skip
    free, ring = mbd.Body("free", 0.5, 0.01, (-1, 1, 0.3)), mbd.Body("ring", 0.4, 0.03, (2, 1, 0.5))
    gear = mbd.Body("gear", 0.3, 0.004, (-2, 0.3, 0.1))
    u, w, x, k = mbd.Input("u", lower=-3, upper=4), mbd.Input("w"), mbd.Input("x"), mbd.Parameter("k", 40.0)
    rail = mbd.Translational("rail", GROUND.at(0, 0.5, 0.2), cart.at(0.02, 0.01, 0.2))
    shoulder = mbd.Revolute("shoulder", arm.at(-0.4, 0.1), cart.at(0.05, 0.1))
    elbow = mbd.Revolute("elbow", arm.at(0.4, 0), fore.at(-0.3, 0))
    pin = mbd.Revolute("gear pin", GROUND.at(-2, 0.3), gear.at(0.01, 0))
    pinion = mbd.Constraint("pinion", 2 * gear.phi - 5 * rail.displacement - 0.2)
    three = mbd.Constraint("three", ring.phi - 0.3 * fore.phi + 0.2 * rail.displacement - 0.1)
    rod = mbd.Distance("rod", ring.at(0.1, 0), fore.at(0.1, 0.1), 1.0)
    forces = [
        mbd.Gravity((0, -9)),
        mbd.RSDA("one joint", arm.at(0, 0), fore.at(0, 0), stiffness=k, free_angle=0.3, damping=2),
        mbd.RSDA("two joints", GROUND.at(0, 0), fore.at(0, 0), stiffness=5, free_angle=-0.1, damping=0.3),
        mbd.TSDA("spring", GROUND.at(0, 2), fore.at(0.1, 0), stiffness=30, free_length=0.5, damping=1.5),
        mbd.TSDA("cylinder", GROUND.at(1, 2), free.at(0.1, 0), stiffness=30, free_length=0.5, actuator=2 * x),
        mbd.Torque("motor", arm, u, opposite=cart), mbd.Torque("same input", fore, 3 * u),
        mbd.Torque("servo", fore, w - 0.4 * (fore.phi - arm.phi) - 0.1 * (fore.omega - arm.omega) + 0.7, opposite=arm),
        mbd.GeneralizedForce("drag", [(rail.displacement, -3 * rail.speed - 4 * rail.displacement)]),
    ]  # fmt: skip
    joints = [elbow, shoulder, rail, pin, pinion, rod, three]
    bodies = [free, fore, arm, cart, ring, gear]
    return mbd.Mechanism(bodies, joints, forces=forces, inputs=[u, w, x], parameters=[k], name="crane")


@pytest.mark.slow
def test_trees_couplings_springs_and_actuators(tmp_path):
    """Accelerations of a machine with everything, in a state far from the pose of the file."""
    machine = crane()
    other = again(machine, tmp_path)
    rail, shoulder, elbow = (machine.joint(name) for name in ("rail", "shoulder", "elbow"))
    free, ring = machine.body("free"), machine.body("ring")
    start = [rail.displacement == 0.35, rail.speed == 0.4, shoulder.angle == -0.8, shoulder.angular_velocity == 1.1]
    start += [elbow.angle == -0.7, elbow.angular_velocity == -0.5, free.x == -0.9, free.vy == 0.3, free.phi == 0.2]
    start += [free.omega == 2, ring.x == 2.1, ring.vx == 0.1]
    names = [
        "rail",
        "shoulder",
        "elbow",
        "gear pin",
        "free x",
        "free y",
        "free angle",
        "ring x",
        "ring y",
        "ring angle",
    ]
    compare(machine, other, start, names, (0.5, -0.3, 0.8))
    drive = other.inputs[0]
    assert (drive.label, drive.lower, drive.upper) == ("u", -3, 4)
    assert other.name == "crane" and len(other.bodies) == 6


@pytest.mark.filterwarnings("ignore:assembly")
@pytest.mark.parametrize("model", ["four_bar", "slider_crank", "quick_return", "watt"])
def test_loops_are_equalities(model, tmp_path):
    """Linkages of the library, whose loops are closed by pins."""
    model = getattr(mbd.library, model)()
    machine = model.mechanism
    other = again(machine, tmp_path)
    tree = re.findall(r'<joint name="([^"]*)" type="(?:hinge|slide)"', (tmp_path / "m.xml").read_text())
    tree = [name for name in tree if any(name == joint.name for joint in machine.joints)]
    compare(machine, other, [model.crank.phi == 0.6, model.crank.omega == 2], tree, [0.4] * len(machine.inputs))


def test_armatures_and_lines(tmp_path):
    """A rotor that is geared to one joint is its armature; a pin in a slot is a slide and a hinge, not a loop."""
    bar, rotor = mbd.Body("bar", 1.0, 0.1, (0.5, 0, 0)), mbd.Body("rotor", 7.0, 0.02)
    hinge = mbd.Revolute("hinge", GROUND.at(0, 0), bar.at(-0.5, 0))
    stage = mbd.Constraint("stage", rotor.phi + 5 * bar.phi)
    machine = mbd.Mechanism([bar, rotor], [hinge, mbd.Revolute("bearing", GROUND.at(3, 0), rotor.at(0, 0)), stage])
    other = again(machine, tmp_path)
    assert 'armature="0.5"' in (tmp_path / "m.xml").read_text()
    (turn,) = (body for body in other.bodies if body.name != "bar")
    assert float(turn.inertia) == 0.5
    bead = mbd.Body("bead", 1.0, 0.1, (0.3, 0.1, 0))
    slot = mbd.PointOnLine("slot", bar.at(0, 0), bead.at(0.1, 0), offset=0.05)
    machine = mbd.Mechanism([bead, bar], [slot, hinge], forces=[mbd.Gravity()])
    start = [bar.phi == 0.3, bar.omega == 1, slot.displacement == 0.1, slot.speed == 0.5]
    start += [bead.phi == 0.2, bead.omega == 2]
    other = again(machine, tmp_path)
    turn, state = other.joint("slot turn"), mbd.assemble(machine, start)
    given = [mine == state[theirs] for name in ("hinge", "slot") for mine, theirs in shared(other, machine, name)]
    given += [turn.angle == state[bead.phi - bar.phi], turn.angular_velocity == 2 - 1]
    found = mbd.assemble(other, given)
    assert found[other.body("bead").a] == pytest.approx(state[bead.a], rel=1e-9)


@pytest.mark.filterwarnings(LEFT_OUT)
def test_limits_friction_and_contacts(tmp_path):
    """Ranges, dry friction, and gaps of all outlines that are geoms."""
    body, block = mbd.Body("body", 2.0, 0.1, (0.4, 0.9, 0.3)), mbd.Body("block", 3.0, 0.2, (1.5, 0.6, 0.1))
    pin = mbd.Revolute("pin", body.at(-0.3, 0), GROUND.at(0.1, 0.8))
    law, rubs = mbd.HuntCrossley(1e4), mbd.Coulomb(0.4, 1e-3)
    slab = mbd.PolygonEdges(block.at(0.1, 0.05, 0.4), [(-0.3, -0.1), (0.3, -0.1), (0.3, 0.1), (-0.3, 0.1)])
    ball, rod = mbd.Circle(body.at(0.3, 0), 0.1), mbd.Segment(body.at(0, 0.1, 0.5), 0.4, 0.05)
    slope = mbd.HalfPlane(GROUND.at(0, -0.2, 0.2))
    forces = [
        mbd.Contact("slab on slope", slab, slope, law, rubs), mbd.Contact("ball on slab", ball, slab, law),
        mbd.Contact("rod on slab", rod, slab, law), mbd.Contact("rod on slope", rod, slope, law, rubs),
        mbd.EndStop("up", 1.2 - pin.angle, law), mbd.EndStop("low", pin.angle + 0.7, law),
        mbd.LoadIndependentFriction("seal", pin, rubs, load=5.0, radius=0.02),
    ]  # fmt: skip
    machine = mbd.Mechanism([body, block], [pin], forces=forces)
    with pytest.warns(mbd.MechanismWarning, match="left out the laws of contacts, stops and friction"):
        mbd.write_mjcf(machine, tmp_path / "m.xml")
    other = mbd.read_mjcf(tmp_path / "m.xml")
    here, there = mbd.assemble(machine), mbd.assemble(other)
    for contact in forces[:4]:
        read = other.force(contact.name)
        assert there[read.gap] == pytest.approx(here[contact.gap], abs=1e-12)
        assert (read.friction is None) == (contact.friction is None)
    assert there[other.force("pin upper stop").gap] == pytest.approx(here[forces[4].gap])
    assert there[other.force("pin lower stop").gap] == pytest.approx(here[forces[5].gap])
    friction = other.force("pin friction")
    assert there[friction.load * friction.radius] == pytest.approx(0.4 * 5 * 0.02)
    assert len(set(re.findall(r'<geom name="([^"]*)"', (tmp_path / "m.xml").read_text()))) == 4


ROBOT = """<mujoco model="robot"><worldbody><geom name="floor" type="plane" size="1 1 1"/><site name="a"/>
  <body name="trunk" pos="0 0 1"><joint name="x" type="slide" axis="1 0 1"/>
  <joint name="z" type="slide" axis="-1 0 1" ref="1"/><joint name="turn" axis="0 1 0" damping="2"/><site name="b"/>
  <geom name="trunk" type="capsule" size="0.05 0.2"/>
  <body name="leg" pos="0 0 -0.2"><joint name="hip" axis="0 -1 0" range="-30 50" armature="0.3" stiffness="9"/>
  <geom name="leg" type="box" size="0.04 0.04 0.2" pos="0 0 -0.2"/></body></body></worldbody>
  <tendon><spatial name="t" springlength="0.3" stiffness="20"><site site="a"/><site site="b"/></spatial></tendon>
  <actuator><position name="u" joint="hip" kp="40" kv="3" gear="2"/></actuator></mujoco>"""


@pytest.mark.filterwarnings(LEFT_OUT)
def test_a_robot_that_was_read(tmp_path):
    """What read_mjcf makes is written, and read again with the same names, laws and accelerations."""
    (tmp_path / "r.xml").write_text(ROBOT)
    robot = mbd.read_mjcf(tmp_path / "r.xml")
    other = again(robot, tmp_path)
    assert {force.name for force in other.forces} == {force.name for force in robot.forces}
    for name in ("trunk on floor", "leg on floor"):
        laws = robot.force(name).law, other.force(name).law
        assert float(laws[1].stiffness) == pytest.approx(float(laws[0].stiffness), rel=1e-12)
    values = {"x": 0.2, "z": 2.0, "turn": 0.3, "hip": 0.4}
    start = [coordinates(robot, name)[0] == value for name, value in values.items()]
    start += [coordinates(robot, name)[1] == value + 0.5 for name, value in values.items()]
    compare(robot, other, start, values, (0.7,))


TENDONS = """<mujoco><compiler angle="radian"/><default><geom contype="0"/></default><worldbody>
  <site name="nail" pos="0 0 2"/><body name="a"><joint name="ja" axis="0 -1 0" ref="0.2"/>
  <geom size="0.1" mass="2" pos="0.5 0 0"/><site name="eye" pos="0.4 0 0.1"/></body>
  <body name="b" pos="0 0 3"><joint name="jb" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/></body></worldbody>
  <tendon><fixed name="sum" range="-0.4 0.9" stiffness="20" damping="0.3" springlength="-0.1 0.3">
  <joint joint="ja" coef="0.5"/><joint joint="jb" coef="-2"/></fixed>
  <spatial name="string" range="0.2 2.3" damping="2" stiffness="70" springlength="0 1.5"><site site="nail"/>
  <site site="eye"/></spatial></tendon>
  <actuator><motor name="u" tendon="sum" gear="3"/><motor name="v" tendon="string"/></actuator></mujoco>"""


@pytest.mark.filterwarnings(LEFT_OUT)
def test_tendons_with_limits_and_play(tmp_path):
    """Ranges and springs with play of tendons are stops with their names and laws again, forces the same."""
    (tmp_path / "t.xml").write_text(TENDONS)
    machine = mbd.read_mjcf(tmp_path / "t.xml")
    other = again(machine, tmp_path)
    stops = [force for force in machine.forces if isinstance(force, mbd.EndStop)]
    names = {"sum lower spring", "sum upper spring", "string upper spring", "sum lower stop", "sum upper stop"}
    assert {stop.name[7:] for stop in stops} == names | {"string lower stop", "string upper stop"}
    here, there = mbd.assemble(machine), mbd.assemble(other)
    for stop in stops:
        read = other.force(stop.name)
        assert there[read.gap] == pytest.approx(here[stop.gap], abs=1e-12)
        assert float(read.law.stiffness) == pytest.approx(float(stop.law.stiffness))
    start = [coordinates(machine, "ja")[0] == 0.9, coordinates(machine, "ja")[1] == 2.0]
    compare(machine, other, [*start, coordinates(machine, "jb")[0] == -0.4], ("ja", "jb"), (0.7, -0.4))


def arm(*, forces=lambda *_: (), joints=lambda *_: (), drivers=lambda *_: (), inputs=()):
    """A bar on a pin, a body without joints, and more."""
    bar, free = mbd.Body("bar", 1.0, 0.1, (0.4, 0, 0)), mbd.Body("free", 1.0, 0.1, (0.8, 0.1, 0.2))
    pin = mbd.Revolute("pin", GROUND.at(0, 0), bar.at(-0.4, 0))
    parts = [[*make(bar, free, pin)] for make in (joints, drivers, forces)]
    return mbd.Mechanism([bar, free], [pin, *parts[0]], parts[1], parts[2], inputs=inputs)


U = mbd.Input("u", lower=0.0)
LAW, FLOOR, NAIL = mbd.HuntCrossley(9), mbd.HalfPlane(GROUND.at(0, -1)), GROUND.at(0, 1)


@pytest.mark.parametrize(
    ("kind", "make", "words"),
    [
        ("forces", lambda b, f, p: mbd.Rope("rope", NAIL, f.at(0, 0), 0.5, 9.0), "rope 'rope' is not linear in the"),
        ("forces", lambda b, f, p: mbd.Torque("t", b, mbd.sin(mbd.t)), "torque 't' is not linear in the coordinates"),
        ("forces", lambda b, f, p: mbd.Torque("t", b, mbd.fmin(-b.phi, 9)), "torque 't' is not linear"),
        ("forces", lambda b, f, p: mbd.Torque("t", b, -(b.phi**3)), "torque 't' is not linear"),
        ("forces", lambda b, f, p: mbd.Torque("t", b, 1.0), "holds a constant force; make that an Input"),
        ("forces", lambda b, f, p: mbd.Torque("t", b, 3 * b.phi), "has a negative stiffness or damping"),
        ("forces", lambda b, f, p: mbd.TSDA("s", NAIL, f.at(0, 0), 9.0, -1.0), "has a negative free length"),
        ("forces", lambda b, f, p: mbd.FirstOrderLag("lag", b.phi, 1.0), "lag 'lag' has states or coordinates"),
        (
            "forces",
            lambda b, f, p: mbd.JointFriction("f", p, mbd.Coulomb(1, 1e-3), radius=1),
            "depends on the reaction",
        ),
        ("forces", lambda b, f, p: mbd.LoadIndependentFriction("f", p, mbd.Viscous(1), 2, 1), "has the law Viscous"),
        ("forces", lambda b, f, p: mbd.EndStop("s", p.angle, LAW), "joint 'pin' has a stop on one side"),
        ("forces", lambda b, f, p: mbd.EndStop("s", b.y, LAW), "stop 's' is no stop on the coordinate of a joint"),
        ("forces", lambda b, f, p: mbd.Contact("c", mbd.Point(f.at(0, 0)), FLOOR, LAW), "has a Point that is no geom"),
        (
            "forces",
            lambda b, f, p: mbd.RigidContact("c", mbd.Circle(f.at(0, 0), 1), FLOOR),
            "switches constraints, which",
        ),
        ("joints", lambda b, f, p: mbd.KnifeEdge("knife", f.at(0, 0)), "'knife' holds velocities alone"),
        (
            "joints",
            lambda b, f, p: mbd.RelativeX("x", b.at(0, 0), f.at(1, 0), 0.3),
            "'x' is neither a pin, a weld or a",
        ),
        ("drivers", lambda b, f, p: mbd.Driver("d", p.angle, mbd.t), "driver 'd' prescribes a motion in time; take a"),
    ],
)
def test_what_has_no_counterpart(kind, make, words, tmp_path):
    """One sentence with the element and what to do; no file is left."""
    with pytest.raises(mbd.ModelError) as caught:
        mbd.write_mjcf(arm(**{kind: lambda *parts: [make(*parts)]}), tmp_path / "m.xml")
    assert words in str(caught.value) and str(caught.value).startswith("write_mjcf: ")
    assert not (tmp_path / "m.xml").exists()


def test_an_input_of_a_tendon_and_a_joint(tmp_path):
    """An actuator acts along one coordinate."""
    machine = arm(
        forces=lambda b, f, p: [mbd.Torque("t", b, U), mbd.TSDA("s", NAIL, f.at(0, 0), actuator=U)], inputs=[U]
    )
    with pytest.raises(mbd.ModelError, match="torque 't' shares the input 'u' with another, and one acts along a dist"):
        mbd.write_mjcf(machine, tmp_path / "m.xml")


def test_what_is_left_out_is_named(tmp_path):
    """Inputs without an effect, and limits on one side; a driver at rest is an equality."""
    machine = arm(forces=lambda b, f, p: [mbd.Torque("t", b, U)], inputs=[U, mbd.Input("idle")])
    with pytest.warns(mbd.MechanismWarning, match="left out the limit of the input 'u' on one side; the input 'idle'"):
        mbd.write_mjcf(machine, tmp_path / "m.xml")
    held = again(arm(drivers=lambda b, f, p: [mbd.Driver("hold", p.angle, 0.3)]), tmp_path)
    assert mbd.assemble(held)[held.joint("pin").angle] == pytest.approx(0.3)
    light = mbd.Body("light", 0.0, 0.0)
    with pytest.raises(mbd.ModelError, match="body 'light' has no mass or no inertia, which MuJoCo does not take"):
        mbd.write_mjcf(mbd.Mechanism([light], [mbd.Weld("w", GROUND.at(0, 0), light.at(0, 0))]), tmp_path / "m.xml")
    with pytest.raises(mbd.ModelError, match="body 'world' has the name of the ground in MuJoCo; give it another one"):
        mbd.write_mjcf(mbd.Mechanism([mbd.Body("world", 1.0, 1.0)]), tmp_path / "m.xml")
    machine = arm(forces=lambda b, f, p: [mbd.EndStop("a", 0.7 - p.angle, LAW), mbd.EndStop("b", p.angle - 0.9, LAW)])
    with pytest.raises(mbd.ModelError, match="joint 'pin' has stops that overlap, the lower one at 0.9 and the upper"):
        mbd.write_mjcf(machine, tmp_path / "m.xml")
    with pytest.raises(mbd.MechanismError, match="expected a Mechanism, got 3"):
        mbd.write_mjcf(3, tmp_path / "m.xml")


def test_mujoco_computes_the_same(tmp_path):
    """Accelerations of MuJoCo itself, of a tree with springs and actuators."""
    mujoco = pytest.importorskip("mujoco", reason="mujoco is not installed (pip install .[robots])")
    machine = crane()
    machine = machine.replace(joints=[machine.joint(name) for name in ("elbow", "shoulder", "rail", "gear pin")])
    mbd.write_mjcf(machine, tmp_path / "m.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "m.xml"))
    data = mujoco.MjData(model)
    data.qpos[:] += np.random.default_rng(0).uniform(-0.3, 0.3, model.nq)
    data.qvel[:], data.ctrl[:] = np.random.default_rng(1).uniform(-1, 1, model.nv), (0.5, -0.3, 0.8)
    mujoco.mj_forward(model, data)
    names = [model.joint(k).name for k in range(model.njnt)]
    pairs = [coordinates(machine, name) for name in names]
    start = [each == value for values in (data.qpos, data.qvel) for each, value in
             zip([pair[int(values is data.qvel)] for pair in pairs], values, strict=True)]  # fmt: skip
    state = mbd.assemble(machine, start, inputs=dict(zip(machine.inputs, (0.5, -0.3, 0.8), strict=True)))
    assert [state[mbd.time_derivative(rate)] for _, rate in pairs] == pytest.approx(data.qacc, rel=1e-9, abs=1e-9)
