"""Random trains of one to three blocks on a rail, with dry friction and buffers, or springs, whose order is not given.

``python random_trains.py [COUNT [SEED [springs]]]`` prints a row for each, and how many were solved and simulated.
Times are those of the processor.
"""

from __future__ import annotations

import sys

import numpy as np
from exact_switching import Train, solved

import mbdcasadi as mbd

#: Error of a simulated motion, in m, m/s and rad, up to which it counts as the planned one.
SAME = 1e-4


def random_train(seed: int, k: int, *, springs: bool = False) -> mbd.OptimalControlProblem:
    """The last of one to three blocks is pushed to its goal by the first, which may come back or stay."""
    random = np.random.default_rng([seed, k])
    count = 1 + k % 3
    lengths = random.uniform(0.1, 0.3, count - 1)
    gaps = random.uniform(0.05, 0.4, count - 1)
    places = np.concatenate([[0.0], np.cumsum(lengths + gaps)])
    train = Train(random.uniform(0.5, 2, count), places, random.uniform(0.1, 0.5, count), lengths)
    goals: list[float | None] = [None] * count
    goals[-1] = float(places[-1] + random.uniform(0.3, 0.8))
    if count > 1 and random.random() < 0.5:
        goals[0] = float(random.uniform(-0.2, 0.1))
    duration = float(random.uniform(1.5, 3))
    return train.problem(0, goals, duration, random.uniform(10, 60, count - 1) if springs else ())


def trains(count: int = 12, seed: int = 20261129, *, springs: bool = False) -> None:
    """Print a row for each random train, and how many were solved and simulated."""
    print("| train | blocks | cost | time, s | switches | simulated, error |\n|---|---|---|---|---|---|")
    good = 0
    for k in range(count):
        found = solved(random_train(seed, k, springs=springs))
        good += found.error < SAME
        cost, switches = (
            (found.report[:100], "")
            if found.solution is None
            else (f"{found.solution.cost:.4f}", len(found.solution.switches))
        )
        print(f"| {k} | {1 + k % 3} | {cost} | {found.seconds:.1f} | {switches} | {found.error:.0e} |", flush=True)
    print(f"\n{good} of {count} are solved and simulated within {SAME:g}")


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:] if text != "springs"]
    trains(*numbers, springs="springs" in sys.argv)
