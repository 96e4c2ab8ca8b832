"""Simulation through mechanisms that change at events, against closed forms."""

import numpy as np
import pytest
from linkages import block_and_rider
from scipy.integrate import quad

import mbdcasadi as mbd

G = 9.81


def wheel(n=8, m=2.0, J0=0.1, slope=0.08, spokes=5):
    """A rimless wheel, its mechanisms by the spoke it stands on, the landings, and the recursion of its speed."""
    half, l = np.pi / n, 1.0  # noqa: E741
    body = mbd.Body("wheel", mass=m, inertia=J0, pose=(-l * np.sin(half), l * np.cos(half), 0.0), velocity=(1, 0, -1))
    feet = [body.at(-l * np.sin(-half - 2 * half * k), -l * np.cos(-half - 2 * half * k)) for k in range(spokes)]
    pins = [mbd.Revolute(f"spoke {k}", mbd.ground.at(2 * l * np.sin(half) * k, 0), f) for k, f in enumerate(feet)]
    gravity = mbd.Gravity((G * np.sin(slope), -G * np.cos(slope)))
    on = [mbd.Mechanism(bodies=[body], joints=[pin], forces=[gravity]) for pin in pins]
    landings = [
        mbd.Event(f"spoke {k} lands", feet[k].y, direction=-1, during=on[k - 1], becomes=on[k])
        for k in range(1, spokes)
    ]
    J = J0 + m * l**2
    mu = (J0 + m * l**2 * np.cos(2 * half)) / J
    gain = 4 * m * G * l * np.sin(half) * np.sin(slope) / J
    return body, pins, on, landings, mu, gain, J


def roll(method="idas", t=2.5, **more):
    body, _, on, landings, *_ = wheel()
    return mbd.simulate(
        on[0],
        np.linspace(0, t, 101),
        initial=[body.phi == 0, body.omega == -1.0],
        events=landings,
        method=method,
        reltol=1e-11,
        abstol=1e-11,
        **more,
    )


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
def test_a_rimless_wheel(method):
    body, pins, on, landings, mu, gain, J = wheel()
    motion = mbd.simulate(
        on[0],
        np.linspace(0, 2.5, 101),
        initial=[body.phi == 0, body.omega == -1.0],
        events=landings,
        method=method,
        reltol=1e-11,
        abstol=1e-11,
    )
    assert len(motion.events) >= 2
    speed, energy, last = 1.0, motion.energy, 0
    for k, event in enumerate(motion.events, start=1):
        before = np.sqrt(speed**2 + gain)
        assert -event.state[body.omega] == pytest.approx(before, abs=1e-9)
        speed = mu * before
        assert -event.after[body.omega] == pytest.approx(speed, abs=1e-9)
        # the impulse changes the momentum, and the energy falls by what the impact takes
        change = 2.0 * (event.after[body.velocity] - event.state[body.velocity])
        np.testing.assert_allclose(event.after[pins[k].impulse_on(body).force], change, atol=1e-9)
        i = int(np.flatnonzero(motion.t == event.t)[0])
        assert motion.t[i + 1] == event.t
        loss = J / 2 * (before**2 - speed**2)
        assert energy.total[i] - energy.total[i + 1] == pytest.approx(loss, abs=1e-8)
        assert np.ptp(energy.total[last : i + 1]) < 1e-7
        last = i + 1
    first = motion.events[0].t
    half, slope = np.pi / 8, 0.08
    exact = quad(
        lambda x: 1 / np.sqrt(1 + 2 * 2.0 * G / J * (np.cos(slope - half) - np.cos(x))), slope - half, slope + half
    )[0]
    assert first == pytest.approx(exact, abs=1e-9)
    assert [part.mechanism for part in motion.phases] == on[: len(motion.events) + 1]


def test_results_evaluate_over_all_phases():
    motion = roll()
    body = motion.mechanism.bodies[0]
    pins = motion.mechanism.joints
    first = motion.events[0].t
    on_first = np.zeros(len(motion), bool)
    on_first[: len(motion.phases[0])] = True
    force = motion[pins[0].reaction_on(body).force]
    assert np.all(force[~on_first] == 0) and np.all(np.abs(force[on_first, 1]) > 1)
    assert np.all(motion[pins[1].reaction_on(body).force][on_first] == 0)
    assert motion.drift.position < 1e-12 and motion.drift.velocity < 1e-11
    before, at, after = motion.at([first - 1e-3, first, first + 1e-3])[body.omega]
    assert at == pytest.approx(motion.events[0].state[body.omega], abs=1e-10)
    assert abs(before - at) < 0.01 and abs(at - after) > 0.3
    assert motion.at(np.nextafter(first, 9))[body.omega][0] == pytest.approx(motion.events[0].after[body.omega])
    # unsorted times, and one beyond the end
    np.testing.assert_allclose(motion.at([first + 1e-3, first - 1e-3])[body.omega], [after, before])
    with pytest.raises(mbd.MechanismError, match="covers"):
        motion.at(99.0)
    assert motion.initial[pins[0].reaction_on(body).force][1] > 0
    assert motion.final.mechanism is motion.phases[-1].mechanism
    assert motion.final[pins[0].reaction_on(body).force][1] == 0


