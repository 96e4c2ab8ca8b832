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


@pytest.mark.parametrize("width", [0.005, 0.01, 0.03])
def test_a_gradient_through_a_load_of_a_few_steps(width):
    """Backwards in time the adjoint rests before it meets the load: ``v dv/dk`` is the work of a unit force."""
    scale = mbd.Parameter("scale", 1.0)
    sled = mbd.Body("sled", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), sled.at(0, 0))
    push = 0.05 / width * scale * mbd.fmax(0, 1 - mbd.fabs(sled.x - 1.5) / width)
    bump = mbd.Force("bump", sled.at(0, 0), (push, 0))
    model = mbd.Mechanism(bodies=[sled], joints=[rail], forces=[bump], parameters=[scale])
    cost = mbd.cost_function(model, [0, 4], [scale], terminal_cost=sled.vx, initial=[sled.x == 0, sled.vx == 1])
    value, gradient = cost.value_and_gradient([1.0])
    assert value == pytest.approx(np.sqrt(1.1), abs=1e-6)
    assert gradient[0] == pytest.approx(0.05 / np.sqrt(1.1), abs=1e-6)


@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_a_sweep_whose_first_case_does_not_meet_the_load(method):
    model, sled, speed, width, initial = coasting_sled()
    cases = {speed: np.array([1e-3, 1.0, 2.0, 5.0]), width: np.array([0.05, 0.05, 0.02, 0.05])}
    swept = mbd.sweep(model, TIMES, cases, {"v": sled.vx}, initial=initial, method=method)
    np.testing.assert_allclose(swept["v"][:, -1], last_speed(cases[speed], cases[width]), atol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "dop853"])
def test_a_sweep_of_which_one_case_meets_the_load(method):
    """Only at a dial of 24 of 1, 2 … 40 the sled is fast enough."""
    model, sled, speed, width, _ = coasting_sled()
    dial = mbd.Parameter("dial", 1.0)
    model = model.replace(parameters=[speed, width, dial])
    cases = {dial: np.arange(1.0, 41.0)}
    start = 0.1 + 2 * mbd.exp(-((dial - 24) ** 2) * 4)
    swept = mbd.sweep(
        model, TIMES, cases, {"v": sled.vx}, initial=[sled.x == 0, sled.vx == start], method=method,
        parameters={width: 0.02},
    )  # fmt: skip
    exact = last_speed(0.1 + 2 * np.exp(-((cases[dial] - 24) ** 2) * 4), 0.02)
    np.testing.assert_allclose(swept["v"][:, -1], exact, atol=1e-6)


@pytest.mark.slow
def test_a_sweep_of_many_cases_reports_how_many_were_looked_at(recwarn):
    model, sled, speed, _, initial = coasting_sled()
    swept = mbd.sweep(
        model, TIMES[:2], {speed: np.linspace(0.01, 0.02, 201)}, {"v": sled.vx}, initial=initial, method="dop853"
    )
    assert "looked for in 200 of 201 cases" in str(recwarn.pop(mbd.MechanismWarning).message)
    np.testing.assert_allclose(swept["v"][:, -1], swept.cases[speed], atol=1e-9)


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


def ball_above_a_peg(radius=0.02, stiffness=1e7, mass=0.1):
    """A ball that is thrown at a fixed peg of its own size, head-on, and comes back with its speed."""
    speed = mbd.Parameter("speed", 1e-3)
    ball = mbd.Body("ball", mass=mass, inertia=1e-6, pose=(0, 1 + 2 * radius, 0))
    law = mbd.HuntCrossley(stiffness, exponent=1.5)
    knock = mbd.Contact("knock", mbd.Circle(ball.at(0, 0), radius), mbd.Circle(mbd.ground.at(0, 0), radius), law)
    model = mbd.Mechanism(bodies=[ball], forces=[knock], parameters=[speed])
    start = [ball.x == 0, ball.y == 1 + 2 * radius, ball.phi == 0, ball.vx == 0, ball.vy == -speed, ball.omega == 0]
    return model, ball, speed, start


@pytest.mark.parametrize("method", ["idas", "erk"])
def test_balls_of_a_sweep_do_not_pass_through_a_peg(method):
    """The first case does not reach it; the others would be through within milliseconds."""
    model, ball, speed, start = ball_above_a_peg()
    speeds = np.array([1e-3, 20.0, 33.0])
    swept = mbd.sweep(model, [0, 1.5], {speed: speeds}, {"v": ball.vy}, initial=start, method=method)
    np.testing.assert_allclose(swept["v"][:, -1], [-1e-3, 20.0, 33.0], rtol=1e-4)


def test_a_cost_function_through_a_contact_that_its_first_values_do_not_reach():
    model, ball, speed, start = ball_above_a_peg(radius=0.005, stiffness=1e9, mass=0.01)
    cost = mbd.cost_function(model, [0, 1.5], [speed], terminal_cost=ball.vy, initial=start)
    value, gradient = cost.value_and_gradient([33.0])
    assert value == pytest.approx(33.0, abs=1e-4)
    np.testing.assert_allclose(gradient, [1.0], rtol=1e-3)


def test_derivatives_of_one_step_methods_through_contacts_are_reported():
    model, ball, speed, start = ball_above_a_peg()
    with pytest.warns(mbd.MechanismWarning, match="through contact .knock"):
        mbd.sensitivities(model, [0, 0.1], [ball.vy], [speed], initial=start, method="erk")
