"""Open chains: in angles alone, from several kinds of guesses, on meshes that are refined by themselves."""

import warnings
from dataclasses import replace

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.search.starts import Starts
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver
from mbdcasadi.optimal_control.solve.solvers.base import GIVEN_UP
from mbdcasadi.optimal_control.transcription.mesh import Mesh


def two_links(driven, duration, length=1.0, inertia=0.083, *, is_reversed=False, **changes):
    """An acrobot or a pendubot (bars of 1 kg, the upper one of 1 m, uniform) from hanging to standing upright."""
    tau, half = mbd.Input("tau"), length / 2
    upper = mbd.Body("upper", mass=1.0, inertia=0.083, pose=(0, -0.5, -np.pi / 2))
    lower = mbd.Body("lower", mass=1.0, inertia=inertia, pose=(0, -1 - half, -np.pi / 2))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.5, 0))
    elbow = mbd.Revolute("elbow", upper.at(0.5, 0), lower.at(-half, 0))
    motor = mbd.Torque("motor", upper, tau) if driven == "shoulder" else mbd.Torque("motor", lower, tau, upper)
    bodies = [lower, upper] if is_reversed else [upper, lower]
    mechanism = mbd.Mechanism(bodies, [shoulder, elbow], forces=[mbd.Gravity(), motor], inputs=[tau])
    rest = [upper.omega == 0, lower.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=duration,
        initial=[upper.phi == -np.pi / 2, lower.phi == -np.pi / 2, *rest],
        final=[upper.phi == np.pi / 2, lower.phi == np.pi / 2, *rest],
        running_cost=tau**2,
    )
    return problem.replace(**changes), upper, lower, elbow


@pytest.mark.slow
@pytest.mark.parametrize(
    ("driven", "duration", "known"), [("elbow", 2.5, 77.62), ("shoulder", 2.5, 171.9), ("shoulder", 4.0, 72.33)]
)
def test_swing_ups(driven, duration, known):
    """Acrobot and pendubot from the automatic guess: cost, a mesh that holds, and the forward dynamics.

    The costs are those of plain collocation in angles from a straight line; there are cheaper and dearer optima.
    """
    problem, upper, lower, elbow = two_links(driven, duration)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*too coarse for the motion")
        solution = mbd.optimize(problem)
    assert solution.cost < 1.02 * known
    first, *others = [start.description for start in solution.statistics.starts]
    assert first == "kinematic, at rest" and len(others) > 1
    # replayed by forward dynamics from mesh point to mesh point
    assert np.max(solution.verify().defects) < 0.02
    motion = solution.trajectory
    assert motion.final[upper.phi] == pytest.approx(np.pi / 2) and motion.final[lower.phi] == pytest.approx(np.pi / 2)
    # reactions are those of the bodies: m a = R + m g of the lower link
    force, gravity = motion[elbow.reaction_on(lower).force], np.array([0.0, -9.81])
    np.testing.assert_allclose(motion[lower.acceleration], force + gravity, atol=1e-6 * np.abs(force).max())


@pytest.mark.slow
@pytest.mark.parametrize(("driven", "known"), [("elbow", 86.6), ("shoulder", 86.91)])
def test_swings_are_found(driven, known):
    """Spong's acrobot and pendubot in 4 s: plain collocation in angles leads to the known costs, or dearer ones.

    From poses that follow each other evenly the costs are 108.3 and 115.6.
    """
    problem, *_ = two_links(driven, 4.0, length=2.0, inertia=0.33)
    solution = mbd.optimize(problem)
    assert solution.cost < 1.001 * known
    assert np.max(solution.verify().defects) < 0.02


