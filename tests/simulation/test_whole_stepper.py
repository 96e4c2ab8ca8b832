"""Runs by DOP853: against closed forms, IDAS and SciPy."""

import gc
import os
import warnings
from itertools import pairwise

import numpy as np
import pytest
from keyboard import interrupted
from linkages import four_bar, n_four_bar, pendulum, slider_crank
from random_mechanisms import random_case
from scipy.integrate import solve_ivp
from scipy.special import ellipk
from seeds import seeds
from threads import together

import mbdcasadi as mbd
from mbdcasadi.integrators.native import build

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="no C compiler")

#: Seeds of random mechanisms that lock up within half a second, from far beyond what any method follows.
LOCKED = (15, 26, 86)


# --- closed forms ------------------------------------------------------------------------------------
def test_period_of_a_pendulum():
    """The period of a swing of 90° is a complete elliptic integral."""
    f = pendulum(angle=0.0)
    inertia = 1.0 * 0.5**2 + float(f.rod.inertia)
    period = 4 * np.sqrt(inertia / (9.81 * 0.5)) * ellipk(np.sin(np.pi / 4) ** 2)
    motion = mbd.simulate(f.mechanism, [0, period / 2, period], method=mbd.DOP853(1e-12, 1e-12))
    assert motion.final[f.rod.phi] == pytest.approx(0.0, abs=1e-9)
    assert motion[f.rod.phi][1] == pytest.approx(-np.pi, abs=1e-9)
    assert "ran in C" in motion.statistics.notes[0]


@pytest.mark.parametrize("gap", [0.02, 0.05, 0.07])
@pytest.mark.parametrize("stiffness", [1e7, 1e9])
def test_elastic_impact_that_begins_where_a_step_ends(gap, stiffness):
    """Two equal pucks exchange their speeds, however stiff they are: no step goes from the first touch through both."""
    a = mbd.Body("a", mass=0.1, inertia=1e-5, pose=(-gap, 0.0, 0.0), velocity=(1.0, 0.0, 0.0))
    b = mbd.Body("b", mass=0.1, inertia=1e-5, pose=(0.04, 0.0, 0.0))
    outlines = mbd.Circle(a.at(0, 0), 0.02), mbd.Circle(b.at(0, 0), 0.02)
    pucks = mbd.Mechanism([a, b], forces=[mbd.Contact("strike", *outlines, mbd.HuntCrossley(stiffness))])
    motion = mbd.simulate(pucks, [0, 0.05, 0.1], method="dop853")
    assert [motion.final[a.vx], motion.final[b.vx]] == pytest.approx([0.0, 1.0], abs=2e-5)


def test_reactions_of_a_pendulum():
    """Accelerations and reactions at outputs are those of the equations of motion there."""
    f = pendulum(angle=0.0)
    motion = mbd.simulate(f.mechanism, np.linspace(0, 1, 21), method="dop853")
    phi, omega = motion[f.rod.phi], motion[f.rod.omega]
    inertia = 0.25 + float(f.rod.inertia)
    np.testing.assert_allclose(motion[f.rod.alpha], -9.81 * 0.5 * np.cos(phi) / inertia, atol=1e-8)
    # along the rod the pin holds the weight's component and the centripetal force
    a = np.column_stack([motion[f.rod.ax], motion[f.rod.ay] + 9.81])
    along = np.column_stack([np.cos(phi), np.sin(phi)])
    np.testing.assert_allclose(np.sum(a * along, axis=1), 9.81 * np.sin(phi) - 0.5 * omega**2, atol=1e-7)
    np.testing.assert_allclose(np.abs(motion.lam[:, :2]), np.abs(a), atol=1e-7)


