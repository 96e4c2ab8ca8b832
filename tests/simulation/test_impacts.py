"""Resets at the start of a motion, at rest, and at one instant."""

import itertools

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def ball(height=1.0, speed=0.0, name="ball", x=0.0):
    return mbd.Body(name, mass=1.0, inertia=0.1, pose=(x, height, 0), velocity=(0, speed, 0))


def bounce(body, restitution, name="floor"):
    return mbd.Event(name, body.y, direction=-1, reset={body.vy: -restitution * body.vy})


@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_at_its_zero_at_the_start(method):
    """A ball that starts on the floor at 1 m/s downwards bounces at once."""
    body = ball(0.0, -1.0)
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.15, 16), events=[bounce(body, 0.8)], method=method)
    assert [e.t for e in motion.events] == [0.0]
    t = motion.t[1:]
    np.testing.assert_allclose(motion[body.y][1:], 0.8 * t - G * t**2 / 2, atol=1e-8)


def test_restart_from_the_state_of_an_event():
    """A run that goes on from the state just before its own event goes on as one run does."""
    body = ball()
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])
    whole = mbd.simulate(mechanism, np.linspace(0, 1, 11), events=[bounce(body, 0.8)])
    first = whole.events[0]
    rest = mbd.simulate(mechanism, [first.t, 1.0], initial=first.state, events=[bounce(body, 0.8)])
    assert rest.final[body.y] == pytest.approx(whole.final[body.y], abs=1e-7)
    after = mbd.simulate(mechanism, [first.t, 1.0], initial=first.after, events=[bounce(body, 0.8)])
    assert after.final[body.y] == pytest.approx(whole.final[body.y], abs=1e-7)
    assert not after.events


def test_pushed_against_a_wall_that_it_touches():
    """A reset cannot hold a block that a force presses through: an error says so, and names the event."""
    block = mbd.Body("block", mass=1, inertia=1)
    push = mbd.Force("push", block.at(0, 0), (5, 0))
    wall = mbd.Event("wall", block.x, direction=1, reset={block.vx: 0})
    with pytest.raises(mbd.SimulationError, match="'wall'.*at rest.*press it through.*Contact"):
        mbd.simulate(mbd.Mechanism(bodies=[block], forces=[push]), [0, 1], events=[wall])


def test_touches_a_wall_and_is_pulled_away():
    """The same with a pull: nothing happens."""
    block = mbd.Body("block", mass=1, inertia=1)
    pull = mbd.Force("pull", block.at(0, 0), (-5, 0))
    wall = mbd.Event("wall", block.x, direction=1, reset={block.vx: 0})
    motion = mbd.simulate(mbd.Mechanism(bodies=[block], forces=[pull]), [0, 1], events=[wall])
    assert motion.final[block.x] == pytest.approx(-2.5, abs=1e-7)
    assert not motion.events


def test_a_reset_to_rest_is_not_held():
    """A ball that is to stop on the floor: the run ends there, and not below it."""
    body = ball()
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()])
    with pytest.raises(mbd.SimulationError, match="'floor'.*cannot hold") as caught:
        mbd.simulate(mechanism, np.linspace(0, 2, 21), events=[bounce(body, 0.0)])
    assert caught.value.time == pytest.approx(np.sqrt(2 / G), abs=1e-9)
    assert caught.value.partial[body.y].min() > -1e-9


