"""Parameters that are found with the motion: of the mechanism, and the problem's own."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest

import mbdcasadi as mbd


@pytest.mark.parametrize("control", ["constant", "polynomial"])
def test_least_peak_force(control):
    """Minimax: rest to rest over d in T takes a peak of 4 m d / T², the force at one limit and then at the other."""
    problem, u, _ = rest_to_rest(3.0, 2.0)
    peak = mbd.Parameter("peak", 10.0, lower=0.0)
    minimax = problem.replace(
        running_cost=0, terminal_cost=peak, path=[mbd.bounded(-peak, u, peak)], free_parameters=[peak]
    )
    solution = mbd.optimize(minimax, intervals=10, control=control)
    assert solution.cost == pytest.approx(3.0, rel=1e-6)
    assert solution.parameters[peak] == pytest.approx(3.0, rel=1e-6)
    times = np.linspace(0.01, 1.99, 50)
    assert np.allclose(solution.trajectory.at(times)[u], np.where(times < 1, 3.0, -3.0), atol=1e-3)
    assert solution.trajectory[peak] == pytest.approx(3.0, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_least_peak_bearing_force(transcription):
    """The peak of the reaction is what the parameter says, and lies below that of the least torque."""
    f = crank_rocker()
    peak = mbd.Parameter("peak", 60.0, lower=0.0)
    load = mbd.norm(f.o4.reaction_on(f.rocker).force)
    least_torque = mbd.optimize(half_turn(f), intervals=30)
    minimax = half_turn(
        f, path=[load <= peak], running_cost=1e-4 * f.tau**2, terminal_cost=peak, free_parameters=[peak]
    )
    solution = mbd.optimize(minimax, intervals=30, guess=least_torque, transcription=transcription)
    found = solution.parameters[peak]
    times = np.linspace(solution.mesh[:-1], solution.mesh[1:], 21).ravel()
    excess = np.max(solution.trajectory.at(np.unique(times))[load]) - found
    assert excess == pytest.approx(max(solution.limit_excess.values()), abs=1e-6)
    assert excess < 0.08 * found
    assert found < 0.95 * np.max(least_torque.trajectory[load])


def test_the_mass_of_a_body():
    """Force squared 12 m² d² / T³ against a price w / m: m³ = w T³ / (24 d²)."""
    u, m = mbd.Input("u"), mbd.Parameter("m", 2.0, lower=0.1, upper=10.0)
    block, mechanism = guided_block(m, u, parameters=[m])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.5,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=u**2,
        terminal_cost=5 / m,
        free_parameters=[m],
    )
    solution = mbd.optimize(problem, intervals=8)
    assert solution.parameters[m] == pytest.approx((5 * 1.5**3 / 24) ** (1 / 3), rel=1e-7)
    assert solution.trajectory[m * block.ax] == pytest.approx(solution.trajectory[u], abs=1e-8)
    assert solution.verify().final_error < 1e-9


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_the_length_of_a_pendulum(transcription):
    """Half a swing of 0.5 rad in T without torque: l = g (T / 2K)², K the complete elliptic integral."""
    from scipy.special import ellipk

    length, tau = mbd.Parameter("l", 1.0, lower=0.1, upper=3.0), mbd.Input("tau")
    bob = mbd.Body("bob", mass=1.0, inertia=0.0, pose=(0, -1, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))
    mechanism = mbd.Mechanism(
        bodies=[bob],
        joints=[pin],
        forces=[mbd.Gravity(), mbd.Torque("motor", bob, tau)],
        inputs=[tau],
        parameters=[length],
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=0.8,
        initial=[bob.phi == 0.5, bob.omega == 0],
        final=[bob.phi == -0.5, bob.omega == 0],
        running_cost=tau**2,
        free_parameters=[length],
    )
    solution = mbd.optimize(problem, intervals=20, transcription=transcription)
    exact = 9.81 * (0.8 / (2 * ellipk(np.sin(0.25) ** 2))) ** 2
    assert solution.parameters[length] == pytest.approx(exact, rel=1e-5)
    assert solution.trajectory.initial[bob.y] == pytest.approx(-solution.parameters[length] * np.cos(0.5), rel=1e-9)
    assert solution.verify().final_error < 1e-4


def test_where_to_start():
    """The problem's own parameter in an initial condition: 12 (1 - s)² / T³ against w s²."""
    s = mbd.Parameter("s", 0.2, lower=-5, upper=5)
    problem, _u, block = rest_to_rest(1.0, 2.0)
    free = problem.replace(initial=[block.x == s, block.vx == 0], terminal_cost=4 * s**2, free_parameters=[s])
    solution = mbd.optimize(free, intervals=6)
    assert solution.parameters[s] == pytest.approx(1.5 / (1.5 + 4), rel=1e-8)
    assert solution.trajectory.initial[block.x] == pytest.approx(solution.parameters[s], abs=1e-10)


