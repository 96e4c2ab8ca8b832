"""Jumps from one branch of a linkage to another between two mesh points."""

import itertools
import re
import warnings

import motions
import numpy as np
import pytest
from motions import crank_rocker, half_turn

import mbdcasadi as mbd
from mbdcasadi.equations.numeric import NumericEquations
from mbdcasadi.optimal_control.measures.branch import branch_jump, changes_sign, refuse_branch_jump
from mbdcasadi.optimal_control.measures.singularity import close_to_singular
from mbdcasadi.optimal_control.search import far_off, refine
from mbdcasadi.optimal_control.solution import Solution


def poses_of_both_branches(f, angles):
    """Poses of the crank-rocker by the circles about A and O4, with B above and below (2, k, 9)."""
    a, b, c, d = 0.10, 0.28, 0.24, 0.30
    both = []
    for side in (1, -1):
        poses = []
        for angle in angles:
            pin_a = a * np.array([np.cos(angle), np.sin(angle)])
            apart = np.array([d, 0.0]) - pin_a
            distance = np.hypot(*apart)
            along = (b**2 - c**2 + distance**2) / (2 * distance)
            across = side * np.sqrt(b**2 - along**2)
            pin_b = pin_a + (along * apart + across * np.array([-apart[1], apart[0]])) / distance
            ends = [(np.zeros(2), pin_a), (pin_a, pin_b), (pin_b, np.array([d, 0.0]))]
            bars = [[*(p + q) / 2, np.arctan2(*(q - p)[::-1])] for p, q in ends]
            bars[2][2] = np.arctan2(*(pin_b - np.array([d, 0.0]))[::-1])
            poses.append(np.ravel(bars))
        both.append(poses)
    return np.array(both)


def test_the_sign_of_dependent_coordinates():
    """It stays along a whole turn in steps of a quarter radian, and changes from one branch to the other anywhere."""
    f = crank_rocker()
    numeric = NumericEquations(mbd.equations(f.mechanism), np.zeros(0))
    angles = np.linspace(0, 2 * np.pi, 26)
    poses = poses_of_both_branches(f, angles)
    assert max(np.abs(numeric.position(0.0, q, np.zeros(0))[0]).max() for q in poses.reshape(-1, 9)) < 1e-12
    jacobians = [[numeric.scaled_jacobian(0.0, q) for q in branch] for branch in poses]
    for branch in jacobians:
        assert not any(changes_sign(*pair) for pair in itertools.pairwise(branch))
    assert all(changes_sign(above, below) for above, below in zip(*jacobians, strict=True))


def with_a_jump(solution, f, interval):
    """The same solution with all mesh points from one on mirrored to the other branch, at rest there."""
    x, program = solution.variables.copy(), solution.program
    part = program.phases[0]
    n = len(part.scheme.eom.independent)
    angles = solution.trajectory[f.o2.angle][:: solution.points_per_interval]
    for k in range(interval, solution.mesh.size):
        x[part.point_index(k)[:n]] = poses_of_both_branches(f, [angles[k]])[1, 0][part.scheme.eom.independent]
        x[part.point_index(k)[n : 2 * n]] = 0.0
    return Solution(
        solution.problem, program, solution.settings, solution.initial, [solution.phases[0].numeric.p], solution.meshes,
        [solution.phases[0].segment_times], x, solution.cost, solution.statistics, solution.answer,
    )  # fmt: skip


def test_a_solution_that_jumps_is_refused():
    """With the constraint, the body and the time."""
    f = crank_rocker()
    solution = mbd.optimize(half_turn(f), intervals=20)
    assert branch_jump(solution) is None
    jumping = with_a_jump(solution, f, 12)
    jump = branch_jump(jumping)
    assert (jump.begin, jump.end) == pytest.approx((11 * 0.03, 12 * 0.03))
    said = r"not a motion of the mechanism: from t = 0\.33 to 0\.36 s \w+\.phi jumps by .* to another branch"
    with pytest.raises(mbd.OptimizationError, match=said) as caught:
        refuse_branch_jump(jumping)
    assert caught.value.partial is jumping and caught.value.time == pytest.approx(0.33)
    assert jump.row.split(".")[0] in ("A", "B", "O4") and jump.coordinate.split(".")[0] in ("coupler", "rocker")


@pytest.mark.slow
def test_a_solution_that_jumps_is_solved_again():
    """From a guess that jumps: the solution on the other branch is none, and the kinematic guess finds the motion."""
    f = crank_rocker()
    straight = mbd.optimize(half_turn(f), intervals=24)
    jumping = with_a_jump(mbd.optimize(half_turn(f), intervals=20), f, 12).trajectory
    solution = mbd.optimize(half_turn(f), intervals=12, guess=jumping)
    stages = solution.statistics.stages
    assert any("jump to another branch" in stage.description for stage in stages)
    assert stages[-1].status == "Solve_Succeeded" and branch_jump(solution) is None
    assert solution.statistics.iterations == sum(stage.iterations for stage in stages)
    assert solution.cost == pytest.approx(straight.cost, rel=1e-5)
    assert solution.verify().final_error < 1e-3


