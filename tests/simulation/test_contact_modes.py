"""Rigid contacts: touch, stick, slip and impacts, against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.simulation.changes import complementarity
from mbdcasadi.simulation.checks import accuracy

G = 9.81
WIDE, HIGH = 0.1, 0.2


def ball_above(height=1.0, friction=None, restitution=0.0, forces=(), plane=None, **more):
    """A ball of 0.6 kg above the ground."""
    ball = mbd.Body("ball", mass=0.6, inertia=2.4e-3, pose=(0, 0.1 + height, 0))
    plane = mbd.HalfPlane(mbd.ground.at(0, 0)) if plane is None else plane
    floor = mbd.RigidContact("floor", mbd.Circle(ball.at(0, 0), 0.1), plane, friction, restitution)
    return ball, floor, mbd.Mechanism([ball], forces=[mbd.Gravity(), floor, *forces], **more)


def block_on_floor(friction=None, restitution=0.0, pose=(0, HIGH, 0), force=None):
    """A block of 2 kg, 0.2 m wide and 0.4 m high, on the ground; `force` is the place and the vector of a push."""
    block = mbd.Body("block", mass=2.0, inertia=2 / 3 * (WIDE**2 + HIGH**2), pose=pose)
    corners = [(-WIDE, -HIGH), (WIDE, -HIGH), (WIDE, HIGH), (-WIDE, HIGH)]
    box = mbd.PolygonEdges(block.at(0, 0), corners)
    stands = mbd.RigidContact("stands", box, mbd.HalfPlane(mbd.ground.at(0, 0)), friction, restitution)
    forces = [mbd.Gravity(), stands]
    if force is not None:
        forces.append(mbd.Force("push", block.at(*force[0]), force[1]))
    return block, stands, mbd.Mechanism([block], forces=forces)


def happenings(motion):
    """Names of the events."""
    return [event.name for event in motion.events]


# --- touch --------------------------------------------------------------------------------------------------
def test_plastic_impact():
    """A ball that does not bounce is at rest from the impact on; its impulse is its momentum."""
    ball, floor, mechanism = ball_above()
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 21))
    (event,) = motion.events
    assert event.name == "floor touches" and event.t == pytest.approx(np.sqrt(2 / G), abs=1e-9)
    assert event.after[floor.impulse] == pytest.approx(0.6 * np.sqrt(2 * G), rel=1e-9)
    late = motion.t > event.t
    np.testing.assert_allclose(motion[ball.y][late], 0.1, atol=1e-12)
    np.testing.assert_allclose(motion[floor.normal_force][late], 0.6 * G, rtol=1e-12)
    assert not motion[floor.normal_force][~late].any() and motion[floor.gap][0] == pytest.approx(1.0)
    np.testing.assert_allclose(motion[floor.reaction_on(ball).force][late], np.tile([0, 0.6 * G], (late.sum(), 1)))
    assert "contact" in motion.statistics.formulation


@pytest.mark.parametrize("restitution", [0.2, pytest.param(0.7, marks=pytest.mark.slow)])
def test_bounces_end_at_rest(restitution):
    """The limit of the bounces is ``(1 + e)/(1 - e) √(2 h/g)``."""
    ball, floor, mechanism = ball_above(restitution=restitution)
    motion = mbd.simulate(mechanism, np.linspace(0, 4, 41))
    first, last = motion.events[0], motion.events[-1]
    assert first.after[ball.vy] == pytest.approx(restitution * np.sqrt(2 * G), rel=1e-9)
    assert last.t == pytest.approx(np.sqrt(2 / G) * (1 + restitution) / (1 - restitution), abs=1e-9)
    assert last.after[floor.impulse] == 0
    assert motion.final[ball.y] == pytest.approx(0.1, abs=1e-12) and motion.final[ball.vy] == 0
    assert motion.final[floor.normal_force] == pytest.approx(0.6 * G, rel=1e-12)


def test_bounces_on_an_incline_lose_no_impulse():
    """The impulses of all bounces are that of the weight: friction takes μ times it while the ball slides."""
    slope, mu, restitution = 0.3, 0.05, 0.3
    plane = mbd.HalfPlane(mbd.ground.at(0, 0, -slope))
    ball, _, mechanism = ball_above(friction=mbd.DryFriction(mu), restitution=restitution, plane=plane)
    start = 1.1 * np.array([np.sin(slope), np.cos(slope)])
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 21), initial=[ball.x == start[0], ball.y == start[1]])
    pressing = G * np.cos(slope)
    limit = np.sqrt(2 / pressing) * (1 + restitution) / (1 - restitution)
    assert motion.events[-1].t == pytest.approx(limit, abs=1e-9)
    along = np.cos(slope) * motion.final[ball.vx] - np.sin(slope) * motion.final[ball.vy]
    assert along == pytest.approx(2 * (G * np.sin(slope) - mu * pressing), rel=1e-10)


def test_two_bodies_bounce_on_each_other_to_rest():
    """Their relative acceleration counts, and they go on together with their momentum."""
    a, b = (mbd.Body(name, mass=m, inertia=1, pose=(x, 0, 0)) for name, m, x in (("a", 1, 0), ("b", 3, 1)))
    rails = [mbd.Translational(f"rail of {body.name}", mbd.ground.at(0, 0), body.at(0, 0)) for body in (a, b)]
    hit = mbd.RigidContact("hit", mbd.Circle(a.at(0, 0), 0.1), mbd.Circle(b.at(0, 0), 0.1), restitution=0.4)
    forces = [mbd.Force("right", a.at(0, 0), (2, 0)), mbd.Force("left", b.at(0, 0), (-1, 0)), hit]
    motion = mbd.simulate(mbd.Mechanism([a, b], rails, forces=forces), np.linspace(0, 3, 16))
    assert motion.events[-1].t == pytest.approx(np.sqrt(2 * 0.8 / (2 + 1 / 3)) * 1.4 / 0.6, abs=1e-9)
    np.testing.assert_allclose([motion.final[a.vx], motion.final[b.vx]], 3 / 4, rtol=1e-12)


@pytest.mark.parametrize("friction", [None, mbd.DryFriction(0.3)])
def test_leaves_a_table_that_shakes(friction):
    """A ball on a table that moves with time lifts off where the table falls faster than g, and that alone is said."""
    size, rate = 0.01, 40.0
    table = mbd.HalfPlane(mbd.ground.at(0, size * mbd.sin(rate * mbd.t)))
    ball, _, mechanism = ball_above(height=0, friction=friction, plane=table)
    motion = mbd.simulate(mechanism, np.linspace(0, 0.1, 11), initial=[ball.vy == size * rate])
    assert happenings(motion) == ["floor opens"]
    assert motion.events[0].t == pytest.approx(np.arcsin(G / size / rate**2) / rate, abs=1e-8)


def test_ladder_leaves_the_wall():
    """A ladder on smooth ground and wall leaves the wall at two thirds of the height at which it began."""
    length, first, speed = 2.0, np.radians(70), 0.02
    pose = (length / 2 * np.cos(first), length / 2 * np.sin(first), -first)
    ladder = mbd.Body("ladder", mass=5, inertia=5 * length**2 / 12, pose=pose)
    wall = mbd.RigidContact(
        "wall", mbd.Point(ladder.at(-length / 2, 0)), mbd.HalfPlane(mbd.ground.at(0, 0, angle=-np.pi / 2))
    )
    floor = mbd.RigidContact("floor", mbd.Point(ladder.at(length / 2, 0)), mbd.HalfPlane(mbd.ground.at(0, 0)))
    sin, cos = np.sin(first), np.cos(first)
    initial = [ladder.omega == speed, ladder.vx == speed * length / 2 * sin, ladder.vy == -speed * length / 2 * cos]
    motion = mbd.simulate(
        mbd.Mechanism([ladder], forces=[mbd.Gravity(), wall, floor]), np.linspace(0, 0.8, 41), initial=initial
    )
    assert happenings(motion) == ["wall opens"]
    height = np.sin(-motion.events[0].state[ladder.phi])
    assert height == pytest.approx(2 / 3 * (sin + speed**2 * length / (3 * G)), abs=1e-8)


def test_corner_that_carries_nothing_stays_open():
    """A guided block stands on two corners, of which the joint leaves one without a load; nothing chatters."""
    block, stands, mechanism = block_on_floor(mbd.DryFriction(0.4), pose=(0, HIGH + 0.1, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), block.at(0, 0, np.pi / 2))
    motion = mbd.simulate(mechanism.replace(joints=[guide]), np.linspace(0, 1, 11))
    assert happenings(motion) == ["stands.0 touches", "stands.1 touches"]
    assert motion.final[stands.normal_force] == pytest.approx(2 * G, rel=1e-9)


# --- stick and slip -----------------------------------------------------------------------------------------
def test_block_slides_on_an_incline_and_stops():
    """Coulomb's way on two corners, and no creep after it."""
    slope, mu, speed = np.radians(20), 0.5, 2.0
    pose = (0.05 * np.sin(slope), 0.05 * np.cos(slope), -slope)
    block = mbd.Body("block", mass=3.0, inertia=0.02, pose=pose)
    box = mbd.PolygonEdges(block.at(0, 0), [(-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)])
    ramp = mbd.HalfPlane(mbd.ground.at(0, 0, angle=-slope))
    lies = mbd.RigidContact("lies", box, ramp, friction=mbd.DryFriction(mu))
    motion = mbd.simulate(
        mbd.Mechanism([block], forces=[mbd.Gravity(), lies]),
        np.linspace(0, 3, 31),
        initial=[block.vx == speed * np.cos(slope), block.vy == -speed * np.sin(slope), block.omega == 0],
    )
    assert happenings(motion) == ["lies.0 stops", "lies.1 stops"]
    braking = G * (mu * np.cos(slope) - np.sin(slope))
    along = np.cos(slope) * motion[block.x] - np.sin(slope) * motion[block.y]
    assert along[-1] - along[0] == pytest.approx(speed**2 / 2 / braking, abs=1e-9)
    assert motion.events[0].t == pytest.approx(speed / braking, abs=1e-9)
    late = motion.t > motion.events[0].t
    assert np.ptp(along[late]) < 1e-12
    assert motion[lies.friction_force][late] == pytest.approx(-3 * G * np.sin(slope), rel=1e-9)
    assert motion[lies.normal_force] == pytest.approx(3 * G * np.cos(slope), rel=1e-9)
    power = motion[lies.power][~late]
    np.testing.assert_allclose(power, -mu * 3 * G * np.cos(slope) * (speed - braking * motion.t[~late]), rtol=1e-8)


