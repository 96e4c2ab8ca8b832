"""Exact dry friction: stick and slip by switching, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def sledge(law, slope=0.0, mass=3.0, forces=(), **more):
    """A block on an inclined guide."""
    block = mbd.Body("block", mass=mass, inertia=0.02, pose=(0, 0, -slope))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, angle=-slope), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, law)
    own = forces(block) if callable(forces) else forces
    return block, guide, rub, mbd.Mechanism(bodies=[block], joints=[guide], forces=[mbd.Gravity(), rub, *own], **more)


def test_stops_and_stays():
    """On an incline below friction's angle: way and time to rounding, then no creep at all."""
    slope, mu, speed = np.radians(20), 0.5, 2.0
    block, guide, rub, mechanism = sledge(mbd.DryFriction(mu), slope)
    times = np.linspace(0, 3, 301)
    motion = mbd.simulate(mechanism, times, initial=[guide.displacement == 0, guide.speed == speed])
    deceleration = G * (mu * np.cos(slope) - np.sin(slope))
    (event,) = motion.events
    assert event.name == "rub stops"
    assert event.t == pytest.approx(speed / deceleration, abs=1e-10)
    np.testing.assert_array_equal(motion.t, times)
    late = motion.t > event.t
    np.testing.assert_allclose(motion[guide.displacement][late], speed**2 / 2 / deceleration, atol=1e-10)
    assert np.abs(motion[guide.speed][late]).max() < 1e-12
    np.testing.assert_allclose(motion[rub.force][late], -3 * G * np.sin(slope), rtol=1e-9)
    np.testing.assert_allclose(motion[rub.force][~late], -3 * G * mu * np.cos(slope), rtol=1e-9)
    np.testing.assert_allclose(motion[guide.reaction_on(block).force_in_joint][:, 1], 3 * G * np.cos(slope), rtol=1e-9)
    assert motion.drift.velocity < 1e-12
    # the accelerations jump at the stop, and interpolation knows
    between = motion.at([event.t - 1e-4, event.t + 1e-4])
    along = between[block.ax] * np.cos(slope) - between[block.ay] * np.sin(slope)
    np.testing.assert_allclose(along, [-deceleration, 0], atol=1e-8)


def test_does_not_hold_above_the_angle_of_friction():
    """From rest it slides where tan(slope) is above the static coefficient, and rests where it is not."""
    for slope, moves in ((0.44, False), (0.48, True)):
        _, guide, _, mechanism = sledge(mbd.DryFriction(0.4, static_coefficient=0.5), slope)
        motion = mbd.simulate(mechanism, [0, 1], initial=[guide.displacement == 0, guide.speed == 0])
        wanted = G * (np.sin(slope) - 0.4 * np.cos(slope)) / 2 if moves else 0.0
        assert motion[guide.displacement][-1] == pytest.approx(wanted, abs=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("static", [None, 0.45])
@pytest.mark.parametrize("sense", [1, -1])
def test_breaks_away(static, sense):
    """Under a growing push, when the static limit is reached."""
    _, guide, rub, mechanism = sledge(
        mbd.DryFriction(0.3, static), forces=lambda b: [mbd.Force("push", b.at(0, 0), (sense * 5 * mbd.t, 0))]
    )
    motion = mbd.simulate(mechanism, np.linspace(0, 4, 41), initial=[guide.displacement == 0, guide.speed == 0])
    (event,) = motion.events
    weight = 3 * G
    begin = (static or 0.3) * weight / 5
    assert event.name == "rub breaks away" and event.t == pytest.approx(begin, abs=1e-8)
    gone = motion.t[-1] - begin
    wanted = (((static or 0.3) - 0.3) * weight * gone + 5 * gone**2 / 2) / 3
    assert motion[guide.speed][-1] == pytest.approx(sense * wanted, abs=1e-7)
    resting = motion.t < begin
    np.testing.assert_allclose(motion[rub.force][resting], -sense * 5 * motion.t[resting], atol=1e-9)


def test_oscillator_comes_to_rest_off_centre():
    """A mass on a spring loses ``2 μ N/k`` of amplitude in each half swing, until the spring cannot move it."""
    mu, k, mass, start = 0.2, 200.0, 3.0, 0.3
    spring = lambda b: [mbd.TSDA("spring", mbd.ground.at(-2, 0), b.at(0, 0), stiffness=k, free_length=2.0)]  # noqa: E731
    _, guide, _rub, mechanism = sledge(mbd.DryFriction(mu), forces=spring)
    motion = mbd.simulate(mechanism, np.linspace(0, 4, 201), initial=[guide.displacement == start, guide.speed == 0])
    offset, turns = mu * mass * G / k, [start]
    while abs(turns[-1]) > offset:
        turns.append(-turns[-1] + 2 * offset * np.sign(turns[-1]))
    assert len(turns) > 4
    assert [e.name for e in motion.events] == ["rub stops"] * (len(turns) - 1)
    half = np.pi * np.sqrt(mass / k)
    np.testing.assert_allclose([e.t for e in motion.events], half * np.arange(1, len(turns)), atol=1e-7)
    np.testing.assert_allclose([e.state[guide.displacement] for e in motion.events], turns[1:], atol=1e-7)
    assert motion[guide.displacement][-1] == pytest.approx(turns[-1], abs=1e-7)
    energy = motion.energy.total
    assert np.diff(energy).max() < 1e-8 * energy[0]


@pytest.mark.slow
def test_stick_slip_on_a_belt():
    """Period, break-away and stop of a spring-held block on a moving belt, in closed form."""
    mass, k, speed, mu, static = 1.2, 150.0, 0.08, 0.25, 0.4
    belt = mbd.Body("belt", mass=5, inertia=1)
    block = mbd.Body("block", mass=mass, inertia=0.01)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), belt.at(0, 0))
    seat = mbd.Translational("seat", belt.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", seat, mbd.DryFriction(mu, static))
    spring = mbd.TSDA("spring", mbd.ground.at(-3, 0), block.at(0, 0), stiffness=k, free_length=3.0)
    mechanism = mbd.Mechanism(
        bodies=[belt, block],
        joints=[rail, seat],
        drivers=[mbd.Driver("run", rail.displacement, speed * mbd.t)],
        forces=[mbd.Gravity(), spring, rub],
    )
    motion = mbd.simulate(mechanism, np.linspace(0, 5, 501), initial=[block.x == 0, block.vx == speed])
    frequency, excess = np.sqrt(k / mass), (static - mu) * mass * G / k
    slip = (2 * np.pi - 2 * np.arctan(excess * frequency / speed)) / frequency
    period = slip + 2 * excess / speed
    names = [e.name for e in motion.events]
    assert names[:4] == ["rub breaks away", "rub stops", "rub breaks away", "rub stops"] and len(names) > 8
    instants = np.array([e.t for e in motion.events])
    first = static * mass * G / k / speed
    np.testing.assert_allclose(instants[0::2], first + period * np.arange(len(instants[0::2])), atol=1e-6)
    np.testing.assert_allclose(instants[1::2], first + slip + period * np.arange(len(instants[1::2])), atol=1e-6)
    assert motion[block.x].max() == pytest.approx(mu * mass * G / k + np.hypot(excess, speed / frequency), abs=1e-4)


@pytest.mark.parametrize("speed", [0.46, 0.7, -0.3])
def test_breaks_away_once_from_a_belt_under_a_push_that_grows_ever_faster(speed):
    """The block does not stop again by the rounding of its speed, which is not zero on a belt."""
    belt, block = mbd.Body("belt", mass=5, inertia=1), mbd.Body("block", mass=2, inertia=0.01)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), belt.at(0, 0))
    seat = mbd.Translational("seat", belt.at(0, 0), block.at(0, 0))
    forces = [
        mbd.Gravity(),
        mbd.JointFriction("rub", seat, mbd.DryFriction(0.25)),
        mbd.Force("push", block.at(0, 0), (-40 * mbd.t**8, 0)),
    ]
    machine = mbd.Mechanism(
        [belt, block], [rail, seat], drivers=[mbd.Driver("drive", rail.displacement, speed * mbd.t)], forces=forces
    )
    start = [seat.displacement == 0, seat.speed == 0]
    motion = mbd.simulate(machine, np.linspace(0, 1, 11), initial=start)
    begin = (0.25 * 2 * G / 40) ** (1 / 8)
    assert [event.t for event in motion.events] == pytest.approx([begin], abs=1e-9)
    t = np.maximum(motion.t, begin)
    slid = -20 * ((t**10 - begin**10) / 90 - begin**9 * (t - begin) / 9) + 0.25 * G * (t - begin) ** 2 / 2
    np.testing.assert_allclose(motion[seat.displacement], slid, atol=1e-8)


