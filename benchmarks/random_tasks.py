"""Tasks as they are brought by users, random in their dimensions, from the automatic guess: solved, and true or not.

Cranes that carry a load over an obstacle in least time, five-bars that pick and place under limits of speed and of a
reaction, presses driven by a motor with a current and a limited voltage, arms with springs of free stiffness, carts
with a sloshing liquid, quick-return mechanisms with a flywheel that is to be chosen. ``python random_tasks.py
[COUNT [SEED]]`` prints a table, with the largest defect of an interval that is simulated again.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from random_families import Problem, bar, end, meet, print_verified

import mbdcasadi as mbd


def crane(random: np.random.Generator) -> Problem:
    """A load on a rigid rope passes a round obstacle that stands in its way, in least time."""
    rope, distance = random.uniform(0.5, 1.2), random.uniform(1.5, 3.0)
    mass, load = random.uniform(1, 4), random.uniform(0.3, 2)
    force = mbd.Input("F", lower=-3 * (mass + load), upper=3 * (mass + load))
    cart = mbd.Body("cart", mass=mass, inertia=0.1, pose=(0, 0, 0))
    bob = mbd.Body("load", mass=load, inertia=1e-3, pose=(0, -rope, -np.pi / 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("hook", cart.at(0, 0), bob.at(-rope, 0)),
    ]
    forces = [mbd.Gravity(), mbd.GeneralizedForce("drive", [(cart.x, force)])]
    place, radius = random.uniform(0.35, 0.65) * distance, random.uniform(0.05, 0.25) * rope
    clear = (bob.x - place) ** 2 + (bob.y + rope) ** 2 >= radius**2
    rest = [cart.vx == 0, bob.omega == 0, bob.phi == -np.pi / 2]
    return Problem(
        mbd.Mechanism([cart, bob], joints, forces=forces, inputs=[force]),
        duration=(0.5, 15.0),
        initial=[cart.x == 0, *rest],
        final=[cart.x == distance, *rest],
        path=[clear, mbd.bounded(-1.0, bob.phi + np.pi / 2, 1.0)],
        terminal_cost=mbd.t,
    )


def picking(random: np.random.Generator) -> Problem:
    """A five-bar takes its tip from place to place in least time, up and down again through a gate."""
    base, crank, rod = random.uniform(0.1, 0.25), random.uniform(0.15, 0.25), random.uniform(0.3, 0.4)
    tip = np.array([base / 2 + random.uniform(-0.08, -0.03), random.uniform(0.28, 0.36)])
    goal = np.array([base / 2 + random.uniform(0.03, 0.1), random.uniform(0.28, 0.36)])
    gate = (tip + goal) / 2 + np.array([0.0, random.uniform(0.01, 0.05)])
    peak, speed = random.uniform(2, 6), random.uniform(4, 9)
    motors = [mbd.Input(f"tau {k}", lower=-peak, upper=peak) for k in (1, 2)]
    o1, o2 = np.zeros(2), np.array([base, 0.0])
    a, b = meet(o1, tip, crank, rod, 1), meet(o2, tip, crank, rod, -1)  # elbows outside
    points = {"left": (o1, a), "right": (o2, b), "rod 1": (a, tip), "rod 2": (b, tip)}
    left, right, one, two = (bar(name, 1.5, *p) for name, p in points.items())
    last = mbd.Revolute("C", end(one, rod, 1), end(two, rod, 1))
    joints = [
        mbd.Revolute("O1", mbd.ground.at(*o1), end(left, crank, -1)),
        mbd.Revolute("O2", mbd.ground.at(*o2), end(right, crank, -1)),
        mbd.Revolute("A", end(left, crank, 1), end(one, rod, -1)),
        mbd.Revolute("B", end(right, crank, 1), end(two, rod, -1)),
        last,
    ]
    forces = [mbd.Torque(f"motor {k}", b, u) for k, (b, u) in enumerate(zip((left, right), motors, strict=True))]
    mechanism = mbd.Mechanism([left, right, one, two], joints, forces=[*forces, mbd.Gravity()], inputs=motors)
    hand, rest = end(one, rod, 1), [left.omega == 0, right.omega == 0]
    limits = [mbd.bounded(-speed, body.omega, speed) for body in (left, right)]
    strength = random.uniform(10, 30)
    return Problem(
        mechanism,
        duration=(0.05, 3.0),
        initial=[hand.x == tip[0], hand.y == tip[1], *rest],
        final=[hand.x == goal[0], hand.y == goal[1], *rest],
        path=[*limits, mbd.norm(last.reaction_on(one).force) <= strength],
        waypoints=[mbd.Waypoint((0.01, 2.9), [hand.x == gate[0], hand.y >= gate[1]])],
        terminal_cost=mbd.t,
    )


def press(random: np.random.Generator) -> Problem:
    """A slider-crank press turns once against its work, driven by a motor; heat and the voltage's rate cost."""
    crank, ratio = random.uniform(0.04, 0.1), random.uniform(2.5, 4)
    rod, work, duration = crank * ratio, random.uniform(20, 150), random.uniform(0.6, 1.5)
    a, b = np.array([crank, 0.0]), np.array([crank + rod, 0.0])
    first, second = bar("crank", 5.0, np.zeros(2), a), bar("rod", 4.0, a, b)
    ram = mbd.Body("ram", mass=random.uniform(1, 4), inertia=1e-2, pose=(*b, 0))
    volts = mbd.Input("V", lower=-48, upper=48)
    motor = mbd.DCMotor("motor", first, volts, constant=0.05, resistance=0.4, inductance=1e-3, ratio=12)
    joints = [
        mbd.Revolute("O", mbd.ground.at(0, 0), end(first, crank, -1)),
        mbd.Revolute("A", end(first, crank, 1), end(second, rod, -1)),
        mbd.Revolute("B", end(second, rod, 1), ram.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, 0), ram.at(0, 0)),
    ]
    depth = rod - crank + 0.4 * crank  # the work begins here, smoothly
    push = work * 0.5 * (1 + mbd.tanh((depth - ram.x) / (0.1 * crank)))
    forces = [motor, mbd.GeneralizedForce("work", [(ram.x, push)])]
    mechanism = mbd.Mechanism([first, second, ram], joints, forces=forces, inputs=[volts])
    return Problem(
        mechanism,
        duration=duration,
        initial=[first.phi == 0, first.omega == 0, motor.current == 0],
        final=[first.phi == 2 * np.pi, first.omega == 0],
        path=[mbd.bounded(-40, motor.current, 40)],
        running_cost=motor.heat,
    )


