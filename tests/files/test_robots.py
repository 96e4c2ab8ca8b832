"""Models of MuJoCo and of ROS as planar mechanisms; accelerations against those that MuJoCo 4.0 computes."""

from pathlib import Path

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.__main__ import main

DATA = Path(__file__).parent / "data"


def read(path, text, reader=mbd.read_mjcf):
    path.write_text(text)
    return reader(path)


def coordinate_of(joint):
    """The coordinate of a joint of a file, by its kind."""
    return joint.angle if hasattr(joint, "angle") else joint.displacement


def test_a_closed_loop_of_mujoco():
    """Masses of all kinds of geoms, frames in all ways, a loop by connect: velocities and accelerations."""
    machine = mbd.read_mjcf(DATA / "four_bar.xml")
    assert [body.name for body in machine.bodies] == ["crank", "coupler", "rocker"]
    assert [joint.name for joint in machine.joints] == ["O2", "A", "O4", "B"]
    crank, coupler, rocker = machine.bodies
    assert crank.mass == pytest.approx(0.56967545) and coupler.mass == pytest.approx(0.8 + 0.6272566)
    assert rocker.pose_estimate[:2] == pytest.approx([0.47488156, 0.19869803])
    (drive,) = machine.inputs
    assert (drive.label, drive.lower, drive.upper) == ("drive", -1, 1)
    # the plane is seen against the y axis: a turn about +y goes clockwise
    state = mbd.assemble(machine, [crank.phi == 0, crank.omega == -3], inputs={drive: 0.4})
    turns = [-state[crank.omega], state[coupler.omega] - state[crank.omega], -state[rocker.omega]]
    assert turns == pytest.approx([3.0, 3.442100383674119, 1.4003281838444988])
    rates = [-state[crank.alpha], state[coupler.alpha] - state[crank.alpha], -state[rocker.alpha]]
    assert rates == pytest.approx([74.93595347393192, 91.00904104147537, 26.044652391922856], rel=1e-6)
    assert mbd.check(machine).degrees_of_freedom == 1


def test_a_walker_of_mujoco():
    """Slides and hinges on one body, references, springs, dampers and servos."""
    with pytest.warns(mbd.MechanismWarning, match="walker.xml: left out the contacts of geoms"):
        machine = mbd.read_mjcf(DATA / "walker.xml", contacts=False)
    trunk, thigh, foot = machine.bodies
    places = {trunk: [0.3, 0.9], thigh: [0.09014312, 0.4739834], foot: [0.02332972, 0.2869392]}
    names = ("root x", "root z", "root turn", "hip", "shin", "ankle")
    q = [coordinate_of(machine.joint(name)) for name in names]
    v = [mbd.time_derivative(each) for each in q]
    at, rates = (0.3, -0.1, 0.2, 0.35, 0.05, -0.3), (0.5, -0.2, 1.1, -2.0, 0.3, 0.7)
    conditions = [a == b for a, b in zip([*q, *v], [*at, *rates], strict=True)]
    servo, other = machine.inputs
    state = mbd.assemble(machine, conditions, inputs={servo: 0.6, other: -0.2})
    for body, known in places.items():
        assert state[body.position] == pytest.approx(known, abs=1e-6)
    known = [0.6801006696629827, -14.39790322933175, -82.145218320224]
    known += [228.81674237991876, -91.68533385547202, 1018.9823524439263]
    assert [state[mbd.time_derivative(each)] for each in v] == pytest.approx(known, rel=1e-6)


def test_coordinates_of_a_file():
    """Oblique slides, hinges of both senses and references, includes and frames: accelerations in the file's terms."""
    machine = mbd.read_mjcf(DATA / "hopper.xml")
    names = ("root a", "root b", "root turn", "hip", "shin", "ankle")
    q = [coordinate_of(machine.joint(name)) for name in names]
    v = [mbd.time_derivative(each) for each in q]
    at = {"q": (0.5, -0.4, 0.4, -0.3, 0.12, 0.3), "v": (0.5, -0.2, 1.1, -2.0, 0.3, 0.7)}
    conditions = [a == b for a, b in zip([*q, *v], [*at["q"], *at["v"]], strict=True)]
    state = mbd.assemble(machine, conditions, inputs=dict(zip(machine.inputs, (0.6, -0.2, 0.4), strict=True)))
    known = [2.7635791860983274, -2.262787029609449, 55.53117563863138]
    known += [283.5010063439173, -102.41963180021938, 1520.9079189364352]
    assert [state[mbd.time_derivative(each)] for each in v] == pytest.approx(known, rel=1e-7)
    assert [body.mass for body in machine.bodies[:3]] == pytest.approx([25.70485356, 2.27870187, 0.90477868])
    at_zero = mbd.assemble(machine)  # the pose of the file
    assert [at_zero[each] for each in q] == pytest.approx([0.4, -0.2, 0.1, 0.1, 0.07, -0.3], abs=1e-12)


@pytest.mark.parametrize("sense", [1, -1])
def test_a_servo_on_a_hinge_of_either_sense(sense, tmp_path):
    """A control law on the angle of the file, with the motor of the file, is stable: I a = -k (a - 0.3) - d a'."""
    text = MJCF.format("", '<option gravity="0 0 0"/><actuator><motor name="u" joint="j"/></actuator>')
    machine = read(tmp_path / "m.xml", text.replace('axis="0 1 0"', f'axis="0 {sense} 0"'))
    (drive,), joint = machine.inputs, machine.joint("j")
    inertia = 4 / 3 * np.pi * 0.1**3 * 1000 * (1 + 0.4 * 0.1**2)
    law = -inertia * (9 * (joint.angle - 0.3) + 6 * joint.angular_velocity)
    run = mbd.simulate(machine, duration=1.0, inputs={drive: law})
    assert run.final[joint.angle] == pytest.approx(0.3 - 0.3 * (1 + 3) * np.exp(-3), rel=1e-5)  # critical damping


