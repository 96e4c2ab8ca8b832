"""Simulation: accuracy, inputs, states, events, refusals, and messages when it stops."""

from __future__ import annotations

import os
import shutil
import signal
import warnings
from itertools import pairwise
from types import SimpleNamespace

import casadi as ca
import numpy as np
import pytest
from keyboard import interrupted
from linkages import G, four_bar, n_four_bar, pendulum, slider_crank
from scipy.integrate import cumulative_simpson, solve_ivp
from scipy.special import ellipk

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock", "dop853", "auto"]
#: Those that take rows that depend on each other.
TOLERANT = [method for method in METHODS if method != "dop853"]
TIGHT = {"reltol": 1e-11, "abstol": 1e-11}


def exact(rate, times, start, **more):
    """Reference by DOP853 at 1e-12: (k, n_t)."""
    settings = {"method": "DOP853", "rtol": 1e-12, "atol": 1e-13} | more
    return solve_ivp(rate, (times[0], times[-1]), start, t_eval=times, **settings).y


def swing(times, angle=0.0, rate=0.0, torque=lambda t, y: 0.0):
    """Angle and rate of a uniform rod of 1 m and 1 kg under gravity and a torque at its pin."""
    return exact(lambda t, y: [y[1], 3 * (torque(t, y) - G / 2 * np.cos(y[0]))], times, [angle, rate])


def actuated_pendulum(**more):
    """The rod with a torque on it."""
    tau = mbd.Input("tau", **more)
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    p.tau = tau
    return p


def ball(height=1.0, **more):
    """A body that falls freely."""
    body = mbd.Body("ball", mass=0.6, inertia=0.01, pose=(0, height, 0), **more)
    return body, mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])


# --- accuracy ---------------------------------------------------------------------------------------
@pytest.mark.slow
def test_conserves_energy_over_100_s():
    """A four-bar that turns over, 1e-8: energy to 2e-5 of the largest kinetic one, constraints to rounding."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    motion = mbd.simulate(f.mechanism, np.linspace(0, 100, 2001), initial=[f.A.angle == 0.5, f.crank.omega == 12])
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() <= 2e-5 * motion.energy.kinetic.max()
    assert motion.drift.position <= 1e-12
    assert motion.drift.velocity <= 1e-11
    assert motion[f.A.angle][-1] > 100


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_methods_agree(method):
    """Each integrator gives the motion of a slider-crank under torque."""
    f = slider_crank(0.5, forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, 2.0)])
    settings = {"initial": [f.A.angle == 0.5, f.crank.omega == 3], "times": np.linspace(0, 1, 21)}
    motion = mbd.simulate(f.mechanism, **settings, reltol=1e-9, abstol=1e-9, method=method)
    reference = mbd.simulate(f.mechanism, **settings, reltol=1e-12, abstol=1e-12, method="erk")
    np.testing.assert_allclose(motion.q, reference.q, atol=1e-6)
    np.testing.assert_allclose(motion.lam, reference.lam, atol=1e-6 * np.abs(reference.lam).max() + 1e-4)
    assert motion.statistics.method == ("dop853" if method == "auto" else method)


def test_auto_chooses_by_stiffness():
    """Runge–Kutta for a pendulum, IDAS for a stiff damper; both right."""
    p = pendulum()
    assert mbd.simulate(p.mechanism, duration=1.0, method="auto").statistics.method == "dop853"
    stiff = pendulum(forces=lambda rod: [mbd.RSDA("damper", mbd.ground.at(0, 0), rod.at(0, 0), damping=3e4)])
    motion = mbd.simulate(stiff.mechanism, duration=10.0, method="auto")
    assert motion.statistics.method == "idas"
    np.testing.assert_allclose(motion[stiff.rod.omega][-1], -G / 2 / 3e4, rtol=1e-3)


def test_converges_with_the_tolerance():
    """The error falls with the tolerance, and is near to it."""
    times = np.linspace(0, 5, 51)
    p = pendulum()
    angle = swing(times)[0]
    errors = [
        np.abs(mbd.simulate(p.mechanism, times, reltol=tol, abstol=tol)[p.rod.phi] - angle).max()
        for tol in (1e-4, 1e-6, 1e-8, 1e-10)
    ]
    assert np.all(np.diff(np.log10(errors)) < -0.8)
    assert errors[2] < 1e-6 and errors[3] < 1e-8


@pytest.mark.parametrize(("method", "order"), [("idas", 5), ("rosenbrock", 5), ("dop853", 8)])
def test_steps_are_counted(method, order):
    """A method of order k takes steps whose number grows with the power 1/k of the tolerance, in the long run."""
    p = pendulum()
    steps = [
        mbd.simulate(p.mechanism, [0, 20], reltol=tol, abstol=tol, method=method).statistics.steps
        for tol in (1e-6, 1e-9)
    ]
    assert 0.5 < order * np.log10(steps[1] / steps[0]) / 3 < 1.5


def test_repeats_itself():
    """The same call gives the same numbers."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    first, second = (mbd.simulate(f.mechanism, np.linspace(0, 1, 11)) for _ in range(2))
    np.testing.assert_array_equal(first.q, second.q)
    np.testing.assert_array_equal(first.lam, second.lam)


def test_outputs_do_not_depend_on_the_grid():
    """A coarse grid gives the values of a fine one; times need not be uniform, nor start at zero."""
    p = pendulum()
    fine = mbd.simulate(p.mechanism, np.linspace(0, 2, 201), **TIGHT)
    coarse = mbd.simulate(p.mechanism, [0, 2], **TIGHT)
    uneven = mbd.simulate(p.mechanism, [0, 0.01, 0.5, 1.99, 2], **TIGHT)
    later = mbd.simulate(p.mechanism, [5, 7], **TIGHT)
    for other in (coarse, uneven, later):
        np.testing.assert_allclose(other.q[-1], fine.q[-1], atol=1e-9)
    np.testing.assert_array_equal(uneven.t, [0, 0.01, 0.5, 1.99, 2])


def test_duration():
    """201 outputs from zero."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, duration=0.5)
    np.testing.assert_allclose(motion.t, np.linspace(0, 0.5, 201))


def test_explicit_time_counts_from_zero():
    """A force in t is taken at the time of the run, wherever its chunks start."""
    body = mbd.Body("body", mass=2.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (mbd.cos(3 * mbd.t), 0))])
    times = np.linspace(1, 9, 81)
    motion = mbd.simulate(mechanism, times, **TIGHT)
    s, c = np.sin(3.0), np.cos(3.0)
    wanted = (c - np.cos(3 * times)) / 18 - s / 6 * (times - 1)
    np.testing.assert_allclose(motion[body.x], wanted, atol=1e-8)
    np.testing.assert_allclose(motion[body.ax], np.cos(3 * times) / 2, atol=1e-12)


# --- compilation --------------------------------------------------------------------------------------
@pytest.mark.skipif(not any(shutil.which(c) for c in ("gcc", "clang", "cc")), reason="no C compiler")
def test_compiled():
    """jit=True gives the same motion."""
    p = pendulum()
    times = np.linspace(0, 1, 21)
    compiled = mbd.simulate(p.mechanism, times, jit=True)
    np.testing.assert_allclose(compiled.q, mbd.simulate(p.mechanism, times).q, atol=1e-7)


def test_no_compiler(monkeypatch, tmp_path):
    """Said in words, before anything is run."""
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(mbd.SimulationError, match="C compiler"):
        mbd.simulate(pendulum().mechanism, duration=1.0, jit=True)


# --- inputs ---------------------------------------------------------------------------------------------
def test_input_as_number():
    """A constant torque, and the input's own value where none is given."""
    times = np.linspace(0, 2, 21)
    p = actuated_pendulum(value=2.0)
    given = mbd.simulate(p.mechanism, times, inputs={p.tau: 3.0}, **TIGHT)
    own = mbd.simulate(p.mechanism, times, **TIGHT)
    np.testing.assert_allclose(given[p.rod.phi], swing(times, torque=lambda t, y: 3.0)[0], atol=1e-8)
    np.testing.assert_allclose(own[p.rod.phi], swing(times, torque=lambda t, y: 2.0)[0], atol=1e-8)
    np.testing.assert_allclose(given[p.tau], 3.0)
    assert given.inputs.shape == (21, 1)


