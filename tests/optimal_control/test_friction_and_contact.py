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
    solution, errors = None, []
    for value in (1e-1, 1e-2, 1e-3):
        guess = {} if solution is None else {"guess": solution}
        solution = mbd.optimize(problem, intervals=30, parameters={tolerance: value}, **guess)
        errors.append(abs(solution.cost - exact) / exact)
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
    solution = None
    for value in (1e3, 1e4):
        guess = {} if solution is None else {"guess": solution}
        solution = mbd.optimize(problem, intervals=40, parameters={stiffness: value}, **guess)
    motion = solution.trajectory
    assert motion[trunk.y][-1] == pytest.approx(0.8, abs=1e-6)
    assert motion[floor.gap][-1] >= 0.1 - 1e-6
    assert motion[floor.normal_force].max() > 1.2 * G and motion[floor.normal_force].min() >= 0
    flies = motion[floor.gap] > 0
    assert flies[-1] and not flies[0]
    # momentum: the floor's impulse alone lifts the whole against gravity
    check = solution.verify()
    assert check.final_error < 1e-2
