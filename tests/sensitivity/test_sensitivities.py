"""Sensitivities against variational equations, closed forms and differences at tolerances of 1e-12."""

from __future__ import annotations

import re

import numpy as np
import pytest
from linkages import G, four_bar, pendulum
from scipy.integrate import solve_ivp
from scipy.optimize import minimize

import mbdcasadi as mbd
from mbdcasadi.identification.shooting import FitSetup

TIMES = np.linspace(0, 1.5, 31)


def swinging_rod():
    """Uniform rod of variable length and gravity, released from a variable angle, with a torque."""
    length, gravity = mbd.Parameter("length", 1.0, lower=0.1), mbd.Parameter("gravity", G)
    angle, tau = mbd.Parameter("angle", -0.4), mbd.Input("tau", value=0.3)
    rod = mbd.Body("rod", mass=1.3, inertia=1.3 * length**2 / 12, pose=(0.5, -0.2, -0.4))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-length / 2, 0))
    forces = [mbd.Gravity((0, -gravity)), mbd.Torque("motor", rod, tau)]
    swing = mbd.Mechanism(bodies=[rod], joints=[pin], forces=forces, inputs=[tau], parameters=[length, gravity, angle])
    return rod, pin, swing, (length, gravity, angle, tau)


def rod_by_hand(length, gravity, angle, tau, times=TIMES):
    """Angle, energy and pin force of the rod from its one equation of motion (DOP853, 1e-13)."""
    mass = 1.3
    inertia = mass * length**2 / 3

    def rate(t, y):
        return [y[1], (tau - mass * gravity * length / 2 * np.cos(y[0])) / inertia]

    run = solve_ivp(rate, (0, times[-1]), [angle, 0], method="DOP853", t_eval=times, rtol=1e-13, atol=1e-13)
    phi, omega = run.y
    alpha = np.array(rate(0, run.y)[1])
    h = length / 2
    ax = -h * (np.sin(phi) * alpha + np.cos(phi) * omega**2)
    ay = h * (np.cos(phi) * alpha - np.sin(phi) * omega**2)
    energy = inertia * omega**2 / 2 + mass * gravity * h * np.sin(phi)
    return {"phi": phi, "energy": energy, "force": mass * np.stack([ax, ay + gravity], axis=1)}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_positions_energies_and_reactions_against_differences(method):
    rod, pin, swing, symbols = swinging_rod()
    eom = mbd.equations(swing)
    outputs = {"phi": rod.phi, "energy": eom.kinetic + eom.potential, "force": pin.reaction_on(rod).force}
    released = [rod.phi == symbols[2], rod.omega == 0]
    found = mbd.sensitivities(
        swing, TIMES, outputs=outputs, wrt=symbols, initial=released, reltol=1e-11, abstol=1e-11, method=method
    )
    base = np.array([1.0, G, -0.4, 0.3])
    for k, symbol in enumerate(symbols):
        step = np.eye(4)[k] * 1e-4
        # fourth-order differences of an independent solution: error of some 1e-10
        runs = [rod_by_hand(*(base + j * step)) for j in (-2, -1, 1, 2)]
        for name in outputs:
            values = [run[name] for run in runs]
            difference = (values[0] - 8 * values[1] + 8 * values[2] - values[3]) / 12e-4
            assert found[name, symbol] == pytest.approx(difference, rel=1e-7, abs=1e-7), (name, symbol.label)
    assert found["force"] == pytest.approx(rod_by_hand(*base)["force"], abs=1e-7)


