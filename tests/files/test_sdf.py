"""Models of Gazebo as planar mechanisms: closed forms, and Eksergian's equation of a four-bar."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.__main__ import main


def bar(name, length, mass, pose="", more=""):
    """A slender bar along the x axis of its frame, that turns about y."""
    inertia = mass * length**2 / 12
    return f"""<link name="{name}">{pose}<inertial><pose>{length / 2} 0 0 0 0 0</pose><mass>{mass}</mass>
      <inertia><ixx>1</ixx><iyy>{inertia}</iyy><izz>1</izz></inertia></inertial>{more}</link>"""


def pin(name, parent, child, more="", axis="<xyz>0 1 0</xyz>"):
    return f"""<joint name="{name}" type="revolute"><parent>{parent}</parent><child>{child}</child>
      <axis>{axis}{more}</axis></joint>"""


def slide(name, parent, child, more=""):
    return pin(name, parent, child, more, "<xyz>1 0 0</xyz>").replace("revolute", "prismatic")


def read(path, text, version="1.9", **options):
    if "<model" not in text and "<world" not in text:
        text = f'<model name="m">{text}</model>'
    (path / "m.sdf").write_text(f'<sdf version="{version}">{text}</sdf>')
    return mbd.read_sdf(path / "m.sdf", **options)


def rates(machine, joints, at, speeds):
    """Accelerations of hinges at angles and speeds."""
    q = [machine.joint(name).angle for name in joints]
    v = [machine.joint(name).angular_velocity for name in joints]
    conditions = [a == b for a, b in zip([*q, *v], [*at, *speeds], strict=True)]
    state = mbd.assemble(machine, conditions, inputs={drive: 0.0 for drive in machine.inputs})
    return [float(state[mbd.time_derivative(each)]) for each in v]


def test_a_pendulum_with_spring_and_damper(tmp_path):
    """Gravity is that of the format, of the world, or given; a turn about +y brings the bar down."""
    laws = """<dynamics><damping>0.3</damping><spring_stiffness>4</spring_stiffness>
      <spring_reference>0.1</spring_reference></dynamics>"""
    text = bar("arm", 0.8, 1.5) + pin("j", "world", "arm", laws)
    inertia = 1.5 * 0.8**2 / 3

    def known(g):
        return (1.5 * g * 0.4 * np.cos(0.5) - 0.3 * 0.7 - 4 * 0.4) / inertia

    assert rates(read(tmp_path, text), "j", [0.5], [0.7]) == pytest.approx([known(9.8)], rel=1e-10)
    world = f'<world name="w"><gravity>0 0 -1.6</gravity><model name="m">{text}</model></world>'
    assert rates(read(tmp_path, world), "j", [0.5], [0.7]) == pytest.approx([known(1.6)], rel=1e-10)
    given = read(tmp_path, world, gravity=(0, 0, -9.81))
    assert rates(given, "j", [0.5], [0.7]) == pytest.approx([known(9.81)], rel=1e-10)
    assert (given.name, [body.name for body in given.bodies]) == ("w", ["arm"])


def test_a_double_pendulum_in_frames(tmp_path):
    """Poses relative to links, frames, joints and models, in degrees and quaternions, give the same motion."""
    plain = bar("a", 1, 2) + bar("b", 0.7, 1.1, "<pose>1 0 0 0 0 0</pose>")
    plain += pin("j", "world", "a") + pin("k", "a", "b")
    turned = f"""<model name="m"><pose degrees="true">0 0 2 0 0 90</pose>
      {bar("a", 1, 2, '<pose relative_to="f"/>')}
      {bar("b", 0.7, 1.1, '<pose relative_to="end" rotation_format="quat_xyzw">-1 0 0 0 0 0 1</pose>')}
      <frame name="f"><pose rotation_format="quat_xyzw">0 0 0 0 0 -1 1</pose></frame>
      <frame name="end" attached_to="a"><pose>2 0 0 0 0 0</pose></frame>
      {pin("j", "world", "f", axis='<xyz expressed_in="a">0 1 0</xyz>').replace("<axis>", "<pose/><axis>")}
      {pin("k", "end", "b", axis='<xyz expressed_in="__model__">1 0 0</xyz>')}</model>"""
    at, speeds = np.array([0.4, -0.9]), np.array([1.3, 0.6])
    # absolute angles p below the horizontal, of bars of the lengths 1 and 0.7
    p, w = np.cumsum(at), np.cumsum(speeds)
    mixed = 1.1 * 1 * 0.35
    mass = np.array([[2 / 3 + 1.1, mixed * np.cos(p[0] - p[1])], [mixed * np.cos(p[0] - p[1]), 1.1 * 0.49 / 3]])
    turning = mixed * np.sin(p[0] - p[1]) * np.array([-(w[1] ** 2), w[0] ** 2])
    weight = 9.8 * np.array([(2 * 0.5 + 1.1) * np.cos(p[0]), 1.1 * 0.35 * np.cos(p[1])])
    known = np.linalg.solve(mass, turning + weight)
    known[1] -= known[0]
    assert rates(read(tmp_path, plain), "jk", at, speeds) == pytest.approx(known, rel=1e-9)
    machine = read(tmp_path, turned)
    assert rates(machine, "jk", at, speeds) == pytest.approx(known, rel=1e-9)
    assert machine.body("a").pose_estimate[:2] == pytest.approx([0.5, 2.0])


CRANK, COUPLER, ROCKER, BASE = 0.3, 0.8, 0.6, 0.7


def four_bar_angles(crank):
    """Angles of coupler and rocker, open, by the law of cosines."""
    tip = CRANK * np.exp(1j * crank)
    across = BASE - tip
    cosine = (abs(across) ** 2 + COUPLER**2 - ROCKER**2) / (2 * abs(across) * COUPLER)
    coupler = np.angle(across) + np.arccos(cosine)
    return coupler, np.angle(tip + COUPLER * np.exp(1j * coupler) - BASE)


def four_bar(crank):
    coupler, rocker = four_bar_angles(crank)
    tip = CRANK * np.exp(1j * crank)
    # an angle about +y turns down
    places = ((0, 0, 0, crank), (tip.real, 0.1, tip.imag, coupler), (BASE, 0.2, 0, rocker))
    poses = [f"<pose>{x:.15g} {y} {z:.15g} 0 {-turn:.15g} 0</pose>" for x, y, z, turn in places]
    text = bar("crank", CRANK, 1.0, poses[0]) + bar("coupler", COUPLER, 2.0, poses[1])
    text += bar("rocker", ROCKER, 1.5, poses[2])
    text += pin("O", "world", "crank") + pin("A", "crank", "coupler") + pin("B", "world", "rocker")
    return text + pin("C", "rocker", "coupler").replace("<axis>", f"<pose>{COUPLER} 0 0 0 0 0</pose><axis>")


def eksergian(angle, speed, gravity):
    """Acceleration of the crank: J a + J' w²/2 = -V', by central differences of the closed loop."""

    def centres(crank):
        turns = (crank, *four_bar_angles(crank))
        ends = [half / 2 * np.exp(1j * turn) for half, turn in zip((CRANK, COUPLER, ROCKER), turns, strict=True)]
        return np.array([ends[0], 2 * ends[0] + ends[1], BASE + ends[2], *(1j * turn for turn in turns)])

    masses, lengths = np.array([1.0, 2.0, 1.5]), np.array([CRANK, COUPLER, ROCKER])
    weights = np.r_[masses, masses * lengths**2 / 12]

    def inertia(crank, h=1e-3):
        far, near = (centres(crank + 2 * h) - centres(crank - 2 * h)), (centres(crank + h) - centres(crank - h))
        return weights @ np.abs((8 * near - far) / (12 * h)) ** 2

    def potential(crank):
        return gravity * masses @ centres(crank)[:3].imag

    def slope(function, h=1e-3):
        near, far = (function(angle + k * h) - function(angle - k * h) for k in (1, 2))
        return (8 * near - far) / (12 * h)

    return (-slope(potential) - slope(inertia) * speed**2 / 2) / inertia(angle)


def test_a_four_bar_with_a_joint_that_closes_its_loop(tmp_path):
    """The joint that closes the loop has its coordinate too, and its damper."""
    damper = "<dynamics><damping>0</damping></dynamics>"
    machine = read(tmp_path, four_bar(1.0).replace("</axis>", damper + "</axis>"))
    assert mbd.check(machine).degrees_of_freedom == 1
    assert [joint.name for joint in machine.joints] == ["O", "B", "A", "C"]
    (acceleration,) = rates(machine, "O", [-0.2], [-2.0])
    assert acceleration == pytest.approx(-eksergian(1.2, 2.0, 9.8), rel=1e-7)
    state = mbd.assemble(machine, [machine.joint("O").angle == -0.2])
    turned = -np.subtract(four_bar_angles(1.2), four_bar_angles(1.0))
    assert state[machine.joint("C").angle] == pytest.approx(turned[0] - turned[1], abs=1e-9)


def test_a_slider_crank_with_a_slide_that_closes_its_loop(tmp_path):
    rod = bar("rod", 1, 1, "<pose>0.3 0 0 0 0 0</pose>")
    block = '<link name="block"><pose>1.3 0 0 0 0 0</pose></link>'
    text = block.join((bar("crank", 0.3, 1) + rod, pin("O", "world", "crank") + pin("A", "crank", "rod")))
    text += pin("B", "rod", "block") + slide("S", "world", "block", "<limit><effort>-1</effort></limit>")
    machine = read(tmp_path, text)
    assert mbd.check(machine).degrees_of_freedom == 1
    state = mbd.assemble(machine, [machine.joint("O").angle == 0.7], inputs={machine.inputs[0]: 0})
    place = 0.3 * np.cos(0.7) + np.sqrt(1 - 0.09 * np.sin(0.7) ** 2)
    assert state[machine.joint("S").displacement] == pytest.approx(place - 1.3, abs=1e-9)
    (drive,) = machine.inputs
    assert (drive.label, drive.upper) == ("S", np.inf)


def test_joints_that_lead_from_the_outside_to_the_world(tmp_path):
    """A coordinate keeps its sense if the tree runs the other way."""
    text = bar("arm", 1, 2, "<pose>0.2 0 0 0 0 0</pose>") + '<link name="base"/>'
    text += """<joint name="f" type="fixed"><parent>world</parent><child>base</child></joint>"""
    machine = read(tmp_path, text + pin("j", "arm", "base").replace("<axis>", "<pose>0.2 0 0 0 0 0</pose><axis>"))
    (rate,) = rates(machine, "j", [0.3], [0.0])
    assert rate == pytest.approx(-9.8 * 0.5 * np.cos(0.3) * 3, rel=1e-9)


BALL = """<collision name="c">{}<geometry><sphere><radius>0.1</radius></sphere></geometry>
  <surface><friction><ode><mu>{}</mu></ode></friction></surface></collision>"""
FLOOR = """<model name="floor"><static>true</static><link name="floor"><collision name="c"><geometry>
  <plane><normal>0 0 1</normal></plane></geometry>
  <surface><friction><ode><mu>100</mu></ode></friction></surface></collision></link></model>"""


def test_a_cart_on_a_floor(tmp_path):
    """A model moves freely in the plane of its hinges; the smaller friction holds; it does not touch itself."""
    wheel = bar("wheel", 0.2, 3, "<pose>0 0 0.1 0 0 0</pose>", BALL.format("<pose>0.1 0 0 0 0 0</pose>", 0.4))
    cart = (
        wheel + bar("cart", 0.2, 3, "<pose>0.1 0 0.15 0 0 0</pose>", BALL.format("", 0.4)) + pin("j", "cart", "wheel")
    )
    text = f'<world name="w">{FLOOR}<model name="cart">{cart}</model></world>'
    with pytest.warns(mbd.MechanismWarning, match="left out the motion of link 'cart' out of the plane$"):
        machine = read(tmp_path, text)
    contacts = [force for force in machine.forces if isinstance(force, mbd.Contact)]
    assert [contact.name for contact in contacts] == ["wheel on floor", "cart on floor"]
    assert float(contacts[0].friction.coefficient) == 0.4
    x, z, turn = (machine.joint(f"cart/{name}") for name in ("x", "z", "theta"))
    still = [x.displacement == 0, z.displacement == -0.1 * 0.01, turn.angle == 0, machine.joint("j").angle == 0]
    state = mbd.assemble(machine, [*still, x.speed == 0, z.speed == 0, turn.angular_velocity == 0])
    assert state[contacts[0].normal_force] == pytest.approx(6 * 9.8, rel=1e-9)  # 1 % of the radius under the weight
    colliding = text.replace('<model name="cart">', '<model name="cart"><self_collide>true</self_collide>')
    with pytest.warns(mbd.MechanismWarning, match="out of the plane"):
        assert len(read(tmp_path, colliding).forces) == len(machine.forces)  # a joint holds them together
    masked = text.replace("<surface><fri", "<surface><contact><collide_bitmask>0x02</collide_bitmask></contact><fri", 1)
    with pytest.warns(mbd.MechanismWarning, match="the contacts of collisions"):
        read(tmp_path, text, contacts=False)
    with pytest.warns(mbd.MechanismWarning, match="out of the plane"):
        assert len(read(tmp_path, masked).forces) == len(machine.forces)  # 2 is in 65535
    with pytest.warns(mbd.MechanismWarning, match="out of the plane"):
        apart = masked.replace("<surface><fri", "<surface><contact><collide_bitmask>1</collide_bitmask></contact><fri")
        assert not any(isinstance(force, mbd.Contact) for force in read(tmp_path, apart).forces)


def test_a_ball_that_falls(tmp_path):
    """Without hinges the plane is that of gravity and the x axis; a free body has its names."""
    ball = '<link name="ball"><pose>0 0 1 0 0 0.5</pose>' + BALL.format("", 0.3) + "</link>"
    with pytest.warns(mbd.MechanismWarning, match="the motion of link 'ball' out of the plane$"):
        machine = read(tmp_path, f'<world name="w">{FLOOR}<model name="m">{ball}</model></world>')
    assert [joint.name for joint in machine.joints] == ["ball/x", "ball/z", "ball/theta"]
    body, z = machine.bodies[0], machine.joint("ball/z")
    assert body.mass == 1.0 and body.inertia == 1.0  # by the format, if a file gives none
    run = mbd.simulate(machine, duration=0.4, initial=[body.vx == 2.0, z.speed == 0, z.displacement == 0])
    assert run.final[body.position] == pytest.approx([0.8, 1 - 9.8 * 0.4**2 / 2], rel=1e-6)


def test_limits_friction_efforts_and_mimic(tmp_path):
    limits = "<limit><lower>-inf</lower><upper>0.4</upper><effort>7</effort></limit>"
    follow = '<mimic joint="j"><multiplier>-2</multiplier><reference>0.1</reference><offset>0.3</offset></mimic>'
    text = bar("a", 1, 2) + bar("b", 0.5, 1) + pin("k", "world", "b", follow)
    text += pin("j", "world", "a", limits + "<dynamics><friction>0.5</friction></dynamics>")
    machine = read(tmp_path, text)
    j, k, (drive,) = machine.joint("j"), machine.joint("k"), machine.inputs
    names = [force.name for force in machine.forces]
    assert "j upper stop" in names and "j lower stop" not in names and "j friction" in names
    assert (drive.label, drive.lower, drive.upper) == ("j", -7, 7)
    state = mbd.assemble(machine, [j.angle == 0.41, j.angular_velocity == 0], inputs={drive: 0})
    assert state[k.angle] == pytest.approx(-2 * (0.41 - 0.1) + 0.3, abs=1e-9)
    # 1 % of a radian under the weight of all at the radius of gyration
    assert state[machine.force("j upper stop").force] == pytest.approx(3 * 9.8 / np.sqrt(3), rel=1e-9)
    with pytest.warns(mbd.MechanismWarning, match="the range of joint 'j'.*; the dry friction of joint 'j'"):
        read(tmp_path, text, contacts=False)


def test_joints_with_names_of_links_and_locked_ones(tmp_path):
    """Old files give a joint the name of a link, and limits of zero to what is fixed."""
    locked = pin("tool", "arm", "tool", "<limit><lower>0</lower><upper>0</upper></limit>")
    text = locked + pin("arm", "world", "arm") + bar("arm", 1, 2) + bar("tool", 1, 2, "<pose>1 0 0 0 0 0</pose>")
    machine = read(tmp_path, text)
    assert [joint.name for joint in machine.joints] == ["arm"] and machine.bodies[0].mass == 4
    assert rates(machine, ["arm"], [0.0], [0.0]) == pytest.approx([4 * 9.8 / (4 * 4 / 3)], rel=1e-9)


def test_included_models(tmp_path):
    """A model twice, moved, one of them static; names with that of the model if they are not the only ones."""
    inner = f'<sdf version="1.4"><model name="x">{bar("arm", 1, 2)}{pin("j", "world", "arm")}</model></sdf>'
    (tmp_path / "models" / "arm").mkdir(parents=True)
    (tmp_path / "models" / "arm" / "model.sdf").write_text(inner)
    include = "<include><uri>{}</uri><name>{}</name><pose>{} 0 0 0 0 0</pose>{}</include>"
    one = include.format("models/arm", "one", 1, "")
    two = include.format(tmp_path / "models" / "arm" / "model.sdf", "two", 2, "")
    world = f'<world name="w">{one}{two}</world>'
    machine = read(tmp_path, world)
    assert [body.name for body in machine.bodies] == ["one::arm", "two::arm"]
    assert [body.pose_estimate[0] for body in machine.bodies] == [1.5, 2.5]
    (tmp_path / "models" / "two").mkdir()
    nested = f'<model name="m">{include.format("model://arm", "in", 4, "")}</model>'
    assert read(tmp_path / "models" / "two", nested).bodies[0].pose_estimate[0] == 4.5
    still = read(tmp_path, world.replace("</pose></include></world>", "</pose><static>1</static></include></world>"))
    assert [joint.name for joint in still.joints] == ["one::j"]
    placed = one.replace("</pose>", "</pose><placement_frame>j</placement_frame>").replace("1 0 0", "3 0 0")
    assert read(tmp_path, f'<world name="w">{placed}</world>').bodies[0].pose_estimate[0] == 3.5


def test_models_in_models(tmp_path, capsys):
    """Joints and poses reach into them, and across the models of a world; a frame is that of its model's first link."""
    inner = f"""<model name="in"><pose>1 0 0 0 0 0</pose>{bar("arm", 1, 2)}
      <frame name="tip"><pose>1 0 0 0 0 0</pose></frame></model>"""
    text = f"""<world name="w"><frame name="up"><pose>0 0 3 0 0 0</pose></frame>
      <model name="m"><pose relative_to="up">0 0 0 0 0 0</pose><link name="base"/>{inner}
      {pin("j", "base", "in", axis='<xyz expressed_in="in::__model__">0 1 0</xyz>')}
      {bar("hand", 1, 1, '<pose relative_to="in::tip"/>')}{pin("k", "in::tip", "hand")}</model>
      <joint name="f" type="fixed"><parent>world</parent><child>m::base</child></joint></world>"""
    machine = read(tmp_path, text)
    assert [body.name for body in machine.bodies] == ["arm", "hand"]
    assert machine.body("hand").pose_estimate[:2] == pytest.approx([2.5, 3.0])
    # both bars of the chain, horizontal
    (first, second) = rates(machine, "jk", [0.0, 0.0], [0.0, 0.0])
    known = np.linalg.solve([[2 / 3 + 1, 0.5], [0.5, 1 / 3]], 9.8 * np.array([2 * 0.5 + 1, 0.5]))
    assert [first, first + second] == pytest.approx(known, rel=1e-9)
    assert main(["check", str(tmp_path / "m.sdf")]) == 0
    assert "degrees of freedom  2" in capsys.readouterr().out


