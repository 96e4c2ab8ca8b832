"""Controllers against the Riccati equation, optimal control and their own limits."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are

import mbdcasadi as mbd


def cart_on_rail(**limits):
    """A cart of 2 kg on a rail with a spring, pushed by a force."""
    force = mbd.Input("force", **limits)
    cart = mbd.Body("cart", mass=2.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-1, 0), cart.at(0, 0), stiffness=8.0, damping=0.5, free_length=1.0)
    push = mbd.Force("push", cart.at(0, 0), (force, 0))
    return mbd.Mechanism([cart], [rail], forces=[spring, push], inputs=[force]), cart, force


def pendulum_on_cart():
    """A cart-pole whose pole stands up."""
    force = mbd.Input("force", lower=-10, upper=10)
    cart = mbd.Body("cart", mass=1.0, inertia=0.0)
    bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, 0.5, np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
    drive = mbd.Force("drive", cart.at(0, 0), (force, 0))
    model = mbd.Mechanism([cart, bob], [rail, pole], forces=[mbd.Gravity(), drive], inputs=[force])
    away = 5 * cart.x**2 + cart.vx**2 + 10 * (bob.phi - np.pi / 2) ** 2 + bob.omega**2
    return model, cart, bob, force, pole, away


def first_inputs(problem, initial, intervals, **options):
    """First inputs by a converged controller and by optimize."""
    sample = problem.duration[1] / intervals
    controller = mbd.Controller(problem, sample=sample, intervals=intervals, iterations=60, **options)
    inputs = controller.inputs(initial)
    best = mbd.optimize(problem, initial=initial, intervals=intervals, control="constant")
    return controller, inputs, best


@pytest.mark.slow
def test_regulator_is_that_of_the_riccati_equation():
    """With the cost to go as terminal cost, the first input is the feedback of the discrete Riccati equation."""
    model, cart, force = cart_on_rail()
    h, n = 0.1, 40
    a = np.array([[0, 1], [-4.0, -0.25]])
    # matrices of the sampled cost by the exponential of Van Loan
    q, r = np.diag([10.0, 1.0]), 0.1
    whole = np.zeros((3, 3))
    whole[:2, :2], whole[:2, 2] = a, [0, 0.5]
    weight = np.zeros((3, 3))
    weight[:2, :2], weight[2, 2] = q, r
    big = expm(h * np.block([[-whole.T, weight], [np.zeros((3, 3)), whole]]))
    step = big[3:, 3:]
    cost = step.T @ big[:3, 3:]
    ad, bd = step[:2, :2], step[:2, 2:]
    p = solve_discrete_are(ad, bd, cost[:2, :2], cost[2:, 2:], s=cost[:2, 2:])
    gain = np.linalg.solve(cost[2:, 2:] + bd.T @ p @ bd, bd.T @ p @ ad + cost[:2, 2:].T)
    end = p[0, 0] * cart.x**2 + 2 * p[0, 1] * cart.x * cart.vx + p[1, 1] * cart.vx**2
    problem = mbd.OptimalControlProblem(
        model,
        duration=n * h,
        running_cost=10 * cart.x**2 + cart.vx**2 + 0.1 * force**2,
        terminal_cost=mbd.at_end(end),
    )
    controller = mbd.Controller(problem, sample=h, intervals=n)
    for x in ([0.3, -0.2], [-0.4, 0.5]):
        controller.reset()
        assert controller.step(x).inputs[0] == pytest.approx(float((-gain @ x)[0]), abs=1e-5)


@pytest.mark.slow
def test_input_limits_hold_as_in_optimize():
    """A controller that has converged on an active limit of the input gives the input of optimize."""
    model, cart, force = cart_on_rail(lower=-2, upper=2)
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        running_cost=50 * cart.x**2 + cart.vx**2 + 0.01 * force**2,
        terminal_cost=mbd.at_end(20 * cart.x**2),
    )
    start = mbd.assemble(model, [cart.x == 0.2, cart.vx == -0.5])
    controller, inputs, best = first_inputs(problem, start, 10)
    assert np.max(np.abs(controller.plan.inputs)) <= 2 + 1e-9
    assert np.sum(np.abs(controller.plan.inputs) > 1.999) >= 1
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=1e-5)


@pytest.mark.slow
def test_nonlinear_plan_is_that_of_optimize():
    """A pole that leans far over: the converged plan is the optimum, and its times are those of the horizon."""
    model, cart, bob, force, _, away = pendulum_on_cart()
    problem = mbd.OptimalControlProblem(
        model, duration=0.8, running_cost=away + 0.01 * force**2, terminal_cost=5 * mbd.at_end(away)
    )
    start = mbd.assemble(model, [cart.x == 0, cart.vx == 0, bob.phi == np.pi / 2 + 0.5, bob.omega == 0])
    controller, inputs, best = first_inputs(problem, start, 16)
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=1e-5)
    assert controller.plan.cost == pytest.approx(best.cost, rel=1e-4)
    assert controller.plan.t == pytest.approx(np.linspace(0, 0.8, 17))


@pytest.mark.slow
def test_steps_that_lead_nowhere_are_halved():
    """From these starts whole steps have no value after a few iterations; with shorter ones the plan is the optimum."""
    model, _, _, force, _, away = pendulum_on_cart()
    problem = mbd.OptimalControlProblem(
        model, duration=1.5, running_cost=away + 0.01 * force**2, terminal_cost=5 * mbd.at_end(away)
    )
    controller = mbd.Controller(problem, sample=0.05, intervals=30, iterations=60)
    assert controller.step([0.12, 0.84, -0.74, -1.84]).status == 0
    assert controller.plan.cost == pytest.approx(218.0510, abs=1e-3)  # of optimize
    for start in ([0.41, 1.96, -0.48, 2.78], [0.12, 2.15, -1.08, 0.93], [-0.27, 0.71, -0.7, -0.91]):
        controller.reset()
        assert controller.step(start).status in (0, 4) and np.isfinite(controller.plan.cost)


@pytest.mark.slow
def test_limits_of_a_crane_hold():
    """The lean of a rope and the load of its pin, which accelerations decide, keep their limits in the motion."""
    force = mbd.Input("force", lower=-10, upper=10)
    trolley = mbd.Body("trolley", mass=1.0, inertia=0.0)
    load = mbd.Body("load", mass=0.5, inertia=0.0, pose=(0, -0.8, -np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
    pin = mbd.Revolute("pin", trolley.at(0, 0), load.at(-0.8, 0))
    drive = mbd.Force("drive", trolley.at(0, 0), (force, 0))
    model = mbd.Mechanism([trolley, load], [rail, pin], forces=[mbd.Gravity(), drive], inputs=[force])
    lean, pull = load.phi + np.pi / 2, pin.reaction_on(load).force[0]
    away = 10 * trolley.x**2 + trolley.vx**2 + lean**2 + load.omega**2
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.5,
        running_cost=away + 0.01 * force**2,
        terminal_cost=5 * mbd.at_end(away),
        path=[mbd.bounded(-0.15, lean, 0.15), mbd.bounded(-0.6, pull, 0.6)],
    )
    start = mbd.assemble(model, [trolley.x == 1, trolley.vx == 0, lean == 0, load.omega == 0])
    controller = mbd.Controller(problem, sample=0.05, intervals=30)
    free = mbd.Controller(problem.replace(path=[]), sample=0.05, intervals=30)
    times = np.linspace(0, 3, 301)
    motion, without = (mbd.simulate(model, times, initial=start, inputs=c) for c in (controller, free))
    assert np.max(np.abs(without[lean])) > 0.2 and np.max(np.abs(without[pull])) > 1
    assert np.max(np.abs(motion[lean])) <= 0.15 + 1e-4
    assert np.max(np.abs(motion[pull])) <= 0.6 + 1e-4
    assert abs(motion[trolley.x][-1]) < 0.02


@pytest.mark.slow
def test_soft_limit_is_passed_at_its_price():
    """Soft limits are inputs of the program that are not returned; the plan is that of optimize."""
    model, cart, force = cart_on_rail(lower=-4, upper=4)
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        running_cost=50 * cart.x**2 + 0.01 * force**2,
        path=[mbd.soft(cart.vx >= -0.4, weight=5)],
    )
    start = mbd.assemble(model, [cart.x == 0.5, cart.vx == -0.3])
    controller, inputs, best = first_inputs(problem, start, 10)
    assert list(inputs) == [force] and controller.plan.inputs.shape == (10, 1)
    assert np.min(controller.plan.states[:, 1]) < -0.45
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=5e-3)


@pytest.mark.slow
def test_conditions_at_the_end_are_met():
    """A state at the end is reached by the plan, as by that of optimize."""
    model, cart, force = cart_on_rail(lower=-10, upper=10)
    rest = mbd.assemble(model, [cart.x == 0, cart.vx == 0])
    problem = mbd.OptimalControlProblem(model, duration=1.0, running_cost=force**2, final=rest)
    start = mbd.assemble(model, [cart.x == 0.3, cart.vx == 0.1])
    controller, inputs, best = first_inputs(problem, start, 10)
    assert controller.plan.states[-1] == pytest.approx([0, 0], abs=1e-8)
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("weight", [0.5, 50.0])
def test_soft_conditions_at_the_end_are_passed_at_their_price(weight):
    """More of them than inputs: a place and a speed that are missed at a low price, and met as far as the force can."""
    model, cart, force = cart_on_rail(lower=-2, upper=2)
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        running_cost=force**2,
        final=[mbd.soft(cart.x == 0, weight=weight), mbd.soft(cart.vx == 0, weight=weight)],
        terminal_cost=2 * mbd.positive_part(mbd.at_end(cart.vx + 0.3)),
    )
    start = mbd.assemble(model, [cart.x == 0.5, cart.vx == -0.1])
    controller, inputs, best = first_inputs(problem, start, 10)
    assert controller.plan.cost == pytest.approx(best.cost, rel=1e-5) and best.cost > 0.1
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=1e-5)
    assert abs(controller.plan.states[-1, 0]) < 1e-8 or weight < 1


@pytest.mark.slow
def test_first_order_states_are_states_of_the_controller():
    """A lag between command and force is a state that is measured."""
    force = mbd.Input("command", lower=-5, upper=5)
    lag = mbd.FirstOrderLag("lag", force, time_constant=0.05)
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    push = mbd.Force("push", cart.at(0, 0), (lag.output, 0))
    model = mbd.Mechanism([cart], [rail], forces=[lag, push], inputs=[force])
    cost = 10 * cart.x**2 + cart.vx**2
    problem = mbd.OptimalControlProblem(
        model, duration=1.0, running_cost=cost + 0.05 * force**2, terminal_cost=mbd.at_end(cost)
    )
    start = mbd.assemble(model, [cart.x == 0.3, cart.vx == 0])
    controller, inputs, best = first_inputs(problem, start, 20)
    assert len(controller.state_names) == 3
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=2e-5)


@pytest.mark.slow
def test_run_is_repeated_and_plans_are_separate():
    """Two runs of one controller are the same; one with other parameters has a plan of its own."""
    model, cart, force = cart_on_rail(lower=-5, upper=5)
    goal = mbd.Parameter("goal", 0.0)
    model = model.replace(parameters=[goal])
    problem = mbd.OptimalControlProblem(
        model, duration=2.0, running_cost=50 * (cart.x - goal) ** 2 + cart.vx**2 + 1e-3 * force**2
    )
    controller = mbd.Controller(problem, sample=0.05, intervals=40)
    times = np.linspace(0, 2, 41)
    runs = [mbd.simulate(model, times, initial=[cart.x == 0.2, cart.vx == 0], inputs=controller) for _ in range(2)]
    assert np.array_equal(runs[0][force], runs[1][force])
    other = mbd.simulate(
        model, times, initial=[cart.x == 0.2, cart.vx == 0], inputs=controller.with_parameters({goal: 0.1})
    )
    assert runs[0][cart.x][-1] == pytest.approx(0, abs=5e-3)
    assert other[cart.x][-1] == pytest.approx(0.1, abs=0.02)
    assert controller.timing.feedback.size == 120 and "ms (median)" in repr(controller.timing)
    moved = controller.with_parameters({goal: 0.1})
    back = moved.step([0.2, 0.0], {goal: 0.0})  # values of a step go before those of the controller
    assert back.inputs == pytest.approx(controller.with_parameters({goal: 0.0}).step([0.2, 0.0]).inputs, abs=0)
    with pytest.raises(mbd.ModelError, match="takes 2 states"):
        moved.step([0.2])
    with pytest.raises(mbd.ModelError, match="takes 1 parameters"):
        moved.step([0.2, 0.0], [1.0, 2.0])
    for given, words in (
        ({"time": "noon"}, "the time in s, got 'noon'"),
        ({"parameters": ["a"]}, "the parameters goal"),
    ):
        with pytest.raises(mbd.ModelError, match=words):
            moved.step([0.2, 0.0], **given)
    with pytest.raises(mbd.FileError, match="cannot be written"):
        moved.export(__file__)
    by_vector = controller.with_parameters([0.1]).step([0.2, 0.0])
    assert by_vector.inputs == pytest.approx(controller.with_parameters({goal: 0.1}).step([0.2, 0.0]).inputs, abs=0)


@pytest.mark.slow
def test_failures_have_a_status_and_finite_inputs():
    """States that are no numbers, beyond reach or beyond limits end in a status; the next good state is controlled."""
    robot = mbd.library.five_bar()
    inputs, tip = robot.mechanism.inputs, robot.tip
    problem = mbd.OptimalControlProblem(
        robot.mechanism,
        duration=0.1,
        running_cost=100 * ((tip.x - 0.125) ** 2 + (tip.y - 0.35) ** 2) + 1e-3 * (inputs[0] ** 2 + inputs[1] ** 2),
        path=[mbd.bounded(-3, inputs[0], 3), mbd.bounded(-3, inputs[1], 3), tip.y <= 0.5],
    )
    controller = mbd.Controller(problem, sample=0.02, intervals=5)
    good = np.array([*mbd.assemble(robot.mechanism)[mbd.equations(robot.mechanism).q[[2, 8]]], 0, 0])
    names = controller.state_names
    assert names == ("left.phi", "right.phi", "left.omega", "right.omega")
    assert controller.step(good).status == 0
    assert controller.step(np.full(4, np.nan)).status == 1
    assert controller.step([np.inf, 0, 0, 0]).status == 1
    apart = controller.step([np.pi, 0.0, 0, 0])  # the cranks point away from each other, and the links are too short
    assert apart.status == 2 and "loops" in apart.reason
    assert controller.step(good).status == 0
    rng = np.random.default_rng(3)
    counts = np.zeros(5, int)
    for _ in range(2000):
        state = good + rng.normal(size=4) * 10 ** rng.uniform(-2, 3, 4)
        if rng.random() < 0.1:
            state[rng.integers(4)] = rng.choice([np.nan, np.inf, -np.inf, 1e300])
        step = controller.step(state)
        counts[step.status] += 1
        assert np.all(np.abs(step.inputs) <= 3 + 1e-6)
    assert np.all(counts[:4] > 0)


@pytest.mark.slow
def test_limits_that_cannot_be_met_are_passed_by_little():
    """Beyond a limit of the position there is a status, and the plan comes back with all the force there is."""
    model, cart, force = cart_on_rail(lower=-20, upper=20)
    problem = mbd.OptimalControlProblem(
        model, duration=1.0, running_cost=force**2, path=[mbd.bounded(-0.1, cart.x, 0.1)]
    )
    controller = mbd.Controller(problem, sample=0.1, intervals=10)
    step = controller.step([0.5, 0.0])
    assert step.status == 3 and "limits" in step.reason
    assert step.inputs[0] == pytest.approx(-20, abs=0.1)
    assert controller.plan.states[-1, 0] <= 0.1 + 1e-3
    for bad in ("rest", {force: 0}, [1j, 0], None):
        with pytest.raises(mbd.ModelError, match="takes 2 "):
            controller.step(bad)
    # a run keeps the statuses, and tells of them once
    start = [cart.x == 0.5, cart.vx == 0]
    with pytest.warns(mbd.MechanismWarning, match="samples the controller had no plan.* first at t = 0 s: no plan"):
        motion = mbd.simulate(model, np.linspace(0, 1, 11), initial=start, inputs=controller)
    times, statuses = motion.statistics.control_times, motion.statistics.control_statuses
    assert times == pytest.approx(np.arange(10) * 0.1) and statuses[0] == 3 and statuses[-1] == 0
    assert motion[cart.x][np.searchsorted(motion.t, times[statuses.index(0)])] < 0.5
    assert sum("had no plan as asked for" in note for note in motion.statistics.notes) == 1


@pytest.mark.slow
def test_measured_positions_may_be_chosen():
    """States of one's own, here heights of the tip, give the inputs that the package's choice gives."""
    model, cart, bob, force, _, away = pendulum_on_cart()
    problem = mbd.OptimalControlProblem(model, duration=0.8, running_cost=away + 0.01 * force**2)
    own = mbd.Controller(problem, sample=0.05, intervals=16, iterations=30, state=[bob.x, bob.phi])
    usual = mbd.Controller(problem, sample=0.05, intervals=16, iterations=30)
    start = mbd.assemble(model, [cart.x == 0.1, cart.vx == 0.2, bob.phi == np.pi / 2 + 0.2, bob.omega == -0.3])
    assert own.state_names[0] == "bob.x"
    assert own.inputs(start)[force] == pytest.approx(usual.inputs(start)[force], abs=1e-6)


@pytest.mark.slow
def test_sample_may_be_shorter_than_an_interval():
    """With samples that divide the intervals, the motion comes to rest as with one sample an interval."""
    model, cart, force = cart_on_rail(lower=-5, upper=5)
    problem = mbd.OptimalControlProblem(model, duration=2.0, running_cost=50 * cart.x**2 + cart.vx**2 + 1e-2 * force**2)
    controller = mbd.Controller(problem, sample=0.02, intervals=20)
    motion = mbd.simulate(model, np.linspace(0, 2, 101), initial=[cart.x == 0.3, cart.vx == 0], inputs=controller)
    assert abs(motion[cart.x][-1]) < 2e-3


@pytest.mark.slow
def test_steps_of_the_integrator_make_plans_accurate():
    """A slider-crank that moves within 0.3 s: errors fall with the fifth power of the steps, to those of optimize."""
    linkage = mbd.library.slider_crank()
    model, crank, tau = linkage.mechanism, linkage.mechanism.bodies[0], linkage.mechanism.inputs[0]
    away = 10 * (crank.phi - 1.2) ** 2
    problem = mbd.OptimalControlProblem(
        model, duration=0.3, running_cost=away + 1e-3 * tau**2, terminal_cost=mbd.at_end(away + 0.1 * crank.omega**2)
    )
    start = mbd.assemble(model, [crank.phi == 0.9, crank.omega == 0])
    best = mbd.optimize(problem, initial=start, intervals=10, control="constant", transcription=mbd.GaussLegendre(5))
    costs = []
    for steps in (1, 2, 4):
        controller = mbd.Controller(problem, sample=0.03, intervals=10, iterations=60, steps=steps)
        first = controller.inputs(start)[tau]
        costs.append(abs(controller.plan.cost - best.cost))
    assert first == pytest.approx(float(best.trajectory[tau][0]), abs=5e-6)
    assert costs[1] < costs[0] / 15 and costs[2] < costs[1] / 15


@pytest.mark.slow
def test_steps_of_the_program_do_not_cycle():
    """Two coupled masses in the wind: from this state whole corrections go round for ever; the plan is the optimum."""
    force = mbd.Input("force")
    near, far = (mbd.Body(name, mass=m, inertia=0.1) for name, m in (("near", 1.0), ("far", 0.5)))
    rails = [mbd.Translational(f"rail {body.name}", mbd.ground.at(0, 0), body.at(0, 0)) for body in (near, far)]
    spring = mbd.TSDA("spring", near.at(0, 0), far.at(0, 0), stiffness=30, damping=0.2, free_length=0.5)
    wind = mbd.Force("wind", far.at(0, 0), (2 * mbd.sin(5 * mbd.t + 11.4), 0))
    push = mbd.Force("push", near.at(0, 0), (force, 0))
    model = mbd.Mechanism([near, far], rails, forces=[spring, wind, push], inputs=[force])
    problem = mbd.OptimalControlProblem(
        model,
        duration=1.0,
        running_cost=30 * (far.x - 0.5 - 0.1 * mbd.sin(mbd.t + 2.28)) ** 2 + 0.1 * far.vx**2 + 0.02 * force**2,
        path=[mbd.bounded(-6, force, 6)],
        final=[mbd.soft(near.vx == 0, weight=0.2)],
        terminal_cost=mbd.absolute(mbd.at_end(far.x) - 0.5),
    )
    moving = [near.x == 0.05988304, far.x == 0.64240239, near.vx == 0.33845905, far.vx == 0.67755189]
    controller, inputs, best = first_inputs(problem, mbd.assemble(model, moving), 20)
    assert controller.status == 0
    assert inputs[force] == pytest.approx(float(best.trajectory[force][0]), abs=1e-5)
