"""Events at whose zeros forces jump, as where sliding ends: against closed forms."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd
from mbdcasadi.simulation.stepping import whole_stepper

METHODS = ["idas", "erk", "rosenbrock"]
GRID = np.linspace(0, 2, 41)
FRICTION = 3.7


def turning(*names: str) -> tuple[list[mbd.Body], list[mbd.Revolute]]:
    """Bodies of unit inertia that turn about the origin."""
    bodies = [mbd.Body(name, 1.0, 1.0) for name in names]
    return bodies, [mbd.Revolute(f"pin {b.name}", mbd.ground.at(0, 0), b.at(0, 0)) for b in bodies]


def braked(body: mbd.Body, friction: float = FRICTION) -> mbd.Torque:
    return mbd.Torque(f"brake {body.name}", body, -friction * mbd.sign(body.omega))


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
def test_slipping_clutch_locks_where_its_torque_changes_sign(method):
    driving, driven = mbd.Body("A", 1, 0.2), mbd.Body("B", 1, 0.5)
    pins = [mbd.Revolute(n, mbd.ground.at(0, 0), b.at(0, 0)) for n, b in (("a", driving), ("b", driven))]
    angle, slip = mbd.Parameter("angle", 0.0), driving.omega - driven.omega
    drag = mbd.Torque("drag", driven, -0.1 * driven.omega)
    clutch = mbd.Torque("clutch", driven, 4 * mbd.sign(slip), opposite=driving)
    lock = mbd.RelativeAngle("lock", driving.at(0, 0), driven.at(0, 0), angle)
    slips = mbd.Mechanism([driving, driven], pins, forces=[clutch, drag], parameters=[angle])
    locked = mbd.Mechanism([driving, driven], [*pins, lock], forces=[drag], parameters=[angle])
    locks = mbd.Event("locks", slip, direction=-1, becomes=locked, reset={angle: driven.phi - driving.phi})
    run = mbd.simulate(
        slips, times=GRID, events=[locks], initial=[driving.omega == 20, driven.omega == 0], method=method
    )
    low, high = 0.5, 1.0
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if 20 - 20 * middle > 40 * (1 - np.exp(-0.2 * middle)) else (low, middle)
    assert [event.t for event in run.events] == pytest.approx([low], abs=1e-8)
    assert run[driven.omega][-1] == pytest.approx((20 - 20 * low) * np.exp(-(2 - low) / 7), abs=1e-7)


@pytest.mark.slow
@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("speed", "factor", "direction"), [(2.0, 1.0, -1), (1.85, -3.0, 1), (2.0, 1.0, 0)])
def test_friction_stops_a_body_where_the_run_ends(method, speed, factor, direction):
    # 1.85 / 3.7 s is the time of an output
    (body,), pins = turning("body")
    stop = mbd.Event("stop", factor * body.omega, direction=direction, terminal=True)
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body)])
    run = mbd.simulate(mechanism, times=GRID, events=[stop], initial=[body.omega == speed], method=method)
    assert run.events[0].t == pytest.approx(speed / FRICTION, abs=1e-8)
    assert run.t[-1] == pytest.approx(speed / FRICTION, abs=1e-8) and np.all(np.diff(run.t) > 0)
    assert run[body.omega][-1] == pytest.approx(0, abs=1e-8)
    assert run[body.phi][-1] - run[body.phi][0] == pytest.approx(speed**2 / (2 * FRICTION), abs=1e-8)


@pytest.mark.slow
def test_several_such_events_in_turn():
    (body,), pins = turning("body")
    kick = mbd.Event("kick", body.omega, direction=-1, reset={body.omega: 1.5})
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body)])
    run = mbd.simulate(mechanism, times=GRID, events=[kick], initial=[body.omega == 2], method="erk")
    assert [event.t for event in run.events] == pytest.approx((2 + 1.5 * np.arange(4)) / FRICTION, abs=1e-8)
    assert run[body.omega][-1] == pytest.approx(2 + 4 * 1.5 - 2 * FRICTION, abs=1e-8)


@pytest.mark.parametrize("method", ["idas", "erk"])
def test_with_play_before_a_spring(method):
    (body,), pins = turning("body")
    gap, stiffness = 0.2, 50.0
    spring = mbd.Torque("spring", body, mbd.if_else(body.phi > gap, -stiffness * (body.phi - gap), 0))
    stop = mbd.Event("stop", body.omega, direction=-1, terminal=True)
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body), spring])
    run = mbd.simulate(mechanism, times=GRID, events=[stop], initial=[body.omega == 2, body.phi == 0], method=method)
    there, rate = np.sqrt(4 - 2 * FRICTION * gap), np.sqrt(stiffness)
    time = (2 - there) / FRICTION + np.arctan(there * rate / FRICTION) / rate
    assert run.events[0].t == pytest.approx(time, abs=1e-7)


def test_friction_that_an_input_gives():
    (body,), pins = turning("body")
    torque, stop = mbd.Input("torque"), mbd.Event("stop", body.omega, direction=-1, terminal=True)
    mechanism = mbd.Mechanism([body], pins, forces=[mbd.Torque("brake", body, torque)], inputs=[torque])
    feedback = {torque: -FRICTION * mbd.sign(body.omega)}
    run = mbd.simulate(mechanism, times=GRID, events=[stop], initial=[body.omega == 2], inputs=feedback, method="erk")
    assert run.events[0].t == pytest.approx(2 / FRICTION, abs=1e-8)


@pytest.mark.parametrize("ahead", [1e-3, 1e-5])
def test_another_force_that_jumps_on_the_way_is_met(ahead):
    (body,), pins = turning("body")
    begins = 2 / FRICTION - ahead
    angle, speed = 2 * begins - FRICTION * begins**2 / 2, 2 - FRICTION * begins
    stop = mbd.Event("stop", body.omega, direction=-1, terminal=True)
    more = mbd.Torque("more", body, mbd.if_else(body.phi > angle, -5.0, 0.0))
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body), more])
    run = mbd.simulate(mechanism, times=GRID, events=[stop], initial=[body.omega == 2, body.phi == 0], method="erk")
    assert run.events[0].t == pytest.approx(begins + speed / (FRICTION + 5), abs=1e-8)


@pytest.mark.slow
def test_friction_at_rest_elsewhere_is_reported_before_the_event_and_not_after():
    (one, other), pins = turning("one", "other")
    stop = mbd.Event("stop", one.omega, direction=-1, terminal=True)
    mechanism = mbd.Mechanism([one, other], pins, forces=[braked(one, 4), braked(other, 4)])

    def run(speed: float) -> mbd.Trajectory:
        start = [one.omega == 2, other.omega == speed]
        return mbd.simulate(mechanism, times=GRID, events=[stop], initial=start, method="erk")

    after = run(2.01)
    assert after.events[0].t == pytest.approx(0.5, abs=1e-8)
    assert after[other.omega][-1] == pytest.approx(0.01, abs=1e-8)
    with pytest.raises(mbd.SimulationError, match=r"stopped at t = 0\.4975"):
        run(1.99)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
@pytest.mark.parametrize("direction", [-1, 0])
def test_event_that_leaves_the_force_as_it_is_does_not_hide_that_it_turns(method, direction):
    (body,), pins = turning("body")
    count = mbd.StateVariable("count", 0.0)
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body)], states={count: 0 * count})
    counts = mbd.Event("counts", body.omega, direction=direction, reset={count: count + 1})
    with pytest.raises(mbd.SimulationError, match=r"stopped at t = 0\.54054.*a force may jump there"):
        mbd.simulate(mechanism, times=GRID, events=[counts], initial=[body.omega == 2], method=method)


def test_whole_run_that_hardly_proceeds_where_a_force_turns_ends_in_a_message(monkeypatch):
    """No event is at the jump: the steps of DOP853 alternate about it, some billions of them to the end."""
    monkeypatch.setattr(whole_stepper, "MAX_STEPS", 4000)
    (body,), pins = turning("body")
    below = mbd.Event("below zero", body.omega + 1e-3, direction=-1, terminal=True)
    mechanism = mbd.Mechanism([body], pins, forces=[braked(body)])
    for events in [below], []:
        with pytest.raises(
            mbd.SimulationError, match=r"stopped at t = 0\.5405\d* s: .*as many steps.*a force may jump"
        ):
            mbd.simulate(mechanism, times=GRID, events=events, initial=[body.omega == 2], method="dop853")


@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
@pytest.mark.parametrize("speed", [1.85, 1.3])
@pytest.mark.parametrize("ends", [True, False])
def test_state_at_the_event_is_the_one_before_the_force_jumps(method, speed, ends):
    """On which side of the jump it lies is a matter of rounding; accelerations and reactions are those before."""
    arm = mbd.Body("arm", 2.0, 0.5, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    braking = mbd.Mechanism([arm], [pin], forces=[braked(arm)])
    change = {"terminal": True} if ends else {"becomes": braking.replace(forces=[])}
    stop = mbd.Event("stop", arm.omega, direction=-1, **change)
    start = [arm.phi == 0, arm.omega == speed]
    run = mbd.simulate(braking, times=GRID, events=[stop], initial=start, method=method)
    (event,) = run.events
    before = np.flatnonzero(run.t == event.t)[0]
    # unit inertia about the pin, whose force is that which accelerates the mass across the arm
    force = mbd.dot(pin.reaction_on(arm).force, arm.at(0, 0).y_axis)
    for found in event.state[arm.alpha], run[arm.alpha][before]:
        assert found == pytest.approx(-FRICTION, rel=1e-6)
    for found in event.state[force], run[force][before]:
        assert found == pytest.approx(-FRICTION, rel=1e-6)
    assert run.at([event.t - 1e-4])[arm.omega] == pytest.approx(FRICTION * 1e-4, rel=1e-3)


def test_events_that_only_record_have_the_state_before_the_force_jumps():
    """A mass on a spring with weak dry friction turns: the spring overcomes it."""
    mass = mbd.Body("mass", 1.0, 1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), mass.at(0, 0))
    load = mbd.Force("load", mass.at(0, 0), (-100 * mass.x - 5 * mbd.sign(mass.vx), 0))
    turns = mbd.Event("turns", mass.vx)
    start = [mass.x == 1, mass.vx == 0]
    run = mbd.simulate(
        mbd.Mechanism([mass], [guide], forces=[load]), np.linspace(0, 1, 21), initial=start, events=[turns]
    )
    places = [1 - 0.1 * (k + 1) for k in range(3)]
    signs = [-1, 1, -1]
    assert len(run.events) == 3
    for event, place, sign in zip(run.events, places, signs, strict=True):
        assert event.state[mass.ax] == pytest.approx(-100 * sign * place - 5 * sign, rel=1e-6)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_state_at_the_event_where_a_force_changes_by_steps(method):
    (body,), pins = turning("body")
    steps = mbd.Torque("steps", body, 1 - 3 * mbd.floor(body.phi))
    step = mbd.Event("step", body.phi - 1, direction=1, terminal=True)
    start = [body.omega == 1, body.phi == 0]
    run = mbd.simulate(mbd.Mechanism([body], pins, forces=[steps]), GRID, initial=start, events=[step], method=method)
    assert run.events[0].t == pytest.approx(np.sqrt(3) - 1, abs=1e-8)
    assert run.events[0].state[body.alpha] == pytest.approx(1) and run[body.alpha][-1] == pytest.approx(1)


@cache
def arm_on_a_rope(end):
    """Angle of an arm of length 1 m that falls into a damped rope; its pin rubs by its load.

    ``I α = M - μ r |R(α)| tanh(r ω / v_t)`` about the pin, solved for α by iteration, which converges by 0.02.
    """

    def rates(_, y):
        phi, omega = y
        x, y, tangent = np.cos(phi), np.sin(phi), (-np.sin(phi), np.cos(phi))
        length = np.hypot(x, y - 0.8)
        rate = omega * (x * tangent[0] + (y - 0.8) * tangent[1]) / length
        tension = max(0.0, 2e4 * (length - 1.5) + 500.0 * rate) if length > 1.5 else 0.0
        pull = -tension * x / length, -tension * (y - 0.8) / length
        moment = pull[0] * tangent[0] + pull[1] * tangent[1] - 9.81 * 0.5 * x
        alpha, rub = moment / 0.35, 0.3 * 0.05 * np.tanh(0.05 * omega / 1e-3)
        for _ in range(10):
            across = 0.5 * alpha * tangent[0] - 0.5 * omega**2 * x - pull[0]
            along = 0.5 * alpha * tangent[1] - 0.5 * omega**2 * y - pull[1] + 9.81
            alpha = (moment - rub * np.hypot(across, along)) / 0.35
        return omega, alpha

    return solve_ivp(rates, (0, end), (0, 0), rtol=1e-9, atol=1e-11, max_step=2e-3).y[0, -1]


@pytest.mark.parametrize("law", [mbd.DryFriction(0.3), mbd.Coulomb(0.3, 1e-3)], ids=["dry", "smoothed"])
@pytest.mark.parametrize("method", ["idas", "rosenbrock"])
def test_friction_by_the_load_of_a_pin_takes_the_jolt_of_a_damped_rope(method, law):
    arm = mbd.Body("arm", 1.0, 0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    rope = mbd.Rope("rope", mbd.ground.at(0, 0.8), arm.at(0.5, 0), 1.5, 2e4, 500.0)
    forces = [mbd.Gravity(), rope, mbd.JointFriction("rub", pin, law, radius=0.05)]
    motion = mbd.simulate(mbd.Mechanism([arm], joints=[pin], forces=forces), np.linspace(0, 0.3, 31), method=method)
    assert motion.final[arm.phi] == pytest.approx(arm_on_a_rope(0.3), abs=1e-4 if law.exact else 1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_forces_that_turn_a_motion_back_on_either_side_end_it(method):
    """A relay whose motion slides along its switching line from where the speed there is below 0.45 m/s.

    It switches first at the speed v, v²/2 = 1 - 0.45 v, and again after 2 (v - 0.45), at 0.134 m/s.
    """
    mass = mbd.Body("mass", 1.0, 1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), mass.at(0, 0))
    relay = mbd.Force("relay", mass.at(0, 0), (-mbd.sign(mass.x + 0.45 * mass.vx), 0))
    start = [mass.x == 1, mass.vx == 0]
    with pytest.raises(mbd.SimulationError) as caught:
        mbd.simulate(
            mbd.Mechanism([mass], [guide], forces=[relay]), np.linspace(0, 4, 41), initial=start, method=method
        )
    first = np.sqrt(0.45**2 + 2) - 0.45
    assert caught.value.time == pytest.approx(3 * first - 0.9, abs=0.01)
