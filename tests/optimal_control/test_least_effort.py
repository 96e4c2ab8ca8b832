"""Arms with a motor in every joint: motions of least effort by inverse dynamics."""

from __future__ import annotations

import signal
import warnings
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from mbdcasadi.optimal_control.search.search.driven.random_motions import best_motion

import mbdcasadi as mbd
from mbdcasadi.optimal_control.program.setup import Settings
from mbdcasadi.optimal_control.solve.driven import run as run_module
from mbdcasadi.optimal_control.solve.driven.motions import DrivenMotions
from mbdcasadi.optimal_control.solve.driven.spline import MotionSpline
from mbdcasadi.optimal_control.solve.problem_solver import ProblemSolver
from mbdcasadi.optimal_control.solve.solvers.ipopt import Ipopt


def arm(links=3, duration=1.0, limit=np.inf, weights=None):
    """Bars of 1 kg with a motor in every joint, from one pose at rest to another; with the motors' inputs and bars."""
    torques = [mbd.Input(f"torque {k + 1}", lower=-limit, upper=limit) for k in range(links)]
    angles = np.linspace(-1.2, 0.4, links)
    turns = np.linspace(1.0, 2.0, links)
    bars, end = [], np.zeros(2)
    for k, angle in enumerate(angles):
        along = np.array([np.cos(angle), np.sin(angle)])
        bars.append(mbd.Body(f"link {k + 1}", mass=1.0, inertia=0.02, pose=(*(end + 0.25 * along), angle)))
        end = end + 0.5 * along
    before = [mbd.ground, *bars]
    joints, forces = [], [mbd.Gravity()]
    for k, (bar, torque) in enumerate(zip(bars, torques, strict=True)):
        joints.append(mbd.Revolute(f"joint {k + 1}", before[k].at(0.25 if k else 0.0, 0), bar.at(-0.25, 0)))
        forces.append(mbd.Torque(f"motor {k + 1}", bar, torque, before[k]))
    weights = np.ones(links) if weights is None else weights
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(bars, joints, forces=forces, inputs=torques),
        duration=duration,
        initial=[c for bar, angle in zip(bars, angles, strict=True) for c in (bar.phi == angle, bar.omega == 0)],
        final=[c for bar, a in zip(bars, angles + turns, strict=True) for c in (bar.phi == a, bar.omega == 0)],
        running_cost=sum(w * torque**2 for w, torque in zip(weights, torques, strict=True)),
    )
    return problem, torques, bars


def motions_of(problem):
    settings = replace(Settings.read("gauss-legendre", 3, "polynomial", None, False), angles=True)
    return ProblemSolver(problem, settings).driven


# --- the parts ----------------------------------------------------------------------------------
@pytest.mark.parametrize("degree", [2, 3, 4])
def test_splines_are_motions(degree):
    """Velocities and accelerations are derivatives; states and accelerations at the stages decide the motion."""
    random = np.random.default_rng(degree)
    ends = random.normal(size=(2, 4))
    spline = MotionSpline(np.cumsum([0.0, 0.3, 0.2, 0.5, 0.4]), degree, (ends[0], ends[1]))
    x = random.normal(size=spline.size)
    t, h = np.linspace(0.02, 1.35, 31), 1e-6
    before, at, after = (spline.at(x, t + shift) for shift in (-h, 0.0, h))
    inside = np.abs(t[:, None] - spline.times).min(axis=1) > 1e-3
    assert at[inside, 1:] == pytest.approx((after - before)[inside, :2] / (2 * h), abs=1e-6)
    assert np.vstack([spline.at(x, np.zeros(1))[0, :2], spline.at(x, spline.times[-1:])[0, :2]]).reshape(
        2, 4
    ) == pytest.approx(ends)
    finer = MotionSpline(np.sort(np.r_[spline.times, (spline.times[1:] + spline.times[:-1]) / 2]), degree, spline.ends)
    assert finer.at(finer.like(spline, x), t) == pytest.approx(at, abs=1e-9)


