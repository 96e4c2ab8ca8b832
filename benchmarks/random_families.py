"""Random mechanisms in optimal control from the automatic guess: how many are solved, and in how many iterations.

Five families: crank-rockers and drag-links, slider-cranks, five-bars with two motors, Watt six-bars, carts with a
double pendulum. Each instance is solved without limits, and again with its inputs limited to a share of the peaks
that were found. If that is said to be infeasible, the least multiple of the limits that will do is searched from the
free motion; it is printed, and "wrongly" counts those of at most 1. ``python random_families.py [COUNT [SEED]]`` prints
a table.
"""

from __future__ import annotations

import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

import numpy as np

import mbdcasadi as mbd

#: Share of the free peaks to which inputs are limited, by family; cranks have one motor, which gravity loads.
SHARES = {"crank-rocker": 1.3, "slider-crank": 1.3, "five-bar": 0.8, "Watt six-bar": 1.3, "cart, double pendulum": 0.8}

Problem = mbd.OptimalControlProblem


def bar(name: str, density: float, first: np.ndarray, last: np.ndarray) -> mbd.Body:
    """A slender bar from one point to another."""
    length = float(np.linalg.norm(last - first))
    angle = float(np.arctan2(*(last - first)[::-1]))
    mass = density * length
    return mbd.Body(name, mass=mass, inertia=mass * length**2 / 12, pose=(*((first + last) / 2), angle))


def end(body: mbd.Body, length: float, side: int) -> mbd.Marker:
    """First (-1) or last (1) point of a bar."""
    return body.at(side * length / 2, 0)


def meet(a: np.ndarray, b: np.ndarray, from_a: float, from_b: float, side: int) -> np.ndarray | None:
    """Point at given distances from two others; None if they are too far apart or too near."""
    reach = b - a
    rho = float(np.linalg.norm(reach))
    along = (from_a**2 - from_b**2 + rho**2) / (2 * rho)
    square = from_a**2 - along**2
    if square <= (0.15 * from_a) ** 2:
        return None
    return a + (along * reach + side * np.sqrt(square) * np.array([-reach[1], reach[0]])) / rho


def rest_to_rest(mechanism: mbd.Mechanism, duration: float, moves: dict, cost: object) -> Problem:
    """From one value to another of each quantity, at rest at both ends; quantity to (rate, first, last)."""
    initial, final = [], []
    for quantity, (rate, first, last) in moves.items():
        initial += [quantity == first, rate == 0]
        final += [quantity == last, rate == 0]
    return Problem(mechanism, duration=duration, initial=initial, final=final, running_cost=cost)


def gravity(random: np.random.Generator) -> list[mbd.Gravity]:
    """Gravity in half of the instances."""
    return [mbd.Gravity()] if random.random() < 0.5 else []


def rotating_lengths(random: np.random.Generator) -> tuple[float, float, float, float]:
    """Crank, coupler, rocker and base of a linkage whose crank turns round."""
    while True:
        lengths = np.sort(random.uniform(0.05, 0.5, 4))
        if lengths[0] + lengths[3] < 0.97 * (lengths[1] + lengths[2]):
            break
    shortest, others = lengths[0], random.permutation(lengths[1:])
    if random.integers(2):
        return others[0], others[1], others[2], shortest
    return shortest, others[0], others[1], others[2]


def crank_rocker(random: np.random.Generator, limits: list[float] | None) -> Problem:
    """Half a turn of the crank."""
    while True:
        crank, coupler, rocker, base = rotating_lengths(random)
        start, side = random.uniform(0, 2 * np.pi), random.choice([-1, 1])
        o2, o4 = np.zeros(2), np.array([base, 0.0])
        a = crank * np.array([np.cos(start), np.sin(start)])
        b = meet(a, o4, coupler, rocker, side)
        if b is not None:
            break
    bodies = [
        bar(n, random.uniform(1, 6), *p) for n, p in {"crank": (o2, a), "coupler": (a, b), "rocker": (o4, b)}.items()
    ]
    joints = [
        mbd.Revolute("O2", mbd.ground.at(0, 0), end(bodies[0], crank, -1)),
        mbd.Revolute("A", end(bodies[0], crank, 1), end(bodies[1], coupler, -1)),
        mbd.Revolute("B", end(bodies[1], coupler, 1), end(bodies[2], rocker, 1)),
        mbd.Revolute("O4", mbd.ground.at(base, 0), end(bodies[2], rocker, -1)),
    ]
    (tau,) = inputs(["tau"], limits)
    forces = [mbd.Torque("motor", bodies[0], tau), *gravity(random)]
    mechanism = mbd.Mechanism(bodies, joints, forces=forces, inputs=[tau])
    first = float(bodies[0].pose_estimate[2])
    moves = {bodies[0].phi: (bodies[0].omega, first, first + np.pi)}
    return rest_to_rest(mechanism, random.uniform(0.3, 1.5), moves, tau**2)