def thrown(angle=0.6):
    """A ball on an arm that turns evenly, let go."""
    arm = mbd.Body("arm", mass=1.0, inertia=0.1, pose=(0.5, 0, 0))
    ball = mbd.Body("ball", mass=0.2, inertia=0.01, pose=(1.0, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    hand = mbd.Weld("hand", arm.at(0.5, 0), ball.at(0, 0))
    turn = mbd.Driver("turn", hinge.angle, 3.0 * mbd.t)
    held = mbd.Mechanism(bodies=[arm, ball], joints=[hinge, hand], drivers=[turn], forces=[mbd.Gravity()])
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    release = mbd.Event("release", hinge.angle - angle, direction=1, becomes=free)
    return arm, ball, hand, held, free, release


def test_bodies_leave():
    arm, ball, hand, held, _free, release = thrown()
    motion = mbd.simulate(held, np.linspace(0, 0.5, 51), events=[release])
    (event,) = motion.events
    assert event.t == pytest.approx(0.2, abs=1e-9)
    np.testing.assert_allclose(event.after[ball.velocity], event.state[ball.velocity], atol=1e-12)
    flying = np.arange(len(motion)) >= len(motion.phases[0])
    assert np.all(np.isnan(motion[arm.phi][flying])) and np.all(np.isfinite(motion[arm.phi][~flying]))
    t = motion.t[flying] - 0.2
    x, y = np.cos(0.6), np.sin(0.6)
    np.testing.assert_allclose(motion[ball.x][flying], x - 3 * y * t, atol=1e-8)
    np.testing.assert_allclose(motion[ball.y][flying], y + 3 * x * t - G * t**2 / 2, atol=1e-8)
    assert np.all(motion[hand.reaction_on(ball).force][flying] == 0)
    assert np.all(np.isfinite(motion.energy.total))
    assert motion.statistics.restarts > 0 and motion.statistics.method
    assert motion.statistics.steps == sum(part.statistics.steps for part in motion.phases) > 10


@pytest.mark.slow
def test_a_ball_that_bounces_by_restitution_and_comes_to_rest_is_an_error():
    """Bounces at closed-form times; where they accumulate the run ends with the remedy, and what was computed."""
    ball = mbd.Body("ball", mass=0.4, inertia=1e-3, pose=(0, 1.0, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    free = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
    e = 0.5
    bounce = mbd.Event("bounce", ball.y, direction=-1, becomes=free, during=free, restitution={floor: e})
    motion = mbd.simulate(free, np.linspace(0, 1.0, 101), events=[bounce])
    v, t = np.sqrt(2 * G), np.sqrt(2 / G)
    for event in motion.events:
        assert event.t == pytest.approx(t, abs=1e-8)
        assert event.after[ball.vy] == pytest.approx(e * v, abs=1e-7)
        assert event.after[floor.impulse_on(ball).force[1]] == pytest.approx(0.4 * (1 + e) * v, abs=1e-7)
        v, t = e * v, t + 2 * e * v / G
    with pytest.raises(mbd.SimulationError, match="'bounce'.*the joint holds") as caught:
        mbd.simulate(free, np.linspace(0, 3, 31), events=[bounce])
    assert caught.value.time == pytest.approx(np.sqrt(2 / G) * (1 + 2 * e / (1 - e)), abs=1e-3)
    assert caught.value.partial.t[-1] > 1.2


def test_joints_that_close_at_one_instant_close_in_one_impact():
    """A beam that falls level onto two supports; whatever the order of the events, it stays level."""
    beam = mbd.Body("beam", mass=2.0, inertia=0.5, pose=(0, 0.5, 0))
    left, right = beam.at(-1, 0), beam.at(1, 0)
    on_left, on_right = mbd.AbsoluteY("left", left, 0.0), mbd.AbsoluteY("right", right, 0.0)
    air = mbd.Mechanism(bodies=[beam], forces=[mbd.Gravity()])
    one, other, both = (air.replace(joints=j) for j in ([on_left], [on_right], [on_left, on_right]))
    events = [
        mbd.Event("left lands", left.y, direction=-1, during=air, becomes=one),
        mbd.Event("right lands", right.y, direction=-1, during=air, becomes=other),
        mbd.Event("right lands too", right.y, direction=-1, during=one, becomes=both),
        mbd.Event("left lands too", left.y, direction=-1, during=other, becomes=both),
    ]
    for order in (events, events[::-1]):
        motion = mbd.simulate(air, np.linspace(0, 1, 21), events=order)
        v = np.sqrt(2 * G * 0.5)
        after = motion.events[-1].after
        assert after.mechanism is both
        assert abs(after[beam.omega]) < 1e-12 and abs(after[beam.vy]) < 1e-12
        for joint in (on_left, on_right):
            assert after[joint.impulse_on(beam).force[1]] == pytest.approx(v, abs=1e-7)
        assert abs(motion.final[beam.phi]) < 1e-12
    with pytest.raises(mbd.SimulationError, match="lead to different mechanisms"):
        mbd.simulate(air, np.linspace(0, 1, 21), events=events[:2])


def test_an_impact_keeps_the_angular_momentum_about_its_pin_and_takes_the_energy_of_the_jump():
    """Two links that fly are pinned at a tip: by the jump alone, whatever the motion before and after."""
    a = mbd.Body("a", mass=1.3, inertia=0.2, pose=(0, 1, 0.3))
    b = mbd.Body("b", mass=0.7, inertia=0.05, pose=(1, 1, 0.1))
    hip = mbd.Revolute("hip", a.at(0.5, 0), b.at(-0.4, 0))
    tip, place = a.at(-0.5, 0), mbd.Parameter("place", 0.0)
    pin = mbd.Revolute("pin", mbd.ground.at(place, 0), tip)
    air = mbd.Mechanism(bodies=[a, b], joints=[hip], forces=[mbd.Gravity()])
    on = air.replace(joints=[hip, pin], parameters=[place])
    lands = mbd.Event("lands", tip.y, direction=-1, becomes=on, reset={place: tip.x})
    start = [a.x == 0, a.y == 1, a.phi == 0.3, b.phi == 0.1, a.vx == 1, a.vy == 0.3, a.omega == 2, b.omega == -1]
    motion = mbd.simulate(air, np.linspace(0, 1, 21), initial=start, events=[lands])
    (event,) = motion.events
    before, after = event.state, event.after
    parts = [(a, 1.3, 0.2), (b, 0.7, 0.05)]

    def momentum(state):
        arms = [(body[0].position - tip.position, body) for body in parts]
        return sum(m * state[arm[0] * body.vy - arm[1] * body.vx] + J * state[body.omega] for arm, (body, m, J) in arms)

    def energy(velocities):
        return sum(
            m / 2 * (vx**2 + vy**2) + J / 2 * w**2 for (vx, vy, w), (_, m, J) in zip(velocities, parts, strict=True)
        )

    def rates(state):
        return np.array([[state[body.vx], state[body.vy], state[body.omega]] for body, *_ in parts])

    assert momentum(after) == pytest.approx(momentum(before), abs=1e-12)
    loss = energy(rates(before) - rates(after))  # of a plastic impact against what stands still
    assert energy(rates(before)) - energy(rates(after)) == pytest.approx(loss, abs=1e-12) and loss > 1
    i = int(np.flatnonzero(motion.t == event.t)[0])
    assert motion.energy.total[i] - motion.energy.total[i + 1] == pytest.approx(loss, abs=1e-10)


def test_restitution_takes_its_share_of_the_energy():
    """A tilted beam bounces on its ends: the work of the impulse, v⁺ = -e v⁻ where it hits, nothing along."""
    beam = mbd.Body("beam", mass=2.0, inertia=0.5, pose=(0, 0.5, 0.1))
    ends = {"left": beam.at(-1, 0), "right": beam.at(1, 0)}
    floors = {name: mbd.AbsoluteY(f"under {name}", end, 0.0) for name, end in ends.items()}
    free = mbd.Mechanism(bodies=[beam], forces=[mbd.Gravity()])
    bounces = [
        mbd.Event(name, end.y, direction=-1, becomes=free, during=free, restitution={floors[name]: 0.7})
        for name, end in ends.items()
    ]
    start = [beam.x == 0, beam.y == 0.5, beam.phi == 0.1, beam.vx == 0.2]
    motion = mbd.simulate(free, np.linspace(0, 0.6, 31), initial=start, events=bounces)
    assert {event.name for event in motion.events} == {"left", "right"} and len(motion.events) >= 3
    for event in motion.events:
        end, before, after = ends[event.name], event.state, event.after
        impulse = after[floors[event.name].impulse_on(beam).force]
        assert after[end.vy] == pytest.approx(-0.7 * before[end.vy], abs=1e-12) and abs(impulse[0]) < 1e-12
        gain = after[beam.vy] ** 2 - before[beam.vy] ** 2 + (after[beam.omega] ** 2 - before[beam.omega] ** 2) / 4
        assert gain == pytest.approx(impulse[1] * (before[end.vy] + after[end.vy]) / 2, abs=1e-12)
        assert after[beam.vx] == pytest.approx(before[beam.vx], abs=1e-13)


def test_a_level_beam_bounces_on_both_ends_at_once():
    """Both impacts are one problem: it stays level, in either order of the events."""
    beam = mbd.Body("beam", mass=2.0, inertia=0.5, pose=(0, 0.5, 0))
    ends = [beam.at(-1, 0), beam.at(1, 0)]
    floors = [mbd.AbsoluteY(f"floor {k}", end, 0.0) for k, end in enumerate(ends)]
    free = mbd.Mechanism(bodies=[beam], forces=[mbd.Gravity()])
    bounces = [
        mbd.Event(f"bounce {k}", end.y, direction=-1, becomes=free, during=free, restitution={floor: 0.7})
        for k, (end, floor) in enumerate(zip(ends, floors, strict=True))
    ]
    for order in (bounces, bounces[::-1]):
        motion = mbd.simulate(free, np.linspace(0, 0.6, 11), events=order)
        assert [event.name for event in motion.events] == [event.name for event in order]
        after = motion.events[0].after
        assert after[beam.vy] == pytest.approx(0.7 * np.sqrt(G), abs=1e-9) and abs(after[beam.omega]) < 1e-12
        for floor in floors:
            assert after[floor.impulse_on(beam).force[1]] == pytest.approx(1.7 * np.sqrt(G), abs=1e-8)


def test_redundant_rows_of_an_impact_are_reported():
    """A foot on a vertical rail is pinned: the row across is held by the rail already."""
    foot = mbd.Body("foot", mass=2.0, inertia=0.1, pose=(0, 1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, np.pi / 2), foot.at(0, 0, np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), foot.at(0, 0))
    air = mbd.Mechanism(bodies=[foot], joints=[rail], forces=[mbd.Gravity()])
    lands = mbd.Event("lands", foot.y, direction=-1, becomes=air.replace(joints=[rail, pin]))
    motion = mbd.simulate(air, np.linspace(0, 1, 11), events=[lands])
    assert any("rows of the impact are redundant; pin.x bear no impulse" in note for note in motion.statistics.notes)
    impulse = motion.events[0].after[pin.impulse_on(foot).force]
    np.testing.assert_allclose(impulse, [0, 2 * np.sqrt(2 * G)], atol=1e-7)


@pytest.mark.slow
def test_a_block_rocks_to_rest():
    """Housner's block: each impact onto the other edge leaves the same share of its rate, ever faster."""
    b, h, m = 0.2, 0.6, 3.0
    block = mbd.Body("block", mass=m, inertia=m / 3 * (b**2 + h**2), pose=(0, h, 0))
    edges = [block.at(-b, -h), block.at(b, -h)]
    pins = [mbd.Revolute(f"edge {k}", mbd.ground.at((-b, b)[k], 0), edges[k]) for k in (0, 1)]
    on = [mbd.Mechanism(bodies=[block], joints=[pin], forces=[mbd.Gravity()]) for pin in pins]
    hits = [mbd.Event(f"onto {k}", edges[k].y, direction=-1, during=on[1 - k], becomes=on[k]) for k in (0, 1)]
    share = 1 - 1.5 * b**2 / (b**2 + h**2)
    with pytest.raises(mbd.SimulationError, match="takes place ever faster.*the joint holds") as caught:
        mbd.simulate(on[0], np.linspace(0, 6, 61), initial=[block.phi == 0.15, block.omega == 0], events=hits)
    events = caught.value.partial.events
    assert len(events) > 20 and [event.name for event in events[:3]] == ["onto 1", "onto 0", "onto 1"]
    for event in events[:10]:
        assert event.after[block.omega] == pytest.approx(share * event.state[block.omega], rel=1e-9)


def test_an_event_may_lead_to_its_own_mechanism():
    """A force changes its sign at a time, or doubles at a place: the event has taken place then, once."""
    body, f = mbd.Body("body", mass=1.0, inertia=1.0), mbd.Parameter("f", 1.0)
    model = mbd.Mechanism(bodies=[body], forces=[mbd.Force("push", body.at(0, 0), (f, 0))], parameters=[f])
    turn = mbd.Event("turn", mbd.t - 0.5 + 0 * body.x, direction=1, becomes=model, during=model, reset={f: -f})
    motion = mbd.simulate(model, np.linspace(0, 1, 11), events=[turn])
    assert [event.t for event in motion.events] == [0.5] and abs(motion.final[body.vx]) < 1e-12
    double = mbd.Event("double", body.x - 0.125, direction=1, becomes=model, during=model, reset={f: 2 * f})
    motion = mbd.simulate(model, np.linspace(0, 1, 11), events=[double])
    assert len(motion.events) == 1 and motion.final[body.vx] == pytest.approx(0.5 + 2 * 0.5, abs=1e-8)


def test_what_closes_must_be_there():
    _arm, ball, _hand, held, free, _ = thrown()
    apart = held.replace(joints=[held.joint("hinge")])
    grip = mbd.Event("grip", mbd.t - 0.1, direction=1, during=apart, becomes=held)
    with pytest.raises(mbd.SimulationError, match=r"event 'grip' at t = 0\.1 s: the position of 'hand\.[xy]'"):
        mbd.simulate(apart, np.linspace(0, 0.5, 11), initial=[ball.x == 1, ball.y == 0, ball.phi == 0], events=[grip])
    comes = mbd.Event("comes", ball.y + 0.1, direction=-1, during=free, becomes=held)
    with pytest.raises(mbd.SimulationError, match="body 'arm'.*may be removed, not added"):
        mbd.simulate(free, np.linspace(0, 0.5, 11), events=[comes])


def test_a_parameter_takes_the_place_where_a_foot_lands():
    block = mbd.Body("block", mass=1.0, inertia=0.1, pose=(0, 1.0, 0), velocity=(2.0, 0, 0))
    place = mbd.Parameter("place", 0.0)
    air = mbd.Mechanism(bodies=[block], forces=[mbd.Gravity()])
    pin = mbd.Revolute("pin", mbd.ground.at(place, 0), block.at(0, 0))
    landed = mbd.Mechanism(bodies=[block], joints=[pin], forces=[mbd.Gravity()], parameters=[place])
    lands = mbd.Event("lands", block.y, direction=-1, becomes=landed, reset={place: block.x}, terminal=True)
    motion = mbd.simulate(air, np.linspace(0, 1, 21), events=[lands])
    t = np.sqrt(2 / G)
    assert motion.t[-1] == motion.t[-2] == pytest.approx(t, abs=1e-9)
    assert motion[place][-1] == pytest.approx(2 * t, abs=1e-8) and motion[place][0] == 0.0
    assert abs(motion.final[block.vx]) < 1e-12 and motion.final[place] == pytest.approx(2 * t, abs=1e-8)
    with pytest.raises(mbd.SimulationError, match=r"'pin\.x'"):
        again = mbd.Event("lands", block.y, direction=-1, becomes=landed)
        mbd.simulate(air, np.linspace(0, 1, 21), events=[again])


def test_a_reaction_that_pulls_lets_go_at_once():
    """A ball on a track that falls away: the joint would pull from the first instant on."""
    ball = mbd.Body("ball", mass=1.0, inertia=0.1, velocity=(1.0, 0, 0))
    track = mbd.Constraint("track", ball.y + 20 * ball.x**2)
    on = mbd.Mechanism(bodies=[ball], joints=[track], forces=[mbd.Gravity()])
    off = on.replace(joints=[])
    lifts = mbd.Event("lifts off", track.reaction_on(ball).force[1], direction=-1, becomes=off)
    motion = mbd.simulate(on, np.linspace(0, 0.1, 11), initial=[ball.x == 0, ball.vx == 1], events=[lifts])
    assert [e.t for e in motion.events] == [0.0]
    np.testing.assert_allclose(motion[ball.y][1:], -G * motion.t[1:] ** 2 / 2, atol=1e-9)


def test_controllers_samples_and_resets_go_on():
    """A controller is called at its own instants through a change, and holds its values across it."""
    block = mbd.Body("block", mass=1.0, inertia=0.1)
    f = mbd.Input("f")
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    one = mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Force("push", block.at(0, 0), (f, 0))], inputs=[f])
    drag = mbd.Force("drag", block.at(0, 0), (-0.5, 0))
    other = one.replace(forces=[*one.forces, drag])
    change = mbd.Event("mud", mbd.t - 0.25 + 0 * block.x, direction=1, during=one, becomes=other)
    called = []

    def answer(time, state):
        called.append(time)
        return {f: 1.0 if time < 0.35 else 2.0}

    motion = mbd.simulate(one, np.linspace(0, 0.5, 51), inputs=mbd.SampledController(answer, 0.1), events=[change])
    np.testing.assert_allclose(called, [0, 0.1, 0.2, 0.3, 0.4], atol=1e-12)
    speed = 0.25 * 1 + 0.15 * 0.5 + 0.1 * 1.5
    assert motion.final[block.vx] == pytest.approx(speed, abs=1e-8)
    samples = mbd.simulate(one, np.linspace(0, 0.5, 51), inputs={f: np.linspace(0, 1, 51)}, events=[change])
    assert samples.final[block.vx] == pytest.approx(0.25 - 0.125, abs=1e-8)
    kick = mbd.Event("kick", block.x - 0.05, direction=1, reset={block.vx: block.vx + 1})
    kicked = mbd.simulate(one, np.linspace(0, 0.5, 51), inputs={f: 1.0}, events=[change, kick])
    assert [e.name for e in kicked.events] == ["mud", "kick"]
    assert kicked.final[block.vx] == pytest.approx(0.25 + 0.125 + 1, abs=1e-7)


def test_exact_friction_in_every_phase():
    """A block slides to rest by dry friction after a second block has left it."""
    block, both, _, jump = block_and_rider()
    motion = mbd.simulate(both, np.linspace(0, 2, 101), initial=[block.vx == 2.0], events=[jump])
    stop = 2.0 / (0.2 * G)
    assert motion.final[block.vx] == pytest.approx(0, abs=1e-9)
    assert motion.final[block.x] == pytest.approx(stop, abs=1e-6)  # v² / (2 mu g) = 1 stop
    assert any("rub" in e.name for e in motion.events)


def test_events_say_what_is_wrong():
    ball = mbd.Body("ball", mass=1, inertia=1)
    free = mbd.Mechanism(bodies=[ball])
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    p = mbd.Parameter("p", 0.0)
    with pytest.raises(mbd.ModelError, match="becomes= takes a Mechanism"):
        mbd.Event("a", ball.y, becomes=ball)
    with pytest.raises(mbd.ModelError, match="during= takes"):
        mbd.Event("a", ball.y, becomes=free, during=[ball])
    with pytest.raises(mbd.ModelError, match="during= is empty"):
        mbd.Event("a", ball.y, becomes=free, during=[])
    with pytest.raises(mbd.ModelError, match="give becomes= too"):
        mbd.Event("a", ball.y, restitution={floor: 0.5})
    with pytest.raises(mbd.ModelError, match="from 0 to 1"):
        mbd.Event("a", ball.y, becomes=free, restitution={floor: 1.5})
    with pytest.raises(mbd.ModelError, match="velocities follow from the impulses"):
        mbd.Event("a", ball.y, becomes=free, reset={ball.vy: 0})
    with pytest.raises(mbd.ModelError, match="'p', which the mechanism of becomes= does not have"):
        mbd.Event("a", ball.y, becomes=free, reset={p: ball.x})
    other = mbd.Body("other", mass=1, inertia=1)
    away = mbd.Event("a", other.y, becomes=mbd.Mechanism(bodies=[ball]))
    with pytest.raises(mbd.ModelError, match="looked for in none"):
        mbd.simulate(free, duration=1.0, events=[away])
    with pytest.raises(mbd.ModelError, match="occurs twice"):
        twin = mbd.Mechanism(bodies=[mbd.Body("ball", mass=1, inertia=1)])
        mbd.simulate(free, duration=1.0, events=[mbd.Event("a", ball.y - 1, becomes=twin)])


def test_redundant_rows_of_a_later_mechanism_are_named_by_a_method_that_takes_none():
    bar = mbd.Body("bar", mass=1, inertia=0.1, pose=(0, 1.0, 0))
    fall = mbd.Mechanism(bodies=[bar], forces=[mbd.Gravity()])
    feet = [mbd.AbsoluteY(name, bar.at(x, 0), 0.0) for name, x in (("left", -0.5), ("middle", 0), ("right", 0.5))]
    standing = mbd.Mechanism(bodies=[bar], joints=feet, forces=[mbd.Gravity()])
    lands = mbd.Event("lands", bar.y, direction=-1, becomes=standing)
    given = {"initial": [bar.y == 1, bar.vy == 0, bar.x == 0, bar.vx == 1, bar.phi == 0, bar.omega == 0]}
    motion = mbd.simulate(fall, [0, 1], events=[lands], **given)
    assert motion[bar.x][-1] == pytest.approx(1, abs=1e-9) and motion[bar.y][-1] == pytest.approx(0, abs=1e-12)
    with pytest.raises(mbd.SimulationError, match="left, middle, right do") as raised:
        mbd.simulate(fall, [0, 1], events=[lands], method="dop853", **given)
    assert raised.value.partial.final.t == pytest.approx(np.sqrt(2 / G), abs=1e-9)


@pytest.mark.parametrize("method", ["idas", "dop853"])
@pytest.mark.parametrize("step", [0.3, 0.01, 0.001])
@pytest.mark.parametrize("height", [2.5, 3.5, 4.5])
def test_string_that_goes_slack_is_taut_again_at_the_end_of_a_free_flight_alone(height, step, method):
    """The string leaves its length with no speed and no acceleration: rounding there does not tighten it again."""
    stone = mbd.Body("stone", mass=1.0, inertia=0.0, pose=(0, -1, 0))
    upright, string = (
        mbd.AbsoluteAngle("upright", stone.at(0, 0)),
        mbd.Distance("s", mbd.ground.at(0, 0), stone.at(0, 0), 1),
    )
    on_string = mbd.Mechanism([stone], joints=[upright, string], forces=[mbd.Gravity()])
    flying = on_string.replace(joints=[upright])
    length = mbd.distance(mbd.ground.at(0, 0), stone.at(0, 0))
    slack = mbd.Event("slack", string.tension, direction=-1, during=on_string, becomes=flying)
    taut = mbd.Event("taut", length - 1, direction=1, during=flying, becomes=on_string)
    start = [stone.x == 0, stone.y == -1, stone.vx == np.sqrt(height * G)]
    run = mbd.simulate(on_string, np.arange(0, 1.51, step), initial=start, events=[slack, taut], method=method)
    assert [event.name for event in run.events] == ["slack", "taut"]
    up = (height - 2) / 3  # height above the pivot at which v² = g y
    x, vx, vy = np.sqrt(1 - up**2), -np.sqrt(G * up) * up, np.sqrt(G * up) * np.sqrt(1 - up**2)
    # along the flight |r|² - 1 = t³ (g² t/4 - g vy), as it starts on the circle, along its tangent
    flight = 4 * vy / G
    first, second = run.events
    assert (first.state[stone.x], first.state[stone.y]) == pytest.approx((x, up), abs=1e-7)
    assert second.t - first.t == pytest.approx(flight, abs=1e-6)
    place = np.array([x + vx * flight, up + vy * flight - G / 2 * flight**2])
    tangent, speed = np.array([-place[1], place[0]]), np.array([vx, vy - G * flight])
    after = [second.after[stone.vx], second.after[stone.vy]]
    assert after == pytest.approx(tangent * (tangent @ speed), abs=1e-6)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_body_without_inertia_that_a_change_sets_free_is_refused(method):
    """As it is if the run starts there."""
    arm = mbd.Body("arm", mass=2.0, inertia=0.3, pose=(0.5, 0, 0))
    load = mbd.Body("load", mass=0.5, inertia=0.0, pose=(1, 0, 0))
    joints = [
        mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0)),
        mbd.Weld("grip", arm.at(0.5, 0), load.at(0, 0)),
    ]
    held = mbd.Mechanism([arm, load], joints=joints, forces=[mbd.Torque("motor", arm, 40.0)])
    throw = mbd.Event("throw", arm.phi - 2, direction=1, becomes=mbd.Mechanism([load], forces=[mbd.Gravity()]))
    with pytest.raises(mbd.SingularityError, match=r"'load' has no mass or inertia in load\.phi") as refused:
        mbd.simulate(held, np.linspace(0, 2, 21), events=[throw], method=method)
    when = np.sqrt(2 * 2.0 / (40.0 / (0.3 + 2 * 0.25 + 0.5)))
    assert refused.value.time == pytest.approx(when, abs=1e-7)
    assert refused.value.partial.final[arm.phi] == pytest.approx(2.0, abs=1e-7)


