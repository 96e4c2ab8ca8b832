"""Wheels that roll on curves, against closed forms of wheels on slopes, in bowls and on drums."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81
TIGHT = {"reltol": 1e-11, "abstol": 1e-11}


def wheel(x, y, mass=2.0, radius=0.1):
    """A disc; its inertia is m R² / 2."""
    return mbd.Body("disc", mass=mass, inertia=mass * radius**2 / 2, pose=(x, y, 0))


def on_slope(angle, *more, radius=0.1, right=True, slips=False):
    """A disc on a straight line that falls to the right, or, with the line run backwards, the same."""
    along = np.array([np.cos(angle), -np.sin(angle)])
    line = mbd.Curve(lambda s: tuple(s * x for x in (along if right else -along)), -9, 9)
    disc = wheel(radius * np.sin(angle), radius * np.cos(angle), radius=radius)
    rolls = mbd.RollingOnCurve("wheel", disc.at(0, 0), mbd.ground.at(0, 0), line, radius, slips)
    return disc, rolls, line, along


@pytest.mark.parametrize("right", [True, False])
def test_down_a_slope(right):
    """``a = 2/3 g sin b``, ``F = m g sin b / 3``, ``N = m g cos b``, whichever way the curve runs."""
    disc, rolls, _, along = on_slope(0.4, right=right)
    run = mbd.simulate(mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity()]), np.linspace(0, 1, 11))
    a = 2 / 3 * G * np.sin(0.4)
    np.testing.assert_allclose(run[disc.position] - run[disc.position][0], np.outer(a / 2 * run.t**2, along), atol=1e-8)
    np.testing.assert_allclose(run[disc.omega], -a / 0.1 * run.t, atol=1e-7)
    np.testing.assert_allclose(run[rolls.normal_force], 2 * G * np.cos(0.4), rtol=1e-9)
    np.testing.assert_allclose(run[rolls.friction_force] * (1 if right else -1), -2 * G * np.sin(0.4) / 3, rtol=1e-9)
    load = run[rolls.reaction_on(disc).force]
    np.testing.assert_allclose(load @ along, -2 * G * np.sin(0.4) / 3, rtol=1e-9)
    np.testing.assert_allclose(run[rolls.reaction_on(disc).torque], -0.1 * 2 * G * np.sin(0.4) / 3, rtol=1e-9)


@pytest.mark.parametrize("inside", [True, False])
def test_in_a_bowl_and_on_a_drum(inside):
    """``v² = 4/3 g h``; ``N = m (g cos a ± v² / r)`` at the angle a from the vertical, and the turns of the wheel."""
    size, radius, mass, start = 1.0, 0.15, 2.0, 0.5
    circle = mbd.Curve(lambda s: (size * mbd.sin(s), -size * mbd.cos(s)), -np.pi, np.pi, closed=True)
    orbit, down = (size - radius, 1) if inside else (size + radius, -1)
    disc = wheel(orbit * np.sin(start), -down * orbit * np.cos(start), radius=radius)
    rolls = mbd.RollingOnCurve("wheel", disc.at(0, 0), mbd.ground.at(0, 0), circle, radius)
    run = mbd.simulate(mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity()]), np.linspace(0, 0.4, 9), **TIGHT)
    angle = np.arctan2(run[disc.x], -down * run[disc.y])
    square = 4 / 3 * G * orbit * down * (np.cos(angle) - np.cos(start))
    np.testing.assert_allclose(run[disc.vx] ** 2 + run[disc.vy] ** 2, square, atol=1e-8)
    np.testing.assert_allclose(run[rolls.normal_force], mass * (G * np.cos(angle) + down * square / orbit), atol=1e-7)
    np.testing.assert_allclose(run[disc.phi], -orbit / radius * (angle - start), atol=1e-8)


def test_leaves_a_drum():
    """A disc that rolls down a drum from its top leaves it where ``cos a = 4/7 cos a_0``."""
    size, radius, start = 1.0, 0.2, 0.1
    drum = mbd.Curve(lambda s: (size * mbd.cos(s), size * mbd.sin(s)), 0, 2 * np.pi, closed=True)
    disc = wheel(1.2 * np.sin(start), 1.2 * np.cos(start), radius=radius)
    rolls = mbd.RollingOnCurve("wheel", disc.at(0, 0), mbd.ground.at(0, 0), drum, radius)
    falls = mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity()])
    run = mbd.simulate(falls, np.linspace(0, 3, 31), events=[rolls.lift_off()])
    assert run[disc.y][-1] / 1.2 == pytest.approx(4 / 7 * np.cos(start), abs=1e-6)
    with pytest.warns(mbd.MechanismWarning, match="'wheel': the contact force is negative: the wheel would lift off"):
        mbd.simulate(falls, [0, run.t[-1] + 0.1])


def test_on_a_body_that_moves():
    """A disc in a valley on a cart: momentum and energy stay, and it does not slip on the cart."""
    cart = mbd.Body("cart", mass=3.0, inertia=1.0)
    disc = wheel(-0.5 + 0.1 / 2**0.5, 0.25 + 0.1 / 2**0.5)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    valley = mbd.Curve(lambda s: (s, s**2), -1, 1)
    rolls = mbd.RollingOnCurve("wheel", disc.at(0, 0), cart.at(0, 0), valley, radius=0.1)
    model = mbd.Mechanism([cart, disc], [rail, rolls], forces=[mbd.Gravity()])
    run = mbd.simulate(model, np.linspace(0, 2, 41), **TIGHT)
    assert np.ptp(run[cart.vx]) > 0.5
    np.testing.assert_allclose(run[3 * cart.vx + 2 * disc.vx], 0, atol=1e-9)
    assert np.ptp(run.energy.total) < 1e-8
    arm = run[rolls.contact_point - disc.position]
    slip = run[disc.velocity - cart.velocity] + run[disc.omega][:, None] * np.column_stack([-arm[:, 1], arm[:, 0]])
    np.testing.assert_allclose(slip, 0, atol=1e-12)


@pytest.mark.parametrize("friction", [0.1, 0.4])
def test_slips_if_friction_does_not_suffice(friction):
    """On a slope: no slip if ``mu > tan b / 3``; else ``a = g (sin b - mu cos b)``, ``alpha = 2 mu g cos b / R``."""
    b = 0.6
    disc, rolls, _, along = on_slope(b, slips=True)
    rubs = mbd.JointFriction("rubs", rolls, mbd.DryFriction(friction))
    run = mbd.simulate(mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity(), rubs]), np.linspace(0, 1, 5))
    slides = friction < np.tan(b) / 3
    a = G * (np.sin(b) - friction * np.cos(b)) if slides else 2 / 3 * G * np.sin(b)
    turn = 2 * friction * G * np.cos(b) / 0.1 if slides else a / 0.1
    np.testing.assert_allclose(run[disc.velocity] @ along, a * run.t, atol=1e-6)
    np.testing.assert_allclose(run[disc.omega], -turn * run.t, atol=1e-5)
    np.testing.assert_allclose(run[rubs.force], run[rolls.friction_force], atol=1e-7)


def test_a_thrown_wheel_begins_to_roll():
    """It slides until ``v_0 / (3 mu g)`` and then rolls with two thirds of its speed."""
    disc, rolls, _, _ = on_slope(0.0, slips=True)
    rubs = mbd.JointFriction("rubs", rolls, mbd.DryFriction(0.2))
    model = mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity(), rubs])
    run = mbd.simulate(model, np.linspace(0, 1, 11), initial=[disc.vx == 3, disc.omega == 0])
    assert run.events[0].t == pytest.approx(3 / (3 * 0.2 * G), abs=1e-8)
    assert run[disc.vx][-1] == pytest.approx(2, abs=1e-7) and run[disc.omega][-1] == pytest.approx(-20, abs=1e-6)


def test_radius_as_a_parameter():
    """Another radius in a run: the wheel is put on the curve again."""
    r = mbd.Parameter("r", 0.1)
    valley = mbd.Curve(lambda s: (s, s**2), -1, 1)
    disc = wheel(0, 0.1)
    rolls = mbd.RollingOnCurve("wheel", disc.at(0, 0), mbd.ground.at(0, 0), valley, r)
    model = mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity()], parameters=[r])
    assert mbd.assemble(model, [disc.x == 0], parameters={r: 0.3})[disc.y] == pytest.approx(0.3)
    with pytest.raises(mbd.MechanismError, match="wheel radius × curvature.*must be above 0"):
        mbd.assemble(model, [disc.x == 0], parameters={r: 0.6})


def test_refuses():
    """A hollow that is too narrow, a wheel of which the side is not known, friction in a wheel that does not slip."""
    valley = mbd.Curve(lambda s: (s, s**2), -1, 1)
    disc = wheel(0, 0.6)
    with pytest.raises(
        mbd.ModelError, match=r"'c': the wheel of radius 0.6 m does not fit into the hollow.* is 0\.5 m"
    ):
        mbd.RollingOnCurve("c", disc.at(0, 0), mbd.ground.at(0, 0), valley, 0.6)
    below = mbd.RollingOnCurve("c", wheel(0, -0.6).at(0, 0), mbd.ground.at(0, 0), valley, 0.6)
    assert below.side == 1
    with pytest.raises(mbd.ModelError, match="'c': the centre of the wheel is on the curve"):
        mbd.RollingOnCurve("c", wheel(0, 0).at(0, 0), mbd.ground.at(0, 0), valley, 0.1)
    with pytest.raises(mbd.ModelError, match="'c': curve must be a Curve"):
        mbd.RollingOnCurve("c", disc.at(0, 0), mbd.ground.at(0, 0), 3, 0.1)
    _, rolls, _, _ = on_slope(0.1)
    with pytest.raises(mbd.ModelError, match="joint 'wheel' rolls without slip; give it slips=True"):
        mbd.JointFriction("rubs", rolls, mbd.DryFriction(0.3))
    disc, rolls, _, _ = on_slope(1.2)
    model = mbd.Mechanism([disc], [rolls], forces=[mbd.Gravity()])
    with pytest.warns(mbd.MechanismWarning, match="'wheel': the wheel has left the curve at one of its ends"):
        mbd.simulate(model, np.linspace(0, 2, 3), initial=[disc.x == 3, disc.vx == 0])
