"""Random motions in phases from the automatic guess: how many are solved, and in how many iterations.

Three families: grippers that take up a load in the swing in least time, arms that throw at a mark, and five-link
bipeds, with other masses, lengths and steps. ``python random_phases.py [COUNT [SEED]]`` prints a table, with the
largest defect, m or rad, of an interval that IDAS simulates again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from random_families import Problem, bar, end, inputs, print_verified

import mbdcasadi as mbd


def gripper(random: np.random.Generator) -> Problem:
    """An arm takes a resting load along, by a plastic impact, and brings it to rest in least time."""
    length, at, beyond = random.uniform(0.5, 1.5), random.uniform(0.8, 3.0), random.uniform(0.2, 1.0)
    place = length * np.array([np.cos(at), np.sin(at)])
    arm = bar("arm", random.uniform(0.8, 3), np.zeros(2), np.array([length, 0]))
    load = mbd.Body(
        "load", mass=arm.mass * random.uniform(0.1, 1), inertia=random.uniform(0.005, 0.05), pose=(*place, at)
    )
    (tau,) = inputs(["tau"], [arm.mass * length**2 * random.uniform(1, 5)])
    hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), end(arm, length, -1))
    table = mbd.Weld("table", mbd.ground.at(*place, angle=at), load.at(0, 0))
    grip = mbd.Weld("grip", end(arm, length, 1), load.at(0, 0))
    reaching = mbd.Mechanism([arm, load], [hinge, table], forces=[mbd.Torque("motor", arm, tau)], inputs=[tau])
    carrying = reaching.replace(joints=[hinge, grip])
    reach = mbd.Phase("reach", reaching, (0.05, 5), initial=[hinge.angle == 0, arm.omega == 0])
    carry = mbd.Phase("carry", carrying, (0.05, 5), final=[hinge.angle == at + beyond, arm.omega == 0])
    return Problem(phases=[reach, carry], terminal_cost=mbd.t)


def thrower(random: np.random.Generator) -> Problem:
    """Two links swing from rest and let a ball go, which hits a mark; the arm is left out of the flight."""
    lengths, hanging = random.uniform(0.25, 0.6, 2), np.array([0.0, -1.0])
    knots = [np.zeros(2), lengths[0] * hanging, lengths.sum() * hanging]
    upper, fore = (bar(f"link {k}", random.uniform(2, 6), knots[k - 1], knots[k]) for k in (1, 2))
    ball = mbd.Body("ball", mass=random.uniform(0.1, 0.6), inertia=4e-4, pose=(*knots[2], -np.pi / 2))
    shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), end(upper, lengths[0], -1))
    elbow = mbd.Revolute("elbow", end(upper, lengths[0], 1), end(fore, lengths[1], -1))
    hand = mbd.Weld("hand", end(fore, lengths[1], 1), ball.at(0, 0))
    first, second = inputs(["tau 1", "tau 2"], None)
    motors = [mbd.Torque("at shoulder", upper, first), mbd.Torque("at elbow", fore, second, opposite=upper)]
    holding = mbd.Mechanism(
        [upper, fore, ball], [shoulder, elbow, hand], forces=[mbd.Gravity(), *motors], inputs=[first, second]
    )
    flying = mbd.Mechanism([ball], forces=[mbd.Gravity()])
    rest = [condition for link in (upper, fore) for condition in (link.phi == -np.pi / 2, link.omega == 0)]
    mark = random.uniform([1.5, -0.5], [3.5, 1.0])
    swing = mbd.Phase("swing", holding, random.uniform(0.35, 0.6), initial=rest, running_cost=first**2 + second**2)
    flight = mbd.Phase("flight", flying, (0.1, 1.2), final=[ball.x == mark[0], ball.y == mark[1]])
    return Problem(phases=[swing, flight])


def biped(random: np.random.Generator) -> Problem:
    """A periodic step of least torque: the swing, and the plastic impact of the foot."""
    shin, thigh, trunk = random.uniform([0.3, 0.3, 0.5], [0.5, 0.5, 0.8])
    sizes = [shin, thigh, trunk, thigh, shin]
    angles = np.array([-0.3, 0.7, 0.0, -0.5, -0.6])

    def above(k: int, point: np.ndarray, sign: float = 1) -> np.ndarray:
        return point + sign * sizes[k] * np.array([-np.sin(angles[k]), np.cos(angles[k])])

    foot = np.zeros(2)
    knee = above(0, foot)
    hip = above(1, knee)
    other_knee = above(3, hip, -1)
    spans = [(foot, knee), (knee, hip), (hip, above(2, hip)), (other_knee, hip), (above(4, other_knee, -1), other_knee)]
    densities = random.uniform([5, 12, 20], [12, 22, 40])[[0, 1, 2, 1, 0]]
    links = [bar(f"link {k}", density, *span) for k, (density, span) in enumerate(zip(densities, spans, strict=True))]
    low, top = ([end(link, size, side) for link, size in zip(links, sizes, strict=True)] for side in (-1, 1))
    joints = [
        mbd.Revolute("knee 1", top[0], low[1]),
        mbd.Revolute("hip 1", top[1], low[2]),
        mbd.Revolute("hip 2", low[2], top[3]),
        mbd.Revolute("knee 2", low[3], top[4]),
    ]
    torques = inputs([f"torque of {joint.name}" for joint in joints], None)
    motors = [mbd.Torque(f"motor {k}", links[k + 1], u, opposite=links[k]) for k, u in enumerate(torques)]
    step = random.uniform(0.3, 0.8) * (shin + thigh)
    stands = mbd.Revolute("foot 1", mbd.ground.at(0, 0), low[0])
    lands = mbd.Revolute("foot 2", mbd.ground.at(step, 0), low[4])
    on_one = mbd.Mechanism(links, [*joints, stands], forces=[mbd.Gravity(), *motors], inputs=torques)
    swing = mbd.Phase(
        "swing", on_one, random.uniform(0.5, 0.9), running_cost=sum(u**2 for u in torques),
        initial=[low[4].vy >= 0], final=[low[4].vy <= 0],
    )  # fmt: skip
    touch = mbd.Phase(
        "touch-down", on_one.replace(joints=[*joints, lands]), 0, initial=[lands.impulse_on(links[4]).force[1] >= 0]
    )
    pairs = list(zip(links, reversed(links), strict=True))
    relations = [mbd.at_end(after.phi) == mbd.at_start(before.phi) for before, after in pairs]
    relations += [mbd.at_end(after.omega) == mbd.at_start(before.omega) for before, after in pairs]
    return Problem(phases=[swing, touch], boundary=relations)


FAMILIES: dict[str, Callable[[np.random.Generator], Problem]] = {
    "gripper": gripper,
    "thrower": thrower,
    "biped": biped,
}


def main(count: int = 30, seed: int = 0) -> None:
    """Solve all families and print the table; what is limited is part of the tasks."""
    print_verified(FAMILIES, count, seed)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
