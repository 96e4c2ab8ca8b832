"""How does a parallel robot carry its tool past a post, with motors and a bearing that bear only so much?

Two motors on the ground turn the inner arms; the outer arms meet at the tool
(a five-bar, two closed-loop constraints, horizontal plane). The tool goes
from rest to rest: in a given time with the least effort, first with nothing
in its way, then around the post with the bearing force limited, then as fast
as motors and bearing allow. An IDAS run confirms every motion.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Circle

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

BASE, INNER, OUTER = 0.16, 0.18, 0.26  # m
POST, RADIUS = (0.07, 0.31), 0.06  # m, the tool's own radius included
START, END = (-0.10, 0.26), (0.24, 0.34)  # m
TORQUE, BEARING = 6.0, 25.0  # N m, N


def arm(name, mass, length, pose):
    """A slender uniform arm."""
    return mbd.Body(name, mass=mass, inertia=mass * length**2 / 12, pose=pose)


left, right = arm("left arm", 0.5, INNER, (-0.08, 0.04, 2.6)), arm("right arm", 0.5, INNER, (0.16, 0.09, 1.6))
rod = arm("left rod", 0.4, OUTER, (-0.12, 0.19, 1.3))
other = arm("right rod", 0.4, OUTER, (0.04, 0.24, 2.7))
tool, payload = rod.at(OUTER / 2, 0), mbd.Body("payload", mass=0.5, inertia=0.0, pose=(*START, 0))
tau = [mbd.Input(f"{side} motor", lower=-TORQUE, upper=TORQUE) for side in ("left", "right")]
elbow = mbd.Revolute("left elbow", left.at(INNER / 2, 0), rod.at(-OUTER / 2, 0))
joints = [
    mbd.Revolute("left shoulder", mbd.ground.at(0, 0), left.at(-INNER / 2, 0)),
    elbow,
    mbd.Revolute("tool pin", tool, other.at(OUTER / 2, 0)),
    mbd.Revolute("right elbow", other.at(-OUTER / 2, 0), right.at(INNER / 2, 0)),
    mbd.Revolute("right shoulder", right.at(-INNER / 2, 0), mbd.ground.at(BASE, 0)),
    mbd.Weld("grip", tool, payload.at(0, 0)),
]
robot = mbd.Mechanism(
    bodies=[left, rod, payload, other, right],
    joints=joints,
    forces=[mbd.Torque("left drive", left, tau[0]), mbd.Torque("right drive", right, tau[1])],
    inputs=tau,
    name="five-bar robot",
)
load = mbd.norm(elbow.reaction_on(rod).force)

free = mbd.OptimalControlProblem(
    robot,
    duration=0.25,
    initial=[tool.position == START, rod.omega == 0, other.omega == 0],
    final=[tool.position == END, tool.velocity == (0, 0)],
    running_cost=tau[0] ** 2 + tau[1] ** 2,
)
around = free.replace(path=[mbd.distance(tool.position, POST) >= RADIUS, load <= BEARING])
quick = around.replace(duration=(0.05, 1.0), running_cost=0, terminal_cost=mbd.t)
solutions = {"nothing in the way": mbd.optimize(free), "around the post": mbd.optimize(around)}
# torques that jump are linear on the intervals, so that nothing passes a limit between two points
solutions["least time"] = mbd.optimize(quick, guess=solutions["around the post"], control="linear")
for name, solution in solutions.items():
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 1001))
    gap = motion[mbd.distance(tool.position, POST)].min() - RADIUS
    torques = " and ".join(f"{np.abs(motion[u]).max():.2f}" for u in tau)
    print(f"{name}: {solution.duration:.4f} s, {solution.statistics.iterations} iterations")
    print(f"  torques up to {torques} N m, elbow load {motion[load].max():.1f} N, {1e3 * gap:.2f} mm from the post")
    print(f"  {solution.verify()}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(11, 5.4), layout="constrained")
axes = figure.subplot_mosaic([["scene", u.label] for u in tau] + [["scene", "load"]], width_ratios=(1.2, 1))
scene = axes["scene"]
mbd.draw(solutions["around the post"], scene, poses=6)
scene.add_patch(Circle(POST, RADIUS, facecolor="#e8d9b5", edgecolor="#b07a10", hatch="///", zorder=3))
for (name, solution), colour in zip(solutions.items(), ("#2e8b6f", "#1f5fa8", "#d1495b"), strict=True):
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 501))
    scene.plot(*motion[tool.position].T, color=colour, linewidth=2, label=name, zorder=4)
    for panel, value in {tau[0].label: tau[0], tau[1].label: tau[1], "load": load}.items():
        axes[panel].plot(motion.t, motion[value], color=colour)
for u in tau:
    axes[u.label].set_ylabel(f"{u.label}, N m")
for panel, level in [(u.label, side * TORQUE) for u in tau for side in (-1, 1)] + [("load", BEARING)]:
    axes[panel].axhline(level, color="black", linewidth=0.8, linestyle="--")
axes["load"].set(xlabel="t, s", ylabel="elbow load, N", ylim=(0, None))
scene.set_title("around the post with the least effort, every 0.05 s")
scene.legend(loc="upper center", ncols=3, fontsize="small")
figure.savefig(OUTPUT / "five_bar_robot.png", dpi=150)
