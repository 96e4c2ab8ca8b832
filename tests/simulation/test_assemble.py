"""Assembly: consistent to rounding, nearest in the mass metric, on the branch of the estimate, or refused in words."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_case
from scipy.optimize import minimize
from seeds import seeds

import mbdcasadi as mbd

G = 9.81
#: Distance from the minimum that Newton's method on its conditions finds.
NEAREST = 1e-8
#: Estimates at the true pose.
EXACT = np.zeros((3, 3))


# --- linkages with known poses ---------------------------------------------------------------
def rod_pose(start, end) -> np.ndarray:
    """Pose of a rod between two points."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    return np.array([*(start + end) / 2, np.arctan2(*(end - start)[::-1])])


def bars(names, lengths, poses, off):
    """Uniform rods at poses that are off."""
    return [
        mbd.Body(n, mass=length, inertia=length**3 / 12, pose=p + o)
        for n, length, p, o in zip(names, lengths, poses, off, strict=True)
    ]


def four_bar(off=EXACT, angle=1.0, **more):
    """Crank-rocker 0.3, 1.0, 0.8 on a base of 1.0 m, elbow up at the true pose."""
    a, b, c, base = 0.3, 1.0, 0.8, 1.0
    crank_pin = a * np.array([np.cos(angle), np.sin(angle)])
    rocker_pin = elbow(crank_pin, [base, 0], b, c)
    poses = [rod_pose((0, 0), crank_pin), rod_pose(crank_pin, rocker_pin), rod_pose((base, 0), rocker_pin)]
    crank, coupler, rocker = bars(("crank", "coupler", "rocker"), (a, b, c), poses, off)
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-a / 2, 0)),
        mbd.Revolute("B", crank.at(a / 2, 0), coupler.at(-b / 2, 0)),
        mbd.Revolute("C", coupler.at(b / 2, 0), rocker.at(c / 2, 0)),
        mbd.Revolute("D", mbd.ground.at(base, 0), rocker.at(-c / 2, 0)),
    ]
    return mbd.Mechanism(bodies=[crank, coupler, rocker], joints=joints, forces=[mbd.Gravity()], **more)


def elbow(start, end, first, second) -> np.ndarray:
    """Point at two distances from two points, to the left of the way between them."""
    start, end = np.asarray(start, float), np.asarray(end, float)
    way = end - start
    length = np.hypot(*way)
    along = (first**2 - second**2 + length**2) / (2 * length)
    height = np.sqrt(first**2 - along**2)
    e = way / length
    return start + along * e + height * np.array([-e[1], e[0]])


def slider_crank(off=EXACT, angle=0.6):
    """Crank 0.3, rod 0.8 m, slider to the right at the true pose."""
    r, length = 0.3, 0.8
    pin = r * np.array([np.cos(angle), np.sin(angle)])
    wrist = np.array([pin[0] + np.sqrt(length**2 - pin[1] ** 2), 0])
    poses = [rod_pose((0, 0), pin), rod_pose(pin, wrist), np.array([wrist[0], 0, 0])]
    crank, rod = bars(("crank", "rod"), (r, length), poses[:2], off[:2])
    slider = mbd.Body("slider", mass=2.0, inertia=0.02, pose=poses[2] + off[2])
    joints = [
        mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-r / 2, 0)),
        mbd.Revolute("B", crank.at(r / 2, 0), rod.at(-length / 2, 0)),
        mbd.Revolute("C", rod.at(length / 2, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    return mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=[mbd.Gravity()])


def pendulum(**more):
    """A rod of a metre on a pin."""
    arm = mbd.Body("arm", mass=1.2, inertia=0.1, **({"pose": (0.27, 0.42, 1.0)} | more))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    return arm, mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])


def free_body(**more):
    """One body that nothing holds."""
    body = mbd.Body("body", mass=2.0, inertia=0.5, **more)
    return body, mbd.Mechanism(bodies=[body])


def residuals(state) -> tuple[float, float, float, float]:
    """Largest ``Phi``, ``Phi_q v - nu``, ``Phi_q a - gamma`` and ``M a + Phi_q^T lam - Q``, the last two relative."""
    eom = state.equations
    size = 1 + np.max(np.abs(np.r_[state.a, state.lam]))
    parts = (
        eom.Phi,
        eom.Phi_q @ eom.v - eom.nu,
        eom.Phi_q @ eom.a - eom.gamma,
        eom.M @ eom.a + eom.Phi_q.T @ eom.lam - eom.Q,
    )
    position, velocity, acceleration, force = (np.max(np.abs(state[part]), initial=0.0) for part in parts)
    return position, velocity, acceleration / size, force / size


# --- consistent --------------------------------------------------------------------------------
@pytest.mark.parametrize("seed", seeds(200, quick=10))
def test_the_state_is_consistent(seed):
    """Position and velocity to 1e-12, accelerations and multipliers solve the equations of motion; also redundant."""
    case = random_case(seed, driven=seed % 3 == 2)
    position, velocity, acceleration, force = residuals(mbd.assemble(case.mechanism))
    assert position <= 1e-12
    assert velocity <= 1e-11
    assert acceleration <= (1e-6 if case.redundant else 1e-11)
    assert force <= 1e-11


def test_rows_that_depend_on_time_hold_at_that_time():
    """Drivers and constraints at t = 0.3."""
    case = random_case(3, driven=True)
    state = mbd.assemble(case.mechanism, t=0.3)
    assert state.t == 0.3
    assert max(residuals(state)) <= 1e-11
    driver = case.mechanism.drivers[0]
    assert state[driver.expression] == pytest.approx(state[driver.value], abs=1e-12)
    assert state[mbd.time_derivative(driver.expression - driver.value)] == pytest.approx(0, abs=1e-11)


def test_an_angle_of_many_turns_is_as_exact():
    """|Phi| to 1e-12 whatever the number of turns."""
    arm, model = pendulum(pose=(0.3, 0.4, 1.0 + 40 * np.pi))
    state = mbd.assemble(model)
    assert residuals(state)[0] <= 1e-12
    assert abs(state[arm.phi] - 40 * np.pi) < np.pi


@pytest.mark.parametrize("turns", [1e3, -1e6])
def test_many_turns_are_made_at_once(turns):
    """A four-bar is after whole turns of its crank where it was, and no warning of another branch is due."""
    model = mbd.library.four_bar()
    poses = []
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for angle in (1.0, 1.0 + 2 * np.pi * turns):
            state = mbd.assemble(model.mechanism, [model.crank.phi == angle])
            assert state[model.crank.phi] == pytest.approx(angle, rel=1e-14)
            poses.append(state[model.rocker.position])
    assert poses[1] == pytest.approx(poses[0], abs=1e-8)


@pytest.mark.slow
def test_gears_count_turns():
    """The way is followed: at once, whole turns of one wheel alone would be found to break the mesh."""
    wheels = [mbd.Body(f"wheel {k}", mass=1.0, inertia=0.1, pose=(0.3 * k, 0, 0)) for k in range(2)]
    pins = [mbd.Revolute(f"pin {k}", mbd.ground.at(0.3 * k, 0), wheel.at(0, 0)) for k, wheel in enumerate(wheels)]
    mesh = mbd.Gear("mesh", wheels[0].at(0, 0), wheels[1].at(0, 0), 0.1, 0.2)
    state = mbd.assemble(mbd.Mechanism(wheels, joints=[*pins, mesh]), [pins[0].angle == 1001.0])
    assert state[pins[1].angle] == pytest.approx(-500.5, rel=1e-12)


