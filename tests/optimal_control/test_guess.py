"""Where the solver starts: poses, trajectories, inverse dynamics, other solutions, several starts."""

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest, swing_up

import mbdcasadi as mbd


@pytest.fixture(scope="module")
def solved():
    """The half turn of the four-bar."""
    f = crank_rocker()
    problem = half_turn(f)
    return problem, f, mbd.optimize(problem, intervals=24)


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings",
    [
        dict(intervals=24),
        dict(intervals=37),
        dict(intervals=24, degree=2),
        dict(intervals=40, transcription="hermite-simpson"),
        dict(intervals=24, control="linear"),
        dict(intervals=24, control="constant"),
    ],
)
def test_a_solution_on_another_mesh(solved, settings):
    """Any mesh, any transcription: few iterations, the same optimum."""
    problem, _, coarse = solved
    again = mbd.optimize(problem, guess=coarse, **settings)
    assert again.statistics.iterations <= 6
    assert again.cost == pytest.approx(coarse.cost, rel=0.02 if settings.get("control") == "constant" else 2e-3)


@pytest.mark.slow
def test_a_solution_of_another_duration_and_other_waypoints(solved):
    """Stretched to the new time; a waypoint that was not there before."""
    problem, f, before = solved
    longer = mbd.optimize(problem.replace(duration=0.75), intervals=24, guess=before)
    assert longer.duration == 0.75 and longer.statistics.iterations <= 15
    assert longer.cost == pytest.approx(mbd.optimize(problem.replace(duration=0.75), intervals=24).cost, rel=1e-6)
    free = mbd.optimize(problem.replace(duration=(0.3, 0.9), terminal_cost=mbd.t), intervals=24, guess=before)
    assert 0.3 < free.duration < 0.9
    via = problem.replace(waypoints=[mbd.Waypoint(0.3, [f.o2.angle == 2.3])])
    assert mbd.optimize(via, intervals=24, guess=before).trajectory.at([0.3])[f.o2.angle] == pytest.approx([2.3])
    back = mbd.optimize(problem, intervals=24, guess=mbd.optimize(via, intervals=24))
    assert back.cost <= before.cost * (1 + 1e-6), "the detour may lead to a better optimum"


def test_a_solution_brings_its_mesh():
    """Without ``intervals=``, if it has as many segments; of the same problem it is not checked anew, else it is."""
    problem, *_ = rest_to_rest()
    first = mbd.optimize(problem, intervals=23)
    assert mbd.optimize(problem, guess=first).mesh.size == 24
    other = problem.replace(duration=2.0)
    assert mbd.optimize(other, guess=first).mesh.size == 24
    via = other.replace(waypoints=[mbd.Waypoint(1.0)])
    assert mbd.optimize(via, guess=first).mesh.size == 41


def test_a_simulation(solved):
    """A replay of the optimum is as good as the optimum."""
    problem, _f, before = solved
    motion = before.simulate()
    again = mbd.optimize(problem, intervals=24, guess=motion)
    assert again.statistics.iterations <= 8 and again.cost == pytest.approx(before.cost, rel=1e-7)


def test_inverse_dynamics_of_a_driven_copy(solved):
    """Drivers and inputs are duals: the first torque is the effort, and few iterations follow."""
    problem, f, before = solved
    angle = 0.5 + np.pi * (3 * (mbd.t / 0.6) ** 2 - 2 * (mbd.t / 0.6) ** 3)
    drive = mbd.Driver("drive", f.crank.phi, angle)
    gravity = [force for force in problem.mechanism.forces if force.name != "motor"]
    driven = problem.mechanism.replace(drivers=[drive], forces=gravity, inputs=[])
    motion = mbd.inverse_dynamics(driven, np.linspace(0, 0.6, 121))
    first = mbd.optimize(problem, intervals=24, guess=motion, starts=None)
    assert first.cost == pytest.approx(before.cost, rel=1e-7) and first.statistics.iterations <= 15
    stopped = stop_at_once(problem, motion)
    times = np.linspace(0.01, 0.59, 59)
    effort = motion.at(times)[drive.effort]
    assert np.allclose(stopped.trajectory.at(times)[f.tau], effort, atol=0.02 * np.max(np.abs(effort)))


def stop_at_once(problem, guess):
    """The guess itself, on the mesh."""
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem, intervals=24, guess=guess, options={"ipopt.max_iter": 0})
    return caught.value.partial


@pytest.mark.slow
def test_several_starts_keep_the_best():
    """All are reported; the one returned has the least cost."""
    problem, *_ = swing_up(5.0, 3.0)
    solution = mbd.optimize(problem, intervals=30, starts=4)
    starts = solution.statistics.starts
    assert len(starts) == 4 and starts[0].guess == "kinematic" and len({s.guess for s in starts}) >= 2
    costs = [s.cost for s in starts if np.isfinite(s.cost)]
    assert solution.cost == min(costs) and all(s.iterations > 0 and s.status for s in starts)
    assert solution.verify().final_error < 1e-3
    again = mbd.optimize(problem, intervals=30, starts=4)
    assert [s.cost for s in again.statistics.starts] == [s.cost for s in starts], "random, but the same every time"


def test_a_list_of_starts(solved):
    """Solutions, trajectories and None, the usual guess."""
    problem, _, before = solved
    solution = mbd.optimize(problem, intervals=20, starts=[None, before, before.simulate()])
    assert [s.description for s in solution.statistics.starts] == ["kinematic", "solution", "trajectory"]


def test_starts_that_fail_are_reported():
    """Where one succeeds the others say with what status they ended."""
    problem, *_ = swing_up(5.0, 3.0)
    good = mbd.optimize(problem, intervals=24)
    limit = good.statistics.iterations - 3
    solution = mbd.optimize(problem, intervals=24, starts=[None, good], options={"ipopt.max_iter": limit})
    first, second = solution.statistics.starts
    assert first.status == "Maximum_Iterations_Exceeded" and np.isnan(first.cost)
    assert second.status == "Solve_Succeeded" and second.cost == solution.cost


def test_the_kinematic_guess_closes_the_loops(solved):
    """It goes from the first pose to the last, on the constraints, with the inputs of inverse dynamics."""
    problem, f, _ = solved
    first = stop_at_once(problem, None)
    n = problem.equations.q.numel()
    for row in first.phases[0].mesh_states:
        assert np.max(np.abs(first.phases[0].numeric.position(0.0, row[:n], np.zeros(0))[0])) < 1e-8
    assert first.trajectory.final[f.o2.angle] == pytest.approx(0.5 + np.pi, abs=1e-6)
    angles = first.trajectory[f.o2.angle][:: first.points_per_interval]
    assert np.all(np.diff(angles) > 0)


def test_a_trajectory_of_other_bodies_is_refused(solved):
    """By the coordinate that it lacks."""
    problem, _, _ = solved
    other, *_ = rest_to_rest()
    stranger = mbd.optimize(other, intervals=4)
    with pytest.raises(mbd.ModelError, match="crank.x"):
        mbd.optimize(problem, guess=stranger.trajectory)


def test_a_solution_of_other_bodies_is_refused(solved):
    """As a trajectory is."""
    problem, _, _ = solved
    with pytest.raises(mbd.ModelError, match="crank.x"):
        mbd.optimize(problem, intervals=6, guess=mbd.optimize(rest_to_rest()[0], intervals=4))
