"""Contact: geometry by hand, restitution, rolling, tipping, energy, derivatives."""

from __future__ import annotations

import re
import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
LAW = mbd.HuntCrossley(1e6, exponent=1.5, damping=0.5)
FLOOR = mbd.HalfPlane(mbd.ground.at(0, 0))


def free_body(x=0.0, y=1.0, phi=0.0, mass=1.0, inertia=0.1, **more):
    """A body that touches something."""
    return mbd.Body("body", mass=mass, inertia=inertia, pose=(x, y, phi), **more)


def at_start(contact, *bodies):
    """State in the estimated poses."""
    return mbd.assemble(mbd.Mechanism(bodies=list(bodies), forces=[contact]))


# --- geometry -----------------------------------------------------------------------------
def other(marker):
    return {
        "circle": mbd.Circle(marker, 0.3),
        "bar": mbd.Segment(marker, 2.0, radius=0.1),
        "block": mbd.PolygonEdges(marker, [(-1, -0.5), (1, -0.5), (1, 0.5), (-1, 0.5)]),
        "plane": mbd.HalfPlane(marker),
    }


@pytest.mark.parametrize(
    "kind, x, y, gap, normal",
    [
        ("circle", 3.0, 4.0, 5 - 0.2 - 0.3, (0.6, 0.8)),
        ("bar", 0.5, 1.0, 1 - 0.2 - 0.1, (0, 1)),
        ("bar", 0.5, -1.0, 1 - 0.2 - 0.1, (0, -1)),
        ("bar", 4.0, 4.0, 5 - 0.2 - 0.1, (0.6, 0.8)),
        ("block", 0.3, 2.0, 1.5 - 0.2, (0, 1)),
        ("block", -3.0, 0.1, 2.0 - 0.2, (-1, 0)),
        ("block", 4.0, 4.5, 5 - 0.2, (0.6, 0.8)),
        ("block", 0.9, 0.1, -0.1 - 0.2, (1, 0)),
        ("plane", 7.0, 0.1, 0.1 - 0.2, (0, 1)),
    ],
)
@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_gap_and_normal(kind, x, y, gap, normal, turn):
    """A disc beside each outline, in a frame that is turned and shifted; and with the two exchanged."""
    c, s = np.cos(turn), np.sin(turn)
    place = np.array([[c, -s], [s, c]]) @ [x, y] + [0.4, -0.2]
    disc, base = free_body(*place), mbd.Body("base", mass=1, inertia=1, pose=(0.4, -0.2, turn))
    outline = other(base.at(0, 0))[kind]
    contact = mbd.Contact("touch", mbd.Circle(disc.at(0, 0), 0.2), outline, LAW)
    state = at_start(contact, disc, base)
    assert state[contact.gap] == pytest.approx(gap)
    wanted = np.array([[c, -s], [s, c]]) @ normal
    np.testing.assert_allclose(state[contact.normal], wanted, atol=1e-12)
    back = mbd.Contact("touch", outline, mbd.Circle(disc.at(0, 0), 0.2), LAW)
    np.testing.assert_allclose(at_start(back, disc, base)[back.normal], -wanted, atol=1e-12)
    assert at_start(back, disc, base)[back.normal_force] == pytest.approx(1e6 * max(-gap, 0) ** 1.5)