def test_the_same_call_gives_the_same_state():
    """Nothing random is left in the answer."""
    first, second = (mbd.assemble(four_bar(np.full((3, 3), 0.4))) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)


# --- nearest --------------------------------------------------------------------------------------
def nearest_by_scipy(model, guess, conditions=()) -> np.ndarray:
    """The nearest pose by an optimiser that is no part of the package; conditions as (kind, expression)."""
    eom = mbd.equations(model)
    zero = [np.zeros(x.numel()) for x in (eom.v, eom.a, eom.z, eom.lam, eom.u)]
    q0, weights = eom.estimate[0], eom.masses(eom.parameter_values)
    weights = np.where(weights > 0, weights, 1.0)

    def evaluate(expression):
        function = eom.function(expression)
        return lambda q: function(0.0, q, *zero, eom.parameter_values).full().ravel()

    constraints = [{"type": "eq", "fun": evaluate(eom.Phi)}]
    constraints += [{"type": kind, "fun": evaluate(expression)} for kind, expression in conditions]
    found = minimize(
        lambda q: 0.5 * (q - q0) @ (weights * (q - q0)),
        guess,
        jac=lambda q: weights * (q - q0),
        constraints=constraints,
        method="SLSQP",
        options={"ftol": 1e-15, "maxiter": 500},
    )
    assert found.success, found.message
    binding = [evaluate(e)(found.x)[0] <= 1e-7 for _, e in conditions]
    rows = ca.vertcat(eom.Phi, *[e for (_, e), binds in zip(conditions, binding, strict=True) if binds])
    return stationary(eom, rows, found.x, weights)


def stationary(eom, rows, q, weights) -> np.ndarray:
    """Newton's method on ``W (q - q0) + rows_q^T lam = 0, rows = 0``: the distance is flat, its slope is not."""
    lam = ca.SX.sym("lam", rows.numel())
    unknowns = ca.vertcat(eom.q, lam)
    slope = ca.DM(weights) * (eom.q - eom.estimate[0]) + ca.jtimes(rows, eom.q, lam, True)
    system = ca.vertcat(slope, rows)
    function = ca.Function("kkt", [unknowns, eom.t, eom.p], [system, ca.jacobian(system, unknowns)])
    x = np.r_[q, np.zeros(rows.numel())]
    for _ in range(20):
        value, jacobian = (part.full() for part in function(x, 0.0, eom.parameter_values))
        step = np.linalg.lstsq(jacobian, -value.ravel(), rcond=1e-12)[0]
        x = x + step
        if np.max(np.abs(step)) < 1e-13:
            break
    assert np.max(np.abs(x[: q.size] - q)) < 1e-3
    return x[: q.size]


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("make", [four_bar, slider_crank], ids=["four-bar", "slider-crank"])
def test_the_pose_is_the_nearest_in_the_mass_metric(make, seed):
    """The same as SciPy's SLSQP finds for ``(q - q0)·M (q - q0)``."""
    model = make(np.random.default_rng(seed).uniform(-0.2, 0.2, (3, 3)))
    state = mbd.assemble(model)
    np.testing.assert_allclose(state.q, nearest_by_scipy(model, state.q + 0.01), atol=NEAREST)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_pose_is_the_nearest_among_those_that_meet_a_condition(seed):
    """A condition takes one degree of freedom; a loop with two more remains to be placed."""
    rng = np.random.default_rng(seed)
    model = four_bar(rng.uniform(-0.1, 0.1, (3, 3)))
    loose = model.replace(joints=model.joints[:3])
    tip = model.body("rocker").at(0.4, 0)
    state = mbd.assemble(loose, [tip.y == 0.5])
    assert state[tip.y] == pytest.approx(0.5, abs=1e-12)
    np.testing.assert_allclose(state.q, nearest_by_scipy(loose, state.q + 0.01, [("eq", tip.y - 0.5)]), atol=NEAREST)


@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_the_pose_is_stationary_for_random_mechanisms(seed):
    """``M (q - q0)`` is a combination of the rows of Phi_q (first-order condition of the nearest pose)."""
    case = random_case(seed)
    state = mbd.assemble(case.mechanism)
    eom = state.equations
    root = np.sqrt(eom.masses(eom.parameter_values))
    rows = np.reshape(state[eom.Phi_q], (-1, state.q.size)) / root
    wish = root * (state.q - eom.estimate[0])
    multipliers = np.linalg.lstsq(rows.T, wish, rcond=1e-10)[0]
    np.testing.assert_allclose(rows.T @ multipliers, wish, atol=1e-8)


@pytest.mark.parametrize("seed", range(0, 60, 4))
def test_the_velocity_is_the_nearest_in_the_mass_metric(seed):
    """The minimiser of ``(v - v0)·M (v - v0)`` under ``Phi_q v = nu``, by the normal equations."""
    case = random_case(seed)
    state = mbd.assemble(case.mechanism)
    eom = state.equations
    rows, nu = np.reshape(state[eom.Phi_q], (-1, state.q.size)), np.reshape(state[eom.nu], -1)
    inverse, v0 = np.diag(1 / eom.masses(eom.parameter_values)), eom.estimate[1]
    wanted = v0 + inverse @ rows.T @ np.linalg.pinv(rows @ inverse @ rows.T) @ (nu - rows @ v0)
    np.testing.assert_allclose(state.v, wanted, atol=1e-9)


def test_what_the_constraints_leave_free_stays_at_the_estimate():
    """A free body does not move at all; a body held in x keeps y and phi."""
    body, model = free_body(pose=(1, 2, 3), velocity=(4, 5, 6))
    state = mbd.assemble(model)
    np.testing.assert_array_equal(state.q, [1, 2, 3])
    np.testing.assert_array_equal(state.v, [4, 5, 6])
    state = mbd.assemble(model.replace(joints=[mbd.AbsoluteX("held", body.at(0, 0), 0.5)]))
    np.testing.assert_allclose(state.q, [0.5, 2, 3], atol=1e-14)
    np.testing.assert_allclose(state.v, [0, 5, 6], atol=1e-14)


def test_heavy_bodies_move_less():
    """Two points drawn together meet at their centre of mass."""
    light, heavy = mbd.Body("light", 1, 1, pose=(0, 0, 0)), mbd.Body("heavy", 3, 1, pose=(1, 0, 0))
    model = mbd.Mechanism(bodies=[light, heavy], joints=[mbd.Revolute("pin", light.at(0, 0), heavy.at(0, 0))])
    state = mbd.assemble(model)
    np.testing.assert_allclose([state[light.x], state[heavy.x]], 0.75, atol=1e-9)


