"""Switches in time in the equations of a mechanism, and the times at which an integrator must restart."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.equations.switching.explicit_time import explicit_time

t = mbd.t


def sled_with(forces=(), drivers=(), joints=(), **more):
    sled = mbd.Body("sled", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    bound = [make(sled, rail) for make in (*forces, *drivers, *joints)]
    of = [bound[: len(forces)], bound[len(forces) : len(forces) + len(drivers)], bound[len(forces) + len(drivers) :]]
    return mbd.equations(mbd.Mechanism(bodies=[sled], joints=[rail, *of[2]], drivers=of[1], forces=of[0], **more))


def push(value):
    return lambda sled, rail: mbd.Force("push", sled.at(0, 0), (value(sled), 0))


def drive(value):
    return lambda sled, rail: mbd.Driver("drive", rail.displacement, value)


@pytest.mark.parametrize(
    "eom, times, restart",
    [
        (lambda: sled_with([push(lambda sled: mbd.if_else(t < 3, 0, sled.x))]), [3], [True]),
        (lambda: sled_with([push(lambda sled: mbd.fabs(t - 3) * sled.vx)]), [3], [False]),
        (lambda: sled_with([push(lambda sled: mbd.step(t, 3, 0, 4, 1) * sled.x)]), [3, 4], [False, False]),
        (lambda: sled_with([push(lambda sled: mbd.sin(t))]), [], []),
        (lambda: sled_with(drivers=[drive(mbd.fabs(t - 3) * (t - 3))]), [3], [True]),  # the acceleration jumps
        (lambda: sled_with(drivers=[drive(mbd.fabs(t - 3) ** 3)]), [3], [False]),
        (lambda: sled_with(drivers=[drive(mbd.MotionProgram(mbd.rise(2, 1), mbd.fall(4))(t))]), [2, 6, 8], [False] * 3),
    ],
)
def test_instants_and_restarts(eom, times, restart):
    found, restarts = explicit_time(eom()).breaks(np.zeros(0), 0, 10)
    np.testing.assert_allclose(found.times, times, rtol=1e-13)
    assert restarts.tolist() == restart


def test_rates_of_states_and_velocity_rows_count():
    charge = mbd.StateVariable("charge")
    eom = sled_with(
        joints=[lambda sled, rail: mbd.NonholonomicConstraint("belt", sled.vx - mbd.fabs(t - 2))],
        states={charge: mbd.if_else(t < 4, 1, 0)},
    )
    found, restarts = explicit_time(eom).breaks(np.zeros(0), 0, 10)
    np.testing.assert_allclose(found.times, [2, 4], rtol=1e-13)
    assert restarts.tolist() == [True, True]
    assert explicit_time(eom).jumps(np.zeros(0), 0, 10) == []


def test_velocity_row_that_jumps():
    eom = sled_with(joints=[lambda sled, rail: mbd.NonholonomicConstraint("belt", sled.vx - mbd.if_else(t < 2, 0, 3))])
    (jump,) = explicit_time(eom).jumps(np.zeros(0), 0, 10)
    assert (jump.level, jump.unit) == ("velocity", "m/s")
    assert (jump.time, abs(jump.size)) == pytest.approx((2, 3), abs=1e-9)


def test_inputs_in_time_are_seen_where_they_enter():
    u = mbd.Input("u")
    eom = sled_with([push(lambda sled: mbd.fmax(u, 0))], inputs=[u])
    assert not explicit_time(eom).depends
    course = explicit_time(eom, ca.vertcat(mbd.sin(t)))
    assert course.depends
    found, restarts = course.breaks(np.zeros(0), 0.1, 10)
    np.testing.assert_allclose(found.times, np.pi * np.arange(1, 4), rtol=1e-13)
    assert not any(restarts)
    assert not explicit_time(eom, ca.vertcat(ca.SX(eom.q[0]))).depends  # feedback without time


def test_parameters_move_the_instants():
    at = mbd.Parameter("at", 3.0)
    eom = sled_with([push(lambda sled: mbd.if_else(t < 2 * at, 0, 1))], parameters=[at])
    for value in (1.0, 2.5):
        assert explicit_time(eom).breaks(np.array([value]), 0, 10)[0].times.tolist() == [2 * value]


def test_it_is_found_once_for_the_same_inputs():
    force = mbd.Input("force")
    eom = sled_with([push(lambda sled: force)], inputs=[force])
    late, early = (ca.SX(mbd.if_else(t < instant, 0, 1)) for instant in (3, 2))
    assert explicit_time(eom, late) is explicit_time(eom, late)
    for inputs, instant in ((late, 3), (early, 2)):
        found, _ = explicit_time(eom, inputs).breaks(np.zeros(0), 0, 10)
        np.testing.assert_allclose(found.times, [instant], rtol=1e-13)
    assert explicit_time(eom, None, late) is not explicit_time(eom, late)