def test_event_that_leads_to_the_only_mechanism_asks_for_during():
    ball = mbd.Body("ball", mass=1.0, inertia=0.1, pose=(0, 1, 0))
    falling = mbd.Mechanism([ball], forces=[mbd.Gravity()])
    bounce = mbd.Event("bounce", ball.y, direction=-1, becomes=falling)
    with pytest.raises(mbd.ModelError, match="the one to which the event leads, which during= has to name"):
        mbd.simulate(falling, duration=1.0, events=[bounce])


@pytest.mark.parametrize("method", ["idas", "dop853"])
@pytest.mark.parametrize(
    "lift, height", [(lambda t: mbd.sin(t), 2 - np.sin(2)), (lambda t: t**2, 16 / 12), (lambda t: -mbd.sin(t), 0.0)]
)
def test_a_reaction_that_grows_from_zero_lets_go(method, lift, height):
    """A floor without load at the start does not hold what is pulled off it."""
    block = mbd.Body("block", mass=1, inertia=1)
    guides = [mbd.AbsoluteX("x", block.at(0, 0)), mbd.AbsoluteAngle("angle", block.at(0, 0))]
    floor = mbd.AbsoluteY("floor", block.at(0, 0))
    free = mbd.Mechanism([block], guides, forces=[mbd.Force("lift", block.at(0, 0), (0, lift(mbd.t)))])
    lifts = mbd.Event("lifts off", floor.reaction_on(block).force[1], direction=-1, becomes=free)
    standing = free.replace(joints=[*guides, floor])
    motion = mbd.simulate(standing, np.linspace(0, 2, 11), events=[lifts], method=method)
    assert motion.final[block.y] == pytest.approx(height, abs=1e-7)