# --- from far away ----------------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 1e-12])
@pytest.mark.parametrize("mass", [1e-6, 1.0, 1e6])
def test_parts_without_mass_follow_those_that_have_some(mass, share):
    """As the limit of a light part does; a massless part counted as 1 kg once, and halved the speed."""
    block = mbd.Body("block", mass=mass, inertia=0.1 * mass, pose=(0.3, 0, 0), velocity=(3, 0, 0))
    part = mbd.Body("part", mass=share * mass, inertia=share * mass, pose=(1, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    state = mbd.assemble(mbd.Mechanism([block, part], [guide, mbd.Weld("weld", block.at(1, 0), part.at(0, 0))]))
    assert (state[block.x], state[block.vx]) == pytest.approx((0.3, 3.0), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("make", [four_bar, slider_crank], ids=["four-bar", "slider-crank"])
def test_linkages_close_from_estimates_that_are_far_off(make):
    """Each coordinate off by up to 1 m and 1 rad: at least 49 of 50 assemble."""
    closed = 0
    for seed in range(50):
        model = make(np.random.default_rng(seed).uniform(-1, 1, (3, 3)))
        try:
            closed += residuals(mbd.assemble(model))[0] <= 1e-12
        except mbd.MechanismError:
            pass
    assert closed >= 49


def tied_bodies(seed: int, off: float) -> mbd.Mechanism:
    """Two bodies on five links of lengths that fit, from far-off estimates: hard for Newton's method alone."""
    rng = np.random.default_rng(seed)
    poses = rng.uniform(-1, 1, (2, 3))
    bodies = [mbd.Body(f"body {k}", 1, 0.1, pose=pose + rng.uniform(-off, off, 3)) for k, pose in enumerate(poses)]
    joints = []
    for k in range(5):
        x, y, phi = poses[k % 2]
        s, anchor = rng.uniform(-0.5, 0.5, 2), rng.uniform(-1, 1, 2)
        point = [x, y] + np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]]) @ s
        length = np.hypot(*(point - anchor))
        joints.append(mbd.Distance(f"link {k}", mbd.ground.at(*anchor), bodies[k % 2].at(*s), length))
    return mbd.Mechanism(bodies=bodies, joints=joints)


@pytest.mark.parametrize("seed", range(20))
def test_hard_starts_close_or_say_that_they_do_not(seed):
    """Where Newton's method settles beside a solution, the other ways are tried; what remains is an AssemblyError."""
    try:
        state = mbd.assemble(tied_bodies(seed, off=3.0))
    except mbd.AssemblyError:
        return
    assert residuals(state)[0] <= 1e-12


def test_a_singular_estimate_is_no_obstacle():
    """The ends of a link estimated at one point, where the row has no slope: it opens, and nothing is warned of."""
    bob, model = free_body()
    tied = model.replace(joints=[mbd.Distance("link", mbd.ground.at(0, 0), bob.at(0, 0), 1.5)])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        state = mbd.assemble(tied)
    assert np.hypot(state[bob.x], state[bob.y]) == pytest.approx(1.5, abs=1e-12)


def coupler_side(state, model) -> float:
    """Signed area of the triangle crank pin, rocker pin, rocker foot: positive elbow up."""
    pin = state[model.body("crank").at(0.15, 0).position]
    top = state[model.body("rocker").at(0.4, 0).position]
    foot = np.array([1.0, 0.0])
    return 0.5 * float((foot - pin)[0] * (top - pin)[1] - (foot - pin)[1] * (top - pin)[0])


@pytest.mark.parametrize("turn", [-6.0, -3.0, -1.5, 1.5, 3.0, 6.0, 4 * np.pi])
def test_a_far_target_keeps_the_branch(turn):
    """The crank of a four-bar turned by radians: the rocker stays on its side, at the closed-form pose."""
    model = four_bar()
    crank, rocker = model.body("crank"), model.body("rocker")
    before = mbd.assemble(model)
    after = mbd.assemble(model, [crank.phi == 1.0 + turn])
    assert coupler_side(before, model) > 0.05 and coupler_side(after, model) > 0.05
    pin = 0.3 * np.array([np.cos(1 + turn), np.sin(1 + turn)])
    top = elbow(pin, [1, 0], 1.0, 0.8)
    np.testing.assert_allclose(after[rocker.at(0.4, 0).position], top, atol=1e-12)
    assert after[crank.phi] == pytest.approx(1.0 + turn, abs=1e-12)
    assert abs(after[rocker.phi] - before[rocker.phi]) < 2.0


@pytest.mark.parametrize("turn", [-3.0, 3.0, 5.0])
def test_the_slider_stays_on_its_side(turn):
    """The crank turned by radians: the slider stays to the right of the crank pin."""
    model = slider_crank()
    crank, slider = model.body("crank"), model.body("slider")
    state = mbd.assemble(model, [crank.phi == 0.6 + turn])
    angle = 0.6 + turn
    wanted = 0.3 * np.cos(angle) + np.sqrt(0.64 - 0.09 * np.sin(angle) ** 2)
    assert state[slider.x] == pytest.approx(wanted, abs=1e-12)


def test_the_other_branch_can_be_asked_for():
    """An estimate elbow down gives the linkage elbow down."""
    up = four_bar()
    pin = 0.3 * np.array([np.cos(1), np.sin(1)])
    base = np.array([1.0, 0.0])
    top = pin + base - elbow([0, 0], base - pin, 0.8, 1.0)
    down = np.array([rod_pose((0, 0), pin), rod_pose(pin, top), rod_pose((1, 0), top)])
    model = four_bar(down - mbd.equations(up).estimate[0].reshape(3, 3))
    assert coupler_side(mbd.assemble(model), model) < -0.05


def test_a_target_beyond_an_end_position_is_reached_with_a_warning():
    """A bob on a link near its turning point in x: past it continuously, or found with a word on the branch."""
    bob, model = free_body(pose=(1, 0, 0))
    model = model.replace(joints=[mbd.Distance("link", mbd.ground.at(0, 0), bob.at(0, 0), 1.0)])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        state = mbd.assemble(model, [bob.x == -0.6])
    assert state[bob.x] == pytest.approx(-0.6, abs=1e-12)
    assert abs(state[bob.y]) == pytest.approx(0.8, abs=1e-12)


# --- conditions ---------------------------------------------------------------------------------------
def test_conditions_on_positions_and_velocities_are_met():
    """Angle and rate of a pendulum; what follows from them is right."""
    arm, model = pendulum()
    state = mbd.assemble(model, [arm.phi == 0.3, arm.omega == -2.0])
    c, s = np.cos(0.3), np.sin(0.3)
    np.testing.assert_allclose(state.q, [0.5 * c, 0.5 * s, 0.3], atol=1e-13)
    np.testing.assert_allclose(state.v, [1.0 * s, -1.0 * c, -2.0], atol=1e-12)
    alpha = -1.2 * G * 0.5 * c / (0.1 + 1.2 * 0.25)
    assert state[arm.alpha] == pytest.approx(alpha, rel=1e-12)


@pytest.mark.parametrize("condition", ["slider.speed", "crank.omega", "rod tip"])
def test_velocity_conditions_fix_the_rate_of_a_linkage(condition):
    """``vx = -r omega (sin a + r sin a cos a / sqrt(l² - r² sin² a))`` of a slider, whichever rate is given."""
    model, angle, omega = slider_crank(), 0.6, 20.0
    crank, rod, slider = model.bodies
    s, c = np.sin(angle), np.cos(angle)
    speed = -0.3 * omega * (s + 0.3 * s * c / np.sqrt(0.64 - 0.09 * s**2))
    relation = {
        "slider.speed": model.joint("guide").speed == speed,
        "crank.omega": crank.omega == omega,
        "rod tip": rod.at(-0.4, 0).vy == 0.3 * omega * c,
    }[condition]
    state = mbd.assemble(model, [crank.phi == angle, relation])
    assert state[crank.omega] == pytest.approx(omega, rel=1e-11)
    assert state[slider.vx] == pytest.approx(speed, rel=1e-11)
    assert residuals(state)[1] <= 1e-10


def test_vector_conditions():
    """A point at a place, with a velocity."""
    body, model = free_body()
    tip = body.at(0.5, 0)
    state = mbd.assemble(model, [tip.position == (1, 2), tip.velocity == (3, 4), body.phi == 1, body.omega == 2])
    np.testing.assert_allclose(state[tip.position], [1, 2], atol=1e-12)
    np.testing.assert_allclose(state[tip.velocity], [3, 4], atol=1e-12)