def chain(links, driven, duration):
    """Bars, each with its length and its mass per length, from hanging to standing, with motors in some joints."""
    motors, forces, joints, bodies, end = [mbd.Input(f"tau {k}") for k in driven], [mbd.Gravity()], [], [], 0.0
    for k, (length, density) in enumerate(links):
        mass, pose = density * length, (0, end - length / 2, -np.pi / 2)
        bodies.append(mbd.Body(f"link {k}", mass=mass, inertia=mass * length**2 / 12, pose=pose))
        before = bodies[-2].at(links[k - 1][0] / 2, 0) if k else mbd.ground.at(0, 0)
        joints.append(mbd.Revolute(f"joint {k}", before, bodies[-1].at(-length / 2, 0)))
        if k in driven:
            forces.append(mbd.Torque(f"motor {k}", bodies[-1], motors[driven.index(k)], *bodies[-2:-1]))
        end -= length
    initial, final = (
        [c for body in bodies for c in (body.phi == phi, body.omega == 0)] for phi in (-np.pi / 2, np.pi / 2)
    )
    mechanism = mbd.Mechanism(bodies, joints, forces=forces, inputs=motors)
    cost = mbd.sumsqr(mbd.vertcat(*motors))
    return mbd.OptimalControlProblem(mechanism, duration=duration, initial=initial, final=final, running_cost=cost)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("links", "driven", "duration"),
    [
        ([(1.11, 1.70), (0.846, 1.93)], (1,), 3.64),  # closed in from a swing
        ([(0.465, 1.40), (0.722, 0.718)], (1,), 1.90),  # from a swing with all limits
        ([(1.106, 1.17), (0.583, 1.66), (0.729, 0.829)], (0, 1), 4.07),  # from the solution without limits
    ],
)
def test_limits_of_a_swing_up(links, driven, duration):
    """Under 0.7 of the torques of the free optimum the cost is that of limits that close in by hand, or lower."""
    problem = chain(links, driven, duration)
    free = mbd.optimize(problem)
    largest = 0.7 * np.max(np.abs(free.trajectory.inputs), axis=0)
    motors = problem.mechanism.inputs
    limited = problem.replace(path=[mbd.bounded(-limit, u, limit) for limit, u in zip(largest, motors, strict=True)])
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*too coarse for the motion")
        solution = mbd.optimize(limited)
    assert free.cost < solution.cost < 1.01 * mbd.optimize(limited, guess=free).cost
    assert np.max(solution.verify().defects) < 0.02


@pytest.mark.slow
def test_least_time_of_a_swing_up():
    """A least time has no end without limits, from which they could close in: swings lead to 4.2 s with them at once.

    The motion that does not swing takes 6.7 s.
    """
    problem = chain([(1.11, 1.70), (0.846, 1.93)], (1,), (1.0, 8.0))
    motor = problem.mechanism.inputs[0]
    fast = problem.replace(path=[mbd.bounded(-12, motor, 12)], running_cost=0, terminal_cost=mbd.t)
    solution = mbd.optimize(fast)
    assert solution.cost < 4.5
    assert np.max(solution.verify().defects) < 0.02


@pytest.mark.slow
def test_a_chain_that_begins_with_a_speed_is_solved_from_its_free_motion():
    """The lower tip of an acrobot that begins with a speed gets as high as from its free motion, or higher."""
    problem, upper, lower, _ = two_links("elbow", 2.0)
    initial = [upper.phi == -np.pi / 2, lower.phi == -np.pi / 2, upper.omega == 6, lower.omega == 6]
    height = lower.at(0.5, 0).position[1]
    problem = problem.replace(initial=initial, final=[], terminal_cost=-50 * height)
    both = mbd.optimize(problem, starts=2)
    assert mbd.optimize(problem).cost <= both.cost + 1e-3 * abs(both.cost)


def test_a_chain_that_hangs_is_not_solved_from_detours():
    """A double pendulum is moved by 0.1 rad at the shoulder: few iterations, and no swings."""
    problem, upper, lower, _ = two_links("shoulder", 2.0)
    rest = [upper.omega == 0, lower.omega == 0]
    end = [upper.phi == 0.1 - np.pi / 2, *rest]
    starts = mbd.optimize(problem.replace(final=end), intervals=20).statistics.starts
    assert [start.description for start in starts] == ["kinematic, at rest", "kinematic", "free motion"]