@pytest.mark.parametrize("kind", ["circle", "bar", "block", "plane"])
def test_forces_are_the_gradient_of_the_energy(kind):
    """Without damping ``Q = -dV/dq``: force, place and moment are right on both bodies; the forces balance."""
    disc, base = free_body(0.55, 0.55), mbd.Body("base", mass=1, inertia=1, pose=(0.4, -0.2, 0.7))
    place = {"circle": (0.1, 0.35), "bar": (0.3, 0.2), "block": (0.6, 0.6), "plane": (0.3, 0.1)}[kind]
    spot = base.at(*place)
    x, y = (float(ca.substitute(e, base.q, ca.DM([0.4, -0.2, 0.7]))) for e in (spot.x, spot.y))
    disc = free_body(x + 0.02, y, 0.3)
    contact = mbd.Contact(
        "touch", mbd.Circle(disc.at(0.02, 0.01), 0.2), other(base.at(0.0, 0.0))[kind], mbd.HuntCrossley(1e4, exponent=2)
    )
    mechanism = mbd.Mechanism(bodies=[disc, base], forces=[contact])
    state, eom = mbd.assemble(mechanism), mbd.equations(mechanism)
    assert state[contact.gap] < -0.01
    np.testing.assert_allclose(state[eom.Q], -state[ca.gradient(eom.potential, eom.q)], rtol=1e-9, atol=1e-9)
    load = state[eom.Q]
    np.testing.assert_allclose(load[:2] + load[3:5], 0, atol=1e-9)
    moment = [q[2] + x * q[1] - y * q[0] for q, (x, y) in ((load[:3], state.q[:2]), (load[3:], state.q[3:5]))]
    assert sum(moment) == pytest.approx(0, abs=1e-9)


@pytest.mark.parametrize("kind", ["circle", "bar", "block", "plane"])
def test_derivatives_are_finite(kind):
    """First and second derivatives of gap, normal force and friction, at first touch, apart, and on one another."""
    disc, base = free_body(0, 0), mbd.Body("base", mass=1, inertia=1)
    friction = mbd.Coulomb(0.3, 1e-3)
    contact = mbd.Contact("touch", mbd.Circle(disc.at(0, 0), 0.2), other(base.at(0, 0))[kind], LAW, friction)
    x = ca.vertcat(disc.q, disc.v, base.q, base.v)
    for expression in (contact.gap, contact.normal_force, contact.friction_force):
        hessian, gradient = ca.hessian(expression, x)
        function = ca.Function("h", [x], [hessian, gradient])
        top = {"circle": 0.5, "bar": 0.3, "block": 0.7, "plane": 0.2}[kind]
        for height in (top, top + 1, top - 0.01, 0.0):
            point = np.zeros(12)
            point[1] = height
            for result in function(point):
                assert np.all(np.isfinite(result.full())), (kind, height)


# --- impact ---------------------------------------------------------------------------------
@pytest.mark.parametrize(
    "model, restitution, accuracy",
    [("flores", 0.9, 0.03), ("flores", 0.5, 0.06), ("hunt-crossley", 0.95, 0.01), ("lankarani-nikravesh", 0.95, 0.01)],
)
def test_restitution(model, restitution, accuracy):
    """The speed after the impact over the one before, without gravity, near to what was asked for."""
    speed = 2.0
    ball = free_body(y=0.1001, velocity=(0, -speed, 0))
    law = mbd.HuntCrossley.from_restitution(1e7, restitution, speed, model=model)
    floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.1), FLOOR, law)
    motion = mbd.simulate(mbd.Mechanism(bodies=[ball], forces=[floor]), np.linspace(0, 0.05, 51))
    assert motion[floor.gap][-1] > 0
    assert motion[ball.vy][-1] / speed == pytest.approx(restitution, abs=accuracy)


def test_restitution_of_hunt_and_crossley_in_closed_form():
    """Any exponent and stiffness: ``(1 + χ v⁻) exp(-χ v⁻) = (1 - χ v⁺) exp(χ v⁺)`` for speeds in and out."""
    chi, speed = 0.3, 2.5
    ball = free_body(y=0.1001, velocity=(0, -speed, 0))
    floor = mbd.Contact("floor", mbd.Circle(ball.at(0, 0), 0.1), FLOOR, mbd.HuntCrossley(1e6, 2.0, chi))
    motion = mbd.simulate(mbd.Mechanism(bodies=[ball], forces=[floor]), np.linspace(0, 0.1, 51), reltol=1e-10)
    out = motion[ball.vy][-1]
    # x/(1 + χ x) dx integrated over the compression and the release
    inwards = speed / chi - np.log(1 + chi * speed) / chi**2
    outwards = -out / chi - np.log(1 - chi * out) / chi**2
    assert inwards == pytest.approx(outwards, rel=1e-6)
    assert motion[floor.normal_force].min() >= 0


