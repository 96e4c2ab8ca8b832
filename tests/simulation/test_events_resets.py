"""Events that reset velocities: impacts in free flight and in mechanisms, against closed forms."""

from __future__ import annotations

from itertools import pairwise

import casadi as ca
import numpy as np
import pytest
from linkages import G, four_bar

import mbdcasadi as mbd


def ball(height=1.0, **more):
    """A body that falls freely."""
    body = mbd.Body("ball", mass=0.6, inertia=0.01, pose=(0, height, 0), **more)
    return body, mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])


def bounce(body, restitution=0.8, name="bounce"):
    """Restitution on a floor at height zero."""
    return mbd.Event(name, body.y, direction=-1, reset={body.vy: -restitution * body.vy})


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_bounces_of_a_ball(method):
    """Times and speeds of the bounces are those of the geometric series, and the ball never sinks in."""
    body, mechanism = ball(velocity=(0.7, 0, 0.3))
    times = np.linspace(0, 3.5, 36)
    motion = mbd.simulate(mechanism, times, events=[bounce(body)], method=method)
    hit, speed, wanted = np.sqrt(2 / G), np.sqrt(2 * G), []
    while hit < 3.5:
        wanted.append((hit, speed))
        speed *= 0.8
        hit += 2 * speed / G
    assert len(motion.events) == len(wanted) > 5
    for event, (hit, speed) in zip(motion.events, wanted, strict=True):
        assert event.t == pytest.approx(hit, abs=1e-9)
        assert event.state[body.vy] == pytest.approx(-speed, abs=1e-8)
        assert event.after[body.vy] == pytest.approx(0.8 * speed, abs=1e-8)
        assert event.after[body.ay] == pytest.approx(-G)
    np.testing.assert_array_equal(motion.t, times)
    np.testing.assert_allclose(motion[body.vx], 0.7, atol=1e-9)
    np.testing.assert_allclose(motion[body.omega], 0.3, atol=1e-9)
    assert motion[body.y].min() > -1e-9


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock", "dop853", "bdf"])
def test_bounces_against_the_air(method):
    """With drag ``c v|v|`` the times of the bounces are known too; errors of the restarts do not add up."""
    body, mechanism = ball()
    drag = 0.45
    end = np.sqrt(0.6 * G / drag)  # speed at which the ball would fall in the end
    air = mbd.Force("air", body.at(0, 0), vector=(0, -drag * body.vy * mbd.fabs(body.vy)))
    height, hit, wanted = 1.0, 0.0, []
    for _ in range(20):
        hit += end / G * np.arccosh(np.exp(G * height / end**2))
        wanted.append(hit)
        speed = 0.8 * end * np.sqrt(1 - np.exp(-2 * G * height / end**2))
        hit += end / G * np.arctan(speed / end)
        height = end**2 / (2 * G) * np.log(1 + speed**2 / end**2)
    motion = mbd.simulate(
        mechanism.replace(forces=[*mechanism.forces, air]),
        [0, wanted[-1] + 1e-4],
        events=[bounce(body)],
        method=method,
        reltol=1e-10,
        abstol=1e-10,
    )
    np.testing.assert_allclose([event.t for event in motion.events], wanted, atol=1e-8)


def test_between_outputs_the_jump_stays():
    """Interpolation uses the states on both sides of a bounce, also from a file."""
    body, mechanism = ball()
    motion = mbd.simulate(mechanism, [0, 0.3, 0.9], events=[bounce(body)])
    hit = np.sqrt(2 / G)
    times = np.array([0.2, hit - 1e-6, hit + 1e-6, 0.7])
    since = times - hit
    wanted = np.where(since < 0, 1 - G * times**2 / 2, 0.8 * G * hit * since - G * since**2 / 2)
    np.testing.assert_allclose(motion.at(times)[body.y], wanted, atol=1e-8)


def test_resets_survive_a_file(tmp_path):
    """Both sides of a jump are written and read."""
    body, mechanism = ball()
    motion = mbd.simulate(mechanism, [0, 0.3, 0.9], events=[bounce(body), mbd.Event("half", body.y - 0.9)])
    motion.save(tmp_path / "bounce.npz")
    read = mbd.read_trajectory(tmp_path / "bounce.npz", mechanism)
    assert [e.name for e in read.events] == [e.name for e in motion.events] == ["half", "bounce"]
    assert read.events[0].after is None
    assert read.events[1].after[body.vy] == motion.events[1].after[body.vy] > 0
    np.testing.assert_allclose(read.at([0.5])[body.y], motion.at([0.5])[body.y], atol=1e-12)


