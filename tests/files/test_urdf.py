"""Contacts, limits, friction, actuators and loops of URDF, with the laws of the other formats."""

import warnings

import numpy as np
import pytest

import mbdcasadi as mbd

INERTIAL = """<inertial><origin xyz="0.5 0 0"/><mass value="2"/><inertia ixx="1" iyy="0.1" izz="1"/></inertial>"""
#: radius of gyration about the hinge, m
GYRATION = np.sqrt(0.25 + 0.05)


def link(name, more=""):
    return f'<link name="{name}">{INERTIAL}{more}</link>'


def joint(name, parent, child, more="", kind="revolute", place="0 0 0"):
    return f"""<joint name="{name}" type="{kind}"><origin xyz="{place}"/><parent link="{parent}"/>
      <child link="{child}"/><axis xyz="0 1 0"/>{more}</joint>"""


def read(path, text, **options):
    (path / "r.urdf").write_text(f'<robot name="r">{text}</robot>')
    return mbd.read_urdf(path / "r.urdf", **options)


def contacts_of(machine):
    return [force.name for force in machine.forces if isinstance(force, mbd.Contact)]


def test_limits_and_dry_friction_as_in_mjcf(tmp_path):
    """The same arm in both formats has the same stops and the same friction."""
    laws = '<dynamics damping="0.3" friction="1.5"/><limit lower="-0.3" upper="0.5" effort="9" velocity="2"/>'
    text = link("arm") + joint("j", "world", "arm", laws)
    (tmp_path / "m.xml").write_text("""<mujoco><compiler angle="radian"/><worldbody><body name="arm">
      <joint name="j" axis="0 1 0" damping="0.3" frictionloss="1.5" range="-0.3 0.5"/>
      <inertial mass="2" pos="0.5 0 0" diaginertia="1 0.1 1"/></body></worldbody></mujoco>""")
    machines = read(tmp_path, text), mbd.read_mjcf(tmp_path / "m.xml")
    for angle, rate in ((0.51, 0.2), (-0.31, -0.1), (0.1, 0.01)):
        values = []
        for machine in machines:
            j = machine.joint("j")
            state = mbd.assemble(machine, [j.angle == angle, j.angular_velocity == rate])
            forces = [state[machine.force(f"j {side} stop").force] for side in ("lower", "upper")]
            values.append([*forces, state[machine.force("j friction").torque], state[machine.bodies[0].alpha]])
        assert values[0] == pytest.approx(values[1], rel=1e-12)
        assert not angle > 0.5 or values[0][1] > 2 * 9.81 * GYRATION
    with pytest.warns(mbd.MechanismWarning, match=r"the range of joint 'j'.*the dry friction of joint 'j'"):
        smooth = read(tmp_path, text, contacts=False)
    assert not any(isinstance(force, mbd.EndStop) for force in smooth.forces)


def test_limits_that_hold_one_side_or_none(tmp_path):
    one = read(tmp_path, link("arm") + joint("j", "world", "arm", '<limit upper="0.5" effort="9" velocity="2"/>'))
    assert [force.name for force in one.forces if isinstance(force, mbd.EndStop)] == ["j upper stop"]
    free = link("arm") + joint("j", "world", "arm", '<limit lower="-1" upper="0.5"/>', "continuous")
    assert not any(isinstance(force, mbd.EndStop) for force in read(tmp_path, free).forces)
    with pytest.warns(mbd.MechanismWarning, match=r"limits of joint 'j', of which the lower one \(0\) is not below"):
        read(tmp_path, link("arm") + joint("j", "world", "arm", '<limit lower="0" upper="0"/>'))


FOOT = '<collision name="{}"><origin xyz="{} 0 0"/><geometry>{}</geometry>{}</collision>'
SPHERE, BOX = '<sphere radius="0.1"/>', '<box size="0.4 0.2 0.2"/>'


