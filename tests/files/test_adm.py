"""Model and analysis files: each type by its closed form, flaws that do no harm, errors that name the place."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.joints.coordinates import AbsoluteX

MODELS = Path(__file__).resolve().parents[2] / "examples" / "models"


def body(identity=1, **more):
    """A body of a file."""
    usual = {"name": f"body {identity}", "id": identity, "mass": 2.0, "jbar": 0.5, "q0": [0, 0, 0], "qd0": [0, 0, 0]}
    return usual | more


def absolute(kind, name, fun="0", point=(0, 0), number=1):
    """An absolute constraint of a file."""
    return {"name": name, "id": 1, "type": kind, "body1": number, "sP1": list(point), "fun": fun}


@pytest.fixture
def write(tmp_path):
    """Write a model and return its path."""

    def written(bodies=None, constraints=(), forces=(), **more):
        content = {"name": "m", "gravity": [0, 0], "bodies": [body()] if bodies is None else bodies}
        content |= {"constraints": list(constraints), "forces": list(forces)} | more
        path = tmp_path / "model.adm"
        path.write_text(json.dumps(content))
        return path

    return written


@pytest.fixture
def read(write):
    """Write a model and read it."""
    return lambda *parts, functions=None, **more: mbd.read_adm(write(*parts, **more), forces=functions)


# --- what a file says -------------------------------------------------------------------
def test_bodies_have_what_the_file_says(read):
    """Mass, inertia, pose, velocity, and the rectangles of the drawing."""
    drawing = {"RGB": [1, 0, 0], "shapes": [{"loc": [0, 0], "size": [2, 0.2]}, {"loc": [0.5, 0], "size": [0.2, 1]}]}
    model = read([body(7, name="arm", mass=3, jbar=0.25, q0=[1, 2, 0.5], qd0=[3, 4, 5], vis=drawing)])
    arm = model.body("arm")
    assert (arm.mass, arm.inertia) == (3.0, 0.25)
    assert arm.pose_estimate.tolist() == [1, 2, 0.5] and arm.velocity_estimate.tolist() == [3, 4, 5]
    corners = [outline.points for outline in arm.shape.outlines()]
    assert np.ptp(corners[0], axis=0) == pytest.approx([2, 0.2]) and corners[1].mean(axis=0) == pytest.approx([0.5, 0])
    assert model.name == "m"


@pytest.mark.parametrize("gravity", [(0.0, -9.81), (9.81, 0.0), (1.0, 2.0)])
def test_gravity(read, gravity):
    """A free body falls with it."""
    model = read(gravity=list(gravity))
    state = mbd.assemble(model)
    assert state[model.bodies[0].acceleration] == pytest.approx(gravity)


def test_gravity_that_is_not_given_is_the_usual_one(write):
    """As in the course's own program; and zero is none."""
    path = write()
    content = json.loads(path.read_text())
    assert mbd.read_adm(path).forces == ()
    del content["gravity"]
    path.write_text(json.dumps(content))
    model = mbd.read_adm(path)
    assert mbd.assemble(model)[model.bodies[0].acceleration] == pytest.approx([0, -9.81])


@pytest.mark.parametrize(
    ("kind", "quantity"),
    [("AbsoluteX", lambda b: b.at(1, 2).x), ("AbsoluteY", lambda b: b.at(1, 2).y), ("AbsoluteAngle", lambda b: b.phi)],
)
def test_absolute_constraints_and_drivers(read, kind, quantity):
    """A constant holds the coordinate; a function of time drives it under the same name."""
    model = read(constraints=[absolute(kind, "row", "0.3 + 0*t", (1, 2))])
    assert not model.drivers and model.joint("row") in model.joints
    assert mbd.assemble(model)[quantity(model.bodies[0])] == pytest.approx(0.3)
    driven = read(constraints=[absolute(kind, "row", "0.3 + t^2", (1, 2))])
    assert not driven.joints and [d.name for d in driven.drivers] == ["row"]
    state = mbd.assemble(driven, t=0.5)
    assert state[quantity(driven.bodies[0])] == pytest.approx(0.55)


