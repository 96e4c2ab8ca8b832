"""Linear feedback along an optimum against exact solutions of the Riccati equation, and perturbed motions."""

import numpy as np
import pytest
from scipy.linalg import expm

import mbdcasadi as mbd
from mbdcasadi.optimal_control.motion import feedback as module


@pytest.fixture(scope="module")
def cart():
    """A mass of 2 kg on a rail that is brought to rest, with its symbols."""
    force = mbd.Input("force")
    body = mbd.Body("cart", mass=2.0, inertia=1.0)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), body.at(0, 0))
    push = mbd.Force("push", body.at(0, 0), (force, 0))
    model = mbd.Mechanism([body], [rail], forces=[push], inputs=[force])
    problem = mbd.OptimalControlProblem(
        model,
        duration=2.0,
        initial=[body.x == 1, body.vx == 0],
        running_cost=10 * body.x**2 + body.vx**2 + body.x * force / 2 + 0.1 * force**2,
        terminal_cost=mbd.at_end(3 * body.x**2 + body.vx**2),
    )
    return mbd.optimize(problem, intervals=8), model, body, force


TIMES = np.linspace(0, 2, 41)


def test_gains_of_a_double_integrator_are_those_of_the_hamiltonian(cart):
    """K(t) by the exponential of the Hamiltonian matrix, with a mixed term in the cost."""
    solution, _, _, force = cart
    a, b = np.array([[0, 1], [0, 0.0]]), np.array([[0], [0.5]])
    q, n, r = np.diag([20.0, 2.0]), np.array([[0.5], [0]]), 0.2
    reduced = a - b @ n.T / r
    hamiltonian = np.block([[reduced, -b @ b.T / r], [-(q - n @ n.T / r), -reduced.T]])
    exact = []
    for t in TIMES:
        z = expm((t - 2) * hamiltonian) @ np.vstack([np.eye(2), np.diag([6, 2])])
        exact.append((b.T @ z[2:] @ np.linalg.inv(z[:2]) + n.T) / r)
    feedback = solution.feedback()
    assert feedback.state_names == ("cart.x", "cart.vx") and feedback.input_names == ("force",)
    np.testing.assert_allclose(feedback.gains(TIMES), exact, atol=1e-6 * np.max(exact))
    np.testing.assert_allclose(feedback.gains(2.0), exact[-1], atol=1e-6 * np.max(exact))
    course = feedback.inputs[force]  # on the optimum it is the input of the optimum
    on_it = np.sum(course(TIMES) * np.c_[np.ones(41), solution.trajectory.at(TIMES)[course.factors[1:]]], axis=1)
    np.testing.assert_allclose(on_it, solution.inputs[force](TIMES), atol=1e-5)


def test_a_heavy_weight_at_the_end_has_its_exact_layer(cart, monkeypatch):
    """Of the speed alone, dS/dt = S² b²/r: with S = 2 w at the end, K = S b/r is a hyperbola, 0.01 s wide."""
    solution, _, body, force = cart
    s, b, r = 2 * 40.0, 0.5, 2 * 0.1
    times = 2 - np.r_[0, np.geomspace(1e-3, 2, 30)]
    exact = s * b / r / (1 + s * b**2 / r * (2 - times))
    gains = solution.feedback({force: 0.1}, {body.vx: 40.0}).gains(times)[:, 0]
    np.testing.assert_allclose(gains[:, 0], 0, atol=1e-12)
    np.testing.assert_allclose(gains[:, 1], exact, rtol=3e-5)
    monkeypatch.setattr(module, "TURN", 10 * module.TURN)
    coarse = solution.feedback({force: 0.1}, {body.vx: 40.0}).gains(times)[:, 0]
    assert np.max(np.abs(coarse[:, 1] / exact - 1)) > 1e-3


def test_the_law_of_the_end_goes_on_after_it(cart):
    """Beyond the end the gains are constant, and the motion is that of their closed loop."""
    solution, model, body, force = cart
    feedback = solution.feedback({body.x: 8.0, force: 0.1}, {body.x: 10.0, body.vx: 5.0})
    motion = mbd.simulate(model, np.linspace(0, 6, 121), initial=[body.x == 1.2, body.vx == 0.5], inputs=feedback)
    x, v = (solution.trajectory[e][-1] for e in (body.x, body.vx))
    (gain,), goal = feedback.gains(5.0), solution.inputs[force](2.0)
    wanted = goal - gain[0] * (motion[body.x] - x) - gain[1] * (motion[body.vx] - v)
    np.testing.assert_allclose(motion[force][41:], wanted[41:], atol=1e-5)
    np.testing.assert_allclose(feedback.gains(2.0)[0], [0, 0.5 * 10 / 0.2], rtol=3e-5, atol=1e-4)


