"""Keyframes of MuJoCo as starts of analyses."""

import pytest

import mbdcasadi as mbd

CART = """<mujoco><worldbody><body name="cart"><joint name="x" type="slide" axis="1 0 0" ref="0.5"/>
  <geom type="box" size="0.1 0.1 0.1" contype="0"/><frame pos="0 0 0.1"><body name="a"><joint name="ja" axis="0 1 0"/>
  <geom size="0.1" contype="0" pos="0 0 1"/></body></frame>
  <body name="b"><joint name="jb" axis="0 -1 0"/><geom size="0.1" contype="0" pos="1 0 0"/></body></body></worldbody>
  <actuator><motor name="u" joint="x"/><motor name="w" joint="jb"/></actuator><keyframe>{}</keyframe></mujoco>"""


def read(folder, keys):
    path = folder / "m.xml"
    path.write_text(CART.format(keys))
    machine = mbd.read_mjcf(path)
    return machine, mbd.read_keyframes(path, machine)


def test_states_of_a_file(tmp_path):
    """Coordinates in the order of the file, frames in it; what is not given is that of the pose of the file."""
    keys = '<key name="home" time="2" qpos="0.1 0.2 -0.3" qvel="1 2 3" ctrl="4 5"/><key qvel="0 0 1"/>'
    machine, frames = read(tmp_path, keys)
    home = frames["home"]
    assert (list(frames), home.time, list(home.inputs.values())) == (["home", "key 2"], 2.0, [4.0, 5.0])
    x, a, b = (machine.joint(name) for name in ("x", "ja", "jb"))
    values = [x.displacement, a.angle, b.angle, x.speed, a.angular_velocity, b.angular_velocity]
    state = mbd.assemble(machine, home.initial, inputs=home.inputs)
    assert [state[each] for each in values] == pytest.approx([0.1, 0.2, -0.3, 1, 2, 3], abs=1e-12)
    assert [state[each] for each in machine.inputs] == [4.0, 5.0]
    state = mbd.assemble(machine, frames["key 2"].initial)
    assert [state[each] for each in values] == pytest.approx([0.5, 0, 0, 0, 0, 1], abs=1e-12)
    run = mbd.simulate(machine, duration=0.1, initial=home.initial, inputs=home.inputs)
    assert run[x.displacement][0] == pytest.approx(0.1)


def test_keyframes_that_are_wrong(tmp_path):
    """One sentence with the element, its line and the count."""
    for keys, words in (
        ('<key qpos="1 2"/>', r"line 5: key has qpos = '1 2', which are not 3 finite numbers"),
        ('<key ctrl="1"/>', r"key has ctrl = '1', which are not 2 finite numbers"),
        ('<key name="a"/><key name="a"/>', "key 'a' has the name of another keyframe"),
        ('<key mpos="1 2 3"/>', "key has mpos, which is not read"),
    ):
        with pytest.raises(mbd.FileError, match=words):
            read(tmp_path, keys)
    machine, _ = read(tmp_path, "")
    with pytest.raises(mbd.FileError, match="there is no joint 'x'.*the mechanism is not that of the file"):
        mbd.read_keyframes(tmp_path / "m.xml", mbd.library.four_bar().mechanism)
    with pytest.raises(mbd.FileError, match="has the actuator 'u', of which the mechanism has no input"):
        mbd.read_keyframes(tmp_path / "m.xml", machine.replace(inputs=[], forces=[]))
