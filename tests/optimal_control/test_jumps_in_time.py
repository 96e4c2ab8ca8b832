"""Costs, limits and forces that jump or bend in time: mesh points are put there, and costs are right to the tolerance.

A block of 1 kg moves from rest to rest with the least integral of w u². With costates that are linear in time, u is
(a + b t) / w within its limits; a and b are found here by Newton's method, with integrals from break to break.
"""

import itertools
import warnings

import numpy as np
import pytest
from motions import rest_to_rest
from scipy.optimize import brentq, fsolve, minimize, minimize_scalar
from test_refinement import motor_at_rest, work_by_hand

import mbdcasadi as mbd

POINTS, WEIGHTS = np.polynomial.legendre.leggauss(24)


def integral(function, begin, end):
    """Integral by Gauss's rule on eight pieces."""
    edges = np.linspace(begin, end, 9)
    t = (edges[:-1, None] + edges[1:, None]) / 2 + np.diff(edges)[:, None] / 2 * POINTS
    return np.sum(function(t) @ WEIGHTS * np.diff(edges) / 2)


def least_effort(duration, distance, pieces, pushed=(0.0, 0.0)):
    """Least integral of w u²: of pieces (end, weight, limit); what other forces add to speed and distance is given."""
    pieces = [(begin, *rest) for begin, rest in zip([0.0, *(p[0] for p in pieces)], pieces, strict=False)]

    def sums(z):
        total = np.zeros(3)
        for begin, end, weight, limit in pieces:

            def free(t, weight=weight):
                return (z[0] + z[1] * (duration - t)) / weight(t)

            grid, edges = np.linspace(begin, end, 200), [begin, end]
            for side in (-limit, limit) if np.isfinite(limit) else ():
                places = np.flatnonzero(np.diff(np.sign(free(grid) - side)))
                edges += [brentq(lambda t, side=side: free(t) - side, grid[i], grid[i + 1]) for i in places]

            def u(t, free=free, limit=limit):
                return np.clip(free(t), -limit, limit)

            for low, high in itertools.pairwise(sorted(edges)):
                total += [
                    integral(u, low, high),
                    integral(lambda t, u=u: u(t) * (duration - t), low, high),
                    integral(lambda t, u=u, weight=weight: weight(t) * u(t) ** 2, low, high),
                ]
        return total

    wanted = np.array([0.0, distance]) - pushed
    for size in (1.0, 3.0, 10.0):
        z = fsolve(lambda z: sums(z)[:2] - wanted, size * np.array([-6.0, 12.0]) * distance, xtol=1e-14)
        if np.allclose(sums(z)[:2], wanted, atol=1e-9):
            return sums(z)[2]
    raise AssertionError("no optimum found by hand")


def constant(weight):
    return lambda t: weight + 0 * t


