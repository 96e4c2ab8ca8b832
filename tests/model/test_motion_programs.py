"""Follower motions: ends, smoothness, published peaks, periods, refusals."""

import casadi as ca
import numpy as np
import pytest

import mbdcasadi as mbd

#: Peaks of velocity and acceleration in lift/duration and lift/duration² (Norton, table 2-5 and chapter 3).
PEAKS = {
    "cycloidal": (2.0, 2 * np.pi),
    "modified trapezoidal": (2.0, 8 * np.pi / (2 + np.pi)),
    "3-4-5": (1.875, 10 / np.sqrt(3)),
    "harmonic": (np.pi / 2, np.pi**2 / 2),
}


def derivatives(program, x):
    """Position, velocity, acceleration (3, n)."""
    s = ca.SX.sym("s")
    position = program(s)
    velocity = ca.jacobian(position, s)
    function = ca.Function("p", [s], [ca.vertcat(position, velocity, ca.jacobian(velocity, s))])
    return function(np.asarray(x)[None, :]).full()


@pytest.mark.parametrize("law", PEAKS)
def test_laws_have_their_published_peaks(law):
    """From rest to rest, peaks of velocity and acceleration, symmetric about the middle."""
    duration, lift = 1.7, 0.03
    program = mbd.MotionProgram(mbd.rise(duration, lift, law), mbd.dwell(1.0), mbd.fall(duration, law))
    x = np.linspace(0, duration, 20_001)
    position, velocity, acceleration = derivatives(program, x)
    assert position[0] == pytest.approx(0, abs=1e-15) and position[-1] == pytest.approx(lift)
    assert velocity[[0, -1]] == pytest.approx(0, abs=1e-12)
    assert np.max(velocity) == pytest.approx(PEAKS[law][0] * lift / duration, rel=1e-6)
    assert np.max(np.abs(acceleration)) == pytest.approx(PEAKS[law][1] * lift / duration**2, rel=1e-5)
    np.testing.assert_allclose(position + position[::-1], lift, atol=1e-14)
    # the derivatives belong to the position
    np.testing.assert_allclose(np.gradient(position, x)[1:-1], velocity[1:-1], atol=1e-8)
    np.testing.assert_allclose(np.gradient(velocity, x)[1:-1], acceleration[1:-1], atol=1e-4)


@pytest.mark.parametrize("law", [law for law in PEAKS if law != "harmonic"])
def test_acceleration_is_continuous_at_the_dwells(law):
    """C2 everywhere, the period's end included; the harmonic law jumps there, by its peak."""
    program = mbd.MotionProgram(mbd.rise(1, 2.0, law), mbd.dwell(0.5), mbd.fall(1.5, law), mbd.dwell(0.2))
    for place in (0, 1, 1.5, 3.0, 3.2):
        before, after = derivatives(program, np.array([place - 1e-9, place + 1e-9])).T
        np.testing.assert_allclose(before, after, atol=1e-6)


def test_levels_and_periods():
    """Steps up and down from another level, repeated in both directions."""
    program = mbd.MotionProgram(mbd.rise(1, 3.0), mbd.rise(1, 5.0), mbd.dwell(1), mbd.fall(1, level=1.0), start=1.0)
    assert program.duration == 4
    np.testing.assert_allclose(program(np.array([0.0, 1, 2, 2.7, 4, 5, -1.5])), [1, 3, 5, 5, 1, 3, 5], atol=1e-12)
    assert program(0.5) == pytest.approx(2.0)


def test_program_of_time_drives_a_joint():
    """A dwell–rise–return as the course of a driver, relative to the pose that was assembled."""
    arm = mbd.Body("arm", mass=1, inertia=1)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(0, 0))
    mechanism = mbd.Mechanism([arm], [pin])
    start = mbd.assemble(mechanism, [arm.phi == 0.7])
    program = mbd.MotionProgram(mbd.rise(1, 0.5), mbd.dwell(1), mbd.fall(1), start=0.0)
    drive = mbd.Driver("drive", pin.angle, program(mbd.t), relative_to=start)
    run = mbd.kinematics(mechanism.replace(drivers=[drive]), [0, 0.5, 1, 1.7, 3])
    np.testing.assert_allclose(run[arm.phi], [0.7, 0.95, 1.2, 1.2, 0.7], atol=1e-12)
    assert run[arm.omega][[0, 2, 3]] == pytest.approx(0, abs=1e-12)


def test_driver_goes_on_from_a_state_at_another_time():
    """relative_to= a state at t = 2 s: the course passes through that state then."""
    arm = mbd.Body("arm", mass=1, inertia=1)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(0, 0))
    mechanism = mbd.Mechanism([arm], [pin])
    state = mbd.assemble(mechanism, [arm.phi == 0.7], t=2.0)
    drive = mbd.Driver("drive", pin.angle, 3 * mbd.t**2, relative_to=state)
    run = mbd.kinematics(mechanism.replace(drivers=[drive]), [2.0, 3.0])
    np.testing.assert_allclose(run[arm.phi], [0.7, 0.7 + 3 * 5], atol=1e-12)
    with pytest.raises(mbd.ModelError, match="driver 'drive': relative_to must be a state"):
        mbd.Driver("drive", pin.angle, mbd.t, relative_to=0.7)


def test_driver_from_data():
    """A spline through measured angles as a course."""
    arm = mbd.Body("arm", mass=1, inertia=1)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(0, 0))
    times = np.linspace(0, 1, 21)
    drive = mbd.Driver("drive", pin.angle, mbd.spline(mbd.t, times, np.sin(2 * times)))
    run = mbd.kinematics(mbd.Mechanism([arm], [pin], [drive]), np.linspace(0, 1, 47))
    np.testing.assert_allclose(run[arm.phi], np.sin(2 * run.t), atol=5e-6)
    np.testing.assert_allclose(run[arm.omega], 2 * np.cos(2 * run.t), atol=5e-4)


@pytest.mark.parametrize(
    "make,said",
    [
        (lambda: mbd.MotionProgram(), "takes segments"),
        (lambda: mbd.MotionProgram(mbd.rise(1, 1), mbd.fall(1))("x"), "takes an expression or numbers, got 'x'"),
        (lambda: mbd.rise(mbd.Parameter("T", 1.0), 1.0), r"duration must be a number, got Parameter\('T'\)"),
        (lambda: mbd.MotionProgram(0.5), "takes segments"),
        (lambda: mbd.MotionProgram(mbd.rise(1, 2.0)), "begins at 0 and ends at 2"),
        (lambda: mbd.rise(-1, 2.0), "duration must be positive, got -1"),
        (lambda: mbd.rise(1, float("nan")), "level must be finite"),
        (lambda: mbd.rise(1, 2.0, "parabolic"), "law must be one of .* got 'parabolic'"),
    ],
)
def test_programs_that_make_no_sense(make, said):
    """Named, with the value."""
    with pytest.raises(mbd.ModelError, match=said):
        make()
