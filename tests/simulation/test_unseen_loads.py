"""Loads in a short range of a coordinate or a state, met in uniform motion: closed forms by the work they do."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

METHODS = ["idas", "erk", "rosenbrock"]
TIMES = np.linspace(0, 10, 11)
FACTOR = mbd.Parameter("factor", 1.0)
#: speed at which a body comes to a load, and the push of the load, N
SPEED, PUSH = 10.0, 100.0


def puck(force, **others):
    body = mbd.Body("puck", mass=1.0, inertia=1.0)
    load = mbd.Force("load", body.at(0, 0), (force(body), 0))
    return mbd.Mechanism(bodies=[body], forces=[load], parameters=[FACTOR], **others), body


def rectangle(body):
    return PUSH * FACTOR * mbd.if_else(ca.logic_and(body.x > 50, body.x < 50.1), 1, 0)


def hump(body):
    return PUSH * FACTOR * mbd.step(body.x, 50, 0, 50.05, 1) * mbd.step(body.x, 50.1, 1, 50.15, 0)


def bell(body):
    return PUSH * FACTOR * mbd.exp(-(((body.x - 50) / 0.05) ** 2))


#: Loads and the ways over which the full push would do the same work, m. The rise of a step does half of it.
LOADS = [(rectangle, 0.1), (hump, 0.1), (bell, 0.05 * np.sqrt(np.pi))]


@pytest.mark.parametrize(("load", "way"), LOADS)
@pytest.mark.parametrize("method", METHODS)
def test_work_of_a_force_in_a_short_range(load, way, method):
    mechanism, body = puck(load)
    motion = mbd.simulate(mechanism, TIMES, initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * way), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize(("load", "way"), LOADS)
def test_compiled_analyses_see_the_same_load(load, way):
    mechanism, body = puck(load)
    given = {"initial": [body.vx == SPEED]}
    factors = np.array([1.0, 1.5])
    speeds = np.sqrt(SPEED**2 + 2 * factors * PUSH * way)
    swept = mbd.sweep(mechanism, TIMES, {FACTOR: factors}, {"v": body.vx}, **given)
    np.testing.assert_allclose(swept["v"][:, -1], speeds, rtol=1e-6)
    found = mbd.sensitivities(mechanism, TIMES, {"v": body.vx}, [FACTOR], given["initial"])
    assert found["v"][-1] == pytest.approx(speeds[0], rel=1e-6)
    assert found["v", FACTOR][-1] == pytest.approx(PUSH * way / speeds[0], rel=1e-4)
    cost = mbd.cost_function(mechanism, TIMES, [FACTOR], terminal_cost=body.vx, **given)
    value, gradient = cost.value_and_gradient(cost.start)
    assert float(value) == pytest.approx(speeds[0], rel=1e-6)
    assert float(gradient[0]) == pytest.approx(PUSH * way / speeds[0], rel=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_a_wave_that_meets_a_body_at_rest(method):
    # relative to the wave the body comes at 2 m/s and is slowed down over 0.04 m
    mechanism, body = puck(lambda b: 20 * FACTOR * mbd.if_else(mbd.fabs(b.x - 2 * mbd.t + 10) < 0.02, 1, 0))
    motion = mbd.simulate(mechanism, TIMES, method=method)
    assert motion[body.vx][-1] == pytest.approx(2 - np.sqrt(4 - 2 * 20 * 0.04), rel=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_a_pulse_at_a_value_of_a_first_order_state(method):
    clock = mbd.StateVariable("clock")
    mechanism, body = puck(lambda _: PUSH * FACTOR * mbd.exp(-(((clock - 5.123) / 0.01) ** 2)), states={clock: 1})
    motion = mbd.simulate(mechanism, TIMES, method=method)
    assert motion[body.vx][-1] == pytest.approx(PUSH * 0.01 * np.sqrt(np.pi), rel=1e-6)


def test_a_pulse_that_a_flywheel_triggers():
    wheel = mbd.Body("wheel", mass=1, inertia=1)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), wheel.at(0, 0))
    slide = mbd.Body("slide", mass=1, inertia=1)
    pulse = PUSH * mbd.exp(-(((wheel.phi - 3.0) / 0.006) ** 2))
    mechanism = mbd.Mechanism(
        bodies=[wheel, slide], joints=[pin], forces=[mbd.Force("kick", slide.at(0, 0), (pulse, 0))]
    )
    motion = mbd.simulate(mechanism, TIMES, initial=[wheel.omega == 0.6, slide.x == 0, slide.vx == 0])
    assert motion[slide.vx][-1] == pytest.approx(PUSH * 0.01 * np.sqrt(np.pi), rel=1e-6)


def test_every_bump_of_a_row_is_met():
    places = np.arange(5.0, 95.0, 7.3)
    mechanism, body = puck(lambda b: sum(FACTOR * PUSH * mbd.exp(-(((b.x - x) / 0.02) ** 2)) for x in places))
    motion = mbd.simulate(mechanism, np.linspace(0, 12, 3), initial=[body.vx == SPEED])
    work = PUSH * 0.02 * np.sqrt(np.pi) * places.size
    assert motion[body.x][-1] > places[-1] + 1
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * work), rel=1e-6)


def test_the_integrator_starts_again_only_where_something_was_missed():
    # a stiffer spring beyond its rest, which every period passes and every step follows
    mechanism, body = puck(lambda b: -b.x - 3 * FACTOR * mbd.if_else(b.x > 0, b.x, 0))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        motion = mbd.simulate(mechanism, np.linspace(0, 30, 301), initial=[body.x == 1])
    assert motion.statistics.restarts < 40
    period = np.pi + np.pi / 2
    folded = np.mod(motion.t, period) - np.pi / 4
    exact = np.where(
        folded < 0,
        np.cos(2 * (folded + np.pi / 4)),
        np.where(folded < np.pi, -2 * np.sin(folded), np.sin(2 * (folded - np.pi))),
    )
    np.testing.assert_allclose(motion[body.x], exact, atol=1e-5)
