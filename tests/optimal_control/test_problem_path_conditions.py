"""What holds all along: equalities, inequalities, limits on both sides, of inputs, states, positions, reactions."""

import numpy as np
import pytest
from motions import crank_rocker, half_turn, rest_to_rest

import mbdcasadi as mbd

SCHEMES = ["gauss-legendre", "hermite-simpson"]


@pytest.mark.slow
@pytest.mark.parametrize("limit", [1 / 5, 1 / 8, 1 / 10])
def test_bryson_and_denham(limit):
    """x <= l with x' = 1, -1 at the ends: the integral of u² is 4 + 12 (1 - 4 l)², or 8 / (9 l) for l <= 1/6."""
    problem, _u, block = rest_to_rest()
    bounded = problem.replace(
        initial=[block.x == 0, block.vx == 1], final=[block.x == 0, block.vx == -1], path=[block.x <= limit]
    )
    solution = mbd.optimize(bounded, intervals=60)
    exact = 8 / (9 * limit) if limit <= 1 / 6 else 4 + 12 * (1 - 4 * limit) ** 2
    assert solution.cost == pytest.approx(exact, rel=2e-3)
    assert np.max(solution.trajectory[block.x]) < limit + 1e-4
    slope = -8 / (9 * limit**2) if limit <= 1 / 6 else -96 * (1 - 4 * limit)
    costate = solution.costates[f"block.x <= {limit:g}"]
    assert -np.sum(costate * np.diff(solution.mesh)) == pytest.approx(slope, rel=0.02)


@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_limited_speed(transcription):
    """The force falls linearly to zero at t1 = 1.5 (T - d / V), the block coasts: cost 8 V² / (3 t1)."""
    problem, u, block = rest_to_rest(1.0, 1.0)
    limited = problem.replace(path=[mbd.bounded(-1.25, block.vx, 1.25)])
    solution = mbd.optimize(limited, intervals=40, transcription=transcription)
    t1 = 1.5 * (1 - 1 / 1.25)
    assert solution.cost == pytest.approx(8 * 1.25**2 / (3 * t1), rel=1e-3)
    motion = solution.trajectory.at(np.linspace(t1 + 0.05, 0.95 - t1, 11))
    assert np.allclose(motion[block.vx], 1.25, atol=1e-3) and np.max(np.abs(motion[u])) < 0.5
    active = next(a for a in solution.active_limits if a.label == "block.vx <= 1.25")
    assert active.spans[0][0] == pytest.approx(t1, abs=0.06) and active.spans[-1][1] == pytest.approx(1 - t1, abs=0.06)
    assert not any("-1.25" in a.label for a in solution.active_limits)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
def test_limits_of_an_input_hold(transcription, control):
    """A limit below the peak 6 d / T²: never passed where it is held, and the force is at it at both ends."""
    problem, u, _block = rest_to_rest(1.0, 1.0, lower=-5, upper=5)
    solution = mbd.optimize(problem, intervals=20, transcription=transcription, control=control)
    # force F until t1, then linear through zero at T / 2: F T²/4 - F (T/2 - t1)² / 3 = d
    rest = np.sqrt(3 * (5 / 4 - 1) / 5)
    exact = 2 * 25 * ((0.5 - rest) + rest / 3)
    assert solution.cost == pytest.approx(exact, rel=4e-3 if control == "constant" else 1e-3)
    assert np.max(np.abs(solution.trajectory[u])) < 5 + 1e-6
    assert solution.trajectory.at([0.0])[u] == pytest.approx([5], abs=1e-3)
    assert {a.label for a in solution.active_limits} == {"u <= 5", "u >= -5"}


@pytest.mark.parametrize("transcription", SCHEMES)
def test_an_equality_in_the_input(transcription):
    """A law for the force prescribed along the path: v = v0 exp(-2 t)."""
    problem, u, block = rest_to_rest()
    law = problem.replace(initial=[block.x == 0, block.vx == 3], final=[], path=[u == -2 * block.vx], running_cost=0)
    solution = mbd.optimize(law, intervals=20, transcription=transcription)
    times = np.linspace(0, 1, 21)
    assert np.allclose(solution.trajectory.at(times)[block.vx], 3 * np.exp(-2 * times), atol=1e-5)