def test_absolute_angle_needs_no_point(read):
    """The course's files give none."""
    row = absolute("AbsoluteAngle", "row", "0.25")
    del row["sP1"]
    model = read(constraints=[row])
    assert mbd.assemble(model)[model.bodies[0].phi] == pytest.approx(0.25)


@pytest.mark.parametrize("fun", ["0.4", "0.4 + t"])
def test_relative_constraints(read, fun):
    """Coordinate of body 2 less that of body 1."""
    points = {"body1": 1, "sP1": [0.1, 0], "body2": 2, "sP2": [0, 0.2], "fun": fun}
    rows = [{"name": kind, "type": kind} | points for kind in ("RelativeX", "RelativeY", "RelativeAngle")]
    model = read([body(1, q0=[0, 0, 0.2]), body(2)], rows)
    assert len(model.drivers) == (3 if "t" in fun else 0)
    one, two = model.bodies
    state = mbd.assemble(model, t=0.1)
    expected = 0.5 if "t" in fun else 0.4
    apart = state[two.at(0, 0.2).position] - state[one.at(0.1, 0).position]
    assert apart == pytest.approx([expected, expected]) and state[two.phi - one.phi] == pytest.approx(expected)


def test_relative_distance(read):
    """A link of the given length; body 0 is the ground."""
    row = {
        "name": "link",
        "type": "RelativeDistance",
        "body1": 0,
        "sP1": [1, 1],
        "body2": 1,
        "sP2": [0, 0],
        "fun": "0.5",
    }
    model = read([body(q0=[1.6, 1, 0])], [row])
    assert mbd.assemble(model)[model.bodies[0].position] == pytest.approx([1.5, 1])


def test_revolute_joint(read):
    """Points coincide; without a second body the joint is on the ground."""
    bodies = [body(1, q0=[0.5, 0, 0]), body(2, q0=[1.4, 0.2, 0.1])]
    hinge = {"name": "hinge", "type": "RevoluteJoint", "body1": 1, "sP1": [-0.5, 0], "sP2": [0.1, 0], "fun": "NONE"}
    knee = {"name": "knee", "type": "RevoluteJoint", "body1": 1, "sP1": [0.5, 0], "body2": 2, "sP2": [-0.5, 0]}
    model = read(bodies, [hinge, knee])
    state = mbd.assemble(model)
    one, two = model.bodies
    assert state[one.at(-0.5, 0).position] == pytest.approx([0.1, 0])
    assert state[one.at(0.5, 0).position] == pytest.approx(state[two.at(-0.5, 0).position])


@pytest.mark.parametrize("direction", [[0, 2], [0, -3]])
def test_translational_joint(read, direction):
    """Block on an inclined line; opposite directions are parallel too, and nothing is turned over."""
    joint = {"name": "slide", "type": "TranslationalJoint", "body1": 0, "sP1": [1, 0], "vP1": [1, 1]}
    joint |= {"body2": 1, "sP2": [0.1, 0], "vP2": direction, "fun": "NONE"}
    model = read([body(q0=[1.4, 0.6, -math.pi / 4 + 0.1])], [joint])
    block = model.bodies[0]
    state = mbd.assemble(model)
    assert state[block.phi] == pytest.approx(-math.pi / 4, abs=1e-9)
    x, y = state[block.at(0.1, 0).position]
    assert y == pytest.approx(x - 1)


def rack_and_pinion(**more):
    """A rack that slides at y = 0.2, and a pinion below it about the origin, that turns by sin(10 t) + 0.3."""
    rack_rows = [absolute("AbsoluteY", "rack y", "0.2")]
    pinion_rows = [absolute(f"Absolute{axis}", f"pinion {axis}", "0", number=2) for axis in "XY"]
    mesh = {"name": "mesh", "type": "RackPinion", "body1": 1, "body2": 2, "sP1": [0, 0], "sQ1": [-1, 0], "sP2": [0, 0]}
    mesh |= {"R2": 0.2, "fun": "0"} | more
    return [*rack_rows, *pinion_rows, mesh, absolute("AbsoluteAngle", "drive", "sin(10*t) + 0.3", number=2)]


