"""Cables over pulleys against closed forms and independent geometry: tackles, drums, wheels, capstans, bearings."""

import numpy as np
import pytest

import mbdcasadi as mbd

G, UP = 9.81, np.pi / 2


def weight(name, mass, x, y):
    body = mbd.Body(name, mass=mass, inertia=1.0, pose=(x, y, 0))
    return body, mbd.Translational(f"{name} guide", mbd.ground.at(x, 0, UP), body.at(0, 0, UP))


# --- geometry ---------------------------------------------------------------------------------------------------
def length_of_way(ends, circles, angles):
    """Length of a way that follows each circle (centre, radius, sense) from an angle on, over a sweep."""
    places, total = [ends[0]], 0.0
    for (centre, radius, sense), (start, sweep) in zip(circles, np.reshape(angles, (-1, 2)), strict=True):
        for angle in (start, start + sense * sweep):
            places.append(centre + radius * np.array([np.cos(angle), np.sin(angle)]))
        total += radius * sweep
    places.append(ends[1])
    return total + sum(np.hypot(*(places[k + 1] - places[k])) for k in range(0, len(places) - 1, 2))


@pytest.mark.parametrize("seed", range(3))
def test_length_is_stationary_over_the_places_of_contact(seed):
    """Tangents make the length of a way over two circles stationary over where it touches them."""
    rng = np.random.default_rng(seed)
    a, b = mbd.Body("a", 1, 1, pose=(-1, rng.uniform(-1, -0.5), 0)), mbd.Body("b", 1, 1, pose=(2.5, -1, 0))
    radii = rng.uniform(0.1, 0.3, 2)
    centres = np.array([[0, 0.5], [1.5, 0.2]]) + rng.uniform(-0.1, 0.1, (2, 2))
    over = [mbd.Pulley(mbd.ground.at(*c), r, "clockwise") for c, r in zip(centres, radii, strict=True)]
    cable = mbd.Cable("cable", a.at(0, 0), b.at(0, 0), over=over)
    state = mbd.assemble(mbd.Mechanism([a, b], joints=[cable]))
    ends = a.pose_estimate[:2], b.pose_estimate[:2]
    circles = [(c, r, -1) for c, r in zip(centres, radii, strict=True)]
    angles = []
    for k, centre in enumerate(centres):
        touch = state[cable.path.strands[k].end] - centre
        angles += [np.arctan2(touch[1], touch[0]), state[cable.path.wraps[k + 1]]]
    assert state[cable.path.sections[0]] == pytest.approx(length_of_way(ends, circles, angles), rel=1e-12)
    lengths = [[length_of_way(ends, circles, angles + s * d) for s in (1, -1)] for d in 1e-6 * np.eye(4)]
    np.testing.assert_allclose(np.diff(lengths) / 2e-6, 0, atol=1e-8)


def test_a_wrap_of_several_turns():
    """Whole turns are added to the turn from strand to strand."""
    a = mbd.Body("a", 1, 1, pose=(-0.1, -1, 0))
    for turns in (0, 1, 3):
        post = mbd.Pulley(mbd.ground.at(0, 0), 0.1, "clockwise", turns=turns)
        cable = mbd.Cable("cable", a.at(0, 0), mbd.ground.at(0.1, -1), over=[post])
        state = mbd.assemble(mbd.Mechanism([a], joints=[cable]))
        assert state[cable.path.wraps[1]] == pytest.approx(np.pi + 2 * np.pi * turns)
        assert state[cable.path.sections[0]] == pytest.approx(2 + 0.1 * np.pi * (1 + 2 * turns))


