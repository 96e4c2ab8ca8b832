"""Fine meshes are solved from the solution on a coarse one; if that is not found, from the guess itself."""

import numpy as np
import pytest
from motions import four_bar, rest_to_rest

import mbdcasadi as mbd
from mbdcasadi.optimal_control.search import search
from mbdcasadi.optimal_control.search.budgets import Budgets
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver
from mbdcasadi.optimal_control.transcription.mesh import Mesh


@pytest.fixture
def counts(monkeypatch):
    """Numbers of intervals that were solved for, in their order."""
    seen, solve = [], ProblemSolver.solve

    def recorded(self, meshes, guess, **how):
        seen.append([mesh.count for mesh in meshes])
        return solve(self, meshes, guess, **how)

    monkeypatch.setattr(ProblemSolver, "solve", recorded)
    return seen


@pytest.mark.slow
def test_the_optimum_is_that_of_the_fine_mesh(counts, monkeypatch):
    """Costs, torques and costates are those from the guess itself: both meet the same conditions of optimality."""
    problem, torque, crank = four_bar()
    found = mbd.optimize(problem, intervals=160)
    assert counts == [[40], [160]] and found.mesh.size == 161
    counts.clear()
    monkeypatch.setattr(search, "FINE", 1000)
    direct = mbd.optimize(problem, intervals=160)
    assert counts == [[160]]
    assert found.cost == pytest.approx(direct.cost, rel=1e-8)
    peak = np.max(np.abs(direct.trajectory[torque]))
    np.testing.assert_allclose(found.trajectory[torque], direct.trajectory[torque], atol=1e-5 * peak)
    np.testing.assert_allclose(found.trajectory[crank.phi], direct.trajectory[crank.phi], atol=1e-6)


def test_the_closed_form_in_two_segments(counts):
    """A metre in a second from rest to rest costs 12 N²s; each segment has its share of the coarse mesh."""
    problem, _, block = rest_to_rest()
    whole = mbd.optimize(problem, intervals=200)
    assert whole.cost == pytest.approx(12, rel=1e-9)
    through = problem.replace(waypoints=[mbd.Waypoint(0.2, [block.x == 0.104])])  # 3 t² - 2 t³
    solution = mbd.optimize(through, intervals=200)
    assert solution.cost == pytest.approx(12, rel=1e-9)
    assert counts == [[40], [200]] * 2
    assert solution.meshes[0].counts == (40, 160)


def test_the_mesh_of_a_share():
    """Segments keep an interval at least; that of an instant has none."""
    mesh = Mesh((np.linspace(0, 1, 101), np.linspace(0, 1, 3)))
    assert mesh.resized(0.2).counts == (20, 1)
    assert mesh.resized(1.25).counts == (125, 2)
    assert Mesh.instant().resized(0.2).count == 0


@pytest.mark.slow
def test_without_success_on_the_coarse_mesh_the_guess_is_taken(counts, monkeypatch):
    """Too many iterations from the coarse solution: the fine mesh is solved from the guess."""
    problem, *_ = four_bar()
    monkeypatch.setattr(search, "BUDGETS", Budgets(fine=1))
    solution = mbd.optimize(problem, intervals=160)
    assert counts == [[40], [160], [160]] and solution.mesh_error < 1e-6
    monkeypatch.setattr(search, "FINE", 1000)
    assert solution.cost == pytest.approx(mbd.optimize(problem, intervals=160).cost, rel=1e-8)