def test_a_solve_is_given_up_if_its_cost_stays_above_a_ceiling():
    """A ceiling far below the optimum ends a solve after so many iterations, one above it changes nothing."""
    problem, *_ = two_links("shoulder", 2.5)
    solver = ProblemSolver(problem, replace(Settings.read("gauss-legendre", 3, "polynomial", None, False), angles=True))
    meshes, guess = [Mesh.equal(20, np.array([0, 2.5]))], Starts(solver).at_rest()
    known = solver.solve(meshes, guess)
    assert known.statistics.iterations > GIVEN_UP
    with pytest.raises(mbd.OptimizationError, match="stayed far above that of another start") as error:
        solver.solve(meshes, guess, ceiling=1e-6 * known.cost)
    assert error.value.partial.statistics.iterations == GIVEN_UP
    assert solver.solve(meshes, guess, ceiling=10 * known.cost).cost == pytest.approx(known.cost, rel=1e-9)


@pytest.mark.slow
def test_results_of_both_forms_are_the_same():
    """The same optimum in angles and, from it as a trajectory, in all coordinates; reactions with the same labels."""
    problem, *_, elbow = two_links("shoulder", 2.5)
    angles = mbd.optimize(problem, intervals=80)
    whole = mbd.optimize(problem, intervals=80, guess=angles.trajectory)
    assert angles.program.size < whole.program.size
    assert whole.cost == pytest.approx(angles.cost, rel=1e-4)
    for expression in (elbow.reaction_on(problem.mechanism.bodies[1]).force, elbow.angle):
        one, other = (s.trajectory.at(np.linspace(0, 2.5, 51))[expression] for s in (angles, whole))
        np.testing.assert_allclose(one, other, atol=0.02 * np.abs(other).max())


@pytest.mark.slow
def test_a_solution_in_angles_is_a_guess_and_is_saved(tmp_path):
    """A solve from a solution keeps its form, and takes no iterations."""
    problem, *_ = two_links("shoulder", 2.5)
    solution = mbd.optimize(problem, intervals=40)
    again = mbd.optimize(problem, intervals=40, guess=solution)
    assert again.program is solution.program and again.statistics.iterations <= 3
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    np.testing.assert_array_equal(back.trajectory.q, solution.trajectory.q)


@pytest.mark.slow
def test_a_number_of_intervals_is_kept():
    """It warns as before if these are too coarse; without a number the mesh is refined."""
    problem, *_ = two_links("elbow", 2.5)
    with pytest.warns(mbd.MechanismWarning, match="the mesh of 12 intervals is too coarse"):
        assert mbd.optimize(problem, intervals=12).mesh.size == 13
    assert mbd.optimize(problem).mesh.size > 41


@pytest.mark.slow
@pytest.mark.parametrize(("gravity", "starts"), [((0.0, 0.0), 1), ((0.0, -9.81), 2)])
def test_an_arm_without_gravity_is_not_solved_from_poses_at_rest(gravity, starts):
    """Poses at rest meet its equations of motion without inputs; under gravity they are a second guess."""
    torques = [mbd.Input("shoulder torque"), mbd.Input("elbow torque")]
    upper = mbd.Body("upper", mass=1.0, inertia=1 / 12, pose=(0.5, 0, 0))
    lower = mbd.Body("lower", mass=1.0, inertia=1 / 12, pose=(1.5, 0, 0))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.5, 0))
    elbow = mbd.Revolute("elbow", upper.at(0.5, 0), lower.at(-0.5, 0))
    motors = [mbd.Torque("M1", upper, torques[0]), mbd.Torque("M2", lower, torques[1], upper)]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([upper, lower], [shoulder, elbow], forces=[mbd.Gravity(gravity), *motors], inputs=torques),
        duration=1.0,
        initial=[upper.phi == 0, lower.phi == 0, upper.omega == 0, lower.omega == 0],
        final=[upper.phi == 1.0, lower.phi == 0.5, upper.omega == 0, lower.omega == 0],
        running_cost=sum(torque**2 for torque in torques),
    )
    solution = mbd.optimize(problem)
    solved = [start for start in solution.statistics.starts if np.isfinite(start.cost)]
    assert max(len(solved), 1) == starts
    assert solution.verify().final_error < 1e-4
