"""Switches inside others: pulse widths, periods and remainders, in time and in the state, against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

P = mbd.Parameter("p", 0.3)
END, TIMES = 1.17, np.linspace(0, 1.17, 5)
#: pulses of 1 N and -0.5 N
HIGH, LOW = 1.0, -0.5


def pushed(force):
    """A mass of 1 kg that starts at 1 m/s."""
    body = mbd.Body("body", mass=1, inertia=1)
    load = mbd.Force("load", body.at(0, 0), (force(body), 0))
    return body, mbd.Mechanism(bodies=[body], parameters=[P], forces=[load])


def pulses(condition):
    return mbd.if_else(condition, HIGH, LOW)


#: Name, force, and speed at the end as a function of p near to 0.3 s, in closed form.
CASES = {
    "width": (lambda _: pulses(ca.fmod(mbd.t, 0.5) < P), lambda p: 1 + LOW * END + 1.5 * (2 * p + 0.17)),
    "period": (lambda _: pulses(ca.fmod(mbd.t, 2 * P) < 0.2), lambda p: 1 + LOW * END + 1.5 * 0.4),
    "both": (lambda _: pulses(ca.fmod(mbd.t, 2 * P) < P), lambda p: 1 + LOW * END + 1.5 * 2 * p),
    "remainder": (
        lambda _: pulses(ca.remainder(mbd.t, P) < 0.05),
        lambda p: 1 + LOW * END + 1.5 * (0.05 + 3 * (p / 2 + 0.05) + (END - 3.5 * p)),
    ),
    "steps of a count": (
        lambda _: 0.3 * ca.fmod(ca.floor(mbd.t / P), 2),
        lambda p: 1 + 0.3 * (p + END - 3 * p),
    ),
    "ramp in each period": (
        lambda _: mbd.step(ca.fmod(mbd.t, 0.45), 0.2 * P, 0, 0.5 * P, 1),
        lambda p: 1 + 3 * (0.45 - 0.35 * p) - (3 * 0.45 - END),
    ),
    "together with a coordinate": (
        lambda body: mbd.if_else(ca.logic_and(ca.fmod(mbd.t, 0.4) < P, body.x > -1), HIGH, LOW),
        lambda p: 1 + LOW * END + 1.5 * (2 * p + p),
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", CASES)
def test_all_analyses_agree_with_closed_forms(name):
    """Derivatives contain their jumps, and sweeps the switches of the force."""
    force, speed = CASES[name]
    body, mechanism = pushed(force)
    given = {"initial": [body.vx == 1]}
    wanted, slope = speed(0.3), (speed(0.3 + 1e-6) - speed(0.3 - 1e-6)) / 2e-6
    motion = mbd.simulate(mechanism, TIMES, **given)
    assert motion[body.vx][-1] == pytest.approx(wanted, abs=1e-5)
    found = mbd.sensitivities(mechanism, TIMES, {"v": body.vx}, [P], **given)
    assert found["v"][-1] == pytest.approx(wanted, abs=1e-5)
    assert found["v", P][-1] == pytest.approx(slope, abs=1e-5)
    cost = mbd.cost_function(mechanism, TIMES, [P], terminal_cost=body.vx, **given)
    value, gradient = cost.value_and_gradient(cost.start)
    assert (float(value), float(gradient[0])) == pytest.approx((wanted, slope), abs=1e-5)
    values = np.array([0.295, 0.3, 0.305])
    swept = mbd.sweep(mechanism, TIMES, {P: values}, {"v": body.vx}, **given)
    assert swept["v"][:, -1] == pytest.approx([speed(p) for p in values], abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_stripes_of_a_coordinate(method):
    """Pushes in stripes of a width p, each 0.4 m, by their work."""
    on_stripe = lambda body: ca.fmod(body.x, 0.4) < P  # noqa: E731
    body, mechanism = pushed(lambda b: mbd.if_else(ca.logic_and(on_stripe(b), b.x > -1), HIGH, 0.0))
    found = mbd.sensitivities(mechanism, TIMES, {"v": body.vx, "x": body.x}, [P], [body.vx == 1], method=method)
    assert 1.6 < found["x"][-1] < 1.9  # four stripes and a part of the fifth
    # v² = 1 + 2 (4 p + x - 1.6): v dv/dp = 4 + dx/dp
    assert found["v"][-1] == pytest.approx(np.sqrt(1 + 2 * HIGH * (4 * 0.3 + found["x"][-1] - 1.6)), abs=1e-6)
    assert found["v", P][-1] * found["v"][-1] == pytest.approx(4 + found["x", P][-1], rel=1e-4)
