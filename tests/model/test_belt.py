"""Elastic belts and chains: loads of bearings, pretension, slack, slip, a swing arm; closed forms."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from scipy.optimize import brentq

import mbdcasadi as mbd

RA, RB, APART, K = 0.05, 0.12, 0.4, 1e5


def drive(crossed=False, load=0.0, **more):
    """Two pulleys; the first one is held, and a couple turns the second."""
    a, b = mbd.Body("a", 1.0, 0.01), mbd.Body("b", 2.0, 0.03, pose=(APART, 0, 0))
    pins = [mbd.Revolute(f"pin {x.name}", mbd.ground.at(at, 0), x.at(0, 0)) for x, at in ((a, 0.0), (b, APART))]
    belt = mbd.ElasticBelt("belt", a.at(0, 0), b.at(0, 0), RA, RB, K, crossed=crossed, **more)
    torque = mbd.Torque("load", b, load)
    return b, pins, belt, mbd.Mechanism([a, b], pins, [mbd.Driver("hold", a.phi, 0)], [belt, torque])


@pytest.mark.parametrize("crossed", [False, True])
def test_bearings_carry_both_strands(crossed):
    """``T1 + T2 = 2 T0``, ``T1 - T2 = M/r``; strands at ``sin β = (r_b ∓ r_a)/d`` to the line of centres."""
    load, pull = 6.0, 200.0
    b, pins, belt, model = drive(crossed, load, pretension=pull)
    rest = mbd.equilibrium(model)
    low, high = pull - load / RB / 2, pull + load / RB / 2
    np.testing.assert_allclose(rest[belt.tensions], [low, high] if crossed else [high, low], rtol=1e-9)
    assert rest[b.phi] == pytest.approx(load / RB**2 / (2 * K), rel=1e-9)
    lean = np.arcsin((RB + RA if crossed else RB - RA) / APART)
    along, across = 2 * pull * np.cos(lean), load / RB * np.sin(lean)
    force = rest[pins[1].reaction_on(b).force]
    assert force[0] == pytest.approx(along, rel=1e-9) and abs(force[1]) == pytest.approx(across, rel=1e-9)
    rigid = mbd.Belt("belt", belt.a, belt.b, RA, RB, crossed)
    stiff = mbd.assemble(model.replace(joints=[*pins, rigid], forces=[model.force("load")]))
    assert rest[belt.tension_difference] == pytest.approx(stiff[rigid.tension_difference], rel=1e-9)


def test_vibration_and_slack():
    """Both strands are springs, ``ω² = 2 k r²/J``; without pretension one of them is, ``k r²/J``, and energy stays."""
    for pull, springs in ((500.0, 2), (0.0, 1)):
        b, _, belt, model = drive(pretension=pull)
        period = 2 * np.pi / np.sqrt(springs * K * RB**2 / 0.03)
        times = [0, period / 4, period / 2, period]
        run = mbd.simulate(model, times, initial=[b.omega == 2], method="dop853", reltol=1e-10, abstol=1e-10)
        np.testing.assert_allclose(run[b.omega], [2, 0, -2, 2], atol=1e-6)
        assert np.ptp(run.energy.total) < 1e-8
        assert np.all(run[belt.tensions] >= 0)


def test_slack_is_taken_up_first():
    """A chain with 1 mm of play in each strand pulls after ``d/r``, as a spring from there on."""
    load, slack = 6.0, 1e-3
    b, _, belt, model = drive(load=load, slack=slack)
    rest = mbd.equilibrium(model)
    assert rest[b.phi] == pytest.approx((slack + load / RB / K) / RB, rel=1e-9)
    np.testing.assert_allclose(rest[belt.tensions], [load / RB, 0], atol=1e-7)


def test_slip_is_named():
    """The limit of Euler and Eytelwein at the smaller pulley."""
    limit = np.exp(0.3 * (np.pi - 2 * np.arcsin((RB - RA) / APART)))
    most = 200 * 2 * (limit - 1) / (limit + 1) * RB
    *_, model = drive(load=0.99 * most, pretension=200.0, friction=0.3)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        mbd.equilibrium(model)
    *_, model = drive(load=1.01 * most, pretension=200.0, friction=0.3)
    with pytest.warns(mbd.MechanismWarning, match="belt 'belt': it would slip"):
        mbd.equilibrium(model)


def test_squat_of_a_swing_arm():
    """The taut strand pulls the axle along the tangent to the sprocket, and the spring of the arm takes its moment."""
    load, stiffness, length = 24.0, 300.0, 0.5
    place = np.array([0.06, 0.05])
    arm, wheel = mbd.Body("arm", 1.0, 0.1), mbd.Body("wheel", 1.0, 0.1, pose=(length, 0, 0))
    pins = [
        mbd.Revolute("pivot", mbd.ground.at(0, 0), arm.at(0, 0)),
        mbd.Revolute("axle", arm.at(length, 0), wheel.at(0, 0)),
    ]
    spring = mbd.RSDA("spring", mbd.ground.at(0, 0), arm.at(0, 0), stiffness=stiffness)
    sprocket = mbd.ground.at(*place)
    chain = mbd.ElasticBelt("chain", sprocket, wheel.at(0, 0), RA, RB, 2e4, carrier=arm)
    torque = mbd.Torque("load", wheel, load)
    rest = mbd.equilibrium(mbd.Mechanism([arm, wheel], pins, forces=[spring, chain, torque]))

    def moment(angle):
        axle = length * np.array([np.cos(angle), np.sin(angle)])
        d = axle - place
        lean = np.arctan2(d[1], d[0]) - np.arcsin((RB - RA) / np.hypot(*d))
        pull = -load / RB * np.array([np.cos(lean), np.sin(lean)])
        return axle[0] * pull[1] - axle[1] * pull[0] - stiffness * angle

    expected = brentq(moment, -0.5, 0.5, xtol=1e-14)
    assert abs(expected) > 0.01
    assert rest[arm.phi] == pytest.approx(expected, abs=1e-9)
    np.testing.assert_allclose(rest[chain.tensions], [load / RB, 0], atol=1e-7)


def test_what_makes_no_sense():
    """Errors name the belt."""
    for more, said in (
        ({"pretension": -1.0}, "pretension"),
        ({"friction": 0.0}, "friction"),
        ({"damping": -1.0}, "damping"),
        ({"slack": -1e-3}, "slack"),
    ):
        with pytest.raises(mbd.ModelError, match=f"belt 'belt': {said}"):
            drive(**more)
    body = mbd.Body("b", 1, 1, pose=(0.1, 0, 0))
    with pytest.raises(mbd.ModelError, match="belt 'belt'.*two pulleys overlap"):
        mbd.ElasticBelt("belt", mbd.ground.at(0, 0), body.at(0, 0), 0.08, 0.2, 1e5)
