"""Solutions in files."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest

import mbdcasadi as mbd


@pytest.fixture
def stored(tmp_path):
    """A solution, its file and its problem."""
    problem, _u, _block = rest_to_rest(3.0, 2.0, lower=-5, upper=5)
    solution = mbd.optimize(problem, intervals=8)
    path = tmp_path / "solution.npz"
    solution.save(path)
    return solution, path, problem


@pytest.mark.slow
@pytest.mark.parametrize(
    "settings", [dict(), dict(degree=5), dict(transcription="hermite-simpson"), dict(control="linear")]
)
def test_what_was_saved_comes_back(tmp_path, settings):
    """Everything that a solution holds, from a problem with waypoints, a free time and a free parameter."""
    f = crank_rocker()
    peak = mbd.Parameter("peak", 5.0, lower=0.0)
    problem = half_turn(
        f,
        duration=(0.4, 0.8),
        path=[f.tau <= peak],
        terminal_cost=mbd.t + 0.1 * peak,
        free_parameters=[peak],
        waypoints=[mbd.Waypoint((0.1, 0.5), [f.o2.angle == 1.5])],
    )
    solution = mbd.optimize(problem, intervals=12, **settings)
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert back.cost == solution.cost and back.duration == solution.duration
    assert back.parameters == solution.parameters
    assert np.array_equal(back.mesh, solution.mesh) and np.array_equal(back.waypoint_times, solution.waypoint_times)
    assert np.array_equal(back.trajectory.q, solution.trajectory.q)
    times = np.linspace(0, solution.duration, 33)
    for e in (f.tau, f.rocker.alpha, f.o4.reaction_on(f.rocker).force, peak * f.tau):
        assert np.array_equal(back.trajectory.at(times)[e], solution.trajectory.at(times)[e])
    assert back.statistics == solution.statistics
    assert repr(back.active_limits) == repr(solution.active_limits)
    for label, value in solution.costates.items():
        assert np.array_equal(back.costates[label], value)
    assert back.verify().final_error == pytest.approx(solution.verify().final_error, abs=1e-12)
    again = mbd.optimize(problem, intervals=12, guess=back, **settings)
    assert again.cost == pytest.approx(solution.cost, rel=1e-6)


@pytest.mark.slow
def test_refined_solutions_keep_their_passes_and_starts(tmp_path):
    """The tables of statistics survive."""
    problem = half_turn(crank_rocker())
    solution = mbd.optimize(problem, intervals=8, tolerance=1e-5, starts=2)
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert back.statistics == solution.statistics and len(back.statistics.passes) >= 2
    assert back.mesh_error == pytest.approx(solution.mesh_error, rel=1e-6)


def test_the_steps_of_a_continuation_come_back(tmp_path):
    """As records, with the values of the parameter by name."""
    u, k = mbd.Input("u"), mbd.Parameter("k", 3.0)
    spring = lambda b: [mbd.GeneralizedForce("spring", [(b.x, -k * b.x)])]  # noqa: E731
    block, mechanism = guided_block(1.0, u, parameters=[k], extra=spring)
    ends = dict(initial=[block.x == 0, block.vx == 0], final=[block.x == 1, block.vx == 0])
    problem = mbd.OptimalControlProblem(mechanism, duration=1.0, running_cost=u**2, **ends)
    solution = mbd.optimize(problem, intervals=6, continuation={k: [3.0, 4.0]})
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert back.statistics == solution.statistics
    assert [step.values for step in back.statistics.steps] == [{"k": 3.0}, {"k": 4.0}]


def test_parameters_that_were_given_come_back(tmp_path):
    """Values other than the mechanism's own."""
    u, k = mbd.Input("u"), mbd.Parameter("k", 3.0)
    spring = lambda b: [mbd.GeneralizedForce("spring", [(b.x, -k * b.x)])]  # noqa: E731
    block, mechanism = guided_block(1.0, u, parameters=[k], extra=spring)
    problem = mbd.OptimalControlProblem(
        mechanism, duration=1.0, initial=[block.x == 0, block.vx == 0], final=[block.x == 1], running_cost=u**2
    )
    solution = mbd.optimize(problem, intervals=6, parameters={k: 20.0})
    solution.save(tmp_path / "s.npz")
    back = mbd.read_solution(tmp_path / "s.npz", problem)
    assert back.cost == solution.cost and back.verify().final_error < 1e-6


