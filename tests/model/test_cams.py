"""Cams, followers and curves: rows against closed formulas and differences, motion, forces, refusals."""

import numpy as np
import pytest
from differences import check_balance, check_rows, value_of

import mbdcasadi as mbd

G = 9.81
E, RADIUS, MASS = 0.010, 0.030, 0.5  # eccentric disc on a flat follower
SPEED = 20.0


@pytest.fixture(params=range(2))
def rng(request):
    """Random states."""
    return np.random.default_rng(request.param)


def turn(phi):
    """``A(phi)``."""
    return np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]])


R = turn(np.pi / 2)


# --- the formulas of the catalogue ------------------------------------------------------------
def egg(alpha):
    """Polar outline with its first derivative, in numbers."""
    rho, slope = 0.3 + 0.04 * np.cos(alpha), -0.04 * np.sin(alpha)
    e, f = np.array([np.cos(alpha), np.sin(alpha)]), np.array([-np.sin(alpha), np.cos(alpha)])
    return rho * e, slope * e + rho * f


EGG = mbd.CamOutline(lambda alpha: 0.3 + 0.04 * mbd.cos(alpha))
S_A, S_B, ANGLE_A, ANGLE_B = np.array([0.05, -0.02]), np.array([-0.04, 0.03]), 0.4, -0.2


def two_bodies(make):
    """An element between two moving bodies, one above the other."""
    a = mbd.Body("a", mass=1, inertia=0.2, pose=(0.1, 0.2, 0.3))
    b = mbd.Body("b", mass=1, inertia=0.2, pose=(0.2, 0.65, -0.1))
    element = make(a.at(*S_A, angle=ANGLE_A), b.at(*S_B, angle=ANGLE_B))
    return element, mbd.Mechanism([a, b], [element])


def rows_of_the_catalogue(kind, q, alpha, beta=None):
    """Phi by hand."""
    (r_i, phi_i), (r_j, phi_j) = (q[:2], q[2]), (q[3:5], q[5])
    A_i, A_j = turn(phi_i), turn(phi_j)
    C_i, C_j = turn(ANGLE_A), turn(ANGLE_B)
    s, g = egg(alpha)
    contact, tangent = r_i + A_i @ (S_A + C_i @ s), A_i @ C_i @ g
    point = r_j + A_j @ S_B
    if kind == "flat":
        v = A_j @ C_j @ np.array([1.0, 0.0])
        return np.array([(R @ v) @ (contact - point), (R @ v) @ tangent])
    if kind == "point":
        return contact - point
    s_j, g_j = egg(beta)
    # the tangency row is scaled by the size of outline b, its largest extent along an axis
    angles = np.linspace(0, 2 * np.pi, 1440, endpoint=False)
    size = np.max(np.ptp(np.array([egg(x)[0] for x in angles]), axis=0))
    parallel = (R @ tangent) @ (A_j @ C_j @ g_j) / size
    return np.r_[contact - point - A_j @ C_j @ s_j, parallel]