def test_elastic_impact_of_two_discs():
    """Momentum and energy: a disc hits another one obliquely; the speeds along the normal are exchanged."""
    a = mbd.Body("a", mass=1, inertia=0.01, pose=(-1, 0.06, 0), velocity=(3, 0, 0))
    b = mbd.Body("b", mass=1, inertia=0.01)
    hit = mbd.Contact("hit", mbd.Circle(a.at(0, 0), 0.1), mbd.Circle(b.at(0, 0), 0.1), mbd.HuntCrossley(1e8))
    motion = mbd.simulate(mbd.Mechanism(bodies=[a, b], forces=[hit]), np.linspace(0, 0.6, 61))
    end = motion.final
    normal = np.array([-np.sqrt(0.2**2 - 0.06**2), 0.06]) / 0.2
    np.testing.assert_allclose([end[b.vx], end[b.vy]], 3 * normal[0] * normal, atol=0.02)
    np.testing.assert_allclose(end[a.vx] + end[b.vx], 3, atol=1e-7)
    np.testing.assert_allclose(motion.energy.total, 4.5, rtol=1e-5)


# --- friction ---------------------------------------------------------------------------------
@pytest.mark.slow
def test_block_tips_or_slides():
    """A block on a slope above friction's angle slides with ``g (sin - μ cos)``; a slim rough one tips over."""
    slope = np.radians(25)
    plane = mbd.HalfPlane(mbd.ground.at(0, 0, angle=-slope))

    def run(half_width, half_height, mu):
        normal = np.array([np.sin(slope), np.cos(slope)]) * (half_height - 1e-5)
        block = mbd.Body("block", mass=1, inertia=(half_width**2 + half_height**2) / 3, pose=(*normal, -slope))
        corners = [(-half_width, -half_height), (half_width, -half_height), (half_width, half_height)]
        edges = mbd.PolygonEdges(block.at(0, 0), [*corners, (-half_width, half_height)])
        law = mbd.HuntCrossley(1e7, damping=2.0)
        contact = mbd.Contact("slope", edges, plane, law, mbd.Coulomb(mu, 1e-3))
        motion = mbd.simulate(mbd.Mechanism(bodies=[block], forces=[mbd.Gravity(), contact]), np.linspace(0, 0.6, 61))
        return block, contact, motion

    block, contact, motion = run(0.2, 0.1, 0.2)
    speed = motion[block.vx] * np.cos(slope) - motion[block.vy] * np.sin(slope)
    slide = G * (np.sin(slope) - 0.2 * np.cos(slope))
    assert (speed[-1] - speed[20]) / 0.4 == pytest.approx(slide, rel=5e-3)
    assert np.abs(motion[block.phi] + slope).max() < 1e-2
    assert contact.gaps.numel() == 4
    # tan(slope) above width over height: it turns about its lower corner
    block, contact, motion = run(0.05, 0.3, 0.9)
    # energy of the turn about that corner: J ω²/2 = m g (fall of the centre of mass), J = 4/3 m r²
    angle = motion[block.phi]
    turning = (motion.t < 0.4) & (angle < -slope - 0.1)
    height = 0.3 * np.cos(angle) - 0.05 * np.sin(angle)
    fall = 0.3 * np.cos(slope) + 0.05 * np.sin(slope) - height
    assert turning.sum() > 10
    wanted = -np.sqrt(1.5 * G * fall / (0.05**2 + 0.3**2))
    np.testing.assert_allclose(motion[block.omega][turning], wanted[turning], rtol=0.02)
    assert np.abs(motion[contact.gaps][turning, 1]).max() < 1e-3
    # a wide rough one stays
    block, contact, motion = run(0.3, 0.1, 0.9)
    assert np.abs(motion[block.phi] + slope).max() < 1e-2
    assert np.hypot(motion[block.vx][-1], motion[block.vy][-1]) < 2e-3