def test_axes_of_old_files(tmp_path):
    """Before 1.5 they are those of the model, afterwards if the file says so, else those of the joint."""
    text = bar("arm", 1, 2, "<pose>0 0 0 0 0 1.5707963267948966</pose>") + pin("j", "world", "arm")
    parent = text.replace("<axis>", "<axis><use_parent_model_frame>1</use_parent_model_frame>")
    for version, form, turns in (("1.4", text, 0.0), ("1.6", text, 1.0), ("1.10", text, 1.0), ("1.6", parent, 0.0)):
        machine = read(tmp_path, form.replace("1.5707963267948966", "0") if turns else form, version)
        assert abs(rates(machine, "j", [0.0], [0.0])[0]) == pytest.approx(turns * 9.8 * 1.5, abs=1e-8)


def test_planar_joints_of_drake(tmp_path):
    text = bar("arm", 1, 2) + '<link name="base"><pose>0 0 0 1.5707963267948966 0 0</pose></link>'
    text += '<joint name="f" type="fixed"><parent>world</parent><child>base</child></joint>'
    text += """<frame name="mid" attached_to="arm"><pose relative_to="base"/></frame>
      <drake:joint name="p" type="planar"><drake:parent>base</drake:parent><drake:child>mid</drake:child>
      <drake:damping>1 2 3</drake:damping></drake:joint>"""
    machine = read(tmp_path, text)
    x, turn = machine.joint("p/x"), machine.joint("p/theta")
    assert mbd.check(machine).degrees_of_freedom == 3
    at = [x.displacement == 0, machine.joint("p/y").displacement == 0, turn.angle == 0]
    state = mbd.assemble(machine, [*at, x.speed == 3, machine.joint("p/y").speed == 0, turn.angular_velocity == 0])
    assert state[mbd.time_derivative(x.speed)] == pytest.approx(-1 * 3 / 2, rel=1e-9)