@pytest.mark.slow
def test_reactions_of_a_four_bar_against_differences_of_simulations():
    """A parameter that moves a point of a loop: start, pose and reactions all change with it."""
    reach, stiffness = mbd.Parameter("reach", 0.2), mbd.Parameter("stiffness", 30.0)
    f = four_bar(0.8)
    c = mbd.Revolute("C", f.coupler.at(0.25, 0), f.rocker.at(reach, 0))
    spring = mbd.TSDA("spring", f.coupler.at(0, 0), mbd.ground.at(0.2, 0.8), stiffness=stiffness, free_length=0.3)
    linkage = f.mechanism.replace(
        joints=[f.A, f.B, c, f.D], forces=[mbd.Gravity(), spring], parameters=[reach, stiffness]
    )
    times = np.linspace(0, 0.6, 13)
    released = [f.crank.phi == 0.8, f.crank.omega == 3]
    pull = c.reaction_on(f.rocker).force
    tight = {"reltol": 1e-11, "abstol": 1e-11}
    found = mbd.sensitivities(
        linkage, times, outputs=[pull, f.rocker.phi], wrt=[reach, stiffness, released[1]], initial=released, **tight
    )

    def run(r=0.2, k=30.0, rate=3.0):
        start = [f.crank.phi == 0.8, f.crank.omega == rate]
        given = {reach: r, stiffness: k}
        motion = mbd.simulate(linkage, times, initial=start, parameters=given, method="erk", reltol=1e-12, abstol=1e-12)
        return motion[pull], motion[f.rocker.phi]

    changes = {reach: ("r", 0.2, 1e-4), stiffness: ("k", 30.0, 1e-2), released[1]: ("rate", 3.0, 1e-3)}
    for key, (name, value, step) in changes.items():
        runs = [run(**{name: value + j * step}) for j in (-2, -1, 1, 2)]
        for k, output in enumerate((pull, f.rocker.phi)):
            difference = (runs[0][k] - 8 * runs[1][k] + 8 * runs[2][k] - runs[3][k]) / (12 * step)
            scale = np.max(np.abs(difference))
            assert found[output, key] == pytest.approx(difference, abs=2e-6 * scale), name


def test_redundant_rows_do_not_matter():
    f = four_bar(0.8, forces=[])
    weight = mbd.Parameter("weight", 9.81)
    plain = f.mechanism.replace(forces=[mbd.Gravity((0, -weight))], parameters=[weight])
    doubled = plain.replace(joints=[*plain.joints, mbd.Revolute("again", f.crank.at(0.1, 0), f.coupler.at(-0.25, 0))])
    times = np.linspace(0, 0.4, 9)
    one, two = (
        mbd.sensitivities(m, times, [f.rocker.phi], [weight], initial=[f.crank.phi == 0.8]) for m in (plain, doubled)
    )
    assert two[f.rocker.phi, weight] == pytest.approx(one[f.rocker.phi, weight], abs=1e-7)


def cantilever(bodies, mass):
    """A redundant arm on a cart in a guide, with a load of zero at its end; and its load, cart, joints and links."""
    load = mbd.Parameter("load", 0.0)
    cart = mbd.Body("cart", mass=5.0, inertia=1.0)
    links = [
        mbd.Body(f"link {k}", mass=m, inertia=m / 12, pose=(k + 0.5, 0, 0)) for k, m in enumerate(bodies * [mass, 1.0])
    ]
    joints = [mbd.Translational("guide", mbd.ground.at(0, 0, np.pi / 2), cart.at(0, 0, np.pi / 2))]
    for k, link in enumerate(links):
        last, x = (links[k - 1], 0.5) if k else (cart, 0)
        joints.append(mbd.Weld(f"weld {k}", last.at(x, 0), link.at(-0.5, 0)))
        joints.append(mbd.Revolute(f"pin {k}", last.at(x, 0.2), link.at(-0.5, 0.2)))
    push = mbd.Force("push", links[-1].at(0.5, 0), (0, load))
    return mbd.Mechanism([cart, *links], joints, forces=[push], parameters=[load]), load, cart, joints, links


@pytest.mark.slow
@pytest.mark.parametrize("mass", [1.0, 0.0])
def test_a_redundant_cantilever_at_rest_without_loads(mass):
    """Where all multipliers are zero, their derivatives are not: those of a rigid arm, shared in least norm."""
    model, load, cart, joints, links = cantilever(3, mass)
    loaded = mbd.assemble(model, parameters={load: 1.0})
    reactions = [joint.reaction_on(links[0]).force[k] for joint in joints[1:3] for k in range(2)]
    times, total = np.linspace(0, 1, 5), 8 + 3 * mass
    found = mbd.sensitivities(model, times, [cart.y, links[-1].ay, *reactions], [load])
    assert found[cart.y, load] == pytest.approx(times**2 / (2 * total), abs=1e-9)
    assert found[links[-1].ay, load] == pytest.approx(1 / total, abs=1e-9)
    for reaction in reactions:
        assert found[reaction, load][0] == pytest.approx(loaded[reaction], abs=1e-7)