def test_input_as_samples():
    """Linear between the samples: a double integral of a broken line, exactly."""
    u = mbd.Input("u")
    body = mbd.Body("body", mass=2.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (u, 0))], inputs=[u])
    times = np.array([0.0, 0.2, 0.7, 1.5, 2.0])
    samples = np.array([1.0, -3.0, 4.0, 0.0, 2.0])
    motion = mbd.simulate(mechanism, times, inputs={u: samples}, **TIGHT)
    x, v = [0.0], [0.0]
    for h, u0, u1 in zip(np.diff(times), samples, samples[1:], strict=False):
        x.append(x[-1] + h * v[-1] + h**2 * (2 * u0 + u1) / 12)
        v.append(v[-1] + h * (u0 + u1) / 4)
    np.testing.assert_allclose(motion[body.x], x, atol=1e-9)
    np.testing.assert_allclose(motion[body.vx], v, atol=1e-9)
    np.testing.assert_allclose(motion[u], samples, atol=1e-12)
    np.testing.assert_allclose(motion[body.ax], samples / 2, atol=1e-12)


@pytest.mark.parametrize("first", [1e-6, 1e-7, 1e-8, 1e-9, 1e-11])
def test_inputs_that_bend(first):
    """Whatever the first step is: where IDAS cannot go on over a bend of the input, it is started anew there."""

    class Begun(mbd.IDAS):
        """A first step of its own, relative to a piece."""

        def plugin_options(self, *, algebraic):
            return super().plugin_options(algebraic=algebraic) | {"step0": first}

    u = mbd.Input("u")
    body = mbd.Body("body", mass=2.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (u, 0))], inputs=[u])
    times, samples = np.array([0.0, 0.2, 0.7, 1.5, 2.0]), np.array([1.0, -3.0, 4.0, 0.0, 2.0])
    motion = mbd.simulate(mechanism, times, inputs={u: samples}, method=Begun(**TIGHT))
    speeds = np.append(0.0, np.cumsum(np.diff(times) * (samples[1:] + samples[:-1]) / 4))
    np.testing.assert_allclose(motion[body.vx], speeds, atol=1e-9)


def test_starts_that_are_kept_belong_to_nobody():
    """A motion from the same start is the same, whatever became of the numbers of the first one."""
    mechanism = pendulum(0.3).mechanism
    start = mbd.assemble(mechanism)
    first = mbd.simulate(mechanism, [0.0, 0.1], initial=start).initial
    kept = first.a.copy(), first.lam.copy()
    first.a[:], first.lam[:], start.a[:] = 1.0, 2.0, 3.0
    again = mbd.simulate(mechanism, [0.0, 0.1], initial=start).initial
    np.testing.assert_array_equal(again.a, kept[0])
    np.testing.assert_array_equal(again.lam, kept[1])


def test_input_as_feedback():
    """PD control in positions and rates, against SciPy; the values are reported."""
    times = np.linspace(0, 3, 61)
    p = actuated_pendulum()
    law = 40 * (mbd.sin(mbd.t) - p.rod.phi) - 6 * p.rod.omega
    motion = mbd.simulate(p.mechanism, times, inputs={p.tau: law}, **TIGHT)
    angle, rate = swing(times, torque=lambda t, y: 40 * (np.sin(t) - y[0]) - 6 * y[1])
    np.testing.assert_allclose(motion[p.rod.phi], angle, atol=1e-8)
    np.testing.assert_allclose(motion[p.tau], 40 * (np.sin(times) - angle) - 6 * rate, atol=1e-6)


def piecewise(times, period, torque):
    """The rod under a torque that is held over periods."""
    y, now, columns = np.zeros(2), times[0], [np.zeros(2)]
    held = torque(now, y)
    instants = np.unique(np.round(np.r_[times, np.arange(0, times[-1], period)], 12))
    for left, right in pairwise(instants):
        if abs(left / period - round(left / period)) < 1e-9:
            held = torque(left, y)
        y = swing(np.array([left, right]), *y, torque=lambda t, y, held=held: held)[:, -1]
        if np.min(np.abs(times - right)) < 1e-9:
            columns.append(y)
    return np.array(columns).T


def test_sampled_controller():
    """Plain Python, asked once a period and held in between: against a piecewise integration."""
    times = np.linspace(0, 2, 81)
    p = actuated_pendulum()
    asked = []

    def control(t, state):
        asked.append(t)
        return {p.tau: 30 * (0.5 - state[p.rod.phi]) - 5 * state[p.rod.omega]}

    motion = mbd.simulate(p.mechanism, times, inputs=mbd.SampledController(control, 0.05), **TIGHT)
    angle, rate = piecewise(times, 0.05, lambda t, y: 30 * (0.5 - y[0]) - 5 * y[1])
    np.testing.assert_allclose(motion[p.rod.phi], angle, atol=1e-8)
    np.testing.assert_allclose(motion[p.rod.omega], rate, atol=1e-7)
    np.testing.assert_allclose(asked, 0.05 * np.arange(40), atol=1e-12)


def test_sampled_controller_off_the_grid():
    """The period need not fit the outputs."""
    times = np.linspace(0, 1, 11)
    p = actuated_pendulum()
    control = mbd.SampledController(lambda t, s: {p.tau: 20 * (0.5 - s[p.rod.phi])}, 0.03)
    motion = mbd.simulate(p.mechanism, times, inputs=control, **TIGHT)
    angle, _ = piecewise(times, 0.03, lambda t, y: 20 * (0.5 - y[0]))
    np.testing.assert_allclose(motion[p.rod.phi], angle, atol=1e-8)


def test_sampled_controller_that_fails():
    """A value that is not finite is refused with the time; an error of the user's own keeps the run, as its cause."""
    p = actuated_pendulum()
    broken = mbd.SampledController(lambda t, s: {p.tau: np.nan if t > 0.4 else 0.0}, 0.1)
    with pytest.raises(mbd.MechanismError, match=r"tau.*t = 0\.5"):
        mbd.simulate(p.mechanism, duration=1.0, inputs=broken)

    def faulty(t, state):
        if t > 0.45:
            raise ZeroDivisionError("mine")
        return {p.tau: 0.0}

    with pytest.raises(mbd.SimulationError, match=r"controller raised ZeroDivisionError at t = 0\.5 s: mine") as caught:
        mbd.simulate(p.mechanism, duration=1.0, inputs=mbd.SampledController(faulty, 0.1))
    assert isinstance(caught.value.__cause__, ZeroDivisionError)
    assert caught.value.partial.t[-1] == pytest.approx(0.5)


def test_input_limits_warn():
    """simulate does not hold limits, but says that they are exceeded, and by whom."""
    p = actuated_pendulum(lower=-1, upper=1)
    with pytest.warns(mbd.MechanismWarning, match=r"'tau'.*2"):
        mbd.simulate(p.mechanism, duration=0.1, inputs={p.tau: 2.0})
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.simulate(p.mechanism, duration=0.1, inputs={p.tau: 1.0})


@pytest.mark.parametrize(
    ("value", "words"),
    [
        ([1.0, 2.0], "2 samples.*11 times"),
        (np.r_[np.zeros(10), np.nan], "sample 10"),
        (float("nan"), "finite"),
        ("high", "tau"),
        (lambda t: t, "Python function"),
    ],
)
def test_refuses_inputs(value, words):
    """Each kind of wrong input is named with the input."""
    p = actuated_pendulum()
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.simulate(p.mechanism, np.linspace(0, 1, 11), inputs={p.tau: value})


def test_refuses_a_foreign_input():
    """An input that the mechanism does not have; feedback of what is not known yet."""
    p = actuated_pendulum()
    other = mbd.Input("other")
    with pytest.raises(mbd.MechanismError, match="'other'"):
        mbd.simulate(p.mechanism, duration=1.0, inputs={other: 1.0})
    with pytest.raises(mbd.ExpressionError, match=r"tau.*alpha"):
        mbd.simulate(p.mechanism, duration=1.0, inputs={p.tau: p.rod.alpha})