KINDS = {
    "flat": lambda a, b: mbd.CamFlatFollower("c", a, b, EGG),
    "point": lambda a, b: mbd.CamPointFollower("c", a, b, EGG),
    "cam": lambda a, b: mbd.CamCam("c", a, b, EGG, EGG),
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_rows_are_those_of_the_catalogue(kind, rng):
    """Phi by the formulas; Phi_q by differences of these formulas; gamma by differences."""
    _, mechanism = two_bodies(KINDS[kind])
    eom = mbd.equations(mechanism)
    n = eom.q.numel()
    q = np.r_[0.1, 0.2, 0.3, 0.2, 0.65, -0.1, np.zeros(n - 6)] + rng.normal(size=n) * 0.3
    v = rng.normal(size=n)
    wanted = rows_of_the_catalogue(kind, q, *q[6:])
    np.testing.assert_allclose(value_of(mechanism, eom.Phi, q, v).ravel(), wanted, atol=1e-13)
    jacobian = value_of(mechanism, eom.Phi_q, q, v)
    for k in range(n):
        h = 1e-6 * np.eye(n)[k]
        slope = rows_of_the_catalogue(kind, q + h, *(q + h)[6:]) - rows_of_the_catalogue(kind, q - h, *(q - h)[6:])
        np.testing.assert_allclose(jacobian[:, k], slope / 2e-6, atol=1e-8)
    check_rows(mechanism, q, v)


PROGRAM = mbd.MotionProgram(mbd.rise(2.0, 0.02), mbd.dwell(1.0), mbd.fall(2 * np.pi - 3.0, "3-4-5"))
NOSE = [(0.2 * np.cos(x) + 0.05 * np.cos(x) ** 3, 0.2 * np.sin(x)) for x in np.linspace(0, 6, 25)]
CROSSED = [(0.03, 0), (-0.03, 0), (0, 0.03), (0, -0.03), (0.021, 0.021)]
MORE = {
    "roller": lambda a, b: mbd.CamPointFollower("c", a, b, EGG, 0.05),
    "points and flat": lambda a, b: mbd.CamFlatFollower("c", a, b, mbd.CamOutline.through(NOSE)),
    "points and roller": lambda a, b: mbd.CamPointFollower("c", a, b, mbd.CamOutline.through(NOSE), 0.03),
    "radii": lambda a, b: mbd.CamPointFollower("c", a, b, mbd.CamOutline([0.3, 0.31, 0.33, 0.3, 0.29, 0.3]), 0.02),
    "program and flat": lambda a, b: mbd.CamFlatFollower("c", a, b, mbd.CamOutline.for_flat_follower(PROGRAM, 0.1)),
    "program and roller": lambda a, b: mbd.CamPointFollower(
        "c", a, b, mbd.CamOutline.for_roller_follower(PROGRAM, 0.1, 0.02, 0.01), 0.02
    ),
    "slot": lambda a, b: mbd.PointOnCurve("c", a, b, mbd.Curve(lambda s: (s, s**2 + mbd.sin(s)), -2, 2)),
    "closed slot": lambda a, b: mbd.PointOnCurve("c", a, b, mbd.Curve.through(NOSE, closed=True)),
    "slot through points": lambda a, b: mbd.PointOnCurve("c", a, b, mbd.Curve.through(NOSE[:9])),
}


@pytest.mark.parametrize("kind", MORE)
def test_rows_of_other_outlines_against_differences(kind, rng):
    """Splines, programs, rollers, slots."""
    element, mechanism = two_bodies(MORE[kind])
    n = 7
    q = np.r_[0.1, 0.2, 0.3, 0.2, 0.65, -0.1, element.parameter.value] + rng.normal(size=n) * 0.03
    check_rows(mechanism, q, rng.normal(size=n), tolerance=1e-6)


@pytest.mark.parametrize("kind", KINDS | MORE)
def test_reactions_balance(kind, rng):
    """What the contact exerts on both bodies cancels, force and moment."""
    element, mechanism = two_bodies((KINDS | MORE)[kind])
    q = mbd.assemble(mechanism).q  # the points of contact coincide
    check_balance(element, mechanism, q, np.zeros(q.size), rng)


# --- eccentric disc on a flat-faced follower ------------------------------------------------------
def tappet(**more):
    """The disc turns about the origin; the follower sits above."""
    cam = mbd.Body("cam", mass=1.0, inertia=1e-3, pose=(E, 0, 0))
    follower = mbd.Body("follower", mass=MASS, inertia=1e-3, pose=(0, RADIUS, 0))
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(-E, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), follower.at(0, 0, angle=np.pi / 2))
    contact = mbd.CamFlatFollower("tappet", cam.at(0, 0), follower.at(0, 0), mbd.CamOutline(RADIUS))
    drive = mbd.Driver("drive", shaft.angle, more.pop("speed", SPEED) * mbd.t)
    mechanism = mbd.Mechanism([cam, follower], [shaft, guide, contact], [drive], forces=[mbd.Gravity()], **more)
    return cam, follower, contact, drive, mechanism


def test_eccentric_disc_with_flat_follower():
    """y = R + e sin(θ); N = m (g + ÿ); torque = (N + m_c g) e cos(θ); nothing from the tangency row; many turns."""
    cam, follower, contact, drive, mechanism = tappet()
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 10, 1001))
    s, c = np.sin(SPEED * run.t), np.cos(SPEED * run.t)
    np.testing.assert_allclose(run[follower.y], RADIUS + E * s, atol=1e-14)
    np.testing.assert_allclose(run[follower.vy], E * SPEED * c, atol=1e-12)
    normal = MASS * (G - E * SPEED**2 * s)
    np.testing.assert_allclose(run[contact.normal_force], normal, atol=1e-10)
    np.testing.assert_allclose(run[contact.reaction_on(follower).force], np.column_stack([0 * s, normal]), atol=1e-10)
    np.testing.assert_allclose(run[contact.reaction_on(cam).force][:, 1], -normal, atol=1e-10)
    np.testing.assert_allclose(run[drive.effort], (normal + 1.0 * G) * E * c, atol=1e-10)
    np.testing.assert_allclose(run[contact.multipliers[1]], 0, atol=1e-10)
    # the disc touches at its top: the parameter turns back as the cam turns
    np.testing.assert_allclose(run[contact.parameter], np.pi / 2 - SPEED * run.t, atol=1e-9)
    np.testing.assert_allclose(run[contact.contact_point][:, 0], E * c, atol=1e-12)