@pytest.mark.filterwarnings("ignore:.*across the plane between the ends")
def test_pins_of_drake_that_close_loops(tmp_path):
    """A loop whose points are apart in the pose of the file closes."""
    text = four_bar(1.0).replace("<model", "").split('<joint name="C"')[0]
    point = "<drake:ball_constraint_{0}>{1}</drake:ball_constraint_{0}>"
    parts = (("body_A", "rocker"), ("p_AP", f"{ROCKER} 0 0"), ("body_B", "coupler"), ("p_BQ", f"{COUPLER} 0 0"))
    pinned = f"<drake:ball_constraint>{''.join(point.format(*part) for part in parts)}</drake:ball_constraint>"
    machine = read(tmp_path, text + pinned)
    (acceleration,) = rates(machine, "O", [-0.2], [-2.0])
    assert acceleration == pytest.approx(-eksergian(1.2, 2.0, 9.8), rel=1e-7)
    swung = text.replace("<pose>0 0.0 0 0", "<pose>0 0 0 0") + pinned
    turned = swung.replace(
        f"0 {-four_bar_angles(1.0)[1]:.15g} 0</pose>", f"0 {-four_bar_angles(1.0)[1] - 0.3:.15g} 0</pose>"
    )
    assert turned != swung
    (acceleration,) = rates(read(tmp_path, turned), "O", [-0.2], [-2.0])
    assert acceleration == pytest.approx(-eksergian(1.2, 2.0, 9.8), rel=1e-7)