def test_friction_of_a_block_is_shared_by_least_norm():
    """Under a growing push it breaks away at the static limit of both corners together; the less loaded one is full."""
    block, stands, mechanism = block_on_floor(mbd.DryFriction(0.2, 0.3), force=((0, -0.1), (4 * mbd.t, 0)))
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 21))
    assert happenings(motion) == ["stands.0 breaks away"]
    begin = 0.3 * 2 * G / 4
    assert motion.events[0].t == pytest.approx(begin, abs=1e-9)
    resting = (motion.t > 0) & (motion.t < begin)
    push, normal = 4 * motion.t[resting], motion[stands.normal_forces][resting][:, :2]
    np.testing.assert_allclose(normal[:, 1] - normal[:, 0], push * (HIGH - 0.1) / WIDE, rtol=1e-9)
    first = np.minimum(push / 2, 0.3 * normal[:, 0])
    assert np.any(first < push / 2)
    np.testing.assert_allclose(motion[stands.friction_forces][resting][:, :2], -np.array([first, push - first]).T)
    gone = motion.t[-1] - begin
    wanted = ((0.3 - 0.2) * 2 * G * gone + 2 * gone**2) / 2
    assert motion.final[block.vx] == pytest.approx(wanted, rel=1e-7)
    assert any("least norm" in note for note in motion.statistics.notes)


def test_block_tips_over_its_corner():
    """Pushed at its top it tips where the moment of the push passes that of its weight."""
    _, _, mechanism = block_on_floor(mbd.DryFriction(1.0), force=((0, HIGH), (4 * mbd.t, 0)))
    motion = mbd.simulate(mechanism, np.linspace(0, 1.5, 16))
    assert happenings(motion) == ["stands.0 opens"]
    assert motion.events[0].t == pytest.approx(2 * G * WIDE / (2 * HIGH) / 4, abs=1e-9)


def test_ball_slides_until_it_rolls():
    """With the inertia ``k m r²`` it rolls with ``v/(1 + k)`` after ``v/(μ g (1 + 1/k))``."""
    mu, speed, k = 0.2, 3.0, 2.4e-3 / 0.6 / 0.01
    ball, floor, mechanism = ball_above(0, mbd.DryFriction(mu))
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 21), initial=[ball.vx == speed, ball.vy == 0, ball.omega == 0])
    assert happenings(motion) == ["floor stops"]
    assert motion.events[0].t == pytest.approx(speed / (mu * G * (1 + 1 / k)), abs=1e-9)
    assert motion.final[ball.vx] == pytest.approx(speed / (1 + k), rel=1e-9)
    assert motion.final[ball.omega] == pytest.approx(-speed / (1 + k) / 0.1, rel=1e-9)
    assert motion.final[floor.friction_force] == pytest.approx(0, abs=1e-9)


