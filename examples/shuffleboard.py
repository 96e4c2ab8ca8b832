"""How is a puck pushed so that it stops on the mark?

A cue may push only up to the foul line; from there the puck slides alone, slowed
down by dry friction, and must come to rest on the mark. When the cue lets go is
for the optimum to find: contact and friction are in the equations, smoothed, and
sharpened step by step, each solution starting from the last.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

G, MU, LINE, MARK, DURATION = 9.81, 0.15, 0.4, 1.2, 1.6
RADIUS, PUCK, CUE = 0.05, 0.5, 0.2

push = mbd.Input("push", lower=-20, upper=40)
tolerance, stiffness = mbd.Parameter("v_t", 0.01), mbd.Parameter("k", 3000)
puck = mbd.Body("puck", mass=PUCK, inertia=1e-3)
cue = mbd.Body("cue", mass=CUE, inertia=1e-3, pose=(-RADIUS, 0, 0))
table = mbd.Translational("table", mbd.ground.at(0, 0), puck.at(0, 0))
slide = mbd.Translational("slide", mbd.ground.at(0, 0), cue.at(0, 0))
rub = mbd.JointFriction("rub", table, mbd.Coulomb(MU, tolerance))
tip = mbd.Contact(
    "tip",
    mbd.Circle(puck.at(0, 0), RADIUS),
    mbd.HalfPlane(cue.at(0, 0, angle=-np.pi / 2)),
    mbd.HuntCrossley(stiffness, exponent=1.5, damping=2.0),
)
board = mbd.Mechanism(
    [puck, cue],
    [table, slide],
    forces=[mbd.Gravity(), rub, tip, mbd.Force("push", cue.at(0, 0), (push, 0))],
    inputs=[push],
    parameters=[tolerance, stiffness],
)
problem = mbd.OptimalControlProblem(
    board,
    duration=DURATION,
    initial=[puck.x == 0, puck.vx == 0, cue.x == -RADIUS, cue.vx == 0],
    final=[puck.x == MARK, mbd.bounded(-1e-3, puck.vx, 1e-3), cue.vx == 0],
    path=[cue.x <= LINE - RADIUS],
    running_cost=push**2,
)
shove = 4 * mbd.cos(np.pi * mbd.t / 0.8) * mbd.if_else(mbd.t < 0.8, 1, 0)
soft = {tolerance: 0.1, stiffness: 300}
guess = mbd.simulate(board, duration=DURATION, initial=problem.initial, inputs={push: shove}, parameters=soft)
sharper = {tolerance: [0.1, 0.03, 0.01], stiffness: [300, 1000, 3000]}
solution = mbd.optimize(problem, intervals=40, tolerance=1e-4, guess=guess, continuation=sharper)
for step in solution.statistics.steps:
    print(", ".join(f"{name} = {value:g}" for name, value in step.values.items()), end=": ")
    print(f"effort {step.cost:.4f} N²s after {step.iterations} iterations")

motion = solution.trajectory
times = np.linspace(0, DURATION, 801)
fine = motion.at(times)
touching = fine[tip.normal_force] > 1e-3 * fine[tip.normal_force].max()
release = times[np.flatnonzero(touching)[-1]]
print(f"the cue lets go at {release:.3f} s and {motion.at([release])[puck.x][0]:.3f} m; ", end="")
print(f"replayed by IDAS the puck stops {1000 * (solution.verify().trajectory[puck.x][-1] - MARK):.2f} mm off the mark")

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