@pytest.mark.parametrize("method", ["erk", "idas", "rosenbrock"])
def test_steps_of_a_redundant_mechanism_at_rest(method):
    """The error test sees no motion, but the drift of redundant rows has derivatives, which are to decay."""
    model, load, cart, *_ = cantilever(1, 1.0)
    times = np.linspace(0, 1, 5)
    found = mbd.sensitivities(model, times, [cart.y], [load], method=method)
    assert found[cart.y, load] == pytest.approx(times**2 / (2 * 7), abs=1e-9)


def test_massless_coupler_takes_the_general_form():
    """Two masses joined by a massless link: the KKT form, with multipliers as unknowns of IDAS."""
    pull = mbd.Parameter("pull", 2.0)
    cars = [mbd.Body(f"car {k}", mass=m, inertia=1.0, pose=(k, 0, 0)) for k, m in enumerate((1.0, 3.0))]
    link = mbd.Body("link", mass=0.0, inertia=0.0, pose=(0.5, 0, 0))
    joints = [mbd.Translational(f"rail {k}", mbd.ground.at(0, 0), c.at(0, 0)) for k, c in enumerate(cars)]
    hitch = mbd.Revolute("front", link.at(0.5, 0), cars[1].at(0, 0))
    train = mbd.Mechanism(
        bodies=[*cars, link],
        joints=[*joints, mbd.Revolute("rear", link.at(-0.5, 0), cars[0].at(0, 0)), hitch],
        forces=[mbd.Force("pull", cars[1].at(0, 0), (pull * mbd.t, 0))],
        parameters=[pull],
    )
    found = mbd.sensitivities(train, [0, 1, 2], [cars[0].x, hitch.reaction_on(link).force[0]], wrt=[pull])
    times = np.array([0, 1, 2])
    assert found[cars[0].x, pull] == pytest.approx(times**3 / 6 / 4, abs=1e-8)
    assert found[hitch.reaction_on(link).force[0], pull] == pytest.approx(times / 4, abs=1e-8)