@pytest.mark.slow
def test_friction_in_a_joint_and_contacts_together():
    """A slider with a dry guide hits a block that rubs on the floor; each comes to rest by its own friction."""
    slider = mbd.Body("slider", mass=1, inertia=0.1, pose=(0, 0.05, 0))
    block = mbd.Body("block", mass=2, inertia=0.02, pose=(1.0, 0.05, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0.05), slider.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(0.2))
    box = mbd.PolygonEdges(block.at(0, 0), [(-0.1, -0.05), (0.1, -0.05), (0.1, 0.05), (-0.1, 0.05)])
    floor = mbd.RigidContact("floor", box, mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.DryFriction(0.1))
    hit = mbd.RigidContact("hit", mbd.Circle(slider.at(0, 0), 0.05), box)
    mechanism = mbd.Mechanism([slider, block], [rail], forces=[mbd.Gravity(), rub, floor, hit])
    motion = mbd.simulate(mechanism, np.linspace(0, 2, 41), initial=[slider.vx == 3, slider.x == 0])
    assert happenings(motion) == ["hit touches", "rub stops", "floor.0 stops", "floor.1 stops"]
    common = np.sqrt(9 - 2 * 0.2 * G * 0.85) / 3
    assert motion.final[slider.x] == pytest.approx(0.85 + common**2 / (0.4 * G), abs=1e-8)
    assert motion.final[block.x] == pytest.approx(1 + common**2 / (0.2 * G), abs=1e-8)


def test_parts_that_do_not_act_on_each_other_are_decided_apart():
    """Ten balls at rest have four to the tenth choices, and no two of them meet."""
    balls = [mbd.Body(f"ball{k}", mass=1, inertia=0.01, pose=(0.3 * k, 0.1, 0)) for k in range(10)]
    plane = mbd.HalfPlane(mbd.ground.at(0, 0))
    floors = [
        mbd.RigidContact(f"floor{b.name}", mbd.Circle(b.at(0, 0), 0.1), plane, mbd.DryFriction(0.3)) for b in balls
    ]
    state = mbd.assemble(mbd.Mechanism(balls, forces=[mbd.Gravity(), *floors]))
    np.testing.assert_allclose([state[floor.normal_force] for floor in floors], G)


def test_what_joints_and_contacts_do_apart():
    """Eight balls at rest, and a slider with a dry guide that none of them acts on."""
    balls = [mbd.Body(f"ball{k}", mass=1, inertia=0.01, pose=(0.3 * k, 0.1, 0)) for k in range(8)]
    plane, law = mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.DryFriction(0.3)
    floors = [mbd.RigidContact(f"floor{b.name}", mbd.Circle(b.at(0, 0), 0.1), plane, law) for b in balls]
    slider = mbd.Body("slider", mass=1, inertia=0.1, pose=(0, 1, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 1), slider.at(0, 0))
    rub = mbd.JointFriction("rub", rail, law)
    state = mbd.assemble(
        mbd.Mechanism([*balls, slider], [rail], forces=[mbd.Gravity(), *floors, rub]), [slider.vx == 1]
    )
    np.testing.assert_allclose([state[floor.normal_force] for floor in floors], G)
    assert state[slider.ax] == pytest.approx(-0.3 * G)


def test_redundant_guides_leave_the_load_of_a_contact_unique():
    """A body between two guides of one direction comes down on rough ground; the guides cannot bear its weight."""
    body, up = mbd.Body("body", mass=2, inertia=0.1, pose=(0, 0.1, 0)), np.pi / 2
    guides = [mbd.Translational(f"guide{x}", mbd.ground.at(x, 0, up), body.at(x, 0, up)) for x in (0, 0.5)]
    outlines = mbd.Circle(body.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.RigidContact("floor", *outlines, mbd.DryFriction(0.3))
    state = mbd.assemble(mbd.Mechanism([body], guides, forces=[mbd.Gravity(), floor]))
    assert state[floor.normal_force] == pytest.approx(2 * G)


def test_shoe_of_a_carriage_brakes_beside_redundant_guides():
    """A carriage on two rails, and in it a shoe on two guides that slides on the ground under its own weight."""
    carriage, shoe = (
        mbd.Body(name, mass=m, inertia=0.1, pose=(0, 0.1, 0)) for name, m in (("carriage", 3), ("shoe", 2))
    )
    up, mu, speed = np.pi / 2, 0.3, 1.0
    joints = [mbd.Translational(f"rail{x}", mbd.ground.at(x, 0.1), carriage.at(x, 0)) for x in (0, 0.5)]
    joints += [mbd.Translational(f"guide{x}", carriage.at(x, 0, up), shoe.at(x, 0, up)) for x in (0, 0.5)]
    outlines = mbd.Circle(shoe.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0))
    brake = mbd.RigidContact("brake", *outlines, mbd.DryFriction(mu))
    mechanism = mbd.Mechanism([carriage, shoe], joints, forces=[mbd.Gravity(), brake])
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11), initial=[carriage.vx == speed])
    assert happenings(motion) == ["brake stops"]
    assert motion.events[0].t == pytest.approx(speed * 5 / (mu * 2 * G), abs=1e-9)
    assert motion.final[shoe.x] == pytest.approx(speed**2 * 5 / (2 * mu * 2 * G), abs=1e-9)
    slides = motion.t < motion.events[0].t
    np.testing.assert_allclose(motion[brake.friction_force][slides], -mu * 2 * G, rtol=1e-10)


def test_surfaces_that_a_driver_moves_rub():
    """Friction that moves nothing is the load of the driver; before the belt moves there is none."""
    belt, body = (mbd.Body(name, mass=2, inertia=0.1, pose=(0, y, 0)) for name, y in (("belt", 0), ("body", 0.1)))
    up, mu = np.pi / 2, 0.3
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), belt.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, up), body.at(0, 0, up))
    moves = mbd.Driver("moves", rail.displacement, mbd.if_else(mbd.t > 0.5, (mbd.t - 0.5) ** 2 / 2, 0))
    lies = mbd.RigidContact("lies", mbd.Circle(body.at(0, 0), 0.1), mbd.HalfPlane(belt.at(0, 0)), mbd.DryFriction(mu))
    mechanism = mbd.Mechanism([belt, body], [rail, guide], drivers=[moves], forces=[mbd.Gravity(), lies])
    motion = mbd.simulate(mechanism, np.linspace(0, 1, 11))
    late = motion.t > 0.55
    np.testing.assert_allclose(motion[lies.normal_force], 2 * G, rtol=1e-12)
    np.testing.assert_allclose(motion[lies.friction_force], np.where(late, mu * 2 * G, 0), rtol=1e-12)
    np.testing.assert_allclose(motion[moves.effort][late], 2 + mu * 2 * G, rtol=1e-12)