def slider_crank(random: np.random.Generator, limits: list[float] | None) -> Problem:
    """Half a turn of the crank."""
    crank = random.uniform(0.05, 0.2)
    rod, offset, start = crank * random.uniform(1.8, 4), crank * random.uniform(-0.5, 0.5), random.uniform(0, 2 * np.pi)
    a = crank * np.array([np.cos(start), np.sin(start)])
    b = np.array([a[0] + np.sqrt(rod**2 - (offset - a[1]) ** 2), offset])
    links = [bar("crank", random.uniform(1, 6), np.zeros(2), a), bar("rod", random.uniform(1, 6), a, b)]
    slider = mbd.Body("slider", mass=random.uniform(0.2, 2), inertia=1e-3, pose=(*b, 0))
    joints = [
        mbd.Revolute("O2", mbd.ground.at(0, 0), end(links[0], crank, -1)),
        mbd.Revolute("A", end(links[0], crank, 1), end(links[1], rod, -1)),
        mbd.Revolute("B", end(links[1], rod, 1), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, offset), slider.at(0, 0)),
    ]
    (tau,) = inputs(["tau"], limits)
    forces = [mbd.Torque("motor", links[0], tau), *gravity(random)]
    mechanism = mbd.Mechanism([*links, slider], joints, forces=forces, inputs=[tau])
    moves = {links[0].phi: (links[0].omega, float(links[0].pose_estimate[2]), float(links[0].pose_estimate[2]) + np.pi)}
    return rest_to_rest(mechanism, random.uniform(0.3, 1.5), moves, tau**2)


def five_bar(random: np.random.Generator, limits: list[float] | None) -> Problem:
    """Both cranks turn by up to a quarter, the closing dyad on one side."""
    while True:
        base, cranks, rods = random.uniform(0.1, 0.4), random.uniform(0.1, 0.3, 2), random.uniform(0.2, 0.5, 2)
        first, turn, side = random.uniform(0.2, np.pi - 0.2, 2), random.uniform(-1.5, 1.5, 2), random.choice([-1, 1])
        o1, o2 = np.zeros(2), np.array([base, 0.0])
        closed = []
        for share in np.linspace(0, 1, 21):
            angles = first + share * turn
            a, b = (o + c * np.array([np.cos(p), np.sin(p)]) for o, c, p in zip((o1, o2), cranks, angles, strict=True))
            closed.append(meet(a, b, *rods, side))
        if all(c is not None for c in closed):
            break
    a, b = (o + c * np.array([np.cos(p), np.sin(p)]) for o, c, p in zip((o1, o2), cranks, first, strict=True))
    c = closed[0]
    points = {"left": (o1, a), "right": (o2, b), "rod 1": (a, c), "rod 2": (b, c)}
    left, right, one, two = (bar(name, random.uniform(1, 6), *p) for name, p in points.items())
    joints = [
        mbd.Revolute("O1", mbd.ground.at(0, 0), end(left, cranks[0], -1)),
        mbd.Revolute("O2", mbd.ground.at(base, 0), end(right, cranks[1], -1)),
        mbd.Revolute("A", end(left, cranks[0], 1), end(one, rods[0], -1)),
        mbd.Revolute("B", end(right, cranks[1], 1), end(two, rods[1], -1)),
        mbd.Revolute("C", end(one, rods[0], 1), end(two, rods[1], 1)),
    ]
    motors = inputs(["tau 1", "tau 2"], limits)
    forces = [mbd.Torque(f"motor {k}", body, u) for k, (body, u) in enumerate(zip((left, right), motors, strict=True))]
    mechanism = mbd.Mechanism([left, right, one, two], joints, forces=[*forces, *gravity(random)], inputs=motors)
    moves = {
        body.phi: (body.omega, float(p), float(p + d)) for body, p, d in zip((left, right), first, turn, strict=True)
    }
    return rest_to_rest(mechanism, random.uniform(0.3, 1.5), moves, motors[0] ** 2 + motors[1] ** 2)


