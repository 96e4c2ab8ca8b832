"""Contact of polygons that are not convex: notches, ratchets, brackets, against closed forms and convex pieces."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
FIRM = mbd.HuntCrossley(1e5, exponent=1, damping=0.5)
LEFT, RIGHT = np.radians(30), np.radians(45)
#: a block with a V, whose flanks rise with 30° on the left and 45° on the right of its root at the origin
NOTCH = [(-2, -1), (2, -1), (2, 1), (1, 1), (0, 0), (-1, np.tan(LEFT)), (-2, np.tan(LEFT))]
#: an L of two beams 0.1 m thick, with its hollow corner at the origin
BRACKET = [(-0.1, -0.1), (1, -0.1), (1, 0), (0, 0), (0, 1), (-0.1, 1)]


def block_at(points, body=mbd.ground):
    """A polygon at the origin of a body."""
    return mbd.PolygonEdges(body.at(0, 0), points)


def test_disc_in_a_notch():
    """It rests on both flanks; the forces by the triangle of forces."""
    ball = mbd.Body("ball", mass=2.0, inertia=0.01, pose=(-0.04, 0.31, 0))
    rest = mbd.Contact("notch", mbd.Circle(ball.at(0, 0), 0.3), block_at(NOTCH), FIRM)
    state = mbd.equilibrium(mbd.Mechanism([ball], forces=[mbd.Gravity(), rest]))
    forces = state[rest.normal_forces]
    wanted = 2 * G * np.array([np.sin(RIGHT), np.sin(LEFT)]) / np.sin(LEFT + RIGHT)
    np.testing.assert_allclose(np.sort(forces[forces > 0]), np.sort(wanted), rtol=1e-3)


@pytest.mark.parametrize("radius", [0.05, 0.0])
@pytest.mark.parametrize("seed", range(3))
def test_gap_is_the_distance(seed, radius):
    """Of discs and points anywhere around a star, by a fine sampling of its outline; inside it is negative."""
    rng = np.random.default_rng(seed)
    around = np.sort(rng.uniform(0, 2 * np.pi, 9))
    star = np.column_stack([np.cos(around), np.sin(around)]) * rng.uniform(0.3, 1.0, (9, 1))
    ball = mbd.Body("ball", mass=1, inertia=1)
    outline = mbd.Circle(ball.at(0, 0), radius) if radius else mbd.Point(ball.at(0, 0))
    contact = mbd.Contact("c", outline, block_at(star), FIRM)
    sides = np.roll(star, -1, axis=0) - star
    fine = np.concatenate([a + np.linspace(0, 1, 4000)[:, None] * d for a, d in zip(star, sides, strict=True)])
    model = mbd.Mechanism([ball], forces=[contact])
    function = mbd.equations(model).function(contact.gap)
    for x, y in rng.uniform(-1.2, 1.2, (40, 2)):
        distance = np.min(np.hypot(fine[:, 0] - x, fine[:, 1] - y))
        ahead = np.arctan2(star[:, 1] - y, star[:, 0] - x)
        turned = np.sum((np.diff(np.r_[ahead, ahead[0]]) + np.pi) % (2 * np.pi) - np.pi)
        inside = abs(turned) > np.pi
        gap = float(function(0, [x, y, 0], 0, 0, [], [], [], []))
        if inside:
            assert gap == pytest.approx(-distance - radius, abs=1e-3)
        else:
            assert gap == pytest.approx(distance - radius, abs=1e-3)


def test_a_disc_rolls_over_a_seam_as_over_one_piece():
    """Over the top of a T it moves as over a beam: where another piece begins inside nothing happens."""
    beam = [(-1, -0.1), (1, -0.1), (1, 0), (-1, 0)]
    tee = [(-1, -0.1), (-0.1, -0.1), (-0.1, -1), (0.1, -1), (0.1, -0.1), (1, -0.1), (1, 0), (-1, 0)]
    runs = []
    for points in (beam, tee):
        ball = mbd.Body("ball", mass=2.0, inertia=0.008, pose=(-0.5, 0.1, 0))
        contact = mbd.Contact("top", mbd.Circle(ball.at(0, 0), 0.1), block_at(points), FIRM, mbd.Coulomb(0.3, 1e-3))
        model = mbd.Mechanism([ball], forces=[mbd.Gravity(), contact])
        run = mbd.simulate(model, np.linspace(0, 0.8, 9), initial=[ball.vx == 1, ball.vy == 0, ball.omega == 0])
        runs.append(run[[ball.x, ball.y, ball.omega]])
    np.testing.assert_allclose(runs[0], runs[1], atol=1e-6)


def ratchet(angle, torque):
    """A wheel with six teeth, radial flanks ahead of slopes, under a pawl that a spring of 5 N presses on."""
    around = np.arange(6) * np.pi / 3
    tips = np.column_stack([np.cos(around), np.sin(around)])
    corners = np.column_stack([0.8 * tips, tips]).reshape(-1, 2)
    wheel = mbd.Body("wheel", mass=5.0, inertia=1.0, pose=(0, 0, angle))
    pawl = mbd.Body("pawl", mass=0.2, inertia=0.01, pose=(0.85, 0.12, 0))
    joints = [
        mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0.12), pawl.at(0, 0)),
    ]
    spring = mbd.Force("spring", pawl.at(0, 0), (-5.0 - 2 * pawl.vx, 0))
    law = mbd.HuntCrossley(2e4, exponent=1, damping=1.0)
    tooth = mbd.Contact("tooth", mbd.Circle(pawl.at(0, 0), 0.03), block_at(corners, wheel), law)
    motor = mbd.Torque("motor", wheel, torque - 4.0 * wheel.omega)
    return mbd.Mechanism([wheel, pawl], joints, forces=[spring, tooth, motor]), wheel, tooth


def test_a_ratchet_holds():
    """The flank of a tooth bears the whole torque."""
    model, _, tooth = ratchet(0.115 - np.pi / 3 + 0.05, -6.0)
    rest = mbd.equilibrium(model)
    moments = [place[0] * force[1] - place[1] * force[0] for place, force in tooth.forces]
    assert rest[sum(moments)] == pytest.approx(-6.0, abs=1e-6) and np.sum(rest[tooth.normal_forces] > 0) == 2


@pytest.mark.slow
def test_a_ratchet_turns_the_other_way():
    """Its teeth lift the pawl and pass it."""
    model, wheel, tooth = ratchet(-0.5, 6.0)
    run = mbd.simulate(model, np.linspace(0, 1.5, 76))
    assert run[wheel.phi][-1] > 0.7 and np.max(run[tooth.gap]) > 0.001


def test_a_block_in_a_bracket():
    """It lies in the hollow corner of an L as on two beams: the same forces on floor and wall."""
    corners = [(-0.2, -0.2), (0.2, -0.2), (0.2, 0.2), (-0.2, 0.2)]
    poses = []
    for pieces in ([BRACKET], [[(0, -0.1), (1, -0.1), (1, 0), (0, 0)], [(-0.1, 0), (0, 0), (0, 1), (-0.1, 1)]]):
        block = mbd.Body("block", mass=2.0, inertia=0.05, pose=(0.2, 0.2, 0))
        contacts = [
            mbd.Contact(f"c{k}", mbd.PolygonEdges(block.at(0, 0), corners), block_at(piece), FIRM)
            for k, piece in enumerate(pieces)
        ]
        push = mbd.Force("push", block.at(0, 0), (-5, 0))
        rest = mbd.equilibrium(mbd.Mechanism([block], forces=[mbd.Gravity(), push, *contacts]))
        poses.append(rest[block.q])
    assert poses[0][0] == pytest.approx(0.2 - 5 / 2e5, abs=1e-6)
    np.testing.assert_allclose(poses[0], poses[1], atol=1e-6)


def test_a_bracket_on_the_floor():
    """It falls on a half-plane and rests on its two lower corners; with a rigid contact too."""
    for kind in (mbd.Contact, mbd.RigidContact):
        law = (mbd.HuntCrossley(1e5, exponent=1, damping=4.0),) if kind is mbd.Contact else ()
        body = mbd.Body("bracket", mass=3.0, inertia=0.5, pose=(0, 0.35, 0))
        points = np.array(BRACKET) - [0.2, 0.2]
        floor = kind("floor", mbd.PolygonEdges(body.at(0, 0), points), mbd.HalfPlane(mbd.ground.at(0, 0)), *law)
        run = mbd.simulate(mbd.Mechanism([body], forces=[mbd.Gravity(), floor]), np.linspace(0, 2, 3))
        assert run[body.y][-1] == pytest.approx(0.3, abs=1e-2)
        assert run[floor.normal_force][-1] == pytest.approx(3 * G, rel=1e-2)


def test_refuses():
    """Outlines that cut themselves, run clockwise or have a corner too many; rigid contacts of hollow ones."""
    body = mbd.Body("b", mass=1, inertia=1)
    for points, words in (
        ([(0, 0), (2, 0), (0, 1), (2, 1)], "cuts itself"),
        (BRACKET[::-1], "counter-clockwise; reverse"),
        ([(0, 0), (1, 0), (2, 0), (1, 1)], r"no corner at \(1, 0\)"),
    ):
        with pytest.raises(mbd.ModelError, match=words):
            block_at(points, body)
    with pytest.raises(mbd.ModelError, match="'c': PolygonEdges on 'b' is not convex, which a rigid contact"):
        mbd.RigidContact("c", block_at(BRACKET, body), mbd.Circle(mbd.ground.at(0, 0), 0.1))
