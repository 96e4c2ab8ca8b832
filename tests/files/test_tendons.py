"""Spatial tendons; accelerations against those that MuJoCo 4.0 computes, and closed forms."""

import numpy as np
import pytest

import mbdcasadi as mbd

ARMS = """<mujoco><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
  <geom name="post" type="cylinder" size="0.12 0.05" pos="0.4 0.02 0.9" zaxis="0 1 0"/>
  <site name="wall" pos="0 0.1 1.2"/><site name="side" pos="0.4 0 1.3"/><site name="in" pos="0.4 0 0.95"/>
  <body name="a" pos="0 0 0.5"><joint name="ja" axis="0 -1 0" ref="0.2" springref="0.1"{}/>
    <geom size="0.1" mass="2" pos="0.5 0 0"/><geom name="ball" size="0.15" mass="0" pos="1 0 0.1"/>
    <site name="a1" pos="0.8 -0.1 0.3"/><site name="a2" pos="0.6 0 -0.1"/>
    <body name="b" pos="1 0 0"><joint name="jb" axis="0 1 0" armature="0.3"{}/><geom size="0.1" mass="1" pos="1 0 0"/>
      <site name="b1" pos="1 0 0.05"/><site name="b2" pos="0.4 0 -0.1"/></body></body>
  </worldbody><tendon>
  <spatial name="rope" stiffness="300" damping="4"{}><site site="wall"/><geom geom="post"{}/><site site="a1"/>
    <pulley divisor="2"/><site site="wall"/><site site="b1"/></spatial>
  <spatial name="band" stiffness="200"><site site="a2"/><geom geom="ball"/><site site="b2"/></spatial></tendon>
  <actuator><motor name="u" tendon="rope" gear="3"/></actuator></mujoco>"""
SIDE = ' sidesite="side"'
TUNED = ' springdamper="0.2 1.5"', ' springdamper="0.1 0.7"', ' springlength="0 0.9"', SIDE


def read(folder, text):
    path = folder / "m.xml"
    path.write_text(text)
    return mbd.read_mjcf(path)


@pytest.mark.parametrize(
    ("given", "first", "second"),
    [
        (("", "", "", ""), (-65.3341874725734, -82.1023519911165), (18.245096693914398, 4.529278309190797)),
        (
            ("", "", ' springlength="0.7"', SIDE),
            (227.66228992507433, 140.45037836944266),
            (183.04404882551106, 182.3083293463234),
        ),
        (TUNED, (132.95252340132518, -46.66124240949598), (184.76524358722767, 205.79946124610757)),
    ],
)
def test_tendons_of_two_arms(given, first, second, tmp_path):
    """Lengths across the plane, around a post and a ball, over a pulley, springs with play, joints tuned by times."""
    arms = read(tmp_path, ARMS.format(*given))
    joints, (drive,) = [arms.joint(name) for name in ("ja", "jb")], arms.inputs
    for at, rates, known in (((-0.03, 2.2), (0.5, -0.7), first), ((-1.0, -0.39), (1.0, 2.0), second)):
        conditions = [joint.angle == x for joint, x in zip(joints, at, strict=True)]
        conditions += [joint.angular_velocity == x for joint, x in zip(joints, rates, strict=True)]
        state = mbd.assemble(arms, conditions, inputs={drive: 0.7})
        found = [state[mbd.time_derivative(joint.angular_velocity)] for joint in joints]
        assert found == pytest.approx(known, rel=1e-9)


def test_a_string_that_holds_a_ball(tmp_path):
    """A limited length is a stop that yields by 1 % of it under the whole weight; none at the length zero."""
    text = """<mujoco><worldbody><site name="nail" pos="0 0 2"/><body name="ball" pos="0 0 1.8">
      <joint name="x" type="slide" axis="1 0 0" damping="9"/><joint name="z" type="slide" axis="0 0 1" damping="9"/>
      <geom size="0.05"/><site name="eye"/></body></worldbody>
      <tendon><spatial name="string" range="0 0.3"><site site="nail"/><site site="eye"/></spatial></tendon></mujoco>"""
    machine = read(tmp_path, text)
    names = [force.name for force in machine.forces if isinstance(force, mbd.EndStop)]
    assert names == ["tendon string upper stop"]
    ball, stop = machine.bodies[0], machine.force("tendon string upper stop")
    state = mbd.assemble(machine, [ball.x == 0, ball.y == 2 - 0.303])
    assert state[stop.force] == pytest.approx(ball.mass * 9.81)
    assert state[machine.joint("z").speed] == 0 and state[ball.ay] == pytest.approx(0, abs=1e-9)