# --- impacts ------------------------------------------------------------------------------------------------
@pytest.mark.parametrize(("mu", "restitution"), [(0.1, 0.6), (1.5, 0.3)])
def test_oblique_bounce_of_a_rod(mu, restitution):
    """Its tip slides through the impact, or sticks in it: two equations of impulses."""
    length, mass, angle = 1.0, 2.0, np.radians(50)
    inertia = mass * length**2 / 12
    height = length / 2 * np.sin(angle)
    rod = mbd.Body("rod", mass=mass, inertia=inertia, pose=(0, height + 2e-3, -angle))
    plane = mbd.HalfPlane(mbd.ground.at(0, 0))
    tip = mbd.RigidContact("tip", mbd.Point(rod.at(length / 2, 0)), plane, mbd.DryFriction(mu), restitution)
    motion = mbd.simulate(
        mbd.Mechanism([rod], forces=[mbd.Gravity(), tip]),
        np.linspace(0, 0.01, 3),
        initial=[rod.vx == 1, rod.vy == -2, rod.omega == 0],
    )
    (event,) = motion.events
    before, after = (np.array([s[rod.vx], s[rod.vy], s[rod.omega]]) for s in (event.state, event.after))
    arm = length / 2 * np.array([np.cos(event.state[rod.phi]), np.sin(event.state[rod.phi])])
    rows = np.array([[0, 1, arm[0]], [1, 0, -arm[1]]])
    by_mass = rows / [mass, mass, inertia]
    matrix, speeds = rows @ by_mass.T, rows @ before
    impulse = np.linalg.solve(matrix, [-restitution * speeds[0], 0] - speeds)
    if abs(impulse[1]) > mu * impulse[0]:
        normal = -(1 + restitution) * speeds[0] / (matrix[0, 0] - mu * matrix[0, 1])
        impulse = np.array([normal, -mu * normal])
        assert (speeds + matrix @ impulse)[1] > 0
    np.testing.assert_allclose(after, before + by_mass.T @ impulse, atol=1e-12)
    np.testing.assert_allclose(-event.after[tip.impulses], impulse, rtol=1e-12)


def test_carriage_hits_a_wall_through_joints():
    """The pendulum that hangs on it answers by the impulse of its pin."""
    carriage = mbd.Body("carriage", mass=3, inertia=0.1)
    bob = mbd.Body("bob", mass=1, inertia=0.02, pose=(0.3, -0.4, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), carriage.at(0, 0))
    pin = mbd.Revolute("pin", carriage.at(0, 0), bob.at(-0.3, 0.4))
    plane = mbd.HalfPlane(mbd.ground.at(1, 0, angle=np.pi / 2))
    wall = mbd.RigidContact("wall", mbd.Circle(carriage.at(0, 0), 0.1), plane, restitution=0.5)
    motion = mbd.simulate(
        mbd.Mechanism([carriage, bob], [rail, pin], forces=[mbd.Gravity(), wall]),
        np.linspace(0, 0.5, 11),
        initial=[carriage.vx == 2, bob.omega == 1, carriage.x == 0.3, bob.phi == 0],
    )
    (event,) = motion.events
    state, after = event.state, event.after
    phi = state[bob.phi]
    x, y = np.array([[np.cos(phi), -np.sin(phi)], [np.sin(phi), np.cos(phi)]]) @ [0.3, -0.4]
    mass = np.array([[4, -y], [-y, 0.02 + x**2 + y**2]])  # in the coordinates x of the carriage and phi of the bob
    answer = np.linalg.solve(mass, [-1, 0])
    impulse = 1.5 * state[carriage.vx] / -answer[0]
    wanted = np.array([state[carriage.vx], state[bob.omega]]) + answer * impulse
    np.testing.assert_allclose([after[carriage.vx], after[bob.omega]], wanted, atol=1e-12)
    assert after[carriage.vx] == pytest.approx(-0.5 * state[carriage.vx], rel=1e-12)
    assert after[wall.impulse] == pytest.approx(impulse, rel=1e-12)
    jump = [after[bob.vx] - state[bob.vx], after[bob.vy] - state[bob.vy]]
    np.testing.assert_allclose(after[pin.impulse_on(bob).force], jump, atol=1e-12)


@pytest.mark.slow
def test_rocking_block():
    """Housner 1963: ``ω⁺/ω⁻ = 1 - 1.5 sin²α`` at each change of the corner."""
    alpha, start, radius = np.radians(15), np.radians(2), 0.5
    wide, high = radius * np.sin(alpha), radius * np.cos(alpha)
    x, y = np.array([[np.cos(start), np.sin(start)], [-np.sin(start), np.cos(start)]]) @ [-wide, high]
    block = mbd.Body("block", mass=3.0, inertia=radius**2, pose=(wide + x, y, -start))
    box = mbd.PolygonEdges(block.at(0, 0), [(-wide, -high), (wide, -high), (wide, high), (-wide, high)])
    rocks = mbd.RigidContact("rocks", box, mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.DryFriction(1.5))
    motion = mbd.simulate(mbd.Mechanism([block], forces=[mbd.Gravity(), rocks]), np.linspace(0, 0.9, 46))
    assert happenings(motion) == ["rocks.0 touches", "rocks.1 touches"] * 2
    ratios = [event.after[block.omega] / event.state[block.omega] for event in motion.events]
    np.testing.assert_allclose(ratios, 1 - 1.5 * np.sin(alpha) ** 2, rtol=1e-9)


@pytest.mark.slow
def test_flat_block_bounces_on_both_corners_to_rest():
    """Friction takes μ times the normal impulse in every bounce: in all, the speed falls as if it had slid."""
    mu, restitution, drop, speed = 0.4, 0.3, 0.05, 1.0
    block, _, mechanism = block_on_floor(mbd.DryFriction(mu), restitution, pose=(0, HIGH + drop, 0))
    motion = mbd.simulate(
        mechanism, np.linspace(0, 0.5, 11), initial=[block.vx == speed, block.vy == 0, block.omega == 0]
    )
    first = np.sqrt(2 * drop / G)
    after = motion.t > motion.events[-1].t
    assert happenings(motion)[:2] == ["stands.0 touches", "stands.1 touches"]
    np.testing.assert_allclose(motion[block.phi], 0, atol=1e-9)
    # the impulses balance the weight from the start of the fall on
    stop = speed / (mu * G)
    np.testing.assert_allclose(motion[block.vx][after], np.maximum(0, speed - mu * G * motion.t[after]), atol=1e-8)
    assert first < stop < 0.5 and happenings(motion)[-1] == "stands.1 stops"