def test_guide_takes_the_moment_of_the_offset_contact():
    """The contact wanders by e cos(θ) along the face: the guide's couple about the follower is N e cos(θ)."""
    _, follower, contact, _, mechanism = tappet()
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 1, 51))
    couple = run[mechanism.joint("guide").reaction_on(follower).torque]
    arm = E * np.cos(SPEED * run.t)
    np.testing.assert_allclose(couple, -run[contact.normal_force] * arm, atol=1e-10)


def test_follower_on_either_side():
    """The face below the cam: the contact is at the bottom, and the force still counts as pressing."""
    cam = mbd.Body("cam", mass=1.0, inertia=1e-3, pose=(E, 0, 0))
    table = mbd.Body("table", mass=MASS, inertia=1e-3, pose=(0, -RADIUS, 0))
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(-E, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), table.at(0, 0, angle=np.pi / 2))
    contact = mbd.CamFlatFollower("tappet", cam.at(0, 0), table.at(0, 0), mbd.CamOutline(RADIUS))
    push = mbd.Force("push", table.at(0, 0), (0, 30.0))
    drive = mbd.Driver("drive", shaft.angle, 5 * mbd.t)
    mechanism = mbd.Mechanism([cam, table], [shaft, guide, contact], [drive], forces=[push])
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 1, 21))
    s = np.sin(5 * run.t)
    np.testing.assert_allclose(run[table.y], -RADIUS + E * s, atol=1e-14)
    np.testing.assert_allclose(run[contact.normal_force], 30 + MASS * E * 25 * s, rtol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_cam_in_simulation_conserves_energy(method):
    """Contact parameters have no inertia and need no settings; every integrator takes them."""
    cam, follower, _contact, _, mechanism = tappet()
    free = mechanism.replace(drivers=[])
    run = mbd.simulate(free, duration=2.0, initial=[cam.phi == 0, cam.omega == 10], method=method)
    assert np.ptp(run.energy.total) < 1e-6
    assert run.drift.position < 1e-14
    np.testing.assert_allclose(run[follower.y], RADIUS + E * np.sin(run[cam.phi]), atol=1e-14)


def test_lift_off_is_told_and_can_end_the_run():
    """At constant speed where sin(θ) = g / (e ω²); the event is located there."""
    speed = 40.0
    _, _, contact, _, mechanism = tappet(speed=speed)
    with pytest.warns(mbd.MechanismWarning, match="'tappet': the contact force is negative.*first at t = "):
        mbd.inverse_dynamics(mechanism, np.linspace(0, 0.1, 101))
    run = mbd.simulate(mechanism, np.linspace(0, 0.1, 101), events=[contact.lift_off()])
    assert run.t[-1] == pytest.approx(np.arcsin(G / (E * speed**2)) / speed, abs=1e-7)
    assert run.events[0].name == "lift-off at tappet"


# --- followers that move by a program -----------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("law", ["cycloidal", "modified trapezoidal", "3-4-5", "harmonic"])
@pytest.mark.parametrize("roller,offset", [(None, 0.0), (0.0, 0.0), (0.008, 0.0), (0.008, 0.006)])
def test_profiles_give_back_the_program(law, roller, offset):
    """Flat face, knife edge, roller, offset roller: the lift is the program's, at every angle."""
    program = mbd.MotionProgram(
        mbd.rise(1.9, 0.006, law), mbd.dwell(0.8), mbd.fall(2.1, law), mbd.dwell(2 * np.pi - 4.8)
    )
    cam = mbd.library.cam_follower(program, 0.04, roller, offset)
    run = mbd.kinematics(cam.driven(cam=3 * mbd.t), np.linspace(0, 4, 401))
    lift = run[cam.coordinates["lift"]]
    np.testing.assert_allclose(lift - lift[0], program(3 * run.t), atol=1e-12)


def test_flat_profile_by_its_support_function():
    """Points, normals and curvature of the profile for y = R + s(θ): the curvature radius is R + s + s''."""
    outline = mbd.CamOutline.for_flat_follower(lambda angle: 0.005 * (1 - mbd.cos(2 * angle)), 0.04)
    alpha = np.linspace(0, 6, 13)
    lift = 0.005 * (1 - np.cos(2 * (np.pi / 2 - alpha)))
    bend = 0.005 * 4 * np.cos(2 * (np.pi / 2 - alpha))
    np.testing.assert_allclose(1 / outline.curvatures(alpha), 0.04 + lift + bend, rtol=1e-12)
    points, normals = outline.points_and_normals(alpha)
    np.testing.assert_allclose(np.sum(points * normals, axis=0), 0.04 + lift, rtol=1e-12)


def test_pressure_angle_of_a_roller_follower():
    """tan = (s' - offset) / height for a guide offset to the left of the upward direction."""
    cam = mbd.library.cam_follower(PROGRAM, 0.08, 0.01)
    run = mbd.kinematics(cam.driven(cam=mbd.t), np.linspace(0.2, 1.8, 9))
    slope = run[cam.coordinates["lift"]] * 0 + run[mbd.time_derivative(cam.coordinates["lift"])]
    height = run[cam.follower.y]
    np.testing.assert_allclose(np.abs(np.tan(run[cam.contact.pressure_angle])), slope / height, rtol=1e-9)


# --- equivalents -----------------------------------------------------------------------------------
def test_roller_on_a_disc_is_a_link_between_the_centres():
    """Motion and bearing force as with a massless Distance of both radii."""

    def build(joint):
        cam = mbd.Body("cam", mass=1.0, inertia=1e-3, pose=(0.012, 0.005, 0.4))
        follower = mbd.Body("follower", mass=MASS, inertia=1e-3, pose=(0, 0.042, 0))
        shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(-0.013, 0))
        guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=np.pi / 2), follower.at(0, 0, angle=np.pi / 2))
        element = joint(cam.at(0, 0), follower.at(0, 0))
        mechanism = mbd.Mechanism([cam, follower], [shaft, guide, element], forces=[mbd.Gravity()])
        start = mbd.assemble(mechanism, [cam.phi == 0.4, cam.omega == 12])
        run = mbd.simulate(mechanism, duration=1.0, initial=start, reltol=1e-10, abstol=1e-10)
        return run[cam.phi], run[element.reaction_on(follower).force], run, element

    rolled = build(lambda a, b: mbd.CamPointFollower("j", a, b, mbd.CamOutline(0.03), 0.01))
    linked = build(lambda a, b: mbd.Distance("j", a, b, 0.04))
    np.testing.assert_allclose(rolled[0], linked[0], atol=1e-7)
    np.testing.assert_allclose(rolled[1], linked[1], atol=1e-5)
    np.testing.assert_allclose(rolled[2][rolled[3].normal_force], np.linalg.norm(rolled[1], axis=1), rtol=1e-9)