def test_a_wrong_file_is_refused(stored, tmp_path):
    """No file, an empty one, no solution, a single array, half of a solution."""
    _solution, path, problem = stored
    (tmp_path / "text.npz").write_text("nothing of the kind")
    (tmp_path / "empty.npz").write_bytes(b"")
    np.save(tmp_path / "array.npy", np.zeros(3))
    np.savez(tmp_path / "junk.npz", a=3)
    whole = path.read_bytes()
    (tmp_path / "half.npz").write_bytes(whole[: len(whole) // 2])
    for name in ("missing.npz", "empty.npz", "text.npz", "array.npy", "junk.npz", "half.npz"):
        with pytest.raises(mbd.FileError, match=name):
            mbd.read_solution(tmp_path / name, problem)


def test_a_file_with_a_part_missing(stored, tmp_path):
    """Named as what it is."""
    _, path, problem = stored
    for part in ("x", "settings", "lam_g", "segment times", "mesh 0"):
        content = dict(np.load(path))
        del content[part]
        np.savez(tmp_path / "part.npz", **content)
        with pytest.raises(mbd.FileError, match="part.npz"):
            mbd.read_solution(tmp_path / "part.npz", problem)


def test_damaged_entries_are_named(stored, tmp_path):
    """Numbers that are none, arrays that are cut, of another shape or of another kind."""
    _, path, problem = stored
    whole = dict(np.load(path))
    for name, values in whole.items():
        damaged = [np.full((3, 2, 1), 0.5)]
        damaged += [values[:-1]] if values.ndim and values.size else []
        damaged += [np.full_like(values, np.nan), np.array(["x"])] if values.dtype.kind == "f" and values.size else []
        for other in damaged:
            np.savez(tmp_path / "damaged.npz", **(whole | {name: other}))
            with pytest.raises(mbd.FileError, match="damaged.npz"):
                mbd.read_solution(tmp_path / "damaged.npz", problem)


def test_a_file_with_unknown_settings(stored, tmp_path):
    """A scheme that this version does not have, or a number that is none."""
    _, path, problem = stored
    for settings in ('{"transcription": "radau", "degree": 3, "control": "polynomial"}', '{"degree": 99}', "[]", "3"):
        np.savez(tmp_path / "odd.npz", **(dict(np.load(path)) | {"settings": settings}))
        with pytest.raises(mbd.FileError, match="odd.npz"):
            mbd.read_solution(tmp_path / "odd.npz", problem)


def test_a_solution_of_another_problem_is_refused(stored):
    """Other conditions, other waypoints, another linkage."""
    _, path, problem = stored
    block = problem.mechanism.bodies[0]
    other = [
        problem.replace(final=[block.x == 2, block.vx == 0]),
        problem.replace(waypoints=[mbd.Waypoint(0.5, [block.x == 0.3])]),
        half_turn(crank_rocker()),
    ]
    for wrong in other:
        with pytest.raises(mbd.FileError, match="solution"):
            mbd.read_solution(path, wrong)


def test_a_solution_of_nearly_the_same_problem_is_refused(stored):
    """Another cost, duration or mass leaves the rows' names as they are."""
    _solution, path, problem = stored
    u = problem.mechanism.inputs[0]
    heavier = rest_to_rest(3.0, 2.0, mass=2.0, lower=-5, upper=5)[0]
    for wrong in (problem.replace(running_cost=3 * u**2), problem.replace(duration=3.0), heavier):
        with pytest.raises(mbd.FileError):
            mbd.read_solution(path, wrong)


def test_wrong_arguments(stored):
    """A problem is wanted, and a path."""
    _, path, problem = stored
    with pytest.raises(mbd.MechanismError, match="OptimalControlProblem"):
        mbd.read_solution(path, 3)
    with pytest.raises(mbd.MechanismError):
        mbd.read_solution(3, problem)


def test_saving_to_nowhere(stored, tmp_path):
    """A directory that does not exist is an error, and nothing is left behind."""
    solution, path, _ = stored
    with pytest.raises((OSError, mbd.FileError)):
        solution.save(tmp_path / "no" / "where.npz")
    assert sorted(p.name for p in tmp_path.iterdir()) == [path.name]


def test_a_phase_of_no_duration_comes_back(tmp_path):
    """With its state and time, and the motion of the phases about it."""
    block, brake = mbd.Body("block", mass=1.0, inertia=1.0), mbd.Input("brake")
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
    free = mbd.Mechanism(bodies=[block], joints=[rail])
    braked = free.replace(forces=[mbd.Force("brake", block.at(0, 0), (brake, 0))], inputs=[brake])
    slide = mbd.Phase("slide", free, 1.0, initial=[block.x == 0, block.vx == 1])
    stop = mbd.Phase("stop", braked, 1.0, final=[block.vx == 0], running_cost=brake**2)
    problem = mbd.OptimalControlProblem(phases=[slide, mbd.Phase("touch", braked, 0.0), stop])
    solution = mbd.optimize(problem, intervals=4)
    solution.save(tmp_path / "solution.npz")
    back = mbd.read_solution(tmp_path / "solution.npz", problem)
    assert back.phases[1].mesh_times == pytest.approx([1.0]) and back.durations == solution.durations
    assert np.array_equal(back.trajectory.q, solution.trajectory.q)
    whole = mbd.OptimalControlProblem(phases=[slide, mbd.Phase("touch", braked, (0.1, 1.0)), stop])
    with pytest.raises(mbd.FileError, match=r"npz: the entry 'phase 1 mesh 0' does not increase"):
        mbd.read_solution(tmp_path / "solution.npz", whole)
