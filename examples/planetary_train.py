"""What ratio does a planetary gear give, what do its teeth carry, and what happens when the ring lets go?

The ring is held and the sun driven: Willis' formula and the tooth forces follow
from the constraints. Then a brake on the ring that slips lets the same
train be simulated with two degrees of freedom.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

SUN, PLANET = 0.04, 0.02
RING = SUN + 2 * PLANET
LOAD = 5.0  # N m on the arm

train = mbd.library.planetary_gear(sun=SUN, planet=PLANET, planets=3)
load = mbd.Torque("load", train.arm, -LOAD)
loaded = train.mechanism.replace(forces=[*train.mechanism.forces, load])

# --- ring held ------------------------------------------------------------------------
drive = mbd.Driver("drive", train.coordinates["sun"], 100 * mbd.t)
brake = mbd.Driver("brake", train.coordinates["ring"], 0 * mbd.t)
run = mbd.inverse_dynamics(loaded.replace(drivers=[drive, brake]), np.linspace(0, 0.5, 201))
ratio = run[train.arm.omega][-1] / run[train.sun.omega][-1]
print(f"arm to sun {ratio:.6f}; Willis says {SUN / (SUN + RING):.6f}")
print(f"torque on the sun {run[drive.effort][-1]:.4f} N m, on the held ring {run[brake.effort][-1]:.4f} N m")
print(f"tooth force of each of three planets {abs(run[train.sun_meshes[0].tooth_force][-1]):.2f} N")

# --- a brake that slips ------------------------------------------------------------------
# 2 N m hold against the ring's motion; 3.33 N m would be needed
slipping = mbd.Torque("slipping brake", train.ring, -2.0 * mbd.tanh(train.ring.omega / 0.1))
motor = mbd.Torque("motor", train.sun, 1.6)
free = loaded.replace(forces=[*loaded.forces, slipping, motor])
motion = mbd.simulate(free, duration=0.5, initial=[train.sun.omega == 100, train.ring.omega == 0, train.arm.phi == 0])
willis = train.sun.omega * SUN + train.ring.omega * RING - train.arm.omega * (SUN + RING)
print(f"after 0.5 s the ring runs back at {motion[train.ring.omega][-1]:.1f} rad/s")
print(f"Willis' relation holds to {np.max(np.abs(motion[willis])):.1e} m/s")

figure = mbd.plot(
    motion,
    {
        "sun, rad/s": train.sun.omega,
        "arm, rad/s": train.arm.omega,
        "ring, rad/s": train.ring.omega,
        "tooth force at the sun, N": train.sun_meshes[0].tooth_force,
    },
)
figure.savefig(OUTPUT / "planetary_train.png", dpi=120)
mbd.animate(motion, OUTPUT / "planetary_train.html", speed=0.05, plots={"ring, rad/s": train.ring.omega})