def test_contacts(tmp_path):
    """Solids touch, except of links that a joint holds together, and those that Drake's filters keep apart."""
    ground = '<link name="ground">' + FOOT.format("g", 0, '<box size="4 1 0.2"/>', "") + "</link>"
    text = ground + link("a", FOOT.format("c", 0.3, BOX, "")) + joint("j", "ground", "a", place="0 0 1")
    text += link(
        "b", FOOT.format("c", 0.3, SPHERE, "") + FOOT.format("d", 0.6, '<cylinder radius="0.1" length="0.2"/>', "")
    )
    text += joint("k", "a", "b", place="1 0 0")
    machine = read(tmp_path, text)
    assert contacts_of(machine) == ["ground on b c", "ground on b d"]
    j, k = machine.joint("j"), machine.joint("k")
    state = mbd.assemble(machine, [j.angle == np.pi / 2 - 0.9, k.angle == 0.9 - np.pi / 2])
    assert state[machine.force("ground on b c").gap] == pytest.approx(1 - np.cos(0.9) - 0.1 - 0.1, abs=1e-9)
    groups = """<drake:collision_filter_group name="g"><drake:member link="ground"/>
      <drake:ignored_collision_filter_group name="h"/></drake:collision_filter_group>
      <drake:collision_filter_group name="h"><drake:member link="b"/></drake:collision_filter_group>"""
    assert contacts_of(read(tmp_path, text + groups)) == []
    with pytest.warns(mbd.MechanismWarning, match=r"contacts of 'b d' \(mesh\), of which the outline"):
        read(tmp_path, text.replace('<cylinder radius="0.1" length="0.2"/>', '<mesh filename="x"/>'))
    with pytest.warns(mbd.MechanismWarning, match="left out the contacts of collisions"):
        assert contacts_of(read(tmp_path, text, contacts=False)) == []
    with pytest.raises(mbd.FileError, match="sphere has a negative size"):
        read(tmp_path, text.replace('radius="0.1"', 'radius="-1"', 1))


@pytest.mark.parametrize(
    ("inside", "beside", "coefficient"),
    [
        ("", "", 1.0),
        ("", '<gazebo reference="b"><mu1>0.3</mu1></gazebo>', 0.3),
        ("", '<gazebo reference="b"><mu>3</mu></gazebo>', 1.0),
        ('<contact><lateral_friction value="0.4"/></contact>', "", 0.4),
    ],
)
def test_the_smaller_friction_holds(inside, beside, coefficient, tmp_path):
    ground = '<link name="ground">' + FOOT.format("g", 0, BOX, "") + "</link>"
    text = ground + link("a") + joint("j", "ground", "a") + link("b", FOOT.format("c", 0, SPHERE, "") + inside)
    machine = read(tmp_path, text + joint("k", "a", "b", place="1 0 1") + beside)
    assert float(machine.force("ground on b").friction.coefficient) == coefficient
    drake = '<drake:proximity_properties><drake:mu_dynamic value="0.2"/></drake:proximity_properties>'
    own = read(
        tmp_path,
        (text + joint("k", "a", "b", place="1 0 1")).replace(SPHERE + "</geometry>", SPHERE + "</geometry>" + drake),
    )
    assert float(own.force("ground on b").friction.coefficient) == 0.2


