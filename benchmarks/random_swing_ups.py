"""Random chains that swing up under limits, from the automatic guess: solved, on a mesh that holds, and iterations.

Acrobots, pendubots, carts with one and two pendulums, double and triple pendulums with motors in all or in all but
one of their joints go from hanging to standing. Each chain is solved freely, carts on a short track, and again with
its inputs limited to a share of the peaks that were found. ``python random_swing_ups.py [COUNT [SEED]]`` prints a
table for COUNT chains of each kind.
"""

from __future__ import annotations

import sys
from functools import partial

import numpy as np
from random_families import HEADER, Problem, bar, end, free_and_limited, inputs, instance

import mbdcasadi as mbd

#: Share of the free peaks to which inputs are limited.
SHARE = 0.7
#: Kinds of chains: links, joints with a motor (0 is the first one, on the ground or the cart), and whether on a cart.
KINDS = {
    "acrobot": (2, (1,), False),
    "pendubot": (2, (0,), False),
    "cart": (1, (), True),
    "cart, two links": (2, (), True),
    "double pendulum": (2, (0, 1), False),
    "triple pendulum": (3, (0, 1, 2), False),
    "triple pendulum, free shoulder": (3, (1, 2), False),
    "triple pendulum, free wrist": (3, (0, 1), False),
}


def swing_up(random: np.random.Generator, limits: list[float] | None, *, kind: str) -> Problem:
    """From hanging to standing, at rest at both ends, with the least integral of the squared inputs."""
    count, driven, on_cart = KINDS[kind]
    lengths = random.uniform(0.4, 1.2, count)
    heights = -np.r_[0.0, np.cumsum(lengths)]
    points = np.column_stack([np.zeros(count + 1), heights])
    links = [bar(f"link {k}", random.uniform(0.5, 2), points[k], points[k + 1]) for k in range(count)]
    motors = inputs([f"tau {k}" for k in driven] or ["F"], limits)
    track, distance = random.uniform(0.8, 2.0), float(random.uniform(-0.5, 0.5))
    slow = np.sqrt(np.sum(lengths) / 9.81)
    duration = random.uniform(5, 9) * slow
    bodies, joints, base, carried = list(links), [], mbd.ground.at(0, 0), [mbd.ground]
    forces: list = [mbd.Gravity()]
    initial, final, path = [], [], []
    if on_cart:
        cart = mbd.Body("cart", mass=random.uniform(0.5, 2), inertia=0.1, pose=(0, 0, 0))
        bodies, joints, base = [cart, *links], [mbd.Translational("rail", base, cart.at(0, 0))], cart.at(0, 0)
        forces.append(mbd.GeneralizedForce("drive", [(cart.x, motors[0])]))
        path = [mbd.bounded(-track, cart.x, track)]
        initial, final = [cart.x == 0, cart.vx == 0], [cart.x == distance, cart.vx == 0]
    for k, link in enumerate(links):
        joints.append(mbd.Revolute(f"joint {k}", base, end(link, lengths[k], -1)))
        base = end(link, lengths[k], 1)
        if k in driven:
            motor = motors[driven.index(k)]
            forces.append(mbd.Torque(f"motor {k}", link, motor, *carried[1:]))
        carried = [mbd.ground, link]
    initial += [c for link in links for c in (link.phi == -np.pi / 2, link.omega == 0)]
    final += [c for link in links for c in (link.phi == np.pi / 2, link.omega == 0)]
    mechanism = mbd.Mechanism(bodies, joints, forces=forces, inputs=motors)
    cost = sum(motor**2 for motor in motors)
    return Problem(mechanism, duration=duration, initial=initial, final=final, path=path, running_cost=cost)


def main(count: int = 5, seed: int = 0) -> None:
    """Solve chains of all kinds and print the table."""
    print(HEADER)
    for kind in KINDS:
        make = partial(swing_up, kind=kind)
        free_and_limited(kind, SHARE, [partial(instance, make, seed, k) for k in range(count)])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