def test_a_planar_base_is_simulated(tmp_path):
    """A free flight: joints that constrain nothing have coordinates, and everything else works as before."""
    text = """<mujoco><worldbody><body name="b" pos="0 0 2">
      <joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1" ref="2"/>
      <joint name="turn" axis="0 1 0"/><geom size="0.1" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
    machine = read(tmp_path / "m.xml", text)
    x, z, turn = (machine.joint(name) for name in ("x", "z", "turn"))
    start = [x.displacement == 0, z.displacement == 2, turn.angle == 0, x.speed == 3, z.speed == 4]
    run = mbd.simulate(machine, duration=0.5, initial=[*start, turn.angular_velocity == 5])
    known = [1.5, 2 + 2 - 9.81 / 8, 2.5]
    assert [run.final[e] for e in (x.displacement, z.displacement, turn.angle)] == pytest.approx(known, rel=1e-6)
    assert mbd.check(machine).degrees_of_freedom == 3
    mbd.draw(run.final, forces=True)


def test_a_robot_of_ros():
    """Links, frames, products of inertia, actuators and fixed links."""
    with pytest.warns(mbd.MechanismWarning, match="left out the range of joint 'rail'.*the range of joint 'elbow'"):
        machine = mbd.read_urdf(DATA / "arm.urdf", contacts=False)
    assert [body.name for body in machine.bodies] == ["cart", "upper", "lower"]
    assert machine.bodies[2].mass == pytest.approx(1.1)
    shoulder, rail = machine.inputs
    assert (shoulder.label, shoulder.upper, rail.upper) == ("shoulder", np.inf, 50)
    cart, upper, lower = machine.bodies
    conditions = [cart.x == 0.1 + 0.2, upper.phi == 0.5, lower.phi - upper.phi == 0.7]
    conditions += [cart.vx == 0.4, upper.omega == -1.2, lower.omega - upper.omega == -2.0]
    state = mbd.assemble(machine, conditions, inputs={shoulder: 1.5, rail: 5.0})
    assert state[upper.position] == pytest.approx([0.479000833, 0.619966683])
    assert state[lower.position] == pytest.approx([0.81100931, 0.77688317])
    rates = [state[cart.ax], state[upper.alpha], state[lower.alpha - upper.alpha]]
    assert rates == pytest.approx([0.9447905660670994, -16.989637474864224, 11.962585657941348], rel=1e-6)


@pytest.mark.filterwarnings("ignore:arm.urdf")
def test_gravity_of_another_world():
    """Gravity along the normal of the plane does nothing; obliquely, its part in the plane counts."""
    flat = mbd.read_urdf(DATA / "arm.urdf", gravity=(0, -9.81, 0))
    assert not any(isinstance(force, mbd.Gravity) for force in flat.forces)
    oblique = mbd.read_urdf(DATA / "arm.urdf", gravity=(3, 5, -4))
    (weight,) = (force for force in oblique.forces if isinstance(force, mbd.Gravity))
    assert [float(weight.acceleration[k]) for k in range(2)] == pytest.approx([0, -5])


def test_couplings(tmp_path):
    """Coordinates of joints that follow others: by a polynomial, by mimic."""
    text = """<mujoco><compiler angle="radian"/><worldbody>
      <body name="a"><joint name="ja" axis="0 1 0" ref="0.2"/><geom type="sphere" size="0.1" pos="1 0 0"
        contype="0" conaffinity="0"/></body>
      <body name="b" pos="0 0 1"><joint name="jb" axis="0 -1 0"/><geom type="sphere" size="0.1" pos="1 0 0"
        contype="0" conaffinity="0"/></body>
      </worldbody><equality><joint joint1="jb" joint2="ja" polycoef="0 2 0.5 0 0"/></equality></mujoco>"""
    machine = read(tmp_path / "a.xml", text)
    a, b = machine.bodies
    state = mbd.assemble(machine, [a.phi == -0.4])  # ja is 0.6, 0.4 from its reference
    assert state[b.phi] == pytest.approx(2 * 0.4 + 0.5 * 0.4**2)
    inertial = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1"/><origin xyz="1 0 0"/></inertial>'
    text = f"""<robot name="two"><link name="base"/><link name="a">{inertial}</link><link name="b">{inertial}</link>
      <joint name="ja" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 -1 0"/></joint>
      <joint name="jb" type="continuous"><parent link="base"/><child link="b"/><axis xyz="0 -1 0"/>
        <mimic joint="ja" multiplier="-3" offset="0.1"/></joint></robot>"""
    machine = read(tmp_path / "a.urdf", text, mbd.read_urdf)
    a, b = machine.bodies
    assert mbd.assemble(machine, [a.phi == 0.3])[b.phi] == pytest.approx(-0.8)


MJCF = """<mujoco>
<worldbody>
<body name="arm">
<joint name="j" axis="0 1 0"/>
<geom type="sphere" size="0.1" pos="1 0 0" contype="0" conaffinity="0"/>
{}
</body>
</worldbody>
{}
</mujoco>"""


@pytest.mark.parametrize(
    ("inside", "outside", "words"),
    [
        (
            '<body name="c"><joint name="k" axis="1 0 0"/><geom size="0.1"/></body>',
            "",
            "line 6: joint 'k' turns about the axis (1, 0, 0), and 'j' about (0, 1, 0): the motion is not planar",
        ),
        (
            '<body name="c"><joint name="k" type="slide" axis="0 1 0.2"/><geom size="0.1"/></body>',
            "",
            "line 6: joint 'k' slides along (0, 0.9806, 0.1961), out of the plane",
        ),
        ('<body><freejoint name="f"/><geom size="1"/></body>', "", "freejoint 'f' is of the type 'free', which moves"),
        ('<body><joint type="ball"/><geom size="1"/></body>', "", "line 6: joint is of the type 'ball'"),
        ('<joint name="k" axis="0 1 0"/>', "", "joint 'k' is one joint too many between two bodies"),
        ('<joint name="k" type="slide" axis="1 0 0"/>', "", "joint 'k' slides on a body that turns first"),
        ('<composite type="rope"/>', "", "line 6: composite is not read in body"),
        ('<replicate count="2"/>', "", "line 6: replicate is not read in body; load the model in MuJoCo"),
        ('<geom type="mesh" mesh="m"/>', "", "line 6: geom is of the type 'mesh', whose mass is not computed"),
        ('<geom type="box" size="1 2"/>', "", "needs 3 positive numbers in size"),
        ('<geom size="big"/>', "", "has size = 'big', which are not finite numbers"),
        ('<geom class="x" size="1"/>', "", "is of the class 'x', which does not exist"),
        ("", '<tendon><spatial name="t"/></tendon>', "line 9: spatial 't' must run from site to site"),
        ("", '<equality><tendon tendon1="t"/></equality>', "tendon names the tendon 't', which does not exist"),
        ("", '<equality><flex flex="t"/></equality>', "flex is not supported; connect, weld, joint and tendon are"),
        ("", '<equality><connect body1="arm" body2="no" anchor="0 0 0"/></equality>', "names the body 'no'"),
        ("", '<equality><connect body1="arm" body2="arm" anchor="0 0 0"/></equality>', "connects a body with itself"),
        (
            "",
            '<actuator><muscle joint="j"/></actuator>',
            "muscle is not supported; motor, position, velocity and general are",
        ),
        ("", '<actuator><motor joint="no"/></actuator>', "motor names the joint 'no', which does not exist"),
        ("", '<actuator><general joint="j" dyntype="filter"/></actuator>', "has the dyntype 'filter'; it must be none"),
        ("", '<compiler boundmass="0.1"/>', "has boundmass = '0.1', which is not read; load the model in MuJoCo"),
        ('<geom size="0.1" shellinertia="true"/>', "", "geom has shellinertia = 'true', which is not read"),
        ("", '<option><flag actuation="disable"/></option>', "flag has actuation = 'disable', which is not read"),
        ("", '<actuator><position joint="j" timeconst="1"/></actuator>', "position has timeconst = '1', which is not"),
        ("", '<equality><weld body1="arm" relpose="1 0 0 1 0 0 0"/></equality>', "weld has relpose = '1 0 0 1 0 0 0'"),
        ("", '<compiler angle="Degree"/>', "compiler has angle = 'Degree', which must be degree or radian"),
        ("", '<option><flag gravity="off"/></option>', "flag has gravity = 'off', which must be enable or disable"),
        ('<joint type="revolute"/>', "", "joint has type = 'revolute', which must be hinge or slide or ball or free"),
        ('<joint limited="yes"/>', "", "joint has limited = 'yes', which must be auto or true or false"),
        ("", "<nonsense/>", "line 9: nonsense is not read in mujoco"),
        ('<body name="c" quat="0 0 0 0"/>', "", "body 'c' has a zero vector as quat"),
        ('<geom type="capsule" size="1" fromto="0 0 0 0 0 0"/>', "", "geom has a zero vector as fromto"),
        ("", '<compiler eulerseq="abc"/>', "has eulerseq = 'abc', which must be three of"),
        ("", "<worldbody>", "not valid XML in line 10"),
    ],
)
def test_what_is_not_planar_or_not_known(inside, outside, words, tmp_path):
    """One sentence with the element and its line."""
    with pytest.raises(mbd.FileError) as caught:
        read(tmp_path / "m.xml", MJCF.format(inside, outside))
    assert words in str(caught.value) and "m.xml" in str(caught.value)


def test_what_changes_the_inertia(tmp_path):
    """The armature of a hinge, a total mass and an actuator with a linear force, against the equation of a pendulum."""
    text = """<mujoco>
      <compiler angle="radian" settotalmass="3"/>
      <default><joint armature="0.7" damping="0.2"/></default>
      <option gravity="1e-5 0 -9.81"/>
      <worldbody>
        <body name="arm">
          <joint name="hip" axis="0 -1 0"/>
          <geom type="sphere" size="0.1" pos="0 0 -0.5" contype="0" conaffinity="0"/>
        </body>
      </worldbody>
      <actuator>
        <general name="hip" joint="hip" gear="2" gainprm="5" biastype="affine" biasprm="0.3 -4 -0.6"/>
      </actuator>
    </mujoco>"""
    machine = read(tmp_path / "m.xml", text)
    (drive,), arm = machine.inputs, machine.bodies[0]
    state = mbd.assemble(machine, [arm.phi == 0.4, arm.omega == 1.5], inputs={drive: 0.8})
    moment = 2 * (5 * 0.8 + 0.3 - 4 * 2 * 0.4 - 0.6 * 2 * 1.5) - 0.2 * 1.5
    moment += 3 * 0.5 * (1e-5 * np.cos(0.4) - 9.81 * np.sin(0.4))
    inertia = 3 * 0.5**2 + 0.4 * 3 * 0.1**2 + 0.7
    assert float(state[arm.alpha]) == pytest.approx(moment / inertia, rel=1e-10)
    assert state[arm.y] == pytest.approx(-0.5 * np.cos(0.4), abs=1e-12)
    assert sum(body.mass for body in machine.bodies) == pytest.approx(3)  # rotors are inertia alone
    acceleration = [state[arm.ax], state[arm.ay]]
    forces = [3 * (1e-5 - acceleration[0]), 3 * (-9.81 - acceleration[1])]
    np.testing.assert_allclose(state[mbd.shaking_force(machine).force], forces, rtol=1e-9)
    couple = 2 * (5 * 0.8 + 0.3 - 4 * 2 * 0.4 - 0.6 * 2 * 1.5)
    assert state[machine.force("hip general").forces] == pytest.approx(couple, rel=1e-12)


def test_repeated_sections(tmp_path):
    """Attributes of repeated elements add up, later ones of the same name count; flags too."""
    text = """<mujoco><compiler angle="radian"/><compiler meshdir="x"/><option gravity="0 0 -1"/>
      <option timestep="0.001"><flag spring="disable" damper="disable"/></option><option gravity="0 0 -1.62"/>
      <option><flag spring="enable"/></option><worldbody><body name="a"><joint name="j" axis="0 -1 0" stiffness="20"
      springref="0.5" damping="7"/><geom size="0.1" mass="2" pos="1 0 0" contype="0" conaffinity="0"/></body>
      </worldbody></mujoco>"""
    machine = read(tmp_path / "m.xml", text)
    joint = machine.joint("j")
    state = mbd.assemble(machine, [joint.angle == 0.2, joint.angular_velocity == 3])
    moment = 20 * (0.5 - 0.2) - 2 * 1.62 * np.cos(0.2)
    rate = mbd.time_derivative(joint.angular_velocity)
    assert state[rate] == pytest.approx(moment / (2 + 0.4 * 2 * 0.1**2), rel=1e-9)


@pytest.mark.parametrize(
    ("defaults", "known"),
    [
        # by default, and of motor, position, position kp="9", velocity, general, general biasprm="7"
        ('<motor gear="2"/>', [(1, 0, 0, 0), (1, 0, -1, 0), (9, 0, -9, 0), (1, 0, 0, -1), (1, 0, 0, 0), (1, 0, 0, 0)]),
        (
            '<position kp="4" kv="0.5"/>',
            [(1, 0, 0, 0), (4, 0, -4, -0.5), (9, 0, -9, -0.5), (1, 0, 0, -1), (4, 0, -4, -0.5), (4, 7, -4, -0.5)],
        ),
        (
            '<velocity kv="2"/>',
            [(1, 0, 0, 0), (1, 0, -1, 0), (9, 0, -9, 0), (2, 0, 0, -2), (2, 0, 0, -2), (2, 7, 0, -2)],
        ),
        (
            '<general gainprm="3" biastype="affine" biasprm=".1 -2"/>',
            [(1, 0, 0, 0), (3, 0, -3, 0), (9, 0, -9, 0), (3, 0, 0, -3), (3, 0.1, -2, 0), (3, 7, -2, 0)],
        ),
        (
            '<position kp="4" kv="0.5"/><general gainprm="6"/>',
            [(1, 0, 0, 0), (6, 0, -6, -0.5), (9, 0, -9, -0.5), (6, 0, 0, -6), (6, 0, -4, -0.5), (6, 7, -4, -0.5)],
        ),
        (
            '<position kp="5" kv="0.5"/><velocity/>',
            [(1, 0, 0, 0), (1, 0, -1, 0), (9, 0, -9, 0), (1, 0, 0, -1), (1, 0, 0, -1), (1, 7, 0, -1)],
        ),
    ],
)
def test_defaults_of_all_kinds_of_actuators(defaults, known, tmp_path):
    """Gain, and constant, stiffness and rate of the bias, in MuJoCo's actuator_gainprm and actuator_biasprm."""
    kinds = ("motor", "position", 'position kp="9"', "velocity", "general", 'general biasprm="7"')
    gear = 2 if "gear" in defaults else 1
    for kind, (gain, constant, stiffness, rate) in zip(kinds, known, strict=True):
        text = f"<default>{defaults}</default><actuator><{kind} name='u' joint='j'/></actuator>"
        machine = read(tmp_path / "m.xml", MJCF.format("", '<compiler angle="radian"/>' + text))
        joint, (drive,) = machine.joint("j"), machine.inputs
        ((_, force),) = machine.force("u").virtual_work
        state = mbd.assemble(machine, [joint.angle == 0.4, joint.angular_velocity == 1.5], inputs={drive: 0.8})
        bias = constant + stiffness * gear * 0.4 + rate * gear * 1.5
        assert state[force] == pytest.approx(gear * (gain * 0.8 + bias), rel=1e-12)