def test_two_discs_are_a_link_between_the_centres():
    """Cam on cam: the same with a disc on a rocker."""

    def build(joint):
        cam = mbd.Body("cam", mass=1.0, inertia=1e-3, pose=(0.01, 0, 0.0))
        rocker = mbd.Body("rocker", mass=MASS, inertia=1e-3, pose=(0.005, 0.06, 0.1))
        pins = [
            mbd.Revolute("shaft", mbd.ground.at(0, 0), cam.at(-0.01, 0)),
            mbd.Revolute("pivot", mbd.ground.at(0.1, 0.06), rocker.at(0.095, 0)),
        ]
        element = joint(cam.at(0, 0, angle=0.3), rocker.at(0, 0, angle=1.0))
        mechanism = mbd.Mechanism([cam, rocker], [*pins, element], forces=[mbd.Gravity()])
        start = mbd.assemble(mechanism, [cam.phi == 0.2, cam.omega == 15])
        run = mbd.simulate(mechanism, duration=1.0, initial=start, reltol=1e-10, abstol=1e-10)
        return run[cam.phi], run[element.reaction_on(rocker).force], run, element

    outlines = mbd.CamOutline(0.03), mbd.CamOutline(0.03)
    touching = build(lambda a, b: mbd.CamCam("j", a, b, *outlines))
    linked = build(lambda a, b: mbd.Distance("j", a, b, 0.06))
    np.testing.assert_allclose(touching[0], linked[0], atol=1e-7)
    np.testing.assert_allclose(touching[1], linked[1], atol=1e-5)
    np.testing.assert_allclose(touching[2][touching[3].normal_force], np.linalg.norm(touching[1], axis=1), rtol=1e-9)