def test_loops_of_gazebo(tmp_path):
    """A parallelogram whose last pin is a joint of SDF: closed form, with the inertia of all about the cranks."""
    loop = """<gazebo><joint name="C" type="revolute"><parent>rocker</parent><child>coupler</child>
      <pose>2 0 0 0 0 0</pose><axis><xyz>0 1 0</xyz><dynamics><damping>{}</damping></dynamics></axis>
      </joint></gazebo>"""
    text = link("base") + link("crank") + link("rocker") + link("coupler") + joint("A", "base", "crank")
    text += joint("B", "base", "rocker", place="2 0 0")
    text += joint("K", "crank", "coupler", place="0 0 1")
    text, turned = text + loop.format(0), text + loop.format(0.5).replace("2 0 0 0 0 0", "2 0 0 0 0 1")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        machine = read(tmp_path, text)
    assert mbd.check(machine).degrees_of_freedom == 1
    A, C = machine.joint("A"), machine.joint("C")
    state = mbd.assemble(machine, [A.angle == 0.3, A.angular_velocity == 0.8])
    assert state[C.angle] == pytest.approx(-0.3, abs=1e-9)
    # cranks about their pins, and the coupler moving with the pin at a distance of 1
    inertia = 2 * 2 * GYRATION**2 + 2 * 1**2
    moment = 9.81 * (2 * 2 * 0.5 * np.cos(0.3) + 2 * 1 * np.sin(0.3))
    assert state[mbd.time_derivative(A.angular_velocity)] == pytest.approx(moment / inertia, rel=1e-9)
    along = turned.replace("</xyz>", "</xyz><use_parent_model_frame>1</use_parent_model_frame>")
    damped = read(tmp_path, along)
    rate = mbd.time_derivative(damped.joint("A").angular_velocity)
    state = mbd.assemble(damped, [damped.joint("A").angle == 0.3, damped.joint("A").angular_velocity == 0.8])
    assert state[rate] == pytest.approx((moment - 0.5 * 0.8) / inertia, rel=1e-9)
    with pytest.raises(mbd.FileError, match="turns about the axis"):
        read(tmp_path, turned.replace("0 0 1</pose>", "1 0 0</pose>"))
    with pytest.raises(mbd.FileError, match="joint 'C' names 'lever', which does not exist"):
        read(tmp_path, text.replace("<parent>rocker", "<parent>lever"))


def test_actuators(tmp_path):
    """Joints of transmissions and of ros2_control have one input each; a rotor of Drake turns with its joint."""
    text = link("a") + joint("j", "world", "a", '<limit effort="7" velocity="1"/>') + link("b") + joint("k", "a", "b")
    control = """<ros2_control name="c" type="system"><joint name="j"><command_interface name="effort"/></joint>
      <joint name="k"><state_interface name="position"/></joint></ros2_control>"""
    transmission = """<transmission name="t"><joint name="{}"/><actuator name="m"><drake:rotor_inertia value="0.02"/>
      <drake:gear_ratio value="5"/></actuator></transmission>"""
    (drive,) = read(tmp_path, text + control).inputs
    assert (drive.label, drive.lower, drive.upper) == ("j", -7, 7)
    machine = read(tmp_path, text + control + transmission.format("j") + transmission.format("k"))
    assert [each.label for each in machine.inputs] == ["j", "k"]
    assert [body.inertia for body in machine.bodies[2:]] == [0.5, 0.5]
    with pytest.raises(mbd.FileError, match="joint 'n' names the joint 'n', which does not exist"):
        read(tmp_path, text + control.replace('name="j"', 'name="n"'))
    (tmp_path / "r.urdf").write_text(f'<!-- a --\n b -->\n <?xml version="1.0"?><robot name="r">{text}\n<leg/></robot>')
    with pytest.raises(mbd.FileError, match="line 6: leg is not known"):
        mbd.read_urdf(tmp_path / "r.urdf")
    fixed = text.replace('name="k" type="revolute"', 'name="k" type="fixed"')
    assert len(read(tmp_path, fixed + transmission.format("k")).inputs) == 0


def test_points_with_a_mass_and_axes_that_do_not_count(tmp_path):
    """A mass without an inertia is that of a point; fixed joints need no axis, and nothing follows them."""
    text = '<link name="a"><inertial><origin xyz="0.5 0 0"/><mass value="2"/></inertial></link>' + joint(
        "j", "world", "a"
    )
    tool = joint("t", "a", "tool", '<mimic joint="t"/>', "fixed").replace("0 1 0", "0 0 0")
    machine = read(tmp_path, text + link("tool").replace('value="2"', 'value="0"') + tool)
    rate = mbd.time_derivative(machine.joint("j").angular_velocity)
    state = mbd.assemble(machine, [machine.joint("j").angle == 0.0])
    assert state[rate] == pytest.approx(9.81 * 0.5 * 2 / (0.5 + 0.1), rel=1e-9)


