"""Non-holonomic constraints: rows, simulation against closed forms, driven motion, efforts, optimal control."""

import numpy as np
import pytest
from differences import check_balance, check_rows

import mbdcasadi as mbd

MASS, INERTIA, BEHIND = 1.3, 0.1, 0.2


@pytest.fixture(params=range(2))
def rng(request):
    """Random states."""
    return np.random.default_rng(request.param)


def sleigh(velocity=(0.0, 0.0, 0.0), pose=(0.0, 0.0, 0.0), **more):
    """Chaplygin's sleigh: a body with a blade behind its centre of mass."""
    body = mbd.Body("sleigh", mass=MASS, inertia=INERTIA, pose=pose, velocity=velocity)
    blade = mbd.KnifeEdge("blade", body.at(-BEHIND, 0))
    return body, blade, mbd.Mechanism([body], [blade], **more)


# --- the rows ---------------------------------------------------------------------------------
def test_rows_of_a_knife_edge(rng):
    """y·ṙ = 0: Jacobian [-s, c, x'] by hand; gamma by differences."""
    _body, _blade, mechanism = sleigh()
    eom = mbd.equations(mechanism)
    q, v = rng.normal(size=3), rng.normal(size=3)
    s, c = np.sin(q[2]), np.cos(q[2])
    jacobian = eom.function(eom.Phi_q)(0, q, v, np.zeros(3), [], [0], [], []).full()
    np.testing.assert_allclose(jacobian, [[-s, c, -BEHIND]], atol=1e-15)
    assert eom.Phi.numel() == 0 and list(eom.position_rows) == []
    # d/dt of (-s vx + c vy - b ω): gamma = (c vx + s vy) ω
    gamma = eom.function(eom.gamma)(0, q, v, np.zeros(3), [], [0], [], []).full()
    np.testing.assert_allclose(gamma, [[(c * v[0] + s * v[1]) * v[2]]], atol=1e-14)
    check_rows(mechanism, q, v)


def test_rheonomic_row_between_two_bodies(rng):
    """A relation of velocities with time, parameters and coordinates in it."""
    a, b = mbd.Body("a", 1, 1), mbd.Body("b", 1, 1)
    k = mbd.Parameter("k", 0.7)
    row = b.vx - k * mbd.cos(a.phi) * a.vy + mbd.sin(3 * mbd.t) * a.x
    mechanism = mbd.Mechanism([a, b], [mbd.NonholonomicConstraint("link", row)], parameters=[k])
    check_rows(mechanism, rng.normal(size=6), rng.normal(size=6))


def test_side_force_is_perpendicular_to_the_blade(rng):
    """Force -Phi_v^T lam along the marker's y axis; nothing about its point; the ground takes it."""
    body, blade, mechanism = sleigh(velocity=(1.0, 0, 3.0))
    state = mbd.assemble(mechanism)
    force = state[blade.reaction_on(body).force]
    assert state[blade.reaction_on(body).torque] == pytest.approx(0, abs=1e-13)
    along = np.array([np.cos(state[body.phi]), np.sin(state[body.phi])])
    assert force @ along == pytest.approx(0, abs=1e-13)
    assert np.linalg.norm(force) == pytest.approx(abs(state[blade.side_force]))
    check_balance(blade, mechanism, state.q, state.v, rng)


def test_degrees_of_freedom_count_at_velocity_level():
    """Two velocities are free, three coordinates can be reached."""
    report = mbd.check(sleigh()[2])
    assert (report.degrees_of_freedom, report.redundant_rows) == (2, 0)


# --- simulation --------------------------------------------------------------------------------------
def test_chaplygin_sleigh():
    """v = V tanh(κ t + c), ω = W sech(κ t + c), κ = b m V / (J + m b²): it turns until it runs straight ahead."""
    body, blade, mechanism = sleigh()
    forward = mbd.dot(blade.marker.x_axis, blade.marker.velocity)
    start = [forward == -0.5, body.omega == 4.0]
    run = mbd.simulate(mechanism, duration=4.0, initial=start, reltol=1e-10, abstol=1e-10)
    at_blade = INERTIA + MASS * BEHIND**2
    energy = 0.5 * (MASS * 0.5**2 + at_blade * 4.0**2)
    V, W = np.sqrt(2 * energy / MASS), np.sqrt(2 * energy / at_blade)
    argument = BEHIND * MASS * V / at_blade * run.t + np.arctanh(-0.5 / V)
    np.testing.assert_allclose(run[forward], V * np.tanh(argument), atol=1e-7)
    np.testing.assert_allclose(run[body.omega], W / np.cosh(argument), atol=1e-7)
    np.testing.assert_allclose(run.energy.total, energy, rtol=1e-7)
    assert run.drift.velocity < 1e-12