def test_elliptic_wheels_on_their_foci():
    """Two equal ellipses, pivoted at foci 2a apart, touch on the line of the pivots: r1 + r2 = 2a (elliptic gears)."""
    a, e = 0.1, 0.5
    p, b = a * (1 - e**2), a * np.sqrt(1 - e**2)

    def ellipse():
        # about its centre; the focus that is the pivot lies at +a e
        return mbd.CamOutline(lambda x: a * b / mbd.sqrt((b * mbd.cos(x)) ** 2 + (a * mbd.sin(x)) ** 2))

    def second_angle(angle):
        r2 = 2 * a - p / (1 + e * np.cos(angle))
        return np.arccos((p / r2 - 1) / e) - np.pi

    start = 0.3  # at 0 and π the normal goes through both pivots, a dead point of two cams
    one, other = start, second_angle(start)
    first = mbd.Body("first", 1, 0.01, pose=(-a * e * np.cos(one), -a * e * np.sin(one), one))
    second = mbd.Body("second", 1, 0.01, pose=(2 * a - a * e * np.cos(other), -a * e * np.sin(other), other))
    pins = [
        mbd.Revolute("A", mbd.ground.at(0, 0), first.at(a * e, 0)),
        mbd.Revolute("B", mbd.ground.at(2 * a, 0), second.at(a * e, 0)),
    ]
    contact = mbd.CamCam("wheels", first.at(0, 0), second.at(0, 0), ellipse(), ellipse())
    drive = mbd.Driver("drive", first.phi, start + mbd.t)
    run = mbd.kinematics(mbd.Mechanism([first, second], [*pins, contact], [drive]), np.linspace(0, 2.5, 126))
    r1 = p / (1 + e * np.cos(start + run.t))
    # the contact lies on the line of the pivots, and the wheels turn against each other as r1 to r2
    np.testing.assert_allclose(run[contact.contact_point], np.column_stack([r1, 0 * r1]), atol=1e-10)
    np.testing.assert_allclose(run[second.omega], -r1 / (2 * a - r1), rtol=1e-9)
    np.testing.assert_allclose(run[second.phi], second_angle(start + run.t), atol=1e-9)


def test_coarse_steps_stay_on_the_branch():
    """A cam that turns by two radians between outputs: steps are divided, the contact does not jump over."""
    _, follower, contact, _, mechanism = tappet()
    run = mbd.kinematics(mechanism, np.linspace(0, 2, 21))
    np.testing.assert_allclose(run[follower.y], RADIUS + E * np.sin(SPEED * run.t), atol=1e-13)
    np.testing.assert_allclose(run[contact.parameter], np.pi / 2 - SPEED * run.t, atol=1e-9)


def test_pin_in_a_circular_slot_is_a_pendulum():
    """A bead in a circular slot against the closed formula: ω² = 2 g/L (cos φ - cos φ0); force by Newton."""
    length, mass = 0.8, 1.5
    bead = mbd.Body("bead", mass=mass, inertia=0.01, pose=(length * np.sin(0.9), -length * np.cos(0.9), 0))
    slot = mbd.Curve(lambda s: (length * mbd.sin(s), -length * mbd.cos(s)), -np.pi, np.pi, closed=True)
    joint = mbd.PointOnCurve("slot", mbd.ground.at(0, 0), bead.at(0, 0), slot)
    hold = mbd.AbsoluteAngle("no turning", bead.at(0, 0))
    mechanism = mbd.Mechanism([bead], [joint, hold], forces=[mbd.Gravity()])
    run = mbd.simulate(mechanism, duration=2.0, reltol=1e-10, abstol=1e-10)
    phi = run[joint.parameter]
    rate = 2 * G / length * (np.cos(phi) - np.cos(0.9))
    np.testing.assert_allclose(run[joint.parameter.velocity] ** 2, rate, atol=1e-7)
    tension = mass * (G * np.cos(phi) + length * rate)
    # the normal is to the right of the tangent: outwards, while the rail pulls inwards
    np.testing.assert_allclose(run[joint.normal_force], -tension, rtol=1e-7)