def test_dampers_of_planar_joints(tmp_path):
    """Drake gives one for each coordinate."""
    text = link("a") + joint("j", "world", "a", '<dynamics damping="1 2 3"/>', "planar")
    machine = read(tmp_path, text, gravity=(0, 0, 0))
    x, y, turn = (machine.joint(f"j/{name}") for name in ("x", "y", "theta"))
    at = [x.displacement == 0, y.displacement == 0, turn.angle == 0, x.speed == 3, y.speed == 0]
    state = mbd.assemble(machine, [*at, turn.angular_velocity == 0])
    assert state[mbd.time_derivative(x.speed)] == pytest.approx(-1 * 3 / 2, rel=1e-9)
    with pytest.raises(mbd.FileError, match="has damping = '1 2 3', which are not 1 finite numbers"):
        read(tmp_path, text.replace("planar", "revolute"))


SPRING = """<drake:{0}><drake:{0}_body_A name="world"/><drake:{0}_p_AP value="0 0 1"/>
  <drake:{0}_body_B name="a"/><drake:{0}_p_BQ value="1 0.5 0"/><drake:{0}_{1} value="1.2"/>
  <drake:{0}_stiffness value="{2}"/><drake:{0}_damping value="3"/></drake:{0}>"""


@pytest.mark.parametrize("kind", [("linear_spring_damper", "free_length"), ("distance_constraint", "distance")])
def test_springs_and_rods_of_drake(kind, tmp_path):
    """A spring between points beside each other has its length in space; a rigid distance leaves no freedom."""
    text = link("a") + joint("j", "world", "a")
    machine = read(tmp_path, text + SPRING.format(*kind, 40))
    j = machine.joint("j")
    state = mbd.assemble(machine, [j.angle == 0.4, j.angular_velocity == 0.7])
    ends = np.array([0, 0, 1]), np.array([np.cos(0.4), 0.5, -np.sin(0.4)])
    span = ends[1] - ends[0]
    length = np.linalg.norm(span)
    lever = span @ np.array([-np.sin(0.4), 0, -np.cos(0.4)]) / length  # dl/dangle
    moment = -lever * (40 * (length - 1.2) + 3 * lever * 0.7) + 2 * 9.81 * 0.5 * np.cos(0.4)
    rate = state[mbd.time_derivative(j.angular_velocity)]
    assert rate == pytest.approx(moment / (2 * GYRATION**2), rel=1e-9)
    if kind[0] == "distance_constraint":
        rigid = read(tmp_path, text + SPRING.format(*kind, "inf"))
        assert mbd.check(rigid).degrees_of_freedom == 0
        # 1 + 1 + 2 sin a + 1/4 = 1.44
        assert mbd.assemble(rigid)[rigid.joint("j").angle] == pytest.approx(np.arcsin((1.44 - 2.25) / 2), abs=1e-9)
    with pytest.raises(mbd.FileError, match="names the body 'c', which does not exist"):
        read(tmp_path, text + SPRING.format(*kind, 40).replace('name="a"', 'name="c"'))


def test_a_base_that_floats_obliquely(tmp_path):
    """The axis that is nearest to the hinges is turned to them."""
    turned = joint("j", "world", "a", kind="floating").replace("<origin", '<origin rpy="0 0 0.3"')
    text = (
        link("a")
        + turned
        + link("b")
        + joint("k", "a", "b").replace('xyz="0 1 0"', f'xyz="{np.sin(0.3)} {np.cos(0.3)} 0"')
    )
    with pytest.warns(mbd.MechanismWarning, match="the motion of joint 'j' out of the plane"):
        machine = read(tmp_path, text)
    assert mbd.check(machine).degrees_of_freedom == 4
    z = machine.joint("j/z")
    state = mbd.assemble(machine, [z.speed == 0])
    assert state[mbd.time_derivative(z.speed)] == pytest.approx(-9.81, rel=1e-6)
