"""Swing-ups of open chains from the automatic guess: cost, iterations of each start, error of the mesh, seconds.

Acrobots and pendubots have the parameters of Spong and of Kelly. Chains with a
motor in every joint are links of 1 m and 1 kg that have 2 s. Each chain goes
from hanging to standing upright with the least integral of the squared
torques. ``python open_chains.py`` prints both tables; seconds are those of the
processor. With ``--peer`` the acrobots and pendubots are also solved by plain
collocation in angles, see ``open_chain_peer.py``, each in turn.

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


#: Chains with a motor in every joint: links, and what ``optimize`` is given.
DRIVEN: tuple[tuple[int, dict], ...] = (
    (5, {"tolerance": 1e-6}),
    (10, {"intervals": 50}),
    (10, {"intervals": 100}),
)


def driven_chain(links: int, duration: float = 2.0) -> mbd.OptimalControlProblem:
    """The problem of uniform bars of 1 m and 1 kg with a motor in every joint."""
    torques = [mbd.Input(f"torque {k + 1}") for k in range(links)]
    bars = [mbd.Body(f"link {k + 1}", mass=1.0, inertia=1 / 12, pose=(0, -k - 0.5, -np.pi / 2)) for k in range(links)]
    before = [mbd.ground, *bars]
    joints, forces = [], [mbd.Gravity()]
    for k, (bar, torque) in enumerate(zip(bars, torques, strict=True)):
        joints.append(mbd.Revolute(f"joint {k + 1}", before[k].at(0.5 if k else 0.0, 0), bar.at(-0.5, 0)))
        forces.append(mbd.Torque(f"motor {k + 1}", bar, torque, before[k]))
    return mbd.OptimalControlProblem(
        mbd.Mechanism(bars, joints, forces=forces, inputs=torques),
        duration=duration,
        initial=[c for bar in bars for c in (bar.phi == -np.pi / 2, bar.omega == 0)],
        final=[c for bar in bars for c in (bar.phi == np.pi / 2, bar.omega == 0)],
        running_cost=sum(torque**2 for torque in torques),
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
    """Solve all cases and print the tables; with the peer the first one alone."""
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
    if peer:
        return
    print(f"\n| links, all driven | given | {cells}")
    print("|---|---|---|---|---|---|---|")
    for links, options in DRIVEN:
        given = ", ".join(f"{name}={value:g}" for name, value in options.items())
        print(f"| {links} | {given} | {row(driven_chain(links), **options)}", flush=True)


if __name__ == "__main__":
    main(peer="--peer" in sys.argv)
