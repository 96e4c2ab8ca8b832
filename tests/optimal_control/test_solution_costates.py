"""What limits and conditions cost: against closed forms, and against differences of the optimal cost."""

import numpy as np
import pytest
from motions import crank_rocker, guided_block, half_turn, rest_to_rest

import mbdcasadi as mbd

SCHEMES = ["gauss-legendre", "hermite-simpson"]


def total(solution, label):
    """Decrease of the cost for one unit by which a limit is loosened all along."""
    return float(np.sum(solution.costates[label] * np.diff(solution.mesh)))


@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("control", ["polynomial", "linear"])
def test_final_conditions(transcription, control):
    """Cost 12 d²/T³ - 12 d v/T² + 4 v²/T: by d 24 d / T³, by the final speed -12 d / T²."""
    problem, _, _ = rest_to_rest(3.0, 2.0)
    solution = mbd.optimize(problem, intervals=10, transcription=transcription, control=control)
    assert solution.costates["final: block.x == 3"] == pytest.approx(24 * 3 / 8, rel=1e-6)
    assert solution.costates["final: block.vx == 0"] == pytest.approx(-12 * 3 / 4, rel=1e-6)


def test_initial_conditions():
    """A start further on by one unit saves 24 d / T³; one unit of speed saves 12 d / T²."""
    problem, _, block = rest_to_rest(3.0, 2.0)
    given = mbd.assemble(problem.mechanism, [block.x == 0, block.vx == 0])
    # the coordinates of a state cannot be changed one by one
    assert not any(k.startswith("initial") for k in mbd.optimize(problem.replace(initial=given), intervals=10).costates)
    solution = mbd.optimize(problem, intervals=10)
    position = next(v for k, v in solution.costates.items() if k.startswith("initial") and "block.x" in k)
    speed = next(v for k, v in solution.costates.items() if k.startswith("initial") and "block.vx" in k)
    assert position == pytest.approx(-24 * 3 / 8, rel=1e-6)
    assert speed == pytest.approx(-12 * 3 / 4, rel=1e-6)


