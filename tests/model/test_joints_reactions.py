"""Reactions: what joints and drivers exert, against Newton and Euler for each body."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from random_mechanisms import random_case

import mbdcasadi as mbd

G = np.array([0.0, -9.81])


def cross(a, b) -> float:
    """Third component of the cross product."""
    return float(a[0] * b[1] - a[1] * b[0])


# --- textbook cases ------------------------------------------------------------------------------
def double_pendulum():
    """Two rods on pins, moving."""
    upper = mbd.Body("upper", mass=1.3, inertia=0.09, pose=(0.3, -0.3, -0.8), velocity=(0, 0, 2.0))
    lower = mbd.Body("lower", mass=0.8, inertia=0.05, pose=(0.9, -0.9, -0.5), velocity=(0, 0, -3.0))
    top = mbd.Revolute("top", mbd.ground.at(0, 0), upper.at(-0.5, 0))
    knee = mbd.Revolute("knee", upper.at(0.5, 0), lower.at(-0.4, 0))
    return upper, lower, top, knee, mbd.Mechanism(bodies=[upper, lower], joints=[top, knee], forces=[mbd.Gravity()])


def test_pin_force_of_a_double_pendulum():
    """The knee holds the lower rod with m2 (a2 - g), the top both rods; pins carry no couple."""
    upper, lower, top, knee, pendulum = double_pendulum()
    state = mbd.assemble(pendulum)
    on_lower = 0.8 * (state[lower.acceleration] - G)
    both = on_lower + 1.3 * (state[upper.acceleration] - G)
    assert np.hypot(*on_lower) > 1
    np.testing.assert_allclose(state[knee.reaction_on(lower).force], on_lower, atol=1e-12)
    np.testing.assert_allclose(state[knee.reaction_on(upper).force], -on_lower, atol=1e-12)
    np.testing.assert_allclose(state[top.reaction_on(upper).force], both, atol=1e-12)
    np.testing.assert_allclose(state[top.reaction_on(mbd.ground).force], -both, atol=1e-12)
    for joint in (top, knee):
        for body in joint.bodies:
            assert state[joint.reaction_on(body).torque] == pytest.approx(0, abs=1e-12)


def test_driver_that_holds_a_horizontal_bar():
    """The effort of the driver and the couple on the bar are m g L / 2."""
    mass, length = 1.2, 1.0
    bar = mbd.Body("bar", mass=mass, inertia=0.1, pose=(length / 2, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), bar.at(-length / 2, 0))
    hold = mbd.Driver("hold", hinge.angle, 0.0)
    state = mbd.assemble(mbd.Mechanism(bodies=[bar], joints=[hinge], drivers=[hold], forces=[mbd.Gravity()]))
    wanted = mass * 9.81 * length / 2
    assert state[hold.effort] == pytest.approx(wanted, rel=1e-12)
    assert state[hold.reaction_on(bar).torque] == pytest.approx(wanted, rel=1e-12)
    assert state[hold.reaction_on(mbd.ground).torque] == pytest.approx(-wanted, rel=1e-12)
    np.testing.assert_allclose(state[hold.reaction_on(bar).force], [0, 0], atol=1e-12)
    np.testing.assert_allclose(state[hinge.reaction_on(bar).force], [0, mass * 9.81], atol=1e-12)


def test_power_of_a_driver_is_effort_times_rate():
    """A driven crank with inertia: effort * rate is the rate of the kinetic energy."""
    crank = mbd.Body("crank", mass=1.0, inertia=0.2, pose=(0.5, 0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), crank.at(-0.5, 0))
    spin = mbd.Driver("spin", hinge.angle, 0.5 * mbd.t**2)
    state = mbd.assemble(mbd.Mechanism(bodies=[crank], joints=[hinge], drivers=[spin]), t=0.7)
    moment = 0.2 + 0.25
    assert state[spin.effort] == pytest.approx(moment * 1.0, rel=1e-12)
    assert state[spin.effort * mbd.time_derivative(hinge.angle)] == pytest.approx(moment * 0.7, rel=1e-12)


def test_slider_with_an_offset_load():
    """A guide under the weight W at +e: force (0, +W), couple +W e about its marker."""
    weight, offset = 7.0, 0.4
    slider = mbd.Body("slider", mass=2.0, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))
    load = mbd.Force("load", slider.at(offset, 0), (0, -weight))
    state = mbd.assemble(mbd.Mechanism(bodies=[slider], joints=[guide], forces=[load]))
    reaction = guide.reaction_on(slider)
    np.testing.assert_allclose(state[reaction.force], [0, weight], atol=1e-12)
    assert state[reaction.torque] == pytest.approx(weight * offset, rel=1e-12)


def test_couple_is_about_the_marker_on_the_body():
    """The same slider held at another point: force times the way adds to the couple; on the ground, about the rail."""
    weight, offset, displaced = 7.0, 0.4, 0.9
    slider = mbd.Body("slider", mass=2.0, inertia=0.1, pose=(displaced, 0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0.1, 0), slider.at(-0.25, 0))
    load = mbd.Force("load", slider.at(offset, 0), (0, -weight))
    state = mbd.assemble(mbd.Mechanism(bodies=[slider], joints=[guide], forces=[load]))
    assert state[guide.reaction_on(slider).torque] == pytest.approx(weight * (offset + 0.25), rel=1e-12)
    on_ground = guide.reaction_on(mbd.ground)
    np.testing.assert_allclose(state[on_ground.force], [0, -weight], atol=1e-12)
    assert state[on_ground.torque] == pytest.approx(-weight * (displaced + offset - 0.1), rel=1e-12)


def test_weld_carries_the_root_moment_of_a_cantilever():
    """A beam welded to a wall: the whole weight, and m g L / 2 about the root."""
    beam = mbd.Body("beam", mass=3.0, inertia=0.2, pose=(0.6, 0, 0))
    root = mbd.Weld("root", mbd.ground.at(0, 0), beam.at(-0.6, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[beam], joints=[root], forces=[mbd.Gravity()]))
    np.testing.assert_allclose(state[root.reaction_on(beam).force], [0, 3 * 9.81], atol=1e-12)
    assert state[root.reaction_on(beam).torque] == pytest.approx(3 * 9.81 * 0.6, rel=1e-12)


# --- distance joints ---------------------------------------------------------------------------------
@pytest.mark.parametrize("length", [0.2, 1.0, 5.0])
def test_reaction_of_a_distance_joint_is_the_tension_of_the_link(length):
    """A mass on a massless link that swings: m (L omega² + g·radial), along the link; its multiplier is in newtons."""
    angle, omega, mass = -1.1, 2.0, 1.5
    radial = np.array([np.cos(angle), np.sin(angle)])
    tangent = np.array([-radial[1], radial[0]])
    start, rate = length * radial, length * omega * tangent
    bob = mbd.Body("bob", mass=mass, inertia=0.1, pose=(*start, 0), velocity=(*rate, 0))
    link = mbd.Distance("link", mbd.ground.at(0, 0), bob.at(0, 0), length)
    state = mbd.assemble(mbd.Mechanism(bodies=[bob], joints=[link], forces=[mbd.Gravity()]))
    tension = mass * (length * omega**2 + G @ radial)
    np.testing.assert_allclose(state[link.reaction_on(bob).force], -tension * radial, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(state[link.reaction_on(mbd.ground).force], tension * radial, rtol=1e-11, atol=1e-12)
    assert abs(state[link.multipliers]) == pytest.approx(tension, rel=1e-11)


def test_reaction_of_a_distance_joint_between_bodies_is_along_the_line_of_its_points():
    """No component across the link, opposite on both ends, no couple about the points."""
    a = mbd.Body("a", mass=1, inertia=0.1, pose=(0, 0, 0.4), velocity=(1, -2, 3))
    b = mbd.Body("b", mass=2, inertia=0.3, pose=(1, 0.3, -0.8), velocity=(0, 1, -1))
    link = mbd.Distance("link", a.at(0.2, 0.1), b.at(-0.3, 0.2), 0.8)
    state = mbd.assemble(mbd.Mechanism(bodies=[a, b], joints=[link], forces=[mbd.Gravity()]))
    d = state[link.b.position - link.a.position]
    on_a, on_b = state[link.reaction_on(a).force], state[link.reaction_on(b).force]
    assert np.hypot(*on_a) > 0.1
    assert cross(d, on_a) == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(on_a, -on_b, atol=1e-12)
    assert state[link.reaction_on(a).torque] == pytest.approx(0, abs=1e-12)
    assert state[link.reaction_on(b).torque] == pytest.approx(0, abs=1e-12)
    # tension (lam > 0 pulls the ends together) and its power on both ends: none, since the length stays
    np.testing.assert_allclose(on_a, state[link.multipliers] * d / np.hypot(*d), atol=1e-12)


def test_rack_force_accelerates_the_pinion():
    """A free pinion between a guide and a pushed rack: tooth force times radius is J' alpha."""
    rack = mbd.Body("rack", mass=2.0, inertia=0.1)
    pinion = mbd.Body("pinion", mass=1.0, inertia=0.03, pose=(0, 0.2, 0))
    mesh = mbd.RackAndPinion("mesh", rack.at(0, 0), pinion.at(0, 0), 0.2)
    joints = [
        mbd.Translational("guide", mbd.ground.at(0, 0), rack.at(0, 0)),
        mbd.Revolute("pin", mbd.ground.at(0, 0.2), pinion.at(0, 0)),
        mesh,
    ]
    push = mbd.Force("push", rack.at(0, 0), (6.0, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[rack, pinion], joints=joints, forces=[push]))
    acceleration = 6.0 / (2.0 + 0.03 / 0.2**2)
    assert state[rack.ax] == pytest.approx(acceleration, rel=1e-12)
    assert state[pinion.alpha] == pytest.approx(acceleration / 0.2, rel=1e-12)
    assert state[mesh.tooth_force] == pytest.approx(2.0 * acceleration - 6.0, rel=1e-12)