def test_sums_over_intervals():
    """Gradient and matrix of a sum of squares over intervals, against dense ones by differences."""
    random = np.random.default_rng(0)
    spline = MotionSpline(np.array([0.0, 0.4, 0.7, 1.3]), 3, (np.zeros(4), np.ones(4)))
    parts = random.normal(size=(spline.count, 6, spline.width))

    def residuals(x):
        return np.einsum("irw,iw->ir", parts, spline.by_interval(x))

    x, jacobian = random.normal(size=spline.size), np.zeros((spline.count * 6, spline.size))
    for k, unit in enumerate(np.eye(spline.size)):
        jacobian[:, k] = (residuals(x + unit) - residuals(x)).ravel()
    gathered = spline.gathered(np.einsum("irw,ir->iw", parts, residuals(x)))
    assert gathered == pytest.approx(jacobian.T @ residuals(x).ravel(), abs=1e-11)
    lower = spline.band(np.swapaxes(parts, 1, 2) @ parts)
    normal = jacobian.T @ jacobian
    for k in range(spline.width):
        assert lower[k, : spline.size - k] == pytest.approx(np.diagonal(normal, -k), abs=1e-11)
    assert np.abs(np.tril(normal, -spline.width)).max(initial=0.0) < 1e-11


def test_inputs_follow_from_the_motion():
    """Against the equations of motion of a simulation, and their derivatives against differences."""
    problem, torques, bars = arm()
    motions, mechanism = motions_of(problem), problem.mechanism
    t = np.linspace(0, 0.4, 5)
    inputs = {torque: 2.0 * (k + 1) for k, torque in enumerate(torques)}
    motion = mbd.simulate(mechanism, t, initial=problem.phases[0].initial, inputs=inputs)
    places = np.stack([np.column_stack([motion[getattr(b, n)] for b in bars]) for n in ("phi", "omega", "alpha")], 1)
    u, by_inputs = motions.dynamics.inputs(t, places)
    assert u == pytest.approx(np.tile([2.0, 4.0, 6.0], (5, 1)), abs=1e-6)
    slopes, h = motions.dynamics.slopes(t, places, u, by_inputs), 1e-6
    for k, unit in enumerate(np.eye(9)):
        step = h * unit.reshape(3, 3)
        change = motions.dynamics.inputs(t, places + step)[0] - motions.dynamics.inputs(t, places - step)[0]
        assert slopes[:, :, k] == pytest.approx(change / (2 * h), rel=1e-5, abs=1e-6)


# --- which problems -----------------------------------------------------------------------------
def test_problems_of_least_effort():
    assert motions_of(arm()[0]) is not None
    assert motions_of(arm(weights=[1.0, 2.0, 0.5])[0]) is not None
    assert motions_of(arm(links=2)[0]) is None  # of few coordinates
    assert motions_of(arm(limit=40.0)[0]) is None
    assert motions_of(arm(weights=[1.0, 0.0, 1.0])[0]) is None  # an input that costs nothing
    assert motions_of(arm(weights=[1.0, -1.0, 1.0])[0]) is None
    assert motions_of(arm(duration=(0.5, 2.0))[0]) is None
    problem, _, bars = arm()
    effort = problem.running_cost
    for size in (1e-12, 1.0, 1e12):  # none with a linear term, whatever the unit of the cost
        assert motions_of(problem.replace(running_cost=size * (effort + bars[0].phi))) is None
        assert motions_of(problem.replace(running_cost=size * effort)) is not None
    assert motions_of(problem.replace(running_cost=effort + mbd.sin(bars[0].phi))) is None
    assert motions_of(problem.replace(running_cost=effort + bars[0].omega ** 2)) is not None
    assert motions_of(problem.replace(path=[bars[0].omega <= 30.0])) is None
    assert motions_of(problem.replace(final=[bar.phi == 1.0 for bar in bars])) is None  # speeds are free
    assert motions_of(problem.replace(terminal_cost=bars[0].phi)) is None
    assert motions_of(problem.replace(waypoints=[mbd.Waypoint(0.5, [bars[0].phi == 0.0])])) is None