def test_rack_and_pinion(read):
    """The rack travels by R times the turn; both rows have names, and the centre distance is R."""
    model = read([body(1, q0=[1, 0.2, 0]), body(2)], rack_and_pinion())
    assert {"mesh", "mesh centre distance"} <= {joint.name for joint in model.joints}
    times = np.linspace(0, 1, 21)
    motion = mbd.kinematics(model, times)
    rack = model.body("body 1")
    # the pinion turns counter-clockwise below the rack, which moves to -x
    assert motion[rack.x] == pytest.approx(1 - 0.2 * (np.sin(10 * times) + 0.3), abs=1e-10)
    assert motion[rack.phi] == pytest.approx(0 * times, abs=1e-10)


def test_rack_and_pinion_with_marks(read):
    """The marks fix where the rack is, though the estimate says otherwise: theta1 = phi2 + theta2 - 3π/2 at Q."""
    marks = {"theta1": -math.pi, "theta2": math.pi / 2}
    model = read([body(1, q0=[1.1, 0.2, 0]), body(2)], rack_and_pinion(**marks))
    # at phi2 = 0 the pinion touches Q = (-1, 0) of the rack: the rack is at x = 1
    assert mbd.assemble(model)[model.body("body 1").x] == pytest.approx(1 - 0.2 * 0.3)
    turned = read([body(1, q0=[1.1, 0.2, 0]), body(2)], rack_and_pinion(theta1=math.pi, theta2=math.pi / 2))
    assert mbd.assemble(turned)[turned.body("body 1").x] == pytest.approx(1 - 0.2 * 0.3)


@pytest.mark.parametrize(("frame", "turn"), [("GRF", 0.0), ("LRF", 0.7)])
def test_point_force(read, frame, turn):
    """A force at a point of a free body, in global axes or in those of the body."""
    force = {
        "name": "f",
        "type": "PointForce",
        "body1": 1,
        "sP1": [0.5, 0],
        "frame": frame,
        "funX": "3",
        "funY": "1 + t",
    }
    model = read([body(q0=[0, 0, 0.7])], forces=[force])
    state = mbd.assemble(model, t=1.0)
    x, y = 3 * math.cos(turn) - 2 * math.sin(turn), 3 * math.sin(turn) + 2 * math.cos(turn)
    moment = 0.5 * (math.cos(0.7) * y - math.sin(0.7) * x)
    assert state[model.bodies[0].a] == pytest.approx([x / 2, y / 2, moment / 0.5])


def test_torque(read):
    """A couple on a free body."""
    model = read(forces=[{"name": "n", "type": "Torque", "body1": 1, "fun": "2*t"}])
    assert mbd.assemble(model, t=0.5)[model.bodies[0].alpha] == pytest.approx(1.0 / 0.5)


@pytest.mark.parametrize("fun", ["0.3", "NONE", 0.3])
def test_rotational_spring_to_the_ground(read, fun):
    """``n = k (phi - theta0) + c omega + h`` acts against the absolute angle."""
    spring = {"name": "s", "type": "RSDA1", "body1": 1, "k": 5, "c": 0.2, "theta0": 0.1, "fun": fun}
    model = read([body(q0=[0, 0, 0.4], qd0=[0, 0, 2])], forces=[spring])
    couple = 5 * 0.3 + 0.2 * 2 + (0 if fun == "NONE" else 0.3)
    assert mbd.assemble(model)[model.bodies[0].alpha] == pytest.approx(-couple / 0.5)


