"""Differentiation formulas in C: against exact solutions, other methods and conserved quantities; what is refused."""

import ctypes

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.arguments.inputs import read_signals
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.integrators.native import build
from mbdcasadi.integrators.native.code import Code
from mbdcasadi.simulation.contact.watched_terms import watched_terms
from mbdcasadi.simulation.stepping.explicit_system import explicit_system

pytestmark = pytest.mark.skipif(build.compiler() is None, reason="there is no C compiler")
TIMES = np.linspace(0, 0.08, 9)


def heap(*more, weight=True, count=14, inputs=()):
    """Discs of two sizes in a heap on a floor; some hundred pairs."""
    rng, law = np.random.default_rng(7), mbd.HuntCrossley(2e4, damping=0.4)
    places = [(0.115 * (k % 5) + 0.005 * rng.normal(), 0.055 + 0.12 * (k // 5), 0) for k in range(count)]
    bodies = [mbd.Body(f"b{k}", mass=0.2, inertia=3e-4, pose=place) for k, place in enumerate(places)]
    discs = [mbd.Circle(body.at(0, 0), 0.05 + 0.01 * (k % 2)) for k, body in enumerate(bodies)]
    rough = mbd.Coulomb(0.3, 1e-2)
    forces = [mbd.Contact(f"c{j}_{k}", discs[j], discs[k], law, rough) for k in range(count) for j in range(k)]
    if weight:
        floor = mbd.HalfPlane(mbd.ground.at(0, 0))
        forces += [mbd.Gravity(), *[mbd.Contact(f"floor{k}", d, floor, law, rough) for k, d in enumerate(discs)]]
    return mbd.Mechanism(bodies, forces=[*forces, *(make(bodies) for make in more)], inputs=inputs)


def oscillator():
    """A stiff damper to the ground, and an actuator that follows an input: linear, so that tolerances can be tested."""
    body, u = mbd.Body("block", mass=2, inertia=0.1), mbd.Input("u")
    lag = mbd.FirstOrderLag("lag", u, 0.1)
    force = mbd.Force("drive", body.at(0, 0), (lag.output - 50 * body.x - 4e3 * body.vx, -200 * body.y))
    return mbd.Mechanism([body], forces=[force, lag], inputs=[u]), body, lag, u


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-8])
def test_a_stiff_system_with_states_and_samples_is_solved_to_the_tolerance(tolerance):
    """An explicit method would need steps below 1e-3 s."""
    mechanism, body, lag, u = oscillator()
    start, times = [body.x == 0.3, body.y == 0.2], np.linspace(0, 3, 31)
    samples = {u: np.sin(times)}
    exact = mbd.simulate(mechanism, times, initial=start, inputs=samples, method=mbd.Rosenbrock(1e-12, 1e-12))
    motion = mbd.simulate(mechanism, times, initial=start, inputs=samples, method=mbd.BDF(tolerance, tolerance))
    assert motion.statistics.method == "bdf" and any("bdf ran in C" in note for note in motion.statistics.notes)
    for quantity in (body.x, body.y, lag.output):
        np.testing.assert_allclose(motion[quantity], exact[quantity], atol=10 * tolerance)
    assert np.max(np.abs(motion[body.y] - exact[body.y])) > 1e-4 * tolerance  # it is the tolerance that decides


@pytest.mark.slow
def test_slopes_with_loops_are_those_of_the_equations():
    """With forces beside the loops, and an input that depends on the state."""
    u = mbd.Input("u")
    mechanism = heap(
        lambda bodies: mbd.TSDA("spring", bodies[0].at(0, 0), mbd.ground.at(0, 1), 30.0, 0.1),
        lambda bodies: mbd.Force("push", bodies[1].at(0, 0.01), (u, 0.0)),
        inputs=[u],
    )
    numeric = NumericEquations(mbd.equations(mechanism), np.zeros(0))
    eom = numeric.eom
    signals = read_signals(eom, {u: -3 * mechanism.bodies[1].vx}, None)
    system = explicit_system(numeric, signals, watched_terms(eom), implicit=True)
    assert system.written is not None
    assert system.written.shared.count("= 0.0;") < eom.q.numel() ** 2  # zeros of slopes are not written one by one
    code = Code(tuple(system.functions.values()), system.written)
    code.compile(build.compiler())
    x = ca.vertcat(eom.q, eom.v)
    force = ca.substitute(eom.Q, eom.u, signals.expressions)
    own = ca.Function("slopes", [eom.q, eom.v], [ca.jacobian(force / eom.mass_diagonal, x)])
    rng, n = np.random.default_rng(1), eom.q.numel()
    address, size = code.entry(list(system.functions).index("slopes"))
    call = ctypes.CFUNCTYPE(ctypes.c_int, *[ctypes.c_void_p] * 4, ctypes.c_int)(address)
    for _ in range(3):
        q, v = eom.estimate[0] + 0.02 * rng.normal(size=n), rng.normal(size=n)
        none, work, found = np.zeros(1), np.zeros(size), np.full((2 * n, n), np.nan)
        arguments = (ctypes.c_void_p * 8)(*(array.ctypes.data for array in (none, q, v, *[none] * 5)))
        call(arguments, (ctypes.c_void_p * 1)(found.ctypes.data), None, work.ctypes.data, 0)
        expected = own(q, v).full()
        np.testing.assert_allclose(found.T, expected, atol=1e-10 * np.max(np.abs(expected)))


@pytest.mark.slow
def test_a_heap_moves_as_by_idas_and_auto_takes_it():
    motion = mbd.simulate(heap(), TIMES, method="auto")
    assert motion.statistics.method == "bdf"
    other = mbd.simulate(heap(), TIMES)
    np.testing.assert_allclose(motion.q, other.q, atol=1e-6)
    assert any('method="bdf" is faster' in note for note in other.statistics.notes)
    springs = mbd.Mechanism([mbd.Body("b", mass=1, inertia=1)], forces=[mbd.Gravity()])
    assert mbd.simulate(springs, duration=0.1, method="auto").statistics.method == "dop853"


@pytest.mark.slow
def test_discs_that_collide_keep_their_momenta():
    """The momentum, and that about the origin, of a heap that flies together without gravity."""
    mechanism = heap(weight=False)
    bodies = mechanism.bodies
    towards = [r for b in bodies for x, y, _ in [b.pose_estimate] for r in (b.vx == -4 * x + 1, b.vy == -6 * y)]
    motion = mbd.simulate(mechanism, TIMES, initial=towards, method="bdf")
    assert sum(np.max(motion[contact.normal_force]) for contact in mechanism.forces) > 10.0
    about = sum(
        0.2 * (motion[b.x] * motion[b.vy] - motion[b.y] * motion[b.vx]) + 3e-4 * motion[b.omega] for b in bodies
    )
    for momentum in (sum(motion[b.vx] for b in bodies), sum(motion[b.vy] for b in bodies), about):
        np.testing.assert_allclose(momentum, momentum[0], atol=1e-7)


def test_a_force_that_switches_in_time_is_met():
    """With a longest step; without one the only step would pass it."""
    body = mbd.Body("b", mass=1, inertia=1)
    kick = mbd.Force("kick", body.at(0, 0), (mbd.if_else(mbd.t > 0.3, 1.0, 0.0), 0.0))
    mechanism = mbd.Mechanism([body], forces=[kick])
    motion = mbd.simulate(mechanism, duration=1.0, method=mbd.BDF(max_step=1e-3))
    assert motion[body.vx][-1] == pytest.approx(0.7, abs=1e-7)
    assert motion.final[body.x] == pytest.approx(0.49 / 2, abs=1e-7)


def test_what_it_does_not_take_is_refused_by_name(monkeypatch):
    body = mbd.Body("arm", mass=1, inertia=1)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), body.at(0, 0))
    with pytest.raises(mbd.SimulationError, match="hinge.*idas"):
        mbd.simulate(mbd.Mechanism([body], joints=[hinge]), duration=1.0, method="bdf")
    ball = mbd.Body("ball", mass=1, inertia=1, pose=(0, 1, 0))
    floor = mbd.RigidContact("floor", mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)))
    with pytest.raises(mbd.SimulationError, match="floor holds bodies.*idas"):  # before it falls
        mbd.simulate(mbd.Mechanism([ball], forces=[floor]), duration=1.0, method="bdf")
    with pytest.raises(mbd.SimulationError, match="takes no options"):
        mbd.BDF(options={"max_num_steps": 3})
    g = mbd.Parameter("g", 9.81)
    free = mbd.Mechanism([body], forces=[mbd.Gravity((0, -g))], parameters=[g])
    with pytest.raises(mbd.SimulationError, match='"bdf".*sweeps and derivatives.*idas'):
        mbd.sweep(free, np.linspace(0, 1, 5), cases={g: [1.0, 2.0]}, outputs=[body.y], method="bdf")
    monkeypatch.setattr(build, "compiler", lambda: None)
    with pytest.raises(mbd.SimulationError, match='"bdf" runs in C alone, and no C compiler'):
        mbd.simulate(free, duration=1.0, method="bdf")


def test_a_force_that_ends_the_motion_keeps_what_was_reached():
    body = mbd.Body("b", mass=1, inertia=1)
    mechanism = mbd.Mechanism([body], forces=[mbd.Force("pull", body.at(0, 0), (mbd.sqrt(0.5 - body.x) + 1, 0.0))])
    with pytest.raises(mbd.SimulationError, match="stopped at t") as caught:
        mbd.simulate(mechanism, duration=3.0, method="bdf")
    partial = caught.value.partial
    assert 0.4 < partial[body.x][-1] < 0.51