@pytest.mark.parametrize(
    ("geom", "mass"),
    [
        ('type="box" size="0.1 0.05" fromto="0 0 0 0.3 0 0.4"', 8 * 0.1 * 0.1 * 0.25 * 1000),
        ('type="box" size="0.1 0.05 0.7" fromto="0 0 0 0.3 0 0.4"', 8 * 0.1 * 0.1 * 0.25 * 1000),
        ('type="ellipsoid" size="0.1 0.2" fromto="0 0 0 0.3 0 0.4"', 4 / 3 * np.pi * 0.1 * 0.1 * 0.25 * 1000),
        ('type="cylinder" size="0.1 0.2" fromto="0 0 0 0.3 0 0.4"', np.pi * 0.1**2 * 0.5 * 1000),
    ],
)
def test_solids_between_two_points(geom, mass, tmp_path):
    """The first number of size is the half width across both axes, and the points give the length."""
    text = MJCF.format("", "").replace('type="sphere" size="0.1" pos="1 0 0"', geom)
    assert read(tmp_path / "m.xml", text).bodies[0].mass == pytest.approx(mass, rel=1e-12)


FOUR_BAR = """<mujoco><worldbody><body name="crank"><joint name="A" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 .1 0 .1" size=".01" {free}/><body name="coupler" pos=".1 0 .1">
  <joint name="B" axis="0 1 0"/><geom type="capsule" fromto="0 0 0 .3 0 .1" size=".01" {free}/></body></body>
  <body name="rocker" pos=".4 0 0"><joint name="D" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0 0 .2" size=".01" {free}/></body></worldbody>
  <equality><weld name="C" body1="coupler" body2="rocker" anchor="0 0 .2" {more}/></equality></mujoco>"""