def test_springs_between_bodies(read):
    """Couple and tension act on both bodies with opposite signs."""
    bodies = [body(1, q0=[0, 0, 0.1], qd0=[0, 0, 1]), body(2, q0=[2, 0, 0.5], qd0=[3, 0, 2], mass=4.0)]
    pair = {"body1": 1, "body2": 2, "k": 5, "c": 0.2, "fun": "0.3"}
    couple = pair | {"name": "r", "type": "RSDA2", "theta0": 0.1}
    tension = pair | {"name": "t", "type": "TSDA", "l0": 1.5, "sP1": [0, 0], "sP2": [0, 0]}
    model = read(bodies, forces=[couple, tension])
    state = mbd.assemble(model)
    n, f = 5 * 0.3 + 0.2 * 1 + 0.3, 5 * 0.5 + 0.2 * 3 + 0.3
    one, two = model.bodies
    assert state[one.a] == pytest.approx([f / 2, 0, n / 0.5]) and state[two.a] == pytest.approx([-f / 4, 0, -n / 0.5])


def test_a_ball_bounces_as_a_mass_on_a_spring_and_damper(read):
    """Half a damped oscillation: the speeds before and after are in the ratio of its closed form."""
    ball = body(q0=[0, 0.1, 0], qd0=[0, -1, 0], mass=2.0)
    model = read([ball], contacts=[BALL | {"kt": 0, "ct": 0}])
    motion = mbd.simulate(model, np.linspace(0, 0.2, 201), reltol=1e-10, abstol=1e-10)
    omega, decay = math.sqrt(1e4 / 2), 2.0 / (2 * 2)
    damped = math.sqrt(omega**2 - decay**2)
    # the force max(k d + c d', 0) vanishes where the acceleration of the free oscillation does
    ends = math.atan2(2 * decay * damped, 2 * decay**2 - omega**2) / damped
    speed = math.exp(-decay * ends) * (math.cos(damped * ends) - decay / damped * math.sin(damped * ends))
    assert motion.final[model.bodies[0].vy] == pytest.approx(-speed, rel=1e-6)


def test_a_ball_sticks_to_the_ground_by_the_tangential_spring(read):
    """A ball that is pressed on the ground swings to and fro on its tangential spring: closed form."""
    ball = body(q0=[0, 0.1 - 2 * 9.81 / 1e4, 0], qd0=[0.1, 0, 0], mass=2.0)
    upright = absolute("AbsoluteAngle", "upright")
    model = read([ball], [upright], contacts=[BALL | {"kt": 1e3, "ct": 4.0}], gravity=[0, -9.81])
    assert model.force("ball").friction is not None
    times = np.linspace(0, 1, 41)
    motion = mbd.simulate(model, times, reltol=1e-10, abstol=1e-10)
    decay = 4.0 / (2 * 2)
    damped = math.sqrt(1e3 / 2 - decay**2)
    expected = 0.1 / damped * np.exp(-decay * times) * np.sin(damped * times)
    assert motion[model.bodies[0].x] == pytest.approx(expected, abs=1e-8)


def test_the_tangential_spring_relaxes_after_lift_off(read):
    """Above the ground nothing holds the ball, and its spring forgets."""
    ball = body(q0=[0, 1.0, 0], qd0=[0.3, 0, 0])
    model = read([ball], contacts=[BALL])
    deflection = next(iter(model.force("ball").rates))
    motion = mbd.simulate(model, [0.0, 0.002], initial=[deflection == 0.01])
    assert motion.final[deflection] == pytest.approx(0.01 * math.exp(-1e3 * 0.002), rel=1e-6)
    assert motion.final[model.bodies[0].vx] == pytest.approx(0.3)


@pytest.mark.parametrize(("frame", "turn"), [("GRF", 0.0), ("LRF", 0.7)])
@pytest.mark.parametrize("name", ["gas", "gas.m"])
def test_a_force_in_a_matlab_file_is_given_as_a_function(read, frame, turn, name):
    """The function gets time, coordinates and velocities of the body; its value is in the frame of the force."""
    force = {"name": "f", "type": "PointForceFile", "body1": 1, "sP1": [0, 0], "frame": frame, "mfile": "gas"}
    parts = {"bodies": [body(q0=[0.2, 0, 0.7], qd0=[3, 0, 0])], "forces": [force]}
    model = read(**parts, functions={name: lambda t, q, v: (t + q[0], mbd.if_else(v[0] > 0, 2.0, 0.0))})
    state = mbd.assemble(model, t=1.0)
    x, y = 1.2 * math.cos(turn) - 2 * math.sin(turn), 1.2 * math.sin(turn) + 2 * math.cos(turn)
    assert state[model.bodies[0].acceleration] == pytest.approx([x / 2, y / 2])