def test_pin_driven_along_its_slot():
    """The parameter is a coordinate like others: driven, it prescribes the motion; the effort by the power."""
    bead = mbd.Body("bead", mass=2.0, inertia=0.01)
    slot = mbd.Curve(lambda s: (s, s**2), -1.5, 1.5)
    joint = mbd.PointOnCurve("slot", mbd.ground.at(0, 0), bead.at(0, 0), slot)
    drive = mbd.Driver("drive", joint.parameter, mbd.sin(mbd.t))
    joints = [joint, mbd.AbsoluteAngle("no turning", bead.at(0, 0))]
    run = mbd.inverse_dynamics(mbd.Mechanism([bead], joints, [drive], forces=[mbd.Gravity()]), np.linspace(0, 3, 61))
    s = np.sin(run.t)
    np.testing.assert_allclose(run[bead.position], np.column_stack([s, s**2]), atol=1e-12)
    power = 2 * run[mbd.dot(bead.velocity, bead.acceleration)] + 2 * G * run[bead.vy]
    np.testing.assert_allclose(run[drive.effort] * np.cos(run.t), power, atol=1e-10)


def test_fixed_cam_and_moving_face():
    """The cam is the ground: a plate slides over a fixed egg."""
    plate = mbd.Body("plate", mass=1.0, inertia=0.1, pose=(0, 0.36, 0.1))
    contact = mbd.CamFlatFollower("rest", mbd.ground.at(0, 0), plate.at(0, 0), EGG)
    slide = mbd.AbsoluteX("no sliding", plate.at(0, 0))
    drive = mbd.Driver("tilt", plate.phi, 0.1 + mbd.t)
    run = mbd.kinematics(mbd.Mechanism([plate], [contact, slide], [drive]), np.linspace(0, 1, 21))
    # the highest point of the egg over the tilted face, by search
    points, _ = EGG.points_and_normals(np.linspace(0, 2 * np.pi, 200_001))
    for phi, y in zip(run[plate.phi], run[plate.y], strict=True):
        height = np.max(points[1] * np.cos(phi) - points[0] * np.sin(phi)) / np.cos(phi)
        assert y == pytest.approx(height, abs=1e-9)


def test_point_that_leaves_the_end_of_a_slot_is_told():
    """A straight slot of 0.2 m, and a fall of more."""
    bead = mbd.Body("bead", mass=1, inertia=0.01)
    slot = mbd.Curve(lambda s: (0 * s, -s), -0.1, 0.1)
    joints = [mbd.PointOnCurve("slot", mbd.ground.at(0, 0), bead.at(0, 0), slot), mbd.AbsoluteAngle("a", bead.at(0, 0))]
    with pytest.warns(mbd.MechanismWarning, match="'slot': the point has left the curve"):
        mbd.simulate(mbd.Mechanism([bead], joints, forces=[mbd.Gravity()]), duration=0.3)


# --- refusals ------------------------------------------------------------------------------------------
def markers():
    """Two markers that a cam may use."""
    a = mbd.Body("a", mass=1, inertia=1)
    return a.at(0, 0), mbd.Body("b", mass=1, inertia=1, pose=(0, 0.4, 0)).at(0, 0)


def test_hollow_is_refused_for_a_flat_face():
    """ρ = 0.1 + 0.05 cos 2α is concave at the sides: ρ² + 2ρ'² - ρρ'' < 0 at ±π/2; the place is named."""
    outline = mbd.CamOutline(lambda a: 0.1 + 0.05 * mbd.cos(2 * a))
    with pytest.raises(
        mbd.ModelError, match=r"'c'.*flat face cannot follow.*parameter 1\.571.*\(.*0\.05\) m.*curvature"
    ):
        mbd.CamFlatFollower("c", *markers(), outline)


def test_narrow_hollow_is_refused_for_a_roller():
    """The hollow of that outline has the radius ρ²/(ρ'' - ρ) = 0.05²/0.15 m; a roller of 10 mm fits, of 20 mm not."""
    outline = mbd.CamOutline(lambda a: 0.1 + 0.05 * mbd.cos(2 * a))
    mbd.CamPointFollower("c", *markers(), outline, 0.010)
    with pytest.raises(
        mbd.ModelError, match=r"'c'.*radius 0.02 m does not fit into the hollow.*curvature there is 0\.01667"
    ):
        mbd.CamPointFollower("c", *markers(), outline, 0.020)