def balanced_arm(random: np.random.Generator) -> Problem:
    """A two-link arm lifts a load; stiffness and free lengths of two springs are chosen for the least effort."""
    lengths, load = random.uniform(0.3, 0.6, 2), random.uniform(0.5, 3)
    k_1, k_2 = (mbd.Parameter(f"k_{j}", 300.0, 0.0, 3000.0) for j in (1, 2))
    free = mbd.Parameter("l0", 0.15, 0.02, 0.3)
    start, goal = np.array([-0.6, 0.4]) + random.uniform(-0.3, 0.3, 2), random.uniform([0.3, 0.5], [1.0, 1.6])
    knee = lengths[0] * np.array([np.cos(start[0]), np.sin(start[0])])
    hand = knee + lengths[1] * np.array([np.cos(start[1]), np.sin(start[1])])
    upper, fore = bar("upper", 3.0, np.zeros(2), knee), bar("fore", 2.0, knee, hand)
    bob = mbd.Body("load", mass=load, inertia=1e-2, pose=(*hand, 0))
    torques = [mbd.Input(f"tau {j}") for j in (1, 2)]
    joints = [
        mbd.Revolute("shoulder", mbd.ground.at(0, 0), end(upper, lengths[0], -1)),
        mbd.Revolute("elbow", end(upper, lengths[0], 1), end(fore, lengths[1], -1)),
        mbd.Weld("grip", end(fore, lengths[1], 1), bob.at(0, 0)),
    ]
    forces = [
        mbd.Gravity(),
        mbd.Torque("shoulder motor", upper, torques[0]),
        mbd.Torque("elbow motor", fore, torques[1], upper),
        mbd.TSDA("spring 1", mbd.ground.at(0, 0.3), upper.at(0, 0), stiffness=k_1, free_length=free),
        mbd.TSDA("spring 2", upper.at(-0.1, 0.1), fore.at(0, 0), stiffness=k_2, free_length=free),
    ]
    bodies = [upper, fore, bob]
    parameters = [k_1, k_2, free]
    mechanism = mbd.Mechanism(bodies, joints, forces=forces, inputs=torques, parameters=parameters)
    rest = [upper.omega == 0, fore.omega == 0]
    return Problem(
        mechanism,
        duration=random.uniform(0.8, 2.0),
        initial=[upper.phi == start[0], fore.phi == start[1], *rest],
        final=[upper.phi == goal[0], fore.phi == goal[1], *rest],
        running_cost=torques[0] ** 2 + torques[1] ** 2,
        free_parameters=parameters,
    )