def test_resets_of_the_user_act_on_what_is_closed():
    """A kick along the floor slides it; one into the floor is taken back at once."""
    ball, _, mechanism = ball_above(0, mbd.DryFriction(0.3))
    kick = mbd.Event("kick", mbd.t - 0.2, reset={ball.vx: 2.0})
    press = mbd.Event("press", mbd.t - 0.1, reset={ball.vy: -1.0})
    motion = mbd.simulate(mechanism, np.linspace(0, 0.3, 4), events=[kick, press])
    assert happenings(motion) == ["press", "kick"]
    assert abs(motion.events[0].after[ball.vy]) < 1e-15
    assert motion.final[ball.vx] == pytest.approx(2 - 0.3 * G * 0.1, rel=1e-9)
    assert motion.final[ball.y] == pytest.approx(0.1, abs=1e-12)


# --- what is refused ------------------------------------------------------------------------------------------
def sliding_rod(mu):
    """A rod that leans at 60° and slides on its tip."""
    angle = np.radians(60)
    rod = mbd.Body("rod", mass=1.0, inertia=1 / 12, pose=(0, np.sin(angle) / 2, angle))
    plane = mbd.HalfPlane(mbd.ground.at(0, 0))
    tip = mbd.RigidContact("tip", mbd.Point(rod.at(-0.5, 0)), plane, mbd.DryFriction(mu))
    return rod, mbd.Mechanism([rod], forces=[mbd.Gravity(), tip])


def test_painleve():
    """Pushed, a rod at 60° jams from ``μ = (1 + 3 cos²θ)/(3 sinθ cosθ)`` on; pulled, it does not."""
    critical = (1 + 3 * 0.25) / (3 * np.sin(np.radians(60)) * 0.5)
    times = np.linspace(0, 1e-3, 2)
    for mu, speed in ((1.02 * critical, 5), (0.98 * critical, -5)):
        rod, mechanism = sliding_rod(mu)
        mbd.simulate(mechanism, times, initial=[rod.vx == speed, rod.vy == 0, rod.omega == 0])
    rod, mechanism = sliding_rod(1.02 * critical)
    with pytest.raises(mbd.SimulationError, match="contact 'tip': no accelerations meet the laws .* t = 0 s.*Painlevé"):
        mbd.simulate(mechanism, times, initial=[rod.vx == -5, rod.vy == 0, rod.omega == 0])


def stack(count):
    """Rough balls on each other, on rough ground."""
    balls = [mbd.Body(f"ball{k}", mass=1, inertia=0.01, pose=(0, 0.1 + 0.2 * k, 0)) for k in range(count)]
    discs = [mbd.Circle(b.at(0, 0), 0.1) for b in balls]
    pairs = zip(discs, [mbd.HalfPlane(mbd.ground.at(0, 0)), *discs], strict=False)
    contacts = [mbd.RigidContact(f"c{k}", *pair, mbd.DryFriction(0.3)) for k, pair in enumerate(pairs)]
    return contacts, mbd.Mechanism(balls, forces=[mbd.Gravity(), *contacts])


def test_ten_rough_balls_stand_on_each_other():
    contacts, mechanism = stack(10)
    state = mbd.assemble(mechanism)
    np.testing.assert_allclose([state[contact.normal_force] for contact in contacts], G * np.arange(10, 0, -1))


def test_three_boxes_in_a_row_are_pushed():
    """Eight rough places that act on each other."""
    boxes = [mbd.Body(f"box{k}", mass=1, inertia=0.01, pose=(0.2 * k, 0.1, 0)) for k in range(3)]
    edges = [mbd.PolygonEdges(b.at(0, 0), [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)]) for b in boxes]
    ground, law = mbd.HalfPlane(mbd.ground.at(0, 0)), mbd.DryFriction(0.3)
    contacts = [mbd.RigidContact(f"under{k}", edge, ground, law) for k, edge in enumerate(edges)]
    noses = zip(boxes, edges[1:], strict=False)
    contacts += [mbd.RigidContact(f"nose of {b.name}", mbd.Circle(b.at(0.05, 0), 0.05), edge, law) for b, edge in noses]
    push = mbd.Force("push", boxes[0].at(-0.1, 0), (12, 0))
    state = mbd.assemble(mbd.Mechanism(boxes, forces=[mbd.Gravity(), push, *contacts]))
    np.testing.assert_allclose([state[b.ax] for b in boxes], 4 - 0.3 * G)


def test_penetration_and_too_many_places_are_refused(monkeypatch):
    """A start inside the floor, and more places in one stack than are sorted out."""
    _, _, mechanism = ball_above(-0.05)
    with pytest.raises(mbd.SimulationError, match=r"contact 'floor': the outlines penetrate .* 0.05 m at t = 0 s"):
        mbd.simulate(mechanism, duration=1)
    monkeypatch.setattr(complementarity, "CHOICES", 20)
    with pytest.raises(mbd.SimulationError, match="7 places that act on each other .* Contact with a stiffness"):
        mbd.simulate(stack(7)[1], duration=1)


def test_gain_of_energy_is_refused():
    """Kane's paradox: with Newton's restitution friction that turns the sliding back adds energy."""
    angle, mass = np.radians(65), 1.0
    rod = mbd.Body("rod", mass=mass, inertia=mass / 12, pose=(0, np.sin(angle) / 2, angle))
    plane = mbd.HalfPlane(mbd.ground.at(0, 0))
    tip = mbd.RigidContact("tip", mbd.Point(rod.at(-0.5, 0)), plane, mbd.DryFriction(2.0), restitution=1.0)
    mechanism = mbd.Mechanism([rod], forces=[mbd.Gravity(), tip])
    with pytest.raises(mbd.SimulationError, match="contact 'tip': the impact at t = 0 s would gain .*Kane"):
        mbd.simulate(mechanism, duration=0.1, initial=[rod.vx == 0.2, rod.vy == -1, rod.omega == 0])