@pytest.mark.slow
def test_two_frictions():
    """A block on a sledge on the ground: the sledge is dragged or not, as the coefficients say."""
    for lower, wanted in ((0.05, 0.2 * 2 * G / 3 - 0.05 * 5 / 3 * G), (0.2, 0.0)):
        sled = mbd.Body("sled", mass=3, inertia=1)
        block = mbd.Body("block", mass=2, inertia=1, pose=(0, 0.2, 0))
        rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
        deck = mbd.Translational("deck", sled.at(0, 0.2), block.at(0, 0))
        below = mbd.JointFriction("below", rail, mbd.DryFriction(lower))
        above = mbd.JointFriction("above", deck, mbd.DryFriction(0.2))
        mechanism = mbd.Mechanism(bodies=[sled, block], joints=[rail, deck], forces=[mbd.Gravity(), below, above])
        start = [rail.displacement == 0, rail.speed == 0, deck.displacement == 0, deck.speed == 2.0]
        motion = mbd.simulate(mechanism, np.linspace(0, 6, 121), initial=start)
        assert motion[sled.ax][1] == pytest.approx(wanted, abs=1e-8)
        # they join, and where the ground brakes less than friction between them can, they stop as one
        joins = 2.0 / (0.2 * G + wanted)
        assert motion.events[0].name == "above stops" and motion.events[0].t == pytest.approx(joins, abs=1e-8)
        common = wanted * joins
        after = (motion.t > joins + 1e-9) & (motion.t < joins + common / (lower * G))
        np.testing.assert_allclose(motion[sled.vx][after], common - lower * G * (motion.t[after] - joins), atol=1e-7)
        np.testing.assert_allclose(motion[deck.speed][motion.t > joins], 0, atol=1e-9)
        assert abs(motion[sled.vx][-1]) < 1e-12


