"""Swing-ups of acrobots and pendubots from the automatic guess: cost, iterations, error of the mesh, seconds.

The parameters are those of Spong and of Kelly; each chain goes from hanging to
standing upright with the least integral of the squared torque. ``python
open_chains.py`` prints a table; seconds are wall clock on this machine.

References
----------
Spong, "The swing up control problem for the acrobot", IEEE Control Systems 15 (1995).
Kelly, An Introduction to Trajectory Optimization, SIAM Review 59 (2017).
"""

from __future__ import annotations

import time
import warnings

import numpy as np

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


def main() -> None:
    """Solve all cases and print the table."""
    print("| links | torque at | s | cost | iterations by start | intervals | error | seconds |")
    print("|---|---|---|---|---|---|---|---|")
    for chain in CHAINS:
        for driven in ("elbow", "shoulder"):
            for duration in DURATIONS:
                began = time.perf_counter()
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", mbd.MechanismWarning)
                    solution = mbd.optimize(swing_up(chain, driven, duration))
                seconds = time.perf_counter() - began
                starts = ", ".join(str(start.iterations) for start in solution.statistics.starts)
                found = f"{solution.cost:.5g} | {starts} | {solution.mesh.size - 1} | {solution.mesh_error:.1e}"
                print(f"| {chain} | {driven} | {duration:g} | {found} | {seconds:.1f} |")


if __name__ == "__main__":
    main()
