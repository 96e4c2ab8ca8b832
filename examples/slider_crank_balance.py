"""Which spring and which flywheel let the smallest motor run a pump at a speed within 3 %?

The motor turns the crank of a slider-crank whose slider works against a
damper (the pump) and, if wanted, a spring. Stiffness and free length of the
spring and the inertia of the flywheel are found together with the torque over
one periodic turn, so that the peak torque, a parameter of the problem's own,
is least. An IDAS run confirms each turn.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

SPEED, BAND = 20.0, 0.03  # rad/s and its share
stiffness = mbd.Parameter("stiffness", 0.0, lower=0.0, upper=5000.0)  # N/m
free_length = mbd.Parameter("free length", 0.3, lower=0.1, upper=0.5)  # m
flywheel = mbd.Parameter("flywheel", 0.0, lower=0.0, upper=0.03)  # kg m²
peak = mbd.Parameter("peak torque", 5.0, lower=0.0, upper=100.0)  # N m
tau = mbd.Input("tau")

crank = mbd.Body("crank", mass=0.12, inertia=1.0e-4 + flywheel, pose=(0.05, 0.0, 0.0))
rod = mbd.Body("rod", mass=0.50, inertia=4.0e-3, pose=(0.25, 0.0, 0.0))
slider = mbd.Body("slider", mass=2.00, inertia=1.0e-3, pose=(0.40, 0.0, 0.0))
main = mbd.Revolute("main bearing", mbd.ground.at(0, 0), crank.at(-0.05, 0))
pin = mbd.Revolute("crank pin", crank.at(0.05, 0), rod.at(-0.15, 0))
wrist = mbd.Revolute("wrist pin", rod.at(0.15, 0), slider.at(0, 0))
guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))
wall = mbd.ground.at(0.6, 0)
pump = mbd.TSDA("pump", wall, slider.at(0, 0), damping=5.0)
spring = mbd.TSDA("spring", wall, slider.at(0, 0), stiffness=stiffness, free_length=free_length)
machine = mbd.Mechanism(
    bodies=[crank, rod, slider],
    joints=[main, pin, wrist, guide],
    forces=[mbd.Gravity(), mbd.Torque("motor", crank, tau), pump, spring],
    inputs=[tau],
    parameters=[stiffness, free_length, flywheel],
    name="pump",
)

turn = mbd.OptimalControlProblem(
    machine,
    duration=2 * np.pi / SPEED,
    initial=[crank.phi == 0],
    final=[crank.phi == 2 * np.pi],
    boundary=[mbd.at_end(value) == mbd.at_start(value) for value in (crank.omega, tau)],
    path=[mbd.bounded((1 - BAND) * SPEED, crank.omega, (1 + BAND) * SPEED), mbd.bounded(-peak, tau, peak)],
    terminal_cost=peak,
    running_cost=1e-6 * tau.rate**2,  # the peak alone leaves much undecided: the smoothest of the best
    free_parameters=[peak],
)
variants = {"neither": [], "flywheel": [flywheel], "spring": [stiffness, free_length]}
variants["spring and flywheel"] = [*variants["spring"], flywheel]
found = {name: mbd.optimize(turn.replace(free_parameters=[peak, *p]), intervals=80) for name, p in variants.items()}
for name, solution in found.items():
    print(f"{name}: {solution}\n  {solution.verify()}")
mean = found["spring"].trajectory.at(np.linspace(0, turn.duration[1], 2001))[tau].mean()
print(f"the pump alone takes {mean:.3f} N m on the average")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(11, 5.2), layout="constrained")
axes = figure.subplot_mosaic([["scene", "torque"], ["peaks", "speed"]], width_ratios=(1, 1.25))
colours = dict(zip(found, ("#5b6770", "#e0a030", "#2e8b6f", "#1f5fa8"), strict=True))
for name, solution in found.items():
    motion = solution.trajectory.at(np.linspace(0, solution.duration, 721))
    angle = np.degrees(motion[crank.phi])
    axes["torque"].plot(angle, motion[tau], color=colours[name], label=name)
    axes["speed"].plot(angle, motion[crank.omega], color=colours[name])
axes["torque"].axhline(mean, color="black", linewidth=0.8, linestyle=":")
axes["torque"].set(ylabel="motor torque, N m", ylim=(-7, 9.5))
axes["torque"].legend(fontsize="small", loc="upper left", ncols=2)
for side in (1 - BAND, 1 + BAND):
    axes["speed"].axhline(side * SPEED, color="black", linewidth=0.8, linestyle="--")
axes["speed"].set(xlabel="crank angle, °", ylabel="crank speed, rad/s")
for panel in ("torque", "speed"):
    axes[panel].set(xlim=(0, 360), xticks=range(0, 361, 60))
bars = axes["peaks"].barh(list(found), [s.parameters[peak] for s in found.values()], color=list(colours.values()))
axes["peaks"].bar_label(bars, fmt="%.2f", padding=3)
axes["peaks"].set(xlabel="least peak torque, N m", xlim=(0, 7))
axes["peaks"].invert_yaxis()

pose = found["spring and flywheel"].trajectory.at([0.055]).final
mbd.draw(pose, axes["scene"]).set_title("motor, flywheel, spring and pump")
figure.savefig(OUTPUT / "slider_crank_balance.png", dpi=150)