# --- motion -------------------------------------------------------------------------------------------------------
@pytest.mark.parametrize("grips", [True, False])
def test_atwood(grips):
    """A wheel that grips is turned; over one that does not the rope runs freely. The bearing carries both strands."""
    m1, m2, inertia, r = 3.0, 2.0, 0.02, 0.1
    (first, guide_1), (second, guide_2) = weight("first", m1, -r, -1), weight("second", m2, r, -1)
    wheel = mbd.Body("wheel", mass=1.0, inertia=inertia)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    pulley = mbd.Pulley(wheel.at(0, 0), r, "clockwise", grips=grips)
    rope = mbd.Cable("rope", first.at(0, 0), second.at(0, 0), over=[pulley])
    model = mbd.Mechanism([first, second, wheel], joints=[guide_1, guide_2, axle, rope], forces=[mbd.Gravity()])
    fall = mbd.simulate(model, np.linspace(0, 0.5, 11))
    a = (m1 - m2) * G / (m1 + m2 + (inertia / r**2 if grips else 0))
    tensions = [m1 * (G - a), m2 * (G + a)]
    np.testing.assert_allclose(fall[first.y], -1 - a * fall.t**2 / 2, atol=1e-8)
    np.testing.assert_allclose(fall[rope.tensions], np.tile(tensions, (11, 1)), atol=1e-6)
    np.testing.assert_allclose(fall[axle.reaction_on(wheel).force], np.tile([0, G + sum(tensions)], (11, 1)), atol=1e-6)
    assert fall[wheel.omega][-1] == pytest.approx(a * 0.5 / r if grips else 0.0, abs=1e-7)


def test_a_winch_takes_up_many_turns():
    """Ten turns of the drum lift a load in two strands, the crossed one √(d² - (r + s)²); both give the effort."""
    load, guide = weight("load", 4.0, 0.35, -5)
    drum = mbd.Body("drum", mass=1.0, inertia=0.1)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), drum.at(0, 0))
    block = mbd.Pulley(load.at(0, 0), 0.125, "counter-clockwise")
    cable = mbd.Cable("cable", mbd.Drum(drum.at(0, 0), 0.1, "clockwise"), mbd.ground.at(0.475, 0), over=[block])
    turn = mbd.Driver("turn", bearing.angle, 20 * np.pi * mbd.step(mbd.t, 0, 0, 2, 1))
    model = mbd.Mechanism([drum, load], joints=[bearing, guide, cable], drivers=[turn], forces=[mbd.Gravity()])
    motion = mbd.inverse_dynamics(model, np.linspace(0, 3, 31))
    assert motion[bearing.angle][-1] == pytest.approx(20 * np.pi)
    crossed = np.sqrt(0.35**2 + motion[load.y] ** 2 - 0.225**2)
    np.testing.assert_allclose(motion[cable.path.strands[0].length], crossed, rtol=1e-12)
    assert np.ptp(motion[cable.path.sections[0]]) < 1e-10
    direction = motion[cable.path.strands[0].direction][-1]
    assert motion[turn.effort][-1] == pytest.approx(0.1 * 4 * G / (1 - direction[1]), rel=1e-9)


# --- friction on a post ---------------------------------------------------------------------------------------------
def capstan(m1, m2, law, turns=0):
    first, guide_1 = weight("first", m1, -0.1, -1)
    second, guide_2 = weight("second", m2, 0.1, -1)
    post = mbd.Pulley(mbd.ground.at(0, 0), 0.1, "clockwise", friction=law, turns=turns)
    cable = mbd.Cable("cable", first.at(0, 0), second.at(0, 0), over=[post])
    return first, cable, mbd.Mechanism([first, second], joints=[guide_1, guide_2, cable], forces=[mbd.Gravity()])


@pytest.mark.parametrize(("m1", "m2"), [(6.0, 2.0), (2.0, 6.0)])
@pytest.mark.parametrize("law", [mbd.DryFriction(0.3), mbd.Coulomb(0.3, 1e-5)])
def test_it_slips_by_eulers_law(m1, m2, law):
    """The tension of the heavy side is exp(μ θ) times that of the light side, in both senses."""
    first, cable, model = capstan(m1, m2, law)
    slid = mbd.simulate(model, np.linspace(0, 0.3, 31))
    heavy, light, e = max(m1, m2), min(m1, m2), np.exp(0.3 * np.pi)
    assert abs(slid[first.ay][-1]) == pytest.approx(G * (heavy - light * e) / (heavy + light * e), abs=1e-6)
    tensions = np.sort(slid[cable.tensions][-1])
    assert tensions[1] / tensions[0] == pytest.approx(e, rel=1e-6)
    assert abs(slid[cable.friction_force][-1]) == pytest.approx(tensions[1] - tensions[0])


