"""Play between teeth: rattle, rest, loads of bearings; closed forms, and the transmissions without play."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

FLANK = mbd.HuntCrossley(2e5, exponent=1)


def shaft(name, x=0.0, y=0.0):
    """A shaft and its bearing."""
    body = mbd.Body(name, mass=1.0, inertia=0.02, pose=(x, y, 0))
    return body, mbd.Revolute(f"bearing of {name}", mbd.ground.at(x, y), body.at(0, 0))


@pytest.mark.filterwarnings("error::mbdcasadi.MechanismWarning")
def test_rattle_without_loss():
    """A shaft that bounces between two flanks: a period of ``2 π √(J/k) + 2 b/ω``, and its energy stays."""
    body, bearing = shaft("shaft")
    keyed = mbd.Coupler("key", mbd.ground.at(0, 0), body.at(0, 0), 1.0)
    key = mbd.Backlash("key", keyed, 0.1, mbd.HuntCrossley(500, exponent=1))
    model = mbd.Mechanism([body], [bearing], forces=[key])
    period = 2 * np.pi * np.sqrt(0.02 / 500) + 2 * 0.1 / 3
    assert mbd.assemble(model)[key.gap] == pytest.approx([0.05, 0.05])
    times = [0, period / 2, period, 3 * period]
    run = mbd.simulate(model, times, initial=[body.omega == 3], method="dop853", reltol=1e-10, abstol=1e-10)
    np.testing.assert_allclose(run[body.omega], [3, -3, 3, 3], atol=1e-6)
    np.testing.assert_allclose(run[bearing.angle], 0, atol=1e-6)
    assert np.ptp(run.energy.total) < 1e-8


def gear(a, b):
    """A pair of 0.2 and 0.1 m."""
    return mbd.Gear("mesh", a.at(0, 0), b.at(0, 0), 0.2, 0.1)


def rack(a, b):
    """Shaft b as a pinion on a rack on shaft a."""
    return mbd.RackAndPinion("mesh", a.at(0, 0.1), b.at(0, 0), 0.2)


def coupler(a, b):
    """A gearbox."""
    return mbd.Coupler("mesh", a.at(0, 0), b.at(0, 0), -2.0)


@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize(("joint_of", "place"), [(gear, (0.3, 0)), (rack, (0, 0.3)), (coupler, (0.3, 0))])
def test_at_rest_it_is_the_transmission(joint_of, place, sense):
    """The play closes and the flank gives way by F/k; the effort and the loads of bearings are as without play."""
    a, first = shaft("a")
    b, second = shaft("b", *place)
    hold, load = mbd.Driver("hold", a.phi, 0), mbd.Torque("load", b, sense * 3.0)
    joint = joint_of(a, b)
    teeth = mbd.Backlash("teeth", joint, 1e-4, FLANK)
    rigid = mbd.assemble(mbd.Mechanism([a, b], [first, second, joint], [hold], [load]))
    loose = mbd.Mechanism([a, b], [first, second], [hold], [load, teeth])
    rest = mbd.equilibrium(loose, [b.phi == sense * 2e-3])
    effort = joint.torque if joint_of is coupler else joint.tooth_force
    assert rest[teeth.effort] == pytest.approx(rigid[effort], rel=1e-6)
    assert abs(rest[teeth.play]) == pytest.approx(5e-5 + abs(rigid[effort]) / 2e5, rel=1e-6)
    for bearing in (first, second):
        expected = rigid[bearing.reaction_on(bearing.b.body).force]
        np.testing.assert_allclose(rest[bearing.reaction_on(bearing.b.body).force], expected, atol=0.02)


def test_between_the_flanks_nothing_is_transmitted():
    """A gear that turns within its play does not move the other."""
    a, first = shaft("a")
    b, second = shaft("b", 0.3)
    teeth = mbd.Backlash("teeth", gear(a, b), 0.02, FLANK)
    model = mbd.Mechanism([a, b], [first, second], [mbd.Driver("turn", a.phi, 0.4 * mbd.t)], [teeth])
    # 0.01 m of play ahead, at 0.08 m/s
    run = mbd.simulate(model, [0, 0.12, 0.2], initial=[b.omega == 0])
    assert run[b.omega][1] == 0 and run[teeth.effort][1] == 0
    assert run[b.omega][2] < -0.1


def test_what_has_no_play():
    """Errors name it."""
    a, first = shaft("a")
    b, _ = shaft("b", 0.3)
    with pytest.raises(mbd.ModelError, match=r"backlash 'teeth': transmission must be a Gear.*Revolute"):
        mbd.Backlash("teeth", first, 0.1, FLANK)
    with pytest.raises(mbd.ModelError, match=r"backlash 'teeth': backlash"):
        mbd.Backlash("teeth", gear(a, b), -1e-4, FLANK)
    with pytest.raises(mbd.ModelError, match=r"backlash 'teeth': law"):
        mbd.Backlash("teeth", gear(a, b), 1e-4, 2e5)