def watt_six_bar(random: np.random.Generator, limits: list[float] | None) -> Problem:
    """A crank-rocker whose rocker drives a second loop; half a turn of the crank."""
    while True:
        crank, coupler, rocker, base = rotating_lengths(random)
        start, side = random.uniform(0, 2 * np.pi), random.choice([-1, 1])
        arm, rod, last = random.uniform(0.1, 0.4), random.uniform(0.2, 0.6), random.uniform(0.1, 0.5)
        pivot, bend = random.uniform(-0.4, 0.8, 2), random.uniform(-2, 2)
        o2, o4 = np.zeros(2), np.array([base, 0.0])
        poses = []
        for angle in start + np.linspace(0, np.pi, 25):
            a = crank * np.array([np.cos(angle), np.sin(angle)])
            b = meet(a, o4, coupler, rocker, side)
            d = None
            if b is not None:
                turned = np.arctan2(*(b - o4)[::-1]) + bend
                c = o4 + arm * np.array([np.cos(turned), np.sin(turned)])
                d = meet(c, pivot, rod, last, 1)
            poses.append(None if d is None else (a, b, c, d))
        if all(pose is not None for pose in poses):
            break
    a, b, c, d = poses[0]
    points = {"crank": (o2, a), "coupler": (a, b), "rocker": (o4, b), "rod": (c, d), "follower": (pivot, d)}
    one, two, three, four, five = (bar(name, random.uniform(1, 6), *p) for name, p in points.items())
    local = arm * np.array([np.cos(bend), np.sin(bend)]) - [rocker / 2, 0]
    joints = [
        mbd.Revolute("O2", mbd.ground.at(0, 0), end(one, crank, -1)),
        mbd.Revolute("A", end(one, crank, 1), end(two, coupler, -1)),
        mbd.Revolute("B", end(two, coupler, 1), end(three, rocker, 1)),
        mbd.Revolute("O4", mbd.ground.at(base, 0), end(three, rocker, -1)),
        mbd.Revolute("C", three.at(*local), end(four, rod, -1)),
        mbd.Revolute("D", end(four, rod, 1), end(five, last, 1)),
        mbd.Revolute("O6", mbd.ground.at(*pivot), end(five, last, -1)),
    ]
    (tau,) = inputs(["tau"], limits)
    forces = [mbd.Torque("motor", one, tau), *gravity(random)]
    mechanism = mbd.Mechanism([one, two, three, four, five], joints, forces=forces, inputs=[tau])
    moves = {one.phi: (one.omega, float(one.pose_estimate[2]), float(one.pose_estimate[2]) + np.pi)}
    return rest_to_rest(mechanism, random.uniform(0.3, 1.5), moves, tau**2)


def double_pendulum_cart(random: np.random.Generator, limits: list[float] | None) -> Problem:
    """A crane: the cart moves along, both pendulums hang at rest before and after."""
    lengths, distance = random.uniform(0.2, 0.8, 2), random.uniform(0.5, 2)
    cart = mbd.Body("cart", mass=random.uniform(0.5, 3), inertia=0.1, pose=(0, 0, 0))
    knots = [np.zeros(2), np.array([0, -lengths[0]]), np.array([0, -lengths.sum()])]
    upper, lower = (bar(f"link {k}", random.uniform(0.5, 3), knots[k - 1], knots[k]) for k in (1, 2))
    joints = [
        mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0)),
        mbd.Revolute("A", cart.at(0, 0), end(upper, lengths[0], -1)),
        mbd.Revolute("B", end(upper, lengths[0], 1), end(lower, lengths[1], -1)),
    ]
    (force,) = inputs(["F"], limits)
    forces = [mbd.Gravity(), mbd.GeneralizedForce("drive", [(cart.x, force)])]
    mechanism = mbd.Mechanism([cart, upper, lower], joints, forces=forces, inputs=[force])
    moves = {cart.x: (cart.vx, 0.0, float(distance))}
    moves |= {body.phi: (body.omega, -np.pi / 2, -np.pi / 2) for body in (upper, lower)}
    return rest_to_rest(mechanism, random.uniform(1.0, 3.0), moves, force**2)


def inputs(names: list[str], limits: list[float] | None) -> list[mbd.Input]:
    """Inputs, perhaps limited to both sides."""
    bounds = [np.inf] * len(names) if limits is None else limits
    return [mbd.Input(name, lower=-bound, upper=bound) for name, bound in zip(names, bounds, strict=True)]


