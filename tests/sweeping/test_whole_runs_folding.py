"""Compiled runs through poses in which a mechanism could fold: a parallelogram that turns over and over."""

import re

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd

CRANK, BASE = 0.3, 0.5
TIMES = np.linspace(0, 0.6, 41)


def parallelogram(gravity=9.81):
    """Two cranks of equal length and a coupler, which stays horizontal; the mass of one crank is a parameter."""
    mass = mbd.Parameter("mass", 1.0)
    corner = CRANK * np.array([np.cos(1), np.sin(1)])
    left = mbd.Body("left", mass=mass, inertia=0.01, pose=(*(corner / 2), 1.0))
    right = mbd.Body("right", mass=1.0, inertia=0.01, pose=(BASE + corner[0] / 2, corner[1] / 2, 1.0))
    coupler = mbd.Body("coupler", mass=1.0, inertia=0.02, pose=(corner[0] + BASE / 2, corner[1], 0.0))
    pins = [
        mbd.Revolute("A", mbd.ground.at(0, 0), left.at(-CRANK / 2, 0)),
        mbd.Revolute("B", left.at(CRANK / 2, 0), coupler.at(-BASE / 2, 0)),
        mbd.Revolute("C", coupler.at(BASE / 2, 0), right.at(CRANK / 2, 0)),
        mbd.Revolute("D", mbd.ground.at(BASE, 0), right.at(-CRANK / 2, 0)),
    ]
    model = mbd.Mechanism([left, coupler, right], pins, forces=[mbd.Gravity((0, -gravity))], parameters=[mass])
    return model, left, coupler, mass


def turning_alone(mass, times, rate=12.0):
    """Angle of the cranks, from the equation of motion of the one degree of freedom of the parallelogram."""
    inertia = 2 * 0.01 + (mass + 1.0) * (CRANK / 2) ** 2 + 1.0 * CRANK**2
    weight = 9.81 * ((mass + 1.0) * CRANK / 2 + 1.0 * CRANK)

    def rates(_, y):
        return [y[1], -weight * np.cos(y[0]) / inertia]

    return solve_ivp(rates, times[[0, -1]], [1.0, rate], t_eval=times, rtol=1e-11, atol=1e-11).y[0]


def slope_alone(times, step=1e-3):
    """Derivative of the same angle by the mass, by differences."""
    return (turning_alone(1 + step, times) - turning_alone(1 - step, times)) / (2 * step)


@pytest.mark.parametrize("method", [pytest.param("idas", marks=pytest.mark.slow), "erk", "dop853"])
def test_cases_that_pass_such_poses_stay_on_the_branch_that_continues_smoothly(method):
    """Compiled runs left for the other branch, on which the coupler turns, or ended."""
    model, left, coupler, mass = parallelogram()
    given = {"initial": [left.omega == 12], "outputs": {"left": left.phi, "coupler": coupler.phi}, "method": method}
    swept = mbd.sweep(model, TIMES, {mass: [0.5, 2.0]}, **given)
    assert not swept.failures
    assert np.max(np.abs(swept["coupler"])) < 1e-9
    for k, value in enumerate((0.5, 2.0)):
        assert swept["left"][k] == pytest.approx(turning_alone(value, TIMES), abs=1e-5)
    assert any("could fold" in note for note in swept.notes)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk"])
def test_cases_that_turn_far_between_outputs_are_looked_at_closely_though_the_first_is_at_rest(method):
    """They were off by several radians: poses between outputs were looked at as closely as the first case needs."""
    model, left, coupler, mass = parallelogram(gravity=0)
    times, masses = np.linspace(0, 1, 4), np.array([1.0, 1.9, 2.0])
    given = {"initial": [left.omega == 12 * (mass - 1)], "outputs": {"left": left.phi, "coupler": coupler.phi}}
    swept = mbd.sweep(model, times, {mass: masses}, method=method, **given)
    assert not swept.failures
    assert np.max(np.abs(swept["coupler"])) < 1e-6
    assert swept["left"] == pytest.approx(1 + 12 * np.outer(masses - 1, times), abs=1e-5)


def test_cases_that_pass_none_run_as_ever():
    model, left, coupler, mass = parallelogram()
    times = np.linspace(0, 0.12, 7)
    given = {"initial": [left.omega == 12], "outputs": {"coupler": coupler.phi}}
    swept = mbd.sweep(model, times, {mass: [0.5, 2.0]}, **given)
    assert not swept.failures and not any("could fold" in note for note in swept.notes)


@pytest.mark.slow
@pytest.mark.parametrize(("method", "times"), [("idas", np.linspace(0, 2.0, 101)), ("erk", [0, 1.0])])
def test_derivatives_past_a_pose_in_which_it_could_fold_are_right_or_refused(method, times):
    """The derivative of the coupler's angle, which is zero, came out as 0.3 and 0.03 without a message.

    By rounding of the start the integrator leaves for the other branch, stops at the pose, or goes on smoothly.
    """
    model, left, coupler, mass = parallelogram()
    refused = (
        "could fold, and leaves for another branch at parameter 'mass' = 1"
        "|the integrator stopped at parameter 'mass' = 1: .* could fold; end the run before"
    )
    given = {"outputs": [coupler.phi, left.phi], "wrt": [mass], "initial": [left.omega == 12], "method": method}
    try:
        found = mbd.sensitivities(model, times, **given)
    except mbd.SimulationError as error:
        assert re.search(refused, str(error))
    else:
        assert np.max(np.abs(found[coupler.phi, mass])) < 1e-6
        assert found[left.phi, mass] == pytest.approx(slope_alone(np.asarray(times, float)), abs=1e-4)


def test_derivatives_of_a_motion_that_continues_smoothly_are_those_of_the_crank_alone():
    model, left, _, mass = parallelogram()
    found = mbd.sensitivities(model, TIMES, outputs=[left.phi], wrt=[mass], initial=[left.omega == 12], method="erk")
    assert found[left.phi, mass] == pytest.approx(slope_alone(TIMES), abs=1e-4)