@pytest.mark.parametrize("turns", [0, 3])
def test_it_holds_up_to_eulers_ratio_and_then_breaks_away(turns):
    """A load that grows slips when it is exp(μ_s θ) times the other; three more turns hold it."""
    first, _, model = capstan(2.0, 2.0, mbd.DryFriction(0.1, static_coefficient=0.12), turns)
    model = model.replace(forces=[*model.forces, mbd.Force("grows", first.at(0, 0), (0, -10 * mbd.t))])
    run = mbd.simulate(model, np.linspace(0, 1.5, 31))
    if turns:
        assert not run.events and np.ptp(run[first.y]) < 1e-12
        return
    (event,) = run.events
    assert event.name == "cable breaks away"
    assert event.t == pytest.approx((np.exp(0.12 * np.pi) - 1) * 2 * G / 10, abs=1e-8)
    assert np.ptp(run[first.y][run.t < event.t]) < 1e-12 and run[first.vy][-1] < -0.1


def tackle(law):
    """A load in two falls: a rope held by a force runs over a wheel at the top and one in the block, and ends above."""
    load, guide = weight("load", 8.0, 0, -2)
    hand, guide_h = weight("hand", 1.0, -0.3, -1)
    over = [
        mbd.Pulley(mbd.ground.at(-0.2, 0), 0.1, "clockwise", friction=law),
        mbd.Pulley(load.at(0, 0), 0.1, "counter-clockwise", friction=law),
    ]
    rope = mbd.Cable("rope", hand.at(0, 0), mbd.ground.at(0.1, 0), over=over)
    pull = mbd.Input("pull", value=3.0 * G)
    force = mbd.Force("pull", hand.at(0, 0), (0, -pull))
    return (
        load,
        rope,
        pull,
        mbd.Mechanism([load, hand], [guide, guide_h, rope], forces=[mbd.Gravity(), force], inputs=[pull]),
    )


def test_each_pulley_of_a_tackle_takes_its_part():
    """With ``e = exp(μ π)`` the falls carry ``T/e + T/e²`` while the load rises, and ``T e + T e²`` while it sinks."""
    load, rope, pull, model = tackle(mbd.DryFriction(0.1))
    e = np.exp(0.1 * np.pi)
    found = mbd.holding_range(model, pull)
    assert found.greatest == pytest.approx(8 * G / (1 / e + 1 / e**2) - G, rel=1e-9)
    assert found.least == pytest.approx(8 * G / (e + e**2) - G, rel=1e-9)
    with pytest.raises(
        mbd.EquilibriumError, match=r"cable 'rope' on the pulley on '(ground' \(rope\.0|load' \(rope\.1)\)"
    ):
        mbd.equilibrium(model, inputs={pull: 1.01 * found.greatest})
    for law in (mbd.DryFriction(0.1), mbd.Coulomb(0.1, 1e-6)):
        load, rope, pull, model = tackle(law)
        for value, share in ((1.2 * found.greatest, 1 / e + 1 / e**2), (0.8 * found.least, e + e**2)):
            run = mbd.simulate(model, np.linspace(0, 0.1, 3), inputs={pull: value})
            by_hand = ((value + G) * share - 8 * G) / (8 + 2 * share)
            assert run.final[load.ay] == pytest.approx(by_hand, rel=1e-4 if law.exact is False else 1e-8)
            ratios = run.final[rope.tensions][1:] / run.final[rope.tensions][:-1]
            np.testing.assert_allclose(ratios, e if by_hand < 0 else 1 / e, rtol=1e-5)


@pytest.mark.slow
def test_it_breaks_away_where_all_its_pulleys_are_at_their_limits():
    """A pull that grows holds up to the static limit of both pulleys together, and the rope stops again."""
    load, _, pull, model = tackle(mbd.DryFriction(0.1, static_coefficient=0.12))
    e = np.exp(0.12 * np.pi)
    run = mbd.simulate(model, np.linspace(0, 1.6, 17), inputs={pull: 3 * G + 20 * mbd.t})
    limit = 8 * G / (1 / e + 1 / e**2) - G
    (event,) = run.events
    assert event.name.endswith("breaks away") and event.t == pytest.approx((limit - 3 * G) / 20, abs=1e-8)
    assert np.ptp(run[load.y][run.t < event.t]) < 1e-12
    rest = mbd.simulate(model, np.linspace(0, 0.5, 11), initial=[load.vy == 0.2], inputs={pull: 3 * G})
    assert {event.name for event in rest.events} == {"rope.0 stops", "rope.1 stops"} and abs(
        rest.final[load.vy]
    ) < 1e-12