def test_an_elastic_impact_may_reverse_all_speeds():
    """Speeds before and after add up to rounding then, which is no gain of energy; ``(-1/3, 2/3, 2/3)`` by Newton."""
    balls = [mbd.Body(f"ball {k}", mass=1, inertia=1e-12, pose=(0.1 * k, 0, 0)) for k in range(3)]
    hinges = [mbd.Revolute(f"hinge {k}", mbd.ground.at(0.1 * k, 1), ball.at(0, 1)) for k, ball in enumerate(balls)]
    rims = [mbd.Circle(ball.at(0, 0), 0.05) for ball in balls]
    touch = [mbd.RigidContact(f"touch {k}", rims[k], rims[k + 1], restitution=1) for k in range(2)]
    cradle = mbd.Mechanism(balls, hinges, forces=[mbd.Gravity(), *touch])
    start = [hinges[0].angle == -0.5, *(hinge.angle == 0 for hinge in hinges[1:]), *(b.omega == 0 for b in balls)]
    motion = mbd.simulate(cradle, duration=0.6, initial=start)
    struck = motion.events[0]
    shares = [struck.after[ball.omega] / struck.state[balls[0].omega] for ball in balls]
    np.testing.assert_allclose(shares, np.array([-1, 2, 2]) / 3, atol=1e-8)


def test_energy_that_impacts_take_is_no_error_of_the_run(monkeypatch):
    """A long run with impacts has a note on its energy only for what it lost between them."""
    monkeypatch.setattr(accuracy, "MANY_STEPS", 0)
    bob = mbd.Body("bob", mass=1, inertia=0.02, pose=(np.sin(1), -np.cos(1), 1))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), bob.at(0, 1))
    plane = mbd.HalfPlane(mbd.ground.at(-0.1, 0, -np.pi / 2))
    wall = mbd.RigidContact("wall", mbd.Circle(bob.at(0, 0), 0.1), plane, restitution=0.5)
    pendulum = mbd.Mechanism([bob], [hinge], forces=[mbd.Gravity(), wall])
    motion = mbd.simulate(pendulum, np.linspace(0, 3, 7), initial=[hinge.angle == 1, bob.omega == 0])
    assert len(motion.events) > 2
    assert motion.statistics.notes == []


def test_energy_that_friction_takes_between_outputs_is_no_error_of_the_run(monkeypatch):
    """A disc flies at the first outputs and rolls at the last: it has slid between them."""
    monkeypatch.setattr(accuracy, "MANY_STEPS", 0)
    disc = mbd.Body("disc", mass=2, inertia=0.01, pose=(0, 0.4, 0))
    outlines = mbd.Circle(disc.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0))
    floor = mbd.RigidContact("floor", *outlines, mbd.DryFriction(0.1))
    start = [disc.x == 0, disc.y == 0.4, disc.phi == 0, disc.vx == 3, disc.vy == 0, disc.omega == 0]
    motion = mbd.simulate(mbd.Mechanism([disc], forces=[mbd.Gravity(), floor]), [0, 0.2, 1.1], initial=start)
    assert motion.events[-1].name == "floor stops"
    assert motion.final[disc.vx] == pytest.approx(2)
    assert motion.statistics.notes == []


def test_names_of_its_events_are_taken():
    """An event of the user may not be called as one of the contact."""
    ball, _, mechanism = ball_above()
    with pytest.raises(mbd.SimulationError, match="'floor touches' has the name"):
        mbd.simulate(mechanism, duration=1, events=[mbd.Event("floor touches", ball.y)])


def test_smoothed_friction_that_depends_on_reactions_is_refused():
    """It is not sorted out together with contacts."""
    ball, floor, mechanism = ball_above()
    rail = mbd.Translational("rail", mbd.ground.at(0, 0, np.pi / 2), ball.at(0, 0, np.pi / 2))
    rub = mbd.JointFriction("rub", rail, mbd.Coulomb(0.3, 1e-3))
    with pytest.raises(mbd.ModelError, match="'rub' depends on reactions .* contact 'floor'; take DryFriction"):
        mbd.simulate(mechanism.replace(joints=[rail], forces=[floor, rub]), duration=1)


def test_assemble_knows_the_forces():
    """At rest the weight; at an impact there are no accelerations."""
    _, floor, mechanism = ball_above(0)
    assert mbd.assemble(mechanism)[floor.normal_force] == pytest.approx(0.6 * G, rel=1e-12)
    ball, floor, mechanism = ball_above(0)
    state = mbd.assemble(mechanism, [ball.vy == -1])
    assert state[ball.vy] == -1
    with pytest.raises(mbd.SingularityError, match="strike each other"):
        _ = state[floor.normal_force]


# --- forces that the motion leaves open ------------------------------------------------------------------------------
@pytest.mark.parametrize("law", [mbd.DryFriction(0.3), pytest.param(mbd.DryFriction(0.2, 0.4), marks=pytest.mark.slow)])
def test_ball_in_a_groove(law):
    """At rest ``N + T = m g/√2``, of least norm if ``T = μ N``; it turns from the couple ``r μ √2 m g/(1 + μ²)`` on."""
    mu, mass, radius, rate = float(law.static_coefficient), 1.0, 0.1, 10.0
    ball = mbd.Body("ball", mass=mass, inertia=0.4 * mass * radius**2, pose=(0, radius * np.sqrt(2), 0))
    sides = [
        mbd.RigidContact(
            name, mbd.Circle(ball.at(0, 0), radius), mbd.HalfPlane(mbd.ground.at(0, 0, np.radians(angle))), law
        )
        for name, angle in (("left", -45), ("right", 45))
    ]
    turn = mbd.Torque("turn", ball, rate * mbd.t)
    begin = radius * mu * np.sqrt(2) * mass * G / (1 + mu**2) / rate
    motion = mbd.simulate(mbd.Mechanism([ball], forces=[mbd.Gravity(), *sides, turn]), np.linspace(0, 1.2 * begin, 7))
    assert happenings(motion)[0] == "left breaks away"
    assert motion.events[0].t == pytest.approx(begin, rel=1e-6)
    for side in sides:
        assert motion.initial[side.normal_force] == pytest.approx(mass * G / np.sqrt(2) / (1 + mu), rel=1e-9)
        assert abs(motion.initial[side.friction_force]) == pytest.approx(
            mu * motion.initial[side.normal_force], rel=1e-9
        )
    resting = motion.t < begin
    assert not np.any(np.abs(motion[ball.omega][resting]) > 1e-12) and motion.final[ball.omega] > 0
    total = sum(
        motion[side.normal_force] - s * motion[side.friction_force] for side, s in zip(sides, (1, -1), strict=True)
    )
    np.testing.assert_allclose(total[resting], mass * G * np.sqrt(2), rtol=1e-9)
    assert any("contact 'left', contact 'right'" in note and "least norm" in note for note in motion.statistics.notes)


