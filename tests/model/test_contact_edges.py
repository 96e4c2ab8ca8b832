"""Contact of bars, polygons and holes with each other: geometry by other means; blocks that stand, slide, tip."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
FIRM = mbd.HuntCrossley(1e7, exponent=1.5, damping=5.0)
DAMPED = mbd.HuntCrossley(1e7, exponent=1.5, damping=200.0)


def box(width, height):
    """Corners of a block about its centre."""
    w, h = width / 2, height / 2
    return [(-w, -h), (w, -h), (w, h), (-w, h)]


def random_polygon(rng, radius):
    """Corners on a circle, none of them far from its neighbours, the centre inside."""
    while True:
        angles = np.sort(rng.uniform(0, 2 * np.pi, rng.integers(3, 7)))
        steps = np.diff(np.r_[angles, angles[0] + 2 * np.pi])
        if 0.2 < steps.min() and steps.max() < 2.8:
            return radius * np.column_stack([np.cos(angles), np.sin(angles)])


def placed(points, q):
    """Points of a body in a pose."""
    c, s = np.cos(q[2]), np.sin(q[2])
    return np.asarray(points) @ np.array([[c, s], [-s, c]]) + q[:2]


def from_segment(p, a, b):
    """Distance of a point from a segment."""
    share = np.clip(np.dot(p - a, b - a) / np.dot(b - a, b - a), 0, 1)
    return np.hypot(*(p - a - share * (b - a)))


def sides(points, closed=True):
    """Pairs of neighbours."""
    return [(points[i], points[(i + 1) % len(points)]) for i in range(len(points) if closed else len(points) - 1)]


def distance(first, second, closed=(True, True)):
    """Distance of two outlines that do not overlap, corner by corner."""
    found = []
    for one, other, whole in ((first, second, closed[1]), (second, first, closed[0])):
        found += [from_segment(p, a, b) for p in one for a, b in sides(other, whole)]
    return min(found)


def separation(first, second):
    """Largest distance of two convex polygons along the normal of an edge; negative where they overlap."""
    found = []
    for one, other in ((first, second), (second, first)):
        for a, b in sides(one):
            normal = np.array([b[1] - a[1], a[0] - b[0]]) / np.hypot(*(b - a))
            found.append(min(normal @ (p - a) for p in other))
    return max(found)


@pytest.mark.parametrize("seed", range(8))
def test_gap_of_polygons(seed):
    """Apart, the gap is their distance; where they overlap it is negative and no deeper than they do."""
    rng = np.random.default_rng(seed)
    a, b = mbd.Body("a", mass=1, inertia=1), mbd.Body("b", mass=1, inertia=1)
    points = random_polygon(rng, 1.0), random_polygon(rng, 0.7)
    contact = mbd.Contact("c", mbd.PolygonEdges(a.at(0, 0), points[0]), mbd.PolygonEdges(b.at(0, 0), points[1]), FIRM)
    gap = ca.Function("gap", [a.q, b.q], [contact.gap])
    apart = 0
    for _ in range(40):
        far, angle = rng.uniform(0.6, 2.2), rng.uniform(0, 2 * np.pi)
        poses = np.r_[0, 0, rng.uniform(-3, 3)], np.r_[far * np.cos(angle), far * np.sin(angle), rng.uniform(-3, 3)]
        first, second = placed(points[0], poses[0]), placed(points[1], poses[1])
        found, between = float(gap(*poses)), separation(first, second)
        if between > 0:
            apart += 1
            assert found == pytest.approx(distance(first, second), abs=1e-12)
        else:
            assert found < 0
            assert found >= between - 0.5 * abs(between) - 1e-12
    assert 5 < apart < 35


@pytest.mark.parametrize("seed", range(4))
def test_gap_of_bars(seed):
    """Bar beside bar, and bar beside polygon."""
    rng = np.random.default_rng(seed)
    a, b = mbd.Body("a", mass=1, inertia=1), mbd.Body("b", mass=1, inertia=1)
    block = random_polygon(rng, 0.5)
    bar, other = mbd.Segment(a.at(0, 0), 1.0, radius=0.02), mbd.Segment(b.at(0, 0), 0.6, radius=0.03)
    bars = mbd.Contact("bars", bar, other, FIRM)
    beside = mbd.Contact("beside", mbd.PolygonEdges(b.at(0, 0), block), bar, FIRM)
    gaps = ca.Function("gaps", [a.q, b.q], [bars.gap, beside.gap])
    ends, others = np.array([[-0.5, 0], [0.5, 0]]), np.array([[-0.3, 0], [0.3, 0]])
    for _ in range(30):
        far, angle = rng.uniform(1.15, 2.0), rng.uniform(0, 2 * np.pi)
        poses = np.r_[0, 0, rng.uniform(-3, 3)], np.r_[far * np.cos(angle), far * np.sin(angle), rng.uniform(-3, 3)]
        found = [float(gap) for gap in gaps(*poses)]
        line = placed(ends, poses[0])
        assert found[0] == pytest.approx(distance(line, placed(others, poses[1]), (False, False)) - 0.05, abs=1e-9)
        assert found[1] == pytest.approx(distance(line, placed(block, poses[1]), (False, True)) - 0.02, abs=1e-9)


def test_holes():
    """A disc, a bar and a block in a bore: by hand; what does not go in is refused."""
    hole = mbd.HollowCircle(mbd.ground.at(0.2, 0.1), 1.0)
    body = mbd.Body("body", mass=1, inertia=1, pose=(0.2 + 0.3, 0.1 - 0.4, 0))
    disc = mbd.Contact("disc", mbd.Circle(body.at(0, 0), 0.45), hole, FIRM)
    bar = mbd.Contact("bar", mbd.Segment(body.at(-0.3, 0.4), 1.2, radius=0.1), hole, FIRM)
    block = mbd.Contact("block", hole, mbd.PolygonEdges(body.at(-0.3, 0.4), box(1.2, 1.6)), FIRM)
    state = mbd.assemble(mbd.Mechanism([body], forces=[disc, bar, block]))
    assert state[disc.gap] == pytest.approx(0.05)
    np.testing.assert_allclose(state[disc.normal], [-0.6, 0.8], atol=1e-12)
    assert state[bar.gap] == pytest.approx(0.3)
    assert state[block.gap] == pytest.approx(0.0, abs=1e-12)
    with pytest.raises(mbd.ModelError, match=r"'disc'.*does not go into a hole"):
        mbd.Contact("disc", mbd.Circle(body.at(0, 0), 1.0), hole, FIRM)


def test_a_marble_rolls_in_a_drum():
    """Small swings of a rolling disc in a bore: ``ω² = 2 g/(3 (R - r))``."""
    big, small = 1.0, 0.1
    angle = 0.05
    marble = mbd.Body("marble", mass=1, inertia=0.5 * small**2, pose=(0.9 * np.sin(angle), -0.9 * np.cos(angle), 0))
    drum = mbd.HollowCircle(mbd.ground.at(0, 0), big)
    law = mbd.HuntCrossley(1e8, damping=1.0)
    touch = mbd.Contact("touch", mbd.Circle(marble.at(0, 0), small), drum, law, mbd.Coulomb(0.8, 1e-4))
    period = 2 * np.pi / np.sqrt(2 * G / (3 * (big - small))) * (1 + angle**2 / 16)
    motion = mbd.simulate(mbd.Mechanism([marble], forces=[mbd.Gravity(), touch]), np.linspace(0, period, 101))
    assert motion[marble.x][-1] == pytest.approx(motion[marble.x][0], rel=2e-3)
    assert motion[marble.x][50] == pytest.approx(-motion[marble.x][0], rel=2e-3)


@pytest.mark.parametrize("seed", range(6))
def test_forces_of_polygons_are_the_gradient_of_the_energy(seed):
    """Without damping ``Q = -dV/dq`` at shallow overlaps, and the forces balance in force and moment."""
    rng = np.random.default_rng(seed)
    points = random_polygon(rng, 1.0), random_polygon(rng, 0.7)
    while True:
        far, angle = rng.uniform(0.8, 1.8), rng.uniform(0, 2 * np.pi)
        poses = np.r_[0, 0, rng.uniform(-3, 3)], np.r_[far * np.cos(angle), far * np.sin(angle), rng.uniform(-3, 3)]
        if -0.02 < separation(placed(points[0], poses[0]), placed(points[1], poses[1])) < -0.005:
            break
    a, b = mbd.Body("a", mass=1, inertia=1, pose=poses[0]), mbd.Body("b", mass=1, inertia=1, pose=poses[1])
    outlines = [mbd.PolygonEdges(body.at(0, 0), p) for body, p in zip((a, b), points, strict=True)]
    contact = mbd.Contact("c", *outlines, mbd.HuntCrossley(1e4, exponent=2))
    mechanism = mbd.Mechanism([a, b], forces=[contact])
    state, eom = mbd.assemble(mechanism), mbd.equations(mechanism)
    load = state[eom.Q]
    assert np.abs(load).max() > 0.1
    np.testing.assert_allclose(load, -state[ca.gradient(eom.potential, eom.q)], rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(load[:2] + load[3:5], 0, atol=1e-9)
    assert sum(load[k + 2] + state.q[k] * load[k + 1] - state.q[k + 1] * load[k] for k in (0, 3)) == pytest.approx(0)


@pytest.mark.parametrize("kind", ["block", "bar", "hole"])
def test_derivatives_are_finite(kind):
    """First and second ones, apart, touching, aligned, and one centre on the other."""
    a, b = mbd.Body("a", mass=1, inertia=1), mbd.Body("b", mass=1, inertia=1)
    block = mbd.PolygonEdges(a.at(0, 0), box(1, 0.4))
    other = {
        "block": mbd.PolygonEdges(b.at(0, 0), box(1, 0.4)),
        "bar": mbd.Segment(b.at(0, 0), 1.0, radius=0.2),
        "hole": mbd.HollowCircle(b.at(0, 0), np.hypot(0.5, 0.2)),
    }[kind]
    contact = mbd.Contact("touch", block, other, FIRM, mbd.Coulomb(0.3, 1e-3))
    x = ca.vertcat(a.q, a.v, b.q, b.v)
    for expression in (contact.gap, contact.normal_force, contact.friction_force):
        hessian, gradient = ca.hessian(expression, x)
        function = ca.Function("h", [x], [hessian, gradient])
        for height in (0.0, 0.39, 0.4, 0.5, 2.0):
            point = np.zeros(12)
            point[1] = height
            for result in function(point):
                assert np.all(np.isfinite(result.full())), (kind, height)


# --- blocks on blocks ------------------------------------------------------------------------------
def standing(offset, friction=0.6, count=2, law=DAMPED):
    """Equal blocks on each other, the lowest fixed to the ground."""
    base = mbd.PolygonEdges(mbd.ground.at(0, -0.1), box(0.4, 0.2))
    bodies, contacts, below = [], [], base
    for k in range(1, count):
        block = mbd.Body(f"block {k}", mass=2, inertia=2 * (0.4**2 + 0.2**2) / 12, pose=(k * offset, 0.2 * k - 0.1, 0))
        outline = mbd.PolygonEdges(block.at(0, 0), box(0.4, 0.2))
        contacts.append(mbd.Contact(f"on {k}", outline, below, law, mbd.Coulomb(friction, 1e-4)))
        bodies.append(block)
        below = outline
    return bodies, contacts, mbd.Mechanism(bodies, forces=[mbd.Gravity(), *contacts])


@pytest.mark.slow
@pytest.mark.parametrize("offset", [0.0, 1e-9, 1e-4, 0.1, 0.19, -0.15])
def test_equal_blocks_stand(offset):
    """It sinks in by what the two corners that carry it ask for, and stays."""
    (block,), (contact,), mechanism = standing(offset)
    motion = mbd.simulate(mechanism, np.linspace(0, 1.0, 21))
    final = motion.final
    reach = 0.4 - abs(offset)  # between the two corners, and how far the centre of mass is from each
    shares = np.sort(np.array([0.2 - abs(offset), 0.2]) / reach)
    forces = np.sort(final[contact.normal_forces])
    np.testing.assert_allclose(forces[-2:], shares * 2 * G, rtol=1e-2)
    np.testing.assert_allclose(forces[:2], 0, atol=1e-9)
    assert np.abs(motion[block.x] - offset).max() < 1e-4
    assert final[contact.gap] == pytest.approx(-((shares[1] * 2 * G / 1e7) ** (2 / 3)), rel=2e-3)
    assert np.abs(final[block.phi]) < 1e-3


def test_a_block_beyond_the_edge_falls():
    """With its centre of mass beyond the lower block it tips."""
    (block,), _, mechanism = standing(0.21)
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 21))
    assert motion[block.phi][-1] < -0.1
    assert motion.energy.total[-1] <= motion.energy.total[0]


@pytest.mark.slow
def test_a_stack_stands():
    """Three equal blocks on a fourth one: each contact carries what is above it."""
    bodies, contacts, mechanism = standing(0.0, count=4)
    motion = mbd.simulate(mechanism, np.linspace(0, 0.5, 11))
    for k, contact in enumerate(contacts):
        assert motion[contact.normal_force][-1] == pytest.approx(2 * G * (3 - k), rel=1e-3)
    assert max(np.abs(motion[body.x]).max() for body in bodies) < 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("mu, moves", [(0.2, True), (0.5, False)])
def test_a_block_on_a_wedge(mu, moves):
    """It slides with ``g (sin α - μ cos α)`` above the angle of friction, and stays below it."""
    angle = 0.35
    wedge = mbd.PolygonEdges(mbd.ground.at(0, 0), [(-2, 0), (2, 0), (-2, 4 * np.tan(angle))])
    start = np.array([-1.0, 3 * np.tan(angle)]) + 0.1 * np.array([np.sin(angle), np.cos(angle)])
    block = mbd.Body("block", mass=2, inertia=0.03, pose=(*start, -angle))
    feet = mbd.Contact("feet", mbd.PolygonEdges(block.at(0, 0), box(0.4, 0.2)), wedge, FIRM, mbd.Coulomb(mu, 1e-5))
    motion = mbd.simulate(mbd.Mechanism([block], forces=[mbd.Gravity(), feet]), np.linspace(0, 0.6, 61))
    way = np.hypot(motion[block.x] - start[0], motion[block.y] - start[1])[-1]
    # over 0.6 s, of which the first hundredth goes into settling
    exact = 0.5 * G * (np.sin(angle) - mu * np.cos(angle)) * 0.6**2 if moves else 0.0
    assert way == pytest.approx(exact, abs=1e-3)
    assert np.abs(motion[block.phi] + angle).max() < 1e-3


@pytest.mark.slow
def test_a_plank_on_two_bars_and_a_block_on_it():
    """Bar on bar and block on bar: forces by the lever."""
    posts = [mbd.Segment(mbd.ground.at(x, -0.25, angle=np.pi / 2), 0.5, radius=0.02) for x in (-0.5, 0.5)]
    plank = mbd.Body("plank", mass=1, inertia=0.2, pose=(0.1, 0.04, 0))
    block = mbd.Body("block", mass=3, inertia=0.02, pose=(0.3, 0.16, 0))
    bar = mbd.Segment(plank.at(0, 0), 1.6, radius=0.02)
    left, right = (mbd.Contact(f"post {k}", bar, post, FIRM, mbd.Coulomb(0.5, 1e-4)) for k, post in enumerate(posts))
    load = mbd.Contact(
        "load", mbd.PolygonEdges(block.at(0, 0), box(0.2, 0.2)), bar, FIRM, mbd.Coulomb(0.5, velocity_tolerance=1e-4)
    )
    mechanism = mbd.Mechanism([plank, block], forces=[mbd.Gravity(), left, right, load])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.6, 21))
    assert motion[load.normal_force][-1] == pytest.approx(3 * G, rel=1e-3)
    assert motion[right.normal_force][-1] == pytest.approx((1 * 0.6 + 3 * 0.8) * G, rel=2e-3)
    assert motion[left.normal_force][-1] == pytest.approx((1 * 0.4 + 3 * 0.2) * G, rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_energy_never_grows(seed):
    """Blocks, bars and discs thrown onto each other in a bore, with friction."""
    rng = np.random.default_rng(seed)
    law, rub = mbd.HuntCrossley(1e6, damping=0.3), mbd.Coulomb(0.4, 1e-3)
    bodies, outlines = [], []
    for k in range(3):
        spin = (*rng.uniform(-2, 2, 2), rng.uniform(-8, 8))
        place = 0.45 * np.array([np.cos(2.1 * k), np.sin(2.1 * k)])
        body = mbd.Body(f"b{k}", mass=1, inertia=0.02, pose=(*place, rng.uniform(-3, 3)), velocity=spin)
        bodies.append(body)
        shape = (k + seed) % 3
        if shape == 0:
            outlines.append(mbd.PolygonEdges(body.at(0, 0), random_polygon(rng, 0.22)))
        elif shape == 1:
            outlines.append(mbd.Segment(body.at(0, 0), 0.3, radius=0.05))
        else:
            outlines.append(mbd.PolygonEdges(body.at(0, 0), box(0.3, 0.2)))
    hole = mbd.HollowCircle(mbd.ground.at(0, 0), 0.9)
    contacts = [mbd.Contact(f"wall {k}", outline, hole, law, rub) for k, outline in enumerate(outlines)]
    for k in range(3):
        contacts.append(mbd.Contact(f"pair {k}", outlines[k], outlines[(k + 1) % 3], law, rub))
    mechanism = mbd.Mechanism(bodies, forces=[mbd.Gravity(), *contacts])
    motion = mbd.simulate(mechanism, np.linspace(0, 1.0, 401))
    energy = motion.energy.total
    size = np.ptp(motion.energy.kinetic)
    assert np.diff(energy).max() < 1e-3 * size
    assert energy[-1] < energy[0]
    assert any(motion[contact.normal_force].max() > 0 for contact in contacts[3:])


def test_refuses():
    """What cannot touch says so, with what to do."""
    a, b = mbd.Body("a", mass=1, inertia=1), mbd.Body("b", mass=1, inertia=1)
    block, thin = mbd.PolygonEdges(a.at(0, 0), box(1, 1)), mbd.Segment(b.at(0, 0), 1.0)
    with pytest.raises(mbd.ModelError, match=r"'c': a corner passes through a bar without thickness.*radius="):
        mbd.Contact("c", block, thin, FIRM)
    with pytest.raises(mbd.ModelError, match=r"'c': two bars without thickness.*radius="):
        mbd.Contact("c", mbd.Segment(a.at(0, 0), 1.0), thin, FIRM)
    with pytest.raises(mbd.ModelError, match=r"'c': there is no contact of HalfPlane and HalfPlane"):
        mbd.Contact("c", mbd.HalfPlane(a.at(0, 0)), mbd.HalfPlane(b.at(0, 0)), FIRM)
    with pytest.raises(mbd.ModelError, match=r"HalfPlane and HollowCircle|HollowCircle and HalfPlane"):
        mbd.Contact("c", mbd.HollowCircle(a.at(0, 0), 1.0), mbd.HalfPlane(b.at(0, 0)), FIRM)
    star = np.arange(5) * 4 * np.pi / 5
    with pytest.raises(mbd.ModelError, match="goes round 2 times"):
        mbd.PolygonEdges(a.at(0, 0), np.column_stack([np.cos(star), np.sin(star)]))
    with pytest.raises(mbd.ModelError, match=r"'c': law must be a function of penetration and rate: too many"):
        mbd.Contact("c", block, mbd.Circle(b.at(0, 0), 0.1), lambda depth: 1e5 * depth)
    with pytest.raises(mbd.ModelError, match=r"'c'.*friction="):
        mbd.Contact("c", block, mbd.Circle(b.at(0, 0), 0.1), mbd.Coulomb(0.3, 1e-3))
    with pytest.raises(mbd.ModelError, match="cuts itself"):
        mbd.PolygonEdges(a.at(0, 0), [(0, 0), (2, 0), (0, 1), (2, 1)])


def test_outlines_that_are_apart_do_not_touch():
    """Whatever two outlines are, the cheap test of their distance is positive only if all gaps are open."""
    rng, law = np.random.default_rng(2), mbd.HuntCrossley(1e3)
    a, b = (mbd.Body(name, mass=1, inertia=1) for name in "ab")
    corners = [(-0.6, -0.2), (0.5, -0.3), (0.7, 0.1), (0.0, 0.4)]
    first = [
        mbd.Circle(a.at(0.1, 0.2), 0.4),
        mbd.Segment(a.at(0.1, -0.1, 0.3), 1.0, 0.1),
        mbd.PolygonEdges(a.at(0.1, 0), corners),
    ]
    second = [
        mbd.Point(b.at(0.2, 0.1)),
        mbd.Circle(b.at(0.1, 0), 0.3),
        mbd.Segment(b.at(0, 0.1, 0.2), 0.8, 0.05),
        mbd.PolygonEdges(b.at(0, 0.1, 1.0), corners),
        mbd.HalfPlane(b.at(0, 0.1, 0.4)),
        mbd.HollowCircle(b.at(0, 0.1), 2.0),
    ]
    q = rng.normal(size=(6, 2000)) * np.array([1.2, 1.2, 3, 1.2, 1.2, 3])[:, None]
    for one in first:
        for other in second:
            contact = mbd.Contact("c", one, other, law)
            function = ca.Function("f", [a.q, b.q], [contact.watched_clearance, ca.mmin(contact.gaps)])
            apart, gap = (part.full().ravel() for part in function(q[:3], q[3:]))
            assert np.any(apart > 0) and not np.any((apart > 0) & (gap <= 0))