def test_rolling_row_acts_at_the_point_of_contact():
    """On the pinion the rack's force has the lever R about the centre; on the rack it acts along the pitch line."""
    rack = mbd.Body("rack", mass=2.0, inertia=0.1, pose=(0.3, 0.1, 0.4))
    pinion = mbd.Body("pinion", mass=1.0, inertia=0.03, pose=(0.2, 0.5, 0.1))
    mesh = mbd.RackAndPinion("mesh", rack.at(0.1, 0.05, angle=0.2), pinion.at(0, 0), 0.2)
    above = mbd.PointOnLine("above", rack.at(0.1, 0.05, angle=0.2), pinion.at(0, 0), 0.2)
    state = mbd.assemble(
        mbd.Mechanism(bodies=[rack, pinion], joints=[mesh, above], forces=[mbd.Gravity(), mbd.Torque("n", pinion, 1.0)])
    )
    force = state[mesh.reaction_on(rack).force]
    assert np.hypot(*force) > 0.1
    assert cross(state[mesh.a.x_axis], force) == pytest.approx(0, abs=1e-12)
    assert state[mesh.tooth_force] == pytest.approx(force @ state[mesh.a.x_axis], rel=1e-12)
    assert state[mesh.reaction_on(rack).torque] == pytest.approx(0, abs=1e-12)
    assert state[mesh.reaction_on(pinion).torque] == pytest.approx(-0.2 * state[mesh.tooth_force], rel=1e-12)


