"""Mechanisms and problems that the tests of optimal control share."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace

import numpy as np

import mbdcasadi as mbd

#: Crank, coupler, rocker and ground of the crank-rocker, m, and masses of its uniform bars, kg.
LENGTHS, MASSES = (0.10, 0.28, 0.24, 0.30), (0.3, 0.8, 0.7)


def guided_block(
    mass,
    force,
    parameters: Sequence = (),
    extra: Callable = lambda block: [],
    inertia=0.01,
    **more,
):
    """A block on a guide, pushed by an input."""
    block = mbd.Body("block", mass=mass, inertia=inertia)
    guide = mbd.Translational("guide", mbd.ground.at(0, 0), block.at(0, 0))
    forces = [mbd.Force("push", block.at(0, 0), (force, 0)), *extra(block)]
    mechanism = mbd.Mechanism(
        bodies=[block], joints=[guide], forces=forces, inputs=[force], parameters=list(parameters), **more
    )
    return block, mechanism


def rest_to_rest(distance=1.0, duration=1.0, mass=1.0, lower=-np.inf, upper=np.inf, unit=None, **changes):
    """A block from rest at zero to rest at a distance with the least integral of the force squared."""
    u = mbd.Input("u", lower=lower, upper=upper, unit=unit)
    block, mechanism = guided_block(mass, u)
    arguments = dict(
        duration=duration,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == distance, block.vx == 0],
        running_cost=u**2,
    )
    if callable(made := changes.pop("with_block", None)):
        arguments |= made(block, u)
    return mbd.OptimalControlProblem(mechanism, **(arguments | changes)), u, block


def pendulum(length=1.0, mass=1.0, inertia=0.0, limit=np.inf, gravity=9.81):
    """A pendulum with a motor at the pin; zero is hanging down. The bob is at the end of a massless rod."""
    tau = mbd.Input("tau", lower=-limit, upper=limit)
    bob = mbd.Body("bob", mass=mass, inertia=inertia, pose=(0, -length, 0))
    pin = mbd.Revolute("pin", mbd.ground.at(0, 0), bob.at(0, length))
    forces = [mbd.Gravity((0, -gravity)), mbd.Torque("motor", bob, tau)]
    return bob, tau, mbd.Mechanism(bodies=[bob], joints=[pin], forces=forces, inputs=[tau])


def swing_up(limit, duration):
    """A pendulum that a motor with a limit, N m, brings up from rest to rest, with the least effort."""
    bob, tau, mechanism = pendulum(limit=limit)
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration,
        initial=[bob.phi == 0, bob.omega == 0],
        final=[bob.phi == np.pi, bob.omega == 0],
        running_cost=tau**2,
    )
    return problem, bob, tau


def sprung_block(stiffness, duration):
    """A block on a spring whose stiffness is a parameter, moved by a metre from rest to rest."""
    u, k = mbd.Input("u"), mbd.Parameter("k", stiffness)
    block, mechanism = guided_block(
        1.0, u, parameters=[k], extra=lambda b: [mbd.GeneralizedForce("spring", [(b.x, -k * b.x)])]
    )
    problem = mbd.OptimalControlProblem(
        mechanism,
        duration,
        initial=[block.x == 0, block.vx == 0],
        final=[block.x == 1, block.vx == 0],
        running_cost=u**2,
    )
    return problem, u, k, block


def crank_rocker(length=1.0, mass=1.0, limit=20.0):
    """A crank-rocker with a motor at the crank, in units of which the metre and the kilogram are so many."""
    a, b, c, d = (length * x for x in LENGTHS)
    limit *= mass * length**2
    f = SimpleNamespace(tau=mbd.Input("tau", lower=-limit, upper=limit))

    def bar(name, m, bar_length, x, y, phi):
        inertia = m * mass * bar_length**2 / 12
        return mbd.Body(name, mass=m * mass, inertia=inertia, pose=(x * length, y * length, phi))

    f.crank = bar("crank", MASSES[0], a, 0.04, 0.02, 0.5)
    f.coupler = bar("coupler", MASSES[1], b, 0.19, 0.14, 0.7)
    f.rocker = bar("rocker", MASSES[2], c, 0.30, 0.12, 1.6)
    f.o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), f.crank.at(-a / 2, 0))
    f.a = mbd.Revolute("A", f.crank.at(a / 2, 0), f.coupler.at(-b / 2, 0))
    f.b = mbd.Revolute("B", f.coupler.at(b / 2, 0), f.rocker.at(c / 2, 0))
    f.o4 = mbd.Revolute("O4", mbd.ground.at(d, 0), f.rocker.at(-c / 2, 0))
    f.mechanism = mbd.Mechanism(
        bodies=[f.crank, f.coupler, f.rocker],
        joints=[f.o2, f.a, f.b, f.o4],
        forces=[mbd.Gravity((0, -9.81 * length)), mbd.Torque("motor", f.crank, f.tau)],
        inputs=[f.tau],
    )
    return f


def half_turn(f, **changes):
    """Half a turn of the crank from rest to rest."""
    arguments = dict(
        duration=0.6,
        initial=[f.o2.angle == 0.5, f.crank.omega == 0],
        final=[f.o2.angle == 0.5 + np.pi, f.crank.omega == 0],
        running_cost=f.tau**2,
    )
    return mbd.OptimalControlProblem(**({"mechanism": f.mechanism} | arguments | changes))


def four_bar():
    """The half turn of the crank-rocker, its torque and its crank."""
    f = crank_rocker()
    return half_turn(f), f.tau, f.crank
