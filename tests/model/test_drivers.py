"""Linear actuators: a driver of a length, by closed forms."""

import numpy as np
import pytest

import mbdcasadi as mbd

MASS, ARM, FOOT, G = 12.0, 0.8, 0.6, 9.81


def lifted(length, *parameters):
    """An arm on a pin, held at its centre of mass by an actuator from a point below the pin."""
    arm = mbd.Body("arm", mass=MASS, inertia=0.9, pose=(ARM, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), arm.at(-ARM, 0))
    jack = mbd.Actuator("jack", mbd.ground.at(0, -FOOT), arm.at(0, 0), length)
    return jack, pin, mbd.Mechanism([arm], [pin], drivers=[jack], forces=[mbd.Gravity()], parameters=parameters)


def test_the_force_at_rest_is_that_of_the_triangle():
    """Foot, pin and eye with the weight along the side below the pin: forces are to each other as the sides are."""
    length = 1.1
    jack, _, mechanism = lifted(length)
    state = mbd.inverse_dynamics(mechanism, [0.0]).initial
    assert state[jack.length] == pytest.approx(length) and state[jack.stroke] == pytest.approx(0, abs=1e-12)
    assert state[jack.force] == pytest.approx(-MASS * G * length / FOOT)  # it pushes
    assert state[jack.effort] == -state[jack.force]
    assert state[jack.reaction_on(mechanism.bodies[0]).force[1]] > 0


def test_its_work_is_the_energy_of_the_motion():
    """Over a stroke with acceleration; the angle follows from the triangle."""
    stroke = 0.15 * (1 - mbd.cos(2 * mbd.t))
    jack, pin, mechanism = lifted(0.9 + stroke)
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 1.2, 1201))
    length = 0.9 + 0.15 * (1 - np.cos(2 * run.t))
    np.testing.assert_allclose(run[jack.stroke], length - 0.9, atol=1e-10)
    sine = (length**2 - ARM**2 - FOOT**2) / (2 * ARM * FOOT)
    np.testing.assert_allclose(np.sin(run[pin.angle]), sine, atol=1e-9)
    power = -run[jack.force] * run[mbd.time_derivative(jack.length)]
    work = np.sum((power[1:] + power[:-1]) / 2 * np.diff(run.t))
    assert work == pytest.approx(run.energy.total[-1] - run.energy.total[0], rel=1e-5)


def test_an_actuator_and_a_given_force_of_the_same_size_move_alike():
    """The force found by inverse dynamics, as that of a TSDA."""
    jack, pin, mechanism = lifted(0.9 + 0.05 * mbd.t**2)
    run = mbd.inverse_dynamics(mechanism, np.linspace(0, 1, 201))
    force = mbd.spline(mbd.t, run.t, run[jack.force])
    given = mbd.TSDA("jack", jack.a, jack.b, actuator=force)
    replay = mbd.simulate(mechanism.replace(drivers=[], forces=[mbd.Gravity(), given]), run.t, initial=run.initial)
    np.testing.assert_allclose(replay[pin.angle], run[pin.angle], atol=1e-6)


def test_a_stroke_that_is_designed():
    """Optimal control with an actuator in it: the stroke after which the arm stands at an angle."""
    out = mbd.Parameter("out", 0.1, lower=0.01, upper=0.5)
    jack, pin, mechanism = lifted(0.9 + out * mbd.step(mbd.t, 0, 0, 1, 1), out)
    problem = mbd.OptimalControlProblem(mechanism, duration=1.0, final=[pin.angle == 0.4], free_parameters=[out])
    solution = mbd.optimize(problem, intervals=10)
    wanted = np.sqrt(ARM**2 + FOOT**2 + 2 * ARM * FOOT * np.sin(0.4)) - 0.9
    assert solution.trajectory[out][0] == pytest.approx(wanted, abs=1e-7)
    assert solution.trajectory[jack.stroke][-1] == pytest.approx(wanted, abs=1e-7)


def test_it_goes_on_from_a_state():
    """With relative_to nothing jumps."""
    *_, mechanism = lifted(1.0)
    state = mbd.assemble(mechanism)
    arm = mechanism.bodies[0]
    on = mbd.Actuator("jack", mbd.ground.at(0, -FOOT), arm.at(0, 0), 0.2 * mbd.t, relative_to=state)
    run = mbd.kinematics(mechanism.replace(drivers=[on]), [0.0, 0.5])
    np.testing.assert_allclose(run[on.length], [1.0, 1.1])
    np.testing.assert_allclose(run[on.stroke], [0.0, 0.1], atol=1e-10)


@pytest.mark.parametrize(
    ("length", "message"),
    [
        (-0.3, "actuator 'jack': length must be above 0, got -0.3"),
        (np.nan, "actuator 'jack': length must be finite"),
        ("long", "actuator 'jack': length must be a number"),
        (mbd.Input("u"), "actuator 'jack' depends on the input 'u'; a servo needs two time derivatives of its value"),
    ],
)
def test_lengths_that_are_none(length, message):
    with pytest.raises(mbd.MechanismError, match=message):
        lifted(length)


def test_a_length_that_a_parameter_makes_negative_and_an_actuator_within_one_body():
    length = mbd.Parameter("length", 1.0)
    *_, mechanism = lifted(length, length)
    with pytest.raises(mbd.ModelError, match="'jack': length must be above 0, got -1.0 with parameter 'length' = -1"):
        mbd.assemble(mechanism, parameters={length: -1.0})
    arm = mechanism.bodies[0]
    with pytest.raises(mbd.ModelError, match="actuator 'jack' connects body 'arm' with itself"):
        mbd.Actuator("jack", arm.at(0, 0), arm.at(1, 0), 1.0)
