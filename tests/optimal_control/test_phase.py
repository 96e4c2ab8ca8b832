"""A problem, its program and its solution consist of phases: one, if it is given a mechanism."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.collocation_program import CollocationProgram
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver
from mbdcasadi.optimal_control.statement.phase import Phase
from mbdcasadi.optimal_control.transcription.mesh import Mesh


def test_what_a_problem_states_hangs_on_its_phase():
    """And is read there; the problem has the same by name."""
    f = crank_rocker()
    via = mbd.Waypoint((0.1, 0.5), [f.o2.angle == 1.5])
    problem = half_turn(f, path=[f.tau <= 5], waypoints=[via], terminal_cost=mbd.t)
    (phase,) = problem.phases
    assert isinstance(phase, Phase) and phase.mechanism is f.mechanism
    assert problem.duration == phase.span == (0.6, 0.6)
    for name in ("mechanism", "equations", "initial", "final", "path", "running_cost", "waypoints"):
        assert getattr(problem, name) is getattr(phase, name)
    assert phase.time_spans == [(0, 0), (0.1, 0.5), (0.6, 0.6)] and phase.has_free_times
    assert repr(phase) == f"Phase('motion', {f.mechanism!r}, duration 0.6 s)"
    with pytest.raises(AttributeError, match="does not change"):
        phase.span = (1.0, 1.0)


def test_a_phase_says_what_is_wrong_with_it():
    block, mechanism = guided_block(1.0, mbd.Input("u"))
    good = Phase("swing", mechanism, (0.3, 1.0), initial=[block.x == 0])
    assert good.span == (0.3, 1.0) and [c.label for c in good.initial] == ["block.x == 0"]
    with pytest.raises(mbd.ModelError, match=r"phase 'swing': duration must be positive.*got -1"):
        Phase("swing", mechanism, -1)
    with pytest.raises(mbd.ModelError, match="name"):
        Phase("", mechanism, 1)
    with pytest.raises(mbd.ConditionError, match="relation"):
        Phase("swing", mechanism, 1, path=[block.x])
    with pytest.raises(mbd.ModelError, match="Mechanism"):
        Phase("swing", None, 1)


@pytest.mark.slow
def test_the_solution_of_a_phase():
    """Its mesh, cut into segments by waypoints, its motion, and its limits."""
    f = crank_rocker()
    via = [mbd.Waypoint(0.2, [f.o2.angle == 1.5]), mbd.Waypoint((0.3, 0.5), [])]
    solution = mbd.optimize(half_turn(f, waypoints=via, path=[mbd.bounded(-4, f.tau, 4)]), intervals=12)
    (part,) = solution.phases
    assert part.phase is solution.problem.phases[0] and len(part.mesh.segments) == 3
    assert part.segment_times[[0, 1, 3]] == pytest.approx([0.0, 0.2, 0.6])
    assert np.array_equal(part.mesh_times, solution.mesh) and np.array_equal(solution.mesh_times, solution.mesh)
    assert part.mesh.count == solution.mesh.size - 1 == 12 and solution.meshes == (part.mesh,)
    assert part.trajectory is solution.trajectory and part.duration == solution.duration
    assert solution.mesh_error == part.mesh_error > 0
    labels = [limit.label for limit in part.limits]
    assert labels == ["-4 <= tau", "tau <= 4", "tau >= -20", "tau <= 20"]
    program = solution.program
    np.testing.assert_array_equal(program.lower, [row.lower for row in program.rows])
    assert np.any(np.isfinite(program.lower) & (program.lower < 0)), "limits of both sides are one row"


def test_a_program_of_two_phases():
    """Side by side, with boundary conditions between the start of the first and the end of the last."""
    problem, u, block = rest_to_rest(3.0, 2.0)
    problem = problem.replace(boundary=[mbd.at_end(block.x) == 2 * mbd.at_start(block.x) + mbd.integral(u**2)])
    settings = Settings.read("gauss-legendre", 3, "polynomial", None, False)
    solver = ProblemSolver(problem, settings)
    (setup,) = solver.setups
    mesh, finer = Mesh.equal(3, setup.path.segment_times), Mesh.equal(5, setup.path.segment_times)
    one, other = (CollocationProgram(problem, [setup], [m]) for m in (mesh, finer))
    both = CollocationProgram(problem, [setup, setup], [mesh, finer])
    assert both.size == one.size + other.size
    random, p = np.random.default_rng(0), solver.setups[0].numeric.p
    x, y = random.standard_normal(one.size), random.standard_normal(other.size)
    times = setup.path.segment_times
    data = [q.data([p], [m], [times]) for q, m in ((one, mesh), (other, finer))]
    first, second = (q.nlp.evaluate(v, d) for q, v, d in ((one, x, data[0]), (other, y, data[1])))
    cost, rows = both.nlp.evaluate(np.r_[x, y], both.data([p, p], [mesh, finer], [times, times]))
    assert float(cost) * both.cost_scale == pytest.approx(
        float(first[0]) * one.cost_scale + float(second[0]) * other.cost_scale, rel=1e-12
    )
    by_phase = [
        [k for k, row in enumerate(both.rows) if row.phase == n and row.label[:8] != "boundary"] for n in (0, 1)
    ]
    np.testing.assert_allclose(rows.full()[by_phase[0]], first[1].full()[:-1], rtol=1e-12)
    np.testing.assert_allclose(rows.full()[by_phase[1]], second[1].full()[:-1], rtol=1e-12)
    labels = [row.label for row in both.rows]
    assert labels[-1].startswith("boundary: at_end(block.x) == ") and labels.count("final: block.x == 3") == 2
    jacobian = both.nlp.derivatives["jac_g"](np.r_[x, y], both.data([p, p], [mesh, finer], [times, times]))[1].full()
    assert not np.any(jacobian[by_phase[0], one.size :]) and not np.any(jacobian[by_phase[1], : one.size])
    touched = np.flatnonzero(jacobian[-1])
    assert touched.min() < one.phases[0].point_size and touched.max() >= both.size - other.phases[0].point_size


def test_contradictions_name_their_phase():
    """Of conditions at the start, at the end and on the way, of limits, and of states; without phases there is none."""
    problem, _, block = rest_to_rest()
    mechanism = problem.mechanism
    first = Phase("come", mechanism, 1.0, initial=[block.x == 0, block.vx == 0])
    twice, beyond = [block.x == 1, block.x == 2], mbd.assemble(mechanism, [block.x == 3])

    def refused(words, **more):
        with pytest.raises(mbd.ConditionError, match=rf"^phase 'go': {words}"):
            mbd.optimize(mbd.OptimalControlProblem(phases=[first, Phase("go", mechanism, 1.0, **more)]))

    refused("final: the conditions contradict each other", final=twice)
    refused("initial: the conditions contradict each other", initial=twice)
    refused("waypoint 1: the conditions contradict each other", waypoints=[mbd.Waypoint(0.5, twice)])
    refused("path: .* contradict each other by 1", path=[block.x >= 2, block.x <= 1])
    refused("final: .* is already decided by the constraints", final=[block.y == 0])
    refused("final: the conditions contradict the path condition", final=[block.x == 3], path=[block.x <= 2])
    refused("final: the state contradicts the path condition", final=beyond, path=[block.x <= 2])
    with pytest.raises(mbd.ConditionError, match=r"^final: the conditions contradict each other"):
        problem.replace(final=twice)


def test_phases_that_do_not_meet_are_named():
    """The end of one and the start of the next are one place."""
    problem, _, block = rest_to_rest()
    first = Phase("come", problem.mechanism, 1.0, initial=[block.x == 0], final=[block.x == 1])
    apart = mbd.OptimalControlProblem(phases=[first, Phase("go", problem.mechanism, 1.0, initial=[block.x == 2])])
    with pytest.raises(mbd.OptimizationError, match="the end of phase 'come' is out of reach.*in phase 'go'"):
        mbd.optimize(apart)