@pytest.mark.parametrize("transcription", SCHEMES)
def test_an_equality_in_accelerations(transcription):
    """An acceleration prescribed: the force is m a."""
    problem, u, block = rest_to_rest(mass=2.0)
    law = problem.replace(initial=[block.x == 0, block.vx == 0], final=[], path=[block.ax == 3 * mbd.t], running_cost=0)
    solution = mbd.optimize(law, intervals=10, transcription=transcription)
    times = np.linspace(0, 1, 21)
    motion = solution.trajectory.at(times)
    assert np.allclose(motion[u], 6 * times, atol=1e-7)
    assert np.allclose(motion[block.x], times**3 / 2, atol=1e-6)


def test_two_sided_limits_on_a_position():
    """A corridor that moves with time: the block stays in it, at the least cost, which more intervals confirm."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    middle = 3 * mbd.t**2 - 2 * mbd.t**3 + 0.1 * mbd.sin(2 * np.pi * mbd.t)
    lane = problem.replace(path=[mbd.bounded(middle - 0.05, block.x, middle + 0.05)])
    solution = mbd.optimize(lane, intervals=40)
    times = np.linspace(0, 1, 401)
    off = solution.trajectory.at(times)[block.x - middle]
    assert np.max(np.abs(off)) < 0.05 + 1e-4 and np.max(off) > 0.0499 - 1e-3
    assert solution.cost > 12.0
    finer = mbd.optimize(lane, intervals=80, guess=solution)
    assert finer.cost == pytest.approx(solution.cost, rel=5e-3)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_bearing_force_is_kept(transcription):
    """The reaction at the rocker's pin below 85 % of its free peak costs torque."""
    f = crank_rocker()
    load = mbd.norm(f.o4.reaction_on(f.rocker).force)
    free = mbd.optimize(half_turn(f), intervals=40, transcription=transcription)
    limit = 0.85 * np.max(free.trajectory[load])
    held = mbd.optimize(half_turn(f, path=[load <= limit]), intervals=40, guess=free, transcription=transcription)
    assert np.max(held.trajectory[load]) < 1.01 * limit
    assert held.cost > free.cost * 1.001
    assert held.verify().final_error < 2e-3
    assert len(held.active_limits) == 1 and "O4" in held.active_limits[0].label


def test_an_obstacle():
    """A point that goes round a circle in the plane: the path is tangent to it, and stays outside."""
    fx, fy = mbd.Input("fx"), mbd.Input("fy")
    puck = mbd.Body("puck", mass=1.0, inertia=1.0)
    level = mbd.AbsoluteAngle("level", puck.at(0, 0))
    mechanism = mbd.Mechanism(
        bodies=[puck], joints=[level], forces=[mbd.Force("jets", puck.at(0, 0), (fx, fy))], inputs=[fx, fy]
    )
    outside = puck.x**2 + (puck.y - 0.05) ** 2 >= 0.3**2
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[puck.x == -1, puck.y == 0, puck.vx == 0, puck.vy == 0],
        final=[puck.x == 1, puck.y == 0, puck.vx == 0, puck.vy == 0],
        path=[outside],
        running_cost=fx**2 + fy**2,
    )
    solution = mbd.optimize(problem, intervals=40)
    times = np.linspace(0, 2, 801)
    motion = solution.trajectory.at(times)
    gap = np.sqrt(motion[puck.x**2 + (puck.y - 0.05) ** 2]) - 0.3
    assert abs(np.min(gap)) < 1e-3
    straight = 12 * 4 / 8
    assert straight * 1.001 < solution.cost < 2 * straight
    assert np.max(motion[puck.y]) < 1e-9 and np.min(motion[puck.y]) < -0.2, "the way below the circle is shorter"
