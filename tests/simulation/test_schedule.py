"""Times of a run, and long runs whose outputs are far apart."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd
from mbdcasadi.simulation.schedule import Piece, Schedule

G = 9.81


@pytest.mark.parametrize("grid", [np.r_[0, np.linspace(1999, 2000, 11)], np.r_[0.0, 1.0], np.geomspace(1e-3, 10, 600)])
def test_watch_points_are_spread_evenly_over_the_time(grid):
    schedule = Schedule(grid, watch_points=400)
    lengths = np.diff(np.r_[schedule.start, schedule.times])
    assert np.max(lengths) <= (grid[-1] - grid[0]) / 400 * (1 + 1e-6)
    assert schedule.size <= 400 + grid.size
    np.testing.assert_array_equal(schedule.times[schedule.requested], grid[1:])


@pytest.mark.parametrize("last", [2.0, 2.5])
def test_an_output_at_the_last_further_stop_stays_one(last):
    """A piece up to stops about a load, the last of which may be an output."""
    schedule = Schedule(np.arange(5.0))
    piece = schedule.piece(0.0, 0, schedule.size - 1).through(np.array([1.5, last]))
    np.testing.assert_array_equal(piece.times[piece.requested], [1, 2])
    np.testing.assert_array_equal(piece.times[piece.stops], [1.5, last])


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "rosenbrock", "dop853"])
def test_every_output_is_there_though_a_force_switches_all_the_time(method):
    """A pendulum with drag, whose sign changes at each turn, at 201 outputs."""
    arm = mbd.Body("arm", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    drag = mbd.Torque("drag", arm, -0.05 * arm.omega * abs(arm.omega))
    pendulum = mbd.Mechanism(bodies=[arm], joints=[pin], forces=[mbd.Gravity(), drag])
    times = np.linspace(0, 20, 201)
    np.testing.assert_array_equal(mbd.simulate(pendulum, times, method=method).t, times)


@pytest.mark.parametrize("stops", [[0.2], [0.1, 0.15, 0.2], [0.12], [0.3], [0.5]])
def test_a_piece_that_ends_at_a_stop_keeps_the_output_there(stops):
    piece = Piece(0.0, np.array([0.1, 0.2, 0.3]), np.array([True, True, False]), np.zeros(3, bool))
    shorter = piece.through(np.array(stops))
    kept = piece.times[piece.requested & (piece.times <= shorter.times[-1])]
    assert shorter.times[shorter.requested].tolist() == kept.tolist()
    assert np.all(np.diff(shorter.times) > 0)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
@pytest.mark.parametrize("times", [np.r_[0, np.linspace(999, 1000, 6)]])
def test_drift_over_a_long_time_is_no_jump_of_a_constraint(method, times):
    arm = mbd.Body("arm", mass=1.0, inertia=0.1, pose=(1, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-1, 0))
    pendulum = mbd.Mechanism(bodies=[arm], joints=[pin], forces=[mbd.Gravity()])
    motion = mbd.simulate(pendulum, times, initial=[arm.phi == 0, arm.omega == 0], method=method)
    exact = solve_ivp(
        lambda t, y: [y[1], -G * np.cos(y[0]) / 1.1], (0, 1000), [0, 0], method="DOP853", rtol=1e-11, atol=1e-12
    )
    # what the note on the energy estimates
    assert motion[arm.phi][-1] == pytest.approx(exact.y[0, -1], abs=0.3)


@pytest.mark.parametrize("method", ["idas", "erk"])
def test_a_row_that_jumps_with_the_coordinates_is_found(method):
    wheel = mbd.Body("wheel", mass=1.0, inertia=1.0)
    slide = mbd.Body("slide", mass=1.0, inertia=1.0)
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), wheel.at(0, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), slide.at(0, 0))
    angle = mbd.atan2(mbd.sin(wheel.phi), mbd.cos(wheel.phi))
    rack = mbd.Constraint("rack", slide.x - angle)
    mechanism = mbd.Mechanism(bodies=[wheel, slide], joints=[pin, guide, rack])
    with pytest.raises(mbd.SimulationError, match="not continuous|cannot be met together"):
        mbd.simulate(mechanism, np.linspace(0, 10, 11), initial=[wheel.phi == 0, wheel.omega == 1], method=method)
