"""How does a double pendulum move, and what must its elbow bear?

The first mechanism: its degrees of freedom, its equations, its motion, its
reactions, a plot, and a page for the browser.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

upper = mbd.Body("upper", mass=1.5, inertia=1.5 * 0.8**2 / 12, pose=(0.4, 0.0, 0.0))
lower = mbd.Body("lower", mass=1.0, inertia=1.0 * 0.5**2 / 12, pose=(0.8, 0.2, np.pi / 3))
pin = mbd.Revolute("pin", mbd.ground.at(0, 0), upper.at(-0.4, 0))
elbow = mbd.Revolute("elbow", upper.at(0.4, 0), lower.at(-0.25, 0))
pendulum = mbd.Mechanism(bodies=[upper, lower], joints=[pin, elbow], forces=[mbd.Gravity()], name="double pendulum")

print(mbd.check(pendulum))
print(mbd.equations(pendulum))

motion = mbd.simulate(pendulum, duration=3.0, initial=[upper.phi == 0, lower.phi == np.pi / 3])
print(motion)
print(f"largest load of the elbow: {motion.maximum(mbd.norm(elbow.reaction_on(lower).force)).value:.1f} N")
energy = motion.energy.total
print(f"energy stays within {np.ptp(energy):.1e} J of {energy[0]:.4f} J")

angles = {"upper": upper.phi, "lower": lower.phi}
figure = mbd.plot(
    motion,
    {
        "angles, rad": angles,
        "tip, m": lower.at(0.25, 0).position,
        "elbow load, N": mbd.norm(elbow.reaction_on(lower).force),
    },
)
figure.savefig(OUTPUT / "first_mechanism.png", dpi=120)

# a page to play with: open it in a browser
mbd.animate(motion, OUTPUT / "first_mechanism.html", trace=[lower.at(0.25, 0)], plots={"angles, rad": angles})