def test_thrown_wheel_rolls():
    """Sliding turns into rolling at ``v₀ / (1 + J/(m r²))`` after ``v₀/(μ g (1 + m r²/J))``."""
    wheel = mbd.Body("wheel", mass=2.0, inertia=0.04, pose=(0, 0.2 - 5e-4, 0), velocity=(3.0, 0, 0))
    road = mbd.Contact("road", mbd.Circle(wheel.at(0, 0), 0.2), FLOOR, LAW, mbd.Coulomb(0.4, 1e-4))
    mechanism = mbd.Mechanism(bodies=[wheel], forces=[mbd.Gravity(), road])
    motion = mbd.simulate(mechanism, np.linspace(0, 0.6, 121))
    assert motion[wheel.vx][-1] == pytest.approx(2.0, abs=2e-3)
    assert motion[wheel.omega][-1] == pytest.approx(-10.0, abs=2e-2)
    rolls = 3 / (0.4 * G * 3)
    sliding = motion.t < 0.9 * rolls
    np.testing.assert_allclose(motion[wheel.vx][sliding], 3 - 0.4 * G * motion.t[sliding], atol=2e-2)


@pytest.mark.slow
def test_bristles_at_a_contact():
    """LuGre under a block that is pushed below its static friction: it stays."""
    block = mbd.Body("block", mass=1, inertia=0.01, pose=(0, 0.1 - 2e-4, 0))
    corners = [(-0.2, -0.1), (0.2, -0.1), (0.2, 0.1), (-0.2, 0.1)]
    law = mbd.LuGre(0.4, 0.5, 0.01, 1e4, damping=50.0)
    floor = mbd.Contact(
        "floor", mbd.PolygonEdges(block.at(0, 0), corners), FLOOR, mbd.HuntCrossley(1e6, damping=2.0), law
    )
    push = mbd.Force("push", block.at(0, -0.1), (0.3 * G, 0))
    mechanism = mbd.Mechanism(bodies=[block], forces=[mbd.Gravity(), floor, push])
    assert len(mechanism.states) == 4
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 31))
    assert np.abs(motion[block.vx][-5:]).max() < 1e-6
    # it goes on a little only while the block still bounces on its stiff corners
    assert motion[block.x][-1] < 10 * 0.3 / 1e4
    assert np.ptp(motion[block.x][-10:]) < 1e-6
    assert motion[floor.friction_force][-1] == pytest.approx(-0.3 * G, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
def test_energy_never_grows(seed):
    """Random discs and blocks thrown into a corner: energy, elastic one included, falls at every output."""
    random = np.random.default_rng(seed)
    body = free_body(0.5, 0.6, random.uniform(-1, 1), inertia=0.02, velocity=tuple(random.uniform(-3, 3, 3)))
    outline = [
        mbd.Circle(body.at(0.02, 0), 0.15),
        mbd.PolygonEdges(body.at(0, 0), [(-0.2, -0.1), (0.25, -0.1), (0.2, 0.15), (-0.2, 0.1)]),
        mbd.Segment(body.at(0, 0), 0.4, radius=0.05),
    ][seed % 3]
    law = mbd.HuntCrossley(random.uniform(1e4, 1e6), random.choice([1.0, 1.5, 2.0]), random.uniform(0, 1))
    friction = [mbd.Coulomb(0.4, 1e-3), mbd.Stribeck(0.3, 0.5, 0.05, 1e-3)][seed % 2]
    planes = [mbd.ground.at(0, 0, angle=0.2), mbd.ground.at(0, 0, angle=-1.3), mbd.ground.at(1.2, 0, angle=1.4)]
    contacts = [mbd.Contact(f"wall {k}", outline, mbd.HalfPlane(m), law, friction) for k, m in enumerate(planes)]
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Gravity(), *contacts])
    motion = mbd.simulate(mechanism, np.linspace(0, 1.5, 301))
    energy = motion.energy.total
    size = motion.energy.kinetic.max()
    assert np.diff(energy).max() <= 2e-6 * size
    assert any(motion[c.normal_force].max() > 1 for c in contacts)
    for contact in contacts:
        assert motion[contact.power].max() <= 1e-12
        assert motion[contact.normal_forces].min() >= 0


