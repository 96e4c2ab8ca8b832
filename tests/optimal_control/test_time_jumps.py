"""Costs, limits and forces that jump or bend in time: mesh points are put there, and costs are right to the tolerance.

A block of 1 kg moves from rest to rest with the least integral of w u². With costates that are linear in time, u is
(a + b t) / w within its limits; a and b are found here by Newton's method, with integrals from break to break.
"""

import itertools
import warnings

import numpy as np
import pytest
from motions import guided_block, rest_to_rest
from scipy.optimize import brentq, fsolve, minimize, minimize_scalar
from test_refine import motor_at_rest, work_by_hand

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


def priced(jump, before, after, duration=(0.2, 6.0), weight=1.0):
    """Least effort and time, whose price per second jumps."""
    problem, u, _ = rest_to_rest(1.0, 1.5)
    price = mbd.if_else(mbd.t < jump, before, after)
    return problem.replace(duration=duration, running_cost=weight * u**2 + price)


@pytest.mark.parametrize(("jump", "before", "after"), [(0.8, 5.0, 60.0), (1.0, 5.0, 20.0)])
@pytest.mark.parametrize("tolerance", [None, 1e-6])
def test_a_price_that_jumps_before_a_free_end(jump, before, after, tolerance):
    """The cost jumps with the duration as stages pass the time: the solver ran out of iterations."""
    best = (36 / after) ** 0.25
    exact = 12 / best**3 + before * jump + after * (best - jump)
    solution = solved(priced(jump, before, after), tolerance=tolerance)
    assert solution.cost == pytest.approx(exact, rel=1e-7)
    assert np.min(np.abs(solution.mesh - jump)) < 1e-9


def test_the_best_end_is_at_a_jump():
    """Later each second costs 200: the end comes up to the jump, and what is left to it is reported if it counts."""
    exact = 12 / 0.9**3 + 5 * 0.9
    assert solved(priced(0.9, 5.0, 200.0), tolerance=1e-4).cost == pytest.approx(exact, rel=1e-4)
    with pytest.warns(mbd.MechanismWarning, match=r"integral of the running cost, .* at t = 0.900001 s most"):
        assert mbd.optimize(priced(0.9, 5.0, 200.0), tolerance=1e-6).cost == pytest.approx(exact, rel=2e-5)


@pytest.mark.parametrize("tolerance", [None, 1e-6])
@pytest.mark.parametrize("time", [0.6, 5.0])
def test_an_end_passes_a_mesh_point_of_the_guess(time, tolerance):
    """The mesh point of a guess at 0.6 s kept the end behind it, where one second costs so much: 1256 for 977."""
    late, rate = mbd.Parameter("late", 0.6), mbd.Parameter("rate", 10.0)
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u, parameters=[late, rate])
    problem = mbd.OptimalControlProblem(
        mechanism,
        (0.05, 4.0),
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=mbd.if_else(mbd.t < late, 1, 3) * u**2 + rate,
    )
    guess = solved(problem, tolerance=1e-6)
    assert guess.meshes[0].pinned
    solution = solved(problem, guess=guess, parameters={rate: 2000.0, late: time}, tolerance=tolerance)
    best = (36 / 2000) ** 0.25
    assert solution.cost == pytest.approx(12 / best**3 + 2000 * best, rel=1e-8)


def test_jumps_nearer_than_mesh_points_that_move():
    """Two jumps within 0.1 µs, and one as near to the start, with a free end: no mesh was found."""
    for jumps, weights in (([0.4, 0.4 + 1e-7], [1.0, 50.0, 3.0]), ([1e-7, 0.4], [5.0, 1.0, 3.0])):
        problem, *_ = weighted(1.5, 1.0, jumps, weights)
        solution = solved(problem.replace(duration=(0.2, 6.0), running_cost=problem.running_cost + 10), tolerance=1e-5)

        def whole(duration):
            return 10 * duration + least_effort(
                duration, 1.0, [(0.4, constant(1.0), np.inf), (duration, constant(3.0), np.inf)]
            )

        exact = minimize_scalar(whole, bounds=(0.8, 3.0), method="bounded", options={"xatol": 1e-9}).fun
        assert solution.cost == pytest.approx(exact, rel=2e-6)


