"""How fast can a geared motor raise an arm, and is the answer the one that the phase plane gives?

A motor of limited torque raises an arm through a gear, from rest to rest.
In least time it accelerates at the limit and brakes at the limit; where it
switches follows in the phase plane from the energies alone. With a limit on
the motor's speed it coasts in between. Direct collocation knows nothing of
switches: it is compared with the phase plane, and an IDAS run confirms the motion.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
RATIO, TORQUE, LIMIT = 20.0, 1.0, 60.0  # motor turns an arm turn, N m, rad/s
MASS, LENGTH, ROTOR = 2.0, 0.8, 2.0e-3  # kg, m, kg m²
START, END = -np.pi / 3, np.pi / 3  # rad, from the horizontal

tau = mbd.Input("motor torque", lower=-TORQUE, upper=TORQUE)
arm = mbd.Body("arm", mass=MASS, inertia=MASS * LENGTH**2 / 12, pose=(0.2, -0.35, START))
rotor = mbd.Body("rotor", mass=0.5, inertia=ROTOR, pose=(-0.1, 0, RATIO * START))
hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-LENGTH / 2, 0))
lifter = mbd.Mechanism(
    bodies=[arm, rotor],
    joints=[
        hinge,
        mbd.Revolute("shaft", mbd.ground.at(-0.1, 0), rotor.at(0, 0)),
        mbd.Constraint("gear", rotor.phi - RATIO * arm.phi),
    ],
    forces=[mbd.Gravity(), mbd.Torque("motor", rotor, tau)],
    inputs=[tau],
    name="geared arm",
)
raising = mbd.OptimalControlProblem(
    lifter,
    duration=(0.1, 5.0),
    initial=[arm.phi == START, arm.omega == 0],
    final=[arm.phi == END, arm.omega == 0],
    terminal_cost=mbd.t,
)
limited = raising.replace(path=[rotor.omega <= LIMIT])
# waypoints at free times move the mesh, so that a switch can fall on a mesh point
moving = raising.replace(waypoints=[mbd.Waypoint((0.2, 0.7))])
reached = mbd.Waypoint((0.1, 0.5), [rotor.omega == LIMIT, tau == TORQUE])  # the torque just before it
coasting = limited.replace(waypoints=[reached, mbd.Waypoint((0.5, 0.85), [rotor.omega == LIMIT])])


def phase_plane(limit):
    """Times, angles, motor speeds and torques of the fastest motion, by the energies."""
    inertia, drive, weight = MASS * LENGTH**2 / 3 + RATIO**2 * ROTOR, RATIO * TORQUE, MASS * 9.81 * LENGTH / 2
    turn, step = np.pi / 40000 * (np.arange(40000) + 0.5), np.pi / 40000
    angle = (START + END) / 2 - (END - START) / 2 * np.cos(turn)  # dense where the arm is slow
    speeding = 2 / inertia * (drive * (angle - START) - weight * (np.sin(angle) - np.sin(START)))
    braking = 2 / inertia * (drive * (END - angle) + weight * (np.sin(END) - np.sin(angle)))
    ways = RATIO * np.sqrt([speeding, braking, np.full_like(angle, (limit / RATIO) ** 2)])
    torque = np.choose(np.argmin(ways, axis=0), [TORQUE, -TORQUE, weight * np.cos(angle) / RATIO])
    return np.cumsum(RATIO * (END - START) / 2 * np.sin(turn) * step / ways.min(axis=0)), angle, ways, torque


exact = {"no limit of speed": phase_plane(np.inf), "speed limited": phase_plane(LIMIT)}
found = {"no limit of speed": mbd.optimize(moving, intervals=20, control="constant")}
# times of switching have optima of their own, 1e-4 s apart: the best of eight guesses
found["speed limited"] = mbd.optimize(coasting, intervals=30, degree=4, starts=8)
equal = {f"{name}, equal intervals": mbd.optimize(p) for name, p in zip(exact, (raising, limited), strict=True)}
for name, solution in {**equal, **found}.items():
    right = exact[name.split(",")[0]][0][-1]
    print(f"{name}: {solution.duration:.7f} s, phase plane {right:.7f} s, {solution.statistics.iterations} iterations")
    print(f"  {solution.verify()}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(11, 4.6), layout="constrained")
axes = figure.subplot_mosaic([["plane", "no limit of speed"], ["plane", "speed limited"]])
plane = axes["plane"]
for (name, solution), colour in zip(found.items(), ("#1f5fa8", "#d1495b"), strict=True):
    times, angle, ways, torque = exact[name]
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 41))
    plane.plot(np.degrees(angle), ways.min(axis=0), color=colour, linewidth=1.2, label=f"phase plane, {name}")
    plane.plot(np.degrees(motion[arm.phi]), motion[rotor.omega], "o", color=colour, markersize=4, label="collocation")
    fine = solution.trajectory.at(np.linspace(0, solution.duration, 2001))
    axes[name].plot(times, torque, color="black", linewidth=1, label="phase plane")
    axes[name].plot(fine.t, fine[tau], color=colour, linewidth=3, alpha=0.5, label="collocation")
    axes[name].hlines((-TORQUE, TORQUE), 0, 0.92, "black", "--", linewidth=0.8, zorder=0)
    axes[name].set(
        ylabel="motor torque, N m", title=f"{name}: {solution.duration:.4f} s", xlim=(0, 0.92), xlabel="t, s"
    )
    axes[name].legend(loc="center left", fontsize="small")
for way in exact["no limit of speed"][2][:2]:
    plane.plot(np.degrees(angle), way, color="#a9b4bd", linewidth=1, zorder=0)
plane.axhline(LIMIT, color="black", linewidth=0.8, linestyle="--", zorder=0)
plane.set(xlabel="arm angle, °", ylabel="motor speed, rad/s", xlim=(-62, 62), ylim=(0, 160))
plane.legend(loc="lower center", fontsize="small")
plane.text(-60, 140, "braking at full torque", color="#7a858e")
plane.text(15, 140, "speeding up at full torque", color="#7a858e")
figure.savefig(OUTPUT / "least_time.png", dpi=150)