# --- Hertz -----------------------------------------------------------------------------------
def test_hertz_stiffness():
    """Approach of two equal spheres under a load, from Johnson's ``δ = (9 F²/(16 R* E*²))^(1/3)``."""
    k = mbd.hertz_stiffness(0.02, 0.02, 70e9, 70e9, 0.33, 0.33)
    reduced = 70e9 / 2 / (1 - 0.33**2)
    load = 100.0
    approach = (9 * load**2 / (16 * 0.01 * reduced**2)) ** (1 / 3)
    assert k * approach**1.5 == pytest.approx(load)
    assert mbd.hertz_stiffness(0.01, np.inf, 210e9, np.inf) == pytest.approx(4 / 3 * 210e9 / 0.91 * 0.1)
    for wrong in [(0, 1, 1, 1), (np.inf, np.inf, 1, 1), (1, -0.5, 1, 1), (1, 1, np.inf, np.inf), (1, 1, -1, 1)]:
        with pytest.raises(mbd.ModelError, match="hertz_stiffness"):
            mbd.hertz_stiffness(*wrong)
    with pytest.raises(mbd.ModelError, match="poisson_a"):
        mbd.hertz_stiffness(1, 1, 1, 1, poisson_a=0.6)


# --- refusals -----------------------------------------------------------------------------------
def test_refuses():
    """Pairs without a rule, one body twice, polygons that run clockwise, numbers out of their limits."""
    body, base = free_body(), mbd.Body("base", mass=1, inertia=1)
    square = [(0, 0), (1, 0), (1, 1), (0, 1)]
    with pytest.raises(mbd.ModelError, match=r"'c'.*two points"):
        mbd.Contact("c", mbd.Point(body.at(0, 0)), mbd.Point(base.at(0, 0)), LAW)
    with pytest.raises(mbd.ModelError, match=r"'c'.*without thickness"):
        mbd.Contact("c", mbd.Segment(base.at(0, 0), 1.0), mbd.Point(body.at(0, 0)), LAW)
    with pytest.raises(mbd.ModelError, match=r"no contact of HalfPlane and HalfPlane"):
        mbd.Contact("c", mbd.HalfPlane(body.at(0, 0)), FLOOR, LAW)
    with pytest.raises(mbd.ModelError, match=r"'c'.*both outlines are on body 'body'"):
        mbd.Contact("c", mbd.Circle(body.at(0, 0), 1), mbd.Circle(body.at(0, 0), 1), LAW)
    with pytest.raises(mbd.ModelError, match=r"'c'.*outlines"):
        mbd.Contact("c", body, FLOOR, LAW)
    with pytest.raises(mbd.ModelError, match=r"'c'.*law"):
        mbd.Contact("c", mbd.Circle(body.at(0, 0), 1), FLOOR, 1e5)
    with pytest.raises(mbd.ModelError, match=r"'body'.*radius"):
        mbd.Circle(body.at(0, 0), -1)
    with pytest.raises(mbd.ModelError, match=r"'body'.*counter-clockwise"):
        mbd.PolygonEdges(body.at(0, 0), square[::-1])
    with pytest.raises(mbd.ModelError, match=r"three corners"):
        mbd.PolygonEdges(body.at(0, 0), square[:2])
    for e, model in [(1.1, "flores"), (0, "flores"), (-0.1, "hunt-crossley")]:
        with pytest.raises(mbd.ModelError, match="restitution"):
            mbd.HuntCrossley.from_restitution(1e5, e, 1.0, model=model)
    with pytest.raises(mbd.ModelError, match="model"):
        mbd.HuntCrossley.from_restitution(1e5, 0.5, 1.0, model="herz")
    with pytest.raises(mbd.ModelError, match="impact_speed"):
        mbd.HuntCrossley.from_restitution(1e5, 0.5, 0.0)