@pytest.mark.slow
def test_drift_of_constraints():
    """Every step is projected: outputs meet positions and velocities to rounding, energy hardly drifts."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    motion = mbd.simulate(f.mechanism, np.linspace(0, 10, 101), initial=[f.crank.omega == 200.0], method="dop853")
    assert abs(motion.final[f.crank.phi]) > 1000
    assert motion.drift.position < 1e-12
    assert motion.drift.velocity < 1e-10
    assert np.ptp(motion.energy.total) < 1e-6 * np.abs(motion.energy.kinetic).max()


@pytest.mark.parametrize("tolerance", [1e-3, 1e-5])
def test_drift_of_chains_at_loose_tolerances(tolerance):
    """One correction of the velocities is enough, or is repeated."""
    bodies = [mbd.Body(f"link {k}", mass=0.1, inertia=1e-4, pose=(0.1 * k + 0.05, 0, 0)) for k in range(10)]
    pins = [mbd.Revolute("pin 0", mbd.ground.at(0, 0), bodies[0].at(-0.05, 0))]
    pins += [mbd.Revolute(f"pin {k + 1}", a.at(0.05, 0), b.at(-0.05, 0)) for k, (a, b) in enumerate(pairwise(bodies))]
    mechanism = mbd.Mechanism(bodies=bodies, joints=pins, forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, duration=1.0, method="dop853", reltol=tolerance, abstol=tolerance)
    assert motion.drift.position < 1e-12
    assert motion.drift.velocity < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-6, 1e-8, 1e-10, 1e-12])
def test_tolerances_against_scipy(tolerance):
    """The error falls with the tolerance as that of SciPy's method on the same equations."""
    f = pendulum(angle=0.3)
    eom = mbd.equations(f.mechanism)
    start = mbd.assemble(f.mechanism)
    none = np.zeros(0)

    def rate(t, y):
        a, _ = eom.forward_dynamics(t, y[:3], y[3:], none, none, eom.parameter_values)
        return np.r_[y[3:], a.full().ravel()]

    times = np.linspace(0, 3, 7)
    y0 = np.r_[start.q, start.v]
    exact = solve_ivp(rate, (0, 3), y0, "DOP853", times, rtol=1e-13, atol=1e-14).y[:3].T
    peer = solve_ivp(rate, (0, 3), y0, "DOP853", times, rtol=tolerance, atol=tolerance).y[:3].T
    motion = mbd.simulate(f.mechanism, times, method=mbd.DOP853(tolerance, tolerance))
    error, other = np.abs(motion.q - exact).max(), np.abs(peer - exact).max()
    assert error < max(3 * other, 1e-11)
    assert error < 1e3 * tolerance


# --- against IDAS, and compiled against interpreted ----------------------------------------------------
@pytest.mark.parametrize("seed", seeds(200, quick=3, without=LOCKED))
def test_random_mechanisms(seed):
    """One random mechanism, and the same by IDAS."""
    mechanism = random_case(seed).mechanism
    start = mbd.assemble(mechanism)
    times = np.linspace(0, 0.4, 9)

    def run(method):
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", mbd.MechanismWarning)
            return mbd.simulate(mechanism, times, initial=start, method=method)

    if random_case(seed).redundant:
        with pytest.raises(mbd.SimulationError, match=r"dop853.*repeated"):
            run("dop853")
        return
    motion = run("dop853")
    size = 1 + np.abs(motion.q).max()
    np.testing.assert_allclose(motion.q, run(mbd.IDAS(1e-10, 1e-10)).q, atol=2e-6 * size)
    assert motion.drift.position < 1e-12 * size


@pytest.mark.slow
def test_compiled_and_interpreted_equations_agree(tmp_path, monkeypatch):
    """The compiler must not change the rounding of the interpreter."""
    monkeypatch.setenv("MBDCASADI_CACHE", str(tmp_path))
    mechanism = n_four_bar(3).mechanism
    times = np.linspace(0, 0.5, 11)
    interpreted = mbd.simulate(mechanism, times, method="dop853")
    compiled = mbd.simulate(mechanism, times, method=mbd.DOP853(jit=True))
    assert "interpreted" in interpreted.statistics.notes[0]
    assert "compiled" in compiled.statistics.notes[0] and "interpreted" not in compiled.statistics.notes[0]
    np.testing.assert_allclose(compiled.q, interpreted.q, atol=1e-12)


