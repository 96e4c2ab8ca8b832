"""How does a car body bounce and pitch, and how much of a wavy road reaches the driver?

A half car on two springs and dampers, with an unsprung mass on a stiff tyre at
each end. One linear model gives the modes and the frequency response.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

road = mbd.Input("road")
side = [(-1.9, -0.1), (1.9, -0.1), (1.9, 0.15), (0.9, 0.25), (0.4, 0.6), (-0.9, 0.6), (-1.4, 0.25), (-1.9, 0.2)]
chassis = mbd.Body("chassis", mass=700.0, inertia=1100.0, pose=(0, 0.9, 0), shape=mbd.Polygon(side))
bodies, joints, forces = [chassis], [mbd.Constraint("straight on", chassis.x)], [mbd.Gravity()]
for name, x in (("front", 1.2), ("rear", -1.4)):
    wheel = mbd.Body(f"{name} wheel", mass=40.0, inertia=1.0, pose=(x, 0.3, 0), shape=mbd.Rod(0.1))
    bodies.append(wheel)
    joints += [mbd.Constraint(f"{name} strut", wheel.x - x), mbd.Constraint(f"{name} brake", wheel.phi)]
    spring = mbd.TSDA(
        f"{name} spring", wheel.at(0, 0), chassis.at(x, 0), stiffness=20e3, damping=1.2e3, free_length=0.8
    )
    # the tyre stands on a road that moves up and down
    tyre = mbd.TSDA(
        f"{name} tyre", mbd.ground.at(x, 0), wheel.at(0, 0), stiffness=180e3, free_length=0.3, actuator=-180e3 * road
    )
    forces += [spring, tyre]
car = mbd.Mechanism(bodies=bodies, joints=joints, forces=forces, inputs=[road])

rest = mbd.equilibrium(car)
model = mbd.linearize(car, rest, wrt=[road], outputs={"driver": chassis.at(0.2, 0).y, "front tyre": bodies[1].y})
for mode in model.modes():
    heave, pitch = mode.shape[1], mode.shape[2]
    print(f"{mode}; heave {abs(heave):.2f}, pitch {abs(pitch):.2f}, wheels {np.abs(mode.shape[[4, 7]]).round(2)}")

frequencies = np.geomspace(0.2, 30, 400)
response = np.abs(model.frequency_response(frequencies))[:, :, 0]

figure = Figure(figsize=(8.4, 6.2), layout="constrained")
axes = figure.subplot_mosaic([["bounce", "pitch"], ["response", "response"]], height_ratios=(1, 1.2))
for name, mode in zip(("bounce", "pitch"), sorted(model.modes()[:2], key=lambda mode: abs(mode.shape[2])), strict=True):
    # half a period apart: the mechanism at both ends of its swing
    mbd.draw(mode.motion(amplitude=0.12, periods=0.5), axes[name], poses=2)
    axes[name].set_title(f"{name}: {mode.frequency:.2f} Hz, damping ratio {mode.damping_ratio:.2f}", fontsize="medium")
for values, name, colour in zip(response.T, model.output_names, ("#1f5fa8", "#d1495b"), strict=True):
    axes["response"].loglog(frequencies, values, color=colour, label=name)
axes["response"].set(xlabel="frequency, Hz", ylabel="motion per motion of the road, m/m")
axes["response"].spines[["top", "right"]].set_visible(False)
axes["response"].legend(frameon=False)
figure.savefig(OUTPUT / "modes.png", dpi=120)