# --- laws that are too soft ---------------------------------------------------------------------------------
PLATES = {
    "segment": lambda at: mbd.Segment(at, 2.0, 0.1),
    "polygon": lambda at: mbd.PolygonEdges(at, [(-1, -0.1), (1, -0.1), (1, 0.1), (-1, 0.1)]),
    "circle": lambda at: mbd.Circle(at, 0.1),
    "half-plane": lambda at: mbd.HalfPlane(mbd.ground.at(0, 0.1)),
}
STRIKERS = {
    "circle": lambda at: mbd.Circle(at, 0.05),
    "point": lambda at: mbd.Point(at),
    "polygon": lambda at: mbd.PolygonEdges(at, [(-0.05, -0.05), (0.05, -0.05), (0.05, 0.05), (-0.05, 0.05)]),
    "segment": lambda at: mbd.Segment(at, 0.2, 0.05),
}
PAIRS = [(plate, striker) for plate in PLATES for striker in STRIKERS if (plate, striker) != ("half-plane", "point")]


def dropped(plate, striker, stiffness, method="idas", outputs=4):
    """A kilogram that falls 2 m onto a plate of 20 cm; few outputs, none of them while it is in there."""
    body = mbd.Body("ball", mass=1.0, inertia=1e-3, pose=(0.003, 2.1, 0))
    law = mbd.HuntCrossley(stiffness, exponent=1)
    hit = mbd.Contact("plate", STRIKERS[striker](body.at(0, 0)), PLATES[plate](mbd.ground.at(0, 0)), law)
    model = mbd.Mechanism([body], forces=[mbd.Gravity(), hit])
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        motion = mbd.simulate(model, np.linspace(0, 1.2, outputs), method=method)
    return motion, body, [str(w.message) for w in said if "too soft" in str(w.message)]


@pytest.mark.slow
@pytest.mark.parametrize(("plate", "striker"), PAIRS)
def test_a_law_too_soft_for_the_impact_is_reported(plate, striker):
    """1 kN/m stop 20 J after 0.2 m, which is as deep as the plate is thick: it falls through, or nearly so."""
    _, _, said = dropped(plate, striker, 1e3)
    assert len(said) == 1
    assert "contact 'plate': its law is too soft" in said[0]
    time = float(re.search(r"first at t = ([0-9.]+) s", said[0])[1])
    assert 0.55 < time < 0.72
    assert float(re.search(r"at worst ([0-9.]+) m deep", said[0])[1]) > 0.04


@pytest.mark.slow
@pytest.mark.parametrize(("plate", "striker"), PAIRS)
def test_an_ordinary_law_is_not_reported(plate, striker):
    """1 MN/m stop it after 6 mm."""
    motion, body, said = dropped(plate, striker, 1e6)
    assert said == []
    assert motion[body.y][-1] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock"])
@pytest.mark.parametrize("outputs", [2, 7, 301])
def test_the_reported_depth_is_that_of_the_motion(method, outputs):
    """By energy: m g (h + d) = k d²/2, whatever the outputs; said once."""
    stiffness = 3e3
    depth = 9.81 / stiffness * (1 + np.sqrt(1 + 2 * stiffness * 1.95 / 9.81))
    _, _, said = dropped("half-plane", "circle", stiffness, method, outputs)
    assert len(said) == 1
    assert float(re.search(r"at worst ([0-9.]+) m deep", said[0])[1]) == pytest.approx(depth, rel=0.05)


def test_a_pose_in_which_bodies_are_inside_each_other_is_reported_by_check():
    body = mbd.Body("ball", mass=1.0, inertia=1e-3, pose=(0.003, 0.02, 0))
    hit = mbd.Contact("plate", mbd.Circle(body.at(0, 0), 0.05), mbd.Segment(mbd.ground.at(0, 0), 2, 0.1), LAW)
    (remark,) = mbd.check(mbd.Mechanism([body], forces=[hit])).remarks
    assert "contact 'plate'" in remark and "(0.13 m deep at t = 0 s)" in remark


def test_half_width_of_a_polygon():
    """Of a rectangle half the shorter side, of an equilateral triangle half the height."""
    at = mbd.ground.at(0, 0)
    assert mbd.PolygonEdges(at, [(0, 0), (3, 0), (3, 1), (0, 1)]).half_width == pytest.approx(0.5)
    assert mbd.PolygonEdges(at, [(0, 0), (2, 0), (1, np.sqrt(3))]).half_width == pytest.approx(np.sqrt(3) / 2)
