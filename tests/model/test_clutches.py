"""Free wheels, backstops and friction clutches against closed forms: exact, of several at once, said by name."""

import numpy as np
import pytest

import mbdcasadi as mbd


def shafts(*inertias):
    """Shafts in a row, each in a bearing."""
    bodies = [mbd.Body(f"shaft {k}", mass=1.0, inertia=inertia) for k, inertia in enumerate(inertias)]
    pins = [mbd.Revolute(f"bearing {k}", mbd.ground.at(k, 0), body.at(0, 0)) for k, body in enumerate(bodies)]
    return bodies, pins


def names(run):
    return [event.name for event in run.events]


# --- one way ---------------------------------------------------------------------------------------------
@pytest.mark.parametrize("sense", [1, -1])
def test_a_free_wheel_is_driven_and_overruns(sense):
    """Held while the driver speeds up, with the couple J α; then it keeps the greatest speed. Clockwise, exchanged."""
    (sprocket, hub), pins = shafts(0.05, 0.2)
    order = (sprocket, hub) if sense > 0 else (hub, sprocket)
    free = mbd.OneWayClutch("free", *order)
    pedal = mbd.Driver("pedal", pins[0].angle, sense * (3 - 3 * mbd.cos(2 * mbd.t)))
    model = mbd.Mechanism([sprocket, hub], joints=[*pins, free], drivers=[pedal])
    ride = mbd.simulate(model, np.linspace(0, 2, 41))
    (event,) = ride.events
    assert event.name == "free overruns" and event.t == pytest.approx(np.pi / 4, abs=1e-8)
    held = ride.t < event.t
    np.testing.assert_allclose(ride[hub.omega], sense * np.where(held, 6 * np.sin(2 * ride.t), 6), atol=1e-6)
    np.testing.assert_allclose(ride[free.torque][held], 0.2 * 12 * np.cos(2 * ride.t[held]), atol=1e-6)
    np.testing.assert_allclose(ride[free.torque][~held], 0, atol=1e-12)
    np.testing.assert_allclose(sense * ride[free.reaction_on(hub).torque], ride[free.torque], atol=1e-12)
    effort = ride[pedal.effort] - sense * ride[free.torque]
    np.testing.assert_allclose(effort, sense * 0.05 * 12 * np.cos(2 * ride.t), atol=1e-6)


def test_it_engages_again_and_drives_against_a_load():
    """Under a steady load the hub slows down from 6 rad/s until the pedals catch it up."""
    (sprocket, hub), pins = shafts(0.05, 0.2)
    free, load = mbd.OneWayClutch("free", sprocket, hub), mbd.Torque("load", hub, -1.2)
    pedal = mbd.Driver("pedal", pins[0].angle, 3 - 3 * mbd.cos(2 * mbd.t))
    model = mbd.Mechanism([sprocket, hub], joints=[*pins, free], drivers=[pedal], forces=[load])
    ride = mbd.simulate(model, np.linspace(0, 5, 501))
    assert names(ride)[:2] == ["free overruns", "free engages"]
    off, on = (event.t for event in ride.events[:2])
    assert 0.2 * 12 * np.cos(2 * off) == pytest.approx(-1.2, abs=1e-7)  # the pedals brake as the load does
    assert 6 * np.sin(2 * off) - 6 * (on - off) == pytest.approx(6 * np.sin(2 * on), abs=1e-6)
    assert np.min(ride[free.sliding_speed]) > -1e-9 and np.min(ride[free.torque]) > -1e-9


def test_two_free_wheels_rectify_an_oscillation():
    """One drives the shaft forth, and a backstop keeps it: it steps, and never turns back."""
    (lever, shaft), pins = shafts(0.05, 0.2)
    drive, stop = mbd.OneWayClutch("drive", lever, shaft), mbd.OneWayClutch("stop", mbd.ground, shaft)
    swing = mbd.Driver("swing", pins[0].angle, 0.25 * (1 - mbd.cos(4 * mbd.t)))
    spring = mbd.Torque("load", shaft, -4.0)
    model = mbd.Mechanism([lever, shaft], joints=[*pins, drive, stop], drivers=[swing], forces=[spring])
    run = mbd.simulate(model, np.linspace(0, 2 * np.pi, 201))
    assert np.min(run[shaft.omega]) > -1e-8 and np.min(run[shaft.omega - lever.omega]) > -1e-8
    assert np.min(run[drive.torque]) > -1e-8 and np.min(run[stop.torque]) > -1e-8
    period = [np.interp(k * np.pi / 2, run.t, run[pins[1].angle]) for k in range(5)]
    np.testing.assert_allclose(np.diff(period)[1:], period[1] - period[0], rtol=1e-3)
    assert period[1] - period[0] == pytest.approx(0.5, abs=1e-3) and "stop engages" in names(run)