# --- the start ------------------------------------------------------------------------------------------
def test_starts_from_a_state():
    """Two halves make a whole, and the state brings its time-independent values along."""
    tau = mbd.Input("tau", value=1.0)
    k = mbd.Parameter("k", 5.0)
    p = pendulum(
        forces=lambda rod: [
            mbd.Torque("motor", rod, tau),
            mbd.RSDA("spring", mbd.ground.at(0, 0), rod.at(0, 0), stiffness=k),
        ],
        inputs=[tau], parameters=[k],
    )  # fmt: skip
    settings = {"inputs": {tau: 2.0}, "parameters": {k: 9.0}} | TIGHT
    whole = mbd.simulate(p.mechanism, np.linspace(0, 2, 21), **settings)
    half = mbd.simulate(p.mechanism, np.linspace(0, 1, 11), **settings)
    rest = mbd.simulate(p.mechanism, np.linspace(1, 2, 11), initial=half.final, **TIGHT)
    np.testing.assert_allclose(rest.q, whole.q[10:], atol=1e-8)
    np.testing.assert_allclose(rest[tau], 2.0)
    np.testing.assert_allclose(rest[k], 9.0)


def test_refuses_an_inconsistent_state():
    """A state of other parameters breaks a joint: named, with the level and the size."""
    arm = mbd.Parameter("arm", 0.5)
    rod = mbd.Body("rod", mass=1, inertia=1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-arm, 0))
    mechanism = mbd.Mechanism(bodies=[rod], joints=[hinge], parameters=[arm])
    state = mbd.assemble(mechanism)
    with pytest.raises(mbd.SimulationError, match=r"hinge\.x.*position.*0\.1"):
        mbd.simulate(mechanism, duration=1.0, initial=state, parameters={arm: 0.6})


def test_starts_from_conditions():
    """Conditions hold at the start, with parameters in them, and take precedence over the estimate."""
    lean = mbd.Parameter("lean", 0.2)
    p = pendulum(parameters=[lean])
    motion = mbd.simulate(
        p.mechanism, duration=0.1, initial=[p.rod.phi == lean + 0.1, p.rod.omega == 2 * lean], parameters={lean: 0.4}
    )
    assert motion.initial[p.rod.phi] == pytest.approx(0.5, abs=1e-12)
    assert motion.initial[p.rod.omega] == pytest.approx(0.8, abs=1e-12)


def test_parameters():
    """A mapping changes the motion without a new model; the period goes with the root of gravity."""
    g = mbd.Parameter("g", 9.81)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    mechanism = mbd.Mechanism(bodies=[rod], joints=[pin], forces=[mbd.Gravity((0, -g))], parameters=[g])
    times = np.linspace(0, 2, 41)
    earth = mbd.simulate(mechanism, times, **TIGHT)
    strong = mbd.simulate(mechanism, times / 2, parameters={g: 4 * 9.81}, **TIGHT)
    np.testing.assert_allclose(strong[rod.phi], earth[rod.phi], atol=1e-8)
    np.testing.assert_allclose(strong.parameters, [4 * 9.81])
    other = mbd.Parameter("other", 1.0)
    with pytest.raises(mbd.MechanismError, match="'other'"):
        mbd.simulate(mechanism, times, parameters={other: 1.0})


# --- first-order states -----------------------------------------------------------------------------------
@pytest.mark.parametrize("method", METHODS)
def test_first_order_lag(method):
    """A step through a lag, and its integral, in closed form."""
    lag, area = mbd.StateVariable("lag", value=0.5), mbd.StateVariable("area")
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], states={lag: (2 - lag) / 0.3, area: lag})
    times = np.linspace(0, 2, 21)
    motion = mbd.simulate(mechanism, times, method=method, reltol=1e-10, abstol=1e-10)
    np.testing.assert_allclose(motion[lag], 2 - 1.5 * np.exp(-times / 0.3), atol=1e-8)
    np.testing.assert_allclose(motion[area], 2 * times - 0.45 * (1 - np.exp(-times / 0.3)), atol=1e-8)
    assert motion.z.shape == (21, 2)


def test_dc_motor():
    """Inductance, resistance and back-emf: current and speed by the matrix exponential."""
    resistance, inductance, constant, inertia, voltage = 0.8, 0.05, 0.3, 0.02, 12.0
    current = mbd.StateVariable("current")
    rotor = mbd.Body("rotor", mass=1.0, inertia=inertia)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), rotor.at(0, 0))
    supply = mbd.Input("voltage")
    motor = mbd.Mechanism(
        bodies=[rotor], joints=[bearing], forces=[mbd.Torque("motor", rotor, constant * current)], inputs=[supply],
        states={current: (supply - resistance * current - constant * rotor.omega) / inductance},
    )  # fmt: skip
    times = np.linspace(0, 1, 51)
    motion = mbd.simulate(motor, times, inputs={supply: voltage}, **TIGHT)
    matrix = np.array([[-resistance / inductance, -constant / inductance], [constant / inertia, 0]])
    values, vectors = np.linalg.eig(matrix)
    rest = np.array([0, voltage / constant])
    share = np.linalg.solve(vectors, -rest)
    wanted = rest + np.real((vectors * share) @ np.exp(np.outer(values, times))).T
    np.testing.assert_allclose(motion[current], wanted[:, 0], atol=1e-7)
    np.testing.assert_allclose(motion[rotor.omega], wanted[:, 1], atol=1e-7)
    start = mbd.simulate(motor, times, inputs={supply: voltage}, initial=[current == 3.0])
    assert start.initial[current] == pytest.approx(3.0, abs=1e-11)


# --- drivers, missing mass, redundant rows ---------------------------------------------------------------------
def test_driven_and_free():
    """A pendulum on a cart that is driven: one coordinate follows the driver, the other swings."""
    cart = mbd.Body("cart", mass=3.0, inertia=1.0)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0, -0.5, -np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    hinge = mbd.Revolute("hinge", cart.at(0, 0), rod.at(-0.5, 0))
    drive = mbd.Driver("drive", rail.displacement, 0.2 * mbd.sin(5 * mbd.t))
    mechanism = mbd.Mechanism(bodies=[cart, rod], joints=[rail, hinge], drivers=[drive], forces=[mbd.Gravity()])
    times = np.linspace(0, 3, 61)
    motion = mbd.simulate(mechanism, times, initial=[rod.omega == 0, rod.phi == -np.pi / 2], **TIGHT)
    push = -0.2 * 25 * np.sin(5 * times)

    def rate(t, y):
        base = -0.2 * 25 * np.sin(5 * t)
        return [y[1], 1.5 * (base * np.sin(y[0]) - G * np.cos(y[0]))]

    angle, speed = exact(rate, times, [-np.pi / 2, 0])
    np.testing.assert_allclose(motion[cart.x], 0.2 * np.sin(5 * times), atol=1e-12)
    np.testing.assert_allclose(motion[cart.ax], push, atol=1e-10)
    np.testing.assert_allclose(motion[rod.phi], angle, atol=1e-7)
    turn = np.array([rate(t, y)[1] for t, y in zip(times, np.c_[angle, speed], strict=True)])
    force = 4 * push + 0.5 * (-turn * np.sin(angle) - speed**2 * np.cos(angle))
    np.testing.assert_allclose(motion[drive.effort], force, atol=1e-5)


