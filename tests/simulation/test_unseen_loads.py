"""Loads in a short range of a coordinate or a state, met in uniform motion: closed forms by the work they do."""

from __future__ import annotations

import warnings

import casadi as ca
import numpy as np
import pytest
from scipy.special import gamma
from seeds import seeds

import mbdcasadi as mbd
from mbdcasadi.arguments.inputs import read_signals
from mbdcasadi.equations.switching.switch_functions import state_switches
from mbdcasadi.simulation.checks.unseen_loads import meets_loads
from mbdcasadi.simulation.quantities import quantities_of

METHODS = ["idas", "dop853", "erk", "rosenbrock"]
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


def quotient(body):
    """Its divisor changes little in its own unit, and by far more than its least size."""
    return PUSH * FACTOR * 0.01**4 / (0.01**4 + (body.x - 50) ** 4)


#: Loads and the ways over which the full push would do the same work, m. The rise of a step does half of it.
LOADS = [(rectangle, 0.1), (hump, 0.1), (bell, 0.05 * np.sqrt(np.pi)), (quotient, 0.01 * np.pi / np.sqrt(2))]


@pytest.mark.parametrize(("load", "way"), LOADS)
@pytest.mark.parametrize("method", METHODS)
def test_work_of_a_force_in_a_short_range(load, way, method):
    mechanism, body = puck(load)
    motion = mbd.simulate(mechanism, TIMES, initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * way), rel=1e-5)


@pytest.mark.parametrize(("power", "divides"), [(4, False), (6, False), (4, True), (6, True)])
@pytest.mark.parametrize("method", METHODS)
def test_flat_loads_between_two_outputs(power, divides, method):
    """Far from them their exponents and divisors look like narrower ones than they are, or wider ones."""
    width = 0.002
    mechanism, body = puck(
        lambda b: (
            PUSH * FACTOR / (1 + ((b.x - 50) / width) ** power)
            if divides
            else PUSH * FACTOR * mbd.exp(-(((b.x - 50) / width) ** power))
        )
    )
    way = 2 * width * (np.pi / power / np.sin(np.pi / power) if divides else gamma(1 + 1 / power))
    motion = mbd.simulate(mechanism, [0, 10], initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] - SPEED == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * way) - SPEED, rel=1e-3)


class Multistep(mbd.Integrator):
    """A plugin of CasADi that the package does not know, with the attributes of the base class."""

    name, plugin, solves_algebraic, is_multistep = "multistep", "cvodes", False, True


@pytest.mark.parametrize(("load", "way"), LOADS)
def test_work_by_a_method_of_ones_own(load, way):
    """It stops where the method stepped over the load."""
    mechanism, body = puck(load)
    method = Multistep(reltol=1e-10, abstol=1e-10)
    motion = mbd.simulate(mechanism, TIMES, initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * way), rel=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_load_at_equal_values_of_what_switches(method):
    """The operands of the comparison are looked at, not the comparison."""
    mechanism, body = puck(lambda b: PUSH * FACTOR * mbd.if_else(ca.sign(b.x - 50) + ca.sign(50.1 - b.x) == 2, 1, 0))
    motion = mbd.simulate(mechanism, TIMES, initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * 0.1), rel=1e-5)


