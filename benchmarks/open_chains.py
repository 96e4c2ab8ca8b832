"""Swing-ups of open chains from the automatic guess: cost, iterations of each start, error of the mesh, seconds.

Acrobots and pendubots have the parameters of Spong and of Kelly. Each goes from
hanging to standing upright with the least integral of the squared torque.
``python open_chains.py`` prints the table; seconds are those of the processor.
With ``--peer`` they are also solved by plain collocation in angles, see
``open_chain_peer.py``, each in turn.

References
----------
Spong, "The swing up control problem for the acrobot", IEEE Control Systems 15 (1995).
Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017).
"""

from __future__ import annotations

import sys
import time
import warnings
from typing import Any

import numpy as np
import open_chain_peer

import mbdcasadi as mbd

#: Lengths, distances of the centres of mass (m) and inertias (kg m²) of both links, of 1 kg each.
CHAINS = {"Spong": ((1.0, 2.0), (0.5, 1.0), (0.083, 0.33)), "Kelly": ((1.0, 1.0), (0.5, 0.5), (0.083, 0.083))}
#: Seconds of the swing-up.
DURATIONS = (2.5, 4.0)


def swing_up(chain: str, driven: str, duration: float) -> mbd.OptimalControlProblem:
    """The problem with the torque at the shoulder or at the elbow."""
    (first, _), (c_1, c_2), inertias = CHAINS[chain]
    tau = mbd.Input("tau")
    upper = mbd.Body("upper", mass=1.0, inertia=inertias[0], pose=(0, -c_1, -np.pi / 2))
    lower = mbd.Body("lower", mass=1.0, inertia=inertias[1], pose=(0, -first - c_2, -np.pi / 2))
    joints = [
        mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-c_1, 0)),
        mbd.Revolute("elbow", upper.at(first - c_1, 0), lower.at(-c_2, 0)),
    ]
    motor = mbd.Torque("motor", upper, tau) if driven == "shoulder" else mbd.Torque("motor", lower, tau, upper)
    rest = [upper.omega == 0, lower.omega == 0]
    return mbd.OptimalControlProblem(
        mbd.Mechanism([upper, lower], joints, forces=[mbd.Gravity(), motor], inputs=[tau]),
        duration=duration,
        initial=[upper.phi == -np.pi / 2, lower.phi == -np.pi / 2, *rest],
        final=[upper.phi == np.pi / 2, lower.phi == np.pi / 2, *rest],
        running_cost=tau**2,
    )


def row(problem: mbd.OptimalControlProblem, **options: Any) -> str:
    """Solve a problem; its cells of a table."""
    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", mbd.MechanismWarning)
        solution = mbd.optimize(problem, **options)
    seconds = time.process_time() - began
    statistics = solution.statistics
    starts = ", ".join(str(start.iterations) for start in statistics.starts) or str(statistics.iterations)
    found = f"{solution.cost:.5g} | {starts} | {solution.mesh.size - 1} | {solution.mesh_error:.1e}"
    return f"{found} | {seconds:.1f} |"


def peer_row(chain: str, driven: str, duration: float) -> str:
    """Solve the problem by the peer; cost, iterations and seconds."""
    began = time.process_time()
    cost, iterations = open_chain_peer.swing_up(*CHAINS[chain], driven, duration)
    return f" {cost:.5g} | {iterations} | {time.process_time() - began:.1f} |"


def main(*, peer: bool) -> None:
    """Solve all cases and print the table."""
    if peer:  # what is loaded at the first solve counts for neither
        row(swing_up("Kelly", "elbow", 2.5), intervals=10, starts=1)
        open_chain_peer.swing_up(*CHAINS["Kelly"], "elbow", 2.5)
    cells = "cost | iterations by start | intervals | error | seconds |"
    print(f"| links | torque at | s | {cells}{' peer: cost | iterations | seconds |' if peer else ''}")
    print("|---|---|---|---|---|---|---|---|" + "---|---|---|" * peer)
    for chain in CHAINS:
        for driven in ("elbow", "shoulder"):
            for duration in DURATIONS:
                found = row(swing_up(chain, driven, duration))
                found += peer_row(chain, driven, duration) if peer else ""
                print(f"| {chain} | {driven} | {duration:g} | {found}", flush=True)


if __name__ == "__main__":
    main(peer="--peer" in sys.argv)