def test_conditions_that_say_the_same_twice_are_met():
    """Redundant, not contradictory: at either level."""
    arm, model = pendulum()
    state = mbd.assemble(model, [arm.phi == 0.3, 2 * arm.phi == 0.6, arm.omega == 1, arm.omega - 1 == 0])
    assert state[arm.phi] == pytest.approx(0.3, abs=1e-10)
    assert state[arm.omega] == pytest.approx(1, abs=1e-10)


def test_inequalities_hold_where_they_must():
    """One that holds already changes nothing; one that does not becomes an equality, at either level."""
    body, model = free_body(pose=(1, 0, 0), velocity=(1, 0, 0))
    idle = mbd.assemble(model, [body.x <= 2, mbd.bounded(0, body.vx, 3)])
    np.testing.assert_allclose([idle[body.x], idle[body.vx]], [1, 1], atol=1e-12)
    met = mbd.assemble(model, [body.x >= 2, mbd.bounded(2, body.vx, 3)])
    np.testing.assert_allclose([met[body.x], met[body.vx]], [2, 2], atol=1e-9)


@pytest.mark.parametrize("level", ["position", "velocity"])
def test_an_inequality_that_another_one_implies_does_not_bind(level):
    """Nearest to 0 under x >= 1 and x + y >= 0.5 is (1, 0): the second is slack there, though broken at the start."""
    body, model = free_body()
    x, y = (body.x, body.y) if level == "position" else (body.vx, body.vy)
    state = mbd.assemble(model, [x >= 1, x + y >= 0.5])
    np.testing.assert_allclose([state[x], state[y]], [1, 0], atol=1e-9)


def test_an_inequality_on_a_linkage_gives_the_nearest_pose():
    """As SLSQP has it: the tip of a two-rod chain below a ceiling."""
    model = four_bar(np.random.default_rng(1).uniform(-0.1, 0.1, (3, 3)))
    loose = model.replace(joints=model.joints[:3])
    tip = model.body("rocker").at(0.4, 0)
    state = mbd.assemble(loose, [tip.y <= 0.5])
    assert state[tip.y] <= 0.5 + 1e-10
    np.testing.assert_allclose(state.q, nearest_by_scipy(loose, state.q + 0.01, [("ineq", 0.5 - tip.y)]), atol=NEAREST)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(8))
def test_several_inequalities_on_a_linkage_give_the_nearest_pose(seed):
    """Those that bind, and only those, are held; as SLSQP has it."""
    rng = np.random.default_rng(seed)
    model = four_bar(rng.uniform(-0.1, 0.1, (3, 3)))
    loose = model.replace(joints=model.joints[:2])
    _, coupler, rocker = loose.bodies
    before = mbd.assemble(loose)
    points = [rocker.at(0.4, 0), coupler.at(0.2, 0.1), rocker.at(0, 0.1)]
    room = [ca.dot(rng.normal(size=2), p.position - before[p.position]) + 0.06 for p in points]
    state = mbd.assemble(loose, [gap >= 0.1 for gap in room])
    assert min(state[gap] for gap in room) >= 0.1 - 1e-10
    wanted = nearest_by_scipy(loose, state.q + 0.003, [("ineq", gap - 0.1) for gap in room])
    np.testing.assert_allclose(state.q, wanted, atol=NEAREST)


def test_inequalities_of_which_two_cannot_bind_at_once():
    """One degree of freedom and two limits: the farther one binds, at either level; IPOPT finds it where need be."""
    arm, model = pendulum()
    state = mbd.assemble(model, [arm.phi >= 1.2, arm.x <= 0.1, arm.y >= 0.1, arm.omega >= 1, arm.vx <= -3])
    np.testing.assert_allclose([state[arm.x], state[arm.vx]], [0.1, -3], atol=1e-9)
    assert state[arm.phi] >= 1.2 and state[arm.omega] >= 1


def test_a_limit_that_no_row_has_a_slope_for():
    """A speed limit is no linear condition, and still holds."""
    body, model = free_body(velocity=(3, 4, 0))
    state = mbd.assemble(model, [mbd.norm(body.velocity) <= 2])
    np.testing.assert_allclose(state.v, [1.2, 1.6, 0], atol=1e-9)


def test_conditions_may_hold_parameters_states_and_time():
    """Their values are those of the call."""
    arm, model = pendulum()
    start, z = mbd.Parameter("start", 0.4), mbd.StateVariable("z", value=0.1)
    model = model.replace(parameters=[start], states={z: -z})
    assert mbd.assemble(model, [arm.phi == start])[arm.phi] == pytest.approx(0.4)
    assert mbd.assemble(model, [arm.phi == start], parameters={start: 0.7})[arm.phi] == pytest.approx(0.7)
    assert mbd.assemble(model, [arm.phi == 0.2 * mbd.t], t=3.0)[arm.phi] == pytest.approx(0.6)
    assert mbd.assemble(model, [arm.phi == z])[arm.phi] == pytest.approx(0.1)
    state = mbd.assemble(model, [arm.phi == z, z == 0.9])
    assert (state[z], state[arm.phi]) == (pytest.approx(0.9), pytest.approx(0.9))


def test_first_order_states_start_at_their_initial_value_or_a_condition():
    """They enter the accelerations at once."""
    rotor = mbd.Body("rotor", mass=1, inertia=0.5)
    current = mbd.StateVariable("current", value=2.0)
    model = mbd.Mechanism(bodies=[rotor], forces=[mbd.Torque("motor", rotor, current)], states={current: -current})
    assert mbd.assemble(model)[rotor.alpha] == pytest.approx(4.0)
    state = mbd.assemble(model, [current == 3.0])
    assert state[current] == pytest.approx(3.0) and state[rotor.alpha] == pytest.approx(6.0)
    assert state.z.tolist() == pytest.approx([3.0])


# --- parameters and inputs --------------------------------------------------------------------------------
def test_parameters_are_overridden_for_one_call():
    """The state carries the value; the next call has the parameter's own again."""
    length, mass = mbd.Parameter("length", 1.0), mbd.Parameter("mass", 2.0)
    arm = mbd.Body("arm", mass=mass, inertia=0.1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-length / 2, 0))
    model = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()], parameters=[length, mass])
    state = mbd.assemble(model, [arm.phi == 0], parameters={length: 0.6, mass: 5.0})
    assert state[arm.x] == pytest.approx(0.3, abs=1e-13) and state[length] == 0.6 and state[mass] == 5.0
    assert state[arm.alpha] == pytest.approx(-5 * G * 0.3 / (0.1 + 5 * 0.09), rel=1e-12)
    assert mbd.assemble(model, [arm.phi == 0])[arm.x] == pytest.approx(0.5, abs=1e-13)
    pairs = mbd.assemble(model, [arm.phi == 0], parameters=[(length, 0.6)])
    assert pairs[arm.x] == pytest.approx(0.3, abs=1e-13)


def test_the_mass_metric_is_that_of_the_parameters():
    """Two points drawn together meet at the centre of the masses of the call."""
    mass = mbd.Parameter("mass", 3.0)
    light, heavy = mbd.Body("light", 1, 1), mbd.Body("heavy", mass, 1, pose=(1, 0, 0))
    pin = mbd.Revolute("pin", light.at(0, 0), heavy.at(0, 0))
    model = mbd.Mechanism(bodies=[light, heavy], joints=[pin], parameters=[mass])
    assert mbd.assemble(model)[light.x] == pytest.approx(0.75, abs=1e-9)
    assert mbd.assemble(model, parameters={mass: 9.0})[light.x] == pytest.approx(0.9, abs=1e-9)


