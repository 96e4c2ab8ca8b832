"""Derivatives through the switches of dry friction and rigid contacts: by hand, and against differences of runs."""

import numpy as np
import pytest
from scipy.optimize import brentq

import mbdcasadi as mbd

G = 9.81
H, E, MU, SPEED = (mbd.Parameter(name, x) for name, x in (("h", 1.0), ("e", 0.7), ("mu", 0.3), ("speed", 2.0)))


def sliding_block(law):
    block = mbd.Body("block", mass=2, inertia=0.1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", rail, law)
    return mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), rub], parameters=[MU, SPEED]), block, rub


def test_a_block_that_slides_to_rest():
    """``x = v²/(2 μ g)``, ``t = v/(μ g)``."""
    mechanism, block, rub = sliding_block(mbd.DryFriction(MU))
    outputs, initial = [block.x, block.vx, rub.friction_force], [block.x == 0, block.vx == SPEED]
    found = mbd.sensitivities(mechanism, [0, 0.3, 1], outputs, [MU, SPEED], initial=initial)
    assert found[block.x, MU][-1] == pytest.approx(-(2**2) / (2 * 0.3**2 * G), rel=1e-8)
    assert found[block.x, SPEED][-1] == pytest.approx(2 / (0.3 * G), rel=1e-8)
    assert found[block.vx, MU][1] == pytest.approx(-0.3 * G) and abs(found[block.vx, MU][-1]) < 1e-12
    assert found[rub.friction_force, MU][[1, -1]] == pytest.approx([-2 * G, 0], abs=1e-12)
    (stops,) = found.events
    assert stops.name == "rub stops" and stops.time(MU) == pytest.approx(-2 / (0.3**2 * G), rel=1e-8)