@pytest.mark.parametrize(
    ("functions", "says"),
    [
        ({"piston": lambda t, q, v: (0, 0)}, "gives piston.*it has gas"),
        ({"gas": 3}, r"force 'f'.*must be a function of t and q and v, got 3"),
        ({"gas": lambda t, q: (0, 0)}, "force 'f'.*must be a function of t and q and v"),
        ({"gas": lambda t, q, v: 0.0}, "force 'f'.*two components"),
        ([1], "functions by name"),
    ],
)
def test_functions_for_matlab_files_are_checked(read, functions, says):
    force = {"name": "f", "type": "PointForceFile", "body1": 1, "sP1": [0, 0], "frame": "GRF", "mfile": "gas"}
    with pytest.raises(mbd.FileError, match=says):
        read(forces=[force], functions=functions)


def test_slider_crank_driven_against_the_closed_form():
    """The slider of the example is at R cos θ + sqrt(L² - R² sin² θ); speeds come from the first derivative."""
    model, analysis = (
        read(MODELS / name)
        for read, name in zip(
            (mbd.read_adm, mbd.read_acf), ("slider_crank_driven.adm", "slider_crank_driven.acf"), strict=True
        )
    )
    motion = mbd.kinematics(model, analysis.times)
    theta = np.pi / 6 + 4 * np.pi * analysis.times
    root = np.sqrt(0.5**2 - (0.2 * np.sin(theta)) ** 2)
    assert motion[model.body("slider").x] == pytest.approx(0.2 * np.cos(theta) + root, abs=1e-10)
    speed = -4 * np.pi * (0.2 * np.sin(theta) + 0.2**2 * np.sin(theta) * np.cos(theta) / root)
    assert motion[model.body("slider").vx] == pytest.approx(speed, abs=1e-9)


# --- flaws that do no harm ------------------------------------------------------------------
GOOD = (MODELS / "slider_crank.adm").read_text()
VIS = '"vis":\n      {\n        "RGB": [0.2, 0.2, 0.9],'


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ('"qd0": [0, 0, 0],', '"qd0": [0, 0, 0,],'),
        ('"fun": "2.2"}', '"fun": "2.2",}'),
        ('"id": 1,\n', '"id": 1, // the first\n'),
        ('"id": 1,\n', '/* the\nfirst */ "id": 1,\n'),
        ('"name": "slider crank"', '"name": "slider // crank, /* [1,]"'),
        ('"gravity": [0, -9.81],', '"comment": "a tab\tin it",\n"gravity": [0, -9.81],'),
        ('"forces":\n  [', '"contacts": [], "forces":\n  [ {},'),
    ],
)
def test_comments_and_commas_too_many(tmp_path, old, new):
    """What editors and people leave behind."""
    assert old in GOOD
    path = tmp_path / "m.adm"
    path.write_text(GOOD.replace(old, new))
    assert len(mbd.read_adm(path).bodies) == 3


