"""How is a puck pushed so that it stops on the mark?

A cue may push only up to the foul line; from there the puck slides alone, slowed
down by dry friction, and must come to rest on the mark. When the cue lets go is
for the optimum to find: contact and friction are exact, and the simulation that
checks it finds the same instants by its own search.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

MU, LINE, MARK, DURATION = 0.15, 0.4, 1.2, 1.6
RADIUS, PUCK, CUE = 0.05, 0.5, 0.2

push = mbd.Input("push", lower=-20, upper=40)
puck = mbd.Body("puck", mass=PUCK, inertia=1e-3)
cue = mbd.Body("cue", mass=CUE, inertia=1e-3, pose=(-RADIUS, 0, 0))
table = mbd.Translational("table", mbd.ground.at(0, 0), puck.at(0, 0))
slide = mbd.Translational("slide", mbd.ground.at(0, 0), cue.at(0, 0))
rub = mbd.JointFriction("rub", table, mbd.DryFriction(MU))
tip = mbd.RigidContact("tip", mbd.Circle(puck.at(0, 0), RADIUS), mbd.HalfPlane(cue.at(0, 0, angle=-np.pi / 2)))
board = mbd.Mechanism(
    [puck, cue],
    [table, slide],
    forces=[mbd.Gravity(), rub, tip, mbd.Force("push", cue.at(0, 0), (push, 0))],
    inputs=[push],
)
problem = mbd.OptimalControlProblem(
    board,
    duration=DURATION,
    initial=[puck.x == 0, puck.vx == 0, cue.x == -RADIUS, cue.vx == 0],
    final=[puck.x == MARK, puck.vx == 0, cue.vx == 0],
    path=[cue.x <= LINE - RADIUS],
    running_cost=push**2,
)
solution = mbd.optimize(problem)
motion = solution.trajectory
for switch in solution.switches:
    print(f"{switch.name} at {switch.t:.4f} s and {motion.at([switch.t])[puck.x][0]:.4f} m", end="; ")
print(f"the effort is {solution.cost:.4f} N²s")
check = solution.verify()
off = 1e9 * abs(check.trajectory[puck.x][-1] - MARK)
print(f"simulated, the puck stops within a nanometre of the mark: {off < 1}")

times = np.linspace(0, DURATION, 801)
fine = motion.at(times)
figure = Figure(figsize=(7, 6), layout="constrained")
places, forces = figure.subplots(2, 1, sharex=True)
places.plot(times, fine[puck.x] - RADIUS, label="puck, rear", color="#1f5fa8")
places.plot(times, fine[cue.x], label="cue", color="#d1495b")
places.axhline(LINE - RADIUS, color="grey", linestyle=":", label="foul line")
places.set_ylabel("place, m")
forces.plot(times, fine[push], label="push", color="#1f5fa8")
forces.plot(times, fine[tip.normal_force], label="contact", color="#d1495b")
forces.plot(times, fine[rub.force], label="friction", color="#2e8b6f")
forces.set_ylabel("force, N")
forces.set_xlabel("t, s")
for axes in (places, forces):
    axes.legend(frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "shuffleboard.png", dpi=120)