@pytest.mark.slow
def test_dry_pin_is_the_limit_of_smoothed_ones():
    """A pendulum in a rough pin: exact switching, and tanh over an ever narrower speed."""

    def run(law):
        rod = mbd.Body("rod", mass=1.5, inertia=0.08, pose=(0.4, 0, 0))
        hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.4, 0))
        bush = mbd.JointFriction("bush", hinge, law, radius=0.03)
        mechanism = mbd.Mechanism(bodies=[rod], joints=[hinge], forces=[mbd.Gravity(), bush])
        return rod, bush, mbd.simulate(mechanism, np.linspace(0, 4, 81), initial=[rod.phi == 0, rod.omega == 0])

    rod, bush, dry = run(mbd.DryFriction(0.3))
    course, torque = dry[rod.phi], dry[bush.torque]
    assert len(dry.events) >= 4
    errors = []
    for tolerance in (1e-3, 1e-5):
        rod, bush, smooth = run(mbd.Coulomb(0.3, tolerance))
        errors.append(np.abs(smooth[rod.phi] - course).max())
    assert errors[1] < 1e-4 and errors[1] < errors[0] / 20
    assert torque.min() < -0.1 < 0.1 < torque.max()


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "rosenbrock"])
@pytest.mark.parametrize("tolerance", [1e-3, 1e-5, 1e-7])
def test_smoothed_laws_meet_the_exact_one(method, tolerance):
    """A mass that swings to rest: smoothing errs by its creep alone, also where coarse tolerances are asked for."""
    motions = []
    for law in (mbd.DryFriction(0.2), mbd.Coulomb(0.2, tolerance)):
        _, guide, _, mechanism = sledge(
            law, forces=lambda b: [mbd.TSDA("s", mbd.ground.at(-2, 0), b.at(0, 0), stiffness=200, free_length=2.0)]
        )
        start = [guide.displacement == 0.3, guide.speed == 0]
        coarse = {} if isinstance(law, mbd.DryFriction) else {"reltol": 1e-6, "abstol": 1e-4}
        motion = mbd.simulate(mechanism, np.linspace(0, 2, 21), initial=start, method=method, **coarse)
        motions.append(motion[guide.displacement])
    assert np.abs(motions[1] - motions[0]).max() < 0.06 * tolerance + 2e-5


def test_with_user_events_inputs_and_states():
    """A terminal event ends it, an input pushes, a state starts it again."""
    tau = mbd.Input("tau")
    _, guide, _, mechanism = sledge(
        mbd.DryFriction(0.3), forces=lambda b: [mbd.Force("push", b.at(0, 0), (tau, 0))], inputs=[tau]
    )
    there = mbd.Event("there", guide.displacement - 1, terminal=True)
    half = mbd.Event("half", guide.displacement - 0.5)
    start = [guide.displacement == 0, guide.speed == 0]
    motion = mbd.simulate(mechanism, np.linspace(0, 5, 51), initial=start, inputs={tau: 15.0}, events=[there, half])
    pull = 15 / 3 - 0.3 * G
    assert [e.name for e in motion.events] == ["half", "there"]
    assert motion.t[-1] == pytest.approx(np.sqrt(2 / pull), abs=1e-8)
    assert motion[guide.displacement][-1] == pytest.approx(1, abs=1e-9)
    onward = mbd.simulate(mechanism, np.linspace(0, 0.5, 6), initial=motion.final)  # a state brings its inputs along
    assert onward[guide.displacement][-1] == pytest.approx(1 + np.sqrt(2 * pull) * 0.5 + pull / 8, abs=1e-7)
    rest = mbd.simulate(mechanism, np.linspace(0, 3, 31), initial=motion.final, inputs={tau: 0.0})
    assert rest[guide.displacement][-1] == pytest.approx(1 + 2 * pull / (2 * 0.3 * G), abs=1e-8)
    assert rest[guide.speed][-1] == pytest.approx(0, abs=1e-12)


def test_assembled_as_it_sticks_or_slides():
    """Accelerations and friction at the start; check counts the joints alone."""
    block, guide, rub, mechanism = sledge(
        mbd.DryFriction(0.3), forces=lambda b: [mbd.Force("push", b.at(0, 0), (6, 0))]
    )
    for speed in (0.0, 2.0, -2.0):
        state = mbd.assemble(mechanism, [guide.displacement == 0, guide.speed == speed])
        friction = -6.0 if speed == 0 else -np.sign(speed) * 0.3 * 3 * G
        assert state[rub.friction_force] == pytest.approx(friction, abs=1e-9)
        assert state[block.ax] == pytest.approx((6 + friction) / 3, abs=1e-9)
        motion = mbd.simulate(mechanism, [0, 0.1], initial=state)
        assert motion[block.ax][0] == pytest.approx(state[block.ax], abs=1e-9)
    report = mbd.check(mechanism)
    assert report.degrees_of_freedom == 1 and not report.redundant_rows
    assert mbd.check(mechanism, state).degrees_of_freedom == 1


def test_refuses():
    """Other analyses, sums, contacts, resets, samples; each says what to do."""
    block, _, _, mechanism = sledge(mbd.DryFriction(0.3))
    with pytest.raises(mbd.ModelError, match=r"'rub'.*cannot follow; take Coulomb"):
        mbd.cost_function(mechanism, [0, 1], [], terminal_cost=block.x)
    with pytest.raises(mbd.ModelError, match="added"):
        _ = mbd.DryFriction(0.3) + mbd.Viscous(1)
    with pytest.raises(mbd.ModelError, match="static_coefficient"):
        mbd.DryFriction(0.3, 0.2)
    with pytest.raises(mbd.ModelError, match="compliant"):
        mbd.Contact(
            "c",
            mbd.Circle(block.at(0, 0), 1),
            mbd.HalfPlane(mbd.ground.at(0, 0)),
            mbd.HuntCrossley(1e5),
            mbd.DryFriction(0.3),
        )
    with pytest.raises(mbd.SimulationError, match=r"'rub stops' has the name"):
        mbd.simulate(mechanism, [0, 1], events=[mbd.Event("rub stops", block.x - 1)])
    tau = mbd.Input("tau")
    _, _guide, _, mechanism = sledge(
        mbd.DryFriction(0.3), forces=lambda b: [mbd.Force("push", b.at(0, 0), (tau, 0))], inputs=[tau]
    )
    with pytest.raises(mbd.ModelError, match=r"3 samples are given for 2 times"):
        mbd.simulate(mechanism, [0, 1], inputs={tau: [1, 2, 3]})