def test_it_slips_on_one_pulley_and_sticks_on_another():
    """A load on a free pulley between two posts draws the rope over one of them, ``T = T_1 exp(μ π)``."""
    light, guide_1 = weight("light", 1.0, -0.4, -1)
    load, guide_2 = weight("load", 5.0, 0, -2)
    heavy, guide_3 = weight("heavy", 2.0, 0.4, -1)
    law = mbd.DryFriction(0.2)
    over = [
        mbd.Pulley(mbd.ground.at(-0.25, 0), 0.15, "clockwise", friction=law),
        mbd.Pulley(load.at(0, 0), 0.1, "counter-clockwise"),
        mbd.Pulley(mbd.ground.at(0.25, 0), 0.15, "clockwise", friction=mbd.DryFriction(0.3)),
    ]
    rope = mbd.Cable("rope", light.at(0, 0), heavy.at(0, 0), over=over)
    model = mbd.Mechanism([light, load, heavy], [guide_1, guide_2, guide_3, rope], forces=[mbd.Gravity()])
    run, e = mbd.simulate(model, np.linspace(0, 0.4, 5)), np.exp(0.2 * np.pi)
    a = G * (5 - 2 * e) / (5 + 4 * e)
    np.testing.assert_allclose(run[load.y], -2 - a * run.t**2 / 2, atol=1e-9)
    assert np.ptp(run[heavy.y]) < 1e-12
    np.testing.assert_allclose(run.final[rope.sliding_speed], [-2 * a * 0.4, 0], atol=1e-9)
    first, middle = G + 2 * a, 5 * (G - a) / 2
    np.testing.assert_allclose(run.final[rope.tensions], [first, middle, middle, 2 * G], rtol=1e-9)
    np.testing.assert_allclose(run.final[rope.friction_force], [middle - first, 2 * G - middle], rtol=1e-9)


def test_exact_and_smoothed_laws_of_one_rope():
    """One pulley rubs exactly, the other by a smoothed law, in both senses."""
    for sign in (1, -1):
        (first, guide_1), (second, guide_2) = weight("first", 4.0 + 3 * sign, -0.2, -1), weight("second", 4.0, 0.2, -1)
        laws = mbd.DryFriction(0.1), mbd.Coulomb(0.05, 1e-6)
        over = [
            mbd.Pulley(mbd.ground.at(x, 0), 0.1, "clockwise", friction=law)
            for x, law in zip((-0.1, 0.1), laws, strict=True)
        ]
        rope = mbd.Cable("rope", first.at(0, 0), second.at(0, 0), over=over)
        model = mbd.Mechanism([first, second], [guide_1, guide_2, rope], forces=[mbd.Gravity()])
        final = mbd.simulate(model, np.linspace(0, 0.1, 3)).final
        ratios = final[rope.tensions][1:] / final[rope.tensions][:-1]
        np.testing.assert_allclose(ratios, np.exp(-sign * np.array([0.1, 0.05]) * np.pi / 2), rtol=1e-4)


def test_it_comes_to_rest_and_its_energy_is_that_of_friction():
    """Set in motion against friction, a weight stops and stays; what is lost is the work of the friction."""
    first, cable, model = capstan(2.5, 2.0, mbd.DryFriction(0.3))
    run = mbd.simulate(model, np.linspace(0, 1, 401), initial=[first.vy == -1.0])
    assert [event.name for event in run.events] == ["cable stops"]
    rub = run[cable.friction_force * cable.sliding_speed]
    lost = np.sum((rub[1:] + rub[:-1]) / 2 * np.diff(run.t))
    assert lost == pytest.approx(run.energy.total[-1] - run.energy.total[0], abs=2e-2) and np.all(rub < 1e-9)
    np.testing.assert_allclose(run[first.vy][run.t > run.events[0].t], 0, atol=1e-12)


