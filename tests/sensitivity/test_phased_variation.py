"""Sensitivities through changes of the mechanism, against closed forms and differences of simulations."""

import warnings

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def bounce(e=0.7, **more):
    ball = mbd.Body("ball", mass=0.4, inertia=1e-3, pose=(0, 1.0, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    g = mbd.Parameter("g", G)
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity((0, -g))], parameters=[g])
    event = mbd.Event("bounce", ball.y, direction=-1, becomes=free, during=free, restitution={floor: e}, **more)
    return ball, g, free, event


def test_a_bounce():
    """Time and speed of the impact and the flight after it, by the height of the fall and by gravity."""
    ball, g, free, event = bounce()
    height = ball.y == 1
    start = [height, ball.vy == 0, ball.x == 0, ball.phi == 0]
    found = mbd.sensitivities(free, np.linspace(0, 1, 11), [ball.y, ball.vy], [height, g], start, events=[event])
    (hit,) = found.events
    fall = np.sqrt(2 / G)
    assert hit.t == pytest.approx(fall, abs=1e-9) and list(found.t[5:7]) == [hit.t, hit.t]
    assert hit.time(height) == pytest.approx(1 / np.sqrt(2 * G), abs=1e-9)
    assert hit.time(g) == pytest.approx(-fall / 2 / G, abs=1e-9)
    assert hit[ball.y, height] == pytest.approx(0, abs=1e-9)  # along with the instant: it is on the floor
    assert hit[ball.vy, height] == pytest.approx(-G / np.sqrt(2 * G), abs=1e-8)
    assert hit.after[ball.vy, height] == pytest.approx(0.7 * G / np.sqrt(2 * G), abs=1e-8)

    def y(t, h, g):
        t1 = np.sqrt(2 * h / g)
        return 0.7 * np.sqrt(2 * g * h) * (t - t1) - g / 2 * (t - t1) ** 2

    flight, step = np.arange(found.t.size) >= 6, 1e-5
    t = found.t[flight]
    by_height = (y(t, 1 + step, G) - y(t, 1 - step, G)) / 2 / step
    by_gravity = (y(t, 1, G + step) - y(t, 1, G - step)) / 2 / step
    np.testing.assert_allclose(found[ball.y, height][flight], by_height, atol=1e-8)
    np.testing.assert_allclose(found[ball.y, g][flight], by_gravity, atol=1e-8)
    np.testing.assert_allclose(found[ball.y], [*(1 - G / 2 * found.t[:6] ** 2), *y(t, 1, G)], atol=1e-7)


