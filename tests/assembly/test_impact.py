"""impact(): the state in which a motion goes on as another mechanism."""

import numpy as np
import pytest

import mbdcasadi as mbd


def two_blocks(speed=3.0, apart=0.0):
    a = mbd.Body("a", mass=1.0, inertia=0.1, pose=(0, 0, 0), velocity=(speed, 0, 0))
    b = mbd.Body("b", mass=2.0, inertia=0.4, pose=(1 + apart, 0, 0))
    return a, b, mbd.Mechanism(bodies=[a, b]), mbd.Weld("latch", a.at(0.5, 0), b.at(-0.5, 0))


def test_latching_shares_the_momentum():
    a, b, apart, latch = two_blocks()
    before = mbd.assemble(apart)
    after = mbd.impact(apart.replace(joints=[latch]), before)
    assert after[a.vx] == pytest.approx(1.0, abs=1e-14) and after[b.vx] == pytest.approx(1.0, abs=1e-14)
    np.testing.assert_allclose(after[latch.impulse_on(b).force], [2, 0], atol=1e-13)
    np.testing.assert_allclose(after[latch.impulse_on(a).force], [-2, 0], atol=1e-13)
    with pytest.raises(mbd.ExpressionError, match="only just after an impact"):
        before[latch.impulse_on(b).force]


def test_a_start_after_adding_a_weld_leads_to_the_impact():
    """The advice to assemble would give both the speed of one."""
    _, _, apart, latch = two_blocks()
    latched, state = apart.replace(joints=[latch]), mbd.assemble(apart)
    with pytest.raises(mbd.SimulationError, match=r"velocity level.*impact\(mechanism, state\)"):
        mbd.simulate(latched, duration=1.0, initial=state)
    motion = mbd.simulate(latched, duration=1.0, initial=mbd.impact(latched, state))
    assert motion.final[latch.a.body.x] == pytest.approx(1.0, abs=1e-9)


def test_refuses_joints_that_do_not_close():
    _, _, apart, latch = two_blocks(apart=0.01)
    latched, state = apart.replace(joints=[latch]), mbd.assemble(apart)
    with pytest.raises(mbd.SimulationError, match=r"'latch\.x' of the new mechanism does not hold.*0\.01"):
        mbd.impact(latched, state)
    with pytest.raises(mbd.SimulationError, match="use assemble to make it consistent"):
        mbd.simulate(latched, duration=1.0, initial=state)


def test_bodies_may_leave_but_not_come():
    a, _b, apart, _ = two_blocks()
    alone = mbd.Mechanism(bodies=[a])
    after = mbd.impact(alone, mbd.assemble(apart))
    assert after[a.vx] == 3.0
    with pytest.raises(mbd.SimulationError, match="body 'b'.*may be removed, not added"):
        mbd.impact(apart, after)


def test_drivers_that_contradict_each_other():
    a, _, apart, _ = two_blocks()
    driven = apart.replace(drivers=[mbd.Driver("x", a.x, 2 * mbd.t), mbd.Driver("x too", a.x, mbd.t)])
    with pytest.raises(mbd.SimulationError, match="no velocities meet all rows"):
        mbd.impact(driven, mbd.assemble(apart))


def test_a_coordinate_without_inertia_follows():
    """A cam that closes brings its contact parameter along, which no body has."""
    cam = mbd.Body("cam", mass=1.0, inertia=0.2, pose=(0, 0, 0.3), velocity=(0, 0, 2.0))
    follower = mbd.Body("follower", mass=0.5, inertia=0.1, pose=(0, 0.5, 0), velocity=(0, -1.0, 0))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), cam.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), follower.at(0, 0, np.pi / 2))
    outline = mbd.CamOutline(lambda angle: 0.2 + 0.05 * mbd.cos(angle))
    contact = mbd.CamFlatFollower("contact", cam.at(0, 0), follower.at(0, 0), outline)
    apart = mbd.Mechanism(bodies=[cam, follower], joints=[hinge, guide])
    closed = apart.replace(joints=[hinge, guide, contact])
    pose = mbd.assemble(closed, [cam.phi == 0.3])
    before = mbd.assemble(apart, [cam.phi == 0.3, follower.y == pose[follower.y], cam.omega == 2, follower.vy == -1])
    after = mbd.impact(closed, before)
    rows = mbd.equations(closed)
    np.testing.assert_allclose(after[rows.Phi_q @ rows.v - rows.nu], 0, atol=1e-12)
    slope = mbd.assemble(closed, [cam.phi == 0.3, cam.omega == 1.0])[follower.vy]
    # along the one free motion (omega, slope omega) the momentum is kept
    omega = (0.2 * 2.0 + 0.5 * slope * -1.0) / (0.2 + 0.5 * slope**2)
    assert after[cam.omega] == pytest.approx(omega, abs=1e-10)