# --- laws that hold for every joint ---------------------------------------------------------------------
def joints_between(a, b):
    """One joint of each kind whose rows do not change when the two bodies move as one."""
    return [
        mbd.Revolute("revolute", a, b),
        mbd.Translational("translational", a, b),
        mbd.Weld("weld", a, b),
        mbd.Distance("distance", a, b, 0.8),
        mbd.PointOnLine("point on line", a, b, 0.1),
        mbd.RelativeAngle("relative angle", a, b, 0.3),
        mbd.RackAndPinion("rack", a, b, 0.2),
        mbd.Driver("driver of the angle", b.angle - a.angle, mbd.t),
        mbd.Driver("driver of the distance", mbd.distance(a, b), 1 + mbd.t),
        mbd.Constraint("written", ca.dot(a.x_axis, b.y_axis)),
    ]


KINDS = [joint.name for joint in joints_between(mbd.ground.at(0, 0), mbd.Body("b", 1, 1).at(0, 0))]


@pytest.mark.parametrize("ground", [False, True], ids=["two bodies", "ground"])
@pytest.mark.parametrize("kind", range(len(KINDS)), ids=KINDS)
def test_action_is_reaction(kind, ground):
    """Forces on both sides sum to zero, and so do the couples about one point of space.

    Revolute and Weld balance where their points coincide; the others at any pose.
    """
    rng = np.random.default_rng(kind)
    i, j = (mbd.Body(n, 1, 1, pose=rng.uniform(-1, 1, 3)) for n in "ij")
    first = mbd.ground if ground else i
    joint = joints_between(first.at(0.2, -0.1, angle=0.4), j.at(-0.3, 0.25, angle=-0.7))[kind]
    point = rng.normal(size=2)

    def about(body):
        reaction = joint.reaction_on(body)
        arm = reaction.marker.position - point
        return reaction.torque + arm[0] * reaction.force[1] - arm[1] * reaction.force[0]

    force = sum((joint.reaction_on(body).force for body in (first, j)), ca.SX(2, 1))
    couple = sum((about(body) for body in (first, j)), ca.SX(0))
    total = ca.Function("total", [i.q, j.q, joint.multipliers, mbd.t], [force, couple])
    count = joint.multipliers.numel()
    q_i, q_j = rng.uniform(-1, 1, 3), rng.uniform(-1, 1, 3)
    if isinstance(joint, mbd.Revolute | mbd.Weld):
        gap = ca.Function("gap", [i.q, j.q], [joint.b.position - joint.a.position])(q_i, q_j)
        q_j[:2] -= gap.full().ravel()
    force, couple = total(q_i, q_j, rng.normal(size=count), 0.3)
    np.testing.assert_allclose(force.full().ravel(), [0, 0], atol=1e-12)
    assert float(couple) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("kind", [mbd.AbsoluteX, mbd.AbsoluteY, mbd.AbsoluteAngle])
