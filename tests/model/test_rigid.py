"""Rigid contacts as elements: their rows, their modes, and what is refused."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

FLOOR = mbd.HalfPlane(mbd.ground.at(0, 0))


def box_on_floor(friction=None):
    """A square of 0.2 m on the ground, and its contact."""
    body = mbd.Body("body", mass=1, inertia=0.01, pose=(0, 0.1, 0))
    box = mbd.PolygonEdges(body.at(0, 0), [(-0.1, -0.1), (0.1, -0.1), (0.1, 0.1), (-0.1, 0.1)])
    return body, mbd.RigidContact("stands", box, FLOOR, friction)


def test_speeds_are_rates_of_the_gaps():
    """The speed of parting is the rate of each gap, and that of sliding is the motion of the corner along the plane."""
    body, stands = box_on_floor()
    rates = mbd.time_derivative(stands.gaps)
    function = ca.Function("speeds", [body.q, body.v], [rates - stands.normal_speeds, stands.sliding_speeds])
    away, along = function([0.3, 0.7, 0.4], [1.0, -2.0, 3.0])
    np.testing.assert_allclose(away.full(), 0, atol=1e-14)
    corner = np.array([[np.cos(0.4), -np.sin(0.4)], [np.sin(0.4), np.cos(0.4)]]) @ [-0.1, -0.1]
    assert float(along[0]) == pytest.approx(1.0 - 3.0 * corner[1])


def test_rows_and_forces_of_a_mode():
    """Closed gaps are position rows, sticking speeds velocity rows, and what slides has a force by its normal force."""
    body, stands = box_on_floor(mbd.DryFriction(0.25))
    active = stands.in_mode(("sticks", "forth", "open", "open"))
    assert active.row_names == ("stands.0.normal", "stands.1.normal", "stands.0.friction")
    assert active.rows.numel() == 2 and active.velocity_rows.numel() == 1
    assert ca.is_equal(active.multipliers, ca.vertcat(*[stands.multipliers[k] for k in (0, 1, 4)]))
    work = sum(force.T @ ca.jacobian(place, body.q) for place, force in active.virtual_work)
    load = ca.Function("load", [body.q, stands.multipliers], [work])([0, 0.1, 0], [0, -8.0, *[0] * 6])
    np.testing.assert_allclose(load.full().ravel(), [-2.0, 0, -0.2], atol=1e-15)  # -μ N at the corner below the centre
    assert not stands.in_mode(stands.free_mode).multipliers.numel()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"friction": mbd.Coulomb(0.2, 1e-3)}, "'c': friction must be DryFriction"),
        ({"friction": 0.3}, "'c': friction must be DryFriction.* got 0.3"),
        ({"restitution": 1.2}, "'c': restitution must be from 0 to 1, got 1.2"),
        ({"restitution": -0.1}, "'c': restitution must be at least 0"),
        ({"restitution": "hard"}, "'c': restitution must be a number"),
    ],
)
def test_bad_arguments(arguments, message):
    """Other laws, and a restitution that is not from 0 to 1."""
    body = mbd.Body("body", mass=1, inertia=1)
    with pytest.raises(mbd.ModelError, match=message):
        mbd.RigidContact("c", mbd.Circle(body.at(0, 0), 0.1), FLOOR, **arguments)


def test_bad_outlines():
    """Two on one body, and what is none."""
    body = mbd.Body("body", mass=1, inertia=1)
    disc = mbd.Circle(body.at(0, 0), 0.1)
    with pytest.raises(mbd.ModelError, match="contact 'c': both outlines are on body 'body'"):
        mbd.RigidContact("c", disc, disc)
    with pytest.raises(mbd.ModelError, match="contact 'c': takes outlines"):
        mbd.RigidContact("c", 3, FLOOR)
    with pytest.raises(mbd.ModelError, match="Contact"):
        mbd.RigidContact("", disc, FLOOR)


def test_restitution_as_a_parameter():
    """Its value is checked at the impact."""
    body = mbd.Body("body", mass=1, inertia=1, pose=(0, 0.2, 0))
    e = mbd.Parameter("e", 0.5)
    floor = mbd.RigidContact("floor", mbd.Circle(body.at(0, 0), 0.1), FLOOR, restitution=e)
    mechanism = mbd.Mechanism([body], forces=[mbd.Gravity(), floor], parameters=[e])
    times = np.linspace(0, 0.2, 3)
    motion = mbd.simulate(mechanism, times, parameters={e: 0.25})
    assert motion.events[0].after[body.vy] == pytest.approx(-0.25 * motion.events[0].state[body.vy])
    with pytest.raises(mbd.ModelError, match="contact 'floor': restitution must be from 0 to 1, got 1.5"):
        mbd.simulate(mechanism, times, parameters={e: 1.5})


@pytest.mark.parametrize("analysis", ["fmu", "live"])
def test_other_analyses_name_it(analysis, tmp_path):
    """What cannot follow it says so, and what to take."""
    body, stands = box_on_floor()
    mechanism = mbd.Mechanism([body], forces=[mbd.Gravity(), stands])
    call = {
        "fmu": lambda: mbd.export_fmu(mechanism, tmp_path / "x.fmu"),
        "live": lambda: mbd.animate(mechanism, live=True),
    }[analysis]
    with pytest.raises(mbd.MechanismError, match="contact 'stands'(: it)? opens and closes exactly, .* take a Contact"):
        call()