def test_values_that_make_no_mechanism_are_refused():
    """A negative mass, a length of zero, a number that is none: also when they come with the call."""
    mass, length = mbd.Parameter("mass", 3.0), mbd.Parameter("length", 1.0)
    body = mbd.Body("body", mass=mass, inertia=1, pose=(1, 0, 0))
    link = mbd.Distance("link", mbd.ground.at(0, 0), body.at(0, 0), length)
    model = mbd.Mechanism(bodies=[body], joints=[link], parameters=[mass, length])
    for parameter, value in ((mass, -1.0), (length, 0.0), (mass, float("nan")), (mass, "heavy")):
        with pytest.raises(mbd.MechanismError, match=parameter.label):
            mbd.assemble(model, parameters={parameter: value})
    with pytest.raises(mbd.MechanismError, match="'other'"):
        mbd.assemble(model, parameters={mbd.Parameter("other", 1.0): 2.0})
    with pytest.raises(mbd.MechanismError, match="parameters="):
        mbd.assemble(model, parameters=3.0)


def test_inputs_have_their_own_value_or_that_of_the_call():
    """Numbers, or an expression in the state."""
    arm, model = pendulum(pose=(0.5, 0, 0))
    tau = mbd.Input("tau", value=1.2 * G * 0.5)
    model = model.replace(forces=[mbd.Gravity(), mbd.Torque("motor", arm, tau)], inputs=[tau])
    assert mbd.assemble(model)[arm.alpha] == pytest.approx(0, abs=1e-12)
    state = mbd.assemble(model, inputs={tau: 0.0})
    assert state[arm.alpha] == pytest.approx(-1.2 * G * 0.5 / 0.4, rel=1e-12) and state[tau] == 0.0
    feedback = mbd.assemble(model, [arm.omega == 2], inputs={tau: -3 * arm.omega + mbd.t}, t=1.0)
    assert feedback[tau] == pytest.approx(-5.0)
    with pytest.raises(mbd.MechanismError, match="'other'"):
        mbd.assemble(model, inputs={mbd.Input("other"): 1.0})


# --- redundant rows and bodies without mass ------------------------------------------------------------------
@pytest.mark.parametrize("omega", [0.0, 3.0])
def test_a_parallelogram_with_three_cranks_accelerates_like_one_degree_of_freedom(omega):
    """``(3 (J' + m l²/4) + M l²) alpha = -(3 m/2 + M) g l cos(phi)``; redundant rows do no harm."""
    angle, m, beam_mass, length, inertia = -np.pi / 2 + 0.8, 1.0, 2.0, 1.0, 1 / 12
    at = np.array([np.cos(angle), np.sin(angle)])
    cranks = [
        mbd.Body(f"crank {k}", mass=m, inertia=inertia, pose=(*(np.array([k, 0.0]) + at / 2), angle)) for k in range(3)
    ]
    beam = mbd.Body("beam", mass=beam_mass, inertia=1.0, pose=(*(np.array([1.0, 0]) + at), 0))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), c.at(-0.5, 0)) for k, c in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", c.at(0.5, 0), beam.at(k - 1.0, 0)) for k, c in enumerate(cranks)]
    model = mbd.Mechanism(bodies=[*cranks, beam], joints=joints, forces=[mbd.Gravity()])
    state = mbd.assemble(model, [cranks[0].phi == angle, cranks[0].omega == omega])
    alpha = -(3 * m / 2 + beam_mass) * G * length * np.cos(angle)
    alpha /= 3 * (inertia + m * length**2 / 4) + beam_mass * length**2
    for crank in cranks:
        assert state[crank.phi] == pytest.approx(angle, abs=1e-12)
        assert state[crank.omega] == pytest.approx(omega, abs=1e-11)
        assert state[crank.alpha] == pytest.approx(alpha, rel=1e-7)
    assert state[beam.alpha] == pytest.approx(0, abs=1e-7)
    total = sum(state[foot.reaction_on(mbd.ground).force] for foot in joints[:3])
    weight = np.array([0, -(3 * m + beam_mass) * G])
    momentum = sum(b.mass * state[b.acceleration] for b in (*cranks, beam))
    np.testing.assert_allclose(total, weight - momentum, atol=1e-6)


def test_multipliers_of_redundant_rows_are_of_least_norm():
    """A block held twice by the same row carries half the load in each."""
    body, model = free_body()
    joints = [mbd.AbsoluteY("first", body.at(0, 0)), mbd.AbsoluteY("second", body.at(0, 0))]
    state = mbd.assemble(model.replace(joints=joints, forces=[mbd.Gravity()]))
    for joint in joints:
        assert state[joint.reaction_on(body).force][1] == pytest.approx(G, rel=1e-7)