def test_rebound_from_a_wall():
    """A sliding block is thrown back by a wall and comes to rest before it gets home."""
    mu, speed, wall, restitution = 0.2, 2.0, 0.5, 0.6
    _block, guide, _, mechanism = sledge(mbd.DryFriction(mu))
    hit = mbd.Event("hit", guide.displacement - wall, direction=1, reset={guide.speed: -restitution * guide.speed})
    start = [guide.displacement == 0, guide.speed == speed]
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 41), initial=start, events=[hit])
    arrives = np.sqrt(speed**2 - 2 * mu * G * wall)
    leaves = restitution * arrives
    first, second = (speed - arrives) / (mu * G), leaves / (mu * G)
    assert [e.name for e in motion.events] == ["hit", "rub stops"]
    np.testing.assert_allclose([e.t for e in motion.events], [first, first + second], atol=1e-8)
    event = motion.events[0]
    assert event.state[guide.speed] == pytest.approx(arrives, abs=1e-7)
    assert event.after[guide.speed] == pytest.approx(-leaves, abs=1e-7)
    assert motion[guide.displacement][-1] == pytest.approx(wall - leaves**2 / (2 * mu * G), abs=1e-7)
    assert motion[guide.speed][-1] == pytest.approx(0, abs=1e-12)


def test_a_kick_sets_a_resting_block_in_motion():
    """A clock of blows against a block that sticks: each moves it by ``v²/(2 μ g)``."""
    mu, blow = 0.3, 0.9
    _, guide, _, mechanism = sledge(mbd.DryFriction(mu, 0.5))
    kick = mbd.Event("kick", mbd.sin(2 * np.pi * (mbd.t - 0.25)), direction=1, reset={guide.speed: guide.speed + blow})
    start = [guide.displacement == 0, guide.speed == 0]
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 31), initial=start, events=[kick])
    assert [e.name for e in motion.events] == ["kick", "rub stops"] * 3
    np.testing.assert_allclose([e.t for e in motion.events[::2]], [0.25, 1.25, 2.25], atol=1e-8)
    assert motion[guide.displacement][-1] == pytest.approx(3 * blow**2 / (2 * mu * G), abs=1e-7)


def test_friction_takes_no_part_in_an_impulse():
    """A pin that sticks is no obstacle to a blow: the velocity after it is that without friction."""
    rod = mbd.Body("rod", mass=1.5, inertia=0.08)
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), rod.at(-0.4, 0))
    bush = mbd.JointFriction("bush", hinge, mbd.DryFriction(0.9), radius=0.05)
    mechanism = mbd.Mechanism([rod], [hinge], forces=[bush])
    blow = mbd.Event("blow", mbd.t - 0.1, direction=1, reset={rod.at(0.4, 0).vy: 2.0})
    motion = mbd.simulate(mechanism, np.linspace(0, 0.2, 3), initial=[hinge.angle == 0, rod.omega == 0], events=[blow])
    assert motion.events[0].after[rod.omega] == pytest.approx(2.0 / 0.8, rel=1e-12)


def test_samples_and_a_ramp():
    """A force that grows in samples: break-away at ``μ_s m g``, then ``ẍ = (F - μ m g)/m``."""
    tau, mu, static, rate = mbd.Input("tau"), 0.3, 0.4, 8.0
    _, guide, _, mechanism = sledge(
        mbd.DryFriction(mu, static), forces=lambda b: [mbd.Force("push", b.at(0, 0), (tau, 0))], inputs=[tau]
    )
    times = np.linspace(0, 2, 9)
    start = [guide.displacement == 0, guide.speed == 0]
    motion = mbd.simulate(mechanism, times, initial=start, inputs={tau: rate * times})
    mass = 3.0
    breaks = static * mass * G / rate
    (event,) = motion.events
    assert event.name == "rub breaks away" and event.t == pytest.approx(breaks, abs=1e-8)
    s = np.maximum(times - breaks, 0)
    exact = rate / mass * s**3 / 6 + (static - mu) * G * s**2 / 2
    np.testing.assert_allclose(motion[guide.displacement], exact, atol=1e-7)
    np.testing.assert_allclose(motion.inputs[:, 0], rate * times, atol=1e-12)


def test_a_controller():
    """Pushed for the first of every two periods; asked once a period, with the whole mechanism's state."""
    tau, mu, mass = mbd.Input("tau"), 0.3, 3.0
    _, guide, rub, mechanism = sledge(
        mbd.DryFriction(mu), forces=lambda b: [mbd.Force("push", b.at(0, 0), (tau, 0))], inputs=[tau]
    )
    asked = []

    def control(time, state):
        asked.append((time, state[rub.force]))
        return {tau: 15.0 if len(asked) % 2 else 0.0}

    start = [guide.displacement == 0, guide.speed == 0]
    inputs = mbd.SampledController(control, 0.5)
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 11), initial=start, inputs=inputs)
    np.testing.assert_allclose([time for time, _ in asked], [0, 0.5, 1.0, 1.5], atol=1e-12)
    pull = 15 / mass - mu * G
    speed = 0.5 * pull
    way = speed**2 / (2 * pull) + speed**2 / (2 * mu * G)
    assert speed / (mu * G) < 0.5
    assert motion[guide.displacement][-1] == pytest.approx(2 * way, abs=1e-7)
    assert [e.name for e in motion.events] == ["rub stops", "rub breaks away", "rub stops"]
    assert motion.events[1].t == pytest.approx(1.0, abs=1e-12)  # by the answer of that sample