def test_skate_on_an_incline_does_not_go_down():
    """A blade on its centre of mass, given a spin: x = g sin α (1 - cos 2ωt) / 4ω², it comes back up (Bloch 2003)."""
    body = mbd.Body("skate", mass=2.0, inertia=0.1)
    blade = mbd.KnifeEdge("edge", body.at(0, 0))
    slope = 3.0  # g sin(alpha), along +x
    mechanism = mbd.Mechanism([body], [blade], forces=[mbd.Force("weight", body.at(0, 0), (2.0 * slope, 0))])
    run = mbd.simulate(mechanism, duration=5.0, initial=[body.omega == 1.5, body.vx == 0], reltol=1e-10, abstol=1e-10)
    w = 1.5
    np.testing.assert_allclose(run[body.x], slope / (4 * w**2) * (1 - np.cos(2 * w * run.t)), atol=1e-6)
    drift = slope / (2 * w**2) * (w * run.t - np.sin(2 * w * run.t) / 2)
    np.testing.assert_allclose(np.abs(run[body.y]), drift, atol=1e-6)


# --- prescribed motion and efforts -----------------------------------------------------------------------
def driven_sleigh():
    """Turned and moved along x by drivers; y follows from the blade."""
    body, blade, mechanism = sleigh(velocity=(1.0, 0, 0))
    turn, push = mbd.Driver("turn", body.phi, 0.5 * mbd.t), mbd.Driver("push", body.x, mbd.t)
    return body, blade, turn, push, mechanism.replace(drivers=[turn, push])


def test_kinematics_of_a_driven_sleigh():
    """ẏ of the blade = tan φ · ẋ of the blade, integrated in closed form."""
    body, _, _, _, mechanism = driven_sleigh()
    run = mbd.kinematics(mechanism, np.linspace(0, 2, 201))
    phi, w = 0.5 * run.t, 0.5
    # ∫ tan(ws)(1 + b w sin ws) ds = -ln cos(φ)/w + b (ln(sec φ + tan φ) - sin φ)
    y_blade = -np.log(np.cos(phi)) / w + BEHIND * (np.log(1 / np.cos(phi) + np.tan(phi)) - np.sin(phi))
    np.testing.assert_allclose(run[body.y], y_blade + BEHIND * np.sin(phi), atol=1e-9)
    assert run.drift.velocity < 1e-13
    between = run.at([0.123, 1.789])
    np.testing.assert_allclose(between[body.phi], 0.5 * between.t, atol=1e-13)


def test_inverse_dynamics_by_newton():
    """The side force and the efforts of both drivers from Newton's and Euler's laws."""
    body, blade, turn, push, mechanism = driven_sleigh()
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 2, 101))
    c, s = np.cos(run[body.phi]), np.sin(run[body.phi])
    # along y only the blade acts: N c = m ÿ
    side = MASS * run[body.ay] / c
    np.testing.assert_allclose(run[blade.side_force], side, atol=1e-10)
    np.testing.assert_allclose(run[push.effort], MASS * run[body.ax] + side * s, atol=1e-10)
    np.testing.assert_allclose(run[turn.effort], INERTIA * run[body.alpha] + BEHIND * side, atol=1e-10)


def test_efforts_at_another_place_and_replay():
    """The inputs that make the same motion; forward dynamics gives it back."""
    body, blade, turn, push, mechanism = driven_sleigh()
    u, f = mbd.Input("u"), mbd.Input("f")
    forces = [mbd.Torque("rudder", body, u), mbd.Force("screw", body.at(0, 0), (f, 0))]
    free = mbd.Mechanism([body], [blade], forces=forces, inputs=[u, f])
    times = np.linspace(0, 1.5, 301)
    run = mbd.inverse_dynamics(mechanism, times)
    found = mbd.inverse_dynamics(free, motion=run, efforts=[u, f])
    np.testing.assert_allclose(found[u], run[turn.effort], atol=1e-11)
    np.testing.assert_allclose(found[f], run[push.effort], atol=1e-11)
    replay = mbd.simulate(free, times, initial=found.initial, inputs={u: found[u], f: found[f]})
    np.testing.assert_allclose(replay.q, run.q, atol=2e-5)  # inputs are linear between the samples
    direct = mbd.inverse_dynamics(free, times, motion=[(body.phi, 0.5 * mbd.t), (body.x, mbd.t)], efforts=[u, f])
    np.testing.assert_allclose(direct[u], found[u], atol=1e-9)