def test_a_backstop_carries_the_load_and_lets_it_be_lifted():
    (shaft,), pins = shafts(0.5)
    stop = mbd.OneWayClutch("stop", mbd.ground, shaft)
    load = mbd.Torque("load", shaft, -3.0 + 4.0 * mbd.step(mbd.t, 1, 0, 2, 1))
    run = mbd.simulate(mbd.Mechanism([shaft], joints=[*pins, stop], forces=[load]), np.linspace(0, 2, 41))
    assert names(run) == ["stop overruns"]
    assert np.ptp(run[pins[0].angle][run.t <= run.events[0].t]) < 1e-12 and run[shaft.omega][-1] > 0.1
    np.testing.assert_allclose(run[stop.torque][run.t <= 1], 3.0)


# --- by friction -----------------------------------------------------------------------------------------
@pytest.mark.parametrize("speed", [10.0, -10.0])
def test_a_clutch_brings_shafts_to_one_speed(speed):
    """After Δω / (M (1/J1 + 1/J2)); the heat is half the reduced inertia times Δω²."""
    (a, b), pins = shafts(0.3, 0.2)
    clutch = mbd.Clutch("clutch", a, b, 2.0)
    model = mbd.Mechanism([a, b], joints=[*pins, clutch])
    run = mbd.simulate(model, np.linspace(0, 1, 101), initial=[a.omega == 0, b.omega == speed])
    (event,) = run.events
    assert event.name == "clutch stops" and event.t == pytest.approx(10 / (2 * (1 / 0.3 + 1 / 0.2)), abs=1e-8)
    np.testing.assert_allclose(run[a.omega][run.t > event.t], speed * 0.2 / 0.5, atol=1e-7)
    np.testing.assert_allclose(run[clutch.torque][run.t < event.t], -2 * np.sign(speed))
    lost = run.energy.total[0] - run.energy.total[-1]
    assert lost == pytest.approx(0.5 * 0.3 * 0.2 / 0.5 * 100, rel=1e-9)


def test_a_clutch_slips_beyond_what_it_holds():
    """A couple that grows is shared by the inertias until 1.5 M acts in the clutch; then M does."""
    (a, b), pins = shafts(0.3, 0.2)
    clutch = mbd.Clutch("clutch", a, b, 1.0, static_capacity=1.5)
    grows = mbd.Torque("grows", a, 2 * mbd.t)
    model = mbd.Mechanism([a, b], joints=[*pins, clutch], forces=[grows])
    run = mbd.simulate(model, np.linspace(0, 3, 61))
    (event,) = run.events
    assert event.name == "clutch breaks away" and event.t == pytest.approx(1.5 * 0.5 / 0.2 / 2, abs=1e-8)
    np.testing.assert_allclose(run[clutch.torque][run.t < event.t], 0.2 / 0.5 * 2 * run.t[run.t < event.t], atol=1e-9)
    np.testing.assert_allclose(run[clutch.torque][run.t > event.t], 1.0)


def test_a_clutch_is_closed_by_an_input():
    (a, b), pins = shafts(0.3, 0.2)
    pressed = mbd.Input("pressed", lower=0)
    clutch = mbd.Clutch("clutch", a, b, pressed)
    model = mbd.Mechanism([a, b], joints=[*pins, clutch], inputs=[pressed])
    start = [a.omega == 0, b.omega == 5]
    loose = mbd.simulate(model, np.linspace(0, 1, 11), initial=start, inputs={pressed: 0.0})
    np.testing.assert_allclose(loose[b.omega], 5, rtol=1e-12)
    closed = mbd.simulate(model, np.linspace(0, 1, 11), initial=start, inputs={pressed: 2 * mbd.t})
    mean = (1 / 0.3 + 1 / 0.2) / 5
    assert closed.events[0].t == pytest.approx(np.sqrt(1 / mean), abs=1e-6)
    np.testing.assert_allclose(closed[a.omega][-1], 2.0, atol=1e-7)


# --- said by name ----------------------------------------------------------------------------------------
def test_a_sampled_controller_switches_a_free_wheel():
    """At a sample at which the drive turns back, the free wheel overruns: an event, as one that is located."""
    drive, a, b = mbd.Input("drive"), *(mbd.Body(name, mass=1, inertia=1.0) for name in "ab")
    pins = [mbd.Revolute(f"pin {s.name}", mbd.ground.at(0, 0), s.at(0, 0)) for s in (a, b)]
    wheel = mbd.OneWayClutch("wheel", a, b)
    model = mbd.Mechanism([a, b], [*pins, wheel], forces=[mbd.Torque("motor", a, drive)], inputs=[drive])
    controller = mbd.SampledController(lambda t, state: {drive: 1.0 if t < 0.45 else -1.0}, 0.1)
    motion = mbd.simulate(model, np.linspace(0, 1, 6), initial=[a.omega == 0, b.omega == 0], inputs=controller)
    (event,) = motion.events
    assert (event.name, event.t) == ("wheel overruns", pytest.approx(0.5))
    assert event.state[wheel.torque] == pytest.approx(0.5) and event.after[wheel.torque] == 0
    assert motion[b.omega][-1] == pytest.approx(0.25) and motion[a.omega][-1] == pytest.approx(-0.25)