def test_an_interval_far_off_the_motion_is_refined_or_refused(monkeypatch):
    """Whatever mesh was asked for; the last solution is kept."""
    problem = half_turn(crank_rocker())
    monkeypatch.setattr(far_off, "LARGEST_ERROR", 0.011)
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # the mesh is fine enough for the cost, too
        solution = mbd.optimize(problem, intervals=4)
    assert solution.mesh.size > 5
    monkeypatch.setattr(refine, "PASSES", 0)
    with pytest.raises(
        mbd.OptimizationError, match="not a motion of the mechanism: the mesh of 4 intervals is too coarse.* t = "
    ) as caught:
        mbd.optimize(problem, intervals=4)
    assert caught.value.partial.mesh.size == 5 and "transmission" not in str(caught.value)


def test_a_linkage_close_to_a_change_point(monkeypatch):
    """At the start, 5 mm from a pose in which all links lie on one line."""
    monkeypatch.setattr(motions, "LENGTHS", (0.0711, 0.2379, 0.15, 0.164))
    f = crank_rocker()
    ends = {"initial": [f.crank.phi == 0, f.crank.omega == 6], "final": [f.crank.phi == 2]}
    part = mbd.optimize(half_turn(f, **ends), intervals=20).phases[0]
    assert "transmission angle" in close_to_singular(part, 0) and not close_to_singular(part, 19)


def parallelogram():
    """A parallelogram with a motor at one crank, both cranks at 0.9 rad; it lies flat at pi."""
    long, short = 0.4, 0.15

    def bar(name, first, last):
        (x, y), (dx, dy) = (first + last) / 2, last - first
        return mbd.Body(name, mass=1.0, inertia=0.01, pose=(x, y, np.arctan2(dy, dx))), np.hypot(dx, dy) / 2

    pivots, tips = np.array([(0, 0), (long, 0)]), np.array([(short, 0), (long + short, 0)])
    turned = np.array([[np.cos(0.9), -np.sin(0.9)], [np.sin(0.9), np.cos(0.9)]])
    tips = pivots + (tips - pivots) @ turned.T
    (one, r), (two, _), (rod, h) = (
        bar("one", pivots[0], tips[0]),
        bar("two", pivots[1], tips[1]),
        bar("rod", *tips),
    )
    joints = [
        mbd.Revolute("A0", mbd.ground.at(*pivots[0]), one.at(-r, 0)),
        mbd.Revolute("B0", mbd.ground.at(*pivots[1]), two.at(-r, 0)),
        mbd.Revolute("A", one.at(r, 0), rod.at(-h, 0)),
        mbd.Revolute("B", two.at(r, 0), rod.at(h, 0)),
    ]
    tau = mbd.Input("tau")
    mechanism = mbd.Mechanism([one, two, rod], joints, forces=[mbd.Torque("motor", one, tau)], inputs=[tau])
    return mechanism, one, two, tau


@pytest.mark.parametrize("turn, near", [(2.0, None), (3.6, np.pi)])
def test_a_motion_through_a_change_point_is_warned_of(turn, near):
    """A parallelogram that lies flat when its cranks have turned by pi from the line of its pivots."""
    mechanism, one, _, tau = parallelogram()
    start, end = [one.phi == 0.9, one.omega == 0], [one.phi == 0.9 + turn, one.omega == 0]
    problem = mbd.OptimalControlProblem(mechanism, 1.0, start, end, running_cost=tau**2)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        motion = mbd.optimize(problem).trajectory
    said = [re.search(r"comes close to a pose near t = (\S+) s in which (.*) depend", str(w.message)) for w in caught]
    if near is None:
        assert not caught
        return
    (match,) = said
    assert motion.at([float(match[1])])[one.phi] == pytest.approx(near, abs=0.1)
    assert {row.split(".")[0] for row in match[2].split(", ")} <= {"A0", "B0", "A", "B"}


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::mbdcasadi.MechanismWarning")
def test_a_pose_beyond_a_change_point_is_not_called_infeasible():
    """The other crank turns back behind the flat pose, as an antiparallelogram does."""
    mechanism, one, two, tau = parallelogram()
    start, end = [one.phi == 0.9, one.omega == 0], [one.phi == 0.9 + np.pi, one.omega == 0, mbd.cos(two.phi) <= -0.85]
    with pytest.raises(mbd.OptimizationError, match="the problem may still have one"):
        mbd.optimize(mbd.OptimalControlProblem(mechanism, 0.6, start, end, running_cost=tau**2), intervals=10)


def test_a_coarse_mesh_without_a_jump_is_not_refused():
    """It is a warning."""
    f = crank_rocker()
    with pytest.warns(mbd.MechanismWarning, match="too coarse"):
        assert branch_jump(mbd.optimize(half_turn(f), intervals=4)) is None


def test_a_blade_has_no_branches():
    """A knife edge has no position rows: a motion that is far off within an interval is no jump of a linkage."""
    turn = mbd.Input("turn", lower=-20, upper=20)
    sledge = mbd.Body("sledge", 1.0, 1.0, pose=(0, 0, -1.2))
    blade = mbd.KnifeEdge("blade", sledge.at(0, 0))
    forces = [mbd.Gravity(), mbd.Torque("steer", sledge, turn)]
    mechanism = mbd.Mechanism([sledge], joints=[blade], forces=forces, inputs=[turn])
    rest = [sledge.x == 0, sledge.y == 0, sledge.vx == 0, sledge.vy == 0]
    end = [sledge.x == 10, sledge.y == -5]
    problem = mbd.OptimalControlProblem(mechanism, (0.5, 5), rest, end, terminal_cost=mbd.t)
    assert mbd.equations(mechanism).has_loops and not mbd.equations(mechanism).has_branches
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)  # that the mesh is coarse
        assert branch_jump(mbd.optimize(problem, intervals=8)) is None