@pytest.mark.parametrize("turn", [0.0, 0.5, np.pi / 2, 2.0])
@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 1, 0, 2)])
def test_the_least_norm_beside_parts_without_mass_knows_no_axes(turn, order):
    """Three parallel cranks, two of them without mass, turned as a whole: by the pseudoinverse of their rows."""
    ways = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    feet, tilt = [np.array([x, 0.0]) for x in (0.0, 1.0, 1.7)], 1.1
    arm = 0.3 * np.array([np.cos(tilt), np.sin(tilt)])
    cranks = [
        mbd.Body(f"crank {k}", mass=mass, inertia=0.1 * mass, pose=(*(ways @ (foot + arm)), tilt + turn))
        for k, (foot, mass) in enumerate(zip(feet, (0.5, 0.0, 0.0), strict=True))
    ]
    beam = mbd.Body("beam", mass=2.0, inertia=0.4, pose=(*(ways @ (2 * arm + (0.8, 0))), turn))
    joints = []
    for foot, crank in zip(feet, cranks, strict=True):
        joints.append(mbd.Revolute(f"foot {crank.name}", mbd.ground.at(*(ways @ foot)), crank.at(-0.3, 0)))
        joints.append(mbd.Revolute(f"head {crank.name}", crank.at(0.3, 0), beam.at(foot[0] - 0.8, 0)))
    bodies = [[*cranks, beam][k] for k in order]
    loads = [mbd.Gravity(tuple(ways @ (1.0, -9.81))), mbd.Torque("push", beam, 3.0)]
    model = mbd.Mechanism(bodies, [*joints[order[0] :], *joints[: order[0]]], forces=loads)
    state = mbd.assemble(model, [cranks[0].omega == 1.2])
    eom = mbd.equations(model)
    jacobian, mass = eom.jacobian(0, state.q, [])[0].full(), eom.masses(np.zeros(0))
    forces = eom.function(eom.Q)(0, state.q, state.v, state.a, [], state.lam, [], []).full().ravel()
    least = np.linalg.pinv(jacobian.T) @ (forces - mass * state.a)
    assert state.lam == pytest.approx(least, abs=1e-6 * np.max(np.abs(least)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("links", "light", "turn", "size"), [(30, 0.0, 0.0, 1.0), (60, 1.0, 0.7, 1.0), (60, 1.0, 2.0, 1e-3)]
)
def test_every_section_of_a_long_cantilever_carries_what_is_beyond_it(links, light, turn, size):
    """Links welded and pinned: the smallest eigenvalue of their rows falls with the fourth power of their number."""
    along, across = size * np.array([np.cos(turn), np.sin(turn)]), size * np.array([-np.sin(turn), np.cos(turn)])
    masses = [light if k % 3 == 0 else 1.0 for k in range(links)]
    bodies = [
        mbd.Body(f"link {k}", mass=m, inertia=m * size**2 / 12, pose=(*((k + 0.5) * along), turn))
        for k, m in enumerate(masses)
    ]
    places = [(mbd.ground.at(0, 0, turn), mbd.ground.at(*(0.2 * across)))]
    places += [(body.at(0.5 * size, 0), body.at(0.5 * size, 0.2 * size)) for body in bodies[:-1]]
    welds = [
        mbd.Weld(f"weld {k}", a, b.at(-0.5 * size, 0)) for k, ((a, _), b) in enumerate(zip(places, bodies, strict=True))
    ]
    pins = [
        mbd.Revolute(f"pin {k}", a, b.at(-0.5 * size, 0.2 * size))
        for k, ((_, a), b) in enumerate(zip(places, bodies, strict=True))
    ]
    state = mbd.assemble(mbd.Mechanism(bodies, [*welds, *pins], forces=[mbd.Gravity()]))
    assert np.abs(state.a).max() < 1e-7
    carried = np.empty((links, 3))
    for k, (weld, pin, body) in enumerate(zip(welds, pins, bodies, strict=True)):
        first, second = state[weld.reaction_on(body).force], state[pin.reaction_on(body).force]
        moment = state[weld.reaction_on(body).torque] + 0.2 * (across[0] * second[1] - across[1] * second[0])
        carried[k] = *(first + second), moment
    weights = G * np.cumsum(masses[::-1])[::-1]
    moments = [sum(G * m * (j + 0.5 - k) for j, m in enumerate(masses) if j >= k) * along[0] for k in range(links)]
    expected = np.column_stack([np.zeros(links), weights, moments])
    units = np.array([weights[0], weights[0], np.abs(expected).max()])
    assert carried / units == pytest.approx(expected / units, abs=1e-8)


@pytest.mark.parametrize("mass", [0.0, 1.0])
@pytest.mark.parametrize("gap", [0.01, 1e-3, 3e-4])
def test_an_arm_on_three_pins_that_are_close(mass, gap):
    """Three metres on millimetres: a load at the tip is carried by large forces that nearly cancel each other."""
    arm = mbd.Body("arm", mass=mass, inertia=0.75 * mass, pose=(1.5, 0, 0))
    tip = mbd.Body("tip", mass=2.0, inertia=1.0, pose=(3, 0, 0))
    pins = [mbd.Revolute(f"pin {k}", mbd.ground.at(k * gap, 0), arm.at(k * gap - 1.5, 0)) for k in range(3)]
    state = mbd.assemble(
        mbd.Mechanism([arm, tip], [*pins, mbd.Weld("end", arm.at(1.5, 0), tip.at(0, 0))], forces=[mbd.Gravity()])
    )
    forces = np.array([state[pin.reaction_on(arm).force] for pin in pins])
    # of least norm: forces vary linearly with the place
    mean, slope = (mass + 2) * G / 3, -((1.5 * mass + 6) * G - (mass + 2) * G * gap) / (2 * gap)
    expected = mean - slope * np.array([-1, 0, 1])
    assert np.abs(state.a).max() < 1e-6
    assert forces[:, 1] / slope == pytest.approx(expected / slope, abs=1e-7)
    assert forces[:, 0] / slope == pytest.approx(0, abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("light", [0.0, 1e-9])
def test_the_least_norm_of_forces_and_moments_beside_light_parts_knows_no_units(light):
    """Welds at both ends and in between: forces, and moments over the mean lever, in metres as in other lengths."""
    found = []
    for size, turn, order in ((1.0, 0.0, 1), (1.3, 0.0, 1), (1.9, 0.3, -1), (1e3, 0.5, 1), (1e-3, 1.0, -1)):
        ways = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

        def place(x, y, ways=ways, size=size):
            return tuple(size * (ways @ (x, y)))

        beam = mbd.Body("beam", mass=1.0, inertia=0.3 * size**2, pose=(*place(0.5, 0), turn))
        link = mbd.Body("link", mass=light, inertia=0.01 * light * size**2, pose=(*place(1.3, 0.1), turn))
        welds = [
            mbd.Weld("left", mbd.ground.at(0, 0, turn), beam.at(-0.5 * size, 0)),
            mbd.Weld("middle", beam.at(0.5 * size, 0), link.at(-0.3 * size, -0.1 * size)),
            mbd.Weld("above", beam.at(0.4 * size, 0.2 * size), link.at(-0.4 * size, 0.1 * size)),
            mbd.Weld("right", mbd.ground.at(*place(1.3, 0.3), turn), link.at(0, 0.2 * size)),
        ]
        loads = [mbd.Gravity(tuple(ways @ (0, -9.81))), mbd.Torque("push", beam, 2.0 * size)]
        model = mbd.Mechanism([beam, link][::order], welds[::order], forces=loads)
        state, eom = mbd.assemble(model), mbd.equations(model)
        jacobian, angular = eom.jacobian(0, state.q, [])[0].full(), eom.angular_rows
        squares = np.sum(jacobian[~angular] ** 2, axis=0)
        lever = np.sqrt(np.sum(squares[2::3]) / (np.sum(squares) - np.sum(squares[2::3])))
        forces = eom.function(eom.Q)(0, state.q, state.v, state.a, [], state.lam, [], []).full().ravel()
        alike = np.where(angular, lever, 1.0)
        least = alike * (np.linalg.pinv(jacobian.T * alike) @ forces)
        assert state.lam / alike == pytest.approx(least / alike, abs=1e-6)
        found.append([ways.T @ state[weld.reaction_on(weld.b.body).force] for weld in welds])
        found[-1].append([state[weld.reaction_on(weld.b.body).torque] / size for weld in welds])
    for others in found[1:]:
        for one, other in zip(found[0], others, strict=True):
            assert np.ravel(other) == pytest.approx(np.ravel(one), abs=1e-6)


@pytest.mark.parametrize(("angle", "omega"), [(0.4, 0.0), (0.4, 2.5), (np.pi / 2, 1.0)])
def test_a_cart_with_a_point_mass_on_a_massless_rod(angle, omega):
    """Cart-pole in closed form; the pole has mass at its end and no inertia."""
    cart_mass, mass, length, push = 1.0, 0.3, 0.5, 2.0
    cart = mbd.Body("cart", mass=cart_mass, inertia=0)
    bob = mbd.Body("bob", mass=mass, inertia=0, pose=(length * np.sin(angle), -length * np.cos(angle), angle))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("pin", cart.at(0, 0), bob.at(0, length)),
    ]
    forces = [mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (push, 0))]
    model = mbd.Mechanism(bodies=[cart, bob], joints=joints, forces=forces)
    state = mbd.assemble(model, [cart.x == 0, cart.vx == 0, bob.phi == angle, bob.omega == omega])
    s, c = np.sin(angle), np.cos(angle)
    ax = (push + mass * s * (length * omega**2 + G * c)) / (cart_mass + mass * s**2)
    assert state[cart.ax] == pytest.approx(ax, rel=1e-11)
    assert state[bob.alpha] == pytest.approx(-(ax * c + G * s) / length, rel=1e-11)