def test_fully_driven():
    """A mechanism without freedom is simulated like any other and agrees with kinematics."""
    f = four_bar(0.5, drivers=lambda f: [mbd.Driver("drive", f.A.angle, 0.5 + 6 * mbd.t)], forces=[mbd.Gravity()])
    times = np.linspace(0, 1, 51)
    motion, known = mbd.simulate(f.mechanism, times), mbd.inverse_dynamics(f.mechanism, times)
    np.testing.assert_allclose(motion.q, known.q, atol=1e-8)
    np.testing.assert_allclose(motion.v, known.v, atol=1e-7)
    np.testing.assert_allclose(motion.lam, known.lam, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_cart_pole_with_a_point_mass(method):
    """A pole without inertia of its own: singular mass matrix, regular motion; against Lagrange's equations."""
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0.5, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    hinge = mbd.Revolute("hinge", cart.at(0, 0), bob.at(-0.5, 0))
    mechanism = mbd.Mechanism(bodies=[cart, bob], joints=[rail, hinge], forces=[mbd.Gravity()])
    times = np.linspace(0, 2, 41)
    motion = mbd.simulate(mechanism, times, method=method, reltol=1e-10, abstol=1e-10)

    def rate(t, y):
        _, theta, v, w = y
        s, c = np.sin(theta), np.cos(theta)
        matrix = [[1.3, -0.3 * 0.5 * s], [-0.3 * 0.5 * s, 0.3 * 0.25]]
        return [v, w, *np.linalg.solve(matrix, [0.3 * 0.5 * w**2 * c, -0.3 * G * 0.5 * c])]

    x, theta, *_ = exact(rate, times, [0, 0, 0, 0])
    np.testing.assert_allclose(motion[cart.x], x, atol=1e-7)
    np.testing.assert_allclose(motion[bob.phi], theta, atol=1e-7)


def parallelogram(coupler_mass=1.0):
    """Three parallel cranks of 1 m on one coupler: one row more than is needed."""
    start = 1.0
    c, s = np.cos(start), np.sin(start)
    cranks = [mbd.Body(f"crank {k}", mass=1.0, inertia=1 / 12, pose=(k + c / 2, s / 2, start)) for k in range(3)]
    coupler = mbd.Body("coupler", mass=coupler_mass, inertia=coupler_mass * 4 / 12, pose=(1 + c, s, 0))
    joints = [mbd.Revolute(f"foot {k}", mbd.ground.at(k, 0), b.at(-0.5, 0)) for k, b in enumerate(cranks)]
    joints += [mbd.Revolute(f"head {k}", b.at(0.5, 0), coupler.at(k - 1, 0)) for k, b in enumerate(cranks)]
    mechanism = mbd.Mechanism(bodies=[*cranks, coupler], joints=joints, forces=[mbd.Gravity()])
    return SimpleNamespace(mechanism=mechanism, cranks=cranks, coupler=coupler, joints=joints)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("coupler_mass", "method"),
    [(mass, method) for mass in (1.0, 0.0) for method in TOLERANT],
)
def test_redundant_parallelogram(coupler_mass, method):
    """Against one coordinate, also where the coupler has no mass; the note says that reactions are not unique."""
    f = parallelogram(coupler_mass)
    times = np.linspace(0, 1.2, 25)
    motion = mbd.simulate(f.mechanism, times, reltol=1e-10, abstol=1e-10, method=method)
    inertia, weight = 3 * (1 / 3) + coupler_mass, (1.5 + coupler_mass) * G
    angle, rate = exact(lambda t, y: [y[1], -weight * np.cos(y[0]) / inertia], times, [1.0, 0.0])
    for crank in f.cranks:
        np.testing.assert_allclose(motion[crank.phi], angle, atol=1e-6)
        np.testing.assert_allclose(motion[crank.omega], rate, atol=1e-5)
        np.testing.assert_allclose(motion[crank.alpha], -weight * np.cos(angle) / inertia, atol=1e-4)
    assert motion.drift.position < 1e-12 and motion.drift.velocity < 1e-11
    assert any("redundant" in note for note in motion.statistics.notes)
    # the sum of the feet is unique nevertheless
    feet = sum(motion[j.reaction_on(b).force] for j, b in zip(f.joints, f.cranks, strict=False))
    bodies = [*f.cranks, f.coupler]
    inertial = sum(b.mass * motion[b.a[:2]] for b in bodies) + sum(b.mass for b in bodies) * np.array([0, G])
    np.testing.assert_allclose(feet, inertial, atol=1e-6 * np.abs(inertial).max() + 1e-6)


def oscillating(beams, joints, cart):
    """Errors of the height of a cart that bounces in a guide, and of the acceleration of what it carries."""
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), cart.at(0, 0, np.pi / 2))
    mass = cart.mass + sum(beam.mass for beam in beams)
    spring = mbd.Force("spring", cart.at(0, 0), (0, -10 * mass * cart.y))
    model = mbd.Mechanism([cart, *beams], joints=[guide, *joints], forces=[mbd.Gravity(), spring])
    times = np.linspace(0, 2, 11)
    motion, phase = mbd.simulate(model, times, method="erk"), np.cos(np.sqrt(10) * times)
    assert motion.statistics.formulation == "regularised"
    return np.abs(motion[cart.y] + 0.1 * G * (1 - phase)).max(), np.abs(motion[beams[-1].ay] + G * phase).max()


@pytest.mark.parametrize("gap", [1e-3, 1e-4])
def test_an_arm_on_pins_that_are_close_moves_with_its_cart(gap):
    """Redundant pins that hold three metres on a millimetre: the motion of one mass on a spring."""
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    arm = mbd.Body("arm", mass=1.0, inertia=0.75, pose=(1.5, 0, 0))
    pins = [mbd.Revolute(f"pin {k}", cart.at(k * gap, 0), arm.at(k * gap - 1.5, 0)) for k in range(3)]
    height, acceleration = oscillating([arm], pins, cart)
    assert height < 1e-8 and acceleration < 1e-6


@pytest.mark.slow
def test_a_long_redundant_cantilever_moves_with_its_cart():
    """Sixty links, each welded and pinned to the last."""
    cart = mbd.Body("cart", mass=5.0, inertia=1.0)
    links = [mbd.Body(f"link {k}", mass=1.0, inertia=1 / 12, pose=(k + 0.5, 0, 0)) for k in range(60)]
    joints = []
    for k, link in enumerate(links):
        last, x = (links[k - 1], 0.5) if k else (cart, 0)
        joints.append(mbd.Weld(f"weld {k}", last.at(x, 0), link.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"pin {k}", last.at(x, 0.2), link.at(-0.5, 0.2)))
    height, acceleration = oscillating(links, joints, cart)
    assert height < 1e-8 and acceleration < 1e-6


@pytest.mark.slow
def test_flat_parallelogram_keeps_its_branch():
    """At usual tolerances, over several turns; the pose is singular twice in each."""
    f = n_four_bar(1)
    motion = mbd.simulate(f.mechanism, np.linspace(0, 5, 101), initial=[f.first.phi == np.pi / 2, f.first.omega == -1])
    np.testing.assert_allclose(motion[f.cranks[1].phi], motion[f.first.phi], atol=1e-8)
    assert motion[f.first.phi][-1] < -10


@pytest.mark.slow
@pytest.mark.parametrize(
    ("end", "count"),
    [
        (10, 101),
        (40, 41),
        pytest.param(40, 401, marks=pytest.mark.slow),
    ],
)
def test_flat_chain_on_coarse_outputs(end, count):
    """Six loops, flat five times a second: the branch is kept whatever the outputs and the length of the run."""
    f = n_four_bar(6)
    start = [f.first.phi == np.pi / 2, f.first.omega == -1]
    motion = mbd.simulate(f.mechanism, np.linspace(0, end, count), initial=start)
    np.testing.assert_allclose(motion[f.cranks[-1].phi], motion[f.first.phi], atol=1e-8)
    assert motion.drift.position < 1e-10
    energy = motion.energy.total
    assert np.abs(energy - energy[0]).max() < 1e-4 * motion.energy.kinetic.max()


def test_redundant_drivers_that_part():
    """Two drivers of one angle that agree at first: the run stops where they part, and names them."""
    f = four_bar(
        0.5,
        drivers=lambda f: [mbd.Driver("one", f.A.angle, 0.5), mbd.Driver("two", f.A.angle, 0.5 + mbd.t**3)],
    )
    with pytest.raises(mbd.MechanismError, match="one.*two|two.*one") as caught:
        mbd.simulate(f.mechanism, np.linspace(0, 1, 11))
    assert caught.value.partial.drift.position < 1e-6


def test_massless_body_that_moves_freely_is_refused():
    """Mass is missing: the body and the coordinate are named."""
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    ghost = mbd.Body("ghost", mass=0.0, inertia=0.0, pose=(1, 0, 0))
    hinge = mbd.Revolute("hinge", cart.at(0, 0), ghost.at(-1, 0))
    with pytest.raises(mbd.SingularityError, match=r"'ghost'.*ghost\.phi"):
        mbd.simulate(mbd.Mechanism(bodies=[cart, ghost], joints=[hinge]), duration=1.0)


