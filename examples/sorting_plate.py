"""Which parts climb a plate that shakes, and which slide down: can friction alone sort them?

The plate leans, and is driven up and forward. Parts stick, slide, fly and land as the law of Coulomb and plastic
impacts have it, without a stiffness: each change is found to rounding.
"""

from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
SLOPE, THROW, STROKE, RATE = np.radians(10), np.radians(40), 0.004, 2 * np.pi * 12  # rad, rad, m, rad/s
ALONG, UP = np.array([[np.cos(SLOPE), np.sin(SLOPE)], [-np.sin(SLOPE), np.cos(SLOPE)]])

plate = mbd.Body("plate", mass=4, inertia=0.1, pose=(0, 0, SLOPE))
springs = mbd.Translational("springs", mbd.ground.at(0, 0, THROW), plate.at(0, 0, THROW - SLOPE))
shaker = mbd.Driver("shaker", springs.displacement, STROKE * mbd.sin(RATE * mbd.t))
parts, contacts, start = [], [], []
for name, friction, place in (("rough", 0.6, 0.03), ("smooth", 0.08, -0.03)):
    pose = place * ALONG + 0.01 * UP
    part = mbd.Body.from_shape(name, mbd.Rectangle(0.03, 0.02), mass=0.05, pose=(*pose, SLOPE))
    box = mbd.PolygonEdges(part.at(0, 0), [(-0.015, -0.01), (0.015, -0.01), (0.015, 0.01), (-0.015, 0.01)])
    lies = mbd.RigidContact(f"under {name}", box, mbd.HalfPlane(plate.at(0, 0)), mbd.DryFriction(friction))
    speed = STROKE * RATE * np.array([np.cos(THROW), np.sin(THROW)])
    start += [part.x == pose[0], part.y == pose[1], part.phi == SLOPE]
    start += [part.vx == speed[0], part.vy == speed[1], part.omega == 0]
    parts.append(part)
    contacts.append(lies)
sorter = mbd.Mechanism([plate, *parts], [springs], [shaker], forces=[mbd.Gravity(), *contacts])

motion = mbd.simulate(sorter, np.linspace(0, 0.4, 201), initial=start)
figure, (places, gaps) = plt.subplots(2, sharex=True, figsize=(7, 5), constrained_layout=True)
for part, contact, line in zip(parts, contacts, ("-", "--"), strict=True):
    along = ALONG @ motion[part.position - plate.position].T
    throws = [event.t for event in motion.events if event.name == f"{contact.name}.0 opens"]
    print(f"{part.name}: {1e3 * (along[-1] - along[0]):+.1f} mm in {motion.t[-1]:.1f} s, thrown {len(throws)} times")
    places.plot(motion.t, 1e3 * (along - along[0]), label=part.name)
    gaps.plot(motion.t, 1e3 * motion[contact.gap], line)
places.set_ylabel("way up the plate, mm")
places.legend()
gaps.set(xlabel="t, s", ylabel="height above it, mm")
figure.savefig(OUTPUT / "sorting_plate.png", dpi=120)
