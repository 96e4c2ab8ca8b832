"""Motions that a mechanism makes by itself, compared with its simulation."""

from dataclasses import replace

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.numerics.symbolic import LOCK
from mbdcasadi.optimal_control.motion.natural_motion import STRETCHES, NaturalMotion
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver


def crane(limit=np.inf, *, angles=False):
    """A cart that carries a hanging bob by a metre in 1.5 s."""
    force = mbd.Input("F", lower=-limit, upper=limit)
    cart, bob = (
        mbd.Body("cart", mass=2.0, inertia=0.1),
        mbd.Body("bob", mass=1.0, inertia=0.05, pose=(0, -1, -np.pi / 2)),
    )
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("hook", cart.at(0, 0), bob.at(-1, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Force("drive", cart.at(0, 0), (force, 0))]
    mechanism = mbd.Mechanism([cart, bob], joints, forces=forces, inputs=[force])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.5,
        initial=[cart.x == 0, cart.vx == 0, bob.phi == 0.4 - np.pi / 2, bob.omega == 0],
        final=[cart.x == 1, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
        running_cost=force**2,
    )
    settings = Settings.read("gauss-legendre", 3, "polynomial", None, False)
    with LOCK:
        solver = ProblemSolver(problem, replace(settings, angles=angles))
    return solver, mechanism, cart, bob, force


def sampled(solver, make):
    """Values at even times of a motion that is made from the start of a problem."""
    setup, start = solver.setups[0], solver.start
    with LOCK:
        guess = make(NaturalMotion(setup), setup.path, start.v, start.z)
        times = np.linspace(0, 1.5, STRETCHES + 1)
        return times, guess.sample(times)


@pytest.mark.parametrize("angles", [False, True])
def test_the_free_motion_is_that_of_a_simulation(angles):
    """The bob swings under the cart, which it moves."""
    solver, mechanism, *_ = crane(angles=angles)
    times, values = sampled(solver, lambda natural, *begin: natural.under(*begin))
    motion = mbd.simulate(mechanism, times, initial=solver.start)
    np.testing.assert_allclose(values["q"], motion.q, atol=1e-6)
    np.testing.assert_allclose(values["a"], motion.a, atol=1e-4)


def test_the_driven_coordinate_follows_the_path_and_the_other_one_swings():
    """The cart arrives; the motion is that of the forces, and the bob does not hang still as on the path."""
    solver, mechanism, _cart, bob, force = crane()
    natural = NaturalMotion(solver.setups[0])
    assert natural.is_underactuated and natural.drives
    times, values = sampled(solver, lambda natural, *begin: natural.along(*begin))
    assert values["q"][-1, 0] == pytest.approx(1.0, abs=1e-2)
    motion = mbd.simulate(mechanism, times, initial=solver.start, inputs={force: values["u"][:, 0]})
    np.testing.assert_allclose(values["q"], motion.q, atol=0.02)  # inputs are straight between the samples here
    assert np.ptp(motion[bob.phi]) > 0.4


def test_inputs_stay_within_their_limits():
    """A weak drive does what it can."""
    solver, *_ = crane(limit=2.0)
    _, values = sampled(solver, lambda natural, *begin: natural.along(*begin))
    assert np.max(np.abs(values["u"])) == pytest.approx(2.0) and values["q"][-1, 0] < 0.9
