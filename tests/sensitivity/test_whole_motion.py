"""Derivatives by the method that runs in C, against other integrators, closed forms and differences."""

from __future__ import annotations

import gc

import casadi as ca
import numpy as np
import pytest
from linkages import four_bar, pendulum
from random_mechanisms import random_case
from test_switching_linear_contacts import END, bounced_height, dropped
from threads import together

import mbdcasadi as mbd
from mbdcasadi.identification.shooting import FitSetup
from mbdcasadi.integrators.native import build
from mbdcasadi.sensitivity.compiled_run import MotionSetup

TIMES = np.linspace(0, 0.5, 6)


def heated_four_bar():
    """A four-bar with a motor and a spring that warms: a first-order state whose rate contains a reaction."""
    stiffness, loss = mbd.Parameter("stiffness", 30.0), mbd.Parameter("loss", 0.5)
    heat, torque = mbd.StateVariable("heat", 0.2), mbd.Input("torque", 0.1)
    f = four_bar(0.8)
    softened = stiffness * (1 - heat / 2)
    spring = mbd.TSDA("spring", f.coupler.at(0, 0), mbd.ground.at(0.2, 0.8), stiffness=softened, free_length=0.3)
    load = f.A.reaction_on(f.crank).force
    linkage = f.mechanism.replace(
        forces=[mbd.Gravity(), spring, mbd.Torque("motor", f.crank, torque)],
        inputs=[torque],
        parameters=[stiffness, loss],
        states={heat: 1e-3 * ca.sumsqr(load) - loss * heat},
    )
    return f, linkage, (stiffness, loss, heat, torque)


def heated_cost(method, tolerance, samples=None):
    """Its cost function by all that it has: parameters, a start, an input as a number or as samples."""
    f, linkage, (stiffness, loss, heat, torque) = heated_four_bar()
    released = [f.crank.phi == 0.8, f.crank.omega == 3]
    given = {"initial": released, "reltol": tolerance, "abstol": tolerance, "method": method}
    given |= {} if samples is None else {"inputs": {torque: samples}}
    force = f.B.reaction_on(f.coupler).force
    cost = {"running_cost": 1e-2 * ca.sumsqr(force) + torque**2, "terminal_cost": heat + f.rocker.phi**2}
    return mbd.cost_function(linkage, TIMES, [stiffness, released[1], heat, torque, loss], **cost, **given)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [None, [0.1, 0.4, 0.2, -0.3, 0.0, 0.2]])
def test_a_cost_of_reactions_by_parameters_start_state_and_input_against_differences(samples):
    J = heated_cost("dop853", 1e-12, samples)
    value, gradient = J.value_and_gradient(J.start)
    steps = 1e-4 * np.diag(1 + np.abs(J.start))
    by_difference = [
        (8 * (J(J.start + d) - J(J.start - d)) - (J(J.start + 2 * d) - J(J.start - 2 * d))) / (12 * np.max(d))
        for d in steps
    ]
    np.testing.assert_allclose(gradient, by_difference, rtol=1e-8, atol=1e-8 * np.max(np.abs(by_difference)))
    other, other_gradient = heated_cost("idas", 1e-11, samples).value_and_gradient(J.start)
    assert value == pytest.approx(other, rel=1e-8)
    np.testing.assert_allclose(gradient, other_gradient, rtol=0, atol=1e-6 * np.max(np.abs(gradient)))


@pytest.mark.slow
@pytest.mark.parametrize("seed", [2, 4, 6, 18, 22, 24])
def test_random_mechanisms_as_by_runge_kutta_of_casadi(seed):
    """Loops, drivers, rows at velocity level and first-order states; accelerations and multipliers are outputs too."""
    mechanism, first = random_case(seed).mechanism, mbd.assemble(random_case(seed).mechanism)
    eom = mbd.equations(mechanism)
    free = mbd.linearize(mechanism, first).state_names[0]
    start = [eom.q[k] == first.q[k] for k, name in enumerate(eom.coordinate_names) if name == free]
    outputs, wrt = {"q": eom.q, "a": eom.a, "lam": eom.lam}, [*start, *mechanism.parameters[:2]]
    by_casadi, in_c = (
        mbd.sensitivities(mechanism, TIMES, outputs, wrt, start, method=method, reltol=tolerance, abstol=tolerance)
        for method, tolerance in (("erk", 1e-12), ("dop853", 1e-10))
    )
    for name in outputs:
        for key in wrt:
            size = 1 + np.max(np.abs(by_casadi[name, key]))
            np.testing.assert_allclose(in_c[name, key], by_casadi[name, key], rtol=0, atol=1e-7 * size)


@pytest.mark.slow
@pytest.mark.parametrize("stiffness", [1e4, 1e6])
def test_derivative_through_a_contact_that_opens_again(stiffness):
    ball, k, drop, start = dropped(stiffness)
    h = 1e-5 * stiffness
    exact = (bounced_height(stiffness + h) - bounced_height(stiffness - h)) / (2 * h)
    found = mbd.sensitivities(drop, np.linspace(0, END, 5), {"y": ball.y}, [k], start, method="dop853")
    assert found["y", k][-1] == pytest.approx(exact, rel=1e-4)


