"""How is a block on a dry rail moved with the least effort: all the time, or faster and with a rest?

Friction is exact: it takes its part only while the block slides. The search finds when it breaks
away and when it sticks again; by hand, the best time to slide does not depend on the time allowed.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

MASS, MU, WAY = 1.0, 0.3, 0.5

force = mbd.Input("force", lower=-20, upper=20)
block = mbd.Body("block", mass=MASS, inertia=0.01, shape=mbd.Rectangle(0.1, 0.06))
rail = mbd.Translational("rail", mbd.ground.at(0, 0), block.at(0, 0))
rub = mbd.JointFriction("rub", rail, mbd.DryFriction(MU))
push = mbd.Force("push", block.at(0, 0), (force, 0))
stage = mbd.Mechanism([block], [rail], forces=[mbd.Gravity(), rub, push], inputs=[force], name="stage")


def cheapest(duration):
    """Least ∫F² dt from rest to rest."""
    ends = {"initial": [block.x == 0, block.vx == 0], "final": [block.x == WAY, block.vx == 0]}
    return mbd.optimize(mbd.OptimalControlProblem(stage, duration, running_cost=force**2, **ends))


def by_hand(duration):
    """∫F² dt = f² τ + 12 m² d² / τ³ of a slide in the time τ, which is the best one unless that is not allowed."""
    friction = MU * MASS * 9.81
    slides = min(np.sqrt(6 * MASS * WAY / friction), duration)
    return friction**2 * slides + 12 * MASS**2 * WAY**2 / slides**3, slides


solutions = {duration: cheapest(duration) for duration in (0.8, 2.0)}
figure = Figure(figsize=(7, 5), layout="constrained")
speeds, forces = figure.subplots(2, 1, sharex=True)
for (duration, solution), colour in zip(solutions.items(), ("#c1553b", "#2a6f97"), strict=True):
    times = [0.0, *(switch.t for switch in solution.switches), duration]
    slides, (cost, best) = max(np.diff(times)), by_hand(duration)
    print(f"in {duration} s: effort {solution.cost:.6f} N² s, by hand {cost:.6f}", end="; ")
    print(f"slides for {slides:.4f} s, by hand {best:.4f} s")
    print(f"simulated, it ends within {solution.verify().final_error:.0e} m")
    fine = solution.trajectory.at(np.linspace(0, duration, 801))
    speeds.plot(fine.t, fine[block.vx], color=colour, label=f"{duration} s allowed")
    forces.plot(fine.t, fine[force], color=colour)
    forces.plot(fine.t, fine[rub.force], color=colour, linestyle=":")
speeds.set_ylabel("speed, m/s")
speeds.legend(frameon=False)
forces.set(xlabel="t, s", ylabel="push and friction (dotted), N")
figure.savefig(OUTPUT / "stick_slip.png", dpi=120)