def landing_chain():
    """Two links that fall and are pinned where the tip lands; a motor with a state drives them, a spring holds them.

    The later mechanism has a parameter and an input of its own, a reset of a state, and a point of support that is
    taken from where the tip is.
    """
    a = mbd.Body("a", mass=1.3, inertia=0.2, pose=(0, 1, 0.3))
    b = mbd.Body("b", mass=0.7, inertia=0.05, pose=(1, 1, 0.1))
    hip = mbd.Revolute("hip", a.at(0.5, 0), b.at(-0.4, 0))
    tip = a.at(-0.5, 0)
    place, stiff, drag = mbd.Parameter("place", 0.0), mbd.Parameter("k", 3.0), mbd.Parameter("c", 0.4)
    heat, push = mbd.StateVariable("heat"), mbd.Input("push")
    bend = mbd.Torque("bend", b, -stiff * hip.angle, opposite=a)
    slow = mbd.Torque("slow", a, -drag * a.omega + push)
    air = mbd.Mechanism(
        bodies=[a, b], joints=[hip], forces=[mbd.Gravity(), bend], parameters=[stiff], states={heat: a.omega**2}
    )
    pin = mbd.Revolute("pin", mbd.ground.at(place, 0), tip)
    on = mbd.Mechanism(
        bodies=[a, b],
        joints=[hip, pin],
        forces=[mbd.Gravity(), bend, slow],
        parameters=[stiff, place, drag],
        inputs=[push],
        states={heat: b.omega**2},
    )
    lands = mbd.Event(
        "lands", tip.y, direction=-1, during=air, becomes=on, reset={place: tip.x, heat: 2 * heat + tip.vy}
    )
    start = [a.x == 0, a.y == 1, a.phi == 0.3, b.phi == 0.1, a.vx == 1, a.vy == 0.3, a.omega == 2, b.omega == -1]
    return a, b, pin, stiff, drag, heat, push, place, air, [lands], start


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_joint_that_closes_where_a_tip_lands(method):
    """Positions, reactions, a state and a parameter that is reset, by parameters of either mechanism and the start."""
    a, b, pin, stiff, drag, heat, push, place, air, events, start = landing_chain()
    outputs = [b.y, b.vy, heat, place, pin.reaction_on(a).force, b.alpha]
    wrt = [stiff, drag, push, start[6]]
    times = np.linspace(0, 1.2, 7)
    tight = dict(reltol=1e-11, abstol=1e-11)
    inputs = {push: 0.3}
    found = mbd.sensitivities(air, times, outputs, wrt, start, inputs=inputs, events=events, method=method, **tight)

    def run(d):
        values = [*start[:6], a.omega == 2 + d[3], *start[7:]]
        return mbd.simulate(
            air, times, initial=values, parameters={stiff: 3.0 + d[0], drag: 0.4 + d[1]}, inputs={push: 0.3 + d[2]},
            events=events, **tight,
        )  # fmt: skip

    base = run(np.zeros(4))
    np.testing.assert_allclose(found.t, base.t, atol=1e-10)
    away = np.abs(base.t - base.events[0].t) > 1e-6  # the instant itself moves
    assert found.events[0].name == "lands" and 1 < np.sum(base.t < base.events[0].t)
    for k, key in enumerate(wrt):
        step = 1e-5 * np.eye(4)[k]
        up, down = run(step), run(-step)
        late = (up.events[0].t - down.events[0].t) / 2e-5
        assert found.events[0].time(key) == pytest.approx(late, abs=1e-6)
        for output in outputs:
            slope = (up[output] - down[output]) / 2e-5
            np.testing.assert_allclose(found[output, key][away], slope[away], atol=2e-4, rtol=1e-5)
        after = (up.events[0].after[b.vy] - down.events[0].after[b.vy]) / 2e-5
        assert found.events[0].after[b.vy, key] == pytest.approx(after, abs=1e-5)


