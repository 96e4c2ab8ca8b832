"""Errors of the inputs to the tolerance, against closed forms at random times."""

import warnings

import numpy as np
import pytest
from motions import rest_to_rest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

import mbdcasadi as mbd
from mbdcasadi.optimal_control.measures.input_error import input_errors


def damped(rate, **changes):
    """A block moved by 1 m in 1 s with the least integral of u² + (rate v)²: v'' = rate² v - c."""
    problem, u, block = rest_to_rest(1.0, 1.0, **changes)
    peak = 1 / (1 - np.tanh(rate / 2) / (rate / 2))
    return (
        problem.replace(running_cost=u**2 + (rate * block.vx) ** 2),
        u,
        lambda t: -peak * rate * np.sinh(rate * (t - 0.5)) / np.cosh(rate / 2),
    )


def off(solution, u, exact):
    """Errors of an input at random times as shares of its largest value."""
    times = np.random.default_rng(3).uniform(0, solution.duration, 2000)
    return np.abs(solution.trajectory.at(times)[u] - exact(times)) / np.max(np.abs(exact(times)))


@pytest.mark.parametrize(("tolerance", "degree"), [(1e-4, 3), (1e-6, 3), (1e-6, 5)])
def test_steep_inputs_are_found_to_the_tolerance(tolerance, degree):
    """The local errors are small from the start: the states are polynomials almost."""
    problem, u, exact = damped(20.0)
    solution = mbd.optimize(problem, intervals=10, degree=degree, tolerance=tolerance)
    assert len(solution.statistics.passes) > 1 and solution.statistics.passes[0].error <= tolerance
    assert np.max(off(solution, u, exact)) < 2 * tolerance


@pytest.mark.parametrize("settings", [{"degree": 2}, {}, {"degree": 5}, {"transcription": "hermite-simpson"}])
def test_the_estimate_is_the_error(settings):
    """To a tenth for Gauss–Legendre, whose values at the stages are precise; to a half for continuous inputs."""
    problem, u, exact = damped(5.0)
    solution = mbd.optimize(problem, intervals=20, **settings)
    error, estimate = np.max(off(solution, u, exact)), np.max(input_errors(solution.phases[0]))
    assert estimate == pytest.approx(error, rel=0.5 if "transcription" in settings else 0.15)


@pytest.mark.parametrize("control", ["linear", "constant"])
def test_a_course_that_was_chosen_is_left_alone(control):
    problem, *_ = damped(5.0)
    solution = mbd.optimize(problem, intervals=10, control=control, tolerance=1e-3)
    assert not np.any(input_errors(solution.phases[0])) and solution.mesh.size == 11


def turning_back(size):
    """Bryson and Ho, Applied Optimal Control, 3.11, with its optimal input, which has kinks at 3 l and 1 - 3 l."""
    problem, u, block = rest_to_rest(0.0, 1.0)
    problem = problem.replace(
        initial=[block.x == 0, block.vx == 1],
        final=[block.x == 0, block.vx == -1],
        path=[block.x <= size],
        running_cost=u**2 / 2,
    )
    return problem, u, lambda t: -2 / (3 * size) * np.maximum(1 - np.minimum(t, 1 - t) / (3 * size), 0)


@pytest.mark.parametrize(("size", "intervals", "tolerance"), [(0.0937, 20, 1e-6), (0.02, 20, 1e-4), (0.02, 40, 1e-5)])
def test_an_input_at_a_limit_of_a_position(size, intervals, tolerance):
    """Kinks lie between the mesh points, which are put there; the input is right beside them, too."""
    problem, u, exact = turning_back(size)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, intervals=intervals, tolerance=tolerance)
    assert solution.cost == pytest.approx(4 / (9 * size), rel=1e-8)
    assert np.mean(off(solution, u, exact) > tolerance) < 1e-3 and not solution.meshes[0].moving
    assert np.min(np.abs(solution.mesh - 3 * size)) < 10 * tolerance and solution.mesh.size <= intervals + 11