def test_initial_conditions_that_leave_something_free():
    """The same where the start is not given as a whole."""
    problem, _, block = rest_to_rest(3.0, 2.0)
    solution = mbd.optimize(problem.replace(initial=[block.x == 0]), intervals=10)
    # free initial speed: u = a (T - t) with rest at the end, cost 3 d² / T³
    assert solution.cost == pytest.approx(3 * 9 / 8, rel=1e-8)
    assert solution.costates["initial: block.x == 0"] == pytest.approx(-6 * 3 / 8, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
@pytest.mark.parametrize("control", ["polynomial", "linear", "constant"])
def test_limits_of_inputs_in_least_time(transcription, control):
    """T = 2 sqrt(m d / F): one newton more on both sides saves T / 2 F."""
    problem, _u, _ = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t)
    solution = mbd.optimize(fast, intervals=20, transcription=transcription, control=control)
    both = total(solution, "u <= 5") + total(solution, "u >= -5")
    assert both == pytest.approx(solution.duration / 10, rel=0.01)
    assert all(np.all(solution.costates[k] >= -1e-8) for k in ("u <= 5", "u >= -5"))


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
def test_boundary_and_waypoint_conditions_of_a_linkage(transcription):
    """Final angle, waypoint and a tied end of a four-bar, by central differences of the cost."""
    f = crank_rocker()
    settings = dict(intervals=24, transcription=transcription)

    def problem(end=0.5 + np.pi, via=1.5, gain=0.0):
        return half_turn(
            f,
            final=[f.o2.angle == end],
            waypoints=[mbd.Waypoint(0.25, [f.o2.angle == via])],
            boundary=[mbd.at_end(f.crank.omega) == mbd.at_start(f.crank.omega) + gain],
        )

    solution = mbd.optimize(problem(), **settings)

    def slope(name, value, step):
        costs = [mbd.optimize(problem(**{name: value + s}), guess=solution, **settings).cost for s in (step, -step)]
        return (costs[0] - costs[1]) / (2 * step)

    found = solution.costates
    final = next(v for k, v in found.items() if k.startswith("final"))
    via = next(v for k, v in found.items() if k.startswith("waypoint"))
    tied = next(v for k, v in found.items() if k.startswith("boundary"))
    assert final == pytest.approx(slope("end", 0.5 + np.pi, 1e-3), rel=1e-3, abs=1e-5)
    assert via == pytest.approx(slope("via", 1.5, 1e-3), rel=1e-3, abs=1e-5)
    assert tied == pytest.approx(slope("gain", 0.0, 1e-2), rel=1e-3, abs=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("transcription", SCHEMES)
def test_a_limit_on_a_bearing_force(transcription):
    """The peak of a reaction, by central differences of the cost."""
    f = crank_rocker()
    load = mbd.norm(f.o4.reaction_on(f.rocker).force)
    settings = dict(intervals=30, transcription=transcription)
    free = mbd.optimize(half_turn(f), **settings)
    limit = round(0.85 * float(np.max(free.trajectory[load])), 3)
    solution = mbd.optimize(half_turn(f, path=[load <= limit]), guess=free, **settings)
    label = next(k for k in solution.costates if k.endswith(f"<= {limit:g}"))
    step = 0.001 * limit
    costs = [
        mbd.optimize(half_turn(f, path=[load <= limit + s]), guess=solution, **settings).cost for s in (step, -step)
    ]
    assert total(solution, label) == pytest.approx((costs[1] - costs[0]) / (2 * step), rel=0.02)


def test_an_integral_and_a_parameter():
    """Boundary conditions with integrals: farthest with an effort E, dd/dE = d / 2 E."""
    problem, u, block = rest_to_rest(1.0, 2.0)
    far = problem.replace(
        final=[block.vx == 0],
        running_cost=0,
        terminal_cost=-mbd.at_end(block.x),
        boundary=[mbd.integral(u**2) <= 6],
    )
    solution = mbd.optimize(far, intervals=8)
    costate = next(v for k, v in solution.costates.items() if k.startswith("boundary"))
    assert costate == pytest.approx(2.0 / 12, rel=1e-4)
    assert [a.label for a in solution.active_limits] == ["boundary: integral(u**2) <= 6"]


def test_active_limits_in_words():
    """Label, when, and what they cost; a limit that is not touched is not named."""
    problem, _u, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    fast = problem.replace(
        duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, path=[block.vx <= 100, block.x >= -1]
    )
    solution = mbd.optimize(fast, intervals=20)
    half = solution.duration / 2
    found = {a.label: a for a in solution.active_limits}
    assert set(found) == {"u <= 5", "u >= -5"}
    (span,) = found["u <= 5"].spans
    assert span == pytest.approx((0.0, half), abs=1e-6)
    (span,) = found["u >= -5"].spans
    assert span == pytest.approx((half, 2 * half), abs=1e-6)
    text = repr(found["u <= 5"])
    assert "u <= 5" in text and "active at 0 … 1.265 s" in text and "costate" in text
    free = mbd.optimize(problem.replace(mechanism=problem.mechanism, duration=100.0), intervals=10)
    assert free.active_limits == []


def test_limit_excess_is_found_between_the_points():
    """Three stages at the limits extrapolate beyond them; the excess is what a fine grid sees."""
    problem, u, block = rest_to_rest(4.0, 1.0, mass=2.0, lower=-5, upper=5)
    fast = problem.replace(duration=(0.5, 10.0), running_cost=0, terminal_cost=mbd.t, path=[block.vx <= 2.5])
    solution = mbd.optimize(fast, intervals=11)
    excess = solution.limit_excess
    assert set(excess) == {"u <= 5", "u >= -5", "block.vx <= 2.5"}
    times = np.unique(np.linspace(solution.mesh[:-1] + 1e-12, solution.mesh[1:] - 1e-12, 201).ravel())
    motion = solution.trajectory.at(times)
    for label, expression in (("u <= 5", u - 5), ("u >= -5", -5 - u), ("block.vx <= 2.5", block.vx - 2.5)):
        assert excess[label] == pytest.approx(max(np.max(motion[expression]), 0.0), rel=0.05, abs=1e-6)
    assert max(excess.values()) > 1e-3, "eleven intervals do not switch at half time"
    constant = mbd.optimize(fast, intervals=11, control="constant")
    assert constant.limit_excess["u <= 5"] < 1e-6


def test_the_bound_of_the_duration_is_an_active_limit():
    """Least effort over a time that is free up to 2 s: one second more would save 36 d² / T⁴ a second."""
    problem, _, _ = rest_to_rest(3.0, (0.5, 2.0))
    (limit,) = mbd.optimize(problem, intervals=10).active_limits
    assert limit.label == "the duration <= 2"
    assert limit.costate == pytest.approx(36 * 9 / 16, rel=1e-6)


def test_the_bound_of_a_parameter_is_an_active_limit():
    """The lighter the block the less the effort, in proportion to the square of its mass."""
    mass = mbd.Parameter("m", 2.0, lower=1.5, upper=4.0)
    u = mbd.Input("u")
    block, mechanism = guided_block(mass, u, parameters=[mass])
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=2.0,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 3, block.vx == 0],
        running_cost=u**2,
        free_parameters=[mass],
    )
    (limit,) = mbd.optimize(problem, intervals=10).active_limits
    assert limit.label == "m >= 1.5"
    assert limit.costate == pytest.approx(2 * 1.5 * 13.5, rel=1e-6)


