"""A cart swings a pole up in two seconds: which force takes the least effort?

The tutorial problem of trajectory optimisation (Kelly, SIAM Review 59, 2017,
849–904). It has two good optima: the usual guess leads to the published one
of 58.81 N²s, other starts to a better one of 57.94 N²s. The mesh of each is
refined until the motion is accurate, and an IDAS run confirms the force.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

force = mbd.Input("force", lower=-20, upper=20)
cart = mbd.Body("cart", mass=1.0, inertia=0.0)
bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, -0.5, -np.pi / 2))  # a point mass on a massless rod
rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
system = mbd.Mechanism(
    bodies=[cart, bob],
    joints=[rail, pole],
    forces=[mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (force, 0))],
    inputs=[force],
    name="cart and pole",
)

swing_up = mbd.OptimalControlProblem(
    system,
    duration=2.0,
    initial=[cart.x == 0, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
    final=[cart.x == 1, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0],
    path=[mbd.bounded(-2, cart.x, 2)],
    running_cost=force**2,
)
usual = mbd.optimize(swing_up, intervals=50)
best = mbd.optimize(swing_up, intervals=50, starts=8)
print("starts:")
for start in best.statistics.starts:
    print(f"  {start.description:36} cost {start.cost:9.4f} N²s, {start.iterations} iterations")

found = {}
for name, coarse in {"usual start": usual, "best of eight starts": best}.items():
    fine = mbd.optimize(swing_up, tolerance=1e-8, degree=5, guess=coarse, intervals=20)
    found[name] = fine
    print(f"\n{name}: {fine}\n{fine.verify()}\n  intervals  local error        cost  iterations")
    for k in fine.statistics.passes:
        print(f"  {k.intervals:9d}  {k.error:11.1e}  {k.cost:10.6f}  {k.iterations:10d}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(10, 6), layout="constrained")
axes = figure.subplot_mosaic([["usual start", "best of eight starts"], ["force", "cart"]], height_ratios=(1.2, 1))
for (name, solution), colour in zip(found.items(), ("#1f5fa8", "#d1495b"), strict=True):
    mbd.draw(solution, axes[name], poses=13, trace=[bob])
    axes[name].set_title(f"{name}: {solution.cost:.2f} N²s")
    motion = solution.trajectory.at(np.linspace(0, 2, 401))
    axes["force"].plot(motion.t, motion[force], color=colour, label=name)
    axes["cart"].plot(motion.t, motion[cart.x], color=colour, label=name)
for level in (-20, 20):
    axes["force"].axhline(level, color="black", linewidth=0.8, linestyle="--")
axes["force"].set(xlabel="t, s", ylabel="force, N")
axes["cart"].set(xlabel="t, s", ylabel="cart, m")
axes["cart"].legend()
figure.savefig(OUTPUT / "cart_pole.png", dpi=150)