@pytest.mark.parametrize("law", [mbd.DryFriction(0.3), mbd.Coulomb(0.3, 1e-6)], ids=["dry", "smoothed"])
def test_redundant_guides_are_told(law):
    """Friction by a load that is not unique has no answer; by a given load it has."""
    for friction, fails in ((mbd.JointFriction, True), (mbd.LoadIndependentFriction, False)):
        block = mbd.Body("block", mass=1, inertia=1)
        guides = [mbd.Translational(f"g{k}", mbd.ground.at(0, 0), block.at(0.1 * k, 0)) for k in range(2)]
        load = {} if fails else {"load": 5.0}
        rub = friction("rub", guides[0], law, **load)
        mechanism = mbd.Mechanism([block], guides, forces=[mbd.Gravity(), rub])
        start = [block.x == 0, block.vx == 1.0]
        if fails:
            told = r"'rub' depends on reactions.*LoadIndependentFriction"
            with pytest.raises(mbd.SingularityError, match=told):
                mbd.simulate(mechanism, [0, 1], initial=start)
            with pytest.raises(mbd.SingularityError, match=told):
                _ = mbd.assemble(mechanism, start)[rub.force]
        else:
            motion = mbd.simulate(mechanism, [0, 1], initial=start)
            assert motion[block.x][-1] == pytest.approx(1 / (2 * 0.3 * 5), abs=1e-5)


def test_survives_a_file(tmp_path):
    """Values at outputs, events and between outputs come back."""
    _, guide, rub, mechanism = sledge(mbd.DryFriction(0.3))
    start = [guide.displacement == 0, guide.speed == 1.0]
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 101), initial=start)
    motion.save(tmp_path / "run.npz")
    again = mbd.read_trajectory(tmp_path / "run.npz", mechanism)
    np.testing.assert_array_equal(again[rub.force], motion[rub.force])
    assert [e.name for e in again.events] == ["rub stops"]
    times = np.linspace(0, 1, 777)
    for expression in (rub.force, guide.displacement, guide.speed):
        np.testing.assert_allclose(again.at(times)[expression], motion.at(times)[expression], atol=1e-7)


def test_with_a_compliant_contact():
    """A block on a dry guide thrown against a spring-like wall: work of friction and nothing else is lost."""
    mu, speed = 0.2, 2.0
    block, guide, _rub, mechanism = sledge(mbd.DryFriction(mu))
    wall = mbd.Contact(
        "wall", mbd.Circle(block.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0.6, 0, angle=np.pi / 2)),
        mbd.HuntCrossley(1e7),
    )  # fmt: skip
    mechanism = mechanism.replace(forces=[*mechanism.forces, wall])
    start = [guide.displacement == 0, guide.speed == speed]
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 401), initial=start)
    deep = motion[guide.displacement].max() - 0.5
    way = speed**2 / (2 * mu * G)
    assert 0 < deep < 5e-3
    assert [e.name for e in motion.events][-1] == "rub stops"
    # it goes there and back as far as friction lets it; the turn is known to the depth alone
    assert motion[guide.displacement][-1] == pytest.approx(1.0 - way, abs=4 * deep)
    assert motion[guide.speed][-1] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("push", [10.0, -10.0])
def test_jamming_is_told(push):
    """A drawer whose friction grows faster than what pushes it."""
    block = mbd.Body("drawer", mass=2.0, inertia=0.1, pose=(0, -0.3, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0.3))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.4), length=0.2)
    push_it = mbd.Force("push", block.at(0, 0.3), (push, 0))
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[push_it, rub])
    with pytest.raises(mbd.MechanismError, match="jams"):
        mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=[guide.displacement == 0, guide.speed == 1.0])


@pytest.mark.parametrize("terminal", [True, False])
def test_events_at_the_instant_of_a_stop(terminal):
    """What a user looks for at the very stop takes place too."""
    mu, speed = 0.2, 3.0
    _, guide, _rub, mechanism = sledge(mbd.DryFriction(mu))
    rest = mbd.Event("rest", guide.speed, direction=-1, terminal=terminal)
    start = [guide.displacement == 0, guide.speed == speed]
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 31), initial=start, events=[rest])
    assert sorted(e.name for e in motion.events) == ["rest", "rub stops"]
    np.testing.assert_allclose([e.t for e in motion.events], speed / mu / G, rtol=1e-12)
    assert motion.t[-1] == pytest.approx(speed / mu / G if terminal else 3.0)


def slider_crank(law, torque=0.0, rubs=("guide",)):
    """A slider-crank with friction in some joints and a side load on the slider, which loads the guide."""
    crank = mbd.Body("crank", mass=0.12, inertia=1e-3, pose=(0.05, 0, 0))
    rod = mbd.Body("rod", mass=0.5, inertia=4e-3, pose=(0.25, 0, 0))
    slider = mbd.Body("slider", mass=2.0, inertia=1e-3, pose=(0.4, 0, 0))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05, 0))
    pin = mbd.Revolute("pin", crank.at(0.05, 0), rod.at(-0.15, 0))
    wrist = mbd.Revolute("wrist", rod.at(0.15, 0), slider.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))
    joints = [main, pin, wrist, guide]
    frictions = [
        mbd.JointFriction(f"rub {j.name}", j, law, **({"length": 0.1} if j is guide else {"radius": 0.01}))
        for j in joints
        if j.name in rubs
    ]
    turn = mbd.Torque("turn", crank, torque)
    forces = [mbd.Gravity(), turn, mbd.Force("side", slider.at(0, 0), (0, -20.0)), *frictions]
    return crank, frictions, mbd.Mechanism(bodies=[crank, rod, slider], joints=joints, forces=forces)