# --- forces of the user's own -------------------------------------------------------------------------------
class Drag(mbd.model.element.Element):
    """Quadratic drag on a body: an element from outside the package."""

    kind = "force"

    def __init__(self, name, body, coefficient):
        super().__init__(name)
        speed = mbd.norm(body.velocity)
        self.virtual_work = ((body.position, -coefficient * speed * body.velocity),)
        self.__dict__["bodies"] = (body,)


class PlainDrag:
    """The same without any base class: the attributes of the interface alone."""

    name, description = "drag", "force 'drag'"
    markers = coordinates = limits = row_labels = row_names = ()
    rows = velocity_rows = multipliers = ca.SX(0, 1)
    potential = ca.SX(0)

    def __init__(self, body, coefficient):
        self.rates = {}
        self.bodies = (body,)
        self.virtual_work = ((body.position, -coefficient * mbd.norm(body.velocity) * body.velocity),)

    def expressions(self):
        """What to look for stray symbols in."""
        return [ca.SX(part) for pair in self.virtual_work for part in pair]


@pytest.mark.parametrize(
    "make", [lambda b: Drag("drag", b, 0.05), lambda b: PlainDrag(b, 0.05)], ids=["derived", "plain"]
)
def test_element_of_the_users_own(make):
    """Its virtual work is all that counts: a ball with quadratic drag against SciPy."""
    body = mbd.Body("ball", mass=0.4, inertia=0.01, velocity=(8, 6, 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity(), make(body)])
    times = np.linspace(0, 2, 41)
    motion = mbd.simulate(mechanism, times, **TIGHT)

    def rate(t, y):
        speed = np.hypot(y[2], y[3])
        return [y[2], y[3], -0.05 / 0.4 * speed * y[2], -0.05 / 0.4 * speed * y[3] - G]

    np.testing.assert_allclose(motion[body.position], exact(rate, times, [0, 0, 8, 6])[:2].T, atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "auto"])
def test_friction_by_the_reaction(method):
    """A smooth friction torque that grows with the pin's own load, against one coordinate."""
    mu, radius, smooth, mass, length = 0.3, 0.02, 1e-2, 1.5, 0.8
    rod = mbd.Body("rod", mass=mass, inertia=mass * length**2 / 12, pose=(length / 2, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    load = mbd.norm(hinge.reaction_on(rod).force)
    torque = -mu * radius * load * mbd.tanh(radius * rod.omega / smooth)
    friction = mbd.GeneralizedForce("bush", [(rod.phi, torque)])
    mechanism = mbd.Mechanism(bodies=[rod], joints=[hinge], forces=[mbd.Gravity(), friction])
    times = np.linspace(0, 5, 101)
    motion = mbd.simulate(mechanism, times, reltol=1e-10, abstol=1e-10, method=method)

    def parts(angle, rate):
        moment, twist = mass * length**2 / 3, 0.0
        for _ in range(60):
            alpha = (-mass * G * length / 2 * np.cos(angle) + twist) / moment
            ax = length / 2 * (-alpha * np.sin(angle) - rate**2 * np.cos(angle))
            ay = length / 2 * (alpha * np.cos(angle) - rate**2 * np.sin(angle))
            force = mass * np.array([ax, ay + G])
            twist = -mu * radius * np.hypot(*force) * np.tanh(radius * rate / smooth)
        return alpha, force, twist

    angle, rate = exact(lambda t, y: [y[1], parts(*y)[0]], times, [0.0, 0.0], rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(motion[rod.phi], angle, atol=1e-7)
    np.testing.assert_allclose(motion[rod.omega], rate, atol=1e-6)
    wanted = [parts(a, r) for a, r in zip(angle, rate, strict=True)]
    np.testing.assert_allclose(motion[hinge.reaction_on(rod).force], [w[1] for w in wanted], atol=1e-4)
    np.testing.assert_allclose(motion[torque], [w[2] for w in wanted], atol=1e-6)


def test_friction_by_the_reaction_refuses_erk():
    """An explicit method cannot, and the message says which one can."""
    rod = mbd.Body("rod", mass=1, inertia=1, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    friction = mbd.GeneralizedForce("bush", [(rod.phi, -0.1 * mbd.norm(hinge.reaction_on(rod).force) * rod.omega)])
    mechanism = mbd.Mechanism(bodies=[rod], joints=[hinge], forces=[mbd.Gravity(), friction])
    with pytest.raises(mbd.SimulationError, match="idas"):
        mbd.simulate(mechanism, duration=1.0, method="erk")


# --- events ------------------------------------------------------------------------------------------------
def test_event_is_located():
    """A falling body meets the floor: closed form to 1e-9, on any grid; the state belongs to the instant."""
    body, mechanism = ball()
    hit = np.sqrt(2 / G)
    for times in (np.linspace(0, 1, 11), [0, 1], np.linspace(0, 1, 501)):
        motion = mbd.simulate(mechanism, times, events=[mbd.Event("floor", body.y)])
        (event,) = motion.events
        assert event.name == "floor" and abs(event.t - hit) < 1e-9
        assert abs(event.state[body.y]) < 1e-9
        assert event.state[body.vy] == pytest.approx(-G * hit, abs=1e-8)
        assert motion.t.size == len(times)
        assert "floor" in repr(motion)


def test_terminal_event_ends_the_run():
    """The last output is the event; what comes behind is left out."""
    body, mechanism = ball()
    floor = mbd.Event("floor", body.y, direction=-1, terminal=True)
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), events=[floor])
    assert abs(motion.t[-1] - np.sqrt(2 / G)) < 1e-9
    np.testing.assert_allclose(motion.t[:-1], np.linspace(0, 0.4, 5))
    assert abs(motion.final[body.y]) < 1e-9
    assert np.all(np.diff(motion.t) > 0)


@pytest.mark.parametrize(("direction", "wanted"), [(1, [0.5, 2.5]), (-1, [1.5, 3.5]), (0, [0.5, 1.5, 2.5, 3.5])])
def test_event_direction(direction, wanted):
    """Rising, falling, both: the zeros of a cosine."""
    body, mechanism = ball()
    event = mbd.Event("zero", -mbd.cos(np.pi * mbd.t) + 0 * body.x, direction=direction)
    motion = mbd.simulate(mechanism, np.linspace(0, 4, 9), events=[event])
    np.testing.assert_allclose([e.t for e in motion.events], wanted, atol=1e-9)


def test_event_at_the_start_does_not_count():
    """A zero at the start is no passage; the returns to it are."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, np.linspace(0, 2.2, 23), events=[mbd.Event("turns", p.rod.omega)], **TIGHT)
    period = 4 * ellipk(0.5) / np.sqrt(1.5 * G)
    np.testing.assert_allclose([e.t for e in motion.events], [period / 2, period], atol=1e-8)


def test_several_events():
    """Sorted by time, each by its name, the first terminal one ends."""
    body, mechanism = ball(2.0)
    events = [mbd.Event(f"at {y}", body.y - y, direction=-1, terminal=y == 0.5) for y in (0.0, 0.5, 1.0, 1.5)]
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 3), events=events)
    assert [e.name for e in motion.events] == ["at 1.5", "at 1.0", "at 0.5"]
    wanted = [np.sqrt(2 * (2 - y) / G) for y in (1.5, 1.0, 0.5)]
    np.testing.assert_allclose([e.t for e in motion.events], wanted, atol=1e-9)
    assert motion.t[-1] == motion.events[-1].t


def test_two_events_within_one_output():
    """Up and down through a height between two outputs."""
    body = mbd.Body("ball", mass=1.0, inertia=1.0, velocity=(0, 5, 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, [0, 1.0], events=[mbd.Event("height", body.y - 1.2)])
    root = np.sqrt(25 - 2 * G * 1.2)
    np.testing.assert_allclose([e.t for e in motion.events], [(5 - root) / G, (5 + root) / G], atol=1e-9)


def test_short_events_are_not_missed():
    """Two passages 3 ms apart in a run of 1 s, whatever the outputs."""
    body = mbd.Body("ball", mass=1.0, inertia=1.0, velocity=(0, 5, 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])
    top = 25 / (2 * G)
    height = top - G / 2 * 0.0015**2
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), events=[mbd.Event("height", body.y - height)])
    np.testing.assert_allclose([e.t for e in motion.events], [5 / G - 0.0015, 5 / G + 0.0015], atol=1e-6)


@pytest.mark.parametrize("method", ["idas", "rosenbrock", "dop853"])
@pytest.mark.parametrize("beyond", [1e-4, 1e-6])
def test_an_angle_that_hardly_passes_a_threshold(method, beyond):
    """At every return of a swing from rest; the angle is beyond for 2 √(2 beyond/|angular acceleration|), here 1 ms."""
    p, start = pendulum(), -np.pi / 2 + 0.5
    period = 4 * np.sqrt(2 / (3 * G)) * ellipk(np.sin(0.25) ** 2)
    early = np.sqrt(2 * beyond / (1.5 * G * np.sin(0.5)))
    top = mbd.Event("top", p.rod.phi - start + beyond, direction=1)
    motion = mbd.simulate(p.mechanism, np.linspace(0, 10, 6), initial=[p.rod.phi == start], events=[top], method=method)
    times = period * np.arange(1, int(10 / period) + 1) - early
    np.testing.assert_allclose([event.t for event in motion.events], times, atol=0.1 * early)


@pytest.mark.parametrize("method", ["erk", "rosenbrock"])
def test_events_with_other_methods(method):
    """Located by the integrator that runs."""
    body, mechanism = ball()
    floor = mbd.Event("floor", body.y, terminal=True)
    motion = mbd.simulate(mechanism, [0, 1], events=[floor], method=method)
    assert abs(motion.t[-1] - np.sqrt(2 / G)) < 1e-9


def test_event_in_a_reaction():
    """The pin's pull along the rod passes through zero where g sin(phi) = w² L/2; the energy says at which height."""
    p = pendulum()
    pull = ca.dot(p.pin.reaction_on(p.rod).force, p.rod.at(0, 0).x_axis)
    slack = mbd.Event("slack", pull, direction=1, terminal=True)
    start = [p.rod.phi == -np.pi / 2, p.rod.omega == 6.5]
    motion = mbd.simulate(p.mechanism, np.linspace(0, 1, 101), initial=start, events=[slack], **TIGHT)
    assert np.sin(motion.final[p.rod.phi]) == pytest.approx((6.5**2 - 3 * G) / (5 * G), abs=1e-9)


def test_event_with_samples_and_controller():
    """Events are found where inputs change by intervals."""
    u = mbd.Input("u")
    body = mbd.Body("body", mass=2.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (u, 0))], inputs=[u])
    far = mbd.Event("far", body.x - 0.1, terminal=True)
    times = np.linspace(0, 2, 5)
    sampled = mbd.simulate(mechanism, times, inputs={u: np.full(5, 1.0)}, events=[far])
    held = mbd.simulate(mechanism, times, inputs=mbd.SampledController(lambda t, s: {u: 1.0}, 0.3), events=[far])
    for motion in (sampled, held):
        assert motion.t[-1] == pytest.approx(np.sqrt(0.4), abs=1e-9)