def test_welds_that_hold_a_point_and_soft_ones(tmp_path):
    """Without a couple a weld is a pin, at a point of the second body; a softness that is left out is named."""
    free = 'contype="0" conaffinity="0"'
    rigid = read(tmp_path / "m.xml", FOUR_BAR.format(free=free, more=""))
    assert mbd.check(rigid).degrees_of_freedom == 0
    pinned = read(tmp_path / "m.xml", FOUR_BAR.format(free=free, more='torquescale="0" solref="0.02" solimp="0.9"'))
    assert mbd.check(pinned).degrees_of_freedom == 1
    state = mbd.assemble(pinned)
    assert state[pinned.joint("C").a.position] == pytest.approx([0.4, 0.2], abs=1e-12)
    named = FOUR_BAR.replace('name="C"', 'name="A"')
    with pytest.warns(
        mbd.MechanismWarning, match=r"the softness \(solref, solimp\) of weld 'A weld', which holds exactly"
    ):
        read(tmp_path / "m.xml", named.format(free=free, more='solref="-100 -5" solimp="0.5"'))
    off = FOUR_BAR.replace("<worldbody>", '<option><flag equality="disable"/></option><worldbody>')
    assert mbd.check(read(tmp_path / "m.xml", off.format(free=free, more=""))).degrees_of_freedom == 3