def test_a_tendon_that_cannot_move(tmp_path):
    """Between places of the world its limits and its play hold nothing, in MuJoCo too."""
    text = """<mujoco><worldbody><site name="a"/><site name="b" pos="1 0 0"/><body name="ball"><geom size="0.05"/>
      <joint name="z" type="slide" axis="0 0 1"/></body></worldbody><tendon><spatial name="t" stiffness="9" {}>
      <site site="a"/><site site="b"/></spatial></tendon></mujoco>"""
    for given in ('springlength="0.2 0.5"', 'range="0 0.5"'):
        machine = read(tmp_path, text.format(given))
        assert mbd.assemble(machine)[machine.bodies[0].ay] == pytest.approx(-9.81)


def test_an_end_inside_of_what_is_wrapped(tmp_path):
    """The way round a post, in closed form; straight while the end is inside the post."""
    text = """<mujoco><default><geom contype="0"/></default><worldbody>
      <geom name="post" type="cylinder" size="0.3 0.1" zaxis="0 1 0"/><site name="nail" pos="-0.5 0 0"/>
      <body name="m" pos="0.5 0 0"><joint name="x" type="slide" axis="1 0 0"/><geom size="0.1"/><site name="eye"/>
      </body></worldbody><tendon><spatial name="t" stiffness="9"><site site="nail"/><geom geom="post"/>
      <site site="eye"/></spatial></tendon></mujoco>"""
    machine = read(tmp_path, text)
    ((length, _),) = machine.force("tendon t spring and damper").virtual_work
    x = machine.joint("x").displacement
    round_it = 2 * 0.4 + 0.3 * (np.pi - 2 * np.arccos(0.3 / 0.5))
    assert [mbd.assemble(machine, [x == at])[length] for at in (0, -0.4)] == pytest.approx([round_it, 0.6], rel=1e-12)


def test_a_side_is_kept_in_each_pose(tmp_path):
    """Above a post: straight beside it, the shorter way if that is above, else the longer one, as MuJoCo 4."""
    text = """<mujoco><default><geom contype="0"/></default><worldbody>
      <geom name="post" type="cylinder" size="0.3 0.1" zaxis="0 1 0"/><site name="nail" pos="-1 0 0"/>
      <site name="above" pos="0 0 0.5"/><body name="m"><joint name="j" axis="0 -1 0"/><geom size="0.1" mass="1"/>
      <site name="eye" pos="0.8 0 0"/></body></worldbody><tendon><spatial name="t" stiffness="9"><site site="nail"/>
      <geom geom="post" sidesite="above"/><site site="eye"/></spatial></tendon></mujoco>"""
    machine = read(tmp_path, text)
    ((length, _),) = machine.force("tendon t spring and damper").virtual_work
    free = np.sqrt(1 - 0.3**2) + np.sqrt(0.8**2 - 0.3**2) - 0.3 * (np.arccos(0.3) + np.arccos(0.3 / 0.8))
    for turn in np.radians([120, 30, -30, -60, -120]):
        eye = 0.8 * np.array([np.cos(turn), np.sin(turn)])
        known = np.hypot(*(eye - (-1, 0))) if abs(turn) > 2 else free + 0.3 * (np.pi - turn)
        assert mbd.assemble(machine, [machine.joint("j").angle == turn])[length] == pytest.approx(known, rel=1e-12)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ((SIDE, ' sidesite="in"'), "geom 'post' is what a tendon wraps, and runs inside of it, or has its side"),
        (('zaxis="0 1 0"', 'zaxis="1 0 0"'), "is none of those that are read: a cylinder across the plane"),
        (('<site site="wall"/><geom', "<geom"), "line 10: geom needs a site before it and one after it"),
        (('<pulley divisor="2"/>', '<geom geom="ball"/><pulley divisor="2"/>'), "pulley must be beside sites"),
        (('divisor="2"', 'divisor="0"'), "pulley must be beside sites, with a divisor above zero"),
        (('<site site="b2"/>', ""), "line 12: spatial 'band' must run from site to site"),
        (('<site site="b2"/>', '<site site="b3"/>'), "names the site 'b3', which does not exist"),
        (('stiffness="200"', 'armature="2"'), "spatial 'band' has armature = '2', which is not read"),
        (('stiffness="200"', 'springlength="2 1"'), "has springlength = '2 1', of which the first is greater"),
    ],
)
def test_tendons_that_are_not_read(change, words, tmp_path):
    """One sentence with the element and its line."""
    with pytest.raises(mbd.FileError) as caught:
        read(tmp_path, ARMS.format("", "", "", SIDE).replace(*change))
    assert words in str(caught.value)