def test_lengths_are_no_loads():
    """The length of a spring compares for zero, and divides; nothing comes and goes there."""
    body = mbd.Body("bob", mass=1.0, inertia=1.0, pose=(1, 0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(0, 0), body.at(0, 0), stiffness=10, free_length=0.5)
    eom = mbd.equations(mbd.Mechanism(bodies=[body], forces=[spring]))
    assert not meets_loads(eom, read_signals(eom, None))
    switches, _ = state_switches(ca.sign(body.x) == 1, eom.q, eom.a)
    assert len(switches) == 1 and ca.is_equal(switches[0], body.x)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("count", [5, 401])
@pytest.mark.parametrize(("begin", "end"), [(0.5, 0.51), (1.35, 1.4)])
def test_a_load_whose_edges_fall_on_outputs(begin, end, count, method):
    # in uniform motion at 1 m/s the places of the edges are instants of the outputs, or of those that are watched
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    work = 0.5
    load = work / (end - begin) * (mbd.if_else(sled.x > begin, 1, 0) - mbd.if_else(sled.x > end, 1, 0))
    force = mbd.Force("load", sled.at(0, 0), (load, 0))
    mechanism = mbd.Mechanism(bodies=[sled], joints=[rail], forces=[force])
    motion = mbd.simulate(mechanism, np.linspace(0, 4, count), initial=[sled.x == 0, sled.vx == 1], method=method)
    assert motion.t.tolist() == np.linspace(0, 4, count).tolist()
    before = motion.t < begin
    np.testing.assert_allclose(motion[sled.vx][before], 1, rtol=1e-9)
    assert motion[sled.vx][-1] == pytest.approx(np.sqrt(2), rel=2e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_load_over_many_outputs_that_begins_and_ends_gently(method):
    # between its knots a smooth step is near to zero for long: what the steps missed begins before what is found
    mechanism, body = puck(lambda b: FACTOR * (mbd.step(b.x, 0.5, 0, 0.55, 1) - mbd.step(b.x, 0.55, 0, 0.6, 1)))
    motion = mbd.simulate(mechanism, np.linspace(0, 3, 401), initial=[body.vx == 0.75], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(0.75**2 + 2 * 0.05), rel=1e-6)


@pytest.mark.parametrize(
    ("span", "half", "place", "count"),
    [
        (0.645548271711253, 4.575128525899132e-05, 0.26435875205574033, 501),
        (0.45167916274565917, 2.4400707685130633e-05, 0.2705977806754503, 101),
        (15.382985155982869, 0.0032202849229307005, 6.4544204642007, 3),
    ],
)
def test_a_load_that_is_zero_at_both_of_its_switches(span, half, place, count):
    """Stops at the two switches alone let IDAS step from one to the other. The work of the load is 16/15 of 0.2 J."""
    body = mbd.Body("puck", mass=1.0, inertia=1.0)
    bump = mbd.positive_power(1 - ((body.x - place) / half) ** 2, 2) * 0.2 / half
    mechanism = mbd.Mechanism(bodies=[body], forces=[mbd.Force("load", body.at(0, 0), (bump, 0))])
    for start in (0.0, 1e4):
        motion = mbd.simulate(mechanism, start + np.linspace(0, span, count), initial=[body.x == 0, body.vx == 1])
        assert motion.final[body.vx] == pytest.approx(np.sqrt(1 + 0.4 * 16 / 15), rel=1e-5)


@pytest.mark.parametrize("method", METHODS)
def test_a_magnet_that_a_body_passes(method):
    mechanism, body = puck(lambda b: PUSH * FACTOR * (1 + ((b.x - 50.3) / 0.01) ** 2) ** -2.5)
    motion = mbd.simulate(mechanism, TIMES, initial=[body.vx == SPEED], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * PUSH * 0.01 * 4 / 3), rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(("count", "begin", "width"), [(401, 1.45, 0.1), (2, 0.65, 0.1)])
@pytest.mark.parametrize("load", ["rectangle", "hump", "triangle"])
def test_compiled_analyses_see_loads_over_many_outputs(load, count, begin, width):
    middle = begin + width / 2
    mechanism, body = puck(
        lambda b: (
            FACTOR
            * {
                "rectangle": mbd.if_else(b.x > begin, 1, 0) - mbd.if_else(b.x > begin + width, 1, 0),
                "hump": 2 * (mbd.step(b.x, begin, 0, middle, 1) - mbd.step(b.x, middle, 0, begin + width, 1)),
                "triangle": 2 * mbd.fmax(0, 1 - mbd.fabs(b.x - middle) / (width / 2)),
            }[load]
        )
    )
    times, start = np.linspace(0, 2, count), [body.vx == 1]
    factors = np.array([0.5, 1.0])
    speeds = np.sqrt(1 + 2 * factors * width)
    swept = mbd.sweep(mechanism, times, {FACTOR: factors}, {"v": body.vx}, initial=start)
    np.testing.assert_allclose(swept["v"][:, -1], speeds, rtol=1e-5)
    found = mbd.sensitivities(mechanism, times, {"v": body.vx}, [FACTOR], start)
    assert found["v"][-1] == pytest.approx(speeds[1], rel=1e-5)
    assert found["v", FACTOR][-1] == pytest.approx(width / speeds[1], rel=1e-3)


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


def test_the_argument_of_a_spline_is_one_quantity():
    body = mbd.Body("b", mass=1.0, inertia=1.0)
    angles = np.linspace(0, 4 * np.pi, 145)
    gas = mbd.spline(body.phi, angles, np.cos(angles), outside="periodic")
    mechanism = mbd.Mechanism([body], forces=[mbd.Torque("gas", body, gas)])
    eom = mbd.equations(mechanism)
    quantities = quantities_of(eom, read_signals(eom, None))
    assert quantities.switches == 2  # the number of periods, and the angle within one
    inside = quantities.levels.between(np.arange(2), np.full(2, 0.01), np.full(2, 12.5))[1]
    np.testing.assert_allclose(inside, angles[1:-1])


@pytest.mark.parametrize("kind", ["cubic", "monotone", "linear"])
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_bump_in_the_data_of_a_spline_does_its_work(kind, method):
    """Of 200 points three hold the load, over 30 mm."""
    body = mbd.Body("puck", mass=1.0, inertia=1.0)
    xs = np.linspace(0, 2, 201)
    ys = np.where(np.abs(np.arange(201) - 130) < 2, 50.0, 0.0)
    force = mbd.spline(body.x, xs, ys, kind=kind, outside="constant")
    mechanism = mbd.Mechanism([body], forces=[mbd.Force("load", body.at(0, 0), (force, 0))])
    x = ca.SX.sym("x")
    curve = ca.Function("f", [x], [mbd.spline(x, xs, ys, kind=kind)])
    fine = (np.arange(200_000) + 0.5) / 1e5
    work = float(np.sum(curve(fine[None]).full()) / 1e5)
    motion = mbd.simulate(mechanism, [0, 1], initial=[body.vx == SPEED, body.x == -1], method=method)
    assert motion[body.vx][-1] == pytest.approx(np.sqrt(SPEED**2 + 2 * work), rel=1e-5)


def random_load(seed):
    """A puck that meets a load in a range from a tenth of a millimetre to a metre, and its speed before and after."""
    random = np.random.default_rng(seed)
    speed, mass, width = random.uniform(1, 30), 10 ** random.uniform(-1, 1), 10 ** random.uniform(-4, 0)
    gain, place, beyond = random.uniform(0.05, 0.5), *(6 * width + random.uniform(0, 40, 2))
    times = np.linspace(0, (place + beyond) / speed, random.integers(2, 30))
    body = mbd.Body("puck", mass=mass, inertia=1.0)
    x = body.x - place
    shape, way = [
        (mbd.if_else(ca.logic_and(x > 0, x < width), 1, 0), width),
        (mbd.exp(-((x / width) ** 2)), width * np.sqrt(np.pi)),
        (mbd.step(x, 0, 0, width, 1) * mbd.step(x, 2 * width, 1, 3 * width, 0), 2 * width),
        (width**4 / (width**4 + x**4), width * np.pi / np.sqrt(2)),
        (ca.fmax(width - ca.fabs(x), 0) / width, width),
    ][random.integers(5)]
    push = gain * mass * speed**2 / 2 / way
    load = mbd.Force("load", body.at(0, 0), (push * shape, 0))
    return mbd.Mechanism([body], forces=[load]), body, times, speed, speed * np.sqrt(1 + gain)


@pytest.mark.parametrize("method", ["idas", "dop853", "erk"])
@pytest.mark.parametrize("seed", seeds(1000))
def test_random_loads_do_their_work(seed, method):
    """Of five kinds, with outputs that are up to the whole run apart."""
    mechanism, body, times, before, after = random_load(seed)
    motion = mbd.simulate(mechanism, times, initial=[body.vx == before], method=method)
    assert motion[body.vx][-1] == pytest.approx(after, rel=1e-4)


@pytest.mark.parametrize("outputs", [2, 26, 300])
def test_a_load_that_lasts_many_outputs_is_not_stepped_over(outputs):
    """A bell of 0.92 m, met at 16.4 m/s: steps of a method that interpolates its outputs may be as long as the run."""
    body = mbd.Body("puck", mass=0.147, inertia=1.0)
    width, speed = 0.915, 16.4177
    load = mbd.Force("load", body.at(0, 0), (4.0 * mbd.exp(-(((body.x - 20.4583) / width) ** 2)), 0))
    times = np.linspace(0, 2.5, outputs)
    motion = mbd.simulate(mbd.Mechanism([body], forces=[load]), times, initial=[body.vx == speed], method="idas")
    exact = np.sqrt(speed**2 + 2 * 4.0 * width * np.sqrt(np.pi) / 0.147)
    assert motion[body.vx][-1] == pytest.approx(exact, rel=1e-5)