@pytest.mark.slow
@pytest.mark.parametrize("rubs", [("guide",), ("wrist",), ("main", "pin", "wrist", "guide")])
def test_turns_at_dead_centres(rubs):
    """Where the pose alone makes a joint turn, its friction changes sense and holds nothing: limit of smoothed laws."""
    times = np.linspace(0, 1, 101)
    found = []
    for law in (mbd.DryFriction(0.1), mbd.Coulomb(0.1, 1e-5)):
        crank, _, mechanism = slider_crank(law, rubs=rubs)
        tolerances = {} if law.exact else {"reltol": 1e-10, "abstol": 1e-10}
        motion = mbd.simulate(mechanism, times, initial=[crank.phi == 0.3, crank.omega == 30.0], **tolerances)
        found.append(motion[crank.phi])
        # at the end it rests, and many frictions that one motion moves do not chatter
        assert not law.exact or 3 <= sum(e.name.endswith("stops") for e in motion.events) < 20
    np.testing.assert_allclose(found[0], found[1], atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("torque", [2.0, 2.0 * mbd.t])
def test_leaves_a_dead_centre(torque):
    """At rest in a dead centre the guide neither sticks nor slides; its friction begins as the crank leaves it."""
    times = np.linspace(0, 0.6, 61)
    found = []
    for law in (mbd.DryFriction(0.2), mbd.Coulomb(0.2, 1e-6)):
        crank, (rub,), mechanism = slider_crank(law, torque)
        tolerances = {} if law.exact else {"reltol": 1e-10, "abstol": 1e-10}
        start = [crank.phi == 0, crank.omega == 0]
        motion = mbd.simulate(mechanism, times, initial=start, **tolerances)
        found.append(motion[crank.phi])
        assert motion[rub.power].max() < 1e-9 and motion[rub.power].min() < -0.1
    np.testing.assert_allclose(found[0], found[1], atol=1e-4 * np.abs(found[1]).max())


@pytest.mark.parametrize("begin", [0.0, 1e7, 1.7e9])
@pytest.mark.parametrize("late", [1e-9, 1e-7, 8e-6])
def test_a_stop_at_a_late_time(begin, late):
    """At large times an instant is known to some roundings of the time, and the speed of a stop no better."""
    block = mbd.Body("block", mass=2.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.3))
    model = mbd.Mechanism(bodies=[block], joints=[rail], forces=[rub, mbd.Gravity()])
    stop = 1.5 / (0.3 * 9.81)
    times = begin + np.linspace(0, stop + late, 5)
    motion = mbd.simulate(model, times, initial=[block.x == 0, block.vx == 1.5])
    assert np.array_equal(motion.t, times)
    assert motion.final[block.x] == pytest.approx(1.5 * stop / 2, abs=1e-6)


@pytest.mark.filterwarnings("error::mbdcasadi.MechanismWarning")
@pytest.mark.parametrize("law", [mbd.DryFriction(0.3), mbd.Coulomb(0.3, 1e-6)], ids=["exact", "smoothed"])
def test_friction_in_a_mechanism_that_is_driven_in_every_freedom(law):
    """An arm that swings as prescribed, turns back, and rests: the torque by hand, and nothing to warn of."""
    arm = mbd.Body("arm", mass=2.0, inertia=0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    swing = mbd.Driver("swing", arm.phi, mbd.if_else(mbd.t < 1, 0, 1 - mbd.cos(np.pi * (mbd.t - 1)) ** 3))
    rub = mbd.JointFriction("rub", pin, law, radius=0.05)
    model = mbd.Mechanism(bodies=[arm], joints=[pin], drivers=[swing], forces=[mbd.Gravity(), rub])
    motion = mbd.simulate(model, np.linspace(0, 4.5, 181))
    phi, omega, alpha = motion[arm.phi], motion[arm.omega], motion[arm.alpha]
    load = np.hypot(2 * motion[arm.ax], 2 * (motion[arm.ay] + G))
    torque = 0.6 * alpha + 2 * G * 0.5 * np.cos(phi) + np.sign(omega) * 0.3 * 0.05 * load
    moves = np.abs(omega) > 1e-3
    np.testing.assert_allclose(motion[swing.effort][moves], torque[moves], atol=1e-9)
    rests = motion.t < 1
    np.testing.assert_allclose(motion[swing.effort][rests], 2 * G * 0.5, atol=1e-9)
    assert moves.sum() > 120 and rests.sum() == 40


@pytest.mark.parametrize(
    "push, press, way",
    [
        (lambda t: mbd.sin(t), lambda t: 0 * t, 2 - np.sin(2)),
        (lambda t: -2 * t, lambda t: t, -(2 - 0.3) * 8 / 6),
        (lambda t: 2 * t**2, lambda t: t**2, (2 - 0.3) * 16 / 12),
        (lambda t: 0.3 * 5 + mbd.sin(t), lambda t: 5 + 0 * t, 2 - np.sin(2)),
        (lambda t: 0.3 * 5 - mbd.sin(t), lambda t: 5 + 0 * t, 0.0),
    ],
)
def test_breaks_away_from_the_limit_at_the_start(push, press, way):
    """Friction that has no load at the start, or is at its limit there, does not hold a push that grows."""
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3))
    pushed = mbd.Force("push", block.at(0, 0), (push(mbd.t), -press(mbd.t)))
    motion = mbd.simulate(mbd.Mechanism([block], joints=[guide], forces=[pushed, rub]), np.linspace(0, 2, 11))
    assert motion[block.x][-1] == pytest.approx(way, abs=1e-7)
    assert [event.t for event in motion.events] == pytest.approx([0.0] if way else [], abs=1e-8)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_brake_that_closes_from_nothing(method):
    """The load of a brake and the push grow from zero together: the wheel slips from the start."""
    wheel = mbd.Body("wheel", mass=1, inertia=0.5)
    hub = mbd.Revolute("hub", mbd.ground.at(0, 0), wheel.at(0, 0))
    brake = mbd.LoadIndependentFriction("brake", hub, mbd.DryFriction(0.4), load=10 * mbd.t, radius=0.1)
    torque = mbd.Torque("torque", wheel, mbd.t)
    motion = mbd.simulate(mbd.Mechanism([wheel], [hub], forces=[torque, brake]), np.linspace(0, 1, 6), method=method)
    assert motion[wheel.omega][-1] == pytest.approx((1 - 0.4) / 0.5 / 2, abs=1e-7)


