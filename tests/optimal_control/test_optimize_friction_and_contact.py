"""Friction and contact in optimal control: solved soft first, then sharper, from the last solution."""

from __future__ import annotations

import numpy as np
import pytest

import mbdcasadi as mbd

G = 9.81


def test_push_against_friction_by_continuation():
    """A block pushed from rest to rest: the least ``∫F² dt`` is ``12 m² d²/T³ + (μ m g)² T`` for sharp friction."""
    mass, mu, way, duration = 2.0, 0.3, 0.5, 1.0
    tolerance = mbd.Parameter("v_t", 0.1)
    force = mbd.Input("F", lower=-30, upper=30)
    block = mbd.Body("block", mass=mass, inertia=0.1)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    rub = mbd.JointFriction("rub", guide, mbd.Coulomb(mu, tolerance))
    mechanism = mbd.Mechanism(
        bodies=[block],
        joints=[guide],
        forces=[mbd.Gravity(), rub, mbd.Force("push", block.at(0, 0), (force, 0))],
        inputs=[force],
        parameters=[tolerance],
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=duration,
        initial=[guide.displacement == 0, guide.speed == 0],
        final=[guide.displacement == way, guide.speed == 0],
        running_cost=force**2,
    )
    exact = 12 * (mass * way) ** 2 / duration**3 + (mu * mass * G) ** 2 * duration
    values = [1e-1, 1e-2, 1e-3]
    solution = mbd.optimize(problem, intervals=30, continuation={tolerance: values})
    steps = solution.statistics.steps
    assert [step.values["v_t"] for step in steps] == values and steps[-1].cost == solution.cost
    assert all(step.iterations > 0 for step in steps)
    errors = [abs(step.cost - exact) / exact for step in steps]
    assert errors[2] < 1e-4 and errors[0] > 5 * errors[1] > 50 * errors[2]
    assert solution.verify().final_error < 1e-3


@pytest.mark.slow
def test_hop_by_continuation():
    """A leg pushes off a compliant floor that is made stiffer: it flies, and energy is what the leg has put in."""
    stiffness = mbd.Parameter("k", 1e3)
    push = mbd.Input("F", lower=-60, upper=60)
    trunk = mbd.Body("trunk", mass=1.0, inertia=0.01, pose=(0, 0.5, 0))
    foot = mbd.Body("foot", mass=0.2, inertia=0.001, pose=(0, 0.05, 0))
    upright = mbd.Translational("upright", mbd.ground.at(0, 0, angle=np.pi / 2), trunk.at(0, 0, angle=np.pi / 2))
    leg = mbd.Translational("leg", foot.at(0, 0, angle=np.pi / 2), trunk.at(0, 0, angle=np.pi / 2))
    floor = mbd.Contact(
        "floor",
        mbd.Circle(foot.at(0, 0), 0.05),
        mbd.HalfPlane(mbd.ground.at(0, 0)),
        mbd.HuntCrossley(stiffness, exponent=1.5, damping=0.5),
    )
    motor = mbd.TSDA("motor", foot.at(0, 0), trunk.at(0, 0), law=lambda length, rate: -push)
    mechanism = mbd.Mechanism(
        bodies=[trunk, foot],
        joints=[upright, leg],
        forces=[mbd.Gravity(), floor, motor],
        inputs=[push],
        parameters=[stiffness],
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=0.6,
        initial=[trunk.y == 0.4, trunk.vy == 0, foot.y == 0.045, foot.vy == 0],
        final=[trunk.y == 0.8, foot.y >= 0.15, trunk.vy == 0],
        path=[mbd.bounded(0.1, leg.displacement, 0.6)],
        running_cost=push**2,
    )
    solution = mbd.optimize(problem, intervals=40, continuation={stiffness: [1e3, 1e4]})
    motion = solution.trajectory
    assert motion[trunk.y][-1] == pytest.approx(0.8, abs=1e-6)
    assert motion[floor.gap][-1] >= 0.1 - 1e-6
    assert motion[floor.normal_force].max() > 1.2 * G and motion[floor.normal_force].min() >= 0
    flies = motion[floor.gap] > 0
    assert flies[-1] and not flies[0]
    # momentum: the floor's impulse alone lifts the whole against gravity
    check = solution.verify()
    assert check.final_error < 1e-2


def swing(limit):
    """A pendulum that is to be held at an angle by a torque that has a limit, under a growing weight."""
    weight, torque = mbd.Parameter("g", 1.0), mbd.Input("torque", lower=-limit, upper=limit)
    arm = mbd.Body("arm", mass=1, inertia=0.1, pose=(0, -0.5, -np.pi / 2))
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-0.5, 0))
    forces = [mbd.Gravity((0, -weight)), mbd.Torque("motor", arm, torque)]
    mechanism = mbd.Mechanism([arm], [hinge], forces=forces, inputs=[torque], parameters=[weight])
    rest = [arm.omega == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.0,
        initial=[hinge.angle == -np.pi / 2, *rest],
        final=[hinge.angle == 0, *rest],
        running_cost=torque**2,
    )
    return problem, weight