def test_reactions_hold_the_friction():
    """The cable pulls a weight with the tension of its strand, and the post with both, by exact and smoothed laws."""
    for law in (mbd.DryFriction(0.3), mbd.Coulomb(0.3, 1e-5)):
        first, cable, model = capstan(6.0, 2.0, law)
        run = mbd.simulate(model, np.linspace(0, 0.1, 3))
        tensions = run[cable.tensions]
        np.testing.assert_allclose(run[cable.reaction_on(first).force][:, 1], tensions[:, 0], rtol=1e-9)
        np.testing.assert_allclose(run[cable.reaction_on(mbd.ground).force][:, 1], -tensions.sum(axis=1), rtol=1e-9)
        np.testing.assert_allclose(run[mbd.shaking_force(model).force][:, 1], -tensions.sum(axis=1), rtol=1e-9)


# --- how far it counts turns ------------------------------------------------------------------------------------
@pytest.mark.parametrize("elastic", [False, True])
@pytest.mark.parametrize("sense", [1, -1])
def test_a_strand_turns_by_up_to_135_degrees(elastic, sense):
    """A ball that flies round a fixed drum winds up the involute, and an error says where turns are not counted."""
    ball = mbd.Body("ball", 1.0, 0.01, pose=(2.0, 0.1, 0))
    post = mbd.Drum(mbd.ground.at(0, 0), 0.1, "clockwise")
    if elastic:
        rope = mbd.Rope("rope", post, ball.at(0, 0), 2.0, 1e5)
    else:
        rope = mbd.Cable("rope", post, ball.at(0, 0))
    model = mbd.Mechanism([ball], **{"forces" if elastic else "joints": [rope]})
    with pytest.raises(
        mbd.SimulationError, match=r"'?rope'? is not finite there:.*turned by more than 135°"
    ) as stopped:
        mbd.simulate(model, np.linspace(0, 4, 81), initial=[ball.vx == 0, ball.vy == sense * 4.0, ball.omega == 0])
    run = stopped.value.partial
    strand = rope.path.strands[0]
    angle = np.arctan2(*run[strand.direction].T[::-1])
    assert abs(angle[-1]) == pytest.approx(np.radians(135), abs=0.15)
    np.testing.assert_allclose(run[strand.length], 2 + 0.1 * angle, atol=3e-4 if elastic else 1e-9)
    np.testing.assert_allclose(np.hypot(run[ball.vx], run[ball.vy]), 4.0, atol=3e-3 if elastic else 1e-6)


def test_length_holds_when_a_parameter_moves_a_drum():
    """What has wound up counts from the estimated poses of the values that parameters have."""
    height = mbd.Parameter("height", 0.0)
    load = mbd.Body("load", 1.0, 1.0, pose=(1.0, 0, 0))
    cable = mbd.Cable("cable", mbd.Drum(mbd.ground.at(0, height), 0.1, "clockwise"), load.at(0, 0), length=1.2)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), load.at(0, 0))
    model = mbd.Mechanism([load], joints=[guide, cable], parameters=[height])
    for value in (0.0, 0.5):
        state = mbd.assemble(model, parameters={height: value})
        strand = cable.path.strands[0]
        angles = [np.arctan2(*np.ravel(d)[::-1]) for d in (state[strand.direction], direction(1.0, -value, 0.1))]
        assert state[strand.length] - 0.1 * (angles[0] - angles[1]) == pytest.approx(1.2, abs=1e-9)


def test_a_winch_on_an_arm_turns_with_it():
    """A winch on an arm that turns by two turns: relative to the arm nothing turns but the drum, which lets out."""
    arm, drum, slider = (mbd.Body(name, 1.0, 0.1, pose=pose) for name, pose in ARM.items())
    turn, slow = 2 * np.pi * mbd.t, 0.5 * mbd.t
    joints = [
        mbd.Revolute("hub", mbd.ground.at(0, 0), arm.at(0, 0)),
        mbd.Revolute("bearing", arm.at(0.2, 0), drum.at(0, 0)),
        mbd.Translational("guide", arm.at(0, 0), slider.at(0, 0)),
        mbd.Cable("cable", mbd.Drum(drum.at(0, 0), 0.1, "clockwise", carrier=arm), slider.at(0, 0)),
    ]
    drives = [mbd.Driver("turn", arm.phi, turn), mbd.Driver("slow", drum.phi, turn - slow)]
    motion = mbd.kinematics(mbd.Mechanism([arm, drum, slider], joints, drivers=drives), np.linspace(0, 2, 41))
    way = np.hypot(motion[slider.x], motion[slider.y]) - 1.0
    # along the tangent from the drum: the strand is longer by what the drum has let out
    began, strand = np.sqrt(0.8**2 - 0.1**2), np.sqrt((0.8 + way) ** 2 - 0.1**2)
    bent = np.arcsin(0.1 / 0.8) - np.arcsin(0.1 / (0.8 + way))
    np.testing.assert_allclose(strand - began - 0.1 * bent, 0.05 * motion.t, atol=1e-9)
    with pytest.raises(mbd.ModelError, match="carrier= is for a pulley that grips"):
        mbd.Pulley(mbd.ground.at(0, 0), 0.1, "clockwise", carrier=arm)