def test_first_order_states_and_their_start():
    level = mbd.StateVariable("level", 2.0)
    drain = mbd.Parameter("drain", 0.7)
    cart = mbd.Body("cart", mass=1.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    tank = mbd.Mechanism(
        bodies=[cart],
        joints=[rail],
        forces=[mbd.Force("jet", cart.at(0, 0), (level, 0))],
        parameters=[drain],
        states={level: -drain * level},
    )
    times = np.linspace(0, 2, 5)
    found = mbd.sensitivities(tank, times, [level, cart.vx], wrt=[drain, level], reltol=1e-10, abstol=1e-10)
    assert found[level, level] == pytest.approx(np.exp(-0.7 * times), abs=1e-8)
    assert found[level, drain] == pytest.approx(-2 * times * np.exp(-0.7 * times), abs=1e-8)
    assert found[cart.vx, level] == pytest.approx((1 - np.exp(-0.7 * times)) / 0.7, abs=1e-8)


@pytest.mark.slow
def test_each_sample_of_an_input():
    tau = mbd.Input("tau")
    p = pendulum(forces=lambda rod: [mbd.Torque("motor", rod, tau)], inputs=[tau])
    times = np.linspace(0, 1, 6)
    samples = np.array([0, 1, 3, 2, 2, -1.0])
    found = mbd.sensitivities(
        p.mechanism, times, [p.rod.phi], wrt=[tau], inputs={tau: samples}, reltol=1e-11, abstol=1e-11
    )
    slope = found[p.rod.phi, tau]
    assert slope.shape == (6, 6)

    def run(values):
        tight = {"method": "erk", "reltol": 1e-12, "abstol": 1e-12}
        return mbd.simulate(p.mechanism, times, inputs={tau: values}, **tight)[p.rod.phi]

    for k in range(6):
        step = np.eye(6)[k] * 1e-3
        assert slope[:, k] == pytest.approx((run(samples + step) - run(samples - step)) / 2e-3, abs=1e-7)
    # nothing that comes later changes what was before
    assert np.all(np.abs(np.triu(slope, 2)) < 1e-12)


def test_start_given_as_a_state_stays_on_the_constraints():
    rod, pin, swing, (length, _, _, tau) = swinging_rod()
    state = mbd.assemble(swing, [rod.phi == -0.4, rod.omega == 2])
    found = mbd.sensitivities(swing, [0, 0.5], [rod.at(-length / 2, 0).x, pin.angle], wrt=[length, tau], initial=state)
    assert found[rod.at(-length / 2, 0).x, length] == pytest.approx(0, abs=1e-9)


# --- cost functions ------------------------------------------------------------------------
def test_gradient_of_a_cost_with_reactions_against_differences():
    """The adjoint through the algebraic outputs of IDAS would be wrong by up to one per cent here."""
    rod, pin, swing, symbols = swinging_rod()
    load = pin.reaction_on(rod).force
    cost = mbd.cost_function(
        swing,
        TIMES,
        symbols,
        running_cost=mbd.dot(load, load),
        terminal_cost=10 * load[0] + rod.omega**2,
        initial=[rod.phi == symbols[2], rod.omega == 0],
        reltol=1e-10,
        abstol=1e-10,
    )
    value, gradient = cost.value_and_gradient(cost.start)
    assert value == pytest.approx(cost(cost.start), rel=1e-12)
    fine = np.linspace(0, 1.5, 6001)

    def by_hand(x):
        run = rod_by_hand(*x, times=fine)
        square = np.sum(run["force"] ** 2, axis=1)
        omega = (run["energy"][-1] - 1.3 * x[1] * x[0] / 2 * np.sin(run["phi"][-1])) * 2 / (1.3 * x[0] ** 2 / 3)
        simpson = (fine[1] - fine[0]) / 3 * (square[0] + square[-1] + 4 * square[1::2].sum() + 2 * square[2:-1:2].sum())
        return simpson + 10 * run["force"][-1, 0] + omega

    assert value == pytest.approx(by_hand(cost.start), rel=1e-8)
    for k in range(4):
        step = np.eye(4)[k] * 1e-4
        difference = (by_hand(cost.start + step) - by_hand(cost.start - step)) / 2e-4
        assert gradient[k] == pytest.approx(difference, rel=2e-6), cost.labels[k]


@pytest.mark.parametrize(("method", "accuracy"), [("idas", 3e-5), ("rosenbrock", 1e-9)])
def test_adjoint_through_friction_that_depends_on_the_reaction(method, accuracy):
    """A block slides x = v t - mu g t² / 2; the adjoint is a polynomial, and IDAS takes it in very few steps."""
    mu = mbd.Parameter("mu", 0.3)
    block = mbd.Body("block", mass=2.0, inertia=1.0, velocity=(3.0, 0, 0))
    plane = mbd.Translational("plane", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.norm(plane.reaction_on(block).force)
    friction = mbd.Force("friction", block.at(0, 0), (-mu * push * mbd.tanh(block.vx / 1e-3), 0))
    model = mbd.Mechanism(bodies=[block], joints=[plane], forces=[mbd.Gravity(), friction], parameters=[mu])
    times = np.linspace(0, 0.8, 9)
    found = mbd.sensitivities(model, times, [block.x, block.ax], [mu], method=method)
    assert found[block.x, mu] == pytest.approx(-G * times**2 / 2, abs=1e-8)
    assert found[block.ax, mu] == pytest.approx(-G, abs=1e-8)
    cost = mbd.cost_function(model, times, [mu], terminal_cost=block.x, method=method)
    assert cost.gradient([0.3]) == pytest.approx([-G * 0.8**2 / 2], rel=accuracy)


def test_scipy_finds_the_throw_that_hits():
    speed, rise = mbd.Parameter("speed", 2.0, lower=0, upper=10), mbd.Parameter("rise", 2.0, lower=0, upper=10)
    ball = mbd.Body("ball", mass=1.0, inertia=1.0)
    thrown = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()], parameters=[speed, rise])
    miss = mbd.cost_function(
        thrown,
        [0, 0.8],
        [speed, rise],
        terminal_cost=(ball.x - 3) ** 2 + (ball.y - 1) ** 2,
        initial=[ball.vx == speed, ball.vy == rise],
    )
    best = minimize(miss.value_and_gradient, miss.start, jac=True, bounds=miss.bounds, method="L-BFGS-B", tol=1e-14)
    assert best.x == pytest.approx([3 / 0.8, (1 + G * 0.8**2 / 2) / 0.8], abs=1e-5)
    assert miss.values_of(best.x) == {speed: best.x[0], rise: best.x[1]}
    assert miss.labels == ("parameter 'speed'", "parameter 'rise'")