FAMILIES: dict[str, Callable[..., Problem]] = {
    "crank-rocker": crank_rocker,
    "slider-crank": slider_crank,
    "five-bar": five_bar,
    "Watt six-bar": watt_six_bar,
    "cart, double pendulum": double_pendulum_cart,
}


#: Head of the tables.
HEADER = """\
| family | limits | solved | said to be infeasible | wrongly | median iterations | coarse | seconds in all |
|---|---|---:|---:|---:|---:|---:|---:|"""


@dataclass
class Tally:
    """Counts of the solves of a family: what was tried, what was said, iterations and seconds of the processor."""

    family: str
    number: int = 0
    infeasible: int = 0
    wrongly: int = 0
    coarse: int = 0
    seconds: float = 0.0
    iterations: list[int] = field(default_factory=list)

    def solve(self, problem: Problem) -> mbd.Solution | None:
        """Solve a problem from the automatic guess and count it; None if it is not solved."""
        self.number += 1
        began = time.process_time()
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                solution = mbd.optimize(problem)
                self.iterations.append(solution.statistics.iterations)
            except mbd.OptimizationError as error:
                solution = None
                self.infeasible += "infeasible" in str(error)
                print(f"  {self.family}, number {self.number}: {str(error)[:160]}", file=sys.stderr)
        self.coarse += any("too coarse" in str(w.message) for w in caught)
        self.seconds += time.process_time() - began
        return solution

    def row(self, limits: str) -> str:
        """Row of the table."""
        median = f"{np.median(self.iterations):g}" if self.iterations else "–"
        solved = f"{len(self.iterations)} of {self.number} | {self.infeasible} | {self.wrongly}"
        return f"| {self.family} | {limits} | {solved} | {median} | {self.coarse} | {self.seconds:.1f} |"


def instance(make: Callable[..., Problem], seed: int, k: int, limits: list[float] | None) -> Problem:
    """An instance of a family, the same one for any limits."""
    return make(np.random.default_rng([seed, k]), limits)


def free_and_limited(family: str, share: float, problems: Sequence[Callable[[list[float] | None], Problem]]) -> None:
    """Solve problems without limits and with inputs limited to a share of their peaks, and print both rows."""
    free, limited = Tally(family), Tally(family)
    for make in problems:
        solution = free.solve(make(None))
        if solution is not None:
            limits = share * np.max(np.abs(solution.trajectory.inputs), axis=0)
            said = limited.infeasible
            limited.solve(make(limits.tolist()))
            if limited.infeasible > said:
                multiple = least_multiple(solution, limits)
                limited.wrongly += multiple <= 1
                print(f"  the least multiple of the limits found is {multiple:.6f}", file=sys.stderr)
    print(free.row("none"))
    print(limited.row(f"{share:g} of the peak"), flush=True)


def least_multiple(free: mbd.Solution, limits: np.ndarray) -> float:
    """Least multiple of limits of the inputs with which a problem can be solved, from its free solution."""
    problem, multiple = free.problem, mbd.Parameter("multiple", 1.0, lower=0.0)
    within = [
        mbd.bounded(-limit * multiple, u, limit * multiple)
        for u, limit in zip(problem.mechanism.inputs, limits.tolist(), strict=True)
    ]
    least = problem.replace(
        path=[*problem.path, *within], running_cost=0, terminal_cost=multiple, free_parameters=[multiple]
    )
    return float(mbd.optimize(least, guess=free).cost)


def print_verified(families: Mapping[str, Callable[[np.random.Generator], Problem]], count: int, seed: int) -> None:
    """Solve instances of families with limits of their own, and print a row of each with the largest defect."""
    print(HEADER)
    for name, make in families.items():
        tally, defect = Tally(name), 0.0
        for k in range(count):
            solution = tally.solve(make(np.random.default_rng([seed, k])))
            if solution is not None:
                defect = max(defect, float(np.max(solution.verify().defects)))
        print(tally.row(f"own, defect {defect:.0e}"), flush=True)


def main(count: int = 10, seed: int = 0) -> None:
    """Solve all families and print the table."""
    print(HEADER)
    for name, make in FAMILIES.items():
        free_and_limited(name, SHARES[name], [partial(instance, make, seed, k) for k in range(count)])


if __name__ == "__main__":
    main(*map(int, sys.argv[1:3]))
