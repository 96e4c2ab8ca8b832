"""Switches and limits to the tolerance: closed forms of least times and of a limit on a position."""

import warnings

import casadi as ca
import numpy as np
import pytest
from motions import guided_block, rest_to_rest
from test_phase_references import least_time, model

import mbdcasadi as mbd
from mbdcasadi.optimal_control.transcription.mesh import Mesh


def fast_block(**changes):
    """A block over 1 m that speeds up with 1 m/s² and brakes with 2 m/s²: sqrt(3) s, with the switch at two thirds."""
    problem, u, block = rest_to_rest(1.0, 1.0, lower=-2, upper=1)
    return problem.replace(duration=(0.1, 10.0), running_cost=0, terminal_cost=mbd.t, **changes), u, block


def test_a_switch_at_a_mesh_point():
    """The mesh point that moves is at the switch; the cost is not below the true one."""
    problem, u, _block = fast_block()
    solution = mbd.optimize(problem, intervals=10, tolerance=1e-7)
    exact = np.sqrt(3)
    assert solution.cost == pytest.approx(exact, rel=1e-9)
    (k,) = solution.meshes[0].moving
    assert solution.mesh[k] == pytest.approx(exact * 2 / 3, abs=1e-7) and solution.waypoint_times.size == 0
    beside = solution.trajectory.at(np.r_[0.0, solution.mesh[k] - 1e-6, solution.mesh[k] + 1e-6, 1.7])[u]
    assert beside == pytest.approx([1, 1, -2, -2], abs=1e-7)
    assert solution.statistics.passes[0].cost > exact * (1 + 1e-4)
    assert solution.statistics.passes[-1].intervals <= 12


def test_a_switch_of_inputs_that_are_continuous():
    """The interval around it shrinks to less than a thousandth of a second; the cost is not below the true one."""
    problem, u, _block = fast_block()
    solution = mbd.optimize(problem, tolerance=1e-7, intervals=11, transcription="hermite-simpson")
    exact = np.sqrt(3)
    assert exact * (1 - 1e-9) < solution.cost < exact * (1 + 1e-7)
    k = int(np.argmin(np.diff(solution.mesh)))
    assert solution.mesh[k + 1] - solution.mesh[k] < 1e-3
    assert solution.mesh[k] < exact * 2 / 3 + 1e-6 and solution.mesh[k + 1] > exact * 2 / 3 - 1e-6
    beside = solution.trajectory.at(np.r_[0.0, solution.mesh[k] - 1e-6, solution.mesh[k + 1] + 1e-6, 1.7])[u]
    assert beside == pytest.approx([1, 1, -2, -2], abs=1e-5)
    assert solution.statistics.passes[0].cost > exact * (1 + 1e-4)
    assert solution.meshes[0].moving == (k, k + 1) and solution.waypoint_times.size == 0


def test_inputs_of_a_digital_controller_keep_their_mesh():
    problem, *_ = fast_block()
    solution = mbd.optimize(problem, intervals=10, tolerance=1e-7, control="constant")
    assert np.allclose(np.diff(solution.mesh), solution.duration / 10)


def test_a_limit_on_the_speed():
    """Speeding up, a run at the limit, braking: 1 / v + v / 2 (1 + 1 / 2) s."""
    problem, _u, block = fast_block()
    solution = mbd.optimize(problem.replace(path=[block.vx <= 0.5]), intervals=10, tolerance=1e-7)
    assert solution.cost == pytest.approx(2 + 0.375, abs=1e-7)
    assert max(solution.limit_excess.values()) < 1e-7


def test_a_block_on_a_spring():
    """From 1 m to rest by |u| <= 0.3 with x'' = u - x: arcs of circles in the phase plane about -u, u and -u."""
    size = 0.3
    problem, u, block = rest_to_rest(1.0, 1.0, lower=-size, upper=size)
    spring = mbd.GeneralizedForce("spring", [(block.x, -block.x)])
    before = problem.mechanism
    mechanism = mbd.Mechanism(before.bodies, before.joints, forces=[*before.forces, spring], inputs=[u])
    start, rest = [block.x == 1, block.vx == 0], [block.x == 0, block.vx == 0]
    problem = mbd.OptimalControlProblem(mechanism, (1, 12), initial=start, final=rest, terminal_cost=mbd.t)
    solution = mbd.optimize(problem, tolerance=1e-6)
    # the first switch is where the circle through the start meets one of the radius u about 3 u: half a circle later
    # the block is on that through the goal
    x = (1 + 2 * size + 8 * size**2) / (8 * size)
    v = np.sqrt(size**2 - (x - 3 * size) ** 2)
    arcs = [np.arctan2(v, x + size), np.pi, np.arctan2(v, 3 * size - x)]
    assert solution.cost == pytest.approx(sum(arcs), rel=1e-8)
    switches = np.cumsum(arcs)[:2]
    assert np.max(np.min(np.abs(solution.mesh[:, None] - switches), axis=0)) < 1e-5