def test_sites_that_are_connected(tmp_path):
    """A loop by sites, one of them in a frame; a site between two points has no place that is read."""
    sites = '<frame pos="0 0 0.1"><site name="s" pos="0 0 0.1"/></frame></body></worldbody>'
    text = FOUR_BAR.format(free='contype="0" conaffinity="0"', more="").replace("</body></worldbody>", sites)
    text = text.replace("<worldbody>", '<worldbody><site name="w" pos=".4 0 .2"/>')
    text = text.replace(
        '<weld name="C" body1="coupler" body2="rocker" anchor="0 0 .2" ', '<connect site1="s" site2="w"'
    )
    assert mbd.check(read(tmp_path / "m.xml", text)).degrees_of_freedom == 2
    with pytest.raises(mbd.FileError, match="site 's' has fromto = '0 0 0 0 0 .2', which is not read"):
        read(tmp_path / "m.xml", text.replace('pos="0 0 0.1"/>', 'fromto="0 0 0 0 0 .2"/>'))


def test_what_is_left_out_of_mjcf_is_named(tmp_path):
    """Contact pairs without contacts of their geoms, bodies that programs move; nothing that a flag turns off."""
    text = MJCF.format(
        '<body name="hand" mocap="true"><geom name="h" size="1" mass="0" contype="0" conaffinity="0"/></body>'
        '<geom name="g" size="1" mass="0" contype="0" conaffinity="0"/>',
        '<contact><pair geom1="g" geom2="h"/><exclude body1="a" body2="b"/></contact>{}',
    )
    path = tmp_path / "m.xml"
    path.write_text(text.format(""))
    with pytest.warns(
        mbd.MechanismWarning, match=r"body 'hand' by a program \(mocap\); the contact pair of 'g' and 'h'$"
    ):
        mbd.read_mjcf(path, contacts=False)
    text = text.replace(' mocap="true"', "").replace('<joint name="j"', '<joint range="0 1" frictionloss="1" name="j"')
    for flags in ('contact="disable" limit="disable" frictionloss="disable"', 'constraint="disable"'):
        read(tmp_path / "m.xml", text.format(f"<option><flag {flags}/></option>"))  # without a warning


def test_files_that_include_each_other(tmp_path):
    """A file is included once, and a missing one is named."""
    (tmp_path / "part.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(
        mbd.FileError, match=r"part.xml, line 1: include includes 'part.xml', which is included already"
    ):
        read(tmp_path / "m.xml", MJCF.format("", '<include file="part.xml"/>'))
    with pytest.raises(mbd.FileError, match="other.xml: the file cannot be read"):
        read(tmp_path / "m.xml", MJCF.format("", '<include file="other.xml"/>'))


def test_actuators_without_names(tmp_path):
    """Several on one joint have numbers, and their forces add up."""
    motors = '<actuator><motor joint="j"/><motor joint="j"/></actuator>'
    machine = read(tmp_path / "m.xml", MJCF.format("", motors))
    assert [drive.label for drive in machine.inputs] == ["j motor", "j motor 2"]
    alpha = machine.bodies[0].alpha
    first, second = (mbd.assemble(machine, inputs=dict(zip(machine.inputs, u, strict=True))) for u in ((1, 2), (3, 0)))
    assert first[alpha] == pytest.approx(second[alpha], rel=1e-12)