def test_an_integral_whose_weight_jumps():
    """A cost at the end that is an integral, and its square: off by 9 and 17 tolerances in silence."""
    problem, u, _ = rest_to_rest(1.0, 1.0)
    effort = mbd.integral(mbd.if_else(mbd.t < 0.37, 1, 5) * u**2)
    exact = least_effort(1.0, 1.0, [(0.37, constant(1.0), np.inf), (1.0, constant(5.0), np.inf)])
    for power in (1, 2):
        found = solved(problem.replace(running_cost=0, terminal_cost=effort**power), tolerance=1e-6)
        assert found.cost == pytest.approx(exact**power, rel=1e-7)


def test_a_jump_at_a_time_that_is_free_is_reported():
    """Its time goes to a limit, since the solver does not see what the weight is worth: 6% above the optimum."""
    problem, u, _ = rest_to_rest(1.0, 1.0)
    at = mbd.Parameter("at", 0.4, lower=0.1, upper=0.9)
    problem = problem.replace(
        running_cost=mbd.if_else(mbd.t < at, 1, 3) * u**2, free_parameters=[at], terminal_cost=40 * at**2
    )
    with pytest.warns(mbd.MechanismWarning, match=r"running_cost jumps .* where at - t passes zero"):
        mbd.optimize(problem, tolerance=1e-4)


@pytest.mark.parametrize(("before", "after", "x0", "duration"), [(1.0, -1.0, 0.6, 1.5), (-5.0, 0.0, 0.5, 2.0)])
def test_a_force_that_jumps_with_the_motion_is_reported(before, after, x0, duration):
    """The effort was off by 1.5% and 16% in silence; phases with the force of their own side find it."""
    u = mbd.Input("u")
    block = mbd.Body("block", mass=1.0, inertia=0.01)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))

    def blown(wind):
        push = mbd.Force("push", block.at(0, 0), (u + wind, 0))
        return mbd.Mechanism([block], [guide], forces=[push], inputs=[u])

    start, end = [block.x == 0, block.vx == 0], [block.x == 1, block.vx == 0]
    jumping = mbd.OptimalControlProblem(
        blown(mbd.if_else(block.x < x0, before, after)), duration, initial=start, final=end, running_cost=u**2
    )
    with pytest.warns(mbd.MechanismWarning, match=r"force 'push' jumps .* where .* passes zero"):
        imprecise = mbd.optimize(jumping, tolerance=1e-6)
    first = mbd.Phase("first", blown(before), (0.1, 1.9), start, [block.x == x0], running_cost=u**2)
    second = mbd.Phase("second", blown(after), (0.1, 1.9), final=end, running_cost=u**2)
    both = mbd.OptimalControlProblem(phases=[first, second], boundary=[first.duration + second.duration == duration])

    def effort(x, begin, finish, time, wind):
        """Least integral of the square of the acceleration without the wind, over a distance between two speeds."""
        whole = 4 * (3 * x**2 / time**2 - 3 * x * (begin + finish) / time + begin**2 + begin * finish + finish**2)
        return whole / time - 2 * wind * (finish - begin) + wind**2 * time

    exact = minimize(
        lambda at: effort(x0, 0.0, at[1], at[0], before) + effort(1 - x0, at[1], 0.0, duration - at[0], after),
        [0.7, 1.0],
        method="Nelder-Mead",
        options={"xatol": 1e-10, "fatol": 1e-12},
    ).fun
    assert solved(both, tolerance=1e-6).cost == pytest.approx(exact, rel=1e-7)
    assert imprecise.cost > exact * 1.01


@pytest.mark.parametrize("side", ["start", "end", "rest"])
def test_a_border_that_a_motion_only_comes_to_is_not_reported(side):
    """It begins or ends at the border, with no jump on its way."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    other = {"start": block.x < 0, "end": block.x > 1, "rest": block.vx < 0}[side]
    found = solved(problem.replace(running_cost=mbd.if_else(other, 100, 1) * u**2), tolerance=1e-6)
    assert found.cost == pytest.approx(12.0, rel=1e-8)


@pytest.mark.parametrize(
    "weight",
    [
        lambda block: mbd.if_else(mbd.t < 0.2, mbd.if_else(block.x < 0.5, 1, 2), 3),
        lambda block: 2 + mbd.atan2(block.x - 0.5, 1 + block.vx),
        lambda block: 1 + mbd.if_else(block.x > 0.5, 4 * (block.x - 0.5) ** 2, 0),
    ],
    ids=["behind another condition", "an angle within its range", "a bend"],
)
def test_what_does_not_jump_on_the_way_is_not_reported(weight):
    """The border is passed, and nothing jumps there."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    solved(problem.replace(running_cost=weight(block) * u**2), tolerance=1e-5)