# --- solutions ----------------------------------------------------------------------------------
def test_blocks_on_rails():
    """Three blocks of 2 kg, each pushed by a distance d in T: the effort of each is ``12 m² d² / T³``.

    The acceleration of least effort is linear in time, which every mesh has.
    """
    pushes = [mbd.Input(f"push {k}") for k in range(3)]
    blocks = [mbd.Body(f"block {k}", mass=2.0, inertia=1.0, pose=(0, k, 0)) for k in range(3)]
    rails = [mbd.Translational(f"rail {k}", mbd.ground.at(0, k), block.at(0, 0)) for k, block in enumerate(blocks)]
    forces = [mbd.Force(f"f{k}", b.at(0, 0), (u, 0)) for k, (b, u) in enumerate(zip(blocks, pushes, strict=True))]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(blocks, rails, forces=forces, inputs=pushes),
        duration=1.5,
        initial=[c for block in blocks for c in (block.x == 0, block.vx == 0)],
        final=[c for k, block in enumerate(blocks) for c in (block.x == k + 1, block.vx == 0)],
        running_cost=sum(push**2 for push in pushes),
    )
    effort = sum(12 * 4 * (k + 1) ** 2 / 1.5**3 for k in range(3))
    solution = mbd.optimize(problem)
    assert solution.cost == pytest.approx(effort, rel=1e-8)
    # what a longer way costs: 24 m² d / T³
    for k in range(3):
        assert solution.costates[f"final: block {k}.x == {k + 1}"] == pytest.approx(24 * 4 * (k + 1) / 1.5**3, rel=1e-6)


def test_the_cost_is_that_of_the_motion():
    """Torques by the laws of Newton and Euler from the positions alone: those of the solution at the stages.

    Their effort, between the stages too, is the cost.
    """
    problem, torques, bars = arm(4, 1.2)
    solution = mbd.optimize(problem, intervals=60)
    assert solution.statistics.status in run_module.STATUSES
    h = 1e-4
    shares = np.r_[(1 - np.sqrt(0.6)) / 2, 0.5, (1 + np.sqrt(0.6)) / 2, np.linspace(0.05, 0.95, 19)]
    t = (np.arange(60)[:, None] + shares).ravel() * 1.2 / 60
    near = [solution.trajectory.at(t + k * h) for k in (-2, -1, 0, 1, 2)]
    now, weights = near[2], np.array([-1, 16, -30, 16, -1]) / (12 * h**2)
    needed = []
    for k in range(4):
        pin = now[bars[k].at(-0.25, 0).position]
        moment = 0.0
        for bar in bars[k:]:
            places = (bar.x, bar.y, bar.phi)
            ax, ay, alpha = (sum(w * at[x] for w, at in zip(weights, near, strict=True)) for x in places)
            arm_x, arm_y = now[bar.x] - pin[:, 0], now[bar.y] - pin[:, 1]
            moment = moment + 0.02 * alpha + arm_x * (ay + 9.81) - arm_y * ax
        needed.append(moment)
    needed = np.array(needed).reshape(4, 60, -1)
    found = np.array([now[torque] for torque in torques]).reshape(needed.shape)
    assert found[:, :, :3] == pytest.approx(needed[:, :, :3], abs=1e-4 * np.abs(found).max())
    assert np.mean(np.sum(needed[:, :, 3:] ** 2, axis=0)) * 1.2 == pytest.approx(solution.cost, rel=1e-2)


def test_is_the_optimum_of_the_program_on_a_fine_mesh():
    """With a tolerance IPOPT finds the same cost and the same costates."""
    problem, *_ = arm(3, 0.8)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(run_module, "SEEN", 0.0)  # the motion itself
        motion = mbd.optimize(problem, intervals=60)
    exact = mbd.optimize(problem, guess=motion, tolerance=1e-6)
    assert motion.statistics.solver == "levenberg-marquardt" and exact.statistics.solver == "ipopt"
    assert motion.cost == pytest.approx(exact.cost, rel=2e-3)
    sizes = np.abs(list(exact.costates.values())).max()
    for label, costate in exact.costates.items():
        assert motion.costates[label] == pytest.approx(costate, abs=0.02 * sizes)


