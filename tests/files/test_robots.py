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
        machine = mbd.read_mjcf(DATA / "walker.xml")
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


def test_a_robot_of_ros():
    """Links, frames, products of inertia, actuators and fixed links."""
    with pytest.warns(mbd.MechanismWarning, match="left out the limits of joint 'rail'.*the limits of joint 'elbow'"):
        machine = mbd.read_urdf(DATA / "arm.urdf")
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
        ('<composite type="rope"/>', "", "line 6: composite is not read in body; load the model in MuJoCo"),
        ('<geom type="mesh" mesh="m"/>', "", "line 6: geom is of the type 'mesh', whose mass is not computed"),
        ('<geom type="box" size="1 2"/>', "", "needs 3 positive numbers in size"),
        ('<geom size="big"/>', "", "has size = 'big', which are not finite numbers"),
        ('<geom class="x" size="1"/>', "", "is of the class 'x', which does not exist"),
        ("", '<tendon><fixed name="t"/></tendon>', "line 9: tendon is not read"),
        ("", '<equality><tendon tendon1="t"/></equality>', "tendon is not supported; connect, weld and joint are"),
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
        ('<body name="c" gravcomp="1"/>', "", "body 'c' has gravcomp = '1', which is not read"),
        ('<geom size="0.1" shellinertia="true"/>', "", "geom has shellinertia = 'true', which is not read"),
        ("", '<option><flag actuation="disable"/></option>', "flag has actuation = 'disable', which is not read"),
        ("", '<actuator><position joint="j" timeconst="1"/></actuator>', "position has timeconst = '1', which is not"),
        ("", '<equality><weld body1="arm" relpose="1 0 0 1 0 0 0"/></equality>', "weld has relpose = '1 0 0 1 0 0 0'"),
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
        (('type="continuous"', 'type="floating"'), "joint 'shoulder' is of the type 'floating'; planar are"),
        (('<child link="lower"/>', '<child link="arm"/>'), "line 47: joint 'elbow' names the link 'arm'"),
        (('<child link="lower"/>', '<child link="upper"/>'), "moves the link 'upper', which another joint moves"),
        (('<parent link="world"/>', '<parent link="tool"/>'), "belongs to a ring of joints"),
        (('mass value="2"', 'mass value="-2"'), "must be at least 0"),
        (('xyz="0.2 0 0"', 'xyz="0.2 0"'), "which are not finite numbers (3)"),
        (("<robot", "<!DOCTYPE r [<!ENTITY x 'y'>]><robot"), "declarations of entities are not read"),
        (('<link name="world"/>', '<link name="world"/><xacro:include/>'), "xacro:include is a macro; expand the file"),
        (('<link name="world"/>', '<link name="world"/><loop_joint name="l"/>'), "loop_joint 'l' is not known"),
        (("<robot", "<model"), "not valid XML"),
    ],
)
def test_wrong_robots(change, words, tmp_path):
    text = (DATA / "arm.urdf").read_text()
    assert change[0] in text
    with pytest.raises(mbd.FileError) as caught:
        read(tmp_path / "r.urdf", text.replace(*change, 1), mbd.read_urdf)
    assert words in str(caught.value), caught.value


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
    assert "degrees of freedom  3" in said and "note: arm.urdf: left out the limits of joint 'rail'" in said