def test_flags_and_shared_defaults(tmp_path):
    """Forces that flags turn off, and defaults of one kind of actuator that are those of the others."""
    text = """<mujoco>
      <compiler angle="radian"/>
      <option density="1.2"><flag gravity="disable" spring="disable" contact="disable"/></option>
      <default><motor gear="2"/></default>
      <default><joint damping="0.5" stiffness="9"/></default>
      <worldbody>
        <body name="arm" gravcomp="0">
          <joint name="hip" axis="0 -1 0"/>
          <geom type="sphere" size="0.1" mass="3" pos="0 0 -0.5" contype="0" conaffinity="0"/>
        </body>
      </worldbody>
      <actuator><velocity name="drive" joint="hip" kv="4"/></actuator>
    </mujoco>"""
    with pytest.warns(mbd.MechanismWarning, match="left out the forces of a fluid"):
        machine = read(tmp_path / "m.xml", text)
    (drive,), arm = machine.inputs, machine.bodies[0]
    state = mbd.assemble(machine, [arm.phi == 0.4, arm.omega == 1.5], inputs={drive: 0.8})
    inertia = 3 * 0.5**2 + 0.4 * 3 * 0.1**2
    assert float(state[arm.alpha]) == pytest.approx((2 * 4 * (0.8 - 2 * 1.5) - 0.5 * 1.5) / inertia, rel=1e-10)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('axis xyz="0 0 1"', 'axis xyz="0 1 0"'), "joint 'elbow' turns about the axis"),
        (('type="continuous"', 'type="ball"'), "joint 'shoulder' is of the type 'ball'; planar are"),
        (('<child link="lower"/>', '<child link="arm"/>'), "line 47: joint 'elbow' names the link 'arm'"),
        (('<child link="lower"/>', '<child link="upper"/>'), "moves the link 'upper', which another joint moves"),
        (('<parent link="world"/>', '<parent link="tool"/>'), "belongs to a ring of joints"),
        (('mass value="2"', 'mass value="-2"'), "must be at least 0"),
        (('xyz="0.2 0 0"', 'xyz="0.2 0"'), "which are not 3 finite numbers"),
        (("<robot", "<!DOCTYPE r [<!ENTITY x 'y'>]><robot"), "declarations of entities are not read"),
        (('<link name="world"/>', '<link name="world"/><xacro:include/>'), "xacro:include is a macro; expand the file"),
        (('<link name="world"/>', '<link name="world"/><loop_joint name="l"/>'), "loop_joint 'l' is not known"),
        (("<robot", "<model"), "not valid XML"),
        (('type="continuous">', 'type="continuous"><mimic joint="shoulder"/>'), "r.urdf: constraint 'shoulder mimic'"),
    ],
)
def test_wrong_robots(change, words, tmp_path):
    text = (DATA / "arm.urdf").read_text()
    assert change[0] in text
    with pytest.raises(mbd.FileError) as caught:
        read(tmp_path / "r.urdf", text.replace(*change, 1), mbd.read_urdf)
    assert words in str(caught.value), caught.value