@pytest.mark.parametrize("duration", [1.0, (0.5, 1.0)])
def test_a_jump_at_a_fixed_time_is_no_kink(duration):
    """A motion that is impossible is not blamed on a weight whose time no solver changes."""
    problem, u, _ = rest_to_rest(1.0, 1.0, lower=-1.0, upper=1.0)
    problem = problem.replace(duration=duration, running_cost=mbd.if_else(mbd.t < 0.3, 1, 2) * u**2)
    with pytest.raises(mbd.OptimizationError) as caught:
        mbd.optimize(problem)
    assert ("kink" in str(caught.value)) is (duration != 1.0)


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_a_jump_beside_a_free_change_of_phases(transcription):
    """Half the way in a time that is free, with weights that jump in time in both phases: no solution was found."""
    jump, weights = 0.5617, [[2.172, 7.913], [0.114, 5.338]]

    def effort(begin, end, start, last, pieces):
        """Least integral of w u² over 0.5 m, from one speed to another: u is (a + b t) / w."""
        i = [sum((q ** (k + 1) - p ** (k + 1)) / (k + 1) / w for p, q, w in pieces) for k in range(3)]
        rows = np.array([[i[0], i[1]], [end * i[0] - i[1], end * i[1] - i[2]]])
        a, b = np.linalg.solve(rows, [last - start, 0.5 - start * (end - begin)])
        return a * a * i[0] + 2 * a * b * i[1] + b * b * i[2]

    def whole(at):
        time, speed = at
        first = effort(0.0, time, 0.0, speed, [(0.0, time, weights[0][0])])
        return first + effort(time, 1.0, speed, 0.0, [(time, jump, weights[1][0]), (jump, 1.0, weights[1][1])])

    exact = minimize(whole, [0.42, 1.5], method="Nelder-Mead", options={"xatol": 1e-11, "fatol": 1e-13}).fun
    u = mbd.Input("u")
    block, mechanism = guided_block(1.0, u)
    costs = [mbd.if_else(mbd.t < jump, *pair) * u**2 for pair in weights]
    first = mbd.Phase(
        "first", mechanism, (0.01, 0.99), [block.x == 0, block.vx == 0], [block.x == 0.5], running_cost=costs[0]
    )
    second = mbd.Phase("second", mechanism, (0.01, 0.99), final=[block.x == 1, block.vx == 0], running_cost=costs[1])
    both = mbd.OptimalControlProblem(phases=[first, second], boundary=[first.duration + second.duration == 1])
    solution = solved(both, tolerance=1e-5, transcription=transcription)
    assert solution.cost == pytest.approx(exact, rel=1e-5)


@pytest.mark.parametrize("transcription", ["gauss-legendre", "hermite-simpson"])
def test_the_best_duration_between_two_stages_is_left(transcription):
    """Without a tolerance: Hermite-Simpson ended at 1.14 s, where the jump passes from stage to stage, with 32.3."""
    best = (36 / 60) ** 0.25
    exact = 12 / best**3 + 5 * 0.8 + 60 * (best - 0.8)
    assert solved(priced(0.8, 5.0, 60.0), transcription=transcription).cost == pytest.approx(exact, rel=1e-5)


@pytest.mark.filterwarnings("ignore:the local errors meet the tolerance")
def test_a_dearer_motion_with_smaller_errors_is_not_kept():
    """Points that move lead to inputs that fit better at a cost 3.7% higher, though the motion before has its cost."""
    duration, distance, limit, tolerance = 2.1997415366830877, 0.3234982677539545, 0.3140503878866202, 4.2589e-5
    jump, weights = 1.1461372421667544, [0.16392754946114202, 5.994586553225691]
    problem, *_ = weighted(duration, distance, [jump], weights, limit)
    pieces = [(jump, constant(weights[0]), limit), (duration, constant(weights[1]), limit)]
    exact = least_effort(duration, distance, pieces)
    solution = mbd.optimize(problem, tolerance=tolerance, transcription="hermite-simpson")
    assert solution.cost == pytest.approx(exact, rel=2 * tolerance)
