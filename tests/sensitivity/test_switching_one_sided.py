"""Switches at which the derivatives to both sides differ: they are reported."""

import warnings

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd


def slope(forces, parameters, times, output="vx"):
    """Derivatives of a velocity by some parameters, for a body that starts at 1 m/s."""
    body = mbd.Body("body", mass=1, inertia=1)
    loads = [mbd.Force(name, body.at(0, 0), (load(body), 0)) for name, load in forces.items()]
    model = mbd.Mechanism([body], forces=loads, parameters=parameters)
    found = mbd.sensitivities(
        model, times, {"y": getattr(body, output)}, parameters, [body.x == 0, body.y == 0, body.vx == 1.0]
    )
    return [found["y", p] for p in parameters]


def test_two_switches_at_one_instant():
    a, b = mbd.Parameter("a", 1.0), mbd.Parameter("b", 1.0)
    forces = {"first": lambda o: ca.if_else(o.x > a, 2.0, 0.0), "second": lambda o: ca.if_else(o.x > b, 0.0, 3.0)}
    with pytest.warns(mbd.MechanismWarning, match="'first' and force 'second' jump together.*one-sided"):
        slope(forces, [a, b], [0, 0.5, 2.0])


def test_two_switches_at_one_instant_that_nothing_moves():
    """Constant instants have no order that changes."""
    k = mbd.Parameter("k", 1.0)
    pulse = {"one": lambda o: k * ca.if_else(mbd.t < 1, 2.0, 0.0), "two": lambda o: ca.if_else(mbd.t < 1, 0.0, 3.0)}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        np.testing.assert_allclose(slope(pulse, [k], [0, 0.5, 1.0, 2.0])[0], [0, 1, 2, 2], atol=1e-7)


@pytest.mark.parametrize("last", [1.0, 2.0])
def test_a_switch_in_the_state_at_an_output(last):
    a = mbd.Parameter("a", 1.0)
    with pytest.warns(mbd.MechanismWarning, match="force 'first' jumps at the output t = 1 s.*before the jump"):
        found = slope({"first": lambda o: ca.if_else(o.x > a, 2.0, 0.0)}, [a], sorted({0, 1.0, last}))[0]
    np.testing.assert_allclose(found, [0, 0, -2][: found.size], atol=1e-6)


@pytest.mark.parametrize("last", [1.0, 2.0])
def test_a_switch_in_time_at_an_output(last):
    end = mbd.Parameter("end", 1.0)
    with pytest.warns(mbd.MechanismWarning, match="force 'pulse' jumps at the output t = 1 s.*before the jump"):
        found = slope({"pulse": lambda o: ca.if_else(mbd.t < end, 2.0, 0.0)}, [end], sorted({0, 1.0, last}))[0]
    np.testing.assert_allclose(found, [0, 0, 2][: found.size], atol=1e-6)


def test_a_switch_between_outputs_is_not_reported():
    end = mbd.Parameter("end", 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = slope({"pulse": lambda o: ca.if_else(mbd.t < end, 2.0, 0.0)}, [end], [0, 0.9, 1.1])[0]
    np.testing.assert_allclose(found, [0, 0, 2], atol=1e-6)


@pytest.mark.parametrize("course", ["turns", "steers"])
def test_an_angle_that_passes_where_it_does_not_jump_is_no_jump(course):
    """The slip of a wheel that rolls forwards passes zero at an output, or leaves it as the wheel turns."""
    cart, stiffness, steers = mbd.Body("cart", 1.0, 1.0), mbd.Parameter("stiffness", 60.0), course == "steers"
    turn = 0.03 * mbd.step(mbd.t, 0.2, 0, 0.6, 1) if steers else 0.0
    ahead, across = (mbd.cos(turn), mbd.sin(turn)), (-mbd.sin(turn), mbd.cos(turn))
    slip = mbd.atan2(mbd.dot(cart.velocity, across), mbd.dot(cart.velocity, ahead))
    drag = mbd.Force("drag", cart.at(0, 0), (-stiffness * slip, -stiffness * slip if steers else 0))
    upright = mbd.AbsoluteAngle("upright", cart.at(0, 0))
    drivers = [] if steers else [mbd.Driver("course", cart.y, 0.5 * mbd.t - 0.5 * mbd.t**2)]
    mechanism = mbd.Mechanism([cart], [upright], drivers, [drag], parameters=[stiffness])
    times, start = np.linspace(0, 1, 11), [cart.x == 0, cart.vx == 20]
    start += [cart.y == 0, cart.vy == 0] if steers else []
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        found = mbd.sensitivities(mechanism, times, [cart.x], [stiffness], start)
    more, less = (
        mbd.simulate(mechanism, times, initial=start, parameters={stiffness: 60 + h}, reltol=1e-12, abstol=1e-12)
        for h in (0.01, -0.01)
    )
    assert found[cart.x, stiffness] == pytest.approx((more[cart.x] - less[cart.x]) / 0.02, abs=1e-7)