# --- inputs, states, drivers, events -------------------------------------------------------------------
def cart(**more):
    """A cart of 2 kg with a force on it."""
    u = mbd.Input("u")
    body = mbd.Body("cart", mass=2.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    push = mbd.Force("push", body.at(0, 0), (u, 0))
    return body, u, mbd.Mechanism(bodies=[body], joints=[rail], forces=[push], inputs=[u], **more)


def test_inputs():
    """A number, samples with a kink, an expression in time, and feedback."""
    body, u, mechanism = cart()
    times = np.linspace(0, 2, 9)
    end = [mbd.simulate(mechanism, times, inputs={u: given}, method="dop853").final[body.x] for given in (
        3.0,
        np.where(times < 1, 4.0 * times, 4.0),
        mbd.sin(3 * mbd.t),
    )]  # fmt: skip
    assert end[0] == pytest.approx(3.0, rel=1e-9)
    # up to 1 s: x = t³/3, v = t²; then with 2 m/s²
    assert end[1] == pytest.approx(1 / 3 + 1.0 + 1.0, rel=1e-8)
    assert end[2] == pytest.approx((2 - np.sin(6) / 3) / 3 / 2, rel=1e-7)
    swing = mbd.simulate(mechanism, times, initial=[body.x == 1.0], inputs={u: -8.0 * body.x}, method="dop853")
    np.testing.assert_allclose(swing[body.x], np.cos(2 * times), atol=1e-6)


def test_first_order_states():
    """A motor current that decays into a force."""
    z = mbd.StateVariable("z", value=1.0)
    body = mbd.Body("cart", mass=2.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    forces = [mbd.Force("push", body.at(0, 0), (z, 0))]
    mechanism = mbd.Mechanism(bodies=[body], joints=[rail], forces=forces, states={z: -5 * z})
    motion = mbd.simulate(mechanism, [0, 1.0], method="dop853")
    assert motion.final[z] == pytest.approx(np.exp(-5), rel=1e-7)
    assert motion.final[body.vx] == pytest.approx((1 - np.exp(-5)) / 10, rel=1e-7)


def test_a_driven_mechanism():
    """Constraints in time: the slider follows the crank, with the velocity and acceleration of the closed form."""
    f = slider_crank(0.4, drivers=lambda f: [mbd.Driver("speed", f.A.angle, 0.4 + 3 * mbd.t)])
    motion = mbd.simulate(f.mechanism, np.linspace(0, 2, 41), method="dop853")
    theta = 0.4 + 3 * motion.t
    x = 0.15 * np.cos(theta) + np.sqrt(0.45**2 - (0.15 * np.sin(theta)) ** 2)
    np.testing.assert_allclose(motion[f.slider.x], x, atol=1e-11)


def test_bounces():
    """A ball with restitution: every bounce at its time, to rounding."""
    ball = mbd.Body("ball", mass=1.0, inertia=0.1, pose=(0, 1, 0))
    bounce = mbd.Event("bounce", ball.y, direction=-1, reset={ball.vy: -0.8 * ball.vy})
    mechanism = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, [0, 2.0], events=[bounce], method="dop853")
    fall = np.sqrt(2 / 9.81)
    expected = [fall, fall * (1 + 2 * 0.8), fall * (1 + 2 * (0.8 + 0.64))]
    found = [event.t for event in motion.events]
    np.testing.assert_allclose(found, [t for t in expected if t < 2.0], atol=1e-9)


def dropped(law, fall=0.95, *, thin=False):
    """A ball of 1 kg and 50 mm dropped onto a floor, or onto a bar without thickness."""
    ball = mbd.Body("ball", mass=1, inertia=1e-3, pose=(0, 0.05 + fall, 0))
    floor = mbd.Segment(mbd.ground.at(0, 0), 2) if thin else mbd.HalfPlane(mbd.ground.at(0, 0))
    contact = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.05), floor, law)
    return mbd.Mechanism([ball], forces=[mbd.Gravity(), contact]), ball