def test_unloaded_friction_does_not_switch_by_rounding():
    """A guide that weight does not load, on a machine that is loaded: no event for two seconds."""
    table = mbd.Body("table", mass=5, inertia=1)
    part = mbd.Body("part", mass=1, inertia=0.1, pose=(0.3, 0.1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), table.at(0, 0))
    column = mbd.Translational("column", table.at(0.3, 0.1, np.pi / 2), part.at(0, 0, np.pi / 2))
    rubs = [mbd.JointFriction(f"rub of {j.name}", j, mbd.DryFriction(0.3)) for j in (rail, column)]
    crane = mbd.Force("crane", part.at(0, 0), (0, G))
    motion = mbd.simulate(mbd.Mechanism([table, part], [rail, column], forces=[mbd.Gravity(), *rubs, crane]), [0, 1, 2])
    assert motion.events == () and motion[part.y][-1] == pytest.approx(0.1, abs=1e-12)


def flat_crank(law, push, mu, in_pin, units=(1.0, 1.0, 1.0)):
    """A slider-crank without weight at rest, its crank at 0.7 rad, pushed at the slider; in units of m, kg and s."""
    length, mass, time = units
    tilt = np.arcsin(np.sin(0.7) / 3)
    reach = 0.1 * length * np.cos(0.7), 0.05 * length * np.sin(0.7), 0.3 * length * np.cos(tilt)
    crank = mbd.Body("crank", mass=0.5 * mass, inertia=1e-3 * mass * length**2, pose=(reach[0] / 2, reach[1], 0.7))
    rod_inertia = 4e-3 * mass * length**2
    rod = mbd.Body("rod", mass=0.5 * mass, inertia=rod_inertia, pose=(reach[0] + reach[2] / 2, reach[1], -tilt))
    slider = mbd.Body("slider", mass=mass, inertia=1e-3 * mass * length**2, pose=(reach[0] + reach[2], 0, 0))
    main = mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(-0.05 * length, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))
    pins = [
        mbd.Revolute("A", crank.at(0.05 * length, 0), rod.at(-0.15 * length, 0)),
        mbd.Revolute("B", rod.at(0.15 * length, 0), slider.at(0, 0)),
    ]
    force = mass * length / time**2
    pushed = mbd.Force("push", slider.at(0, 0), (force * push(mbd.t / time), 5 * force))
    rubs = [mbd.JointFriction("rub", guide, law(mu))]
    rubs += [mbd.JointFriction("rub of the pin", main, law(0.2), radius=0.01 * length)] if in_pin else []
    return crank, mbd.Mechanism([crank, rod, slider], [main, *pins, guide], forces=[pushed, *rubs])


@pytest.mark.slow
@pytest.mark.parametrize("push, rate, mu, phase", [(3, 2, 0.3, 0), (6, 4, 0.2, 0), (6, 4, 0.2, 1), (5, 1, 0.4, 0)])
@pytest.mark.parametrize("in_pin", [False, True])
def test_a_crank_that_is_pushed_out_of_rest(push, rate, mu, phase, in_pin):
    """No weight: reactions, couples and accelerations are zero, or rounding, until the push overcomes the friction."""

    def end_with(law):
        crank, machine = flat_crank(law, lambda t: push * mbd.sin(rate * t + phase), mu, in_pin)
        return mbd.simulate(machine, np.linspace(0, 1, 21))[crank.phi][-1]

    smoothed = end_with(lambda mu: mbd.Coulomb(mu, velocity_tolerance=1e-7))
    assert abs(smoothed - 0.7) > 0.1
    assert end_with(mbd.DryFriction) == pytest.approx(smoothed, abs=5e-6)


@pytest.mark.slow
@pytest.mark.parametrize("units", [(1e-6, 1e-12, 1e-3), (1e-3, 1e-6, 1.0), (1e3, 1e6, 1.0)])
def test_stick_and_slip_in_any_units(units):
    """Two frictions of one motion break away together, each in the sense in which it then slides."""

    def course(units):
        crank, machine = flat_crank(mbd.DryFriction, lambda t: 3 * mbd.sin(2 * t), 0.2, True, units)
        motion = mbd.simulate(machine, np.linspace(0, 0.3 * units[2], 7))
        return [*motion[crank.phi], *(event.t / units[2] for event in motion.events)], [e.name for e in motion.events]

    usual, scaled = course((1.0, 1.0, 1.0)), course(units)
    assert scaled[1] == usual[1] and len(usual[1]) < 4
    np.testing.assert_allclose(scaled[0], usual[0], atol=1e-6)


def test_frictions_of_one_motion_hold_up_to_the_sum_of_their_static_limits():
    """Two wheels in mesh do not move before both hubs are at their limits, although they would go on to slide."""
    wheels = [mbd.Body(name, mass=1, inertia=J, pose=(x, 0, 0)) for name, J, x in (("a", 0.02, 0.0), ("b", 0.1, 0.3))]
    hubs = [
        mbd.Revolute(f"hub of {w.name}", mbd.ground.at(x, 0), w.at(0, 0)) for w, x in zip(wheels, (0, 0.3), strict=True)
    ]
    mesh = mbd.Constraint("mesh", hubs[0].angle - hubs[1].angle)
    laws = mbd.DryFriction(0.2, static_coefficient=0.3), mbd.DryFriction(0.1, static_coefficient=0.4)
    rubs = [
        mbd.LoadIndependentFriction(f"rub of {hub.name}", hub, law, load=10, radius=0.1)
        for hub, law in zip(hubs, laws, strict=True)
    ]
    # N m: it turns round below the limit of 0.3 + 0.4, and is beyond it from -0.7 on
    torque = mbd.Torque("torque", wheels[0], 0.65 - 3 * (mbd.t - 0.5) ** 2)
    motion = mbd.simulate(mbd.Mechanism(wheels, [*hubs, mesh], forces=[torque, *rubs]), np.linspace(0, 1.4, 15))
    x, begin = motion.t - 0.5, np.sqrt(1.35 / 3)
    assert motion.events[-1].t == pytest.approx(0.5 + begin, abs=1e-9)
    late = np.maximum(x - begin, 0)
    slid = (0.95 * late**2 / 2 - ((begin + late) ** 4 - begin**4) / 4 + begin**3 * late) / 0.12
    np.testing.assert_allclose(motion[wheels[0].phi], slid, atol=1e-8)
    held = sum(motion[rub.torque] for rub in rubs)[x < begin]
    np.testing.assert_allclose(held, -(0.65 - 3 * x[x < begin] ** 2), atol=1e-9)