def test_a_massless_crank_between_pins_passes_the_force_along():
    """A rod of no mass that holds a weight: the tension is along the rod, and the motion that of a pendulum."""
    angle, length, mass = 0.7, 0.8, 2.0
    at = length * np.array([np.sin(angle), -np.cos(angle)])
    rod = mbd.Body("rod", mass=0, inertia=0, pose=(*at / 2, angle))
    bob = mbd.Body("bob", mass=mass, inertia=0.3, pose=(*at, 0.0))
    joints = [
        mbd.Revolute("top", mbd.ground.at(0, 0), rod.at(0, length / 2)),
        mbd.Revolute("end", rod.at(0, -length / 2), bob.at(0, 0)),
    ]
    model = mbd.Mechanism(bodies=[rod, bob], joints=joints, forces=[mbd.Gravity()])
    state = mbd.assemble(model, [rod.phi == angle, rod.omega == 0, bob.omega == 1.5])
    assert state[rod.alpha] == pytest.approx(-G * np.sin(angle) / length, rel=1e-11)
    assert state[bob.alpha] == pytest.approx(0, abs=1e-11)
    tension = mass * G * np.cos(angle)
    np.testing.assert_allclose(state[joints[0].reaction_on(rod).force], -tension * at / length, atol=1e-10)


@pytest.mark.parametrize(
    ("settings", "joint", "missing"),
    [
        ({"mass": 0, "inertia": 0}, None, ["x", "y", "phi"]),
        ({"mass": 1, "inertia": 0}, None, ["phi"]),
        ({"mass": 0, "inertia": 1}, None, ["x", "y"]),
        ({"mass": 0, "inertia": 0}, "pin", ["phi"]),
    ],
)
def test_a_body_that_lacks_mass_is_named(settings, joint, missing):
    """Pose and velocity are there nevertheless; accelerations and reactions say which body and which coordinates."""
    ghost, solid = mbd.Body("ghost", pose=(0.3, 0.1, 0), **settings), mbd.Body("solid", 1, 1)
    joints = [mbd.Revolute("pin", mbd.ground.at(0.3, 0.1), ghost.at(0, 0))] if joint else []
    state = mbd.assemble(mbd.Mechanism(bodies=[ghost, solid], joints=joints, forces=[mbd.Gravity()]))
    assert state[ghost.x] == pytest.approx(0.3)
    with pytest.raises(mbd.SingularityError, match="'ghost'") as error:
        state[ghost.alpha]
    assert all(f"ghost.{name}" in str(error.value) for name in missing)
    assert all(f"ghost.{name}" not in str(error.value) for name in {"x", "y", "phi"} - set(missing))
    assert "solid" not in str(error.value)


# --- what cannot be assembled ---------------------------------------------------------------------------
def test_parts_that_do_not_reach_each_other():
    """The message names the joints, the residuals hold metres, the largest first."""
    arm, model = pendulum()
    far = model.replace(joints=[*model.joints, mbd.Revolute("too far", mbd.ground.at(3, 0), arm.at(0.5, 0))])
    with pytest.raises(mbd.AssemblyError, match=r"cannot assemble.*t = 0 s.*'too far'") as error:
        mbd.assemble(far)
    found = error.value.residuals
    assert set(found) == {"hinge", "too far"}
    assert list(found.values()) == sorted(found.values(), reverse=True)
    assert found["hinge"] + found["too far"] == pytest.approx(2.0, rel=1e-3)
    assert error.value.time == 0.0


def test_residuals_name_only_what_is_open():
    """A chain that cannot close: other parts of the mechanism are not accused in the message."""
    arm, model = pendulum()
    other = mbd.Body("other", 1, 1)
    joints = [
        *model.joints,
        mbd.Revolute("too far", mbd.ground.at(3, 0), arm.at(0.5, 0)),
        mbd.Revolute("fine", mbd.ground.at(0, 0), other.at(0.2, 0)),
    ]
    with pytest.raises(mbd.AssemblyError) as error:
        mbd.assemble(model.replace(bodies=[arm, other], joints=joints))
    assert "fine" not in str(error.value)
    assert error.value.residuals["fine"] < 1e-6 < error.value.residuals["too far"]


def test_constraints_that_contradict_each_other():
    """Both are named."""
    arm, model = pendulum()
    held = [mbd.AbsoluteAngle("up", arm.at(0, 0), 1.0), mbd.AbsoluteAngle("down", arm.at(0, 0), -1.0)]
    with pytest.raises(mbd.AssemblyError, match=r"(?s)(?=.*'up')(?=.*'down')") as error:
        mbd.assemble(model.replace(joints=[*model.joints, *held]))
    assert error.value.residuals["up"] == pytest.approx(1.0, rel=1e-3)


def test_drivers_that_contradict_at_velocity():
    """Two drivers that agree in angle and not in rate: no velocity exists, and both are named."""
    arm, model = pendulum()
    drivers = [mbd.Driver("slow", arm.phi, 0.5 + mbd.t), mbd.Driver("fast", arm.phi, 0.5 + 2 * mbd.t)]
    with pytest.raises(mbd.AssemblyError, match="slow") as error:
        mbd.assemble(model.replace(drivers=drivers))
    assert "fast" in str(error.value) and "velocit" in str(error.value)


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        (lambda arm: [arm.phi == 0.3, arm.phi == 0.4], ["arm.phi == 0.3", "arm.phi == 0.4"]),
        (lambda arm: [arm.x == 2.0], ["arm.x == 2"]),
        (lambda arm: [arm.at(0.5, 0).position == (0.9, 0.9)], ["hinge"]),
        (lambda arm: [arm.phi == 0, arm.vx == 5.0], ["arm.vx"]),
        (lambda arm: [arm.omega == 1, arm.omega == 2], ["arm.omega"]),
        (lambda arm: [arm.x >= 2.0], ["arm.x"]),
        (lambda arm: [arm.omega <= 1, arm.omega >= 2], ["arm.omega"]),
        (lambda arm: [arm.phi <= 1, arm.phi >= 2], ["arm.phi"]),
    ],
)
def test_conditions_that_cannot_be_met(conditions, words):
    """A ConditionError in the words of the conditions."""
    arm, model = pendulum()
    with pytest.raises(mbd.ConditionError) as error:
        mbd.assemble(model, conditions(arm))
    assert all(word in str(error.value) for word in words), error.value


def test_a_condition_that_cannot_be_met_says_by_how_much():
    """Residuals by condition and by joint."""
    arm, model = pendulum()
    with pytest.raises(mbd.AssemblyError) as error:
        mbd.assemble(model, [arm.x == 2.0])
    assert error.value.residuals["arm.x == 2"] + error.value.residuals["hinge"] == pytest.approx(1.5, rel=0.05)


@pytest.mark.parametrize(
    ("conditions", "words"),
    [
        (lambda arm, tau: [arm.phi], "relation"),
        (lambda arm, tau: [arm.phi != 0], "!="),
        (lambda arm, tau: [arm.alpha == 0], "accelerations"),
        (lambda arm, tau: [tau == 3], "inputs"),
        (lambda arm, tau: [mbd.Body("stranger", 1, 1).phi == 0], "stranger"),
        (lambda arm, tau: [mbd.t == 3], "no coordinate"),
        (lambda arm, tau: {arm.phi: 0.3}, "list of relations"),
        (lambda arm, tau: [arm.phi == float("nan")], "finite|nan"),
    ],
)
def test_what_is_no_condition_of_a_start_is_refused(conditions, words):
    """Accelerations and inputs follow; strangers, numbers and other things are no conditions."""
    arm, model = pendulum()
    tau = mbd.Input("tau")
    model = model.replace(forces=[mbd.Torque("motor", arm, tau)], inputs=[tau])
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.assemble(model, conditions(arm, tau))


@pytest.mark.parametrize("t", [float("nan"), "soon", None])
def test_the_time_is_a_number(t):
    """Finite."""
    with pytest.raises(mbd.MechanismError, match="t must be"):
        mbd.assemble(pendulum()[1], t=t)