LINK = """<link name="{}"><inertial><origin xyz="0.5 0 0"/><mass value="1"/>
  <inertia ixx="1" iyy="0.1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
ARM = """<joint name="j" type="{kind}"><parent link="{parent}"/><child link="arm"/><axis xyz="{axis}"/>{more}</joint>"""


def robot(path, kind="continuous", parent="world", axis="0 1 0", more="", beside=""):
    arm = ARM.format(kind=kind, parent=parent, axis=axis, more=more)
    return read(path / "r.urdf", f'<robot name="r">{LINK.format("arm")}{arm}{beside}</robot>', mbd.read_urdf)


def test_the_world_of_urdf(tmp_path):
    """A parent that the file does not describe is the ground if it is the world."""
    machine = robot(tmp_path)
    rate = mbd.time_derivative(machine.joint("j").angular_velocity)  # about +y: gravity turns it down
    assert mbd.assemble(machine)[rate] == pytest.approx(9.81 * 0.5 / (0.1 + 0.25), rel=1e-10)
    with pytest.raises(mbd.FileError, match="joint 'j' names the link 'earth', which does not exist"):
        robot(tmp_path, parent="earth")


def test_planar_joints_of_urdf(tmp_path):
    """Slides along the axes of the frame, turned to the axis of the joint, and a hinge; only in the plane of others."""
    machine = robot(tmp_path, kind="planar")
    x, y, theta = (machine.joint(f"j/{name}") for name in ("x", "y", "theta"))
    arm = machine.bodies[0]
    state = mbd.assemble(machine, [x.displacement == 0.3, y.displacement == 0.2, theta.angle == 0.1])
    # the shortest turn from z to y brings y to -z; a turn about y is seen clockwise
    assert state[arm.position] == pytest.approx([0.3 + 0.5 * np.cos(0.1), -0.2 - 0.5 * np.sin(0.1)], abs=1e-12)
    assert mbd.check(machine).degrees_of_freedom == 3
    hand = LINK.format("hand") + ARM.format(kind="revolute", parent="arm", axis="1 0 0", more="")
    hand = hand.replace('child link="arm"', 'child link="hand"').replace('name="j"', 'name="wrist"')
    with pytest.raises(
        mbd.FileError, match=r"'wrist' turns about the axis \(1, 0, 0\), and 'j/theta' about \(0, 1, 0\)"
    ):
        robot(tmp_path, kind="planar", beside=hand)


def test_floating_joints_of_urdf(tmp_path):
    """A base that is free in space moves in the plane of the hinges of its robot, and falls freely."""
    hand = LINK.format("hand") + ARM.format(kind="continuous", parent="arm", axis="0 -1 0", more="")
    hand = hand.replace('child link="arm"', 'child link="hand"').replace('name="j"', 'name="wrist"')
    with pytest.warns(mbd.MechanismWarning, match="left out the motion of joint 'j' out of the plane"):
        machine = robot(tmp_path, kind="floating", beside=hand)
    x, z, theta = (machine.joint(f"j/{name}") for name in ("x", "z", "theta"))
    assert mbd.check(machine).degrees_of_freedom == 4
    state = mbd.assemble(machine, [x.displacement == 0.3, z.displacement == 0.2, theta.angle == 0.1])
    assert state[machine.bodies[0].position] == pytest.approx([0.3 + 0.5 * np.cos(0.1), 0.2 - 0.5 * np.sin(0.1)])
    assert state[machine.bodies[1].ay] == pytest.approx(-9.81, rel=1e-9)
    with pytest.warns(mbd.MechanismWarning, match="left out the motion of joint 'j' out of the plane"):
        alone = robot(tmp_path, kind="floating")  # in the plane of gravity and the x axis
    assert [joint.name for joint in alone.joints] == ["j/x", "j/z", "j/theta"]


@pytest.mark.parametrize(
    ("more", "beside", "words"),
    [
        ('<dynamics dampng="3"/>', "", r"attribute dampng of dynamics \(line 2\)"),
        ("<limits/>", "", r"limits of joint 'j' \(line 2\)"),
        ("", '<gazebo reference="j"><springStiffness>9</springStiffness></gazebo>', "springStiffness of gazebo 'j'"),
        (
            "",
            '<transmission name="t"><actuator name="m"><drake:rotor_inertias value="1"/></actuator></transmission>',
            "drake:rotor_inertias of actuator 'm'",
        ),
        (
            "",
            '<link name="a"><collision/></link><joint name="f" type="fixed" a="1"><parent link="arm"/><child link="a"/>'
            '</joint><link name="b"/><joint name="g" type="fixed" a="1"><parent link="arm"/><child link="b"/></joint>',
            r"attribute a of joint 'f' \(line 2\) and 1 more",
        ),
    ],
)
def test_what_is_left_out_of_urdf_is_named(more, beside, words, tmp_path):
    with pytest.warns(mbd.MechanismWarning, match="left out .*" + words):
        robot(tmp_path, more=more, beside=beside)


@pytest.mark.parametrize("wrap", ["body", "frame", "default"])
def test_deep_files(wrap, tmp_path):
    """Elements nested more deeply than Python calls itself."""
    depth = 3000
    if wrap == "default":
        classes = "".join(f'<default class="c{k}">' for k in range(depth)) + "</default>" * depth
        machine = read(tmp_path / "m.xml", MJCF.format("", f"<default>{classes}</default>"))
    else:
        inner = f'<{wrap} pos="0 0 0.001">' * depth + '<geom size="0.1" mass="2"/>' + f"</{wrap}>" * depth
        machine = read(tmp_path / "m.xml", MJCF.format(inner, ""))
        assert machine.bodies[0].mass == pytest.approx(2 + 4 / 3 * np.pi)
    assert len(machine.bodies) == 1


def test_a_long_chain_of_fixed_links(tmp_path):
    joint = '<joint name="j{0}" type="fixed"><parent link="{1}"/><child link="{0}"/></joint>'
    chain = "".join(LINK.format(f"l{k}") + joint.format(f"l{k}", f"l{k - 1}" if k else "arm") for k in range(1500))
    assert robot(tmp_path, beside=chain).bodies[0].mass == pytest.approx(1501)


def test_other_files(tmp_path):
    for gravity in ("down", (0, -9.81), (0, 0, np.nan), None):
        with pytest.raises(mbd.ModelError, match="gravity must be"):
            mbd.read_urdf(DATA / "arm.urdf", gravity=gravity)
    for reader, name in ((mbd.read_mjcf, "arm.urdf"), (mbd.read_urdf, "four_bar.xml")):
        with pytest.raises(mbd.FileError, match="the outermost element must be"):
            reader(DATA / name)
        with pytest.raises(mbd.FileError, match="cannot be read"):
            reader(tmp_path / "nothing")


def test_from_the_command_line(capsys):
    """The command line takes these files as well."""
    assert main(["check", str(DATA / "four_bar.xml")]) == 0
    assert "degrees of freedom  1" in capsys.readouterr().out
    assert main(["check", str(DATA / "arm.urdf")]) == 0
    said = capsys.readouterr().out
    assert "degrees of freedom  3" in said and "note" not in said


TENDON = """<mujoco><compiler angle="radian"/><worldbody>
  <body name="a"><joint name="ja" axis="0 -1 0" ref="0.2"/><geom size="0.1" mass="2" pos="0.5 0 0"/></body>
  <body name="b" pos="0 0 3" gravcomp="0.75"><joint name="jb" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/>
  </body></worldbody><tendon><fixed name="ja" stiffness="20" damping="0.3"{}>
  <joint joint="ja" coef="0.5"/><joint joint="jb" coef="-2"/></fixed></tendon>{}</mujoco>"""


def test_tendons_and_carried_weights(tmp_path):
    """The moment on each joint is its factor times the force of the tendon; a share of a weight is carried."""
    motor = '<actuator><motor name="u" tendon="ja" gear="3"/></actuator>'
    machine = read(tmp_path / "m.xml", TENDON.format(' springlength="0.4"', motor))
    (drive,), (a, b) = machine.inputs, (machine.joint(name) for name in ("ja", "jb"))
    at = [a.angle == 0.6, b.angle == -0.1, a.angular_velocity == 0.7, b.angular_velocity == 1.5]
    state = mbd.assemble(machine, at, inputs={drive: 0.8})
    pull = 3 * 0.8 - 20 * (0.5 * 0.6 + 2 * 0.1 - 0.4) - 0.3 * (0.5 * 0.7 - 2 * 1.5)
    rates = [state[mbd.time_derivative(each.angular_velocity)] for each in (a, b)]
    inertia = 0.4 * 0.1**2
    assert rates[0] == pytest.approx((0.5 * pull - 2 * 9.81 * 0.5 * np.cos(0.4)) / (2 * (0.25 + inertia)), rel=1e-9)
    assert rates[1] == pytest.approx((-2 * pull + 0.25 * 9.81 * np.cos(0.1)) / (1 + inertia), rel=1e-9)
    machine = read(tmp_path / "m.xml", TENDON.replace('axis="0 1 0"', 'axis="0 1 0" springref="0.3"').format("", ""))
    ((value, force),) = machine.force("tendon ja spring and damper").virtual_work
    free = mbd.assemble(machine, [value == -2 * 0.3])  # where the springs of the joints are free, as in MuJoCo
    assert free[force] == pytest.approx(0, abs=1e-9)


RATIOS = """<mujoco><compiler angle="radian"/><default><position dampratio="0.7"/></default><worldbody>
  <body name="a"><joint name="ja" axis="0 -1 0" ref="0.2" armature="0.1"/><geom size="0.1" mass="2" pos="0.5 0 0"/>
  <body name="b" pos="1 0 0"><joint name="jb" axis="0 1 0"/><geom size="0.1" mass="1" pos="1 0 0"/></body></body>
  </worldbody><tendon><fixed name="sum"><joint joint="ja" coef="0.5"/><joint joint="jb" coef="-2"/></fixed></tendon>
  <actuator><position name="u" joint="ja" kp="30" gear="3"/><position name="v" tendon="sum" kp="20" dampratio="1.2"
  gear="2"/><general name="w" joint="jb" gainprm="9" biastype="affine" biasprm="0 -9 0.4"/></actuator></mujoco>"""


def test_damping_ratios_of_servos(tmp_path):
    """Damping by the inertia of the coordinate in the pose of the file, as MuJoCo 4.0 has it."""
    machine = read(tmp_path / "m.xml", RATIOS)
    a, b = (machine.joint(name) for name in ("ja", "jb"))
    still = mbd.assemble(machine, [a.angle == 0, b.angle == 0])
    moving = mbd.assemble(machine, [a.angle == 0, b.angle == 0, a.angular_velocity == 2, b.angular_velocity == -1])
    for name, gear, rate, known in (
        ("u", 3, 2, -1.99957393),
        ("v", 2, 0.5 * 2 + 2 * 1, -1.09750745),
        ("w", 1, -1, -0.87599879),
    ):
        ((_, force),) = machine.force(name).virtual_work
        assert (moving[force] - still[force]) / (gear**2 * rate) == pytest.approx(known, rel=1e-7)
    with pytest.raises(mbd.FileError, match="position 'v' has both kv and dampratio; give one of them"):
        read(tmp_path / "m.xml", RATIOS.replace('dampratio="1.2"', 'dampratio="1.2" kv="1"'))


def test_tendons_that_are_coupled(tmp_path):
    """A sum of coordinates stays what it is in the pose of the file; ranges and dry friction are named."""
    equality = '<equality><tendon tendon1="ja" polycoef="0.3 0 0 0 0"/></equality>'
    with pytest.warns(mbd.MechanismWarning, match="left out the dry friction of tendon 'ja'"):
        machine = read(tmp_path / "m.xml", TENDON.format(' range="0 1" frictionloss="1"', equality))
    a, b = (machine.joint(name) for name in ("ja", "jb"))
    stops = [machine.force(f"tendon ja {side} stop") for side in ("lower", "upper")]
    softest = 3 * 9.81 * np.sqrt(1 + 0.4 * 0.1**2) / (0.01 * 2**2)  # that of jb, which yields by 1 % of its radius
    assert [float(stop.law.stiffness) for stop in stops] == pytest.approx([softest] * 2)
    assert mbd.assemble(machine, [a.angle == 0.4])[stops[1].gap] == pytest.approx(1 - 0.5 * 0.2 - 0.3)
    assert mbd.assemble(machine, [a.angle == 0.4])[b.angle] == pytest.approx((0.5 * (0.4 - 0.2) - 0.3) / 2, rel=1e-9)


def test_sites_that_are_connected_may_be_apart(tmp_path):
    """The loop closes, as in MuJoCo, which pulls them together; a distance across the plane is left out and said."""
    text = """<mujoco><worldbody><site name="nail" pos="0.6 {} 0.8"/><body name="a"><joint name="ja" axis="0 -1 0"/>
      <geom size="0.1"/><body name="b" pos="1 0 0"><joint name="jb" axis="0 -1 0"/><geom size="0.1" pos="0.5 0 0"/>
      <site name="tip" pos="0.5 0 0.1"/></body></body></worldbody>
      <equality><connect name="pin" site1="tip" site2="nail"/></equality></mujoco>"""
    path = tmp_path / "m.xml"
    path.write_text(text.format(0))
    machine = mbd.read_mjcf(path)
    state = mbd.assemble(machine)
    assert state[machine.body("b").at(0, 0.1).position] == pytest.approx([0.6, 0.8], abs=1e-9)
    path.write_text(text.format(0.2))
    with pytest.warns(mbd.MechanismWarning, match=r"left out the 0\.2 m across the plane between the ends of 'pin'"):
        mbd.read_mjcf(path)