def test_comes_to_rest_without_a_force():
    """A plastic reset with nothing that presses: the body stays, whatever rounding does."""
    block = mbd.Body("block", mass=1, inertia=1, pose=(-1, 0, 0), velocity=(2, 0, 0))
    wall = mbd.Event("wall", block.x, direction=1, reset={block.vx: 0})
    motion = mbd.simulate(mbd.Mechanism(bodies=[block]), np.linspace(0, 3, 31), events=[wall])
    assert [e.name for e in motion.events] == ["wall"]
    np.testing.assert_allclose(motion[block.x][motion.t > 0.5], 0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_a_rod_dropped_flat(restitution, order):
    """Both tips hit at once: the impulses are one system, and the rod does not turn."""
    rod = mbd.Body("rod", mass=1.2, inertia=0.1, pose=(0, 1, 0))
    tips = [rod.at(-0.5, 0), rod.at(0.5, 0)]
    hits = [mbd.Event(f"tip {k}", p.y, direction=-1, reset=[(p.vy, -restitution * p.vy)]) for k, p in enumerate(tips)]
    mechanism = mbd.Mechanism(bodies=[rod], forces=[mbd.Gravity()])
    end = np.sqrt(2 / G) * 1.2
    events = [hits[k] for k in order]
    if restitution == 0.0:
        with pytest.raises(mbd.SimulationError, match="cannot hold") as caught:
            mbd.simulate(mechanism, [0, end], events=events)
        motion = caught.value.partial
    else:
        motion = mbd.simulate(mechanism, np.linspace(0, end, 13), events=events)
    assert sorted(e.name for e in motion.events) == ["tip 0", "tip 1"]
    after = motion.events[-1].after
    assert after[rod.vy] == pytest.approx(restitution * np.sqrt(2 * G), abs=1e-7)
    assert after[rod.omega] == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_three_bodies_at_once(order):
    """A mass between two that come from both sides: symmetric, and the same whatever the order of the list."""
    bodies = [mbd.Body(n, mass=1, inertia=1, pose=(x, 0, 0), velocity=(v, 0, 0))
              for n, x, v in (("left", -1, 1), ("middle", 0, 0), ("right", 1, -1))]  # fmt: skip
    left, middle, right = bodies
    e = 0.5

    def hit(a, b, name):
        gap, rate = b.x - a.x - 0.2, b.vx - a.vx
        return mbd.Event(name, gap, direction=-1, reset=[(rate, -e * rate)])

    guard = mbd.Event("guard", left.x + 5, direction=-1, terminal=True)
    events = [hit(left, middle, "left hit"), hit(middle, right, "right hit"), guard]
    motion = mbd.simulate(mbd.Mechanism(bodies=bodies), [0, 1], events=[events[k] for k in order])
    np.testing.assert_allclose(motion.final[mbd.vertcat(left.vx, middle.vx, right.vx)], [-0.5, 0, 0.5], atol=1e-9)


def test_a_chain_of_impacts():
    """Newton's cradle: what closes by an impact takes place in the next round, and the last ball flies off."""
    count, gap = 5, 0.0
    bodies = [mbd.Body(f"ball {k}", mass=1, inertia=1, pose=(0.2 * k, 0, 0)) for k in range(count)]
    first = bodies[0]
    hits = []
    for a, b in itertools.pairwise(bodies):
        rate = b.vx - a.vx
        hits.append(mbd.Event(f"{a.name} hits {b.name}", b.x - a.x - 0.2 - gap, direction=-1, reset=[(rate, -rate)]))
    motion = mbd.simulate(
        mbd.Mechanism(bodies=bodies), np.linspace(0, 1, 11), initial=[first.x == -0.5, first.vx == 1], events=hits[::-1]
    )
    assert motion.final[bodies[-1].vx] == pytest.approx(1)
    np.testing.assert_allclose([motion.final[b.vx] for b in bodies[:-1]], 0, atol=1e-9)


def test_resets_that_contradict_each_other():
    """Two events that give the same velocity different values at once are refused by their names."""
    body = ball()
    events = [
        mbd.Event("one", body.y, direction=-1, reset={body.vy: 1.0}),
        mbd.Event("two", body.y, direction=-1, reset={body.vy: 2.0}),
    ]
    with pytest.raises(mbd.SimulationError, match="'one', 'two'.*another reset"):
        mbd.simulate(mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()]), [0, 1], events=events)