# --- what is refused ----------------------------------------------------------------------------
def test_bad_arguments():
    rod, _, swing, (length, gravity, _, tau) = swinging_rod()
    start = [rod.phi == -0.4]

    def tried(**change):
        given = {"outputs": [rod.phi], "wrt": [gravity], "initial": start} | change
        return mbd.sensitivities(swing, TIMES, **given)

    with pytest.raises(mbd.ModelError, match="wrt= is empty"):
        tried(wrt=[])
    with pytest.raises(mbd.ModelError, match="'k', which is not in the mechanism"):
        tried(wrt=[mbd.Parameter("k", 1.0)])
    with pytest.raises(mbd.ModelError, match=r"names parameter 'gravity' twice"):
        tried(wrt=[gravity, gravity])
    with pytest.raises(mbd.ModelError, match="not an equality of initial="):
        tried(wrt=[rod.omega == 1])
    with pytest.raises(mbd.ModelError, match="given by an expression"):
        tried(wrt=[tau], inputs={tau: mbd.t})
    with pytest.raises(mbd.ModelError, match="SampledController"):
        tried(inputs=mbd.SampledController(lambda t, s: {tau: 0.0}, 0.1))
    with pytest.raises(mbd.ExpressionError, match="which the mechanism does not have"):
        tried(outputs=[mbd.Body("other", mass=1, inertia=1).phi])
    with pytest.raises(mbd.SimulationError, match="method must be one of"):
        tried(method="euler")
    found = tried()
    with pytest.raises(mbd.ModelError, match="not among the outputs"):
        found[rod.x]
    with pytest.raises(mbd.ModelError, match="not among what was differentiated by"):
        found[rod.phi, length]
    cost = mbd.cost_function(swing, TIMES, [length], terminal_cost=rod.phi, initial=start)
    with pytest.raises(mbd.ModelError, match="must be 1 finite numbers"):
        cost([1.0, 2.0])


def test_a_relation_with_a_bare_parameter_keeps_its_sides():
    angle = mbd.Parameter("angle", -0.4)
    p = pendulum(-0.4, parameters=[angle])
    rod, model = p.rod, p.mechanism
    released = [rod.phi == angle, rod.omega == 0]
    found = mbd.sensitivities(model, TIMES, [rod.phi], [angle, released[0]], released)
    assert np.allclose(found[rod.phi, released[0]], found[rod.phi, angle], atol=1e-9)
    with pytest.raises(mbd.ConditionError, match="rod.phi == angle"):
        mbd.assemble(model, [rod.phi == angle, rod.phi == 3])


@pytest.mark.parametrize("tolerance", [1e-8, 1e-11])
def test_gradients_by_samples_are_those_of_the_motion_by_idas_too(tolerance):
    stiffness, push = mbd.Parameter("stiffness", 10.3), mbd.Input("push")
    block = mbd.Body("block", mass=1, inertia=0.1)
    slide = mbd.Translational("slide", mbd.ground.at(0, 0), block.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-1, 0), block.at(0, 0), stiffness=stiffness, free_length=1, damping=0.1)
    forces = [spring, mbd.Force("push", block.at(0, 0), (push, 0))]
    model = mbd.Mechanism([block], [slide], forces=forces, inputs=[push], parameters=[stiffness])
    times = np.linspace(0, 1, 7)
    cost = {"running_cost": 1e-3 * (push**2 + spring.force**2), "terminal_cost": (block.x - 1) ** 2 + block.vx**2}
    gradients = []
    for method in ("idas", "erk"):  # IDAS was off by a third, or ended the process
        given = {"inputs": {push: np.full(7, 0.4)}, "method": method, "reltol": tolerance, "abstol": tolerance}
        J = mbd.cost_function(model, times, [push, stiffness], initial=[block.x == 0], **cost, **given)
        gradients.append(J.gradient(J.start))
    assert np.allclose(*gradients, rtol=0, atol=1e-5 * np.max(np.abs(gradients)))
    with pytest.raises(mbd.ModelError, match="x must be 8 finite numbers"):
        J("a")