@pytest.mark.slow
def test_frictions_of_one_motion_leave_a_growing_push_to_those_that_are_not_at_their_limits():
    """A crank at rest with friction in every joint: the frictions do not hand over the last of the push to and fro."""

    def course(law, **options):
        crank, _, machine = slider_crank(law, torque=4 * mbd.t, rubs=("main", "pin", "wrist", "guide"))
        start = [crank.phi == 0.7, crank.omega == 0]
        motion = mbd.simulate(machine, np.linspace(0, 0.5, 11), initial=start, **options)
        return motion[crank.phi], [event.name for event in motion.events]

    angles, names = course(mbd.DryFriction(0.3))
    assert 0 < len(names) < 8 and not any("stops" in name for name in names)
    smoothed, _ = course(mbd.Coulomb(0.3, velocity_tolerance=1e-7), method="rosenbrock")
    assert smoothed[-1] > 0.75
    np.testing.assert_allclose(angles, smoothed, atol=1e-5)


@pytest.mark.parametrize("growth, way", [(0.0, 0.0), (-1.0, 0.0), (1.0, 0.1 * G * 2 + 8 / 6)])
def test_friction_at_rest_holds_a_push_at_its_limit(growth, way):
    """At the limit of rest, from which sliding would accelerate, a push that does not grow is held."""
    block = mbd.Body("block", mass=1, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.DryFriction(0.3, static_coefficient=0.4))
    push = mbd.Force("push", block.at(0, 0), (0.4 * G + growth * mbd.t, 0))
    motion = mbd.simulate(mbd.Mechanism([block], [guide], forces=[mbd.Gravity(), push, rub]), [0, 1, 2])
    assert motion[block.x][-1] == pytest.approx(way, abs=1e-7)


@pytest.mark.parametrize(
    "rub_on, method",
    [
        (lambda guide, law: mbd.JointFriction("rub", guide, law), "idas"),
        (lambda guide, law: mbd.LoadIndependentFriction("rub", guide, law, load=2 * G), "dop853"),
    ],
)
def test_a_method_is_chosen_for_exact_friction(rub_on, method):
    """By "auto": an explicit method takes no friction that depends on reactions."""
    block = mbd.Body("block", mass=2, inertia=1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    machine = mbd.Mechanism([block], [guide], forces=[mbd.Gravity(), rub_on(guide, mbd.DryFriction(0.3))])
    motion = mbd.simulate(machine, np.linspace(0, 1, 6), initial=[block.vx == 2], method="auto")
    assert motion.statistics.method == method
    assert motion[block.x][-1] == pytest.approx(2**2 / (2 * 0.3 * G), abs=1e-8)


@pytest.mark.parametrize("begin", [0.0, 1.7e9])
def test_slow_sliding_beside_a_flywheel_at_a_late_start(begin):
    """What rounding of the time hides is the block's own change of speed, not that of a wheel in rad/s²."""
    block, _, _, sliding = sledge(mbd.DryFriction(0.2))
    wheel = mbd.Body("wheel", mass=1.0, inertia=1e-3, pose=(0, 1, 0))
    hub, motor = mbd.Revolute("hub", mbd.ground.at(0, 1), wheel.at(0, 0)), mbd.Torque("motor", wheel, 100.0)
    mechanism = mbd.Mechanism([block, wheel], [*sliding.joints, hub], forces=[*sliding.forces, motor])
    start = [block.x == 0, block.vx == 0.02, wheel.phi == 0, wheel.omega == 0]
    motion = mbd.simulate(mechanism, begin + np.linspace(0, 0.02, 3), initial=start)
    assert motion.final[block.x] == pytest.approx(0.02**2 / (2 * 0.2 * 9.81), rel=1e-4)


@pytest.mark.slow
def test_frictions_that_do_not_act_on_each_other_are_decided_apart():
    """Seven blocks on rails at rest have four to the seventh choices; each breaks away by its own push."""
    blocks = [mbd.Body(f"block{k}", mass=1, inertia=1, pose=(0, k, 0)) for k in range(7)]
    rails = [mbd.Translational(f"rail{k}", mbd.ground.at(0, k), block.at(0, 0)) for k, block in enumerate(blocks)]
    rubs = [mbd.JointFriction(f"rub{k}", rail, mbd.DryFriction(0.3)) for k, rail in enumerate(rails)]
    pushes = [mbd.Force(f"push{k}", b.at(0, 0), (40 * mbd.t * (k + 1), 0)) for k, b in enumerate(blocks)]
    model = mbd.Mechanism(blocks, rails, forces=[mbd.Gravity(), *rubs, *pushes])
    motion = mbd.simulate(model, np.linspace(0, 0.08, 2))
    times = [0.3 * G / 40 / (k + 1) for k in range(7)]
    assert [event.name for event in motion.events] == [f"rub{k} breaks away" for k in range(6, -1, -1)]
    np.testing.assert_allclose([event.t for event in motion.events], times[::-1], atol=1e-10)
