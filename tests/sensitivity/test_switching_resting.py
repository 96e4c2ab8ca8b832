"""Jumps where a quantity is zero over a stretch: dead zones, penetrations, ends of a pulse; against closed forms."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

F, GAP = mbd.Parameter("F", 2.0), mbd.Parameter("gap", 0.45)
TIMES = np.linspace(0, 1.6, 5)
beyond = lambda x: mbd.fmax(x - GAP, 0)  # noqa: E731
outside = lambda x: mbd.if_else(x > GAP, x, 0)  # noqa: E731

#: A push back by F where x is beyond the gap, in words that are zero over a stretch.
BEYOND = {
    "more than no penetration": lambda x: mbd.if_else(beyond(x) > 0, 1, 0),
    "a multiple of it": lambda x: mbd.if_else(2.5 * beyond(x) > 0, 1, 0),
    "half of it, with the other sign": lambda x: mbd.if_else(-beyond(x) / 2 < 0, 1, 0),
    "no penetration": lambda x: mbd.if_else(beyond(x) <= 0, 0, 1),
    "a bounded one": lambda x: mbd.if_else(mbd.fmin(beyond(x), 1) >= 1e-300, 1, 0) * mbd.sign(beyond(x)),
    "what exceeds the gap": lambda x: mbd.if_else(mbd.fmax(x, GAP) - GAP > 0, 1, 0),
    "what is cut off at the gap": lambda x: mbd.if_else(mbd.fmax(mbd.fmin(x, GAP) - GAP, -1) >= 0, 1, 0),
    "its sign": lambda x: mbd.sign(mbd.fmin(beyond(x), 1)),
    "the sign of what is outside": lambda x: mbd.sign(outside(x)),
    "not inside": lambda x: mbd.if_else(outside(x) <= 0, 0, 1),
}


def pushed(push, x, v):
    body = mbd.Body("body", mass=1, inertia=1, pose=(x, 0, 0), velocity=(v, 0, 0))
    force = mbd.Force("load", body.at(0, 0), (push(body.x), 0))
    return body, mbd.Mechanism(bodies=[body], parameters=[F, GAP], forces=[force])


def place_after(start, speed, push, gap, time):
    """Place of a mass of 1 kg that is pushed back beyond a gap, until it goes in or comes back for good."""
    if start < gap:
        enters = (gap - start) / speed
        back = enters + 2 * speed / push
        inside = gap + speed * (time - enters) - push * (time - enters) ** 2 / 2
        return np.where(time < enters, start + speed * time, np.where(time < back, inside, gap - speed * (time - back)))
    leaves = (speed + np.sqrt(speed**2 + 2 * push * (start - gap))) / push
    goes = speed - push * leaves
    return np.where(time < leaves, start + speed * time - push * time**2 / 2, gap + goes * (time - leaves))


@pytest.mark.parametrize("name", BEYOND)
@pytest.mark.parametrize(("x", "v"), [(0.1, 1.0), (0.9, -0.3)])
@pytest.mark.parametrize("method", ["dop853", pytest.param("idas", marks=pytest.mark.slow)])
def test_derivatives_of_jumps_by_quantities_that_rest(name, x, v, method):
    """The motion is right, and its derivatives by the push and the gap, from inside and from outside."""
    body, mechanism = pushed(lambda at: -F * BEYOND[name](at), x, v)
    found = mbd.sensitivities(mechanism, TIMES, {"x": body.x}, [F, GAP], method=method)
    assert found["x"] == pytest.approx(place_after(x, v, 2.0, 0.45, TIMES), abs=1e-6)
    h = 1e-6
    by_push = (place_after(x, v, 2 + h, 0.45, TIMES) - place_after(x, v, 2 - h, 0.45, TIMES)) / (2 * h)
    by_gap = (place_after(x, v, 2.0, 0.45 + h, TIMES) - place_after(x, v, 2.0, 0.45 - h, TIMES)) / (2 * h)
    assert found["x", F] == pytest.approx(by_push, abs=1e-6)
    assert found["x", GAP] == pytest.approx(by_gap, abs=1e-6)


def test_a_pulse_between_two_ends_that_rest():
    """A push before the gap and one after twice the gap in time, by the sign of a sum that is zero in between."""
    sides = mbd.sign(mbd.fmax(mbd.t - 2 * GAP, 0) + mbd.fmin(mbd.t - GAP, 0))
    body, mechanism = pushed(lambda _: F * sides, 0.0, 0.0)
    found = mbd.sensitivities(mechanism, TIMES, {"v": body.vx}, [F, GAP])
    # v = -F gap + F (t - 2 gap) at the end
    assert found["v"][-1] == pytest.approx(2 * (1.6 - 3 * 0.45), abs=1e-6)
    assert found["v", F][-1] == pytest.approx(1.6 - 3 * 0.45, abs=1e-6)
    assert found["v", GAP][-1] == pytest.approx(-6.0, abs=1e-6)


@pytest.mark.parametrize(("x", "v"), [(0.1, 1.0), (0.9, -0.3)])
def test_what_rests_and_cannot_be_told_apart_is_refused(x, v):
    """A product with a parameter of any sign: neither the way in nor the way out passes zero."""
    body, mechanism = pushed(lambda at: -F * mbd.if_else(F * beyond(at) > 0, 1, 0), x, v)
    with pytest.raises(mbd.SimulationError, match=r"force 'load' jumps near t = .*zero over a stretch.*compare"):
        mbd.sensitivities(mechanism, TIMES, {"x": body.x}, [F], method="dop853")


@pytest.mark.slow
def test_motion_that_stays_at_the_border_of_a_dead_zone_is_refused():
    """A drag beyond a speed holds the motion at that speed: the switch that makes the drag is inside another one."""
    body = mbd.Body("body", mass=1, inertia=1, velocity=(0.1, 0, 0))
    drag = -F * mbd.sign(mbd.if_else(mbd.fabs(body.vx) > GAP, body.vx, 0))
    mechanism = mbd.Mechanism([body], parameters=[F, GAP], forces=[mbd.Force("load", body.at(0, 0), (1 + drag, 0))])
    with pytest.raises(mbd.SimulationError, match=r"'load' jumps at t = 0\.35.* holds the motion at the border"):
        mbd.sensitivities(mechanism, np.linspace(0, 0.5, 3), {"x": body.x}, [F])


@pytest.mark.parametrize("method", ["dop853", "idas"])
def test_a_direction_along_the_negative_axis_is_half_a_turn(method):
    """A force by the angle of a place on the border of atan2, and by the sign of zero, is constant."""
    body = mbd.Body("body", mass=1, inertia=1, pose=(-1, 0, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    force = -F * (mbd.atan2(body.y, body.x) - 3.0) - 0.1 * ca.copysign(F, body.y)
    model = mbd.Mechanism([body], [rail], forces=[mbd.Force("load", body.at(0, 0), (force, 0))], parameters=[F])
    found = mbd.sensitivities(model, TIMES, {"x": body.x}, [F], method=method)
    slope = -(np.pi - 3 + 0.1) * TIMES**2 / 2
    assert found["x"] == pytest.approx(-1 + 2 * slope, abs=1e-7)
    assert found["x", F] == pytest.approx(slope, abs=1e-7)