def test_a_limit_of_the_power():
    """A block of 1 kg speeds up with 1 N, then with 0.4 W, and brakes from 1 m/s with 1 N."""
    power, fastest = 0.4, 1.0
    duration = power + (fastest**2 - power**2) / (2 * power) + fastest
    distance = power**2 / 2 + (fastest**3 - power**3) / (3 * power) + fastest**2 / 2
    problem, u, block = rest_to_rest(distance, 1.0, lower=-1, upper=1)
    problem = problem.replace(duration=(0.1, 10), running_cost=0, terminal_cost=mbd.t, path=[u * block.vx <= power])
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        solution = mbd.optimize(problem, tolerance=1e-5)
    assert solution.cost == pytest.approx(duration, rel=1e-5)
    assert max(solution.limit_excess.values()) <= 1e-5 * power
    motion = solution.trajectory.at(np.linspace(0.5, duration - fastest - 0.1, 50))
    assert motion[u] == pytest.approx(power / motion[block.vx], abs=3e-5)


def test_a_limit_on_the_position():
    """Bryson and Ho, Applied Optimal Control, 3.11: 4 / (9 l) for l < 1 / 6, on the limit from 3 l to 1 - 3 l."""
    problem, u, block = rest_to_rest(0.0, 1.0)
    problem = problem.replace(
        initial=[block.x == 0, block.vx == 1],
        final=[block.x == 0, block.vx == -1],
        path=[block.x <= 0.02],
        running_cost=u**2 / 2,
    )
    solution = mbd.optimize(problem, intervals=20, tolerance=1e-6)
    assert solution.cost == pytest.approx(4 / (9 * 0.02), rel=1e-6)
    assert mbd.optimize(problem, intervals=20).cost < 4 / (9 * 0.02) * (1 - 5e-4)  # the limit is passed a little
    assert solution.limit_excess["block.x <= 0.02"] < 1e-6 * 0.02


def test_several_switches_of_two_inputs():
    """The two-link arm of Fotouhi and Szyszkowski (and of the collections of test problems): 2.98228 s."""
    u1, u2 = (mbd.Input(name, lower=-1, upper=1) for name in ("u1", "u2"))
    upper = mbd.Body("upper", mass=1, inertia=1 / 12, pose=(0.5, 0, 0))
    tip = (1 + 0.75 * np.cos(0.5), 0.75 * np.sin(0.5), 0.5)
    fore = mbd.Body("fore", mass=2, inertia=1 / 12 + 1 / 8, pose=tip)  # a rod of 1 m with its own mass at the tip
    joints = [
        mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-0.5, 0)),
        mbd.Revolute("elbow", upper.at(0.5, 0), fore.at(-0.75, 0)),
    ]
    motors = [mbd.Torque("at shoulder", upper, u1), mbd.Torque("at elbow", fore, u2, opposite=upper)]
    mechanism = mbd.Mechanism([upper, fore], joints, forces=motors, inputs=[u1, u2])
    rest = [upper.omega == 0, fore.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        (1, 6),
        initial=[upper.phi == 0, fore.phi == 0.5, *rest],
        final=[upper.phi == 0.522, fore.phi == 1.022, *rest],
        terminal_cost=mbd.t,
    )
    solution = mbd.optimize(problem, intervals=20, tolerance=1e-6)
    assert solution.cost == pytest.approx(2.98228, abs=2e-6)
    inputs = solution.trajectory.at(np.linspace(0, solution.duration, 1001)[:-1])[ca.vertcat(u1, u2)]
    assert np.sum(np.diff(np.sign(inputs), axis=0) != 0) == 3 and np.sum(np.abs(inputs) < 0.999) <= 3