def test_finds_the_way_that_costs_less():
    """With much time an arm hangs down first: the straight guess alone leads to a higher cost."""
    problem, *_ = arm(3, 2.0)
    found = mbd.optimize(problem)
    straight = mbd.optimize(problem, starts=[None])
    assert found.cost <= 1.01 * straight.cost


def test_limits_close_in():
    """Under torque limits the arm is solved from the motion of least effort without them."""
    free_problem, torques, _ = arm(4, 1.0)
    free = mbd.optimize(free_problem)
    peak = max(np.abs(free.trajectory[torque]).max() for torque in torques)
    problem, torques, _ = arm(4, 1.0, limit=0.8 * peak)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", message=".*limit.*")
        solution = mbd.optimize(problem)
    t = np.linspace(0, 1.0, 400)
    largest = max(np.abs(solution.trajectory.at(t)[torque]).max() for torque in torques)
    assert largest <= 0.8 * peak * (1 + 1e-6)
    # limits cost something, but for a search that ended some per cent above the optimum without them
    assert 0.9 * free.cost < solution.cost < 1.5 * free.cost
    assert solution.statistics.solver == "ipopt"


@pytest.mark.slow
def test_a_chain_of_ten():
    """Ten links of 1 m and 1 kg swing up in 2 s: a motion on a mesh on which the optimum of the program is none."""
    links = [mbd.Body(f"link {k}", mass=1.0, inertia=1 / 12, pose=(0, -k - 0.5, -np.pi / 2)) for k in range(10)]
    torques = [mbd.Input(f"torque {k}") for k in range(10)]
    before = [mbd.ground, *links]
    joints = [
        mbd.Revolute(f"joint {k}", before[k].at(0.5 if k else 0.0, 0), link.at(-0.5, 0)) for k, link in enumerate(links)
    ]
    motors = [mbd.Torque(f"motor {k}", link, torques[k], before[k]) for k, link in enumerate(links)]
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism(links, joints, forces=[mbd.Gravity(), *motors], inputs=torques),
        duration=2.0,
        initial=[c for link in links for c in (link.phi == -np.pi / 2, link.omega == 0)],
        final=[c for link in links for c in (link.phi == np.pi / 2, link.omega == 0)],
        running_cost=sum(torque**2 for torque in torques),
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        solution = mbd.optimize(problem, intervals=100)
    assert solution.statistics.iterations <= 60 and solution.mesh_error < 0.5
    # the least of many real motions is about 1000; the optimum of the program, no motion, costs 476
    assert 800 < solution.cost < 1600