@pytest.mark.parametrize(
    "drawing",
    [
        '"vis":\n {\n "RGB": [187/255, 98/255, 0],',
        '"vis":\n {\n "RGB": [0.2 0.2 0.9],',
        '"vis":\n {\n "RGB": [0.2, 0.2, 0.9]',
        '"vis":\n {\n "RGB": [0.2, 0.2, 0.9,',
        '"vis":\n {\n "RGB": 0.2, 0.2, 0.9],',
        '"vis":\n {\n "RGB": "red, }',
        '"vis":\n {\n RGB: \'blue\', "more": {"a": [1, 2}, ',
        '"vis": 5/3, "vis":\n {',
        '"vis":\n {\n "shapes": [{"loc": 1}], "shapes": [[[]], "points": [1, 2, ',
    ],
)
def test_a_broken_drawing_does_no_harm(tmp_path, drawing):
    """The mechanism is the same; the bodies whose drawing is whole may keep it."""
    path = tmp_path / "m.adm"
    text = GOOD.replace(VIS, drawing)
    assert text != GOOD
    path.write_text(text)
    with pytest.raises(json.JSONDecodeError):
        json.loads(text)
    model = mbd.read_adm(path)
    rod = model.body("rod")
    assert [b.name for b in model.bodies] == ["crank", "rod", "slider"] and (rod.mass, rod.inertia) == (0.8, 0.016667)
    assert len(model.joints) == 6 and len(model.forces) == 3


@pytest.mark.parametrize("before", ['"qd0": [0, 0, 0]\n      "vis"', '"qd0": [0, 0, 0],,\n      "vis"'])
def test_a_comma_that_is_wrong_before_the_drawing(tmp_path, before):
    """It goes with the drawing."""
    path = tmp_path / "m.adm"
    path.write_text(GOOD.replace('"qd0": [0, 0, 0],\n      "vis"', before))
    assert len(mbd.read_adm(path).bodies) == 3


@pytest.mark.parametrize(
    "drawing",
    [5, "none", [], {}, {"shapes": 3}, {"shapes": [1]}, {"shapes": [{"loc": [0, 0]}]}, {"shapes": [{"size": [1, -1]}]},
     {"shapes": [{"size": [1]}]}, {"shapes": [{"size": ["a", "b"]}]}, {"shapes": {"size": {}}}, None],
)  # fmt: skip
def test_a_drawing_that_makes_no_sense_is_none(read, drawing):
    """Well-formed, but no rectangles."""
    assert read([body(vis=drawing)]).bodies[0].shape is None


def test_encodings(tmp_path):
    """With a byte-order mark, as Windows editors write it, and in Latin-1."""
    for encoding in ("utf-8-sig", "utf-16", "latin-1"):
        path = tmp_path / f"{encoding}.adm"
        path.write_bytes(GOOD.replace("slider crank", "Schubkurbel für Ü").encode(encoding))
        assert mbd.read_adm(path).name == "Schubkurbel für Ü"


def test_fields_that_mean_nothing_are_named(read):
    """A slip of the pen in an optional field is not passed over in silence."""
    with pytest.warns(mbd.MechanismWarning, match=r"body 'body 1': 'qdO' is not used"):
        read([body(qdO=[1, 2, 3])])


# --- errors -----------------------------------------------------------------------------------
X = absolute("AbsoluteX", "row")
HINGE = {"name": "hinge", "type": "RevoluteJoint", "body1": 1, "sP1": [0, 0], "body2": 0, "sP2": [0, 0], "fun": "NONE"}
SLIDE = HINGE | {"type": "TranslationalJoint", "vP1": [1, 0], "vP2": [1, 0]}
BALL = {"name": "ball", "body": 1, "sP1": [0, 0], "kn": 1e4, "cn": 2.0, "kt": 1e3, "ct": 1.0, "r": 0.1}
PUSH = {"name": "push", "type": "PointForce", "body1": 1, "sP1": [0, 0], "frame": "GRF", "funX": "1", "funY": "1"}