@pytest.mark.slow
def test_bounces_that_die_out_are_told():
    """A reset cannot hold the ball; the run ends in words, with what was computed, and not below the floor."""
    body, mechanism = ball()
    with pytest.raises(mbd.SimulationError, match="'bounce' takes place ever faster") as caught:
        mbd.simulate(mechanism, np.linspace(0, 5, 51), events=[bounce(body)])
    rest = np.sqrt(2 / G) * (1 + 0.8) / (1 - 0.8)
    assert caught.value.time == pytest.approx(rest, abs=1e-6)
    assert caught.value.partial.t[-1] == pytest.approx(4.0)
    assert caught.value.partial[body.y].min() > -1e-9


def test_impact_in_a_four_bar():
    """The coupler strikes with restitution: the jump of the crank follows from one coordinate, by hand.

    With the velocities ``v = w(q) theta'`` of the mechanism, an impulse P on a speed
    ``s = g · v`` changes ``J theta'`` by ``P g · w``, ``J = w · M w``; restitution
    then asks for ``theta'+ = -e theta'-``, whatever the masses are.
    """
    f = four_bar(0.5, forces=[mbd.Gravity()])
    tip = f.mechanism.bodies[1].at(0.1, 0.2)
    start = [f.A.angle == 0.5, f.crank.omega == 12]
    free = mbd.simulate(f.mechanism, np.linspace(0, 0.4, 41), initial=start)
    height = float(free.at([0.21])[tip.y][0])
    strike = mbd.Event("strike", tip.y - height, reset=[(tip.vy, -0.6 * tip.vy)])
    motion = mbd.simulate(f.mechanism, np.linspace(0, 0.4, 41), initial=start, events=[strike])
    event = motion.events[0]
    before, after = event.state, event.after
    eom = mbd.equations(f.mechanism)
    assert after[f.crank.omega] == pytest.approx(-0.6 * before[f.crank.omega], rel=1e-9)
    np.testing.assert_allclose(after.v, -0.6 * before.v, atol=1e-8)
    np.testing.assert_allclose(after[eom.Phi_q @ eom.v], 0, atol=1e-10)
    np.testing.assert_array_equal(after.q, before.q)


def double_pendulum(m, length, forces_of=lambda tip: ()):
    """Two equal rods that begin horizontal, their tip, and the mechanism."""
    first = mbd.Body("first", mass=m, inertia=m * length**2 / 12, pose=(length / 2, 0, 0))
    second = mbd.Body("second", mass=m, inertia=m * length**2 / 12, pose=(1.5 * length, 0, 0))
    pins = [
        mbd.Revolute("upper", mbd.ground.at(0, 0), first.at(-length / 2, 0)),
        mbd.Revolute("lower", first.at(length / 2, 0), second.at(-length / 2, 0)),
    ]
    tip = second.at(length / 2, 0)
    return first, second, tip, mbd.Mechanism([first, second], pins, forces=[mbd.Gravity(), *forces_of(tip)])


def test_impact_of_two_degrees_of_freedom():
    """A double pendulum hits a wall with its tip: impulse and speeds from its 2 × 2 mass matrix, by hand."""
    m, length = 1.3, 0.7
    first, second, tip, mechanism = double_pendulum(m, length)
    wall = mbd.Event("wall", tip.x - 0.4, direction=-1, reset=[(tip.vx, -0.5 * tip.vx)])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.7, 71), events=[wall])
    before, after = motion.events[0].state, motion.events[0].after
    a, b = before[first.phi], before[second.phi]
    coupling = m * length**2 / 2 * np.cos(a - b)
    mass = np.array([[4 / 3 * m * length**2, coupling], [coupling, m * length**2 / 3]])
    along = -length * np.sin([a, b])  # d tip.x / d angles
    rates = np.array([before[first.omega], before[second.omega]])
    response = np.linalg.solve(mass, along)
    impulse = -1.5 * (along @ rates) / (along @ response)
    wanted = rates + response * impulse
    np.testing.assert_allclose([after[first.omega], after[second.omega]], wanted, rtol=1e-8)
    assert impulse > 0
    lost = before[mbd.equations(mechanism).kinetic] - after[mbd.equations(mechanism).kinetic]
    assert lost == pytest.approx(0.75 / 2 * (along @ rates) ** 2 / (along @ response), rel=1e-7)