@pytest.mark.slow
def test_continuation_that_cannot_be_finished_tells_how_far_it_came():
    """Values between are tried; the error names the value, and brings the last solution."""
    problem, weight = swing(limit=9.0)
    with pytest.raises(mbd.OptimizationError, match=r"continuation stopped at g = ") as caught:
        mbd.optimize(problem, intervals=10, continuation={weight: [1.0, 400.0]}, options={"ipopt.max_iter": 60})
    reached = caught.value.reached
    assert reached.statistics.status == "Solve_Succeeded"
    assert 1.0 <= reached.trajectory.parameters[0] < 400.0


def test_continuation_refines_the_last_mesh_alone():
    """The tolerance holds at the end; several parameters go together."""
    problem, weight = swing(limit=20.0)
    solution = mbd.optimize(problem, intervals=6, continuation={weight: [1.0, 5.0, 9.81]}, tolerance=1e-6)
    direct = mbd.optimize(problem, intervals=6, parameters={weight: 9.81}, tolerance=1e-6)
    assert solution.mesh_error <= 1e-6 and len(solution.statistics.passes) > 1
    assert solution.cost == pytest.approx(direct.cost, rel=1e-5)


def test_continuation_refuses():
    """What is no parameter, is given twice, does not go together, or is empty."""
    problem, weight = swing(limit=9.0)
    for continuation, more, said in (
        ({mbd.Parameter("other", 1.0): [1, 2]}, {}, "not a parameter of the mechanism"),
        ({weight: [1, np.nan]}, {}, "finite"),
        ({weight: []}, {}, "finite"),
        ({weight: "soft"}, {}, "one after another"),
        ({}, {}, "empty"),
        ({weight: [1, 2]}, {"parameters": {weight: 3.0}}, "also given by parameters="),
    ):
        with pytest.raises(mbd.ModelError, match=said):
            mbd.optimize(problem, continuation=continuation, **more)


def test_a_block_rests_on_an_incline():
    """Pushed up against a load c of slope and friction, ``12 m² d² / T³ + c² T``, and left there at no cost."""
    mass, mu, slope, way = 2.0, 0.4, 0.2, 0.5
    force = mbd.Input("F")
    block = mbd.Body("block", mass=mass, inertia=0.1, pose=(0, 0, slope))
    incline = mbd.Translational("incline", mbd.ground.at(0, 0, angle=slope), block.at(0, 0))
    push = mbd.Force("push", block.at(0, 0), (force * np.cos(slope), force * np.sin(slope)))
    rub = mbd.JointFriction("rub", incline, mbd.Coulomb(mu, 1e-4))
    mechanism = mbd.Mechanism([block], [incline], forces=[mbd.Gravity(), rub, push], inputs=[force])
    there = [incline.displacement == way, incline.speed == 0]
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration=1.5,
        initial=[incline.displacement == 0, incline.speed == 0],
        final=there,
        waypoints=[mbd.Waypoint(1.0, there)],
        running_cost=force**2,
    )
    solution = mbd.optimize(problem, intervals=30)
    load = mass * G * (np.sin(slope) + mu * np.cos(slope))
    assert solution.cost == pytest.approx(12 * (mass * way) ** 2 + load**2, rel=3e-3)
    resting = solution.trajectory.at(np.linspace(1.1, 1.4, 7))
    assert np.max(np.abs(resting[force])) < 0.02 * load


def test_a_block_is_carried_by_friction():
    """A slide with a block on it that does not slip while ``6 d / T² < mu g``: as one mass, ``12 M² d² / T³``."""
    force = mbd.Input("F")
    slide = mbd.Body("slide", mass=2.0, inertia=0.1)
    load = mbd.Body("load", mass=1.0, inertia=0.1, pose=(0, 0.2, 0))
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), slide.at(0, 0))
    top = mbd.Translational("top", slide.at(0, 0.2), load.at(0, 0))
    rub = mbd.JointFriction("rub", top, mbd.Coulomb(0.5, 1e-3))
    pull = mbd.Force("pull", slide.at(0, 0), (force, 0))
    problem = mbd.OptimalControlProblem(
        mbd.Mechanism([slide, load], [rail, top], forces=[mbd.Gravity(), rub, pull], inputs=[force]),
        duration=1.0,
        initial=[rail.displacement == 0, rail.speed == 0, top.displacement == 0, top.speed == 0],
        final=[slide.x == 0.5, slide.vx == 0, load.x == 0.5, load.vx == 0],
        running_cost=force**2,
    )
    solution = mbd.optimize(problem, intervals=30)
    assert solution.cost == pytest.approx(12 * (3 * 0.5) ** 2, rel=3e-3)
    assert np.max(np.abs(solution.trajectory[top.displacement])) < 1e-3
