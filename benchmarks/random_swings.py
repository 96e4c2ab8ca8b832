"""Random mechanisms that move by swinging: brachiation, gymnasts, swings, hanging loads and steered blades.

They have fewer inputs than degrees of freedom, most have a free duration, and several optima each.
``python random_swings.py [COUNT [SEED]]`` prints the cost of each instance by default, with ``starts=16``, and their
ratio.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable

import numpy as np
from random_families import Problem, bar, end, inputs

import mbdcasadi as mbd


def _two_links(random: np.random.Generator, first: float, second: float) -> tuple:
    """Two bars that hang from the origin at angles, with a motor between them."""
    lengths = random.uniform(0.4, 0.7, 2)
    elbow = lengths[0] * np.array([np.cos(first), np.sin(first)])
    hand = elbow + lengths[1] * np.array([np.cos(second), np.sin(second)])
    links = [bar("upper", random.uniform(1, 3), np.zeros(2), elbow), bar("lower", random.uniform(1, 3), elbow, hand)]
    (motor,) = inputs(["u"], [float(random.uniform(15, 30))])
    joints = [
        mbd.Revolute("hold", mbd.ground.at(0, 0), end(links[0], lengths[0], -1)),
        mbd.Revolute("elbow", end(links[0], lengths[0], 1), end(links[1], lengths[1], -1)),
    ]
    forces = [mbd.Gravity(), mbd.Torque("motor", links[1], motor, opposite=links[0])]
    mechanism = mbd.Mechanism(links, joints, forces=forces, inputs=[motor])
    return mechanism, links, end(links[1], lengths[1], 1), motor, lengths, hand


def _at(body: mbd.Body) -> list:
    """The angle of its estimate, at rest."""
    return [body.phi == float(body.pose_estimate[2]), body.omega == 0]


def brachiation(random: np.random.Generator) -> Problem:
    """From one bar to the next by the hand, at rest before and after, in any time."""
    spread = random.uniform(0.4, 0.9)
    mechanism, (upper, lower), hand, motor, lengths, _ = _two_links(random, -np.pi / 2 - spread, np.pi - 0.3)
    target = float(random.uniform(0.5, 0.85) * np.sum(lengths))
    return Problem(
        mechanism,
        duration=(0.3, 3.0),
        initial=[*_at(upper), *_at(lower)],
        final=[hand.x == target, hand.y == float(random.uniform(-0.1, 0.1)), upper.omega == 0, lower.omega == 0],
        running_cost=motor**2,
    )


def gymnast(random: np.random.Generator) -> Problem:
    """From hanging to a handstand on the bar by the hips alone."""
    mechanism, (upper, lower), _, motor, *_ = _two_links(random, -np.pi / 2, -np.pi / 2)
    up = [c for body in (upper, lower) for c in (body.phi == np.pi / 2, body.omega == 0)]
    return Problem(mechanism, duration=(1.0, 6.0), initial=[*_at(upper), *_at(lower)], final=up, running_cost=motor**2)


def swing(random: np.random.Generator) -> Problem:
    """Pumping a swing to an angle in least time, by the height of the centre of mass."""
    (legs,) = inputs(["f"], None)
    first, length, mass = random.uniform(0.15, 0.3), random.uniform(2.0, 3.0), random.uniform(40, 80)
    short = 0.8 * length
    legs = mbd.Input("f", lower=-8 * mass, upper=40 * mass)
    angle = -np.pi / 2 + first
    rope = mbd.Body("rope", 0.0, 0.0, pose=(0, 0, angle))
    child = mbd.Body("child", mass, 0.0, pose=(0.9 * length * np.cos(angle), 0.9 * length * np.sin(angle), angle))
    pivot = mbd.Revolute("pivot", mbd.ground.at(0, 0), rope.at(0, 0))
    slide = mbd.Translational("slide", rope.at(0, 0), child.at(0, 0))
    forces = [mbd.Gravity(), mbd.GeneralizedForce("legs", [(slide.displacement, -legs)])]
    mechanism = mbd.Mechanism([rope, child], [pivot, slide], forces=forces, inputs=[legs])
    lean, r = rope.phi + np.pi / 2, slide.displacement
    return Problem(
        mechanism,
        duration=(1.0, 30.0),
        initial=[lean == first, rope.omega == 0, r == length, slide.speed == 0],
        path=[mbd.bounded(short, r, length), mbd.bounded(-1.5, slide.speed, 1.5)],
        final=[lean == float(random.uniform(0.5, 1.0)), rope.omega == 0],
        terminal_cost=mbd.t,
    )


def load(random: np.random.Generator) -> Problem:
    """A hanging load carried over a wall by a weak cart, in any time."""
    length, distance = float(random.uniform(0.8, 1.5)), float(random.uniform(1.5, 3))
    cart = mbd.Body("cart", mass=random.uniform(1, 3), inertia=0.1)
    hung = mbd.Body("load", mass=random.uniform(0.5, 2), inertia=0.0, pose=(0, -length, -np.pi / 2))
    (force,) = inputs(["F"], [float(random.uniform(10, 25))])
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("hook", cart.at(0, 0), hung.at(-length, 0)),
    ]
    forces = [mbd.Gravity(), mbd.Force("drive", cart.at(0, 0), (force, 0))]
    mechanism = mbd.Mechanism([cart, hung], joints, forces=forces, inputs=[force])
    rest = [cart.vx == 0, hung.omega == 0]
    wall = mbd.Waypoint((0.2, 6.0), [hung.x == distance / 2, hung.y >= -0.75 * length])
    return Problem(
        mechanism,
        duration=(1.0, 8.0),
        initial=[cart.x == 0, hung.phi == -np.pi / 2, *rest],
        final=[cart.x == distance, hung.phi == -np.pi / 2, *rest],
        waypoints=[wall],
        running_cost=force**2,
    )


def blade(random: np.random.Generator) -> Problem:
    """Least time on a steered blade under gravity: a cycloid."""
    turn = mbd.Input("turn", lower=-20, upper=20)
    sledge = mbd.Body("sledge", 1.0, 1.0, pose=(0, 0, float(random.uniform(-1.5, -0.8))))
    forces = [mbd.Gravity(), mbd.Torque("steer", sledge, turn)]
    mechanism = mbd.Mechanism([sledge], [mbd.KnifeEdge("blade", sledge.at(0, 0))], forces=forces, inputs=[turn])
    end_x, end_y = float(random.uniform(4, 12)), float(random.uniform(-6, -2))
    return Problem(
        mechanism,
        duration=(0.5, 5.0),
        initial=[sledge.x == 0, sledge.y == 0, sledge.vx == 0, sledge.vy == 0],
        final=[sledge.x == end_x, sledge.y == end_y],
        terminal_cost=mbd.t,
    )


FAMILIES: dict[str, Callable[[np.random.Generator], Problem]] = {
    "brachiation": brachiation,
    "gymnast": gymnast,
    "swing": swing,
    "load over a wall": load,
    "blade": blade,
}


def cost_of(problem: Problem, **settings: object) -> tuple[float, float]:
    """Cost, nan if it is not solved, and seconds of the processor."""
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            cost = mbd.optimize(problem, **settings).cost
        except mbd.OptimizationError:
            cost = np.nan
    return cost, time.process_time() - began


def main(count: int = 4, seed: int = 0) -> None:
    """Solve all families and print the table."""
    print("| family | instance | default | s | starts=16 | s | ratio |\n|---|---:|---:|---:|---:|---:|---:|")
    for name, make in FAMILIES.items():
        for k in range(count):
            (one, first), (other, second) = (
                cost_of(make(np.random.default_rng([seed, k])), **more) for more in ({}, {"starts": 16})
            )
            row = f"{one:.5g} | {first:.1f} | {other:.5g} | {second:.1f} | {one / np.fmin(one, other):.3f}"
            print(f"| {name} | {k} | {row} |", flush=True)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