def test_refuses_events():
    """What is no event, names given twice, expressions of other mechanisms."""
    body, mechanism = ball()
    other = mbd.Body("other", mass=1, inertia=1)
    with pytest.raises(mbd.MechanismError, match="Event"):
        mbd.simulate(mechanism, duration=1.0, events=[body.y])
    with pytest.raises(mbd.MechanismError, match="twice: a, a"):
        mbd.simulate(mechanism, duration=1.0, events=[mbd.Event("a", body.y), mbd.Event("a", body.x)])
    with pytest.raises(mbd.ExpressionError, match="other"):
        mbd.simulate(mechanism, duration=1.0, events=[mbd.Event("a", other.y)])
    with pytest.raises(mbd.ModelError, match="direction"):
        mbd.Event("a", body.y, direction=2)


# --- what the user sees ---------------------------------------------------------------------------------------
def test_progress_bar(capsys):
    """Counts simulated seconds, on standard error; without it nothing is printed."""
    p = pendulum()
    mbd.simulate(p.mechanism, duration=1.0)
    silent = capsys.readouterr()
    assert silent.out == "" and silent.err == ""
    mbd.simulate(p.mechanism, duration=1.0, progress=True)
    shown = capsys.readouterr()
    assert shown.out == "" and "100%" in shown.err and "1 s" in shown.err


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_keeps_what_was_computed():
    """SIGINT in a long run: Interrupted soon after, with the part that was done."""
    f = four_bar(0.5, forces=[mbd.Gravity()])
    start = [f.A.angle == 0.5, f.crank.omega == 12]
    mbd.simulate(f.mechanism, np.linspace(0, 0.1, 3), initial=start)
    times = np.linspace(0, 2000, 20001)
    caught = interrupted(
        lambda: mbd.simulate(f.mechanism, times, initial=start), enough=lambda e: len(e.partial or ()) > 1
    )
    partial = caught.partial
    assert isinstance(caught, KeyboardInterrupt) and "user" in str(caught)
    assert caught.time == partial.t[-1] < 2000
    assert partial.drift.position < 1e-12
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_ctrl_c_in_a_controller():
    """A long run of many chunks stops in the middle of them."""
    p = actuated_pendulum()
    calls = []

    def control(t, state):
        calls.append(t)
        if len(calls) == 50:
            os.kill(os.getpid(), signal.SIGINT)
        return {p.tau: 0.0}

    with pytest.raises(mbd.Interrupted) as caught:
        mbd.simulate(p.mechanism, np.linspace(0, 20, 2001), inputs=mbd.SampledController(control, 0.01))
    assert 0.4 < caught.value.partial.t[-1] < 1.0
    np.testing.assert_allclose(caught.value.partial[p.rod.phi], swing(caught.value.partial.t)[0], atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_blow_up_in_time(method):
    """A force 1/(1 - t): the run stops before t = 1, says so, and keeps what it had."""
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    push = mbd.Force("push", body.at(0, 0), (1 / (1 - mbd.t) ** 2, 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[push])
    with pytest.raises(mbd.SimulationError, match=r"stopped at t = (0\.\d+|1) s.*partial") as caught:
        mbd.simulate(mechanism, np.linspace(0, 2, 201), method=method)
    partial = caught.value.partial
    assert 0.9 <= partial.t[-1] < 1.0
    assert caught.value.time == pytest.approx(1.0, abs=0.03)
    exact_x = -partial.t - np.log(1 - partial.t)
    np.testing.assert_allclose(partial[body.x], exact_x, rtol=1e-4, atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_blow_up_in_state(method):
    """x'' = 2 x³ escapes to infinity at t = 1: the same, with the fastest coordinate named."""
    body = mbd.Body("body", mass=1.0, inertia=1.0, pose=(1, 0, 0), velocity=(1, 0, 0))
    push = mbd.Force("push", body.at(0, 0), (2 * body.x**3, 0))
    mechanism = mbd.Mechanism(bodies=[body], forces=[push])
    with pytest.raises(mbd.SimulationError, match=r"body\.x") as caught:
        mbd.simulate(mechanism, np.linspace(0, 2, 201), method=method)
    partial = caught.value.partial
    assert 0.9 <= partial.t[-1] <= 1.0
    np.testing.assert_allclose(partial[body.x][partial.t < 0.9], 1 / (1 - partial.t[partial.t < 0.9]), rtol=1e-5)


def test_force_that_is_not_finite():
    """A square root of what becomes negative: said so, with the coordinate that is acted on."""
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (mbd.sqrt(0.5 - mbd.t), 0))])
    with pytest.raises(mbd.SimulationError, match=r"'push' is not finite") as caught:
        mbd.simulate(mechanism, np.linspace(0, 1, 101))
    assert caught.value.partial.t[-1] == pytest.approx(0.5, abs=0.011)


