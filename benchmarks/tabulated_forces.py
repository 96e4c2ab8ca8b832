"""Time of a slider-crank under a gas force by a formula and by data; prints Markdown.

    python benchmarks/tabulated_forces.py [points]

Milliseconds of the processor, the least of some runs of one second, and the time in comparison with the formula.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

from machine import one_thread

one_thread()

import casadi as ca  # noqa: E402  (after the threads are set)
import numpy as np  # noqa: E402

import mbdcasadi as mbd  # noqa: E402

REPEATS = 5
#: Force on the piston by angle and angular velocity of the crank, N.
Law = Callable[[ca.SX, ca.SX], ca.SX]


def laws(points: int) -> dict[str, Law]:
    """The same force as a formula, through points of two turns, and over angle and speed."""
    angles, speeds = np.linspace(0, 4 * np.pi, points), np.linspace(0, 60, 5)
    forces = -50 * (1 + np.cos(angles / 2)) ** 2
    splines: dict[str, Law] = {
        f"spline, {kind}": lambda angle, _, kind=kind: mbd.spline(angle, angles, forces, kind=kind, outside="periodic")
        for kind in ("cubic", "monotone", "linear")
    }
    grid = np.tile(forces[:, None], (1, speeds.size))
    return {
        "formula": lambda angle, _: -50 * (1 + ca.cos(angle / 2)) ** 2,
        **splines,
        "table": lambda angle, speed: mbd.table(angle, speed, angles, speeds, grid, outside=("periodic", "linear")),
    }


def engine(law: Law) -> mbd.Mechanism:
    """A slider-crank that starts at 20 rad/s."""
    crank = mbd.Body("crank", mass=0.5, inertia=0.001, pose=(0.0, 0.0, 0.3), velocity=(0.0, 0.0, 20.0))
    rod, piston = mbd.Body("rod", mass=0.5, inertia=0.003), mbd.Body("piston", mass=0.4, inertia=0.001)
    joints = [
        mbd.Revolute("main", mbd.ground.at(0, 0), crank.at(0, 0)),
        mbd.Revolute("crank pin", crank.at(0.05, 0), rod.at(-0.1, 0)),
        mbd.Revolute("piston pin", rod.at(0.1, 0), piston.at(0, 0)),
        mbd.Translational("bore", mbd.ground.at(0, 0), piston.at(0, 0)),
    ]
    gas = mbd.Force("gas", piston.at(0, 0), (law(crank.phi, crank.omega), 0))
    return mbd.Mechanism([crank, rod, piston], joints, forces=[gas])


def measured(mechanism: mbd.Mechanism, method: str) -> tuple[float, float]:
    """Time of the first run and the least of later ones, ms."""
    took = []
    for _ in range(REPEATS + 1):
        began = time.process_time()
        mbd.simulate(mechanism, np.linspace(0, 1, 201), method=method)
        took.append(1e3 * (time.process_time() - began))
    return took[0], min(took[1:])


def main() -> None:
    points = int(sys.argv[1]) if len(sys.argv) > 1 else 145
    print(
        f"| {points} points | idas, ms | | first run | dop853, ms | | first run |\n|---|---:|---:|---:|---:|---:|---:|"
    )
    formula: list[float] = []
    for name, law in laws(points).items():
        first, later = zip(*(measured(engine(law), method) for method in ("idas", "dop853")), strict=True)
        formula = formula or list(later)
        cells = [f"{own:.1f} | {own / base:.2f} | {f:.0f}" for own, base, f in zip(later, formula, first, strict=True)]
        print(f"| {name} | " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main()
