"""Linkages from positions: how many of the known ones are found, and in which time.

``python synthesis.py nine [SECONDS]``: four-bars through the nine points of problem 3 of Wampler, Morgan and Sommese
(1992), of which there are 64 real triples of cognates. ``python synthesis.py curves [COUNT]``: random crank-rockers by
40 points of their coupler curve, 10 s each; found is the generator or a cognate, to 1e-6 of its size.
``python synthesis.py six [COUNT]``: random six-bars of Stephenson's third kind by 11 points of their curve, 10 s each;
found is any that meets the points.
"""

from __future__ import annotations

import sys
import time

import numpy as np

import mbdcasadi as mbd

NINE = [(0.25, 0), (0.52, 0.10), (0.80, 0.70), (1.20, 1.00), (1.40, 1.30), (1.10, 1.48), (0.70, 1.40), (0.20, 1.00)]
NINE.append((0.02, 0.40))


def nine(seconds: float = 120.0) -> None:
    """Count the four-bars through nine points, and those that pass them as they are wanted."""
    model = mbd.library.four_bar(0.5, 1.0, 0.9, 1.1, point=(0.1, 0.3), free=True)
    positions = [[model.point.position == place] for place in NINE]
    found = mbd.synthesize(
        model.mechanism, list(model.unknowns.values()), positions, seconds=seconds, symmetries=[model.cognates]
    )
    ordered = found.where(one_branch=True, in_order=True)
    print(found)
    print(
        f"{len(found)} of 192, residual {max(x.residual for x in found):.1e}; in order on one circuit {len(ordered)}, ",
        end="",
    )
    print(f"with a crank that turns {len(ordered.where(crank_turns=True))}")


def curves(count: int = 20) -> None:
    """Find the generators of random coupler curves."""
    random, hit = np.random.default_rng(1), 0
    for k in range(count):
        lengths = 0.3 + 0.2 * random.random(), 1 + 0.5 * random.random(), 0.9 + 0.4 * random.random(), 1.1
        point = tuple(random.uniform(-0.5, 0.5, 2))
        known = mbd.library.four_bar(*lengths, point=point, gravity=None)
        turning = known.driven(crank=0.5 + 2 * np.pi * mbd.t)
        curve = mbd.kinematics(turning, np.linspace(0, 1, 41)[:-1])[known.point.position]
        model = mbd.library.four_bar(0.5, 1.0, 0.9, 1.1, point=(0.1, 0.3), free=True)
        positions = [[model.point.position == place] for place in curve]
        unknowns, began = list(model.unknowns.values()), time.perf_counter()
        found = mbd.synthesize(model.mechanism, unknowns, positions, exact=False, seconds=10)
        good = found[0].residual < 1e-6 * np.max(np.ptp(curve, axis=0))
        hit += good
        print(
            f"{k}: residual {found[0].residual:.1e}, {time.perf_counter() - began:.1f} s, {hit} of {k + 1}", flush=True
        )


SIX = {"ground": "ADG", "crank": "AB", "coupler": "BCE", "rocker": "DC", "link": "EFP", "output": "GF"}
DRAWN = {"A": (0, 0), "D": (1.1, 0), "B": (0.1, 0.35), "C": (1.2, 0.95), "E": (0.6, 1.1), "F": (1.4, 1.6)}
DRAWN |= {"G": (1.9, 0.4), "P": (0.9, 1.7)}


def six(count: int = 30) -> None:
    """Find six-bars through points of the curves of random ones, whose crank turns."""
    random, hit, tried = np.random.default_rng(5), 0, 0
    while tried < count:
        places = {name: place + 0.12 * random.uniform(-1, 1, 2) for name, place in DRAWN.items()}
        known = mbd.library.free_linkage(places, SIX, gravity=None)
        try:
            turning = known.driven(crank=2 * np.pi * mbd.t)
            curve = mbd.kinematics(turning, np.linspace(0, 1, 12)[:-1])[known.P.position]
        except mbd.MechanismError:  # its crank does not turn
            continue
        tried += 1
        model = mbd.library.free_linkage(DRAWN | {"P": curve[0]}, SIX, gravity=None)
        positions = [[model.P.position == place] for place in curve]
        try:
            found = mbd.synthesize(model.mechanism, list(model.unknowns.values()), positions, seconds=10)
            hit += max(x.residual for x in found) < 1e-9
            print(f"{tried}: {found}, {hit} of {tried}", flush=True)
        except mbd.ModelError as error:
            print(f"{tried}: {error}", flush=True)


def main() -> None:
    """Run one of them."""
    task, *number = sys.argv[1:] or ["nine"]
    {"nine": nine, "curves": curves, "six": six}[task](*map(int, number))


if __name__ == "__main__":
    main()