def test_a_reaction_that_jumps_below_zero_lets_go():
    """A force that a reset switches on lifts the block, and the event of the reset takes place once."""
    block, runner = mbd.Body("block", mass=1, inertia=1), mbd.Body("runner", mass=1, inertia=1, velocity=(1, 0, 0))
    guides = [mbd.AbsoluteX("x", block.at(0, 0)), mbd.AbsoluteAngle("angle", block.at(0, 0))]
    floor, on = mbd.AbsoluteY("floor", block.at(0, 0)), mbd.StateVariable("on")
    lift = mbd.Force("lift", block.at(0, 0), (0, 3 * on - 1))
    free = mbd.Mechanism([block, runner], guides, forces=[lift], states={on: 0 * mbd.t})
    lifts = mbd.Event("lifts off", floor.reaction_on(block).force[1], direction=-1, becomes=free)
    switch = mbd.Event("switch", runner.x - 0.5, direction=1, reset={on: on + 1})
    motion = mbd.simulate(free.replace(joints=[*guides, floor]), np.linspace(0, 2, 11), events=[lifts, switch])
    assert [event.name for event in motion.events] == ["switch", "lifts off"]
    assert motion.final[block.y] == pytest.approx(2 * 1.5**2 / 2, abs=1e-7)


@pytest.mark.parametrize("direction", [-1, 0])
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_impacts_of_one_kind_are_counted_by_mechanisms(direction, method):
    """A ball under a weight that falls at each impact: the second one is the next time that it gets there."""
    ball = mbd.Body("ball", mass=1.0, inertia=0.1, pose=(0, 1, 0))
    floor = mbd.AbsoluteY("floor", ball.at(0, 0), 0.0)
    falling = [mbd.Mechanism([ball], forces=[mbd.Gravity((0, -weight))]) for weight in (10.0, 5.0, 2.0)]
    bounces = [
        mbd.Event("first", ball.y, direction, during=falling[0], becomes=falling[1], restitution={floor: 0.5}),
        mbd.Event("second", 2 * ball.y, direction=-1, during=falling[1], becomes=falling[2], restitution={floor: 0.5}),
    ]
    motion = mbd.simulate(falling[0], np.linspace(0, 2, 41), events=bounces, method=method)
    first = np.sqrt(0.2)
    speed = 0.5 * 10 * first
    second = first + 2 * speed / 5
    assert [event.name for event in motion.events] == ["first", "second"]
    assert [event.t for event in motion.events] == pytest.approx([first, second], abs=1e-7)
    left = 2 - second
    assert motion.final[ball.y] == pytest.approx(0.5 * speed * left - left**2, abs=1e-6)


@pytest.mark.parametrize("value", ["much", [1.0, 2.0], None])
def test_values_of_parameters_are_read_as_in_one_mechanism(value):
    push, body = mbd.Parameter("push", 1.0), mbd.Body("body", mass=1.0, inertia=1.0)
    pushed = mbd.Mechanism([body], forces=[mbd.Force("force", body.at(0, 0), (push, 0))], parameters=[push])
    released = mbd.Event("released", body.x - 0.1, becomes=mbd.Mechanism([body]))
    with pytest.raises(mbd.ModelError, match="parameter 'push': value must be a number"):
        mbd.simulate(pushed, [0, 1], events=[released], parameters={push: value})
