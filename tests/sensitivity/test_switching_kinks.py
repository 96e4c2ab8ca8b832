"""Derivatives of motions past kinks of a force, against differences of runs of SciPy and closed forms."""

import warnings

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import mbdcasadi as mbd

TIMES = np.linspace(0, 2, 21)
ONE_STEP = ["erk", "rosenbrock", "auto"]
LAWS = {
    "positive part": (lambda x, v: mbd.fmax(0, -0.5 - x), lambda x, v: max(0, -0.5 - x)),
    "absolute value": (lambda x, v: -0.2 * mbd.fabs(x + 0.7), lambda x, v: -0.2 * abs(x + 0.7)),
    "of a velocity": (lambda x, v: 0.05 * mbd.fabs(v), lambda x, v: 0.05 * abs(v)),
    "bend of a slope": (
        lambda x, v: mbd.sqrt(mbd.fmax(0, -0.5 - x) ** 2 + 0.01),
        lambda x, v: np.sqrt(max(0, -0.5 - x) ** 2 + 0.01),
    ),
    "comparison": (lambda x, v: mbd.if_else(x < -0.5, -0.5 - x, 0), lambda x, v: max(0, -0.5 - x)),
}


def falling(torque):
    factor = mbd.Parameter("factor", 20.0)
    rod = mbd.Body("rod", 1.0, 0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    forces = [mbd.Gravity(), mbd.Torque("stop", rod, factor * torque(rod.phi, rod.omega))]
    return rod, factor, mbd.Mechanism([rod], joints=[pin], forces=forces, parameters=[factor])


def slope_of(torque, h=2e-3):
    def angle(factor):
        def rate(_, y):
            return [y[1], (-9.81 * 0.5 * np.cos(y[0]) + factor * torque(*y)) / 0.35]

        return solve_ivp(rate, (0, 2), [0, 0], "DOP853", TIMES, rtol=1e-12, atol=1e-13, max_step=0.02).y[0]

    return (angle(20 + h) - angle(20 - h)) / (2 * h)


@pytest.mark.slow
@pytest.mark.parametrize("law", LAWS)
def test_a_kink_is_passed_by_every_method(law):
    torque, numbers = LAWS[law]
    rod, factor, model = falling(torque)
    wanted = slope_of(numbers)
    for method in (*ONE_STEP, "idas", "dop853"):
        found = mbd.sensitivities(model, TIMES, {"angle": rod.phi}, wrt=[factor], method=method)["angle", factor]
        np.testing.assert_allclose(found, wanted, atol=1e-5 * np.max(np.abs(wanted)), err_msg=method)


@pytest.mark.parametrize("method", ONE_STEP)
def test_gradients_of_costs_past_a_kink(method):
    torque, numbers = LAWS["positive part"]
    rod, factor, model = falling(torque)
    cost = mbd.cost_function(model, TIMES, wrt=[factor], terminal_cost=rod.phi, method=method)
    _, gradient = cost.value_and_gradient([20.0])
    assert gradient[0] == pytest.approx(slope_of(numbers)[-1], rel=1e-4)


def test_a_kink_in_time_that_a_parameter_moves():
    begin, sled = mbd.Parameter("begin", 0.3), mbd.Body("sled", 1.0, 1.0)
    push = mbd.Force("push", sled.at(0, 0), (mbd.fmax(0, mbd.t - begin), 0))
    model = mbd.Mechanism([sled], forces=[push], parameters=[begin])
    found = mbd.sensitivities(model, [0, 0.5, 1.0], {"v": sled.vx}, wrt=[begin], method="erk")["v", begin]
    np.testing.assert_allclose(found, [0, -0.2, -0.7], atol=1e-7)


def test_a_kink_on_which_the_motion_rests_is_no_jump():
    factor, sled = mbd.Parameter("factor", 1.0), mbd.Body("sled", 1.0, 1.0)
    forces = [mbd.Force("drag", sled.at(0, 0), (0, -factor * mbd.fabs(sled.vy) * sled.vy - mbd.fmax(0, sled.y)))]
    model = mbd.Mechanism([sled], forces=forces, parameters=[factor])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = mbd.sensitivities(model, [0, 1.0], {"y": sled.y}, wrt=[factor], method="erk")["y", factor]
    np.testing.assert_allclose(found, 0.0, atol=1e-12)


@pytest.mark.slow
def test_a_rope_that_becomes_taut():
    stiffness = mbd.Parameter("stiffness", 1000.0)
    rod = mbd.Body("rod", 1.0, 0.1, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    rope = mbd.Rope("rope", mbd.ground.at(0, 0.8), rod.at(0.5, 0), 1.5, stiffness)
    model = mbd.Mechanism([rod], joints=[pin], forces=[mbd.Gravity(), rope], parameters=[stiffness])

    def angle(k):
        def rate(_, y):
            c, s = np.cos(y[0]), np.sin(y[0])
            length = np.hypot(c, s - 0.8)
            tension = k * max(0, length - 1.5)
            return [y[1], (-9.81 * 0.5 * c + tension * 0.8 * c / length) / 0.35]

        return solve_ivp(rate, (0, 2), [0, 0], "DOP853", TIMES, rtol=1e-12, atol=1e-13, max_step=0.01).y[0]

    wanted = (angle(1000.1) - angle(999.9)) / 0.2
    found = mbd.sensitivities(model, TIMES, {"angle": rod.phi}, wrt=[stiffness], method="erk")["angle", stiffness]
    np.testing.assert_allclose(found, wanted, atol=1e-5 * np.max(np.abs(wanted)))