def height_of_bounces(t, stiffness, fall):
    """Height of the ball on a linear spring: free flight and harmonic motion in turn, each in closed form."""
    g = 9.81
    speed, w = np.sqrt(2 * g * fall), np.sqrt(stiffness)
    flight, closed = 2 * speed / g, 2 * (np.pi - np.arctan(speed * w / g)) / w
    phase = (t + flight / 2) % (flight + closed)
    inside = phase - flight
    depth = g / w**2 * (1 - np.cos(w * inside)) + speed / w * np.sin(w * inside)
    return 0.05 + np.where(inside < 0, speed * phase - g / 2 * phase**2, -depth)


def test_bounces_on_a_linear_spring():
    model, ball = dropped(mbd.HuntCrossley(1e5, damping=0, exponent=1))
    motion = mbd.simulate(model, np.linspace(0, 3, 301), method="dop853")
    np.testing.assert_allclose(motion[ball.y], height_of_bounces(motion.t, 1e5, 0.95), atol=1e-7)


@pytest.mark.parametrize("count", [2, 11, 101])
@pytest.mark.parametrize("stiffness", [1e6, 1e7])
@pytest.mark.parametrize("fall", [0.9, 0.9001, 0.95, 1.9])
def test_a_thin_bar_is_not_fallen_through(fall, stiffness, count):
    """Steps that end elsewhere than those before, to meet one bounce, may pass another one unawares."""
    model, ball = dropped(mbd.HuntCrossley(stiffness, damping=0, exponent=1), fall, thin=True)
    motion = mbd.simulate(model, np.linspace(0, 3, count), method="dop853")
    np.testing.assert_allclose(motion[ball.y], height_of_bounces(motion.t, stiffness, fall), atol=5e-6)


@pytest.mark.parametrize("stiffness", [1e4, 1e6, 1e9])
def test_bounces_keep_their_energy(stiffness):
    model, ball = dropped(mbd.HuntCrossley(stiffness, damping=0))
    motion = mbd.simulate(model, np.linspace(0, 3, 31), method="dop853")
    depth = np.maximum(0.05 - motion[ball.y], 0)
    energy = motion[ball.vy] ** 2 / 2 + 9.81 * motion[ball.y] + stiffness * depth**2.5 / 2.5
    np.testing.assert_allclose(energy, 9.81, atol=5e-6)


@pytest.mark.slow
def test_a_step_that_ends_at_a_switch_up_to_rounding():
    """Three discs fall onto each other with friction: a contact begins where a step ends, and the run goes on."""
    discs = [mbd.Body(f"disc {k}", mass=1.0, inertia=0.005, pose=(0.05 * k, 0.3 * (k + 1), 0)) for k in range(3)]
    law, friction = mbd.HuntCrossley(1e4, exponent=1, damping=0.3), mbd.Coulomb(0.3, 0.01)
    rims = [mbd.Circle(disc.at(0, 0), 0.1) for disc in discs]
    floor = mbd.HalfPlane(mbd.ground.at(0, 0))
    pairs = [*((floor, rim) for rim in rims), *pairwise(rims)]
    contacts = [mbd.Contact(f"contact {k}", a, b, law, friction=friction) for k, (a, b) in enumerate(pairs)]
    mechanism = mbd.Mechanism(discs, forces=[mbd.Gravity(), *contacts])
    times = np.linspace(0, 0.3, 21)
    motion, reference = (mbd.simulate(mechanism, times, method=method) for method in ("dop853", "idas"))
    for disc in discs:
        assert motion[disc.position] == pytest.approx(reference[disc.position], abs=1e-5)


