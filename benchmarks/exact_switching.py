"""Motions with dry friction and contacts whose order is not given: closed forms, balls, carts, nosnoc.

``python exact_switching.py [NAME ...]`` prints the cases; random trains of blocks are in ``random_trains.py``.
``python exact_switching.py peers PYTHON`` solves two of the cases with nosnoc as well, which the interpreter PYTHON has
(``pip install nosnoc``). Times are those of the processor.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from machine import one_thread

one_thread()

import numpy as np  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

G = 9.81
HEADER = "| case | cost | by hand | time, s | switches | simulated, error |\n|---|---|---|---|---|---|"


class Case(NamedTuple):
    """A problem, and its least cost if that is known."""

    problem: mbd.OptimalControlProblem
    exact: float | None = None


# --- one block, 1 kg, on a rail with friction of 0.3 ---------------------------------------------------
def block(way: float = 0.5, limit: float = 20, **more: Any) -> mbd.OptimalControlProblem:
    """From rest to rest; a running cost is given as a function of force and speed."""
    force = mbd.Input("force", lower=-limit, upper=limit)
    part = mbd.Body("part", mass=1, inertia=1)
    rail = mbd.Translational("rail", mbd.ground.at(0, 0), part.at(0, 0))
    forces = [mbd.Gravity(), mbd.Force("push", part.at(0, 0), (force, 0))]
    forces.append(mbd.JointFriction("rub", rail, mbd.DryFriction(0.3)))
    cost = more.pop("cost", lambda force, _: force**2)(force, part.vx)
    return mbd.OptimalControlProblem(
        mbd.Mechanism([part], [rail], forces=forces, inputs=[force]),
        running_cost=cost,
        initial=[part.x == 0, part.vx == 0],
        final=[part.x == way, part.vx == 0],
        **{"duration": 2.0} | more,
    )


def least_effort(way: float) -> float:
    """∫F² dt of a slide in the best time, or in all of the two seconds."""
    friction = 0.3 * G
    slides = min(np.sqrt(6 * way / friction), 2.0)
    return float(friction**2 * slides + 12 * way**2 / slides**3)


def least_time() -> float:
    """Full force, then full force back, both with friction."""
    rates = 1 / (6 - 0.3 * G) + 1 / (6 + 0.3 * G)
    return float(np.sqrt(2 * 0.5 / rates) * rates)


# --- several bodies ----------------------------------------------------------------------------------
def on_rail(name: str, mass: float, x: float) -> tuple[mbd.Body, mbd.Translational]:
    """A body on the rail along x."""
    body = mbd.Body(name, mass=mass, inertia=1, pose=(x, 0, 0))
    return body, mbd.Translational(f"rail of {name}", mbd.ground.at(0, 0), body.at(0, 0))


def buffer(left: mbd.Body, right: mbd.Body, gap: float) -> mbd.RigidContact:
    """Two bodies on a rail that touch if their centres are `gap` apart."""
    face = mbd.HalfPlane(left.at(0, 0, angle=-np.pi / 2))
    return mbd.RigidContact(f"{left.name} and {right.name}", mbd.Circle(right.at(0, 0), gap), face)


class Train(NamedTuple):
    """Blocks in a row on a rail: masses, places, friction, and lengths between centres that touch; kg, m."""

    masses: np.ndarray
    places: np.ndarray
    friction: np.ndarray
    lengths: np.ndarray
    limit: float = 60.0

    def problem(
        self, driven: int, goals: list[float | None], duration: float, stiffness: Sequence[float] = ()
    ) -> mbd.OptimalControlProblem:
        """One block is driven, others may have goals; all are at rest first and last.

        Springs between neighbours, N/m, are as long as these are apart at first.
        """
        force = mbd.Input("force", lower=-self.limit, upper=self.limit)
        made = [on_rail(f"block {k}", m, x) for k, (m, x) in enumerate(zip(self.masses, self.places, strict=True))]
        blocks, rails = zip(*made, strict=True)
        laws = zip(blocks, rails, self.friction, strict=True)
        forces = [mbd.Gravity(), mbd.Force("push", blocks[driven].at(0, 0), (force, 0))]
        forces += [mbd.JointFriction(f"rub of {b.name}", rail, mbd.DryFriction(mu)) for b, rail, mu in laws if mu > 0]
        forces += [buffer(*pair, gap) for pair, gap in zip(itertools.pairwise(blocks), self.lengths, strict=True)]
        apart = zip(stiffness, itertools.pairwise(blocks), np.diff(self.places), strict=False)
        forces += [
            mbd.TSDA(f"spring {k}", one.at(0, 0), other.at(0, 0), stiffness=c, free_length=length)
            for k, (c, (one, other), length) in enumerate(apart)
        ]
        starts = [c for b, x in zip(blocks, self.places, strict=True) for c in (b.x == x, b.vx == 0)]
        ends = [b.x == goal for b, goal in zip(blocks, goals, strict=True) if goal is not None]
        model = mbd.Mechanism(blocks, rails, forces=forces, inputs=[force])
        rest = [b.vx == 0 for b in blocks]
        return mbd.OptimalControlProblem(model, duration, running_cost=force**2, initial=starts, final=[*ends, *rest])


def two_balls() -> mbd.OptimalControlProblem:
    """Two balls above a floor, the upper one on a spring on the lower one: it is at a height at last."""
    force, up = mbd.Input("force", lower=-60, upper=60), np.pi / 2
    low, high = (mbd.Body(name, mass=1, inertia=1, pose=(0, y, 0)) for name, y in (("low", 0.1), ("high", 0.5)))
    rails = [mbd.Translational(f"rail of {b.name}", mbd.ground.at(0, 0, up), b.at(0, 0, up)) for b in (low, high)]
    spring = mbd.TSDA("spring", low.at(0, 0), high.at(0, 0), stiffness=100, free_length=0.5, actuator=-force)
    floor = mbd.RigidContact("floor", mbd.Circle(low.at(0, 0), 0.1), mbd.HalfPlane(mbd.ground.at(0, 0)))
    return mbd.OptimalControlProblem(
        mbd.Mechanism([low, high], rails, forces=[mbd.Gravity(), spring, floor], inputs=[force]),
        0.6,
        running_cost=force**2,
        initial=[low.y == 0.1, low.vy == 0, high.y == 0.5, high.vy == 0],
        final=[high.y == 0.9, high.vy == 0],
    )


def three_carts() -> mbd.OptimalControlProblem:
    """The middle one of three carts, with friction of 0.05, pushes both others where they are wanted."""
    train = Train(np.ones(3), np.array([-3.0, 0.0, 3.0]), np.full(3, 0.05), np.full(2, 2.0))
    return train.problem(1, [-4.0, None, 4.0], 6.0)


def cart_pole() -> mbd.OptimalControlProblem:
    """A pendulum of 0.1 kg swings up on a cart of 1 kg, whose rail takes 2 N by friction."""
    force = mbd.Input("force", lower=-30, upper=30)
    cart, rail = on_rail("cart", 1.0, 1.0)
    bob = mbd.Body("bob", mass=0.1, inertia=1e-9, pose=(1, -1, -np.pi / 2))
    pin = mbd.Revolute("pin", cart.at(0, 0), bob.at(-1, 0))
    forces = [mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (force, 0))]
    forces.append(mbd.LoadIndependentFriction("rub", rail, mbd.DryFriction(1.0), 2.0))
    return mbd.OptimalControlProblem(
        mbd.Mechanism([cart, bob], [rail, pin], forces=forces, inputs=[force]),
        5.0,
        path=[mbd.bounded(-5, cart.x, 5)],
        running_cost=force**2,
        initial=[cart.x == 1, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
        final=[cart.x == 0, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0],
    )


CASES: dict[str, Callable[[], Case]] = {
    "least effort, 0.5 m": lambda: Case(block(), least_effort(0.5)),
    "least effort, 1 m": lambda: Case(block(way=1.0), least_effort(1.0)),
    "least time, 6 N": lambda: Case(
        block(limit=6, duration=(0.1, 5), cost=lambda *_: 0, terminal_cost=mbd.t), least_time()
    ),
    "least positive work": lambda: Case(
        block(cost=lambda force, speed: mbd.positive_part(force * speed)), 0.3 * G * 0.5
    ),
    "two balls": lambda: Case(two_balls()),
    "three carts": lambda: Case(three_carts()),
    "cart-pole": lambda: Case(cart_pole()),
}


# --- solved, and simulated again ---------------------------------------------------------------------
class Outcome(NamedTuple):
    """Solution, or what was reported; time of the processor, s; error of the simulation."""

    solution: Any
    seconds: float
    error: float
    report: str = ""


def solved(problem: mbd.OptimalControlProblem) -> Outcome:
    """Solve from the automatic guess and simulate with the search for stick, slip and touch."""
    begin = time.process_time()
    try:
        solution = mbd.optimize(problem)
    except mbd.OptimizationError as error:
        return Outcome(None, time.process_time() - begin, np.inf, str(error).splitlines()[0])
    return Outcome(solution, time.process_time() - begin, solution.verify().final_error)


def rows(names: list[str]) -> Iterator[str]:
    """Rows of the table of cases."""
    for name in names:
        case = CASES[name]()
        found = solved(case.problem)
        hand = "" if case.exact is None else f"{case.exact:.8f}"
        if found.solution is None:
            yield f"| {name} | {found.report[:100]} | {hand} | {found.seconds:.1f} | | |"
        else:
            cost, when = found.solution.cost, [f"{s.name} {s.t:.4f}" for s in found.solution.switches]
            yield f"| {name} | {cost:.8f} | {hand} | {found.seconds:.1f} | {', '.join(when)} | {found.error:.0e} |"


def peers(python: str) -> None:
    """Print cost and time of this package and of nosnoc for the block and the cart-pole."""
    for name in ("least effort, 0.5 m", "cart-pole"):
        found = solved(CASES[name]().problem)
        own = found.report if found.solution is None else f"{found.solution.cost:.6f}"
        print(f"{name}: mbdcasadi {own} in {found.seconds:.1f} s", flush=True)
        script = Path(__file__).with_name("exact_switching_peer.py")
        print(
            subprocess.run([python, script, name], capture_output=True, text=True, check=True).stdout,
            end="",
            flush=True,
        )


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["peers", python]:
            peers(python)
        case names:
            print(HEADER)
            for row in rows(names or list(CASES)):
                print(row, flush=True)