def test_only_a_mechanism_is_assembled():
    """Anything else is refused."""
    with pytest.raises(mbd.MechanismError, match="Mechanism"):
        mbd.assemble(pendulum()[0])


# --- the state -------------------------------------------------------------------------------------------
def test_the_state_prints_poses_by_body():
    """Numbers with units, states of first order as well."""
    text = repr(mbd.assemble(pendulum()[1]))
    assert "t = 0 s" in text and "arm: x =" in text and "rad/s" in text


def test_the_state_refuses_strangers():
    """An expression with a symbol of another model."""
    with pytest.raises(mbd.ExpressionError, match="stranger"):
        mbd.assemble(pendulum()[1])[mbd.Body("stranger", 1, 1).phi]


def test_a_dead_point_has_a_pose_and_a_velocity():
    """Two links in line, both ends held: singular, consistent, and accelerations either right or refused."""
    rods = [mbd.Body(n, 1.0, 0.1, pose=(x, 0, 0)) for n, x in (("left", 0.5), ("right", 1.5))]
    joints = [
        mbd.Revolute("a", mbd.ground.at(0, 0), rods[0].at(-0.5, 0)),
        mbd.Revolute("b", rods[0].at(0.5, 0), rods[1].at(-0.5, 0)),
        mbd.Revolute("c", rods[1].at(0.5, 0), mbd.ground.at(2, 0)),
    ]
    state = mbd.assemble(mbd.Mechanism(bodies=rods, joints=joints))
    assert residuals_of_position(state) <= 1e-12
    np.testing.assert_allclose(state[rods[0].position], [0.5, 0], atol=1e-6)


def residuals_of_position(state) -> float:
    """Largest ``Phi``."""
    return float(np.max(np.abs(state[state.equations.Phi])))


# --- whatever the size -------------------------------------------------------------------------
@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-6, 1e-3, 1.0, 1e3, 1e6])
def test_four_bars_of_any_size_close_from_estimates_that_are_off(size):
    """By the triangle of coupler and rocker; conditions and limits are met to the size of the linkage."""
    lengths = np.array([0.2, 0.5, 0.4, 0.55])
    for seed in range(4):
        generator = np.random.default_rng(seed)
        angle = generator.uniform(0.3, 2.8)
        off = generator.uniform(-0.1, 0.1, (3, 3)) * [size, size, 1]
        crank_end = lengths[0] * np.array([np.cos(angle), np.sin(angle)])
        ground = np.array([lengths[3], 0.0])
        across = ground - crank_end
        span = np.hypot(*across)
        cosine = (lengths[1] ** 2 + span**2 - lengths[2] ** 2) / (2 * lengths[1] * span)
        lean = np.arctan2(across[1], across[0]) + np.arccos(cosine)
        joint = crank_end + lengths[1] * np.array([np.cos(lean), np.sin(lean)])
        back = np.arctan2(*(joint - ground)[::-1])
        poses = np.array(
            [[*(crank_end / 2), angle], [*((crank_end + joint) / 2), lean], [*((joint + ground) / 2), back]]
        )
        poses[:, :2] *= size
        bodies = [
            mbd.Body(name, mass=1, inertia=0.01 * size**2, pose=pose)
            for name, pose in zip(("crank", "coupler", "rocker"), poses + off, strict=True)
        ]
        half = lengths / 2 * size
        crank, coupler, rocker = bodies
        joints = [
            mbd.Revolute("A", mbd.ground.at(0, 0), crank.at(-half[0], 0)),
            mbd.Revolute("B", crank.at(half[0], 0), coupler.at(-half[1], 0)),
            mbd.Revolute("C", coupler.at(half[1], 0), rocker.at(half[2], 0)),
            mbd.Revolute("D", mbd.ground.at(2 * half[3], 0), rocker.at(-half[2], 0)),
        ]
        model = mbd.Mechanism(bodies=bodies, joints=joints)
        state = mbd.assemble(model, [crank.phi == angle, crank.omega == 2])
        np.testing.assert_allclose(state[rocker.at(half[2], 0).position], joint * size, atol=1e-12 * size)
        # the same by a limit in metres that holds
        level = float(crank_end[1] / 2 * size)
        lifted = crank.y >= level if angle < np.pi / 2 else crank.x <= float(crank_end[0] / 2 * size)
        held = mbd.assemble(model, [lifted])
        assert held[crank.y] >= level - 1e-9 * size or angle >= np.pi / 2
        mbd.simulate(model, [0, 1e-3], initial=state)


def test_a_state_that_breaks_the_constraints_is_refused_at_any_size():
    for size in (1e-6, 1.0, 1e6):
        arm = mbd.Body("arm", mass=1, inertia=size**2, pose=(size, 0, 0))
        hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-size, 0))
        model = mbd.Mechanism(bodies=[arm], joints=[hinge])
        state = mbd.assemble(model)
        mbd.simulate(model, [0, 0.1], initial=state)
        loose = mbd.Mechanism(bodies=[arm])
        apart = mbd.assemble(loose, [arm.x == 1.02 * size])
        with pytest.raises(mbd.SimulationError, match=r"breaks the constraint hinge\.x at position level"):
            mbd.simulate(model, [0, 0.1], initial=apart)


@pytest.mark.parametrize("relation", ["equal", "at least"])
def test_a_speed_is_met_from_rest(relation):
    """At rest the speed has no slope; a body, and the tip of a double pendulum, leave it in some direction."""
    free = mbd.Body("free", mass=1.0, inertia=1.0)
    upper, lower = (mbd.Body(name, mass=1.0, inertia=0.1, pose=(0, y, 0)) for name, y in (("up", -0.5), ("low", -1.5)))
    pins = [
        mbd.Revolute("pin", mbd.ground.at(0, 0), upper.at(0, 0.5)),
        mbd.Revolute("elbow", upper.at(0, -0.5), lower.at(0, 0.5)),
    ]
    for mechanism, body in ((mbd.Mechanism([free]), free), (mbd.Mechanism([upper, lower], pins), lower)):
        speed = body.vx**2 + body.vy**2
        state = mbd.assemble(mechanism, [speed == 25 if relation == "equal" else speed >= 25])
        assert state[body.vx] ** 2 + state[body.vy] ** 2 == pytest.approx(25, rel=1e-7)
    with pytest.raises(mbd.ConditionError, match="cannot all be met"):
        mbd.assemble(mechanism, [upper.omega == 0, lower.omega == 0, speed == 25])


@pytest.mark.parametrize("size", [1e-3, 1e3])
def test_starts_without_any_mass_are_the_same_in_any_unit(size):
    """Poses and velocities nearest to estimates that do not fit, of two links without mass that a rail guides."""

    def start(unit):
        first = mbd.Body("first", 0, 0, pose=(0.2 * unit, 0.1 * unit, 0.5), velocity=(0, 0.5 * unit, 1.2))
        second = mbd.Body("second", 0, 0, pose=(0.8 * unit, 0, -0.4), velocity=(0.2 * unit, 0, 0.7))
        joints = [
            mbd.Revolute("hinge", mbd.ground.at(0, 0), first.at(-0.3 * unit, 0)),
            mbd.Revolute("elbow", first.at(0.3 * unit, 0), second.at(-0.4 * unit, 0)),
            mbd.AbsoluteY("rail", second.at(0.4 * unit, 0), 0),
        ]
        state = mbd.assemble(mbd.Mechanism([first, second], joints))
        return state[[first.phi, second.phi, first.omega, second.omega]]

    np.testing.assert_allclose(start(size), start(1.0), rtol=1e-8)