@pytest.mark.parametrize(
    ("parts", "says"),
    [
        ({"bodies": []}, ["no bodies"]),
        ({"bodies": 5}, ["bodies", "list", "5"]),
        ({"bodies": [3]}, ["body number 1", "object", "3"]),
        ({"bodies": [body(mass=-1)]}, ["body 'body 1'", "mass", "-1"]),
        ({"bodies": [body(mass="heavy")]}, ["body 'body 1'", "mass", "'heavy'"]),
        ({"bodies": [body(mass=True)]}, ["body 'body 1'", "mass", "True"]),
        ({"bodies": [body(jbar=float("nan"))]}, ["body 'body 1'", "jbar", "finite", "nan"]),
        ({"bodies": [body(q0=[1, 2])]}, ["body 'body 1'", "q0", "3 finite numbers", "[1, 2]"]),
        ({"bodies": [body(id=0)]}, ["body 'body 1'", "id = 0", "ground"]),
        ({"bodies": [body(id=1.5)]}, ["id", "whole number", "1.5"]),
        ({"bodies": [body(1), body(1, name="twin")]}, ["body 'twin'", "id = 1", "'body 1'"]),
        ({"bodies": [body(1), body(2, name="body 1")]}, ["body 1", "twice"]),
        ({"bodies": [{"name": "b", "id": 1, "jbar": 1, "q0": [0, 0, 0]}]}, ["body 'b'", "'mass' is missing"]),
        ({"constraints": [HINGE | {"body2": 9}]}, ["constraint 'hinge'", "body2 = 9", "known ids are 1"]),
        ({"constraints": [HINGE | {"body1": 0}]}, ["hinge", "itself"]),
        ({"constraints": [HINGE | {"body1": "1"}]}, ["constraint 'hinge'", "body1", "'1'"]),
        ({"constraints": [HINGE | {"sP1": 0}]}, ["constraint 'hinge'", "sP1", "2 finite numbers", "0"]),
        ({"constraints": [HINGE | {"fun": "sin(t)"}]}, ["constraint 'hinge'", "sin(t)", "NONE"]),
        ({"constraints": [HINGE | {"type": "Hinge"}]}, ["constraint 'hinge'", "'Hinge'", "RevoluteJoint"]),
        ({"constraints": [X, X]}, ["constraint 'row'", "twice"]),
        ({"constraints": [X | {"body1": 0}]}, ["constraint 'row'", "body1 = 0", "moving body"]),
        ({"constraints": [X | {"fun": "foo(t)"}]}, ["constraint 'row'", "fun", "foo(t)"]),
        ({"constraints": [X | {"fun": None}]}, ["constraint 'row'", "fun", "None"]),
        ({"constraints": [SLIDE | {"vP2": [0, 0]}]}, ["constraint 'hinge'", "vP2", "direction"]),
        ({"constraints": rack_and_pinion(R2=0)}, ["constraint 'mesh'", "R2", "above 0"]),
        ({"constraints": rack_and_pinion(sQ1=[0, 0])}, ["constraint 'mesh'", "sQ1", "direction"]),
        ({"forces": [PUSH | {"frame": "local"}]}, ["force 'push'", "GRF", "'local'"]),
        (
            {"forces": [PUSH | {"type": "PointForceFile", "mfile": "gas"}]},
            ["force 'push'", "gas.m", "Matlab", "forces="],
        ),
        ({"forces": [PUSH | {"type": "PointForceFile"}]}, ["force 'push'", "'mfile' is missing"]),
        ({"forces": [PUSH | {"name": "row"}], "constraints": [X]}, ["'row'", "twice"]),
        (
            {"forces": [{"name": "s", "type": "RSDA1", "body1": 1, "k": 1, "c": 1}]},
            ["force 's'", "'theta0' is missing"],
        ),
        ({"contacts": [{"name": "ball"}]}, ["contact 'ball'", "'body' is missing"]),
        ({"contacts": [BALL | {"body": 0}]}, ["contact 'ball'", "body = 0", "moving body"]),
        ({"contacts": [BALL | {"r": 0}]}, ["contact 'ball'", "r must be above 0"]),
        ({"contacts": [BALL | {"kn": 0}]}, ["contact 'ball'", "kn must be above 0"]),
        ({"contacts": [BALL | {"ct": 0}]}, ["contact 'ball'", "ct = 0", "kt"]),
        ({"contacts": [BALL, BALL]}, ["contact 'ball'", "twice"]),
        ({"sensors": []}, ["'sensors'"]),
        ({"gravity": 9.81}, ["gravity", "9.81"]),
    ],
)
def test_errors_name_the_place(write, parts, says):
    """File, element, field and value."""
    if "bodies" not in parts and any("mesh" in str(c) for c in parts.get("constraints", [])):
        parts = parts | {"bodies": [body(1), body(2)]}
    with pytest.raises(mbd.FileError) as caught:
        mbd.read_adm(write(**parts))
    message = str(caught.value)
    assert all(word in message for word in ["model.adm", *says]), message
    assert "\n" not in message