def test_force_without_slope():
    """A root at zero has no slope, which IDAS needs and dop853 does not: a body falls from where its brake begins."""
    body = mbd.Body("body", mass=1, inertia=1)
    depth, level = mbd.fabs(body.y), mbd.StateVariable("level")
    brake = mbd.Force("brake", body.at(0, 0), (0, depth**0.5))
    falls = mbd.Mechanism([body], forces=[mbd.Gravity(), brake])
    with pytest.raises(mbd.SimulationError, match=r"force 'brake' has no finite slope there.*method='dop853'"):
        mbd.simulate(falls, duration=0.5)
    motion = mbd.simulate(falls, duration=0.5, method="dop853")
    energy = motion[body.vy] ** 2 / 2 + 9.81 * motion[body.y] + 2 / 3 * motion[depth] ** 1.5
    np.testing.assert_allclose(energy, 0, atol=1e-7)
    drains = mbd.Mechanism([body], states={level: 1 - 2 * mbd.sqrt(level)})
    with pytest.raises(mbd.SimulationError, match=r"rate of state 'level' has no finite slope"):
        mbd.simulate(drains, duration=0.5)


@pytest.mark.slow
def test_spline_left_at_its_end():
    """Data that end are an error at the time they end, not a zero force from there on; the cause is named."""
    body = mbd.Body("body", mass=1.0, inertia=1.0)
    curve = mbd.spline(mbd.t, np.linspace(0, 1, 6), [0, 1, 0, 2, 1, 3.0])
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (curve, 0))])
    assert len(mbd.simulate(mechanism, np.linspace(0, 1, 11))) == 11
    with pytest.raises(mbd.MechanismError, match=r"(?i)spline|finite") as caught:
        mbd.simulate(mechanism, np.linspace(0, 2, 21))
    assert caught.value.partial.t[-1] == pytest.approx(1.0, abs=1e-9)


@pytest.mark.slow
def test_lock_up_of_a_driver():
    """A driver that takes the linkage to its toggle: the joint rows and the driver are named."""
    f = four_bar(
        0.2, (0.4, 0.5, 0.45, 1.0), (1, 1, 1), (0.01, 0.02, 0.02),
        drivers=lambda f: [mbd.Driver("crank drive", f.A.angle, 0.2 + 0.5 * mbd.t)],
    )  # fmt: skip
    with pytest.raises(mbd.MechanismError, match="singular.*crank drive") as caught:
        mbd.simulate(f.mechanism, np.linspace(0, 5, 201))
    assert 1.9 < caught.value.partial.t[-1] < 2.0862
    assert caught.value.time == pytest.approx(2.086174, abs=0.05)


# --- arguments that make no sense -----------------------------------------------------------------------------------
@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"times": [0, 1], "duration": 1.0}, "either"),
        ({}, "times or duration"),
        ({"duration": -1.0}, "duration.*positive"),
        ({"duration": 0.0}, "duration.*positive"),
        ({"duration": float("nan")}, "duration.*finite"),
        ({"duration": "long"}, "duration.*number"),
        ({"times": [0.0]}, "at least 2"),
        ({"times": 1.0}, "times"),
        ({"times": [0, 0.5, 0.5, 1]}, r"times\[1\] = 0\.5"),
        ({"times": [0, np.nan]}, r"times\[1\]"),
        ({"times": [0, np.inf]}, r"times\[1\]"),
        ({"times": ["a", "b"]}, "times must be numbers"),
        ({"duration": 1.0, "method": "euler"}, "'euler'"),
        ({"duration": 1.0, "reltol": 0}, "reltol.*positive"),
        ({"duration": 1.0, "abstol": -1e-8}, "abstol.*positive"),
        ({"duration": 1.0, "reltol": "fine"}, "reltol.*number"),
        ({"duration": 1.0, "options": {"no_such_option": 1}}, "option"),
        ({"duration": 1.0, "parameters": 3}, "parameters="),
        ({"duration": 1.0, "inputs": 3}, "inputs="),
    ],
)
def test_refuses_arguments(arguments, words):
    """The argument and the value are named."""
    with pytest.raises(mbd.MechanismError, match=words):
        mbd.simulate(pendulum().mechanism, **arguments)


def test_refuses_what_is_no_mechanism():
    """Said so, with what was given."""
    with pytest.raises(mbd.MechanismError, match="Mechanism"):
        mbd.simulate("pendulum", duration=1.0)


def test_options_reach_the_integrator():
    """A step limit that cannot be kept stops the run."""
    with pytest.raises(mbd.SimulationError, match="steps"):
        mbd.simulate(pendulum().mechanism, [0, 100], options={"max_num_steps": 3})


@pytest.mark.parametrize("method", [mbd.IDAS, mbd.RungeKutta, mbd.Rosenbrock])
def test_options_that_are_lengths_of_steps(method):
    """The longest step is in seconds; CasADi's integrator itself runs over pieces of length 1."""
    with pytest.raises(mbd.SimulationError, match=r"option 'step0' would not be in seconds.*max_step="):
        mbd.simulate(pendulum().mechanism, [0, 100], method=method.name, options={"step0": 0.01})
    motion = mbd.simulate(pendulum().mechanism, [0, 2], method=method.name, options={"max_step_size": 2e-3})
    same = mbd.simulate(pendulum().mechanism, [0, 2], method=method(max_step=2e-3))
    assert motion.statistics.steps == same.statistics.steps > 1000
    np.testing.assert_array_equal(motion.q, same.q)


# --- the trajectory ----------------------------------------------------------------------------------------------
def test_shapes():
    """Scalars, columns, matrices and constants, each by time."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, np.linspace(0, 1, 11))
    eom = mbd.equations(p.mechanism)
    assert motion[p.rod.phi].shape == (11,)
    assert motion[p.rod.position].shape == (11, 2)
    assert motion[p.rod.position.T].shape == (11, 2)
    assert motion[ca.SX(3.0)].shape == (11,)
    assert motion[2.5].shape == (11,) and np.all(motion[2.5] == 2.5)
    assert motion[mbd.t].shape == (11,)
    np.testing.assert_array_equal(motion[mbd.t], motion.t)
    assert motion[eom.Phi_q].shape == (11, 2, 3)
    assert motion[eom.M].shape == (11, 3, 3)
    np.testing.assert_array_equal(motion[eom.M][4], np.diag([1, 1, 1 / 12]))
    phi_q = motion[eom.Phi_q]
    angle = motion[p.rod.phi]
    np.testing.assert_allclose(phi_q[:, 0, 2] ** 2 + phi_q[:, 1, 2] ** 2, 0.25, rtol=1e-14)
    np.testing.assert_allclose(np.abs(phi_q[:, 0, 2]), np.abs(0.5 * np.sin(angle)), atol=1e-14)
    assert motion.q.shape == motion.v.shape == motion.a.shape == (11, 3)
    assert motion.lam.shape == (11, 2) and motion.z.shape == (11, 0) and motion.inputs.shape == (11, 0)
    assert len(motion) == 11


def test_initial_and_final():
    """States with everything in them."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, np.linspace(0, 1, 11))
    for state, k in ((motion.initial, 0), (motion.final, -1)):
        assert state.t == motion.t[k]
        np.testing.assert_array_equal(state.q, motion.q[k])
        np.testing.assert_array_equal(state.lam, motion.lam[k])
        assert isinstance(state[p.rod.phi], float)
        np.testing.assert_array_equal(state[p.pin.reaction_on(p.rod).force], motion[p.pin.reaction_on(p.rod).force][k])


def test_outputs_satisfy_the_equations():
    """At every output M a + Phi_q^T lam = Q and Phi_q a = gamma, to rounding."""
    f = four_bar(0.5, forces=lambda f: [mbd.Gravity(), mbd.Torque("motor", f.crank, 1.5)])
    motion = mbd.simulate(f.mechanism, np.linspace(0, 1, 21))
    eom = mbd.equations(f.mechanism)
    left_over = motion[eom.M @ eom.a + eom.Phi_q.T @ eom.lam - eom.Q]
    assert np.abs(left_over).max() < 1e-11 * np.abs(motion.lam).max()
    assert np.abs(motion[eom.Phi_q @ eom.a - eom.gamma]).max() < 1e-11 * np.abs(motion.a).max()