@pytest.mark.parametrize("ahead", [1e-12, 1e-10, 1e-9, 1e-8, 1e-7])
def test_an_event_just_before_the_end(ahead):
    """A crossing that close to the last output does not fail the run."""
    body = ball()
    fall = np.sqrt(2 / G)
    ground = mbd.Event("ground", body.y, direction=-1)
    motion = mbd.simulate(
        mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()]), np.linspace(0, fall + ahead, 11), events=[ground]
    )
    assert len(motion.t) == 11
    assert [e.name for e in motion.events] == ["ground"]
    assert motion.events[0].t == pytest.approx(fall, abs=1e-9)


@pytest.mark.parametrize("duration", [1e-7, 1e-10])
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
def test_a_very_short_run(duration, method):
    body = ball(1.0, 3.0)
    motion = mbd.simulate(mbd.Mechanism(bodies=[body], forces=[mbd.Gravity()]), duration=duration, method=method)
    assert len(motion.t) == 201
    np.testing.assert_allclose(motion[body.y] - 1, 3 * motion.t, rtol=1e-5, atol=1e-13)


def test_an_event_between_two_outputs():
    """A gate that opens and closes between outputs is found, by what its expression does there."""
    arm = mbd.Body("arm", mass=1, inertia=1, velocity=(0, 0, 3.0))
    mechanism = mbd.Mechanism(bodies=[arm])
    gate = mbd.Event("gate", mbd.cos(arm.phi) + 0.999999)  # below zero for 0.9 ms
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 3), events=[gate])
    assert [e.name for e in motion.events] == ["gate", "gate"]
    half = np.arccos(0.999999)
    np.testing.assert_allclose([e.t for e in motion.events], [(np.pi - half) / 3, (np.pi + half) / 3], atol=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("begin", [0.0, 1e3, 1.7e9, -1.7e9])
def test_any_start_time(begin):
    """Every output is there, and the motion does not depend on when it starts."""
    arm = mbd.Body("arm", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity()])
    times = np.linspace(0, 60, 11)
    motions = [mbd.simulate(pendulum, b + times, initial=[arm.phi == -1.2, arm.omega == 0]) for b in (0.0, begin)]
    assert len(motions[1].t) == 11
    np.testing.assert_allclose(motions[1][arm.phi], motions[0][arm.phi], atol=1e-4)


@pytest.mark.slow
@pytest.mark.parametrize("tilt", [1e-9, 2e-9, 1e-8, 1e-6])
def test_ends_of_a_nearly_flat_rod_answer_each_other(tilt):
    """One tip after the other and the first again: velocities by the impulses of three impacts, with the free fall."""
    rod = mbd.Body("rod", mass=1, inertia=1 / 12, pose=(0, 1, 0))
    events = []
    for name, place in (("left", -0.5), ("right", 0.5)):
        tip = rod.at(place, 0).y
        speed = mbd.time_derivative(tip)
        events.append(mbd.Event(name, tip, direction=-1, reset={speed: -0.5 * speed}))
    mechanism = mbd.Mechanism(bodies=[rod], forces=[mbd.Gravity()])
    start = [rod.x == 0, rod.y == 1, rod.phi == tilt, rod.vx == 0, rod.vy == 0, rod.omega == 0]
    motion = mbd.simulate(mechanism, np.linspace(0, 0.6, 13), initial=start, events=events)
    # an impulse P at a tip changes vy by P and omega by ±6 P, its own speed by 4 P, that of the other by -2 P
    fall = np.sqrt(2 * 9.81)
    vy, omega = -fall, 0.0
    for side in (-1, 1, -1):
        impulse = -1.5 * (vy + side * omega / 2) / 4
        vy, omega = vy + impulse, omega + 6 * side * impulse
    assert [event.name for event in motion.events] == ["left", "right", "left"]
    assert motion[rod.omega][-1] == pytest.approx(omega, rel=1e-4)
    assert motion[rod.vy][-1] == pytest.approx(vy - 9.81 * (0.6 - fall / 9.81), abs=1e-4)
