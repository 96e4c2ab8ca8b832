"""Estimators against the Kalman filter, motions that are known, and bad input."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

import mbdcasadi as mbd


def cart_on_rail():
    """A cart of 2 kg on a rail with a spring, pushed by a force."""
    force = mbd.Input("force")
    cart = mbd.Body("cart", mass=2.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    spring = mbd.TSDA("spring", mbd.ground.at(-1, 0), cart.at(0, 0), stiffness=8.0, damping=0.5, free_length=1.0)
    push = mbd.Force("push", cart.at(0, 0), (force, 0))
    return mbd.Mechanism([cart], [rail], forces=[spring, push], inputs=[force]), cart, force


def pendulum():
    """A point mass on a rod of an unknown length, with damping, driven by a torque."""
    torque, mass = mbd.Input("torque"), mbd.Parameter("mass", 1.0)
    rod = mbd.Body("rod", mass=mass, inertia=0.0, pose=(0, -0.5, -np.pi / 2))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), rod.at(-0.5, 0))
    forces = [mbd.Gravity(), mbd.Torque("drive", rod, torque)]
    return mbd.Mechanism([rod], [pin], forces=forces, inputs=[torque], parameters=[mass]), rod, torque, mass


def cart_estimator(horizon, **options):
    """An estimator of the cart from its position, and the cart."""
    model, cart, force = cart_on_rail()
    given = {"measured": [cart.x], "noise": [0.02], "disturbance": {force: 0.5}, "sample": 0.1} | options
    return mbd.Estimator(model, horizon=horizon, **given), model, cart, force


@pytest.mark.parametrize("horizon", [3, 40])
def test_linear_estimator_is_the_kalman_filter(horizon):
    """States and covariances are those of the filter, with short horizons as well, and if measurements are missing."""
    estimator, model, cart, force = cart_estimator(horizon)
    full = expm(0.1 * np.array([[0, 1, 0], [-4.0, -0.25, 0.5], [0, 0, 0]]))
    a, b = full[:2, :2], full[:2, 2]
    x, p = np.array([0.1, 0.0]), np.array([[1.0, 0.2], [0.2, 0.5]])
    estimator.reset(mbd.assemble(model, [cart.x == 0.1, cart.vx == 0]), p)
    assert estimator.covariance == pytest.approx(p, abs=1e-12)
    for k in range(12):
        u, y = np.sin(k), 0.3 * np.cos(0.2 * k) + 0.02 * (-1) ** k
        x, p = a @ x + b * u, a @ p @ a.T + 0.25 * np.outer(b, b)
        if k == 5:
            y = np.nan
        else:
            gain = p[:, 0] / (p[0, 0] + 0.02**2)
            x, p = x + gain * (y - x[0]), p - np.outer(gain, p[0])
        state = estimator.update([y], {force: u})
        assert [state[cart.x], state[cart.vx]] == pytest.approx(x, abs=1e-7)
        assert estimator.covariance == pytest.approx(p, rel=1e-5)
    assert state.t == pytest.approx(1.2)
    assert state[2 * cart.ax + 8 * cart.x + 0.5 * cart.vx] == pytest.approx(state[force])


def test_acceleration_is_measured():
    """A measurement on which the disturbance acts at once: the filter with noises that are correlated."""
    model, cart, force = cart_on_rail()
    estimator = mbd.Estimator(model, [cart.ax], [0.05], {force: 0.5}, sample=0.1, horizon=3)
    full = expm(0.1 * np.array([[0, 1, 0], [-4.0, -0.25, 0.5], [0, 0, 0]]))
    a, b, h, d = full[:2, :2], full[:2, 2], np.array([-4.0, -0.25]), 0.5
    x, p = np.array([0.1, 0.0]), np.diag([0.01, 0.04])
    estimator.reset(mbd.assemble(model, [cart.x == 0.1, cart.vx == 0]), p)
    for k in range(8):
        u, y = np.cos(k), -0.3 * np.cos(0.2 * k)
        x, p = a @ x + b * u, a @ p @ a.T + 0.25 * np.outer(b, b)
        both = p @ h + 0.25 * b * d
        gain = both / (h @ p @ h + 2 * 0.25 * (h @ b) * d + 0.25 * d**2 + 0.05**2)
        x, p = x + gain * (y - h @ x - d * u), p - np.outer(gain, both)
        state = estimator.update([y], {force: u})
        assert [state[cart.x], state[cart.vx]] == pytest.approx(x, abs=1e-7)


@pytest.mark.slow
def test_mass_of_a_pendulum_is_found():
    """From noisy angles of large swings under a known torque: angle, rate and mass, within their deviations."""
    model, rod, torque, mass = pendulum()
    estimator = mbd.Estimator(model, [rod.phi], [0.01], {torque: 0.02}, sample=0.05, horizon=20, unknown=[mass])
    assert estimator.state_names == ("rod.phi", "rod.omega", "mass")
    estimator.reset(mbd.assemble(model, [rod.phi == -1.2, rod.omega == 0]), np.diag([0.5, 0.5, 0.3]) ** 2)
    true, noise, x = 1.3, np.random.default_rng(3), np.array([-0.9, 0.0])
    for k in range(100):
        drive = 3.0 * np.sin(0.15 * k)

        def rates(_, x, drive=drive):
            return [x[1], (drive - true * 9.80665 * 0.5 * np.cos(x[0])) / (true * 0.25)]

        x = solve_ivp(rates, (0, 0.05), x, rtol=1e-10, atol=1e-10).y[:, -1]
        state = estimator.update([x[0] + noise.normal(0, 0.01)], {torque: drive})
    deviation = np.sqrt(np.diag(estimator.covariance))
    miss = np.array([state[rod.phi] - x[0], state[rod.omega] - x[1], state[mass] - true])
    assert np.all(np.abs(miss) < 3 * deviation)
    assert deviation[2] < 0.05 and abs(miss[2]) < 0.05


@pytest.mark.slow
def test_closed_loop_is_followed():
    """A four-bar whose crank is measured: from a wrong rate to that of the motion, with the loop closed."""
    bar = mbd.library.four_bar(crank=0.2, coupler=0.5, rocker=0.4, base=0.55)
    model, crank = bar.mechanism, bar.crank
    start = mbd.assemble(model, [crank.phi == 1.0, crank.omega == 8.0])
    motion = mbd.simulate(model, np.linspace(0, 1, 51), initial=start)
    estimator = mbd.Estimator(model, [crank.phi], [1e-3], sample=0.02, horizon=10, state=[crank.phi])
    estimator.reset(mbd.assemble(model, [crank.phi == 1.1, crank.omega == 6.0]), np.diag([0.2, 3.0]) ** 2)
    for angle in motion[crank.phi][1:]:
        state = estimator.update([angle], dict.fromkeys(model.inputs, 0.0))
    assert state[crank.omega] == pytest.approx(motion[crank.omega][-1], abs=1e-3)
    assert np.max(np.abs(state[state.equations.Phi])) < 1e-9


def test_state_that_is_known_stays_known():
    """Without a covariance and disturbances the estimate is the motion, whatever is measured."""
    estimator, model, cart, force = cart_estimator(3, disturbance=None)
    estimator.reset(mbd.assemble(model, [cart.x == 0.1, cart.vx == 0]), np.zeros((2, 2)))
    for _ in range(5):
        state = estimator.update([5.0], {force: 0})
    free = expm(0.5 * np.array([[0, 1], [-4.0, -0.25]])) @ [0.1, 0]
    assert [state[cart.x], state[cart.vx]] == pytest.approx(free, abs=1e-7)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"noise": [0.0]}, "noise must be positive"),
        ({"noise": [0.1, 0.1]}, "got 2 for 1"),
        ({"horizon": 0}, "horizon must be a whole number"),
        ({"sample": -1}, "sample must be positive"),
        ({"unknown": [mbd.Parameter("length", 1.0)]}, "unknown= holds 'length', which is not in the mechanism"),
        ({"disturbance": {mbd.Input("wind"): 1.0}}, "disturbance= holds 'wind', which is not in the mechanism"),
        ({"measured": [mbd.Input("other")]}, "contains input 'other'"),
        ({"measured": [mbd.Input("other") == 0]}, "what is measured is the relation"),
    ],
)
def test_bad_statement_is_refused(options, message):
    """Each error names what is wrong."""
    with pytest.raises(mbd.MechanismError, match=message):
        cart_estimator(**{"horizon": 5} | options)


def test_bad_sample_is_refused():
    """Updates before a reset, and numbers that do not fit; the estimator stays as it was."""
    estimator, model, cart, force = cart_estimator(5)
    with pytest.raises(mbd.ModelError, match="call reset"):
        estimator.update([0.1], {force: 0})
    start = mbd.assemble(model, [cart.x == 0.1, cart.vx == 0])
    with pytest.raises(mbd.ModelError, match="must be 2 x 2 finite numbers"):
        estimator.reset(start, np.eye(3))
    with pytest.raises(mbd.ModelError, match="without negative eigenvalues"):
        estimator.reset(start, [[1, 0], [0, -1]])
    with pytest.raises(mbd.ModelError, match="takes a State"):
        estimator.reset([0.1, 0], np.eye(2))
    estimator.reset(start, np.eye(2))
    for measured in ([0.1, 0.2], [np.inf], ["a"]):
        with pytest.raises(mbd.ModelError, match="takes 1 measured values"):
            estimator.update(measured, {force: 0})
    with pytest.raises(mbd.ModelError, match="no value of 'force'"):
        estimator.update([0.1])
    with pytest.raises(mbd.ModelError, match="must be finite"):
        estimator.update([0.1], {force: np.nan})
    with pytest.raises(mbd.SimulationError, match="no finite value"):
        estimator.update([0.1], {force: 1e308})
    first = estimator.update([0.1], {force: 0})
    assert first.t == pytest.approx(0.1)


def test_exact_friction_is_refused():
    """What switches has no slopes."""
    model, cart, _ = cart_on_rail()
    rubbing = model.replace(forces=[mbd.JointFriction("rub", model.joints[0], mbd.DryFriction(0.3))])
    with pytest.raises(mbd.ModelError, match="'rub' switches"):
        mbd.Estimator(rubbing, [cart.x], [0.1], sample=0.1, horizon=5)


@pytest.mark.slow
def test_long_samples_take_many_steps_or_are_refused():
    """A pendulum over twenty swings; more steps than an update can take are an error at once."""
    model, rod, torque, _ = pendulum()
    options = {"measured": [rod.phi], "noise": [0.01], "disturbance": {torque: 0.1}, "horizon": 3}
    estimator = mbd.Estimator(model, sample=30.0, **options)
    start = mbd.assemble(model, [rod.phi == -np.pi / 2 + 0.5, rod.omega == 0])
    estimator.reset(start, np.eye(2) * 1e-16)
    state = estimator.update([np.nan], {torque: 0})
    run = mbd.simulate(model, [0, 30], initial=start, reltol=1e-11, abstol=1e-11)
    assert [state[rod.phi], state[rod.omega]] == pytest.approx([run[rod.phi][-1], run[rod.omega][-1]], abs=1e-3)
    with pytest.raises(
        mbd.ModelError, match="a sample of 50000 s takes .* steps of integration.*give a shorter sample"
    ):
        mbd.Estimator(model, sample=5e4, **options)


def test_controller_is_fed_by_estimates():
    """A cart-pole whose rates nobody measures is kept up, from a wrong start; runs with one seed are the same."""
    force = mbd.Input("force", lower=-10, upper=10)
    cart = mbd.Body("cart", mass=1.0, inertia=0.0)
    bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, 0.5, np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
    drive = mbd.Force("drive", cart.at(0, 0), (force, 0))
    model = mbd.Mechanism([cart, bob], [rail, pole], forces=[mbd.Gravity(), drive], inputs=[force])
    lean = bob.phi - np.pi / 2
    away = 5 * cart.x**2 + cart.vx**2 + 10 * lean**2 + bob.omega**2
    plan = mbd.OptimalControlProblem(
        model, duration=1.0, running_cost=away + 0.01 * force**2, terminal_cost=5 * mbd.at_end(away)
    )
    controller = mbd.Controller(plan, sample=0.05, intervals=20)
    estimator = mbd.Estimator(model, [cart.x, lean], [1e-3, 2e-3], {force: 0.05}, sample=0.05, horizon=10)
    start = mbd.assemble(model, [cart.x == 0, cart.vx == 0, lean == 0.2, bob.omega == 0])
    guess = mbd.assemble(model, [cart.x == 0.05, cart.vx == 0, lean == 0.1, bob.omega == 0])
    fed = controller.fed_by(estimator, np.diag([0.1, 0.2, 0.1, 0.1]) ** 2, initial=guess, seed=4)
    times = np.linspace(0, 3, 61)
    runs = [mbd.simulate(model, times, initial=start, inputs=fed) for _ in range(2)]
    assert np.array_equal(runs[0][force], runs[1][force])
    assert abs(runs[0][lean][-1]) < 0.01 and abs(runs[0][cart.x][-1]) < 0.02
    assert [state.t for state in fed.estimates][:60] == pytest.approx(times[:60])
    rates = np.array([state[bob.omega] for state in fed.estimates])
    assert np.max(np.abs(rates[20:60] - runs[0][bob.omega][20:60])) < 0.05
    exact = mbd.simulate(model, times, initial=start, inputs=controller.fed_by(estimator, np.zeros((4, 4))))
    direct = mbd.simulate(model, times, initial=start, inputs=controller)
    assert exact[force] == pytest.approx(direct[force], abs=1e-4)
    other = mbd.Estimator(model, [cart.x], [1e-3], sample=0.02, horizon=10)
    with pytest.raises(mbd.ModelError, match=r"samples every 0\.02 s, the controller every 0\.05 s"):
        controller.fed_by(other, np.eye(4))
    with pytest.raises(mbd.ModelError, match="takes an Estimator"):
        controller.fed_by(controller, np.eye(4))
    with pytest.raises(mbd.ModelError, match="seed must be a whole number of at least 0, got 1.5"):
        controller.fed_by(estimator, np.eye(4), seed=1.5)
    with pytest.raises(mbd.ModelError, match=r"not written as C; controller.export\('folder'\) writes the controller"):
        fed.export("folder")
    with pytest.raises(mbd.ModelError, match="status must be a whole number from 0 to 4, got 7"):
        fed.meaning(7)


@pytest.mark.slow
def test_unknown_parameters_are_those_of_the_plans():
    """The first input of a fed controller is that under the mean of an unknown mass, and not under its own value."""
    model, rod, torque, mass = pendulum()
    cost = (rod.phi + np.pi / 2) ** 2 + 0.1 * rod.omega**2 + 0.01 * torque**2
    controller = mbd.Controller(
        mbd.OptimalControlProblem(model, duration=0.5, running_cost=cost), sample=0.1, intervals=5
    )
    estimator = mbd.Estimator(model, [rod.phi], [0.01], {torque: 0.1}, sample=0.1, horizon=5, unknown=[mass])
    start = [rod.phi == -1.0, rod.omega == 0]
    heavy = mbd.assemble(model, start, parameters={mass: 2.0})
    fed = controller.fed_by(estimator, np.diag([0.1, 0.1, 0.1]) ** 2, initial=heavy)
    run = mbd.simulate(model, [0, 0.05], initial=start, inputs=fed)
    values = [controller.with_parameters({mass: m}).inputs(heavy)[torque] for m in (1.0, 2.0)]
    assert run[torque][0] == pytest.approx(values[1], abs=1e-9)
    assert abs(values[1] - values[0]) > 0.1