def test_what_has_no_feedback_is_refused(cart):
    solution, _, body, force = cart
    with pytest.raises(mbd.ModelError, match="square of the input 'force'; give weights="):
        solution.feedback({body.x: 1.0})
    with pytest.raises(mbd.ModelError, match="weights= takes scalars with weights that are not negative"):
        solution.feedback({body.x: -1.0, force: 1.0})
    with pytest.raises(mbd.ModelError, match=r"state= holds 2 expressions"):
        solution.feedback(state=[body.x, body.y])
    stranger = mbd.Body("stranger", mass=1.0, inertia=1.0)
    for weights, final, message in (
        ({stranger.x: 1.0, force: 1.0}, None, "stranger"),
        ({force: 1.0}, {stranger.x: 1.0}, "stranger"),
        ({force: 1.0}, {force: 1.0}, "it contains input 'force', which is not known there"),
        ([(body.x == 0, 1.0), (force, 1.0)], None, "is the relation"),
    ):
        with pytest.raises(mbd.MechanismError, match=message):
            solution.feedback(weights, final)
    with pytest.raises(mbd.ModelError, match="takes a time or a list of times in s, got 'now'"):
        solution.feedback({force: 1.0}).gains("now")


@pytest.mark.slow
def test_a_pole_that_is_pushed_swings_up():
    """From another start the inputs alone lose the pole; with the feedback it stands up where it should."""
    force = mbd.Input("force")
    cart, bob = mbd.Body("cart", 1.0, 0.0), mbd.Body("bob", 0.3, 0.0, pose=(0, -0.5, -np.pi / 2))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
    pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
    drive = mbd.Force("drive", cart.at(0, 0), (force, 0))
    model = mbd.Mechanism([cart, bob], [rail, pole], forces=[mbd.Gravity(), drive], inputs=[force])
    down = [cart.x == 0, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0]
    up = [cart.x == 0.5, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0]
    problem = mbd.OptimalControlProblem(
        model, duration=2.0, initial=down, final=up, running_cost=force**2, path=[mbd.soft(cart.x <= 0.6, weight=10.0)]
    )
    solution = mbd.optimize(problem)
    weights = {cart.x: 10, bob.phi: 10, force: 0.1}
    feedback = solution.feedback(weights, {cart.x: 50, bob.phi: 50, bob.omega: 5})
    start = [cart.x == 0.05, cart.vx == 0.1, bob.phi == 0.1 - np.pi / 2, bob.omega == 0.2]
    inputs = {"with": feedback, "without": {force: solution.inputs[force]}}
    ends = {name: mbd.simulate(model, [0, 2], initial=start, inputs=u).final for name, u in inputs.items()}
    assert abs(ends["without"][bob.phi] - np.pi / 2) > 1
    assert ends["with"][bob.phi] == pytest.approx(np.pi / 2, abs=2e-3)
    assert ends["with"][cart.x] == pytest.approx(0.5, abs=2e-3) and abs(ends["with"][bob.omega]) < 2e-3
    # of a closed loop, against the linear model of the last state
    lin = mbd.linearize(model, solution.trajectory.final, wrt=[force])
    assert lin.state_names == feedback.state_names
    np.testing.assert_allclose(feedback.gains(2.0), lin.B.T @ np.diag([100, 100, 0, 10]) / 0.2, atol=5e-3)


@pytest.mark.slow
def test_loops_are_closed_inside():
    """A five-bar that starts off comes to the end of the optimum."""
    robot = mbd.library.five_bar()
    inputs, tip, start = robot.mechanism.inputs, robot.tip, mbd.assemble(robot.mechanism)
    away = (tip.x - float(start[tip.x]) - 0.03) ** 2 + (tip.y - float(start[tip.y]) + 0.02) ** 2
    angles = [robot.coordinates[side] for side in ("left", "right")]
    rates = [mbd.time_derivative(angle) for angle in angles]
    begin = [*(angle == float(start[angle]) for angle in angles), *(rate == 0 for rate in rates)]
    problem = mbd.OptimalControlProblem(
        robot.mechanism,
        duration=0.3,
        initial=begin,
        running_cost=100 * away + 1e-3 * (inputs[0] ** 2 + inputs[1] ** 2),
        terminal_cost=mbd.at_end(500 * away + 0.05 * (rates[0] ** 2 + rates[1] ** 2)),
    )
    solution = mbd.optimize(problem)
    off = [angles[0] == float(start[angles[0]]) + 0.05, angles[1] == float(start[angles[1]]) - 0.05, *begin[2:]]
    motion = mbd.simulate(robot.mechanism, [0, 0.3], initial=off, inputs=solution.feedback())
    for place in (tip.x, tip.y):
        assert motion[place][-1] == pytest.approx(solution.trajectory[place][-1], abs=1e-5)
    lin = mbd.linearize(robot.mechanism, solution.trajectory.final, wrt=inputs)
    feedback = solution.feedback({u: 1e-3 for u in inputs}, {rate: 0.05 for rate in rates})
    assert feedback.state_names == lin.state_names
    np.testing.assert_allclose(feedback.gains(0.3)[:, 2:], lin.B[2:].T * 50, rtol=1e-4, atol=1e-3)