def test_box_against_a_smooth_wall():
    """Both corners at the wall share a central push, and the ground bears the weight evenly."""
    _, stands, mechanism = block_on_floor(force=((0, 0), (10 * mbd.t, 0)))
    wall = mbd.RigidContact("wall", stands.a, mbd.HalfPlane(mbd.ground.at(WIDE, 0, np.pi / 2)))
    motion = mbd.simulate(mechanism.replace(forces=[*mechanism.forces, wall]), np.linspace(0, 1, 5))
    assert not motion.events
    np.testing.assert_allclose(motion[stands.normal_forces][:, :2], G, rtol=1e-9)
    np.testing.assert_allclose(motion[wall.normal_forces][:, 1:3], np.outer(motion.t, [5, 5]), atol=1e-9)


# --- edges on edges --------------------------------------------------------------------------------------------
def two_boxes(friction=None, width=WIDE):
    """Two equal boxes in line, of 1 and 2 kg, and the contacts below them."""
    boxes = [mbd.Body(f"box{k}", mass=1.0 + k, inertia=0.01, pose=(0, 0.05 + 0.1 * k, 0)) for k in range(2)]
    corners = [(-width, -0.05), (width, -0.05), (width, 0.05), (-width, 0.05)]
    outlines = [mbd.PolygonEdges(box.at(0, 0), corners) for box in boxes]
    below = [mbd.HalfPlane(mbd.ground.at(0, 0)), outlines[0]]
    contacts = [mbd.RigidContact(f"c{k}", *pair, friction) for k, pair in enumerate(zip(outlines, below, strict=True))]
    return boxes, contacts, mbd.Mechanism(boxes, forces=[mbd.Gravity(), *contacts])


@pytest.mark.slow
def test_equal_boxes_in_line_rest():
    """Their corners meet; rounding at the ends of the edges closes nothing."""
    _, contacts, mechanism = two_boxes(mbd.DryFriction(0.3))
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 6))
    assert not motion.events
    for contact, load in zip(contacts, (3 * G, 2 * G), strict=True):
        np.testing.assert_allclose(motion[contact.normal_forces][:, :2], load / 2, rtol=1e-9)


@pytest.mark.slow
def test_box_slides_off_an_equal_one():
    """From the place in line it stands on one of its corners and one of the other box; edge stays on edge."""
    boxes, (_, upper), mechanism = two_boxes()
    upper_box, speed = boxes[1], 0.4
    motion = mbd.simulate(
        mechanism,
        np.linspace(0, 0.1, 3),
        initial=[upper_box.vx == speed, upper_box.vy == 0, upper_box.omega == 0, boxes[0].vx == 0, boxes[0].omega == 0],
    )
    assert motion.final[upper_box.phi] == pytest.approx(0, abs=1e-12)
    way = speed * 0.1
    arms = np.array([-WIDE, WIDE - way])  # of the corners that carry, about the middle of the upper box
    forces = motion.final[upper.normal_forces]
    loads = forces[forces > 0]
    assert loads.sum() == pytest.approx(2 * G, rel=1e-9) and sorted(loads) == pytest.approx(
        sorted(2 * G * np.abs(arms[::-1]) / (arms[1] - arms[0])), rel=1e-9
    )


@pytest.mark.slow
def test_box_tips_on_a_polygon_until_it_lies():
    """A corner stays the same place as the box passes 45°: it turns about it by its energy."""
    tilt, spin = np.radians(40), 2.0
    turned = np.array([[np.cos(tilt), np.sin(tilt)], [-np.sin(tilt), np.cos(tilt)]])
    x, y = -turned @ [WIDE, -HIGH]
    block, stands, _ = block_on_floor(pose=(x, y, -tilt))
    table = mbd.PolygonEdges(mbd.ground.at(0, -0.1), [(-1, -0.1), (1, -0.1), (1, 0.1), (-1, 0.1)])
    tips = mbd.RigidContact("tips", stands.a, table, mbd.DryFriction(2.0))
    motion = mbd.simulate(
        mbd.Mechanism([block], forces=[mbd.Gravity(), tips]),
        np.linspace(0, 0.1, 3),
        initial=[block.omega == -spin, block.vx == spin * y, block.vy == -spin * x],
    )
    assert not motion.events and motion.final[block.phi] < -np.radians(48)
    inertia = (2 / 3 + 2) * (WIDE**2 + HIGH**2)
    fast = np.sqrt(spin**2 + 2 * 2 * G * (y - motion.final[block.y]) / inertia)
    assert motion.final[block.omega] == pytest.approx(-fast, rel=1e-7)
    assert np.flatnonzero(motion.final[tips.normal_forces]) == [1]