def test_a_stiff_contact_meets_the_impulse():
    """An elastic blow of a double pendulum: by a reset, and by contacts that are ever stiffer."""
    m, length, wall = 1.3, 0.7, 0.4

    def run(forces_of, events_of):
        first, second, tip, mechanism = double_pendulum(m, length, forces_of)
        motion = mbd.simulate(mechanism, np.linspace(0, 0.65, 66), events=events_of(tip))
        return motion, np.array([motion[first.phi][-1], motion[second.phi][-1]])

    hard, wanted = run(
        lambda tip: [], lambda tip: [mbd.Event("wall", tip.x - wall, direction=-1, reset=[(tip.vx, -tip.vx)])]
    )
    assert [event.name for event in hard.events] == ["wall"] and hard.events[0].t < 0.6
    solid, errors = mbd.HalfPlane(mbd.ground.at(wall, 0, angle=-np.pi / 2)), []
    for stiffness in (1e6, 1e8, 1e10):
        law = mbd.HuntCrossley(stiffness, exponent=1.0)
        _, found = run(lambda tip, law=law: [mbd.Contact("wall", mbd.Point(tip), solid, law)], lambda tip: [])
        errors.append(np.abs(found - wanted).max())
    # what is left falls with the time of contact, which goes with the root of the stiffness
    assert errors[2] < 5e-4 and errors[1] < errors[0] / 5 and errors[2] < errors[1] / 5


@pytest.mark.slow
@pytest.mark.parametrize("clearance", [0.0, 1e-4])
def test_newtons_cradle(clearance):
    """Five pendulums, touching or nearly so: one comes, the last one leaves with its speed; and back."""
    length, radius, count = 1.0, 0.05, 5
    pitch = 2 * radius + clearance
    balls = [mbd.Body(f"ball {k}", mass=0.2, inertia=0, pose=(k * pitch, -length, 0)) for k in range(count)]
    strings = [mbd.Revolute(f"string {k}", mbd.ground.at(k * pitch, 0), b.at(0, length)) for k, b in enumerate(balls)]
    mechanism = mbd.Mechanism(bodies=balls, joints=strings, forces=[mbd.Gravity()])
    hits = []
    for k, (a, b) in enumerate(pairwise(balls)):
        gap = mbd.distance(a, b) - 2 * radius
        swap = [(a.vx, b.vx), (b.vx, a.vx)]
        hits.append(mbd.Event(f"hit {k}", gap, direction=-1, reset=swap))
    start = [balls[0].phi == -0.3, *[b.phi == 0 for b in balls[1:]], *[b.omega == 0 for b in balls]]
    motion = mbd.simulate(mechanism, np.linspace(0, 1.3, 131), initial=start, events=hits)
    speed = np.sqrt(2 * G * length * (1 - np.cos(0.3)))
    last = motion[balls[-1].phi]
    assert last.max() == pytest.approx(0.3, abs=1e-4 if not clearance else 1e-2)
    assert [e.name for e in motion.events[:4]] == ["hit 0", "hit 1", "hit 2", "hit 3"]
    assert motion.events[3].after[balls[4].vx] == pytest.approx(speed, rel=1e-3)
    energy = motion.energy.total
    np.testing.assert_allclose(energy, energy[0], atol=1e-5)


def test_with_samples_and_a_controller():
    """Bounces do not disturb inputs by samples, nor the instants at which a controller is asked."""
    u = mbd.Input("u")
    body, _ = ball(velocity=(1, 0, 0))
    mechanism = mbd.Mechanism(
        bodies=[body], forces=[mbd.Gravity(), mbd.Force("push", body.at(0, 0), (u, 0))], inputs=[u]
    )
    times = np.linspace(0, 1.2, 13)
    motion = mbd.simulate(mechanism, times, inputs={u: 0.6 * times}, events=[bounce(body)])
    assert len(motion.events) == 2
    np.testing.assert_allclose(motion[body.vx], 1 + times**2 / 2, atol=1e-7)
    asked = []

    def control(time, state):
        asked.append(time)
        return {u: 0.6 * round(time / 0.3)}

    motion = mbd.simulate(mechanism, times, inputs=mbd.SampledController(control, 0.3), events=[bounce(body)])
    np.testing.assert_allclose(asked, [0, 0.3, 0.6, 0.9], atol=1e-9)
    assert motion[body.vx][-1] == pytest.approx(1 + 0.3 * (0 + 1 + 2 + 3), abs=1e-7)