def test_initial_conditions_beside_a_motion_that_is_prescribed():
    """Two links, the first on a time law by its path condition; the costate of the second speed by differences."""

    def swing(speed):
        first, second = (mbd.Body(name, mass=1.0, inertia=0.1) for name in ("first", "second"))
        t1, t2 = mbd.Input("t1"), mbd.Input("t2")
        joints = [
            mbd.Revolute("shoulder", mbd.ground.at(0, 0), first.at(0, 0.5)),
            mbd.Revolute("elbow", first.at(0, -0.5), second.at(0, 0.5)),
        ]
        forces = [mbd.Torque("m1", first, t1), mbd.Torque("m2", second, t2, opposite=first)]
        problem = mbd.OptimalControlProblem(
            mbd.Mechanism([first, second], joints, forces=forces, inputs=[t1, t2]),
            duration=1.0,
            initial=[second.phi == 0, second.omega == speed],
            final=[second.phi == 0.5],
            running_cost=t1**2 + t2**2,
            path=[first.phi == 0.3 * mbd.t**2],
        )
        return mbd.optimize(problem, intervals=15)

    slope = (swing(0.101).cost - swing(0.099).cost) / 0.002
    assert swing(0.1).costates["initial: second.omega == 0.1"] == pytest.approx(slope, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("way", [1, -1])
def test_both_sides_of_a_limit_are_told_apart(way):
    """A speed within -1.2 … 1.3 m/s, there and back: the side that is touched has the costate, by differences."""

    def move(low, high):
        problem, _, block = rest_to_rest(2.0 * way, 2.0)
        limit = mbd.bounded(low, block.vx, high)
        return mbd.optimize(problem.replace(path=[limit]), intervals=30)

    solution = move(-1.2, 1.3)
    touched, free = ("block.vx <= 1.3", "-1.2 <= block.vx") if way > 0 else ("-1.2 <= block.vx", "block.vx <= 1.3")
    assert [limit.label for limit in solution.active_limits] == [touched]
    assert np.max(np.abs(solution.costates[free])) < 1e-5 * np.max(solution.costates[touched])
    wider = move(-1.2, 1.3001) if way > 0 else move(-1.2001, 1.3)
    assert total(solution, touched) == pytest.approx((solution.cost - wider.cost) / 1e-4, rel=2e-3)
    assert solution.program.rows[-1].lower == 0  # conditions at the end come last