def varying(capacity, start, **inputs):
    """Run of a shaft that is driven by 0.5 N m, with a clutch to another one, whose capacity varies."""
    a, b = mbd.Body("a", mass=1, inertia=1.0), mbd.Body("b", mass=1, inertia=2.0)
    pins = [mbd.Revolute(f"pin {s.name}", mbd.ground.at(0, 0), s.at(0, 0)) for s in (a, b)]
    clutch, motor = mbd.Clutch("clutch", a, b, capacity), mbd.Torque("motor", a, 0.5)
    model = mbd.Mechanism([a, b], [*pins, clutch], forces=[motor], inputs=[level])
    return mbd.simulate(model, np.linspace(0, 1, 11), initial=[a.omega == start, b.omega == 0], **inputs)


level = mbd.Input("level", 1.0)


@pytest.mark.parametrize(
    ("value", "time", "what"),
    [
        (-1.0, 0.0, "at least 0, got -1"),
        (0.45 - mbd.t, 0.45, "at least 0, got -"),
        (mbd.if_else(mbd.logic_and(mbd.t > 0.43, mbd.t < 0.46), -2, 1), 0.43, "at least 0, got -2"),
        (mbd.SampledController(lambda t, state: {level: 3.0 - 10 * t}, 0.1), 0.4, "at least 0, got -1"),
    ],
)
def test_a_capacity_that_becomes_negative_stops_the_run(value, time, what):
    """A negative capacity would drive: the run ends where it begins, also between outputs."""
    inputs = value if isinstance(value, mbd.SampledController) else {level: value}
    with pytest.raises(mbd.SimulationError, match=f"'clutch': capacity must be {what}") as failure:
        varying(level, 3.0, inputs=inputs)
    assert failure.value.time == pytest.approx(time, abs=0.01)
    if time:
        assert failure.value.partial.t[-1] == pytest.approx(0.4)


@pytest.mark.filterwarnings("ignore:event 'clutch breaks away'")
def test_what_sticks_does_not_hold_beyond_the_data_of_its_capacity():
    with pytest.raises(mbd.SimulationError, match="capacity must be finite, got nan at t = 0.55"):
        varying(mbd.spline(mbd.t, [0, 0.2, 0.4, 0.55], [3, 3, 3, 3]), 0.0)


def test_what_is_wrong_is_named():
    (a, b), pins = shafts(0.3, 0.2)
    free = mbd.OneWayClutch("free", a, b)
    model = mbd.Mechanism([a, b], joints=[*pins, free])
    with pytest.raises(mbd.ModelError, match="one-way clutch 'free' connects body 'shaft 0' with itself"):
        mbd.OneWayClutch("free", a, a)
    with pytest.raises(mbd.ModelError, match="'free': b must be a body"):
        mbd.OneWayClutch("free", a, pins[1])
    with pytest.raises(mbd.ModelError, match="capacity.*-1"):
        mbd.Clutch("c", a, b, -1.0)
    with pytest.raises(mbd.ModelError, match="static_capacity 0.5 is below the capacity 1"):
        mbd.Clutch("c", a, b, 1.0, static_capacity=0.5)
    with pytest.raises(
        mbd.MechanismError, match="'free' moves at t = 0 s in the sense in which it holds, with -1 rad/s"
    ):
        mbd.simulate(model, [0, 1], initial=[a.omega == 1, b.omega == 0])
    with pytest.raises(mbd.MechanismError, match="a live page does not follow one-way clutch 'free'.*take a Torque"):
        mbd.animate(model, "page.html", live=True)
    held = model.replace(joints=[*model.joints[:-1], mbd.OneWayClutch("stop", mbd.ground, a)])
    back = held.replace(forces=[mbd.Torque("back", a, -1.0)])
    with pytest.raises(mbd.EquilibriumError, match="'stop' would have to hold 1 N m and holds 0 N m"):
        mbd.equilibrium(held.replace(forces=[mbd.Torque("on", a, 1.0)]))
    assert mbd.equilibrium(back)[held.joint("stop").torque] == pytest.approx(1.0)
    with pytest.raises(mbd.ModelError, match="'free' switches exactly.*take a Torque"):
        mbd.equilibrium_path(model.replace(parameters=[load := mbd.Parameter("load", 1.0)]), load, 0.0, 1.0)