def test_the_ground_takes_the_reaction_of_an_absolute_constraint(kind):
    """Force and moment about the origin on the ground balance those on the body."""
    body = mbd.Body("body", 1, 1)
    constraint = kind("held", body.at(0.3, 0.2, angle=0.1), 0.4)
    on_body, on_ground = constraint.reaction_on(body), constraint.reaction_on(mbd.ground)
    arm = on_body.marker.position
    couple = on_body.torque + arm[0] * on_body.force[1] - arm[1] * on_body.force[0] + on_ground.torque
    total = ca.Function("total", [body.q, constraint.multipliers], [on_body.force + on_ground.force, couple])
    force, couple = total([0.3, -0.5, 0.8], 2.0)
    np.testing.assert_allclose(force.full().ravel(), [0, 0], atol=1e-12)
    assert float(couple) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("kind", [mbd.RelativeX, mbd.RelativeY])
def test_the_ground_takes_the_couple_of_a_distance_along_a_global_axis(kind):
    """Two opposite forces along the axis, not in line: what they lack to balance is a couple on the ground."""
    a, b = mbd.Body("a", 1, 1, pose=(0, 0, 0)), mbd.Body("b", 2, 1, pose=(1, 0.4, 0))
    apart = kind("apart", a.at(0.1, 0.2), b.at(-0.1, 0.3), 0.8)
    push = mbd.Force("push", b.at(0, 0), (3.0, 5.0))
    state = mbd.assemble(mbd.Mechanism(bodies=[a, b], joints=[apart], forces=[push]))
    on_a, on_b, on_ground = (apart.reaction_on(body) for body in (a, b, mbd.ground))
    assert np.hypot(*state[on_a.force]) > 0.1
    np.testing.assert_allclose(state[on_a.force], -state[on_b.force], atol=1e-12)
    np.testing.assert_array_equal(state[on_ground.force], [0, 0])
    moments = [cross(state[r.marker.position], state[r.force]) + state[r.torque] for r in (on_a, on_b, on_ground)]
    assert abs(moments[2]) > 0.1
    assert sum(moments) == pytest.approx(0, abs=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(12))
