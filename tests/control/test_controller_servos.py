"""Controllers, estimators and feedback of machines whose drivers follow states, against optimal control."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd


def crane(**limits):
    """A trolley that follows a state, whose acceleration is the input, with a load on a rope."""
    command = mbd.Input("acceleration", **limits)
    place, speed = mbd.StateVariable("place"), mbd.StateVariable("speed")
    trolley = mbd.Body("trolley", mass=20.0, inertia=0.0)
    load = mbd.Body("load", mass=5.0, inertia=0.0, pose=(0, -1, -np.pi / 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0)),
        mbd.Revolute("hook", trolley.at(0, 0), load.at(-1, 0)),
    ]
    servo = mbd.Driver("servo", trolley.x, place)
    states = {place: speed, speed: command}
    model = mbd.Mechanism([trolley, load], joints, [servo], [mbd.Gravity()], inputs=[command], states=states)
    return model, trolley, load, servo, command, place, speed


def converged(problem, initial, intervals, steps=None):
    """First inputs by a converged controller and by optimize."""
    sample = problem.duration[1] / intervals
    controller = mbd.Controller(problem, sample=sample, intervals=intervals, iterations=60, steps=steps)
    inputs = controller.inputs(initial)
    return controller, inputs, mbd.optimize(problem, initial=initial, intervals=intervals, control="constant")


@pytest.mark.slow
def test_plan_of_a_crane_is_that_of_optimize():
    """Also where the force of the servo is at its limit; in a run the load comes to rest at the goal."""
    model, trolley, load, servo, command, *_ = crane(lower=-3, upper=3)
    lean = load.phi + np.pi / 2
    away = 10 * (trolley.x - 1) ** 2 + trolley.vx**2 + 10 * lean**2 + load.omega**2
    problem = mbd.OptimalControlProblem(
        model, duration=1.5, running_cost=away + 0.01 * command**2, terminal_cost=5 * mbd.at_end(away),
        path=[mbd.bounded(-40, servo.effort, 40)],
    )  # fmt: skip
    start = mbd.assemble(model, [load.phi == -np.pi / 2 + 0.2, load.omega == 0])
    controller, inputs, best = converged(problem, start, 10)
    assert inputs[command] == pytest.approx(float(best.trajectory[command][0]), abs=1e-4)
    assert controller.plan.cost == pytest.approx(best.cost, rel=1e-4)
    run = mbd.simulate(
        model, np.linspace(0, 4, 41), initial=start, inputs=mbd.Controller(problem, sample=0.15, intervals=10)
    )
    assert [run[trolley.x][-1], run[lean][-1]] == pytest.approx([1, 0], abs=0.02)
    assert np.max(np.abs(run[servo.effort])) < 41


@pytest.mark.slow
def test_plan_of_a_linkage_is_that_of_optimize():
    """A crank that follows states moves a rocker: the loop closes with the states, far from the start, too."""
    angle, speed, command = mbd.StateVariable("angle", 1.0), mbd.StateVariable("speed"), mbd.Input("acceleration")
    f = mbd.library.four_bar(angle=1.0)
    servo = mbd.Driver("servo", f.crank.phi, angle)
    model = f.mechanism.replace(
        drivers=[servo], forces=[mbd.Gravity()], inputs=[command], states={angle: speed, speed: command}
    )
    start = mbd.assemble(model, [angle == 1.0, speed == 0])
    goal = float(mbd.assemble(model, [angle == 2.0, speed == 0])[f.rocker.phi])
    away = 20 * (f.rocker.phi - goal) ** 2 + f.rocker.omega**2
    problem = mbd.OptimalControlProblem(
        model, duration=1.0, running_cost=away + 0.001 * command**2, terminal_cost=mbd.at_end(away)
    )
    controller, inputs, best = converged(problem, start, 6, steps=8)
    assert inputs[command] == pytest.approx(float(best.trajectory[command][0]), rel=2e-4)
    assert controller.plan.cost == pytest.approx(best.cost, rel=1e-4)
    far = mbd.assemble(model, [angle == 1.0 + 4 * np.pi, speed == 0])
    controller.reset()
    controller.inputs(far)
    assert controller.status == 0
    assert controller.plan.states[0] == pytest.approx([1.0 + 4 * np.pi, 0])


def test_limits_of_states_hold():
    """A trolley whose speed is limited: the plan goes at the limit, and never above it."""
    speed = mbd.StateVariable("speed", upper=0.5)
    place, command = mbd.StateVariable("place"), mbd.Input("acceleration")
    trolley = mbd.Body("trolley", mass=20.0, inertia=0.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
    servo = mbd.Driver("servo", trolley.x, place)
    model = mbd.Mechanism([trolley], [rail], [servo], inputs=[command], states={place: speed, speed: command})
    away = 10 * (trolley.x - 1) ** 2
    problem = mbd.OptimalControlProblem(
        model, duration=2.0, running_cost=away + 0.01 * command**2, terminal_cost=mbd.at_end(away)
    )
    controller = mbd.Controller(problem, sample=0.1, intervals=20, iterations=20)
    controller.inputs(mbd.assemble(model, [place == 0, speed == 0]))
    speeds = controller.plan.states[:, controller.state_names.index("speed")]
    assert np.max(speeds) == pytest.approx(0.5, abs=1e-8) and np.sum(speeds > 0.499) > 5


def test_feedback_is_that_of_the_riccati_equation():
    """A double integrator at the end of a long horizon: gains 1 and √3 of ``x² + v² + u²``."""
    model, trolley, _, _, command, place, speed = crane()
    model = mbd.Mechanism(
        [trolley], model.joints[:1], model.drivers, inputs=[command], states={place: speed, speed: command}
    )
    problem = mbd.OptimalControlProblem(
        model, duration=8.0, initial=[place == 0.5, speed == 0], running_cost=place**2 + speed**2 + command**2
    )
    feedback = mbd.optimize(problem, intervals=16).feedback()
    np.testing.assert_allclose(feedback.gains([0.0])[0], [[1.0, np.sqrt(3)]], atol=1e-3)


def test_an_estimator_follows_a_crane():
    """From the lean alone, measured without noise, with the motion of the servo known: the state is exact."""
    model, trolley, load, _, command, place, speed = crane()
    lean = load.phi + np.pi / 2
    start = mbd.assemble(model, [load.phi == -np.pi / 2 + 0.3, load.omega == 0.1, place == 0.2, speed == 0.4])
    guess = mbd.assemble(model, [load.phi == -np.pi / 2, load.omega == 0, place == 0.2, speed == 0.4])
    estimator = mbd.Estimator(model, measured=[lean], noise=[1e-4], sample=0.05, horizon=20)
    assert estimator.state_names == ("load.phi", "load.omega", "place", "speed")
    estimator.reset(guess, np.diag([0.1, 0.1, 1e-8, 1e-8]))
    times = np.linspace(0, 1.0, 21)
    run = mbd.simulate(model, times, initial=start, inputs={command: 0.5}, reltol=1e-10, abstol=1e-10)
    for measured in run[lean][1:]:
        state = estimator.update([measured], {command: 0.5})
    for quantity in (load.phi, load.omega, trolley.x, trolley.vx):
        assert state[quantity] == pytest.approx(run[quantity][-1], abs=2e-4)