ARM = bar("arm", 1, 2) + "\n" + pin("j", "world", "arm")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("revolute", "ball"), "line 3: joint 'j' is of the type 'ball'; planar are revolute"),
        (("revolute", "universal"), "joint 'j' is of the type 'universal'"),
        (("0 1 0</xyz>", "0 one 0</xyz>"), "line 4: axis has xyz = '0 one 0', which are not 3 finite numbers"),
        (("<child>arm", "<child>leg"), "line 3: joint 'j' names 'm::leg', which does not exist"),
        (("<xyz>", '<xyz expressed_in="f">'), "joint 'j' names 'm::f', which does not exist"),
        (("<mass>2", "<mass>-2"), "inertial has mass = -2, which must be at least 0"),
        (("<inertial>", '<inertial auto="true">'), "is to be computed from the collisions (auto); give mass"),
        (
            ("</xyz>", "</xyz><dynamics><damping>-1</damping></dynamics>"),
            "has damping = '-1', which must not be negative",
        ),
        (("<joint", "<drake:linear_bushing_rpy/><joint"), "drake:linear_bushing_rpy is not read; leave it out, if"),
        (("<joint", "<include><uri>m.sdf</uri><name>b</name></include><joint"), "includes m.sdf, which includes it"),
        (("<joint", "<include><uri>https://x.org/a</uri></include><joint"), "names 'https://x.org/a'; load the model"),
        (("<joint", "<include><uri>model://none</uri></include><joint"), "names 'model://none', which is not there"),
        (("<joint", '<include merge="1"><uri>a</uri></include><joint'), "include is to be merged, which is not read"),
        (("<joint", '<link name="arm"/><joint'), "link 'arm' has the name of another frame, 'm::arm'"),
        (('"arm">', '"arm"><pose relative_to="arm">0 0 0 0 0 0</pose>'), "link 'arm' has a pose relative to itself"),
        (("world", "arm"), "joint 'j' connects a link with itself"),
        (('<joint name="j" type="revolute">', '<joint name="j" type="fixed">'), "has no joint that moves"),
        (("0 1 0</xyz>", "0 0 0</xyz>"), "joint 'j' has a zero vector as axis"),
    ],
)
def test_what_is_not_read(change, words, tmp_path):
    text = ARM
    assert change[0] in text
    with pytest.raises(mbd.FileError) as caught:
        read(tmp_path, text.replace(*change))
    assert words in str(caught.value), caught.value


def test_what_is_left_out_is_named(tmp_path):
    text = ARM.replace("<joint", '<plugin name="drive"/><joint').replace("</xyz>", "</xyz><damping>3</damping>")
    with pytest.warns(
        mbd.MechanismWarning, match=r"left out plugin 'drive' of model 'm' \(line 1\); attribute damping"
    ):
        read(tmp_path, text)
    with pytest.raises(mbd.ModelError, match="read_sdf: gravity must be"):
        read(tmp_path, ARM, gravity=(0, 1))
