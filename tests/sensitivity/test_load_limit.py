"""Compiled analyses meet loads that come and go with the motion, at every values of the parameters."""

import numpy as np
import pytest

import mbdcasadi as mbd

TIMES = np.linspace(0, 10, 21)
FORCE = 2.0


def coasting_sled():
    """A sled of 1 kg that coasts over a force of a short range about x = 5 m; the work of it is known."""
    speed, width = mbd.Parameter("speed", 1e-3), mbd.Parameter("width", 0.05)
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    bump = mbd.Force("bump", sled.at(0, 0), (FORCE * mbd.exp(-(((sled.x - 5) / width) ** 2)), 0))
    model = mbd.Mechanism(bodies=[sled], joints=[rail], forces=[bump], parameters=[speed, width])
    return model, sled, speed, width, [sled.x == 0, sled.vx == speed]


def last_speed(speed, width):
    return np.where(speed > 0.5, np.sqrt(speed**2 + 2 * FORCE * width * np.sqrt(np.pi)), speed)


@pytest.mark.parametrize("method", ["idas", "erk"])
def test_a_cost_function_away_from_its_first_values(method):
    """At the values given the sled does not reach the bump; at others it passes in some hundredths of a second."""
    model, sled, speed, width, initial = coasting_sled()
    cost = mbd.cost_function(model, TIMES, [speed, width], terminal_cost=sled.vx, initial=initial, method=method)
    for values in ((2.0, 0.05), (2.0, 0.02)):
        value, gradient = cost.value_and_gradient(values)
        end = float(last_speed(*values))
        assert value == pytest.approx(end, abs=1e-6)
        np.testing.assert_allclose(gradient, [values[0] / end, FORCE * np.sqrt(np.pi) / end], atol=1e-5)


@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_a_sweep_whose_first_case_does_not_meet_the_load(method):
    model, sled, speed, width, initial = coasting_sled()
    cases = {speed: np.array([1e-3, 1.0, 2.0, 5.0]), width: np.array([0.05, 0.05, 0.02, 0.05])}
    swept = mbd.sweep(model, TIMES, cases, {"v": sled.vx}, initial=initial, method=method)
    np.testing.assert_allclose(swept["v"][:, -1], last_speed(cases[speed], cases[width]), atol=1e-6)


def test_a_load_about_the_end_of_a_piece():
    """Its peak is at an output at which a one-step method starts again, and half of it lies on either side."""
    model, sled, speed, width, initial = coasting_sled()
    motion = mbd.simulate(model, TIMES, initial=initial, parameters={speed: 5.0, width: 0.003}, method="erk")
    assert motion.final[sled.vx] == pytest.approx(float(last_speed(5.0, 0.003)), abs=1e-6)


@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_sweep_whose_later_cases_move_little(method):
    """Oscillations of a metre and of a micrometre, each right to its own size."""
    amplitude = mbd.Parameter("amplitude", 1.0)
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    spring = mbd.Force("spring", block.at(0, 0), (-4 * block.x, 0))
    model = mbd.Mechanism(bodies=[block], joints=[rail], forces=[spring], parameters=[amplitude])
    times, sizes = np.linspace(0, 10, 21), np.array([1.0, 1e-3, 1e-6])
    initial = [block.x == amplitude, block.vx == 0]
    swept = mbd.sweep(model, times, {amplitude: sizes}, {"x": block.x}, initial=initial, method=method)
    np.testing.assert_allclose(swept["x"] / sizes[:, None], np.tile(np.cos(2 * times), (3, 1)), atol=1e-5)