def test_newton_and_euler_hold_for_every_body_of_a_random_mechanism(seed):
    """``m a = F + ΣR`` and ``J' alpha = n + Σ(T + arm x R)`` with the reactions of all joints and drivers."""
    case = random_case(seed, driven=seed % 2 == 0)
    mechanism = case.mechanism
    state = mbd.assemble(mechanism)
    eom = state.equations
    Q = state[eom.Q]
    for k, body in enumerate(mechanism.bodies):
        force, couple = Q[3 * k : 3 * k + 2].copy(), float(Q[3 * k + 2])
        for element in mechanism.constraints:
            if body in element.bodies:
                reaction = element.reaction_on(body)
                R, arm = state[reaction.force], state[reaction.marker.position - body.position]
                force += R
                couple += state[reaction.torque] + cross(arm, R)
        scale = 1 + np.max(np.abs(state.lam), initial=0)
        np.testing.assert_allclose(body.mass * state[body.acceleration], force, atol=1e-9 * scale)
        assert body.inertia * state[body.alpha] == pytest.approx(couple, abs=1e-9 * scale)


def test_force_in_joint_is_the_force_in_the_axes_of_the_marker():
    """Same norm, components along the marker's axes, on either body and on the ground."""
    upper, lower, *_ = double_pendulum()
    top = mbd.Revolute("top", mbd.ground.at(0, 0, angle=0.9), upper.at(-0.5, 0, angle=0.3))
    knee = mbd.Revolute("knee", upper.at(0.5, 0, angle=-0.6), lower.at(-0.4, 0, angle=1.2))
    state = mbd.assemble(mbd.Mechanism(bodies=[upper, lower], joints=[top, knee], forces=[mbd.Gravity()]))
    for joint, body in ((top, mbd.ground), (top, upper), (knee, upper), (knee, lower)):
        reaction = joint.reaction_on(body)
        marker = joint.a if joint.a.body is body else joint.b
        force, inside = state[reaction.force], state[reaction.force_in_joint]
        angle = state[marker.angle]
        along, across = [np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]
        assert np.hypot(*inside) == pytest.approx(np.hypot(*force), rel=1e-12)
        np.testing.assert_allclose(inside, [force @ along, force @ across], atol=1e-12)


def test_guide_carries_no_force_along_its_axis():
    """On an inclined rail: the first component of force_in_joint on the ground side is zero, the second m g cos."""
    slope = 0.5
    block = mbd.Body("block", mass=2.0, inertia=0.1, pose=(0, 0, slope))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, angle=slope), block.at(0, 0))
    state = mbd.assemble(mbd.Mechanism(bodies=[block], joints=[rail], forces=[mbd.Gravity()]))
    np.testing.assert_allclose(state[rail.reaction_on(block).force_in_joint], [0, 2 * 9.81 * np.cos(slope)], atol=1e-12)
    assert np.hypot(*state[block.acceleration]) == pytest.approx(9.81 * np.sin(slope), rel=1e-12)


def test_reaction_excludes_springs_and_motors_in_the_joint():
    """A motor at the pin changes the motion, not the pin's couple, which stays zero."""
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(-0.5, 0), stiffness=5, free_angle=1)
    forces = [mbd.Torque("motor", arm, 4.0), spring]
    state = mbd.assemble(mbd.Mechanism(bodies=[arm], joints=[pin], forces=forces))
    assert state[arm.alpha] == pytest.approx((4.0 + 5.0) / 0.35, rel=1e-12)
    assert state[pin.reaction_on(arm).torque] == pytest.approx(0, abs=1e-12)


def test_reaction_on_a_body_that_is_not_connected_is_refused():
    """The message names the joint, the body, and the bodies it acts on."""
    upper, lower, top, _, _ = double_pendulum()
    with pytest.raises(mbd.MechanismError, match=r"'top' does not act on 'lower'.*'ground', 'upper'"):
        top.reaction_on(lower)
    with pytest.raises(mbd.MechanismError, match="does not act on"):
        mbd.Revolute("knee", upper.at(0, 0), lower.at(0, 0)).reaction_on(mbd.ground)


def test_reaction_prints_what_it_is():
    """The joint and the body."""
    upper, _, top, _, _ = double_pendulum()
    assert repr(top.reaction_on(upper)) == "Reaction of joint 'top' on 'upper'"
