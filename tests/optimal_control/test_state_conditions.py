"""States as conditions on the way: a pose at which a mechanism rests."""

import numpy as np
import pytest
from motions import rest_to_rest

import mbdcasadi as mbd


def test_out_and_back():
    """Rest at x = 1 half way: 12 d² / T³ for each half."""
    problem, _u, block = rest_to_rest(1.0, 1.0)
    there = mbd.Waypoint(0.5, mbd.assemble(problem.mechanism, [block.x == 1]))
    solution = mbd.optimize(problem.replace(final=[block.x == 0, block.vx == 0], waypoints=[there]), intervals=4)
    assert solution.cost == pytest.approx(2 * 12 / 0.5**3, rel=1e-8)


def _four_bar():
    torque = mbd.Input("tau")
    crank = mbd.Body("crank", mass=0.2, inertia=2e-4, pose=(0.05, 0, 0))
    rod = mbd.Body("rod", mass=0.4, inertia=3e-3)
    rocker = mbd.Body("rocker", mass=0.3, inertia=2e-3)
    o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-0.05, 0))
    a = mbd.Revolute("A", crank.at(0.05, 0), rod.at(-0.15, 0))
    b = mbd.Revolute("B", rod.at(0.15, 0), rocker.at(0.125, 0))
    o4 = mbd.Revolute("O4", mbd.ground.at(0.3, 0), rocker.at(-0.125, 0))
    motor = mbd.Torque("motor", crank, torque)
    linkage = mbd.Mechanism([crank, rod, rocker], [o2, a, b, o4], forces=[mbd.Gravity(), motor], inputs=[torque])
    problem = mbd.OptimalControlProblem(
        linkage,
        duration=1.0,
        initial=[o2.angle == 0.5, crank.omega == 0],
        final=[o2.angle == 2.5, crank.omega == 0],
        running_cost=torque**2,
    )
    return problem, o2, crank, rocker


@pytest.mark.slow
def test_a_linkage_rests_on_the_way():
    """A pose of all bodies says as much as the crank alone, on its branch."""
    problem, o2, crank, _rocker = _four_bar()
    pose = mbd.assemble(problem.mechanism, [o2.angle == 1.5])
    solution = mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(0.5, pose)]), intervals=10)
    stated = mbd.Waypoint(0.5, [o2.angle == 1.5, crank.omega == 0])
    assert solution.cost == pytest.approx(
        mbd.optimize(problem.replace(waypoints=[stated]), intervals=10).cost, rel=1e-6
    )
    at = solution.trajectory.at(np.array([0.5]))
    assert at.q[0] == pytest.approx(pose.q, abs=1e-8) and at.v[0] == pytest.approx(0 * pose.q, abs=1e-7)


@pytest.mark.slow
def test_the_other_branch_is_not_taken_for_the_pose():
    """A crank angle is met on both branches, the pose of the other one is not."""
    problem, o2, _crank, rocker = _four_bar()
    other = mbd.assemble(problem.mechanism, [o2.angle == 1.5, rocker.y >= 0])
    with pytest.raises(mbd.OptimizationError, match=r"waypoint 1: rocker\.phi == .* \(on the same branch\)"):
        mbd.optimize(problem.replace(waypoints=[mbd.Waypoint(0.5, other)]), intervals=6)


def test_a_state_of_another_mechanism():
    """Its coordinates are not known."""
    problem, *_ = rest_to_rest()
    stranger = mbd.Body("stranger", mass=1, inertia=1)
    state = mbd.assemble(mbd.Mechanism([stranger], []), [])
    with pytest.raises(mbd.ExpressionError, match=r"waypoint 1: .*stranger"):
        problem.replace(waypoints=[mbd.Waypoint(0.5, state)])