def test_an_input_at_a_limit_of_a_speed():
    """The force falls to zero where the limit v is reached, at 1.5 (1 - 1 / v) s, and stays there."""
    fastest = 1.23
    ramp = 1.5 * (1 - 1 / fastest)
    problem, u, block = rest_to_rest(1.0, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem.replace(path=[block.vx <= fastest]), tolerance=1e-6)
    assert solution.cost == pytest.approx(8 / 3 * fastest**2 / ramp, rel=1e-9)
    near = lambda t: np.maximum(1 - np.minimum(t, 1 - t) / ramp, 0) * np.sign(0.5 - t)  # noqa: E731
    assert np.max(off(solution, u, lambda t: 2 * fastest / ramp * near(t))) < 1e-6
    assert solution.mesh.size == 41 and len(solution.statistics.passes) <= 4


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-4, 1e-5])
def test_an_input_at_a_limit_of_a_reaction(tolerance):
    """A mass of 1 kg on an arm of 1 m in least time: the torque keeps |F| at R, tau² + omega⁴ = R², where it can."""
    most, load, angle = 2.0, 2.5, 4.0
    torque = mbd.Input("torque", lower=-most, upper=most)
    bob = mbd.Body("bob", mass=1.0, inertia=0.0, pose=(1, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-1, 0))
    mechanism = mbd.Mechanism([bob], [pin], forces=[mbd.Torque("motor", bob, torque)], inputs=[torque])
    rest = [bob.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        (0.1, 20),
        initial=[bob.phi == 0, *rest],
        final=[bob.phi == angle, *rest],
        path=[mbd.norm(pin.reaction_on(bob).force) <= load],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, tolerance=tolerance)
    # with omega² = R sin s: s' = 2 omega, and an angle of s / 2
    first = (load**2 - most**2) ** 0.25
    begin = np.arcsin(first**2 / load)
    run = solve_ivp(
        lambda t, s: 2 * np.sqrt(load * np.sin(s)), (0, 1), [begin], rtol=1e-11, atol=1e-12, dense_output=True
    )
    arc = brentq(lambda t: run.sol(t)[0] - np.pi / 2, 0.1, 0.5)
    coasts = (angle - first**2 / most - (np.pi / 2 - begin)) / np.sqrt(load)
    duration = 2 * (first / most + arc) + coasts
    assert solution.cost == pytest.approx(duration, rel=0.1 * tolerance)
    times = np.random.default_rng(1).uniform(0, duration / 2, 1000)
    since = times - first / most
    led = load * np.cos(np.minimum(run.sol(np.clip(since, 0, arc))[0], np.pi / 2))
    exact = np.where(since < 0, most, np.where(since < arc, led, 0.0))
    motion = solution.trajectory.at(np.r_[times, duration - times])
    errors = np.abs(motion[torque].ravel() - np.r_[exact, -exact]) / most
    assert np.mean(errors > tolerance) < 0.005 and np.max(errors) < 5 * tolerance
    assert max(solution.limit_excess.values()) <= tolerance * load


@pytest.mark.slow
def test_an_input_that_no_cost_sees():
    """A speed is followed within force limits: the force is its slope on the way, and jumps at both ends."""
    problem, u, block = rest_to_rest(0.0, 3.0, lower=-2, upper=2)
    followed = 1 + mbd.sin(mbd.t) / 2
    problem = problem.replace(final=[block.vx == 0], running_cost=(block.vx - followed) ** 2)
    wave = lambda t: 1 + np.sin(t) / 2  # noqa: E731
    ends = brentq(lambda t: 2 * t - wave(t), 0, 2), brentq(lambda t: 2 * (3 - t) - wave(t), 1, 3)
    plain = mbd.optimize(problem)
    times = np.linspace(1, 2, 301)
    assert np.max(np.abs(plain.trajectory.at(times)[u] - np.cos(times) / 2)) < 1e-3, "no chatter on the way"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=1e-5)
    times = np.random.default_rng(1).uniform(0, 3, 1000)
    exact = np.where(times < ends[0], 2, np.where(times > ends[1], -2, np.cos(times) / 2))
    errors = np.abs(solution.trajectory.at(times)[u] - exact) / 2
    away = np.min(np.abs(times[:, None] - ends), axis=1) > 3 * np.sqrt(1e-5)
    assert np.mean(errors > 1e-5) < 0.01 and np.max(errors[away]) < 2e-5
    assert solution.mesh.size <= 50


def test_inputs_that_are_not_found_are_reported(monkeypatch):
    """One pass leaves the mesh as it is."""
    monkeypatch.setattr("mbdcasadi.optimal_control.search.refine.PASSES", 1)
    problem, *_ = damped(20.0)
    with pytest.warns(mbd.MechanismWarning, match=r"meet the tolerance 1e-06, but not the inputs, which are off by"):
        mbd.optimize(problem, intervals=10, tolerance=1e-6)


@pytest.mark.slow
def test_meshes_are_split_after_mesh_points_were_moved_in_vain():
    """Least work of the motor of a cart with a pendulum: the cost of 160 equal intervals, without a warning."""
    force, k = mbd.Input("force", lower=-25, upper=25), mbd.Parameter("k", 2.0)
    cart = mbd.Body("cart", mass=1.0, inertia=0.1)
    bob = mbd.Body("bob", mass=0.5, inertia=0.01, pose=(0, -0.4, 0))
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), cart.at(0, 0))
    pin = mbd.Revolute("pin", cart.at(0, 0), bob.at(0, 0.4))
    lag = mbd.StateVariable("lag", 0.1)
    push = mbd.Force("push", cart.at(0, 0), (force - k * cart.x - 0.1 * lag, 0))
    system = mbd.Mechanism(
        [cart, bob],
        [guide, pin],
        forces=[mbd.Gravity(), push],
        inputs=[force],
        parameters=[k],
        states={lag: cart.vx - lag},
    )
    problem = mbd.OptimalControlProblem(
        system,
        duration=1.5,
        initial=[cart.x == 0, cart.vx == 0, bob.phi == 0, bob.omega == 0, lag == 0],
        final=[cart.x == 1, cart.vx == 0],
        running_cost=mbd.absolute(force * cart.vx) + 0.01 * force**2,
    )
    with warnings.catch_warnings():
        warnings.simplefilter("error", mbd.MechanismWarning)
        solution = mbd.optimize(problem, intervals=4, tolerance=1e-3)
    assert solution.cost == pytest.approx(1.19593, rel=1e-4)