# --- impulses ---------------------------------------------------------------------------------------------------
def test_friction_of_a_guide_acts_in_an_impact():
    """A slider is hit at 45°: the guide bears the same impulse across as along, and its friction takes μ of it."""
    mu, restitution, speed = 0.2, 0.5, 3 * np.sqrt(2)
    slider = mbd.Body("slider", mass=1, inertia=0.1)
    ball = mbd.Body("ball", mass=1, inertia=0.01, pose=(-0.2, 0.2, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slider.at(0, 0))
    rub = mbd.JointFriction("rub", rail, mbd.DryFriction(mu))
    hit = mbd.RigidContact("hit", *(mbd.Circle(b.at(0, 0), 0.1) for b in (ball, slider)), restitution=restitution)
    mechanism = mbd.Mechanism([slider, ball], [rail], forces=[rub, hit])
    motion = mbd.simulate(
        mechanism, np.linspace(0, 0.03, 3), initial=[ball.vx == 3, ball.vy == -3, slider.vx == 0, slider.x == 0]
    )
    (event,) = motion.events
    impulse = (1 + restitution) * speed / (1 + (1 - mu) / 2)
    assert event.after[hit.impulse] == pytest.approx(impulse, rel=1e-9)
    assert event.after[slider.vx] == pytest.approx((1 - mu) * impulse / np.sqrt(2), rel=1e-9)


def test_impulses_at_the_start_and_of_a_reset():
    """A start that touches with a speed is an event; the floor's answer to a reset belongs to that event."""
    ball, floor, mechanism = ball_above(0, restitution=0.5)
    (event,) = mbd.simulate(mechanism, duration=0.1, initial=[ball.vy == -2]).events
    assert (event.name, event.t) == ("floor touches", 0)
    assert event.state[ball.vy] == -2 and event.after[ball.vy] == pytest.approx(1, rel=1e-12)
    assert event.after[floor.impulse] == pytest.approx(0.6 * 3, rel=1e-12)
    kick = mbd.Event("kick", mbd.t - 0.1, reset={ball.vy: -1.0})
    (event,) = mbd.simulate(mechanism, duration=0.15, initial=[ball.vy == 0], events=[kick]).events
    assert event.name == "kick" and event.after[floor.impulse] == pytest.approx(0.6 * 1.5, rel=1e-12)


@pytest.mark.parametrize("friction", [None, mbd.DryFriction(0.3)])
def test_driven_into_the_floor(friction):
    """That no force can stop a driver is no paradox of friction."""
    ball, _, mechanism = ball_above(0.2, friction)
    drive = mbd.Constraint("drive", ball.y - 0.3 + mbd.t)
    with pytest.raises(mbd.SimulationError, match="contact 'floor': joints, drivers .* press .* at t = 0.2 s"):
        mbd.simulate(mechanism.replace(joints=[drive]), duration=0.5)


# --- closed forms ----------------------------------------------------------------------------------------------------
@pytest.mark.slow
def test_three_blocks_of_which_the_middle_one_is_pushed():
    """It slides off the lowest one, which rests, and drags the upper one along."""
    mus, push, half = (0.3, 0.2, 0.1), 20.0, 0.05
    blocks = [mbd.Body(f"block{k}", mass=1, inertia=0.01, pose=(0.01 * k, half + 2 * half * k, 0)) for k in range(3)]
    corners = [(-WIDE, -half), (WIDE, -half), (WIDE, half), (-WIDE, half)]
    boxes = [mbd.PolygonEdges(block.at(0, 0), corners) for block in blocks]
    below = [mbd.HalfPlane(mbd.ground.at(0, 0)), *boxes]
    contacts = [
        mbd.RigidContact(f"c{k}", box, below[k], mbd.DryFriction(mu))
        for k, (box, mu) in enumerate(zip(boxes, mus, strict=True))
    ]
    forces = [mbd.Gravity(), *contacts, mbd.Force("push", blocks[1].at(0, 0), (push, 0))]
    state = mbd.assemble(mbd.Mechanism(blocks, forces=forces))
    wanted = [0, push - 0.2 * 2 * G - 0.1 * G, 0.1 * G]
    np.testing.assert_allclose([state[block.ax] for block in blocks], wanted, atol=1e-9)
    np.testing.assert_allclose([state[contact.normal_force] for contact in contacts], [3 * G, 2 * G, G], rtol=1e-9)


@pytest.mark.parametrize("spin", [10.0, -160.0])
def test_superball(spin):
    """Elastic and rough: Newton's normal speed turns back, and friction stops the surface, or slides with μ of it."""
    mass, radius, mu, inertia = 0.6, 0.1, 0.5, 2.4e-3
    ball, floor, mechanism = ball_above(0, mbd.DryFriction(mu), restitution=1.0)
    vx, vy = 1.0, -3.0
    (event,) = mbd.simulate(mechanism, duration=0.1, initial=[ball.vx == vx, ball.vy == vy, ball.omega == spin]).events
    normal, slip = -2 * mass * vy, vx + radius * spin
    stop = slip / (1 / mass + radius**2 / inertia)  # impulse that stops the surface
    impulse = -np.sign(slip) * min(abs(stop), mu * normal)
    after = event.after
    assert after[floor.impulse] == pytest.approx(normal, rel=1e-12)
    assert [after[ball.vx], after[ball.vy], after[ball.omega]] == pytest.approx(
        [vx + impulse / mass, -vy, spin + radius * impulse / inertia], rel=1e-10
    )
    assert (abs(stop) < mu * normal) == (spin > 0)


@pytest.mark.parametrize("omega", [0.0, 6.0])
def test_sliding_rod(omega):
    """A rod that slides on its tip presses on the ground; turning fast, it lifts off at once."""
    angle, mu, mass, length = np.radians(60), 0.2, 1.0, 1.0
    rod, mechanism = sliding_rod(mu)
    tip = mechanism.forces[-1]
    sin, cos = np.sin(angle), np.cos(angle)
    initial = [rod.omega == omega, rod.vx == 3 + omega * length / 2 * -sin, rod.vy == omega * length / 2 * cos]
    state = mbd.assemble(mechanism, initial)
    # of the tip at (-l/2, 0): 0 = (N/m - g) - l/2 cos α + l/2 ω² sin, I α = N l/2 (-cos) + F l/2 sin, F = -μ N
    lever = length / 2
    by_load = 1 / mass - lever * cos * (-lever * cos - mu * lever * sin) * 12 / mass / length**2
    load = max(0.0, (G - lever * omega**2 * sin) / by_load)
    assert state[tip.normal_force] == pytest.approx(load, rel=1e-9)
    assert state[rod.ay] == pytest.approx(load / mass - G, abs=1e-9) and (load > 0) == (omega == 0)


@pytest.mark.slow
def test_ratchet():
    """A rack that is pulled back is kept by its pawl; the face and the slope that it touches share the load."""
    rack, pull, lever, radius = mbd.Body("rack", mass=2, inertia=0.1), 4.0, 0.3, 0.01
    slope = np.array([0.04, 0.1]) / np.hypot(0.04, 0.1)
    height = (slope @ [0.1, 0] + radius - slope[0] * (0.1 - radius)) / slope[1]  # of the tip behind a face
    pawl = mbd.Body("pawl", mass=0.5, inertia=0.5 * lever**2 / 12, pose=(0.2 - radius + lever / 2, height, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), rack.at(0, 0))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0.2 - radius + lever, height), pawl.at(lever / 2, 0))
    tip = mbd.Circle(pawl.at(-lever / 2, 0), radius)
    teeth = [mbd.PolygonEdges(rack.at(0.1 * k, 0), [(0, -0.02), (0.1, -0.02), (0.1, 0.0), (0, 0.04)]) for k in range(3)]
    contacts = [mbd.RigidContact(f"tooth{k}", tip, tooth) for k, tooth in enumerate(teeth)]
    forces = [mbd.Gravity(), *contacts, mbd.Force("pull", rack.at(0, 0), (-pull, 0))]
    motion = mbd.simulate(
        mbd.Mechanism([rack, pawl], [rail, pivot], forces=forces),
        np.linspace(0, 0.6, 3),
        initial=[rack.x == 0, rack.vx == 0.8, pawl.omega == 0, pawl.phi == 0],
    )
    assert happenings(motion) == ["tooth1 touches", "tooth1 opens", "tooth0 touches", "tooth1 touches"]
    assert motion.final[rack.x] == pytest.approx(0.1, abs=1e-12) and abs(motion.final[rack.vx]) < 1e-12
    weight = 0.5 * G / 2 / slope[1]
    wanted = [weight, pull + slope[0] * weight, 0]
    np.testing.assert_allclose([motion.final[c.normal_force] for c in contacts], wanted, rtol=1e-9, atol=1e-12)
