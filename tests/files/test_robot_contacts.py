"""Contacts, limits, dry friction and force ranges of MuJoCo's files; rest poses against MuJoCo 4.0."""

import numpy as np
import pytest

import mbdcasadi as mbd

BASE = """<joint name="x" type="slide" axis="1 0 0"/><joint name="z" type="slide" axis="0 0 1"/>
  <joint name="turn" axis="0 1 0"/>"""
BALL = f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1"/>
  <body name="ball" pos="0 0 0.1">{BASE}<geom name="g" size="0.1"/></body>{{}}</worldbody>{{}}</mujoco>"""
LEG = f"""<mujoco><worldbody><geom name="floor" type="plane" size="1 1 1" conaffinity="1"/>
  <body name="thigh" pos="0 0 0.9">{BASE}<geom name="upper" type="capsule" size="0.05" fromto="0 0 0 0.1 0 -0.4"/>
  <body name="shank" pos="0.1 0 -0.4"><joint name="knee" axis="0 1 0" range="0 100" damping="2"/>
  <geom name="lower" type="capsule" size="0.04" fromto="0 0 0 -0.1 0 -0.4"/>
  <body name="foot" pos="-0.1 0 -0.4"><joint name="ankle" axis="0 1 0" range="-40 20" damping="1" frictionloss="0.1"/>
  <geom name="sole" type="capsule" size="0.04" fromto="-0.05 0 0 0.15 0 0"/></body></body></body>
  </worldbody></mujoco>"""
ARM = """<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="j" axis="0 -1 0" {}/>
  <geom size="0.1" mass="2" pos="1 0 0"/></body></worldbody>{}</mujoco>"""
#: radius of gyration of the arm about its hinge, m
GYRATION = np.sqrt(1 + 0.4 * 0.1**2)


def read(path, text, **options):
    (path / "m.xml").write_text(text)
    return mbd.read_mjcf(path / "m.xml", **options)


def contacts_of(machine):
    return [force.name for force in machine.forces if isinstance(force, mbd.Contact)]


def test_a_ball_lies_on_its_floor(tmp_path):
    """It yields by 1 % of its radius under its weight, and slides with the greater coefficient of the two."""
    machine = read(tmp_path, BALL.replace('name="g"', 'name="g" friction="0.3"').format("", ""))
    assert contacts_of(machine) == ["g on floor"]
    floor, ball = machine.force("g on floor"), machine.bodies[0]
    pose = [ball.x == 0, ball.y == 0.1 - 0.01 * 0.1, ball.phi == 0]
    state = mbd.assemble(machine, [*pose, ball.vx == 2, ball.vy == 0, ball.omega == 0])
    assert state[ball.ay] == pytest.approx(0, abs=1e-9)
    assert state[ball.ax] == pytest.approx(-9.81, rel=1e-9)
    assert state[floor.normal_force] == pytest.approx(4 / 3 * np.pi * 0.1**3 * 1000 * 9.81, rel=1e-9)
    moved = mbd.assemble(machine, [*pose, ball.vx == 0, ball.vy == -0.1, ball.omega == 0])
    # 1 + 2 v/√(g δ), the critical damping of the weight
    assert moved[ball.ay] == pytest.approx(9.81 * 2 * 0.1 / np.sqrt(9.81 * 0.001), rel=1e-9)


@pytest.mark.slow
def test_a_leg_falls_and_lies_as_in_mujoco(tmp_path):
    """A leg of three parts with limits of its joints comes to rest on its floor, at the place of MuJoCo."""
    machine = read(tmp_path, LEG)
    assert contacts_of(machine) == ["upper on floor", "lower on floor", "sole on floor", "upper on sole"]
    names = ("x", "z", "turn", "knee", "ankle")
    joints = [machine.joint(name) for name in names]
    q = [joint.angle if hasattr(joint, "angle") else joint.displacement for joint in joints]
    start = [a == b for a, b in zip(q, (0, -0.1, 0.5, 0.3, 0.0), strict=True)]
    run = mbd.simulate(machine, duration=2.0, initial=start)
    # the impacts are not the same, so that it slides by another 2 cm; the pose is that of MuJoCo
    assert run.final[q[0]] == pytest.approx(0.393, abs=0.04)
    assert run.final[q[1]] == pytest.approx(-0.761, abs=0.005)
    assert [run.final[each] for each in q[2:]] == pytest.approx([1.598, -0.003, -0.677], abs=0.03)
    assert max(abs(run.final[mbd.time_derivative(each)]) for each in q) < 0.01
    with pytest.warns(mbd.MechanismWarning, match="left out the range of joint 'knee'.*the dry friction of joint 'ank"):
        smooth = read(tmp_path, LEG, contacts=False)
    assert not any(isinstance(force, mbd.Contact | mbd.EndStop) for force in smooth.forces)


def test_limits_and_dry_friction_of_a_joint(tmp_path):
    """A stop yields by 1 % of a radian under the weight at the radius of gyration; friction is as large as given."""
    machine = read(tmp_path, ARM.format('range="-0.3 0.5" ref="0.1" frictionloss="3"', ""))
    joint, (low, high) = machine.joint("j"), [machine.force(f"j {side} stop") for side in ("lower", "upper")]
    state = mbd.assemble(machine, [joint.angle == -0.31, joint.angular_velocity == 0])
    assert state[low.force] == pytest.approx(2 * 9.81 * GYRATION, rel=1e-9)
    assert (state[low.gap], state[high.gap], state[high.force]) == pytest.approx((-0.01, 0.81, 0), abs=1e-12)
    moved = mbd.assemble(machine, [joint.angle == 0.51, joint.angular_velocity == 0.2])
    factor = 1 + 2 / np.sqrt(9.81 * 0.01 * GYRATION) * GYRATION * 0.2
    assert moved[high.force] == pytest.approx(2 * 9.81 * GYRATION * factor, rel=1e-9)
    turning = mbd.assemble(machine, [joint.angle == 0.1, joint.angular_velocity == 4])
    assert turning[machine.force("j friction").torque] == pytest.approx(-3, rel=1e-9)
    creep = 0.01 * np.sqrt(9.81 / GYRATION)
    slow = mbd.assemble(machine, [joint.angle == 0.1, joint.angular_velocity == creep])
    assert slow[machine.force("j friction").torque] == pytest.approx(-3 * np.tanh(1), rel=1e-9)


def test_limits_of_slides(tmp_path):
    """A slide yields by 1 % of the radius of gyration about the centre of mass."""
    text = ARM.replace('axis="0 -1 0"', 'axis="1 0 0" type="slide"').format('range="-0.3 0.5" frictionloss="3"', "")
    machine = read(tmp_path, text)
    joint, radius = machine.joint("j"), np.sqrt(0.4) * 0.1
    at = [joint.displacement == -0.3 - 0.01 * radius, joint.speed == -1]
    assert mbd.assemble(machine, at)[machine.force("j friction").force] == pytest.approx(3, rel=1e-9)
    resting = mbd.assemble(machine, [at[0], joint.speed == 0])
    assert resting[machine.force("j lower stop").force] == pytest.approx(2 * 9.81, rel=1e-9)


def test_ranges_of_forces(tmp_path):
    """A motor is limited by its input, a servo by its force; the range of a joint holds after the gear."""
    motors = """<actuator><general name="u" joint="j" gear="2" gainprm="5" ctrlrange="-1 1" forcerange="-4 10"/>
      </actuator>"""
    (drive,) = read(tmp_path, ARM.format('actuatorfrcrange="-20 6"', motors)).inputs
    assert (drive.lower, drive.upper) == pytest.approx((-0.8, 0.6))
    servo = motors.replace("general", "position").replace('gainprm="5"', 'kp="50"')
    machine = read(tmp_path, ARM.format('actuatorfrcrange="-20 6"', servo))
    ((_, force),), (drive,), joint = machine.force("u").virtual_work, machine.inputs, machine.joint("j")
    for angle, known in ((1.0, -8), (-1.0, 6), (0.01, 2 * 50 * -0.02)):
        state = mbd.assemble(machine, [joint.angle == angle], inputs={drive: 0})
        assert state[force] == pytest.approx(known, rel=1e-9)
    both = motors.replace("</actuator>", '<motor name="v" joint="j"/></actuator>')
    with pytest.warns(mbd.MechanismWarning, match="the range of the sum of the forces of actuators on joint 'j'"):
        read(tmp_path, ARM.format('actuatorfrcrange="-20 6"', both))
    with pytest.raises(mbd.FileError, match="'u' has ranges of its input and its force that have nothing in common"):
        read(tmp_path, ARM.format("", motors.replace("-4 10", "6 10")))
    with pytest.raises(mbd.FileError, match="'j' has range = '1 0', of which the first must be below the second"):
        read(tmp_path, ARM.format('range="1 0"', ""))


OTHER = '<body name="other" pos="0 {} 0.5"><joint axis="0 1 0"/><geom name="h" {}/></body>'


@pytest.mark.parametrize(
    ("beside", "geom", "more", "names"),
    [
        (0, 'size="0.1"', "", ["g on floor", "h on floor", "g on h"]),
        (0.19, 'size="0.1"', "", ["g on floor", "h on floor", "g on h"]),
        (0.21, 'size="0.1"', "", ["g on floor", "h on floor"]),
        (0.21, 'type="box" size=".1 .2 .3"', "", ["g on floor", "h on floor", "g on h"]),
        (0.31, 'type="capsule" size="0.1 0.12" zaxis="0 1 0"', "", ["g on floor", "h on floor", "g on h"]),
        (0, 'type="cylinder" size="0.1 0.12"', "", ["g on floor", "h on floor", "g on h"]),
        (0, 'size="0.1" contype="2" conaffinity="2"', "", ["g on floor"]),
        (0, 'size="0.1" contype="2" conaffinity="1"', "", ["g on floor", "h on floor", "g on h"]),
        (0, 'size="0.1"', '<exclude body1="ball" body2="other"/>', ["g on floor", "h on floor"]),
        (0, 'size="0.1" contype="0" conaffinity="0"', '<pair geom1="h" geom2="g"/>', ["g on floor", "h on g"]),
    ],
)
def test_which_geoms_touch(beside, geom, more, names, tmp_path):
    """Bits, exclusions, pairs, and solids that pass beside each other."""
    machine = read(tmp_path, BALL.format(OTHER.format(beside, geom), f"<contact>{more}</contact>"))
    assert sorted(contacts_of(machine)) == sorted(names)


def test_balls_beside_each_other(tmp_path):
    """Two balls at a distance across the plane touch at that of their centres in space."""
    machine = read(tmp_path, BALL.format(OTHER.format(0.12, 'size="0.1"'), ""))
    ball = machine.bodies[0]
    state = mbd.assemble(machine, [ball.x == 0.16 + 0.05, ball.y == 0.5])
    assert state[machine.force("g on h").gap] == pytest.approx(0.05, abs=1e-9)


def test_walls_and_geoms_that_are_not_known(tmp_path):
    """A plane may be oblique in the plane of the motion; other geoms are named."""
    machine = read(tmp_path, BALL.replace('size="1 1 1"', 'size="1 1 1" zaxis="-1 0 1"').format("", ""))
    ball = machine.bodies[0]
    state = mbd.assemble(machine, [ball.x == 0.2, ball.y == 0.7])
    assert state[machine.force("g on floor").gap] == pytest.approx(0.5 / np.sqrt(2) - 0.1, abs=1e-9)
    with pytest.warns(mbd.MechanismWarning, match=r"the contacts of 'h' \(ellipsoid\), of which the outline"):
        read(tmp_path, BALL.format(OTHER.format(0, 'type="ellipsoid" size="0.1 0.2 0.3"'), ""))
    with pytest.warns(mbd.MechanismWarning, match="the contacts of 'floor'"):
        read(tmp_path, BALL.replace('size="1 1 1"', 'size="1 1 1" zaxis="0 1 1"').format("", ""))


def test_geoms_without_names(tmp_path):
    """They are counted in each body, and do not change the names of others."""
    text = BALL.replace(' name="g"', "").replace(' name="floor"', "").format('<body><geom size="0.01"/></body>', "")
    assert contacts_of(read(tmp_path, text)) == ["ball geom 1 on world geom 1", "ball geom 1 on body 2 geom 1"]


def test_neighbours_and_priorities(tmp_path):
    """A body does not touch the one that carries it, unless a flag says so; the greater priority has the friction."""
    child = '<body name="c" pos="0 0 0.15"><joint axis="0 1 0"/><geom name="h" size="0.1" priority="1" friction="0.2"/>'
    text = BALL.format("", "").replace("</body>", child + "</body></body>")
    assert contacts_of(read(tmp_path, text)) == ["g on floor", "h on floor"]
    text = text.replace("<worldbody>", '<option><flag filterparent="disable"/></option><worldbody>')
    machine = read(tmp_path, text)
    assert contacts_of(machine) == ["g on floor", "h on floor", "g on h"]
    coefficients = [machine.force(name).friction.coefficient for name in contacts_of(machine)]
    assert [float(each) for each in coefficients] == [1.0, 0.2, 0.2]