# --- touches that are short beside the steps ----------------------------------------------------------
def rotor_with_peg():
    """A rotor at 100 rad/s whose peg touches a damped stop once a turn: mechanism, rotor, pin, and its speed."""
    rotor = mbd.Body("rotor", mass=1.0, inertia=0.01)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rotor.at(0, 0))
    law = mbd.HuntCrossley(1e4, exponent=1, damping=2.0)
    stop = mbd.Contact("stop", mbd.Point(rotor.at(0.1, 0)), mbd.HalfPlane(mbd.ground.at(0, -0.099)), law)

    def rate(t, y):
        depth, speed = -0.099 - 0.1 * np.sin(y[0]), -0.1 * np.cos(y[0]) * y[1]
        force = max(1e4 * depth * (1 + 2.0 * speed), 0.0) if depth > 0 else 0.0
        return [y[1], 0.1 * np.cos(y[0]) * force / 0.01]

    def speed(angle, times):
        options = {"method": "DOP853", "t_eval": times, "rtol": 1e-10, "atol": 1e-10, "max_step": 2e-4}
        return solve_ivp(rate, (0, times[-1]), [angle, 100], **options).y[1]

    return mbd.Mechanism([rotor], joints=[pin], forces=[stop]), rotor, pin, speed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("angle", "turns", "count"),
    # the start of a step in the stop by less than 1 nm, a last stage that grazes it, stages of the dense output and
    # outlines that part without a force in it, and stops for a touch of which but an instant was looked at
    [(1.0, 12, 2), (2.0, 12, 5), (3.3373, 5, 3), (-1.1764157857100614, 7, 3), (4.2590254038279145, 6, 2)],
)
def test_each_touch_of_a_rotor_counts(angle, turns, count):
    """Each takes 0.0121 rad/s, and steps between them span a turn or more."""
    machine, rotor, pin, speed = rotor_with_peg()
    times = np.linspace(0, turns * 2 * np.pi / 100, count)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = mbd.simulate(machine, times, initial=[pin.angle == angle, rotor.omega == 100], method="dop853")
    assert motion[rotor.omega] == pytest.approx(speed(angle, times), abs=5e-5)


@pytest.mark.slow
@pytest.mark.parametrize("angle", [0.0, 1.0])
def test_energy_of_touches_by_runge_kutta(angle):
    """The estimate of the error is some fifty times too small in steps across a touch; each takes 0.0121 rad/s."""
    machine, rotor, pin, speed = rotor_with_peg()
    times = np.linspace(0, 12 * 2 * np.pi / 100, 13)
    motion = mbd.simulate(machine, times, initial=[pin.angle == angle, rotor.omega == 100], method="erk")
    assert motion[rotor.omega] == pytest.approx(speed(angle, times), abs=1e-4)


def test_a_force_that_switches_in_the_state():
    """From x = 1/2 on a force of 1 N: x = t until t = 1/2, and a parabola after it."""
    body = mbd.Body("body", mass=1, inertia=1)
    push = mbd.Force("push", body.at(0, 0), (mbd.if_else(body.x > 0.5, 1.0, 0.0), 0))
    model = mbd.Mechanism([body], forces=[push])
    for times in (np.linspace(0, 1, 11), np.linspace(0, 1, 8)):
        motion = mbd.simulate(model, times, initial=[body.vx == 1.0], method="dop853")
        exact = times + np.maximum(times - 0.5, 0) ** 2 / 2
        np.testing.assert_allclose(motion[body.x], exact, atol=1e-10)


def test_events_between_far_outputs():
    """Events inside one long step are found in both directions, and a terminal one ends the run."""
    f = pendulum(angle=0.0)
    below = mbd.Event("below", mbd.cos(f.rod.phi), direction=0)
    stop = mbd.Event("stop", f.rod.omega, direction=1, terminal=True)
    motion = mbd.simulate(f.mechanism, [0, 10.0], events=[below, stop], method="dop853")
    inertia = 0.25 + float(f.rod.inertia)
    period = 4 * np.sqrt(inertia / (9.81 * 0.5)) * ellipk(0.5)
    assert [event.name for event in motion.events] == ["below", "stop"]
    assert motion.events[0].t == pytest.approx(period / 4, abs=1e-7)
    assert motion.events[1].t == pytest.approx(period / 2, abs=1e-7)
    assert motion.t[-1] == pytest.approx(period / 2, abs=1e-7)


def test_the_longest_step():
    """A limit on the step makes more of them."""
    f = pendulum(angle=0.0)
    free = mbd.simulate(f.mechanism, [0, 2.0], method="dop853")
    held = mbd.simulate(f.mechanism, [0, 2.0], method=mbd.DOP853(max_step=1e-3))
    assert held.final[f.rod.phi] == pytest.approx(free.final[f.rod.phi], abs=1e-7)
    assert np.ptp(held.energy.total) < 1e-11