def test_a_field_given_twice(tmp_path):
    """JSON would keep the last one."""
    path = tmp_path / "m.adm"
    path.write_text(GOOD.replace('"mass": 1.2,', '"mass": 1.2, "mass": 12,'))
    with pytest.raises(mbd.FileError, match=r"body 'crank': the field 'mass' is given more than once"):
        mbd.read_adm(path)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "line 1, column 1"),
        ("{\n  'name': 3}", "line 2, column 3"),
        ("[1]", "JSON object"),
        ("ADAMS/View model name: crank\n!\nUNITS/FORCE = NEWTON", "MSC Adams"),
        ("! a comment\nPART/1, GROUND", "MSC Adams"),
        ("[" * 100_000, "JSON"),
    ],
)
def test_text_that_is_no_model(tmp_path, text, says):
    """Line and column, or what it is."""
    path = tmp_path / "m.adm"
    path.write_text(text)
    with pytest.raises(mbd.FileError, match=says):
        mbd.read_adm(path)


def test_a_file_that_is_not_there(tmp_path):
    """Or is a folder."""
    for path in (tmp_path / "absent.adm", tmp_path):
        with pytest.raises(mbd.FileError, match=str(path)):
            mbd.read_adm(path)


# --- analysis files ----------------------------------------------------------------------------
def test_analysis_files(tmp_path):
    """Kind, end, and outputSteps + 1 times."""
    path = tmp_path / "a.acf"
    path.write_text('{"simulation": "dynamics", "tend": 4.0, "stepSize": 0.005, "outputSteps": 400}')
    analysis = mbd.read_acf(path)
    assert (analysis.kind, analysis.end, analysis.output_steps, analysis.step_size) == ("dynamics", 4.0, 400, 0.005)
    assert analysis.times.size == 401 and analysis.times[0] == 0 and analysis.times[-1] == 4.0
    path.write_text('{"simulation": "Inverse Dynamics", "tend": 1, "outputSteps": 1}')
    assert mbd.read_acf(path).kind == "inverse dynamics"


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"simulation": "Equilibrium"}, ["Equilibrium", "mbd.equilibrium", "kinematics"]),
        ({"simulation": "Magic"}, ["Magic", "kinematics"]),
        ({"simulation": 3}, ["simulation", "3"]),
        ({"tend": 0}, ["tend", "above 0", "0"]),
        ({"tend": "4"}, ["tend", "'4'"]),
        ({"outputSteps": 0}, ["outputSteps", "0"]),
        ({"outputSteps": 2.5}, ["outputSteps", "2.5"]),
        ({"outputSteps": 10**12}, ["outputSteps", "1000000000000"]),
        ({"stepSize": -0.1}, ["stepSize", "-0.1"]),
        ({"simulation": None}, ["simulation", "None"]),
    ],
)
def test_errors_in_analysis_files(tmp_path, change, says):
    """File, field and value."""
    path = tmp_path / "a.acf"
    path.write_text(json.dumps({"simulation": "Dynamics", "tend": 1.0, "outputSteps": 10} | change))
    with pytest.raises(mbd.FileError) as caught:
        mbd.read_acf(path)
    assert all(word in str(caught.value) for word in ["a.acf", *says]), str(caught.value)


def test_the_types_of_rows():
    """The guide of the example is a constraint, not a driver."""
    model = mbd.read_adm(MODELS / "slider_crank.adm")
    assert isinstance(model.joint("main bearing x"), AbsoluteX) and not model.drivers
