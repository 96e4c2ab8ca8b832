"""Wheels with elastic tyres: static deflection, ride over waves, leaps, traction; closed forms."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
TIGHT = {"reltol": 1e-10, "abstol": 1e-10}
TYRE = mbd.HuntCrossley(2e4, exponent=1)


def flat(x):
    """A level road."""
    return 0 * x


def disc(road, x=0.0, y=0.3, mass=10.0, law=TYRE, friction=None, base=mbd.ground):
    """A wheel of 0.3 m that nothing else holds."""
    body = mbd.Body("disc", mass=mass, inertia=0.5, pose=(x, y, 0))
    return body, mbd.Wheel("tyre", body.at(0, 0), base.at(0, 0), road, 0.3, law, friction)


def test_at_rest_on_the_road():
    """``m g / k`` deep; it bounces with ``k / m``."""
    body, tyre = disc(flat)
    rest = mbd.equilibrium(mbd.Mechanism([body], forces=[mbd.Gravity(), tyre]))
    assert rest[body.y] == pytest.approx(0.3 - 10 * G / 2e4, abs=1e-9)
    assert rest[tyre.normal_force] == pytest.approx(10 * G, abs=1e-8)
    assert np.max(np.abs(rest.small_motions.eigenvalues.imag)) == pytest.approx(np.sqrt(2e4 / 10), rel=1e-6)


def test_ride_over_waves():
    """An axle that drives with 20 m/s over waves of 1 mm and 4 m: ``m y" = k (h - y)`` about its rest; closed form."""
    speed, wave, high = 20.0, 2 * np.pi / 4, 0.001
    body, tyre = disc(lambda x: high * mbd.sin(wave * x), y=0.3 - 10 * G / 2e4)
    drives = [mbd.Driver("speed", body.x, speed * mbd.t), mbd.Driver("upright", body.phi, 0)]
    model = mbd.Mechanism([body], drivers=drives, forces=[mbd.Gravity(), tyre])
    run = mbd.simulate(model, np.linspace(0, 0.2, 21), initial=[body.vy == 0, body.y == 0.3 - 10 * G / 2e4], **TIGHT)
    own, forced = np.sqrt(2e4 / 10), wave * speed
    size = high * own**2 / (own**2 - forced**2)
    lift = size * (np.sin(forced * run.t) - forced / own * np.sin(own * run.t))
    assert np.min(run[tyre.normal_force]) > 10
    np.testing.assert_allclose(run[body.y] - 0.3 + 10 * G / 2e4, lift, atol=1e-8)
    slope = high * wave * np.cos(wave * speed * run.t)
    np.testing.assert_allclose(run[drives[0].effort], run[tyre.normal_force] * slope, atol=1e-6)


def test_energy_on_hills_and_a_leap():
    """Without friction and damping energy stays, also when it leaps; in the air it flies freely."""
    body, tyre = disc(lambda x: 0.15 * mbd.cos(2 * x), x=0.0, y=0.44)
    model = mbd.Mechanism([body], forces=[mbd.Gravity(), tyre])
    run = mbd.simulate(model, np.linspace(0, 1, 101), initial=[body.x == 0, body.vx == 4, body.y == 0.44], **TIGHT)
    assert np.ptp(run.energy.total) < 1e-6
    air = run[tyre.gap] > 0
    assert 10 < np.sum(air) < 90
    np.testing.assert_allclose(run[body.ay][air], -G, atol=1e-9)
    np.testing.assert_allclose(run[tyre.normal_force][air], 0, atol=1e-12)


@pytest.mark.parametrize("on_a_body", [False, True])
def test_braking_and_rolling(on_a_body):
    """A wheel thrown without spin slides with ``mu g``, turns faster by ``mu m g R / J`` and then rolls."""
    law = mbd.HuntCrossley(2e4, exponent=1, damping=0.2)
    base = mbd.Body("barge", mass=1e9, inertia=1e9) if on_a_body else mbd.ground
    body, tyre = disc(flat, y=0.3 - 10 * G / 2e4, law=law, friction=mbd.Coulomb(0.5, 1e-4), base=base)
    bodies, more = [body], []
    if on_a_body:
        bodies, more = [base, body], [mbd.Weld("moored", mbd.ground.at(0, 0), base.at(0, 0))]
    model = mbd.Mechanism(bodies, more, forces=[mbd.Gravity(), tyre])
    start = [body.vx == 3, body.vy == 0, body.omega == 0, body.y == 0.3 - 10 * G / 2e4]
    run = mbd.simulate(model, np.linspace(0, 1, 11), initial=start, reltol=1e-8, abstol=1e-8)
    until = 3 / (0.5 * G * (1 + 10 * 0.3**2 / 0.5))
    slides = run.t < until
    np.testing.assert_allclose(run[body.vx][slides], 3 - 0.5 * G * run.t[slides], atol=1e-4)
    np.testing.assert_allclose(run[body.omega][slides], -0.5 * G * 10 * 0.3 / 0.5 * run.t[slides], atol=1e-3)
    assert run[body.vx][-1] == pytest.approx(3 - 0.5 * G * until, abs=1e-4)
    assert run[tyre.sliding_speed][-1] == pytest.approx(0, abs=1e-4) and np.all(run[tyre.power] <= 1e-9)


def test_refuses():
    """Exact friction, a road that depends on the motion, a tyre that is too soft."""
    body, _ = disc(flat)
    with pytest.raises(mbd.ModelError, match="'tyre': DryFriction switches a row"):
        disc(flat, friction=mbd.DryFriction(0.5))
    with pytest.raises(mbd.ExpressionError, match="'tyre' depends on the velocity 'disc.vx'"):
        mbd.Wheel("tyre", body.at(0, 0), mbd.ground.at(0, 0), lambda x: x * body.vx, 0.3, TYRE)
    with pytest.raises(mbd.ModelError, match="'tyre': radius must be above 0"):
        mbd.Wheel("tyre", body.at(0, 0), mbd.ground.at(0, 0), flat, 0.0, TYRE)
    body, tyre = disc(flat, law=mbd.HuntCrossley(100, exponent=1))
    with pytest.warns(mbd.MechanismWarning, match="'tyre': its law is too soft: the centre of the wheel is under"):
        mbd.simulate(mbd.Mechanism([body], forces=[mbd.Gravity(), tyre]), np.linspace(0, 1, 5))