def test_noise_at_the_limit_of_stability():
    """A strong drag that follows a moving belt, against the closed form: steps stay where no noise grows."""
    body, rate = cart()[0], 2000.0
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    drag = mbd.Force("drag", body.at(0, 0), (-2 * rate * (body.vx - mbd.sin(mbd.t)), 0))
    mechanism = mbd.Mechanism(bodies=[body], joints=[rail], forces=[drag])
    times, initial = np.linspace(0, 2, 101), [body.x == 0, body.vx == 0]
    motion = mbd.simulate(mechanism, times, initial=initial, method="dop853", reltol=1e-6, abstol=1e-6)
    known = rate**2 * np.sin(times) - rate * np.cos(times) + rate * np.exp(-rate * times)
    assert np.max(np.abs(motion[body.vx] - known / (1 + rate**2))) < 2e-5  # 1e-4 at the limit itself


# --- what it refuses -------------------------------------------------------------------------------------
def test_stiff_motion_is_refused():
    """A hard spring with a strong damper: stability asks for 1e7 steps, and the error says so with the remedy."""
    body, u, _ = cart()
    damper = mbd.Force("damper", body.at(0, 0), (-1e8 * body.vx + u, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    mechanism = mbd.Mechanism(bodies=[body], joints=[rail], forces=[damper], inputs=[u])
    with pytest.raises(mbd.SimulationError, match=r'too stiff for method="dop853".*method="idas"') as raised:
        mbd.simulate(mechanism, [0, 5.0], inputs={u: 1.0}, method="dop853")
    assert 0 <= raised.value.time < 1.0


def test_friction_by_reactions_is_refused_by_name():
    body = mbd.Body("block", mass=1.0, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    friction = mbd.JointFriction("rub", rail, mbd.Coulomb(0.2, 1e-3), length=0.2)
    mechanism = mbd.Mechanism(bodies=[body], joints=[rail], forces=[friction, mbd.Gravity()])
    with pytest.raises(mbd.SimulationError, match=r'dop853.*rub.*method="idas"'):
        mbd.simulate(mechanism, duration=0.1, method="dop853")


def test_options_are_refused():
    with pytest.raises(mbd.SimulationError, match="DOP853 takes no options, got 'max_num_steps'"):
        mbd.DOP853(options={"max_num_steps": 3})
    with pytest.raises(mbd.SimulationError, match="reltol must be positive"):
        mbd.DOP853(reltol=-1)


def test_jit_without_a_compiler(monkeypatch):
    monkeypatch.setenv("PATH", "/nowhere")
    monkeypatch.delenv("CC", raising=False)
    with pytest.raises(mbd.SimulationError, match="jit=True needs a C compiler"):
        mbd.DOP853(jit=True)


# --- threads, Ctrl-C, memory -------------------------------------------------------------------------------
def test_eight_threads():
    """Runs of one mechanism in eight threads are those of one thread."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    times = np.linspace(0, 1, 11)

    def run(k):
        return mbd.simulate(f.mechanism, times, initial=[f.crank.omega == 5.0 + k], method="dop853").q

    expected = [run(k) for k in range(8)]
    found = together([lambda k=k: run(k) for k in range(8)])
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-12)


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interruption():
    """Ctrl-C in a long run ends it, with what was computed."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    start, method = [f.crank.omega == 20.0], mbd.DOP853(max_step=1e-5)
    caught = interrupted(lambda: mbd.simulate(f.mechanism, np.linspace(0, 1000, 11), initial=start, method=method))
    assert 0 <= caught.time < 1000


@pytest.mark.slow
def test_memory_of_many_runs():
    """Two thousand runs leave nothing behind."""
    resource = pytest.importorskip("resource")
    f = pendulum(angle=0.0)

    def runs(count):
        for _ in range(count):
            mbd.simulate(f.mechanism, [0, 0.1], method="dop853")
        gc.collect()
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss

    before = runs(300)
    assert runs(2000) - before < 4000  # kB
