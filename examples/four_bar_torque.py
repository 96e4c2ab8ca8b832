"""Which crank torque carries a four-bar from rest to rest, half a turn in 0.6 s, with the least effort?

Then the same with a bearing that bears 15 % less, and as fast as the motor can.
Each torque is found by direct collocation on the equations that are simulated,
and confirmed by an IDAS run from rest.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"


def bar(name, mass, length, pose):
    """A slender uniform bar."""
    return mbd.Body(name, mass=mass, inertia=mass * length**2 / 12, pose=pose)


crank = bar("crank", 0.3, 0.10, (0.04, 0.02, 0.5))
coupler = bar("coupler", 0.8, 0.28, (0.19, 0.14, 0.7))
rocker = bar("rocker", 0.7, 0.24, (0.30, 0.12, 1.6))
tau = mbd.Input("tau", lower=-20, upper=20)
o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-0.05, 0))
pin_a = mbd.Revolute("A", crank.at(0.05, 0), coupler.at(-0.14, 0))
pin_b = mbd.Revolute("B", coupler.at(0.14, 0), rocker.at(0.12, 0))
o4 = mbd.Revolute("O4", mbd.ground.at(0.30, 0), rocker.at(-0.12, 0))
linkage = mbd.Mechanism(
    bodies=[crank, coupler, rocker],
    joints=[o2, pin_a, pin_b, o4],
    forces=[mbd.Gravity(), mbd.Torque("motor", crank, tau)],
    inputs=[tau],
    name="four-bar",
)

problem = mbd.OptimalControlProblem(
    linkage,
    duration=0.6,
    initial=[o2.angle == 0.5, crank.omega == 0],
    final=[o2.angle == 0.5 + np.pi, crank.omega == 0],
    running_cost=tau**2,
)
load = mbd.norm(o4.reaction_on(rocker).force)
effort = mbd.optimize(problem)
limit = 0.85 * effort.trajectory[load].max()
gentle = mbd.optimize(problem.replace(path=[load <= limit]), guess=effort)
torque = 6.0
hurry = problem.replace(
    duration=(0.05, 2.0), path=[mbd.bounded(-torque, tau, torque)], running_cost=0, terminal_cost=mbd.t
)
fastest = mbd.optimize(hurry, intervals=60, guess=effort)

solutions = {"least effort": effort, "bearing O4 spared": gentle, "least time": fastest}
for name, solution in solutions.items():
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 2001))
    print(f"{name}: {solution}")
    print(f"  peak torque {np.abs(motion[tau]).max():.2f} N m, peak load of O4 {motion[load].max():.2f} N")
    print(f"  {solution.verify()}")
    for active in solution.active_limits:
        print(f"  {active}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(11, 4.4), layout="constrained")
axes = figure.subplot_mosaic(
    [["pose", "torque", "torque, fast"], ["pose", "load", "load, fast"]], width_ratios=(1.7, 1.2, 0.8)
)
mbd.draw(effort, axes["pose"], poses=7, trace=[coupler.at(0, 0)])
axes["pose"].set_title("least effort, every 0.1 s")

for name, solution in solutions.items():
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 601))
    suffix, colour = {"least time": (", fast", "#d1495b"), "least effort": ("", "#1f5fa8")}.get(name, ("", "#2e8b6f"))
    axes["torque" + suffix].plot(motion.t, motion[tau], color=colour, label=name)
    axes["load" + suffix].plot(motion.t, motion[load], color=colour)
axes["torque"].legend(fontsize="small")
for panel, level in (("torque, fast", torque), ("torque, fast", -torque), ("load", limit)):
    axes[panel].axhline(level, color="black", linewidth=0.8, linestyle="--", zorder=0)
axes["torque, fast"].set_title("least time")
axes["torque"].set(ylabel="crank torque, N m", title="in 0.6 s")
axes["load"].set(xlabel="t, s", ylabel="load of bearing O4, N", ylim=(0, None))
axes["load, fast"].set(xlabel="t, s", ylim=(0, None))
axes["load"].annotate("limit", (0.45, limit), textcoords="offset points", xytext=(0, 3))
figure.savefig(OUTPUT / "four_bar_torque.png", dpi=150)