def test_a_switch_in_a_phase(tmp_path):
    """The gripper brakes before it grips; the file keeps the mesh points that moved."""
    names = model("gripper", "free = fastest")
    hinge, arm = names["hinge"], names["arm"]
    reach = mbd.Phase("reach", names["reaching"], (0.05, 3), initial=[hinge.angle == 0, arm.omega == 0])
    carry = mbd.Phase("carry", names["carrying"], (0.05, 3), final=[hinge.angle == 2.3, arm.omega == 0])
    problem = mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t)
    solution = mbd.optimize(problem, intervals=10, tolerance=1e-7)
    assert solution.cost == pytest.approx(least_time(), abs=1e-8)
    assert solution.phases[0].mesh.moving and not solution.phases[1].mesh.moving
    solution.save(tmp_path / "grip.npz")
    back = mbd.read_solution(tmp_path / "grip.npz", problem)
    assert (
        np.allclose(back.mesh, solution.mesh, rtol=1e-15, atol=1e-15)
        and back.meshes[0].moving == solution.meshes[0].moving
    )
    again = mbd.optimize(problem, intervals=10, guess=solution)
    assert again.cost == pytest.approx(least_time(), rel=2e-3) and not again.meshes[0].moving


def test_what_is_not_resolved_is_reported(monkeypatch):
    """Without a pass the switch stays within an interval."""
    monkeypatch.setattr("mbdcasadi.optimal_control.search.refine.PASSES", 0)
    problem, *_ = fast_block()
    with pytest.warns(mbd.MechanismWarning, match=r"meet the tolerance 1e-07, but not the switching time t = 1\.04"):
        solution = mbd.optimize(problem, intervals=10, tolerance=1e-7)
    assert solution.cost > np.sqrt(3) * (1 + 1e-4)


def test_a_smooth_problem_is_solved_once():
    """Without limits nothing switches."""
    problem, *_ = rest_to_rest(3.0, 2.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(mbd.optimize(problem, intervals=5, tolerance=1e-6).statistics.passes) == 1


def test_meshes_with_points_that_move():
    """Pieces between waypoints and moving points; what is split, and times that were found."""
    times = np.array([0.0, 1.0, 4.0])
    mesh = Mesh.equal(8, times).with_moving([0, 2, 3, 6, 8])
    assert mesh.counts == (2, 6) and mesh.moving == (3, 6)
    assert mesh.knots.tolist() == [0, 2, 3, 6, 8] and mesh.piece.tolist() == [0, 0, 1, 2, 2, 2, 3, 3]
    assert mesh.begin == pytest.approx([0, 1 / 2, 0, 0, 1 / 3, 2 / 3, 0, 1 / 2])
    found = np.array([0.0, 1.0, 1.3, 3.3, 4.0])
    moved = mesh.moved(found)
    assert moved.moving == mesh.moving and moved.times(times)[mesh.knots] == pytest.approx(found)
    assert moved.times(times)[4:6] == pytest.approx([1.3 + 2 / 3, 1.3 + 4 / 3])
    finer = moved.refined(np.array([1, 1, 2, 1, 1, 1, 1, 1]))
    assert finer.times(times) == pytest.approx([0, 0.5, 1, 1.15, 1.3, 1.3 + 2 / 3, 1.3 + 4 / 3, 3.3, 3.65, 4.0])
    assert finer.moving == (4, 7)


def test_a_mesh_with_points_at_switches():
    """Points that are too near to a switch go; waypoints stay, and what moved before moves no more."""
    mesh = Mesh((np.linspace(0, 1, 5), np.linspace(0, 1, 3))).with_moving([1])
    other = mesh.through_points(np.zeros(0), 0.3, np.array([0.52, 1.25]))
    assert other.positions == pytest.approx([0, 0.25, 0.52, 0.75, 1, 1.25, 1.5, 2])
    assert other.moving == (2, 5) and other.waypoints.tolist() == [4]


def test_phases_with_unlike_meshes():
    """A block passes a mark and stops beyond it, in least time, with a limited speed and more force behind the mark."""
    push, first, second = mbd.Input("push"), 1.0, 2.0
    block, mechanism = guided_block(1.0, push)
    speeds = [block.vx <= 1.8]
    mark, beyond = 1.0, 4.0
    before = mbd.Phase(
        "before", mechanism, (0.05, 10), initial=[block.x == 0, block.vx == 0], final=[block.x == mark],
        path=[mbd.bounded(-first, push, first), *speeds],
    )  # fmt: skip
    behind = mbd.Phase(
        "behind", mechanism, (0.05, 10), final=[block.x == mark + beyond, block.vx == 0],
        path=[mbd.bounded(-second, push, second), *speeds],
    )  # fmt: skip
    solution = mbd.optimize(mbd.OptimalControlProblem(phases=[before, behind], terminal_cost=mbd.t), tolerance=1e-6)
    passes = np.sqrt(2 * first * mark)
    at_speed = (beyond - (2 * 1.8**2 - passes**2) / (2 * second)) / 1.8
    assert solution.duration == pytest.approx(passes / first + (2 * 1.8 - passes) / second + at_speed, rel=1e-9)
