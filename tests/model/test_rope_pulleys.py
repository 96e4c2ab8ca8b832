"""Elastic ropes over pulleys and drums against closed forms: bearings, sections, energy."""

import numpy as np
import pytest

import mbdcasadi as mbd

G, UP = 9.81, np.pi / 2


def over_a_wheel(m, k, y, length, grips):
    """A weight on a rope from the ground over a wheel of radius 0.1 m."""
    load = mbd.Body("load", m, 1.0, pose=(0.1, y, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0.1, 0, UP), load.at(0, 0, UP))
    wheel = mbd.Body("wheel", 1.0, 0.01)
    axle = mbd.Revolute("axle", mbd.ground.at(0, 0), wheel.at(0, 0))
    over = [mbd.Pulley(wheel.at(0, 0), 0.1, "clockwise", grips=grips)]
    rope = mbd.Rope("rope", mbd.ground.at(-0.1, -1), load.at(0, 0), length, k, over=over)
    return load, wheel, axle, rope, mbd.Mechanism([load, wheel], joints=[guide, axle], forces=[mbd.Gravity(), rope])


def test_a_free_pulley_shares_the_tension_and_its_bearing_carries_both_strands():
    """A weight that hangs over a fixed wheel swings about m g/k with √(k/m)."""
    m, k = 2.0, 800.0
    load, wheel, axle, rope, model = over_a_wheel(m, k, -1, 2 + 0.1 * np.pi, False)
    run = mbd.simulate(model, np.linspace(0, 1, 101), reltol=1e-10, abstol=1e-10)
    down = m * G / k * (1 - np.cos(np.sqrt(k / m) * run.t))
    np.testing.assert_allclose(run[load.y], -1 - down, atol=1e-8)
    np.testing.assert_allclose(run[rope.tensions], np.transpose([k * down, k * down]), atol=1e-5)
    np.testing.assert_allclose(run[axle.reaction_on(wheel).force][:, 1], 2 * k * down + G, atol=1e-5)
    assert np.ptp(run.energy.total) < 1e-7 and np.max(np.abs(run[wheel.omega])) < 1e-12


def test_a_wheel_that_grips_divides_the_rope_into_springs_in_series():
    """At rest each part is stretched by its share; the wheel turns by the stretch of the first part over its radius."""
    m, k = 2.0, 800.0
    load, wheel, _, rope, model = over_a_wheel(m, k, -3, 4.0, True)
    rest = mbd.equilibrium(model)
    assert rest.stable
    np.testing.assert_allclose(rest[rope.tension], m * G, atol=1e-8)
    assert rest[load.y] == pytest.approx(-3 - m * G / k)  # 4 m of rope, 1 m and 3 m
    assert rest[wheel.phi] == pytest.approx(-m * G / k / 4 / 0.1)


def test_a_drum_over_many_turns_keeps_the_energy_and_loads_its_bearing():
    """A load unwinds five turns of a drum: two masses with a spring between them, in closed form."""
    m, k, inertia, r = 3.0, 2e4, 0.06, 0.2
    load = mbd.Body("load", m, 1.0, pose=(r, -1, 0))
    guide = mbd.Translational("guide", mbd.ground.at(r, 0, UP), load.at(0, 0, UP))
    drum = mbd.Body("drum", 1.0, inertia)
    bearing = mbd.Revolute("bearing", mbd.ground.at(0, 0), drum.at(0, 0))
    wire = mbd.Rope("wire", mbd.Drum(drum.at(0, 0), r, "clockwise"), load.at(0, 0), 1.0, k)
    model = mbd.Mechanism([load, drum], joints=[guide, bearing], forces=[mbd.Gravity(), wire])
    run = mbd.simulate(model, np.linspace(0, 1.4, 141), reltol=1e-10, abstol=1e-10)
    reduced = m * inertia / (m * r**2 + inertia)
    tension = G * reduced * (1 - np.cos(np.sqrt(k / reduced) * run.t))
    np.testing.assert_allclose(run[wire.tension], tension, atol=2e-4)
    np.testing.assert_allclose(run[bearing.reaction_on(drum).force][:, 1], tension + G, atol=2e-4)
    assert run[drum.phi][-1] < -10 * np.pi and np.ptp(run.energy.total) < 1e-6


def test_friction_belongs_to_cables():
    body = mbd.Body("body", 1, 1, pose=(0.1, -1, 0))
    post = mbd.Pulley(mbd.ground.at(0, 0), 0.1, "clockwise", friction=mbd.DryFriction(0.1))
    with pytest.raises(mbd.ModelError, match="rope 'rope'.*take a Cable"):
        mbd.Rope("rope", mbd.ground.at(-0.1, -1), body.at(0, 0), 2.3, 100.0, over=[post])