def test_driven_sleigh_with_a_redundant_driver():
    """A third driver that says the same: least-norm efforts share it."""
    body, _blade, turn, push, mechanism = driven_sleigh()
    again = mbd.Driver("again", body.phi, 0.5 * mbd.t)
    run = mbd.inverse_dynamics(mechanism.replace(drivers=[turn, push, again]), np.linspace(0, 1, 51))
    single = mbd.inverse_dynamics(mechanism, np.linspace(0, 1, 51))
    np.testing.assert_allclose(run.q, single.q, atol=1e-9)
    np.testing.assert_allclose(run[turn.effort] + run[again.effort], single[turn.effort], atol=1e-8)


@pytest.mark.slow
def test_sleigh_driven_sideways_locks():
    """Turned across the direction in which it is pushed, at φ = π/2: no velocity meets both."""
    body, _blade, mechanism = sleigh(velocity=(1.0, 0, 0))
    turn, push = mbd.Driver("turn", body.phi, mbd.t), mbd.Driver("push", body.x, mbd.t)
    with pytest.raises(mbd.SingularityError, match="pose is singular.*push") as caught:
        mbd.kinematics(mechanism.replace(drivers=[turn, push]), np.linspace(0, 3, 301))
    assert caught.value.time == pytest.approx(np.pi / 2, abs=1e-3)
    assert len(caught.value.partial) == 158


def test_sleigh_with_too_few_drivers_is_refused():
    """One driver for two free velocities."""
    body, _blade, mechanism = sleigh()
    with pytest.raises(mbd.MechanismError, match="1 degree of freedom left"):
        mbd.kinematics(mechanism.replace(drivers=[mbd.Driver("turn", body.phi, mbd.t)]), [0, 1])


# --- optimal control --------------------------------------------------------------------------------------
def test_sleigh_is_parked_sideways():
    """It cannot move sideways and gets there nevertheless: least effort, verified by IDAS."""
    u, f = mbd.Input("u"), mbd.Input("f")
    body = mbd.Body("sleigh", mass=MASS, inertia=INERTIA)
    blade = mbd.KnifeEdge("blade", body.at(-BEHIND, 0))
    forces = [mbd.Torque("rudder", body, u), mbd.Force("screw", body.at(-BEHIND, 0), (f, 0), frame="body")]
    mechanism = mbd.Mechanism([body], [blade], forces=forces, inputs=[u, f])
    rest = [body.omega == 0, mbd.dot(blade.marker.x_axis, blade.marker.velocity) == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[body.x == 0, body.y == 0, body.phi == 0, *rest],
        final=[body.x == 0.5, body.y == 0.4, body.phi == 0, *rest],
        running_cost=u**2 + f**2,
    )
    solution = mbd.optimize(problem, intervals=30)
    motion = solution.trajectory
    across = mbd.dot(blade.marker.y_axis, blade.marker.velocity)
    assert np.max(np.abs(motion[across])) < 1e-4
    assert motion[body.y][-1] == pytest.approx(0.4, abs=1e-7)
    assert solution.verify().final_error < 1e-5


U = mbd.Input("u")


# --- refusals ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "make,said",
    [
        (lambda b: mbd.NonholonomicConstraint("n", b.vx**2), "'n' is not linear in the velocities"),
        (lambda b: mbd.NonholonomicConstraint("n", b.vx * b.omega), "'n' is not linear in the velocities"),
        (lambda b: mbd.NonholonomicConstraint("n", b.x), "'n' contains no velocity.*use Constraint"),
        (lambda b: mbd.NonholonomicConstraint("n", [b.vx, b.x]), "'n' contains no velocity"),
        (lambda b: mbd.NonholonomicConstraint("n", b.vx == 0), "'n' is the relation"),
        (lambda b: mbd.NonholonomicConstraint("n", b.ax + b.vx), "'n' depends on the acceleration 'b.ax'"),
        (lambda b: mbd.NonholonomicConstraint("n", b.vx - U), "'n' depends on the input 'u'"),
        (lambda b: mbd.KnifeEdge("k", b), "'k': marker must be a marker"),
        (lambda b: mbd.KnifeEdge("k", mbd.ground.at(0, 0)), "'k' contains no velocity"),
    ],
)
def test_velocity_level_constraints_that_make_no_sense(make, said):
    """Named, with the expression."""
    with pytest.raises(mbd.MechanismError, match=said):
        make(mbd.Body("b", mass=1, inertia=1))