def solved(problem, **arguments):
    """The solution, found without a warning."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return mbd.optimize(problem, **arguments)


def weighted(duration, distance, times, weights, limit=np.inf, **more):
    """Least effort with a weight that jumps at times."""
    weight = weights[-1]
    for time, before in zip(times[::-1], weights[-2::-1], strict=True):
        weight = mbd.if_else(mbd.t < time, before, weight)
    problem, u, block = rest_to_rest(distance, duration, lower=-limit, upper=limit)
    return problem.replace(running_cost=weight * u**2, **more), u, block


@pytest.mark.parametrize("tolerance", [1e-4, 1e-5, 1e-6, 1e-7])
@pytest.mark.parametrize("limit", [2.0, 100.0])
def test_a_weight_that_jumps(limit, tolerance):
    """The cost was found 4e-4 below its optimum at 1e-4."""
    problem, *_ = weighted(2.0, 1.0, [0.37], [1.0, 5.0], limit)
    exact = least_effort(2.0, 1.0, [(0.37, constant(1.0), limit), (2.0, constant(5.0), limit)])
    solution = solved(problem, tolerance=tolerance)
    assert solution.cost == pytest.approx(exact, rel=tolerance / 10)
    assert 0.37 in solution.mesh


def test_a_time_that_is_a_parameter():
    """The mesh point is at the value that the parameter has in the solve."""
    late = mbd.Parameter("late", 0.3)
    u = mbd.Input("u")
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (u, 0))
    mechanism = mbd.Mechanism([block], [guide], forces=[push], inputs=[u], parameters=[late])
    problem = mbd.OptimalControlProblem(
        mechanism,
        1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=mbd.if_else(mbd.t < 2 * late, 1, 3) * u**2,
    )
    for value in (0.3, 0.21):
        solution = solved(problem, tolerance=1e-6, parameters={late: value})
        exact = least_effort(1.0, 1.0, [(2 * value, constant(1.0), np.inf), (1.0, constant(3.0), np.inf)])
        assert solution.cost == pytest.approx(exact, rel=1e-7)


def test_mesh_points_that_move_beside_one_that_stays():
    """Inputs leave their limits between the jumps, at mesh points that move on the way to the solution."""
    times, weights, limit = [0.31, 0.77], [1.0, 4.0, 0.5], 5.0
    problem, *_ = weighted(1.0, 1.0, times, weights, limit)
    ends = [*times, 1.0]
    exact = least_effort(1.0, 1.0, [(end, constant(w), limit) for end, w in zip(ends, weights, strict=True)])
    solution = solved(problem, tolerance=1e-6)
    assert solution.cost == pytest.approx(exact, rel=1e-7)
    assert np.all(np.min(np.abs(solution.mesh - np.array(times)[:, None]), axis=1) < 1e-9)
    assert len(solution.meshes[0].pinned) == 2


def test_a_mesh_point_that_stays_is_saved(tmp_path):
    """The mesh of a solution with a free end is the same when it is read."""
    problem, *_ = weighted(1.0, 1.0, [0.4], [1.0, 3.0])
    free = problem.replace(duration=(0.2, 4.0), running_cost=problem.running_cost + 10)
    solution = solved(free, tolerance=1e-6)
    solution.save(tmp_path / "one.npz")
    assert solution.meshes[0].pinned
    mesh, read = solution.meshes[0], mbd.read_solution(tmp_path / "one.npz", free).meshes[0]
    assert read.structure == mesh.structure and read.pinned == mesh.pinned
    assert np.allclose(read.positions, mesh.positions, rtol=1e-13)


@pytest.mark.parametrize("weights", [(1.0, 3.0), (2.0, 0.7)])
def test_a_jump_with_a_free_end(weights):
    """The mesh point keeps its time, whatever the duration: by a search for the best duration of closed forms."""
    rate, jump = 10.0, 0.6

    def whole(duration):
        pieces = [(min(jump, duration), constant(weights[0]), np.inf)]
        pieces += [(duration, constant(weights[1]), np.inf)] if duration > jump else []
        return rate * duration + least_effort(duration, 1.0, pieces)

    exact = minimize_scalar(whole, bounds=(0.8, 3.0), method="bounded", options={"xatol": 1e-9}).fun
    problem, *_ = weighted(1.5, 1.0, [jump], weights)
    solution = solved(problem.replace(duration=(0.2, 6.0), running_cost=problem.running_cost + rate), tolerance=1e-6)
    assert solution.cost == pytest.approx(exact, rel=1e-7)
    assert np.min(np.abs(solution.mesh - jump)) < 1e-9


@pytest.mark.parametrize("degree", [3, 5])
def test_a_weight_with_a_corner(degree):
    """An input reaches its limit in an interval alone between two mesh points that move: off by 7 tolerances before."""
    duration, distance, corner, slope, limit = 2.846157, 0.3027662, 2.3632906, 14.3472667, 0.6827876

    def weight(t):
        return 0.1 + slope * np.abs(t - corner)

    problem, u, _ = rest_to_rest(distance, duration, lower=-limit, upper=limit)
    away = mbd.if_else(mbd.t < corner, corner - mbd.t, mbd.t - corner)
    problem = problem.replace(running_cost=(0.1 + slope * away) * u**2)
    solution = mbd.optimize(problem, degree=degree, tolerance=1e-5)
    exact = least_effort(duration, distance, [(corner, weight, limit), (duration, weight, limit)])
    assert solution.cost == pytest.approx(exact, rel=1e-6)


def test_a_limit_that_jumps():
    """The limits of a force are 5 N before 0.43 s and 8 N afterwards."""
    problem, u, _ = rest_to_rest(1.0, 1.0)
    most = mbd.if_else(mbd.t < 0.43, 5.0, 8.0)
    solution = solved(problem.replace(path=[u <= most, u >= -most]), tolerance=1e-6)
    exact = least_effort(1.0, 1.0, [(0.43, constant(1.0), 5.0), (1.0, constant(1.0), 8.0)])
    assert solution.cost == pytest.approx(exact, rel=1e-7)


def test_a_force_that_jumps():
    """A wind of 2 N turns to -3 N at 0.37 s; the limits hold at both ends."""
    u = mbd.Input("u", lower=-6.0, upper=6.0)
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (u + mbd.if_else(mbd.t < 0.37, 2, -3), 0))
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([block], [guide], forces=[push], inputs=[u]),
        1.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=u**2,
    )
    blown = 2 * 0.37 - 3 * 0.63, 2 * (0.37 - 0.37**2 / 2) - 3 * 0.63**2 / 2
    exact = least_effort(1.0, 1.0, [(1.0, constant(1.0), 6.0)], blown)
    assert solved(problem, tolerance=1e-7).cost == pytest.approx(exact, rel=1e-7)


def test_continuous_inputs_at_a_jump():
    """Hermite-Simpson has values at the mesh points: two of these lie around the jump."""
    problem, *_ = weighted(1.0, 1.0, [0.37], [1.0, 5.0])
    exact = least_effort(1.0, 1.0, [(0.37, constant(1.0), np.inf), (1.0, constant(5.0), np.inf)])
    solution = solved(problem, tolerance=1e-4, transcription="hermite-simpson")
    assert solution.cost == pytest.approx(exact, rel=1e-5)


def test_a_controller_keeps_its_intervals():
    """A force that is constant on intervals: a weight that jumps within one of them is reported."""
    problem, *_ = weighted(1.0, 1.0, [0.37], [1.0, 5.0])
    with pytest.warns(mbd.MechanismWarning, match="integral of the running cost"):
        solution = mbd.optimize(problem, intervals=20, control="constant", tolerance=1e-6)
    assert solution.mesh.size == 21


def test_a_mesh_on_which_moving_points_fail():
    """Inputs that leave their limits: mesh points that move are led astray, and stay where they are once that fails."""
    duration, distance, limit = 1.4775348, 1.4333798, 3.84438756
    problem, *_ = rest_to_rest(distance, duration, lower=-limit, upper=limit)
    exact = least_effort(duration, distance, [(duration, constant(1.0), limit)])
    assert mbd.optimize(problem, intervals=15, tolerance=1e-7).cost == pytest.approx(exact, rel=2e-7)


def test_a_cost_that_jumps_with_the_motion_is_reported():
    """Its derivatives do not show what another time of the jump is worth; phases find that."""
    problem, u, block = rest_to_rest(1.0, 1.5)
    jumping = problem.replace(running_cost=mbd.if_else(block.x < 0.3, 1.0, 4.0) * u**2)
    with pytest.warns(mbd.MechanismWarning, match=r"may be off by more than the tolerance 1e-06: running_cost jumps"):
        imprecise = mbd.optimize(jumping, tolerance=1e-6)

    def effort(x, start, end, time):
        """Least effort over a distance, from one speed to another."""
        return 4 * (3 * x**2 / time**2 - 3 * x * (start + end) / time + start**2 + start * end + end**2) / time

    def whole(at):
        return effort(0.3, 0.0, at[1], at[0]) + 4 * effort(0.7, at[1], 0.0, 1.5 - at[0])

    exact = minimize(whole, [0.6, 1.0], method="Nelder-Mead", options={"xatol": 1e-10, "fatol": 1e-12}).fun
    before = mbd.Phase("before", problem.mechanism, (0.1, 1.4), problem.initial, [block.x == 0.3], running_cost=u**2)
    after = mbd.Phase("after", problem.mechanism, (0.1, 1.4), final=problem.final, running_cost=4 * u**2)
    both = mbd.OptimalControlProblem(phases=[before, after], boundary=[before.duration + after.duration == 1.5])
    assert solved(both, tolerance=1e-6).cost == pytest.approx(exact, rel=1e-7)
    assert imprecise.cost > exact * (1 + 1e-6)


def test_a_cost_that_bends_with_the_motion_is_not_reported():
    """The square of a positive part has derivatives."""
    problem, u, block = rest_to_rest(1.0, 1.5)
    fast = block.vx - 0.5
    problem = problem.replace(running_cost=u**2 + mbd.if_else(fast > 0, fast**2, 0))
    solved(problem, tolerance=1e-5)


def test_work_of_a_motor_by_hermite_simpson():
    """A voltage at both ends and in the middle of an interval moves the current unseen: -0.065 J for 0.178 J."""
    electric = {"constant": 0.7, "resistance": 1.5, "inductance": 0.06}
    wheel = mbd.Body("wheel", mass=1.0, inertia=0.05)
    shaft = mbd.Revolute("shaft", mbd.ground.at(0, 0), wheel.at(0, 0))
    problem = motor_at_rest(wheel, shaft, 1.0, 1.2, 12.0, **electric)
    exact = work_by_hand(0.05, 1.0, 1.2, 12.0, **electric)
    solution = mbd.optimize(problem, intervals=40, transcription="hermite-simpson")
    assert solution.cost == pytest.approx(exact, rel=0.02)


def test_jumps_in_two_phases():
    """Time goes on from phase to phase: a weight jumps in the second one, which begins where the first one ends."""
    u = mbd.Input("u")
    block = mbd.Body("block", mass=1.0, inertia=1.0)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (u, 0))
    mechanism = mbd.Mechanism([block], [guide], forces=[push], inputs=[u])
    cost = mbd.if_else(mbd.t < 0.67, 1, 3) * u**2
    first = mbd.Phase("first", mechanism, 0.4, initial=[block.x == 0, block.vx == 0], running_cost=cost)
    second = mbd.Phase("second", mechanism, 0.6, final=[block.x == 1, block.vx == 0], running_cost=cost)
    solution = solved(mbd.OptimalControlProblem(phases=[first, second]), tolerance=1e-6)
    exact = least_effort(1.0, 1.0, [(0.67, constant(1.0), np.inf), (1.0, constant(3.0), np.inf)])
    assert solution.cost == pytest.approx(exact, rel=1e-7)