def test_a_constant_in_the_cost_changes_nothing():
    """On a coarse mesh the optimum of the program is no motion, and not taken, however large the cost is besides."""
    problem, *_ = arm(3, 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        plain = mbd.optimize(problem, intervals=10)
        more = mbd.optimize(problem.replace(running_cost=problem.running_cost + 1e5), intervals=10)
    assert plain.statistics.solver == more.statistics.solver == "levenberg-marquardt"
    assert more.cost - 1e5 == pytest.approx(plain.cost, rel=1e-6)


def test_costates_of_a_state_at_the_end():
    """Those of the conditions that decide it, which IPOPT finds too; windows of the branch have none."""
    problem, *_ = arm(3, 1.0)
    motion = mbd.optimize(problem)
    problem = problem.replace(final=motion.trajectory.final)
    found, exact = mbd.optimize(problem), mbd.optimize(problem, guess=motion, tolerance=1e-5)
    assert found.statistics.solver == "levenberg-marquardt" and exact.statistics.solver == "ipopt"
    sizes = np.abs(list(exact.costates.values())).max()
    for label, costate in exact.costates.items():
        assert found.costates[label] == pytest.approx(costate, abs=0.02 * sizes)


# --- forces that are not defined everywhere, inputs that move nothing ---------------------------
def first_motor(torque_of, also=()):
    """The arm of three links with another torque of the first motor and more forces; with its bars."""
    problem, torques, bars = arm()
    forces = [f for f in problem.mechanism.forces if f.name != "motor 1"]
    forces += [mbd.Torque("motor 1", bars[0], torque_of(torques[0], bars[0])), *also]
    return problem.replace(mechanism=problem.mechanism.replace(forces=forces)), bars


@pytest.mark.parametrize("transmission", [lambda bar: mbd.t - 0.5, lambda bar: bar.phi + 0.7], ids=["time", "pose"])
def test_a_motor_that_moves_nothing_on_the_way(transmission):
    """At the middle of the motion, or of the straight way, which are points of the mesh: no error."""
    problem, bars = first_motor(lambda torque, bar: torque * transmission(bar))
    solution = mbd.optimize(problem)
    assert solution.mesh_error < 1e-2
    assert [float(solution.trajectory.final[bar.phi]) for bar in bars] == pytest.approx([-0.2, 1.1, 2.4], abs=1e-6)


def test_forces_that_are_not_defined_on_all_ways():
    """A root that has no value where a random motion swings back: such motions are left out, in silence."""
    problem, _, bars = arm()
    root = mbd.Torque("root", bars[0], mbd.sqrt(bars[0].phi + 1.2001))
    mechanism = problem.mechanism.replace(forces=[*problem.mechanism.forces, root])
    problem = problem.replace(mechanism=mechanism)
    motions = motions_of(problem)
    found = best_motion(motions)
    assert found is not None and np.isfinite(motions.effort_on(found.spline).value(found.x))
    with warnings.catch_warnings():
        warnings.simplefilter("error", RuntimeWarning)
        solution = mbd.optimize(problem)
    assert solution.mesh_error < 1e-2 and np.isfinite(solution.cost)


# --- around them --------------------------------------------------------------------------------
def test_a_guess_is_kept_to():
    """From a solution the search does not go elsewhere."""
    problem, *_ = arm(3, 1.0)
    solution = mbd.optimize(problem)
    again = mbd.optimize(problem, guess=solution)
    assert again.cost == pytest.approx(solution.cost, rel=1e-3) and again.cost <= solution.cost * (1 + 1e-6)


def test_ctrl_c_keeps_the_motion(monkeypatch):
    """Ctrl-C in the search for the least effort: the last motion, which meets all rows, is in ``.partial``."""
    search = DrivenMotions.search

    def interrupted(self, *arguments, stopped, **more):
        signal.raise_signal(signal.SIGINT)
        return search(self, *arguments, stopped=stopped, **more)

    monkeypatch.setattr(DrivenMotions, "search", interrupted)
    problem, *_ = arm()
    with pytest.raises(mbd.Interrupted) as error:
        mbd.optimize(problem)
    partial = error.value.partial
    assert np.isfinite(partial.cost) and partial.statistics.iterations == 0


def test_ctrl_c_without_a_motion(monkeypatch):
    """It is not lost if inputs do not follow from the motion, and the solver would go on otherwise."""

    def interrupted(self, *arguments, **more):
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(DrivenMotions, "search", interrupted)
    with pytest.raises(mbd.Interrupted):
        mbd.optimize(arm()[0])


def test_ctrl_c_in_the_last_step_keeps_the_motion(monkeypatch):
    """Ctrl-C while IPOPT goes on: the motion of least effort is a solution, the iterate of IPOPT is none."""
    run = Ipopt.run

    def interrupted(self, *arguments, **more):
        result = run(self, *arguments, **more)
        return replace(result, succeeded=False, interrupted=True, answer=result.answer | {"x": 0 * result.answer["x"]})

    problem, *_ = arm()
    motion = mbd.optimize(problem, intervals=80)
    assert motion.statistics.solver == "ipopt"
    monkeypatch.setattr(Ipopt, "run", interrupted)
    with pytest.raises(mbd.Interrupted, match="best solution") as error:
        mbd.optimize(problem, intervals=80)
    partial = error.value.partial
    assert partial.statistics.solver == "levenberg-marquardt"
    assert partial.cost == pytest.approx(motion.cost, rel=1e-2) and partial.mesh_error < 1e-3


def test_several_starts_and_executor():
    problem, *_ = arm()
    with ThreadPoolExecutor(2) as executor:
        solution = mbd.optimize(problem, starts=2, executor=executor)
    one = mbd.optimize(problem)
    assert len(solution.statistics.starts) == 2 and solution.cost <= one.cost * 1.01