@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_gradients_by_samples_of_a_cost_of_the_input_alone_are_exact(method):
    push = mbd.Input("push")
    block = mbd.Body("block", mass=1, inertia=0.1)
    slide = mbd.Translational("slide", mbd.ground.at(0, 0), block.at(0, 0))
    model = mbd.Mechanism([block], [slide], forces=[mbd.Force("push", block.at(0, 0), (push, 0))], inputs=[push])
    times = np.linspace(0, 1, 4)
    given = {"running_cost": push**2, "inputs": {push: [0.0, 1.0, 2.0, 1.0]}, "reltol": 1e-11, "abstol": 1e-11}
    # the integral of squares of a polygon: h/3 (a^2 + ab + b^2) over each interval
    exact = np.array([1.0, 6.0, 10.0, 4.0]) / 9
    J = mbd.cost_function(model, times, [push], method=method, **given)
    assert np.allclose(J.gradient(J.start), exact, rtol=0, atol=1e-8)


def pushed_puck(course):
    """A mass of 1 kg under ``k course(t)``, and its velocity: ``k`` times the integral of the course."""
    k = mbd.Parameter("k", 1.0)
    puck = mbd.Body("puck", mass=1, inertia=1)
    forces = [mbd.Force("push", puck.at(0, 0), (k * course, 0))]
    return mbd.Mechanism([puck], forces=forces, parameters=[k]), k, puck.vx


@pytest.mark.parametrize("outputs", [2, 11, 1001])
def test_gradient_of_a_pulse_in_the_middle_of_the_time(outputs):
    """Stops inside one adjoint integration ended the process."""
    course = 10 * (mbd.step(mbd.t, 5, 0, 5.5, 1) - mbd.step(mbd.t, 6.5, 0, 7, 1))
    model, k, speed = pushed_puck(course)
    J = mbd.cost_function(model, np.linspace(0, 10, outputs), [k], terminal_cost=speed, method="idas")
    value, gradient = J.value_and_gradient(J.start)
    assert value == pytest.approx(15, abs=1e-6)
    assert gradient == pytest.approx([15], abs=1e-6)


@pytest.mark.parametrize(
    "course, exact",
    [
        (mbd.t, 50.0),  # the adjoint is constant: its order stayed at 1, and the gradient was off by 1e-5
        (mbd.exp(-(((mbd.t - 5.123) / 0.01) ** 2)), 0.01 * np.sqrt(np.pi)),
        (mbd.exp(-(((mbd.t - 5.123) / 2) ** 2)), 3.5433916477),
    ],
)
def test_gradient_of_the_integral_of_a_force_is_the_integral(course, exact):
    model, k, speed = pushed_puck(course)
    J = mbd.cost_function(model, np.linspace(0, 10, 11), [k], terminal_cost=speed, method="idas")
    assert J.gradient(J.start) == pytest.approx([exact], rel=1e-7)


def test_gradient_over_a_road_of_many_knots():
    stiffness = mbd.Parameter("stiffness", 20000.0)
    car = mbd.Body("car", mass=300, inertia=1, pose=(0, 0.5, 0))
    wheel = mbd.Body("wheel", mass=1, inertia=1)
    up = {"angle": np.pi / 2}
    guides = [mbd.Translational(f"{b.name} guide", mbd.ground.at(0, 0, **up), b.at(0, 0, **up)) for b in (car, wheel)]
    road = mbd.spline(mbd.t, [0, 1, 1.4, 1.5, 1.6, 1.7, 1.8, 2.5, 4], [0, 0, 0, 0.02, 0.05, 0.02, 0, 0, 0])
    spring = mbd.TSDA("spring", wheel.at(0, 0), car.at(0, 0), stiffness=stiffness, free_length=0.6, damping=1500)
    drivers, forces = [mbd.Driver("road", wheel.y, road)], [mbd.Gravity(), spring]
    model = mbd.Mechanism([car, wheel], guides, drivers, forces=forces, parameters=[stiffness])
    gradients = []
    for method in ("idas", "erk"):
        given = {"running_cost": (car.y - 0.5) ** 2, "terminal_cost": car.y, "method": method}
        J = mbd.cost_function(model, np.linspace(0, 4, 41), [stiffness], **given)
        gradients.append(J.gradient(J.start))
    assert gradients[0] == pytest.approx(gradients[1], rel=1e-6)