@pytest.mark.slow
def test_a_reaction_ends_a_phase_and_bodies_leave():
    """A ball on a turning arm is let go at a given pull of its weld; how far it flies, by the pull and the motor."""
    limit, speed = mbd.Parameter("limit", 1.0), mbd.Parameter("speed", 0.0)
    arm = mbd.Body("arm", mass=1.0, inertia=0.3, pose=(0.5, 0, 0))
    ball = mbd.Body("ball", mass=0.2, inertia=0.01, pose=(1.0, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    hand = mbd.Weld("hand", arm.at(0.5, 0), ball.at(0, 0))
    motor = mbd.Torque("motor", arm, 12 + speed)
    held = mbd.Mechanism(
        bodies=[arm, ball], joints=[hinge, hand], forces=[mbd.Gravity(), motor], parameters=[limit, speed]
    )
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    pull = hand.reaction_on(arm).force
    events = [
        mbd.Event("lets go", pull[0] ** 2 + pull[1] ** 2 - (5 * limit) ** 2, direction=1, becomes=free, during=held),
        mbd.Event("lands", ball.y + 1, direction=-1, during=free, terminal=True),
    ]
    start = [hinge.angle == 0, arm.omega == 0]
    tight = dict(reltol=1e-11, abstol=1e-11)
    times = np.linspace(0, 5, 11)
    found = mbd.sensitivities(held, times, [ball.x, arm.phi], [limit, speed], start, events=events, **tight)
    release, landing = found.events
    assert (release.name, landing.name, landing.after) == ("lets go", "lands", None)
    assert np.isnan(landing[arm.phi]) and np.isnan(found[arm.phi, limit][-1])

    def range_at(**d):
        values = {limit: 1.0 + d.get("limit", 0.0), speed: d.get("speed", 0.0)}
        run = mbd.simulate(held, times, initial=start, parameters=values, events=events, **tight)
        return np.array([run.final[ball.x], run.t[-1]])

    for name, key in (("limit", limit), ("speed", speed)):
        slope = (range_at(**{name: 1e-5}) - range_at(**{name: -1e-5})) / 2e-5
        assert landing[ball.x, key] == pytest.approx(slope[0], abs=1e-4)
        assert landing.time(key) == pytest.approx(slope[1], abs=1e-4)


@pytest.mark.slow
def test_what_has_no_derivative_is_refused():
    ball, g, free, event = bounce()
    kick = mbd.Event("kick", ball.y - 0.5, direction=-1, reset={ball.vy: ball.vy - 1})
    with pytest.raises(mbd.ModelError, match="'kick' resets velocities"):
        mbd.sensitivities(free, [0, 0.4, 1], [ball.y], [g], events=[event, kick])
    other = mbd.Parameter("other", 1.0)
    with pytest.raises(mbd.ModelError, match="other"):
        mbd.sensitivities(free, [0, 1], [ball.y], [other], events=[event])
    pinned = free.replace(joints=[mbd.Revolute("pin", mbd.ground.at(0, 0), ball.at(0, 0))])
    slides = [ball.x == 0, ball.y == 1, ball.phi == 0, ball.vx == 0]
    lands = mbd.Event("lands", ball.y, direction=-1, becomes=pinned)
    by_x = slides[0]
    with pytest.raises(mbd.SimulationError, match=r"for other values event 'lands'.*'pin\.x' closed"):
        mbd.sensitivities(free, [0, 1], [ball.y], [by_x], slides, events=[lands])
    top = mbd.Event("top", mbd.t - 0.2 + 0 * ball.x, direction=1, becomes=free, during=free)
    two = mbd.Event("two", 2 * mbd.t - 0.4 + 0 * ball.x, direction=1, becomes=free, during=free)
    with pytest.raises(mbd.ModelError, match="'top', 'two' take place together"):
        mbd.sensitivities(free, [0, 0.1, 0.4], [ball.y], [g], events=[top, two])


def test_inputs_are_numbers_and_expressions():
    body, u = mbd.Body("body", mass=2.0, inertia=1.0), mbd.Input("u")
    one = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (u, 0))], inputs=[u])
    other = one.replace(forces=[mbd.Force("push", body.at(0, 0), (3 * u, 0))])
    change = mbd.Event("change", mbd.t - 0.3 + 0 * body.x, direction=1, during=one, becomes=other)
    found = mbd.sensitivities(one, [0, 0.5, 1], [body.vx], [u], inputs={u: 4.0}, events=[change])
    np.testing.assert_allclose(found[body.vx, u], [0, 0.15, 0.15, 0.45, 1.2], atol=1e-9)
    start = body.vx == 1
    swing = {u: mbd.sin(mbd.t)}
    found = mbd.sensitivities(one, [0, 0.5, 1], [body.x], [start], [start], inputs=swing, events=[change])
    np.testing.assert_allclose(found[body.x, start], [0, 0.3, 0.3, 0.5, 1], atol=1e-9)
    controller = mbd.SampledController(lambda time, state: {u: 1.0}, 0.1)
    for inputs in ({u: [0.0, 1.0, 2.0]}, controller):
        with pytest.raises(mbd.ModelError, match="inputs= takes numbers and expressions"):
            mbd.sensitivities(one, [0, 0.5, 1], [body.x], [u], inputs=inputs, events=[change])


def test_without_a_change_it_is_the_same():
    ball, g, free, event = bounce()
    plain = mbd.sensitivities(free, [0, 0.1, 0.2], [ball.y], [g])
    found = mbd.sensitivities(free, [0, 0.1, 0.2], [ball.y], [g], events=[event])
    np.testing.assert_allclose(found[ball.y, g], plain[ball.y, g], atol=1e-10)
    assert not found.events


def turning_about_origin() -> tuple[mbd.Body, mbd.Revolute]:
    body = mbd.Body("body", 1.0, 1.0)
    return body, mbd.Revolute("pin", mbd.ground.at(0, 0), body.at(0, 0))