def test_reset_of_a_state_variable():
    """A counter of turns, and a sawtooth, as first-order states."""
    body, _ = ball()
    saw = mbd.StateVariable("saw")
    mechanism = mbd.Mechanism(bodies=[body], forces=[], states={saw: 2.0})
    event = mbd.Event("full", saw - 1, direction=1, reset={saw: saw - 1})
    motion = mbd.simulate(mechanism, np.linspace(0, 2.2, 23), events=[event])
    np.testing.assert_allclose([e.t for e in motion.events], [0.5, 1.0, 1.5, 2.0], atol=1e-9)
    # an output at the event itself belongs to the time before it
    late = np.abs(np.remainder(motion.t + 0.25, 0.5) - 0.25) > 1e-6
    np.testing.assert_allclose(motion[saw][late], np.remainder(2 * motion.t, 1)[late], atol=1e-8)


def test_a_kick_that_passes_through():
    """A reset that does not turn the motion round takes place once."""
    body, mechanism = ball(velocity=(1, 0, 0))
    kick = mbd.Event("kick", body.x - 0.5, direction=1, reset={body.vx: body.vx + 1})
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), events=[kick])
    (event,) = motion.events
    assert event.t == pytest.approx(0.5, abs=1e-9)
    assert motion[body.x][-1] == pytest.approx(1.5, abs=1e-8)


def test_refuses_resets():
    """What cannot jump, what contradicts the joints, and what has no effect."""
    body, mechanism = ball()
    with pytest.raises(mbd.ModelError, match="positions"):
        mbd.Event("a", body.y, reset={body.x: 0})
    with pytest.raises(mbd.ModelError, match="not linear"):
        mbd.Event("a", body.y, reset=[(body.vx**2, 0)])
    with pytest.raises(mbd.ModelError, match="empty"):
        mbd.Event("a", body.y, reset={})
    with pytest.raises(mbd.ModelError, match="pairs"):
        mbd.Event("a", body.y, reset=3)
    with pytest.raises(mbd.ModelError, match="terminal"):
        mbd.Event("a", body.y, terminal=True, reset={body.vy: 0})
    other, _ = ball()
    with pytest.raises(mbd.ExpressionError, match="ball"):
        mbd.simulate(mechanism, [0, 1], events=[mbd.Event("a", body.y, reset={body.vy: other.vy})])
    pin = mbd.Revolute("pin", mbd.ground.at(0, 1), body.at(0, 0))
    held = mbd.Mechanism(bodies=[body], joints=[pin], forces=[mbd.Gravity()])
    with pytest.raises(mbd.SimulationError, match=r"contradicts the constraints.*pin"):
        mbd.simulate(held, [0, 1], events=[mbd.Event("a", mbd.t - 0.5 + 0 * body.x, reset={body.vx: 1})])
    assert ca.SX(body.vy).is_symbolic()


@pytest.mark.parametrize("side", [0, 1])
def test_a_reset_of_what_is_not_there_is_refused_at_the_start(side):
    """Though the event never takes place."""
    body, mechanism = ball()
    stranger = mbd.Body("stranger", mass=1, inertia=1)
    pair = [(stranger.vy, -body.vy), (body.vy, -stranger.vy)][side]
    with pytest.raises(mbd.ExpressionError, match=r"event 'hit', reset: .*'stranger'"):
        mbd.simulate(mechanism, duration=0.1, events=[mbd.Event("hit", body.y + 5, -1, reset=[pair])])


def test_events_at_one_instant_are_all_recorded():
    """Beside a reset or the end of the run, whatever the order in which they are given."""
    ball = mbd.Body("ball", mass=1, inertia=1, pose=(0, 1, 0))
    mechanism = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    touch = mbd.Event("touch", ball.y, direction=-1)
    hit = mbd.Event("hit", ball.y, direction=-1, reset={ball.vy: -0.5 * ball.vy})
    ends = [mbd.Event(name, ball.y, direction=-1, terminal=True) for name in ("end", "stop")]
    for events, names in (
        ([hit, touch], ["touch", "hit"]),
        ([touch, hit], ["touch", "hit"]),
        ([ends[0], touch], ["touch", "end"]),
        (ends, ["end", "stop"]),
        ([hit, ends[0]], ["end"]),
    ):
        motion = mbd.simulate(mechanism, np.linspace(0, 0.8, 9), events=events)
        assert [event.name for event in motion.events] == names
        np.testing.assert_allclose([event.t for event in motion.events], np.sqrt(2 / 9.81), rtol=1e-12)