def slosh(random: np.random.Generator) -> Problem:
    """A vessel is carried along and tipped to and fro, its liquid a pendulum: in least time, at rest at both ends."""
    length, liquid, distance = random.uniform(0.1, 0.4), random.uniform(0.5, 3), random.uniform(0.3, 1.5)
    cart = mbd.Body("vessel", mass=random.uniform(1, 5), inertia=0.1, pose=(0, 0, 0))
    wave = mbd.Body("liquid", mass=liquid, inertia=1e-4, pose=(0, -length, -np.pi / 2))
    strong = random.uniform(2, 6) * (cart.mass + liquid)
    force = mbd.Input("F", lower=-strong, upper=strong)
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("surface", cart.at(0, 0), wave.at(-length, 0)),
    ]
    forces = [
        mbd.Gravity(),
        mbd.GeneralizedForce("drive", [(cart.x, force)]),
        mbd.RSDA(
            "viscosity", cart.at(0, 0), wave.at(-length, 0), damping=0.02 * liquid * length**2 * np.sqrt(9.81 / length)
        ),
    ]
    rest = [cart.vx == 0, wave.omega == 0, wave.phi == -np.pi / 2]
    return Problem(
        mbd.Mechanism([cart, wave], joints, forces=forces, inputs=[force]),
        duration=(0.1, 10.0),
        initial=[cart.x == 0, *rest],
        final=[cart.x == distance, *rest],
        path=[mbd.bounded(-0.25, wave.phi + np.pi / 2, 0.25)],
        terminal_cost=mbd.t,
    )


def quick_return(random: np.random.Generator) -> Problem:
    """A quick-return mechanism runs periodically against a cutting force; its flywheel and its turns are chosen."""
    crank, arm = random.uniform(0.05, 0.1), random.uniform(0.35, 0.5)
    below, cut = random.uniform(0.15, 0.25), random.uniform(10, 60)
    wheel_inertia = mbd.Parameter("J", 0.05, 0.001, 1.0)
    wheel = mbd.Body("wheel", mass=2.0, inertia=wheel_inertia, pose=(0, 0, 0))
    angle = np.arctan2(below, crank)
    lever = mbd.Body(
        "lever",
        mass=1.5,
        inertia=1.5 * arm**2 / 12,
        pose=(*(arm / 2 * np.array([np.cos(angle), np.sin(angle)]) - [0, below]), angle),
    )
    block = mbd.Body("block", mass=0.3, inertia=1e-4, pose=(crank, 0, angle))
    torque = mbd.Input("tau")
    joints = [
        mbd.Revolute("O", mbd.ground.at(0, 0), wheel.at(0, 0)),
        mbd.Revolute("A", wheel.at(crank, 0), block.at(0, 0)),
        mbd.Revolute("P", mbd.ground.at(0, -below), lever.at(-arm / 2, 0)),
        mbd.Translational("slot", lever.at(0, 0), block.at(0, 0)),
    ]
    tip = lever.at(arm / 2, 0)
    speed = tip.vx
    force = -cut * 0.5 * (1 + mbd.tanh(speed / 0.05))
    forces = [mbd.Torque("motor", wheel, torque), mbd.Force("cut", tip, (force, 0.0))]
    mechanism = mbd.Mechanism([wheel, lever, block], joints, forces=forces, inputs=[torque], parameters=[wheel_inertia])
    mean = random.uniform(4, 9)
    return Problem(
        mechanism,
        duration=2 * np.pi / mean,
        initial=[wheel.phi == 0],
        final=[wheel.phi == 2 * np.pi],
        boundary=[mbd.at_start(wheel.omega) == mbd.at_end(wheel.omega)],
        path=[mbd.bounded(0.8 * mean, wheel.omega, 1.2 * mean)],
        running_cost=torque**2,
        terminal_cost=0.5 * wheel_inertia,
        free_parameters=[wheel_inertia],
    )


FAMILIES: dict[str, Callable[[np.random.Generator], Problem]] = {
    "crane over an obstacle": crane,
    "picking five-bar": picking,
    "press with a motor": press,
    "arm with springs": balanced_arm,
    "slosh": slosh,
    "quick return": quick_return,
}


def main(count: int = 5, seed: int = 20261122) -> None:
    """Solve all families and print the table; what is limited is part of the tasks."""
    print_verified(FAMILIES, count, seed)


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