def test_a_switch_whose_place_is_a_parameter():
    """A constant push from a place on: ``v² = 1 + 2 push (x - place)`` at the end."""
    place, push = mbd.Parameter("place", 0.4), 3.0
    sled = mbd.Body("sled", mass=1, inertia=1)
    force = mbd.Force("push", sled.at(0, 0), (mbd.if_else(sled.x > place, push, 0.0), 0))
    model = mbd.Mechanism([sled], forces=[force], parameters=[place])
    found = mbd.sensitivities(
        model, [0, 1], [sled.x, sled.vx], [place], [sled.vx == 1], method="dop853", reltol=1e-10, abstol=1e-10
    )
    left = 1 - 0.4  # time after the place, which is passed at 1 m/s
    assert found[sled.x][-1] == pytest.approx(1 + push * left**2 / 2, abs=1e-9)
    assert found[sled.vx, place][-1] == pytest.approx(-push, abs=1e-8)
    assert found[sled.x, place][-1] == pytest.approx(-push * left, abs=1e-8)


def test_more_directions_than_run_together():
    """A free mass under samples of its force: by each a hat of the polygon, integrated twice."""
    push, mass = mbd.Input("push"), mbd.Body("mass", mass=1, inertia=1)
    model = mbd.Mechanism([mass], forces=[mbd.Force("push", mass.at(0, 0), (push, 0))], inputs=[push])
    times = np.linspace(0, 2, 21)
    given = {"inputs": {push: np.sin(times)}, "method": "dop853", "reltol": 1e-11, "abstol": 1e-11}
    found = mbd.sensitivities(model, times, [mass.vx, mass.x], [push], **given)
    hats = np.r_[0.05, np.full(19, 0.1), 0.05]
    # the centre of area of a hat is at its sample, of a half one at a third of its base
    centres = np.r_[1 / 30, times[1:-1], 2 - 1 / 30]
    np.testing.assert_allclose(found[mass.vx, push][-1], hats, atol=1e-10)
    np.testing.assert_allclose(found[mass.x, push][-1], hats * (2 - centres), atol=1e-10)


def test_gradients_stay_when_others_are_forgotten_and_in_threads():
    """Callbacks in functions of CasADi live as long as the cost function that they belong to."""
    gravity = mbd.Parameter("gravity", 9.81)
    p = pendulum(forces=lambda rod: [mbd.Force("weight", rod.at(0, 0), (0, -gravity))], parameters=[gravity])

    def cost():
        return mbd.cost_function(p.mechanism, [0, 0.5, 1], [gravity], terminal_cost=p.rod.phi, method="dop853")

    kept = cost()
    wanted = kept.gradient([9.0])
    for _ in range(3):
        cost().gradient([9.5])
        gc.collect()
    results = together([lambda: kept.gradient([9.0])] * 2 + [lambda: cost().gradient([9.0])] * 2)
    assert kept.gradient([9.2])[0] != pytest.approx(wanted[0], rel=1e-6)
    for gradient in [*results, kept.gradient([9.0])]:
        np.testing.assert_allclose(gradient, wanted, rtol=1e-12)


def test_what_does_not_suit_is_refused_with_the_method_to_take():
    body, gravity = mbd.Body("body", mass=1, inertia=0.1), mbd.Parameter("g", 9.81)
    joints = [mbd.Revolute(name, mbd.ground.at(0, 0), body.at(0, 0)) for name in ("first", "second")]
    twice = mbd.Mechanism([body], joints, forces=[mbd.Gravity((0, -gravity))], parameters=[gravity])
    for analysis in (
        lambda: mbd.sensitivities(twice, [0, 1], [body.phi], [gravity], method="dop853"),
        lambda: mbd.cost_function(twice, [0, 1], [gravity], terminal_cost=body.phi, method="dop853"),
        lambda: mbd.identify(twice, [0, 1], {body.phi: [0, 0]}, [gravity], method="dop853"),
    ):
        with pytest.raises(mbd.SimulationError, match=r'"dop853".*first.*second.*method="idas"'):
            analysis()
    with pytest.raises(mbd.SimulationError, match=r'"bdf" runs in code of its own.*derivatives.*method="idas"'):
        mbd.sensitivities(twice, [0, 1], [body.phi], [gravity], method="bdf")


@pytest.mark.skipif(build.compiler() is None, reason="without a C compiler it is not taken")
def test_identify_takes_it_by_itself_if_there_is_a_compiler(monkeypatch):
    mechanism = pendulum().mechanism
    assert FitSetup(mechanism, "identify", TIMES, method="auto").integrator.name == "dop853"
    assert MotionSetup(mechanism, "cost_function", TIMES, method="auto").integrator.name == "erk"
    monkeypatch.setenv("CC", "no-such-compiler")
    assert FitSetup(mechanism, "identify", TIMES, method="auto").integrator.name == "erk"