@pytest.mark.slow
def test_an_adjoint_through_a_pose_in_which_the_linkage_could_fold_names_it():
    """A parallelogram through its flat pose: the adjoint of IDAS ended after 82 s with the path of a file."""
    torque = mbd.Parameter("torque", 0.7)
    left, right = (mbd.Body(name, mass=1, inertia=1 / 12, pose=(x, 0.5, np.pi / 2)) for name, x in (("l", 0), ("r", 1)))
    bar = mbd.Body("bar", mass=1, inertia=1 / 12, pose=(0.5, 1, 0))
    pins = [
        mbd.Revolute("a", mbd.ground.at(0, 0), left.at(-0.5, 0)),
        mbd.Revolute("b", mbd.ground.at(1, 0), right.at(-0.5, 0)),
        mbd.Revolute("c", left.at(0.5, 0), bar.at(-0.5, 0)),
        mbd.Revolute("d", bar.at(0.5, 0), right.at(0.5, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Torque("torque", left, torque * mbd.cos(1.3 * mbd.t))]
    model = mbd.Mechanism([left, right, bar], pins, forces=forces, parameters=[torque])
    given = {"terminal_cost": left.phi, "initial": [left.phi == -1, left.omega == 7]}
    times = np.linspace(0, 0.6, 25)
    J = mbd.cost_function(model, times, [torque], **given)
    with pytest.raises(mbd.SimulationError) as caught:
        J.gradient(J.start)
    assert re.search(r"near t = 0\.1\d+ s in which .*could fold.*method=\"erk\"", str(caught.value))
    assert ".cpp" not in str(caught.value)
    J = mbd.cost_function(model, times, [torque], method="erk", **given)
    step = 1e-4
    slope = (J([0.7 + step]) - J([0.7 - step])) / (2 * step)
    assert J.gradient(J.start) == pytest.approx([slope], rel=1e-5)
    J = mbd.cost_function(model, times, [torque], method="dop853", **given)
    with pytest.raises(mbd.SimulationError, match=r"could fold.*method=\"erk\""):
        J.gradient(J.start)
    setup = FitSetup(model, "identify", times, initial=given["initial"], method="auto")
    assert len(setup.motion([0]).poses) == times.size and setup.integrator.name == "erk"


def test_of_friction_by_the_load_of_a_joint():
    """A sliding block: ``x = v t - μ g t²/2``, so ``∂x/∂μ = -g t²/2``."""
    mu = mbd.Parameter("mu", 0.3)
    block = mbd.Body("block", mass=1, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(mu, 1e-2))
    mechanism = mbd.Mechanism([block], [guide], forces=[mbd.Gravity(), rub], parameters=[mu])
    times = np.linspace(0, 0.3, 4)
    found = mbd.sensitivities(mechanism, times, outputs=[block.x], wrt=[mu], initial=[block.x == 0, block.vx == 2])
    np.testing.assert_allclose(found[block.x, mu], -9.81 * times**2 / 2, rtol=1e-6, atol=1e-9)


def small_oscillator(origin=0.0):
    """A mass on a spring at a place: ``x = origin + A cos(10 t)``."""
    stiffness = mbd.Parameter("stiffness", 100.0)
    mass = mbd.Body("mass", mass=1, inertia=1, pose=(origin, 0, 0))
    slide = mbd.Translational("slide", mbd.ground.at(0, 0), mass.at(0, 0))
    pull = mbd.Force("pull", mass.at(0, 0), (-stiffness * (mass.x - origin), 0))
    return mbd.Mechanism([mass], [slide], forces=[pull], parameters=[stiffness]), mass, stiffness


@pytest.mark.slow
@pytest.mark.parametrize("amplitude, error", [(1e-6, 1e-5), (1e-9, 1e-3)])
@pytest.mark.parametrize("method", ["idas", "erk", "dop853"])
def test_motions_of_small_range_are_resolved_by_every_analysis(amplitude, error, method):
    """The default tolerance does not resolve them: results were off by up to 92 times the amplitude."""
    model, mass, stiffness = small_oscillator()
    times, start = np.linspace(0, 10, 101), [mass.x == amplitude, mass.vx == 0]
    exact = np.cos(10 * times)
    slope = -np.sin(10 * times) * times * 0.05
    found = mbd.sensitivities(model, times, {"x": mass.x}, [stiffness], start, method=method)
    np.testing.assert_allclose(found["x"] / amplitude, exact, atol=error)
    np.testing.assert_allclose(found["x", stiffness] / amplitude, slope, atol=error)
    J = mbd.cost_function(model, times, [stiffness], terminal_cost=mass.x, initial=start, method=method)
    value, gradient = J.value_and_gradient(J.start)
    assert [value / amplitude, gradient[0] / amplitude] == pytest.approx([exact[-1], slope[-1]], abs=error)
    swept = mbd.sweep(model, times, {stiffness: [100.0, 100.0]}, {"x": mass.x}, start, method=method)
    np.testing.assert_allclose(swept["x"] / amplitude, [exact, exact], atol=error)
    data = {mass.x: amplitude * exact}
    fit = mbd.identify(model, times, data, [stiffness], start, parameters={stiffness: 99.0}, method=method)
    assert fit[stiffness] == pytest.approx(100, rel=error)


def test_a_tolerance_of_the_user_that_does_not_resolve_the_motion_is_reported():
    model, mass, stiffness = small_oscillator()
    times, start = np.linspace(0, 1, 11), [mass.x == 1e-6, mass.vx == 0]
    with pytest.warns(mbd.MechanismWarning, match="sensitivities: the motion stays within 2e-06.*lower it"):
        mbd.sensitivities(model, times, [mass.x], [stiffness], start, abstol=1e-8)
    with pytest.warns(mbd.MechanismWarning, match="cost_function: the motion stays within 2e-06.*lower it"):
        mbd.cost_function(model, times, [stiffness], terminal_cost=mass.x, initial=start, method=mbd.IDAS())


def test_a_motion_near_the_rounding_of_its_coordinates_is_reported():
    model, mass, stiffness = small_oscillator(1000.0)
    times, start = np.linspace(0, 1, 11), [mass.x == 1000 + 1e-9, mass.vx == 0]
    said = "at coordinates of up to 1e\\+03, near their rounding"
    assert any(re.search(said, note) for note in mbd.simulate(model, times, initial=start).statistics.notes)
    with pytest.warns(mbd.MechanismWarning, match=said):
        mbd.sensitivities(model, times, [mass.x], [stiffness], start)
    rest = mbd.simulate(model, times, initial=[mass.x == 1000, mass.vx == 0])
    assert not any("rounding" in note for note in rest.statistics.notes)


def test_parameters_that_are_listed_without_values():
    g = mbd.Parameter("g", 9.81)
    stone = mbd.Body("stone", mass=1, inertia=1)
    fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    found = mbd.sensitivities(fall, [0, 1, 2], outputs=[stone.y], parameters=[g])
    assert found[stone.y, g] == pytest.approx([0, -0.5, -2], abs=1e-6)
    for parameters in (None, {g: 9.0}, [(g, 9.0)], []):
        with pytest.raises(mbd.ModelError, match="wrt= is missing"):
            mbd.sensitivities(fall, [0, 1, 2], outputs=[stone.y], parameters=parameters)


def test_a_force_without_a_finite_derivative_on_the_way_is_named_as_a_cause():
    """``simulate``, to which the message refers, reaches the end."""
    start = mbd.Parameter("start", 0.3)
    block = mbd.Body("block", mass=1, inertia=1)
    pull = mbd.Force("pull", block.at(0, 0), [mbd.sqrt(mbd.fmax(mbd.t - start, 0)), 0])
    model = mbd.Mechanism([block], forces=[pull], parameters=[start])
    assert mbd.simulate(model, [0, 1.0])[block.vx][-1] == pytest.approx(0.7**1.5 / 1.5, abs=1e-6)
    with pytest.raises(mbd.SimulationError, match="has no finite derivative on the way, as a root"):
        mbd.sensitivities(model, [0, 1.0], outputs=[block.vx], wrt=[start])