def test_an_input_may_be_a_parameter():
    """``x = (F/m - μ g) t²/2`` of a block that is pulled from rest."""
    block, pull, force = mbd.Body("block", mass=2, inertia=0.1), mbd.Input("pull"), mbd.Parameter("force", 20.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    forces = [
        mbd.Gravity(),
        mbd.JointFriction("rub", rail, mbd.DryFriction(0.3)),
        mbd.Force("f", block.at(0, 0), (pull, 0)),
    ]
    mechanism = mbd.Mechanism([block], [rail], forces=forces, inputs=[pull], parameters=[force])
    found = mbd.sensitivities(mechanism, [0, 0.5], [block.x], [force], inputs={pull: force})
    assert found[block.x, force][-1] == pytest.approx(0.5**2 / 4, rel=1e-8)


def test_a_start_that_sticks_by_the_values_given_has_no_derivative():
    mechanism, block, _ = sliding_block(mbd.DryFriction(MU))
    with pytest.raises(mbd.SimulationError, match="'rub' would not stick or touch at the start"):
        mbd.sensitivities(mechanism, [0, 1], [block.x], [SPEED], initial=[block.vx == SPEED - 2])


def ball_on_floor(friction=None):
    ball = mbd.Body("ball", mass=0.6, inertia=2.4e-3, pose=(0, 1.1, 0))
    outlines = mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.RigidContact("floor", *outlines, friction=friction, restitution=E)
    return mbd.Mechanism([ball], forces=[mbd.Gravity(), floor], parameters=[H, E, MU, SPEED]), ball


def test_the_height_of_a_bounce():
    """``y = e² h``, and the impulse takes the speed ``(1 + e) √(2 g h)``."""
    mechanism, ball = ball_on_floor()
    top = mbd.Event("top", ball.vy, direction=-1, terminal=True)
    outputs = [ball.y, ball.vy]
    found = mbd.sensitivities(mechanism, [0, 0.5, 1], outputs, [E, H], initial=[ball.y == 0.1 + H], events=[top])
    touches, end = found.events
    assert end[ball.y, E] == pytest.approx(2 * 0.7, rel=1e-8) and end[ball.y, H] == pytest.approx(0.49, rel=1e-8)
    fall = np.sqrt(2 * G)
    assert (touches[ball.vy, H], touches.after[ball.vy, H]) == pytest.approx((-fall / 2, 0.7 * fall / 2), rel=1e-8)
    assert touches.after[ball.vy, E] == pytest.approx(fall) and touches.time(H) == pytest.approx(1 / fall)


@pytest.mark.slow
def test_a_ball_with_spin_bounces_until_it_rolls():
    """Against differences: bounces that end at rest, with impulses that slide first and stick then."""
    mechanism, ball = ball_on_floor(mbd.DryFriction(MU))
    initial = [ball.x == 0, ball.y == 0.1 + H, ball.vx == SPEED, ball.vy == 0, ball.omega == 40]
    values, outputs = {E: 0.1}, [ball.x, ball.vx, ball.omega]
    found = mbd.sensitivities(mechanism, [0, 0.8], outputs, [H, MU, SPEED], initial=initial, parameters=values)
    assert len(found.events) > 3
    low, high = (
        mbd.simulate(mechanism, [0, 0.8], initial=initial, parameters=values | {MU: 0.3 + x}) for x in (-1e-4, 1e-4)
    )
    for output in outputs:
        by_differences = (high.final[output] - low.final[output]) / 2e-4
        assert found[output, MU][-1] == pytest.approx(by_differences, rel=1e-5, abs=1e-6)
    assert found[ball.vx, SPEED][-1] == pytest.approx(1 / (1 + 2.4e-3 / (0.6 * 0.1**2)), rel=1e-6)


def box_on_floor():
    box = mbd.Body("box", mass=3, inertia=0.1, pose=(0, 0.2, 0))
    edges = mbd.PolygonEdges(box.at(0, 0), [(-0.3, -0.2), (0.3, -0.2), (0.3, 0.2), (-0.3, 0.2)])
    floor = mbd.RigidContact("floor", edges, mbd.HalfPlane(mbd.ground.at(0, 0)), friction=mbd.DryFriction(MU))
    return mbd.Mechanism([box], forces=[mbd.Gravity(), floor], parameters=[H, MU, SPEED]), box


@pytest.mark.slow
def test_a_box_that_falls_flat_and_slides():
    """Both corners strike together whatever the height: ``v⁺ = v - μ √(2 g h)``, ``x = v t + v⁺²/(2 μ g)``."""
    mechanism, box = box_on_floor()
    values = {H: 0.2, MU: 0.3, SPEED: 2.0}
    start = [box.x == 0, box.y == 0.2 + H, box.phi == 0, box.vx == SPEED, box.vy == 0, box.omega == 0]
    found = mbd.sensitivities(mechanism, [0, 1.2], [box.x], [H, MU, SPEED], initial=start, parameters=values)
    fall, time = np.sqrt(2 * G * 0.2), np.sqrt(2 * 0.2 / G)
    after, rubs = 2 - 0.3 * fall, 0.3 * G
    assert found[box.x][-1] == pytest.approx(2 * time + after**2 / (2 * rubs), rel=1e-8)
    assert found[box.x, SPEED][-1] == pytest.approx(time + after / rubs, rel=1e-7)
    assert found[box.x, MU][-1] == pytest.approx(-after * fall / rubs - after**2 / (2 * 0.3**2 * G), rel=1e-7)
    assert found[box.x, H][-1] == pytest.approx(2 / fall - after * 0.3 * G / fall / rubs, rel=1e-7)


@pytest.mark.slow
def test_corners_that_strike_together_by_chance_are_reported():
    mechanism, box = box_on_floor()
    start = [box.y == 0.4, box.phi == H - 1, box.vx == 0, box.vy == 0, box.omega == 0]
    with pytest.raises(mbd.ModelError, match=r"'floor\.0 touches', 'floor\.1 touches' take place together"):
        mbd.sensitivities(mechanism, [0, 1.2], [box.x], [H], initial=start)


def stick_slip(speed, k=40.0, mass=2.0):
    """A block by a spring on a belt, μ = 0.3 in motion and 0.5 at rest; its period by hand, and where it turns."""
    belt, block = mbd.Body("belt", mass=1, inertia=1), mbd.Body("block", mass=mass, inertia=0.1)
    joints = [mbd.Translational("belt", mbd.ground.at(0, 0), belt.at(0, 0))]
    joints.append(mbd.Translational("on belt", belt.at(0, 0), block.at(0, 0)))
    rub = mbd.JointFriction("rub", joints[1], mbd.DryFriction(0.3, 0.5))
    spring = mbd.TSDA("spring", mbd.ground.at(-3, 0), block.at(0, 0), stiffness=k, free_length=3)
    drive = mbd.Driver("drive", belt.x, speed * mbd.t)
    mechanism = mbd.Mechanism(
        [belt, block], joints, drivers=[drive], forces=[mbd.Gravity(), rub, spring], parameters=[SPEED]
    )
    v, w, d = 0.2, np.sqrt(k / mass), 0.2 * mass * G / k
    period = 2 * d / v + (np.pi + 2 * np.arctan2(v / w, d)) / w
    by_speed = -2 * d / v**2 + 2 * d / w**2 / (d**2 + (v / w) ** 2)
    return mechanism, block, period, by_speed, 0.3 * mass * G / k + np.hypot(d, v / w)


@pytest.mark.slow
def test_the_period_of_stick_and_slip_by_the_speed_of_the_belt():
    mechanism, block, period, by_speed, _ = stick_slip(SPEED)
    found = mbd.sensitivities(
        mechanism, [0, 3.5], [block.x], [SPEED], initial=[block.x == 0, block.vx == SPEED], parameters={SPEED: 0.2}
    )
    first, _, second = found.events[:3]
    assert (first.name, second.name) == ("rub breaks away",) * 2
    assert second.t - first.t == pytest.approx(period, rel=1e-6)
    assert second.time(SPEED) - first.time(SPEED) == pytest.approx(by_speed, rel=1e-6)


@pytest.mark.slow
def test_stick_and_slip_forgets_a_disturbance_at_once():
    """One multiplier is 1, along the motion; sticking takes the other to zero."""
    mechanism, block, period, _, turns = stick_slip(0.2)
    motion = mbd.simulate(mechanism, [0, period], initial=[block.x == turns, block.vx == 0])
    same = [mbd.at_end(x) == mbd.at_start(x) for x in (block.x, block.vx)]
    assert mbd.stability(motion, same).multipliers == pytest.approx([1, 0], abs=1e-6)


def shaken_ball(amplitude, w, e):
    """A ball on a table that shakes."""
    table, ball = mbd.Body("table", mass=1, inertia=1), mbd.Body("ball", mass=1, inertia=0.1, pose=(0, 0.1, 0))
    guides = [
        mbd.Translational(b.name, mbd.ground.at(0, 0, angle=np.pi / 2), b.at(0, 0, angle=np.pi / 2))
        for b in (table, ball)
    ]
    drive = mbd.Driver("drive", table.y, amplitude * mbd.sin(w * mbd.t))
    contact = mbd.RigidContact("contact", mbd.Circle(ball.at(0, 0), 0.1), mbd.HalfPlane(table.at(0, 0)), restitution=e)
    forces, parameters = [mbd.Gravity(), contact], [H, E]
    return mbd.Mechanism([table, ball], guides, drivers=[drive], forces=forces, parameters=parameters), ball, contact


@pytest.mark.slow
def test_a_ball_lifts_off_a_table_that_shakes():
    """It opens where ``A ω² sin ωt = g``, with ``A = 0.02 h``; flight and impact by hand."""
    mechanism, ball, _ = shaken_ball(0.02 * H, 30.0, E)
    start, outputs, w = [ball.y == 0.1, ball.vy == 0.6 * H], [ball.y, ball.vy], 30.0

    def end(h, e):
        a = 0.02 * h
        opens = np.arcsin(G / (a * w**2)) / w
        height, speed = a * np.sin(w * opens), a * w * np.cos(w * opens)
        flight = brentq(
            lambda x: height + speed * x - G * x**2 / 2 - a * np.sin(w * (opens + x)), 0.05, 0.17, xtol=1e-15
        )
        plate = a * w * np.cos(w * (opens + flight))
        after, left = plate - e * (speed - G * flight - plate), 0.18 - opens - flight
        return np.array([0.1 + a * np.sin(w * (opens + flight)) + after * left - G * left**2 / 2, after - G * left])

    found = mbd.sensitivities(mechanism, [0, 0.18], outputs, [H, E], initial=start)
    assert [event.name for event in found.events] == ["contact opens", "contact touches"]
    phase = np.arcsin(G / (0.02 * w**2))
    assert found.events[0].t == pytest.approx(phase / w, rel=1e-6)
    assert found.events[0].time(H) == pytest.approx(-np.tan(phase) / w, rel=1e-6)
    assert [found[x][-1] for x in outputs] == pytest.approx(end(1, 0.7), rel=1e-7)
    by_h, by_e = (end(1 + 1e-6, 0.7) - end(1 - 1e-6, 0.7)) / 2e-6, (end(1, 0.71) - end(1, 0.69)) / 0.02
    assert [found[x, H][-1] for x in outputs] == pytest.approx(by_h, rel=1e-6)
    assert [found[x, E][-1] for x in outputs] == pytest.approx(by_e, rel=1e-6)


def test_the_multipliers_of_a_ball_on_a_table_that_shakes():
    """Against differences of its own map from impact to impact."""
    amplitude, period, e = 0.03, 0.5, 0.8
    w = 2 * np.pi / period
    mechanism, ball, _ = shaken_ball(amplitude, w, e)

    def next_impact(state):
        begin, speed = state
        height = amplitude * np.sin(w * begin)
        lasts = brentq(
            lambda x: height + speed * x - G * x**2 / 2 - amplitude * np.sin(w * (begin + x)), 0.3, 0.7, xtol=1e-14
        )
        plate = amplitude * w * np.cos(w * (begin + lasts))
        return np.array([begin + lasts, plate - e * (speed - G * lasts - plate)])

    begin = np.arccos(G * period / 2 * (1 - e) / (1 + e) / (amplitude * w)) / w
    impact = np.array([begin, G * period / 2])
    by_hand = np.linalg.eigvals(
        np.array([(next_impact(impact + h) - next_impact(impact - h)) / 2e-6 for h in 1e-6 * np.eye(2)]).T
    )
    half, highest = begin + period / 2, 0.1 + amplitude * np.sin(w * begin) + G * period**2 / 8
    start = mbd.assemble(mechanism, [ball.y == highest, ball.vy == 0], t=half)
    motion = mbd.simulate(mechanism, [half, half + period], initial=start)
    found = mbd.stability(motion, [mbd.at_end(x) == mbd.at_start(x) for x in (ball.y, ball.vy)])
    np.testing.assert_allclose(np.sort_complex(found.multipliers), np.sort_complex(by_hand), atol=1e-6)


@pytest.mark.slow
def test_friction_through_a_change_of_the_mechanism():
    """A block is dragged back from where it passes ``x = h`` on: ``v² = v0² - 2 μ g h`` there."""
    mechanism, block, _ = sliding_block(mbd.DryFriction(MU))
    spring = mbd.Force("drag", block.at(0, 0), (-4.0, 0))
    dragged = mechanism.replace(forces=[*mechanism.forces, spring], parameters=[MU, SPEED, H])
    free = mechanism.replace(parameters=[MU, SPEED, H])
    parts = mbd.Event("parts", block.x - H, direction=1, becomes=dragged)
    start, values = [block.x == 0, block.vx == SPEED], {H: 0.3}
    found = mbd.sensitivities(free, [0, 1], [block.x], [H, MU], initial=start, events=[parts], parameters=values)
    assert [event.name for event in found.events] == ["parts", "rub stops"]
    slow, fast = 0.3 * G, 0.3 * G + 2
    square = 4 - 2 * slow * 0.3
    assert found[block.x][-1] == pytest.approx(0.3 + square / (2 * fast), rel=1e-8)
    assert found[block.x, H][-1] == pytest.approx(1 - slow / fast, rel=1e-7)
    by_mu = -2 * G * 0.3 / (2 * fast) - square * G / (2 * fast**2)
    assert found[block.x, MU][-1] == pytest.approx(by_mu, rel=1e-7)


def test_a_motion_that_does_not_know_its_modes_is_refused(tmp_path):
    mechanism, block, _ = sliding_block(mbd.DryFriction(0.3))
    motion = mbd.simulate(mechanism, [0, 1], initial=[block.vx == 2])
    motion.save(tmp_path / "motion.npz")
    again = mbd.read_trajectory(tmp_path / "motion.npz", mechanism)
    with pytest.raises(mbd.ModelError, match="does not know where its friction and contacts switch"):
        mbd.stability(again, [mbd.at_end(block.x) == mbd.at_start(block.x)])


@pytest.mark.slow
def test_dry_friction_in_a_joint_answers_an_impact():
    """Against differences: a ball falls on a round cart, whose guide takes a part of the impulse and rubs under it."""
    cart, ball = mbd.Body("cart", mass=2, inertia=0.1), mbd.Body("ball", mass=1, inertia=0.004, pose=(-0.2, 0.8, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(MU))
    outlines = mbd.Circle(ball.at(0, 0), 0.1), mbd.Circle(cart.at(0, 0), 0.3)
    strikes = mbd.RigidContact("strikes", *outlines, friction=mbd.DryFriction(0.3), restitution=0.5)
    mechanism = mbd.Mechanism([cart, ball], [rail], forces=[mbd.Gravity(), rub, strikes], parameters=[MU])
    start = [cart.x == 0, cart.vx == 0.5, ball.x == -0.2, ball.y == 0.8, ball.vx == 0, ball.vy == 0, ball.omega == 1]
    outputs = [cart.vx, ball.x, ball.vy, ball.omega]
    found = mbd.sensitivities(mechanism, [0, 0.45], outputs, [MU], initial=start, parameters={MU: 0.15})
    assert [event.name for event in found.events] == ["strikes touches"]
    low, high = (mbd.simulate(mechanism, [0, 0.45], initial=start, parameters={MU: 0.15 + x}) for x in (-1e-4, 1e-4))
    for output in outputs:
        by_differences = (high.final[output] - low.final[output]) / 2e-4
        assert found[output, MU][-1] == pytest.approx(by_differences, rel=1e-5)


def test_an_impact_at_the_start_and_a_load_that_jumps_are_refused():
    mechanism, ball = ball_on_floor()
    with pytest.raises(mbd.ModelError, match="'floor touches' at the start"):
        mbd.sensitivities(mechanism, [0, 0.1], [ball.y], [SPEED], initial=[ball.y == 0.1, ball.vy == -SPEED])
    sliding, block, _ = sliding_block(mbd.DryFriction(0.3))
    push = mbd.Force("push", block.at(0, 0), (mbd.if_else(mbd.t > 0.5, 10 * SPEED, mbd.t), 0))
    pushed = sliding.replace(forces=[*sliding.forces, push])
    with pytest.raises(mbd.ModelError, match=r"changes its mode at t = 0\.5 s, where a load"):
        mbd.sensitivities(pushed, [0, 1], [block.x], [SPEED], initial=[block.x == 0, block.vx == 0])