ARM = {"arm": (0, 0, 0), "drum": (0.2, 0, 0), "slider": (1.0, 0, 0)}


@pytest.mark.parametrize("grips", [False, True])
def test_its_length_holds_wraps_on_pulleys_that_grip_too(grips):
    """Half a turn round a wheel of 0.1 m between strands of 1 m and 2 m."""
    load, wheel = mbd.Body("load", 1.0, 1.0, pose=(0.1, -2.0, 0)), mbd.Body("wheel", 1.0, 0.01)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0.1, 0, np.pi / 2), load.at(0, 0, np.pi / 2))
    over = [mbd.Pulley(wheel.at(0, 0), 0.1, "clockwise", grips=grips)]
    cable = mbd.Cable("cable", mbd.ground.at(-0.1, -1), load.at(0, 0), over, length=3 + 0.1 * np.pi)
    model = mbd.Mechanism([load, wheel], [axle, guide, cable])
    state = mbd.assemble(model, () if grips else [wheel.phi == 0])
    assert state[load.y] == pytest.approx(-2.0, abs=1e-12) and state[wheel.phi] == pytest.approx(0.0, abs=1e-12)


def direction(x, y, r):
    """Direction of the tangent from a clockwise circle about the origin to a point."""
    turn = np.arctan2(y, x) - np.arcsin(r / np.hypot(x, y))
    return np.array([np.cos(turn), np.sin(turn)])


# --- said by name ---------------------------------------------------------------------------------------------------
def test_what_is_wrong_is_named():
    body = mbd.Body("body", 1, 1, pose=(0, -1, 0))
    here, there = body.at(0, 0), mbd.ground.at(0, 0)

    def post(x, friction=None):
        return mbd.Pulley(mbd.ground.at(x, 1), 0.1, "clockwise", friction=friction)

    with pytest.raises(mbd.ModelError, match="turn must be one of"):
        mbd.Pulley(there, 0.1, "left")
    with pytest.raises(mbd.ModelError, match="radius must be above 0"):
        mbd.Pulley(there, 0.0, "clockwise")
    with pytest.raises(mbd.ModelError, match="not both"):
        mbd.Pulley(there, 0.1, "clockwise", grips=True, friction=mbd.DryFriction(0.1))
    with pytest.raises(mbd.ModelError, match="takes Pulley objects"):
        mbd.Cable("cable", here, there, over=[there])
    with pytest.raises(mbd.ModelError, match="cable 'cable'.*no tangent"):
        mbd.Cable("cable", here, mbd.ground.at(1, 0), over=[mbd.Pulley(mbd.ground.at(0, -0.9), 0.2, "clockwise")])
    with pytest.raises(mbd.ModelError, match="not proportional to the load"):
        mbd.Cable("cable", here, there, over=[post(1, mbd.Viscous(1))])
    with pytest.raises(mbd.ModelError, match="itself"):
        mbd.Cable("cable", mbd.ground.at(1, 0), there)


def test_friction_that_is_not_there_is_refused():
    cable = mbd.Cable("cable", mbd.ground.at(0, 0), mbd.Body("load", 1, 1, pose=(1, 0, 0)).at(0, 0))
    for name in ("friction_force", "sliding_speed"):
        with pytest.raises(mbd.ModelError, match="rubs on no pulley"):
            getattr(cable, name)


def test_a_cable_that_would_push_is_reported():
    body, guide = weight("body", 1.0, 0, 1)
    cable = mbd.Cable("cable", mbd.ground.at(0, 0), body.at(0, 0))
    with pytest.warns(mbd.MechanismWarning, match="would have to push"):
        mbd.simulate(mbd.Mechanism([body], joints=[guide, cable], forces=[mbd.Gravity()]), np.linspace(0, 0.1, 3))