def test_limits_of_a_parameter_hold():
    """Where the optimum lies beyond, the limit is the answer."""
    u, m = mbd.Input("u"), mbd.Parameter("m", 2.0, lower=1.5, upper=10.0)
    block, mechanism = guided_block(m, u, parameters=[m])
    _problem, *_ = rest_to_rest()
    light = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=u**2,
        free_parameters=[m],
    )
    solution = mbd.optimize(light, intervals=4)
    assert solution.parameters[m] == pytest.approx(1.5, rel=1e-6)
    assert solution.cost == pytest.approx(12 * 1.5**2, rel=1e-6)


def test_a_parameter_cannot_be_both_given_and_free():
    """Said with its name."""
    u, k = mbd.Input("u"), mbd.Parameter("k", 3.0)
    block, mechanism = guided_block(1.0, u, parameters=[k], extra=lambda b: [mbd.GeneralizedForce("s", [(b.x, -k)])])
    problem = mbd.OptimalControlProblem(
        mechanism, duration=1.0, initial=[block.x == 0], running_cost=u**2, free_parameters=[k]
    )
    with pytest.raises(mbd.ModelError, match="'k' is both given and free"):
        mbd.optimize(problem, parameters={k: 2.0})


def test_the_best_duration():
    """Force squared against time: 12 d² / T³ + c T is least at T⁴ = 36 d² / c."""
    problem, *_ = rest_to_rest(2.0)
    solution = mbd.optimize(problem.replace(duration=(0.1, 20.0), terminal_cost=3 * mbd.t), intervals=6)
    exact = (36 * 4 / 3) ** 0.25
    assert solution.duration == pytest.approx(exact, rel=1e-7)
    assert solution.cost == pytest.approx(12 * 4 / exact**3 + 3 * exact, rel=1e-9)


def test_a_free_parameter_without_inputs():
    """A ballistic problem: the stiffness that carries a mass over, no input at all."""
    k = mbd.Parameter("k", 3.0, lower=0.1, upper=50.0)
    block = mbd.Body("block", mass=1.0, inertia=0.01)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    spring = mbd.GeneralizedForce("spring", [(block.x, -k * block.x)])
    mechanism = mbd.Mechanism(bodies=[block], joints=[guide], forces=[spring], parameters=[k])
    problem = mbd.OptimalControlProblem(
        mechanism, duration=1.0, initial=[block.x == 1, block.vx == 0], final=[block.x == 0], free_parameters=[k]
    )
    solution = mbd.optimize(problem, intervals=10)
    assert solution.parameters[k] == pytest.approx(np.pi**2 / 4, rel=1e-7)
    assert solution.mesh_error < 1e-6
    assert solution.verify().final_error < 1e-6


def test_the_radius_of_a_rolling_wheel():
    """Spinning at 1 rad/s it must go 1 m in 1 s: effort is least at the radius whose speed needs no torque, r = 1."""
    u, r = mbd.Input("u"), mbd.Parameter("r", 0.5, lower=0.2, upper=2.0)
    wheel = mbd.Body("wheel", mass=1.0, inertia=1.0)
    rolling = mbd.NonholonomicConstraint("rolling", wheel.vx - r * wheel.omega)
    motor = mbd.Torque("motor", wheel, u)
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(bodies=[wheel], joints=[rolling], forces=[motor], inputs=[u], parameters=[r]),
        duration=1.0,
        initial=[wheel.x == 0, wheel.y == 0, wheel.phi == 0, wheel.vy == 0, wheel.omega == 1],
        final=[wheel.x == 1],
        running_cost=u**2,
        free_parameters=[r],
    )
    solution = mbd.optimize(problem, intervals=6)
    assert solution.parameters[r] == pytest.approx(1.0, abs=1e-4) and solution.cost < 1e-7
    first = solution.trajectory.initial
    assert first[wheel.omega] == pytest.approx(1.0, abs=1e-9)
    assert first[wheel.vx] == pytest.approx(solution.parameters[r], abs=1e-9)


def test_a_state_that_fixes_a_free_length_is_refused():
    """A length changes the pose that the state gives as a whole; a mass does not."""
    u = mbd.Input("u")
    length, mass = mbd.Parameter("l", 0.5, lower=0.2, upper=2.0), mbd.Parameter("m", 1.0, lower=0.5, upper=2.0)
    bob = mbd.Body("bob", mass=mass, inertia=1.0, pose=(0.5, 0, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(-length, 0))
    motor = mbd.Torque("motor", bob, u)
    mechanism = mbd.Mechanism([bob], [pin], forces=[motor], inputs=[u], parameters=[length, mass])
    state = mbd.assemble(mechanism, [bob.phi == 0])
    wanted = dict(duration=1.0, initial=state, final=[bob.phi == 1], running_cost=u**2)
    problem = mbd.OptimalControlProblem(mechanism, free_parameters=[length], **wanted)
    with pytest.raises(mbd.ConditionError, match="'l' alone; state conditions"):
        mbd.optimize(problem, intervals=6)
    lighter = mbd.optimize(problem.replace(free_parameters=[mass]), intervals=6)
    assert lighter.parameters[mass] == pytest.approx(0.5, abs=1e-6)