def test_hollow_into_which_no_part_of_the_other_fits():
    """The same with a disc of 20 mm as the other cam."""
    outline = mbd.CamOutline(lambda a: 0.1 + 0.05 * mbd.cos(2 * a))
    mbd.CamCam("c", *markers(), outline, mbd.CamOutline(0.01))
    with pytest.raises(mbd.ModelError, match="'c': no part of the other outline fits into the hollow"):
        mbd.CamCam("c", *markers(), outline, mbd.CamOutline(0.02))


def test_curvature_by_the_formula_of_polar_curves():
    """(ρ² + 2ρ'² - ρρ'') / (ρ² + ρ'²)^(3/2)."""
    alpha = np.linspace(0, 6, 25)
    rho, d1, d2 = 0.1 + 0.05 * np.cos(2 * alpha), -0.1 * np.sin(2 * alpha), -0.2 * np.cos(2 * alpha)
    wanted = (rho**2 + 2 * d1**2 - rho * d2) / (rho**2 + d1**2) ** 1.5
    outline = mbd.CamOutline(lambda a: 0.1 + 0.05 * mbd.cos(2 * a))
    np.testing.assert_allclose(outline.curvatures(alpha), wanted, rtol=1e-10)


@pytest.mark.slow
def test_undercut_profiles_are_refused_with_the_angle():
    """A fast rise on a small base: the flat face needs R > -(s + s'')."""
    steep = mbd.MotionProgram(mbd.rise(0.5, 0.02), mbd.dwell(1.0), mbd.fall(2 * np.pi - 1.5))
    with pytest.raises(mbd.ModelError, match="undercut where the cam has turned by .* rad: its radius of curvature"):
        mbd.CamOutline.for_flat_follower(steep, 0.02)
    with pytest.raises(mbd.ModelError, match="undercut where the cam has turned by .* rad: the path of the roller"):
        mbd.CamOutline.for_roller_follower(steep, 0.02, 0.02)
    # the peak of -s - s'' by differences of the program, and a base just above and just below it
    angle = np.linspace(0, 2 * np.pi, 200_001)
    lift = steep(angle)
    needed = np.max(-lift[1:-1] - np.diff(lift, 2) / (angle[1] - angle[0]) ** 2)
    mbd.CamOutline.for_flat_follower(steep, 1.001 * needed)
    with pytest.raises(mbd.ModelError, match="undercut"):
        mbd.CamOutline.for_flat_follower(steep, 0.99 * needed)