@pytest.mark.parametrize("method", ["idas", "erk"])
@pytest.mark.parametrize("size", [1.37, 2.11, 3.3, 5.9, 0.73])
def test_change_where_a_force_jumps(method, size):
    """On which side of the jump the state at the event lies is a matter of rounding."""
    body, pin = turning_about_origin()
    torque = mbd.Parameter("torque", size)
    push = mbd.Torque("push", body, mbd.if_else(body.phi < 0.5, torque, -1.0))
    pushed = mbd.Mechanism([body], [pin], forces=[push], parameters=[torque])
    leaves = mbd.Event("leaves", body.phi - 0.5, direction=1, becomes=pushed.replace(forces=[]))
    start = [body.phi == 0, body.omega == 0]
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        found = mbd.sensitivities(
            pushed, [0, 0.1, 3], [body.omega, body.alpha], [torque], start, events=[leaves], method=method
        )
    (event,) = found.events
    assert event.time(torque) == pytest.approx(-0.5 * size**-1.5, rel=1e-6)
    assert found[body.omega, torque][-1] == pytest.approx(0.5 / np.sqrt(size), rel=1e-6)
    assert event[body.alpha] == pytest.approx(size) and event[body.alpha, torque] == pytest.approx(1)
    before, after = np.flatnonzero(found.t == event.t)
    assert found[body.alpha][before] == pytest.approx(size) and found[body.alpha, torque][before] == pytest.approx(1)
    assert found[body.alpha][after] == pytest.approx(0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_end_where_friction_stops_a_body(method):
    body, pin = turning_about_origin()
    friction, speed = mbd.Parameter("friction", 3.7), 1.85
    brake = mbd.Torque("brake", body, -friction * mbd.sign(body.omega))
    stop = mbd.Event("stop", body.omega, direction=-1, terminal=True)
    mechanism = mbd.Mechanism([body], [pin], forces=[brake], parameters=[friction])
    start = [body.omega == speed, body.phi == 0]
    outputs = [body.phi, body.alpha]
    found = mbd.sensitivities(
        mechanism, np.linspace(0, 2, 41), outputs, [friction], start, events=[stop], method=method
    )
    (event,) = found.events
    assert event.time(friction) == pytest.approx(-speed / 3.7**2, rel=1e-6)
    assert event[body.phi, friction] == pytest.approx(-(speed**2) / 2 / 3.7**2, rel=1e-6)
    assert event[body.alpha] == pytest.approx(-3.7) and found[body.alpha, friction][-1] == pytest.approx(-1)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_clutch_that_locks_where_its_torque_changes_sign(method):
    """Against differences of a closed form: slip ends at t, then both turn on under the drag."""
    driving, driven = mbd.Body("A", 1, 0.2), mbd.Body("B", 1, 0.5)
    pins = [mbd.Revolute(n, mbd.ground.at(0, 0), b.at(0, 0)) for n, b in (("a", driving), ("b", driven))]
    angle, grip, slip = mbd.Parameter("angle", 0.0), mbd.Parameter("grip", 4.0), driving.omega - driven.omega
    drag = mbd.Torque("drag", driven, -0.1 * driven.omega)
    clutch = mbd.Torque("clutch", driven, grip * mbd.sign(slip), opposite=driving)
    lock = mbd.RelativeAngle("lock", driving.at(0, 0), driven.at(0, 0), angle)
    slips = mbd.Mechanism([driving, driven], pins, forces=[clutch, drag], parameters=[angle, grip])
    locked = slips.replace(joints=[*pins, lock], forces=[drag])
    locks = mbd.Event("locks", slip, direction=-1, becomes=locked, reset={angle: driven.phi - driving.phi})
    start = [driving.omega == 20, driven.omega == 0]
    found = mbd.sensitivities(slips, [0, 1, 2], [driven.omega], [grip], start, events=[locks], method=method)

    def exact(torque: float) -> tuple[float, float]:
        def excess(t: float) -> float:
            return 20 - torque * t / 0.2 - 10 * torque * (1 - np.exp(-0.2 * t))

        low, high = 0.0, 2.0
        for _ in range(100):
            middle = (low + high) / 2
            low, high = (middle, high) if excess(middle) > 0 else (low, middle)
        return low, (20 - torque * low / 0.2) * np.exp(-(2 - low) / 7)

    slopes = (np.array(exact(4.001)) - np.array(exact(3.999))) / 0.002
    assert found.events[0].time(grip) == pytest.approx(slopes[0], rel=1e-5)
    assert found[driven.omega, grip][-1] == pytest.approx(slopes[1], rel=1e-5)