def test_refuses_relations_and_a_single_event():
    """A relation is 0 or 1 and never passes through zero."""
    ball = mbd.Body("ball", mass=1, inertia=1)
    for relation in (ball.y > 0, ball.y <= 0, ball.y == 0):
        with pytest.raises(mbd.ModelError, match=r"event 'low'.*relation.*difference"):
            mbd.Event("low", relation)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), ball.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.2))
    for forces in ([], [rub]):
        mechanism = mbd.Mechanism(bodies=[ball], joints=[rail], forces=forces)
        with pytest.raises(mbd.ModelError, match=r"write events=\["):
            mbd.simulate(mechanism, duration=0.1, events=mbd.Event("low", ball.x))


# --- events that are active at the start ---------------------------------------------------------
def thrown(y, vy, direction):
    ball = mbd.Body("ball", mass=1.0, inertia=1.0)
    floor = mbd.Event("floor", ball.y, direction=direction, reset={ball.vy: -0.5 * ball.vy})
    mechanism = mbd.Mechanism(bodies=[ball])
    motion = mbd.simulate(mechanism, [0, 0.5, 1.0], initial=[ball.y == y, ball.vy == vy], events=[floor])
    return motion[ball.y][-1], len(motion.events)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("y", [0.0, -1e-11, -1e-9, -1e-6])
def test_reset_at_the_start_that_rounding_has_passed_takes_place_at_once(y):
    height, events = thrown(y, -1.0, -1)
    assert events == 1
    assert height == pytest.approx(y + 0.5, abs=1e-12)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("y", "vy"), [(0.0, 1.0), (1e-3, 1.0), (-1e-7, 1.0)])
def test_reset_at_the_start_from_which_the_motion_leaves_does_not_take_place(y, vy):
    assert thrown(y, vy, -1) == (pytest.approx(y + vy), 0)


@pytest.mark.parametrize("vy", [-1.0, 0.0, 1.0])
def test_start_behind_a_floor_is_reported(vy):
    with pytest.warns(mbd.MechanismWarning, match="'floor' is beyond its zero by 0.1 at the start"):
        thrown(-0.1, vy, -1)


@pytest.mark.parametrize("vy", [-1.0, 1.0])
def test_start_at_the_zero_of_an_event_without_direction_is_reported(vy):
    with pytest.warns(mbd.MechanismWarning, match="'floor' is at its zero at the start.*both directions"):
        assert thrown(0.0, vy, 0) == (pytest.approx(vy), 0)


@pytest.mark.filterwarnings("error")
def test_kick_that_the_start_has_passed_is_none():
    ball = mbd.Body("ball", mass=1.0, inertia=1.0)
    kicks = [
        mbd.Event("place", ball.x - 5, direction=1, reset={ball.vx: ball.vx + 1}),
        mbd.Event("time", mbd.t - 5, direction=1, reset={ball.vx: -ball.vx}),
    ]
    motion = mbd.simulate(mbd.Mechanism(bodies=[ball]), [6, 7], initial=[ball.x == 10, ball.vx == 1], events=kicks)
    assert motion[ball.x][-1] == pytest.approx(11)


@pytest.mark.filterwarnings("error")
def test_event_in_time_brings_no_warning_of_numerics():
    ball = mbd.Body("ball", mass=1.0, inertia=1.0)
    kick = mbd.Event("kick", mbd.t - 0.75, direction=1, reset={ball.vy: ball.vy + 5})
    times = np.linspace(0, 2, 11)
    motion = mbd.simulate(mbd.Mechanism(bodies=[ball]), times, initial=[ball.y == 1, ball.vy == -1], events=[kick])
    assert motion[ball.y][-1] == pytest.approx(1 - 2 + 5 * 1.25)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [3e-9, 5e-9, 1e-8, 2e-8, 1e-7])
def test_bounces_that_die_out_are_never_passed(tolerance):
    """At no tolerance does the ball fall through: an event begins at zero, whatever the error of its place."""
    body, mechanism = ball()
    with pytest.raises(mbd.SimulationError, match="'bounce' takes place ever faster") as caught:
        mbd.simulate(mechanism, np.linspace(0, 5, 51), events=[bounce(body)], reltol=tolerance, abstol=tolerance)
    assert caught.value.partial[body.y].min() > -1e-6
    assert caught.value.time == pytest.approx(np.sqrt(2 / G) * (1 + 0.8) / (1 - 0.8), abs=1e-3)