def test_parameter_that_makes_a_hollow_is_refused_in_the_analysis():
    """The outline holds a parameter; its own value is fine, the analysis' value is not."""
    depth = mbd.Parameter("depth", 0.01)
    a, b = markers()
    contact = mbd.CamFlatFollower("c", a, b, mbd.CamOutline(lambda x: 0.1 + depth * mbd.cos(2 * x)))
    mechanism = mbd.Mechanism([a.body, b.body], [contact], parameters=[depth])
    mbd.assemble(mechanism)
    with pytest.raises(mbd.ModelError, match="'c': curvature of the outline at the parameter .*'depth' = 0.05"):
        mbd.assemble(mechanism, parameters={depth: 0.05})


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda: mbd.CamOutline(0.0), "radius must be above 0"),
        (lambda: mbd.CamOutline(lambda a: mbd.cos(a)), "radius must be above 0, got"),
        (lambda: mbd.CamOutline(lambda a: 0.1 + 0.01 * a), "does not close"),
        (lambda: mbd.CamOutline([0.1] * 4), "takes at least 5 values of the radius, got 4"),
        (lambda: mbd.CamOutline([0.1] * 5, [0, 1, 3, 2, 5]), "angles must increase, got 3 and 2"),
        (lambda: mbd.CamOutline([0.1, 0.1, 0.1, np.nan, 0.1]), "must be finite"),
        (lambda: mbd.CamOutline([0.1] * 5, [0, 1, 2, 3, 7]), "go round once or more"),
        (lambda: mbd.CamOutline([0.1] * 5, [0, 1, 2]), "5 radii do not go with 3 angles"),
        (lambda: mbd.CamOutline("disc"), "radius must be"),
        (lambda: mbd.CamOutline.through([(0, 0), (1, 0), (1, 1), (0, 1)]), "at least 5 pairs"),
        (lambda: mbd.Curve.through([(0, 0), (1, 0), (1, 1)]), "at least 4 pairs"),
        (lambda: mbd.CamOutline.through([(0, 0), (1, 0), (1, 0), (1, 1), (0, 1)]), "coincide"),
        (lambda: mbd.CamOutline.through(NOSE, closed=False), "an outline closes"),
        (lambda: mbd.Curve(lambda s: (s**3, s**2), -1, 1.001), "cusp"),
        (lambda: mbd.Curve(lambda s: (s, s), 1, 0), "upper must be above lower"),
        (lambda: mbd.Curve(lambda s: s, 0, 1), "two coordinates, got 1"),
        (lambda: mbd.Curve((0, 1), 0, 1), "must be a function"),
        (lambda: mbd.Curve(lambda s: (s, mbd.sqrt(s)), -1, 1), "no finite point or tangent"),
        (
            lambda: mbd.CamOutline.for_flat_follower(mbd.MotionProgram(mbd.rise(1, 0.1), mbd.fall(1)), 0.1),
            "one turn, 2π",
        ),
        (lambda: mbd.CamOutline.for_roller_follower(lambda a: 0 * a, 0.1, -0.1), "roller_radius must be at least 0"),
        (lambda: mbd.CamOutline.for_roller_follower(lambda a: 0 * a, 0.1, 0.0, 0.2), "offset 0.2 m is not less"),
        (lambda: mbd.CamFlatFollower("c", *markers(), 0.1), "'c': the outline must be a CamOutline"),
        (lambda: mbd.PointOnCurve("c", *markers(), 0.1), "'c': curve must be a Curve"),
        (lambda: mbd.CamOutline(lambda: 0.1), "CamOutline: radius must be a function of the angle: too many"),
        (
            lambda: mbd.CamOutline.for_flat_follower(lambda a, b: a, 0.1),
            "program must be a function of the angle: miss",
        ),
        (lambda: mbd.Curve(lambda: (0, 0), 0, 1), "Curve: point must be a function of the parameter: too many"),
        (lambda: mbd.Curve(lambda s: (s, s), 0, 1, closed="no"), "Curve: closed must be True or False, got 'no'"),
        (lambda: mbd.CamOutline.through(CROSSED), "the outline crosses itself near"),
        (lambda: mbd.CamPointFollower("c", *markers(), EGG, -1), "'c': roller_radius must be at least 0"),
    ],
)
def test_outlines_and_curves_that_make_no_sense(make, said):
    """Each message says what and where."""
    with pytest.raises(mbd.ModelError, match=said):
        make()


@pytest.mark.parametrize("knife", [True, False])
def test_parameter_that_makes_the_radius_negative_is_refused_in_the_analysis(knife):
    """As a number is, when the outline is made."""
    wave = mbd.Parameter("wave", 0.001)
    outline = mbd.CamOutline(lambda x: 0.03 + wave * mbd.cos(3 * x))
    a, b = markers()
    disc = mbd.CamOutline(0.01)
    contact = mbd.CamPointFollower("c", a, b, outline) if knife else mbd.CamCam("c", a, b, outline, disc)
    mechanism = mbd.Mechanism([a.body, b.body], [contact], parameters=[wave])
    mbd.assemble(mechanism, parameters={wave: 0.002})
    with pytest.raises(mbd.ModelError, match="'c': radius of the outline at the parameter .*'wave' = 0.05"):
        mbd.assemble(mechanism, parameters={wave: 0.05})


def test_curve_of_a_coordinate_is_refused():
    """A curve is fixed in its body: parameters only."""
    body = mbd.Body("b", mass=1, inertia=1)
    with pytest.raises(mbd.ExpressionError, match=r"parameters only, not position 'b\.x'"):
        mbd.CamOutline(lambda a: 0.1 + 0.001 * body.x * mbd.cos(a))


def test_points_in_either_sense_give_the_same_outline():
    """Clockwise points are turned round, so that the normal points outward."""
    one, other = mbd.CamOutline.through(NOSE), mbd.CamOutline.through(NOSE[::-1])
    for outline in (one, other):
        points, normals = outline.points_and_normals(outline.samples)
        assert np.all(np.sum(points * normals, axis=0) > 0)
    knots = np.array(NOSE)
    for outline in (one, other):
        points = outline.points_and_normals(np.linspace(0, 2 * np.pi, 20_000))[0].T
        assert all(np.min(np.hypot(*(points - knot).T)) < 1e-4 for knot in knots)