def test_between_outputs_however_far_apart():
    """.at() is as accurate as a run with outputs there, on the constraints, with forces from the equations there."""
    p = pendulum()
    fine = np.linspace(0.013, 1.987, 77)
    wanted = swing(np.r_[0, fine])[:, 1:]
    for count in (2, 6, 21, 81):
        motion = mbd.simulate(p.mechanism, np.linspace(0, 2, count), reltol=1e-12, abstol=1e-12, method="erk")
        between = motion.at(fine)
        assert np.abs(between[p.rod.phi] - wanted[0]).max() < 1e-9
        assert between.drift.position < 1e-13 and between.drift.velocity < 1e-12
        np.testing.assert_array_equal(between.t, fine)
    force = between[p.pin.reaction_on(p.rod).force][:, 1]
    angle, rate = wanted
    alpha = -1.5 * G * np.cos(angle)
    np.testing.assert_allclose(force, G + 0.5 * (alpha * np.cos(angle) - rate**2 * np.sin(angle)), atol=1e-6)


def test_interpolation_of_inputs_and_states():
    """Feedback is evaluated at the interpolated state; samples are linear; states follow."""
    lag = mbd.StateVariable("lag")
    tau = mbd.Input("tau")
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau], states={lag: (1 - lag) / 0.5})
    times, fine = np.linspace(0, 1, 41), np.linspace(0.01, 0.99, 33)
    fed = mbd.simulate(p.mechanism, times, inputs={tau: -3 * p.rod.omega}, **TIGHT).at(fine)
    np.testing.assert_allclose(fed[tau], -3 * fed[p.rod.omega], atol=1e-12)
    np.testing.assert_allclose(fed[lag], 1 - np.exp(-fine / 0.5), atol=1e-5)
    sampled = mbd.simulate(p.mechanism, times, inputs={tau: 2 * times}, **TIGHT).at(fine)
    np.testing.assert_allclose(sampled[tau], 2 * fine, atol=1e-12)


def test_interpolation_outside_is_refused():
    """Named with the span and the time."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, np.linspace(0, 1, 11))
    with pytest.raises(mbd.MechanismError, match=r"0 … 1 s.*1\.5"):
        motion.at(1.5)
    assert len(motion.at(0.5)) == 1
    np.testing.assert_allclose(motion.at(motion.t).q, motion.q, atol=1e-13)


def test_energy_and_power():
    """Energy of gravity and springs is conserved; a torque changes it by its work."""
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, 0.7 * mbd.cos(mbd.t))])
    motion = mbd.simulate(p.mechanism, np.linspace(0, 2, 401), **TIGHT)
    power = motion[0.7 * mbd.cos(mbd.t) * p.rod.omega]
    work = cumulative_simpson(power, x=motion.t, initial=0)
    np.testing.assert_allclose(motion.energy.total - motion.energy.total[0], work, atol=1e-8)
    np.testing.assert_allclose(motion.energy.kinetic, motion[p.rod.omega] ** 2 / 6, atol=1e-12)
    np.testing.assert_allclose(motion.energy.potential, G * motion[p.rod.y], atol=1e-12)


def test_foreign_expressions_are_refused():
    """A symbol of another mechanism: the symbol and the body are named."""
    p = pendulum()
    motion = mbd.simulate(p.mechanism, duration=0.1)
    other = mbd.Body("other", mass=1, inertia=1)
    with pytest.raises(mbd.ExpressionError, match=r"other\.x"):
        motion[other.x]
    with pytest.raises(mbd.ExpressionError, match="loose"):
        motion.final[ca.SX.sym("loose")]


def test_prints():
    """One line of what it is, one of how it was made."""
    p = pendulum(name="clock")
    text = repr(mbd.simulate(p.mechanism, np.linspace(0, 1, 11)))
    assert "clock" in text and "11 times" in text and "idas" in text and "drift" in text


@pytest.mark.slow
@pytest.mark.parametrize("unit", [1.0, 1e-3, 1e-5, 1e4])
def test_drift_does_not_depend_on_the_unit_of_length(unit):
    """A slider-crank of a micrometre or a kilometre: rows in m and in rad are brought back alike; same motion."""
    motions = []
    for k in (1.0, unit):
        f = slider_crank_of_length(k)
        motions.append((mbd.simulate(f[0], duration=0.5, initial=[f[1].angle == 0.3, f[2].omega == 20]), f))
    (plain, one), (scaled, other) = motions
    assert scaled.drift.velocity < 1e-12 * unit * 20
    assert scaled.drift.position < max(1e-13, 1e-12 * unit)
    np.testing.assert_allclose(scaled[other[2].phi], plain[one[2].phi], atol=1e-6)


def slider_crank_of_length(k):
    """Mechanism, main bearing and crank; lengths times k, masses as they are."""
    crank = mbd.Body("crank", mass=0.12, inertia=1.0e-4 * k**2, pose=(0.05 * k, 0.0, 0.0))
    rod = mbd.Body("rod", mass=0.50, inertia=4.0e-3 * k**2, pose=(0.25 * k, 0.0, 0.0))
    slider = mbd.Body("slider", mass=2.00, inertia=1.0e-3 * k**2, pose=(0.40 * k, 0.0, 0.0))
    bearing = mbd.Revolute("main bearing", mbd.ground.at(0, 0), crank.at(-0.05 * k, 0))
    joints = [
        bearing,
        mbd.Revolute("crank pin", crank.at(0.05 * k, 0), rod.at(-0.15 * k, 0)),
        mbd.Revolute("wrist pin", rod.at(0.15 * k, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0)),
    ]
    return (
        mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=[mbd.Gravity((0, -9.81 * k))]),
        bearing,
        crank,
    )


def knee_on_splines():
    """A shank whose knee moves by its angle, on splines that end at 0.4 rad."""
    angles = np.linspace(-2.2, 0.4, 9)
    shank = mbd.Body("shank", 3.0, 0.05, pose=(0, -0.6, 0))
    knee = shank.at(0, 0.2)
    x, y = (mbd.spline(shank.phi, angles, z) for z in (0.005 * angles, -0.4 + 0.01 * np.cos(1.5 * angles)))
    joints = [mbd.Constraint("cx", knee.x - x), mbd.Constraint("cy", knee.y - y)]
    return (
        mbd.Mechanism([shank], joints=joints, forces=[mbd.Gravity()]),
        [shank.phi == -1.2, shank.omega == 0],
        "cx, cy",
    )


def driven_by_a_spline():
    """A driver whose spline ends at 0.6 s."""
    body = mbd.Body("b", 1, 0.1)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), body.at(-0.5, 0))
    turn = mbd.Driver("turn", pin.angle, mbd.spline(mbd.t, [0, 0.2, 0.4, 0.6], [0, 0.1, 0.3, 0.4]))
    return mbd.Mechanism([body], joints=[pin], drivers=[turn], forces=[mbd.Gravity()]), [], "turn"


def geared_by_a_spline():
    """A ratio of speeds by a spline of the angle."""
    bodies = [mbd.Body(name, 1, 0.1) for name in "bc"]
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bodies[0].at(-0.5, 0))
    elbow = mbd.Revolute("elbow", bodies[0].at(0.5, 0), bodies[1].at(-0.5, 0))
    ratio = mbd.spline(bodies[0].phi, [-1, -0.5, 0, 0.5], [0, 0.1, 0.3, 0.4])
    ratio_of_speeds = mbd.NonholonomicConstraint("variator", bodies[1].omega - ratio * bodies[0].omega)
    return mbd.Mechanism(bodies, joints=[pin, elbow, ratio_of_speeds], forces=[mbd.Gravity()]), [], "variator"


@pytest.mark.parametrize("method", ["idas", "rosenbrock", "erk", "dop853"])
@pytest.mark.parametrize("model", [knee_on_splines, driven_by_a_spline, geared_by_a_spline])
def test_a_spline_that_ends_inside_a_constraint_is_named(model, method):
    mechanism, start, names = model()
    with pytest.raises(mbd.SimulationError, match=f"{names} is not finite there: a spline outside its data"):
        mbd.simulate(mechanism, np.linspace(0, 1, 101), **({"initial": start} if start else {}), method=method)
