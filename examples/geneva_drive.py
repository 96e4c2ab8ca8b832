"""How does a Geneva drive turn a uniform rotation into steps, and what does its pin bear?

A pin on a crank enters a slot of the wheel, turns it by a quarter and leaves it; until it comes back
the wheel is locked. Two mechanisms of the same bodies follow each other without end. The pin enters
along the slot, so that only the acceleration jumps; which slot it enters, and where the wheel
stands, are parameters that take their values at the change.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

SLOTS, DISTANCE, SPEED = 4, 0.1, 2 * np.pi  # m, rad/s
CRANK = DISTANCE * np.sin(np.pi / SLOTS)
REACH = DISTANCE * np.cos(np.pi / SLOTS)
ENTRY = np.pi / 2 - np.pi / SLOTS  # angle of the crank at which the pin enters, before the line of centres

bar = mbd.Rectangle(CRANK + 0.012, 0.012, (CRANK / 2, 0)) + mbd.Disc(0.006, (CRANK, 0))
crank = mbd.Body("crank", mass=0.4, inertia=5e-4, pose=(0, 0, -2.5), shape=bar)
pin = crank.at(CRANK, 0)
notch = [(REACH, -0.006), (DISTANCE - CRANK - 0.006, -0.006), (DISTANCE - CRANK - 0.006, 0.006), (REACH, 0.006)]
outline = []
for k in range(SLOTS):
    a = 2 * np.pi / SLOTS * k
    outline += [(x * np.cos(a) - y * np.sin(a), x * np.sin(a) + y * np.cos(a)) for x, y in notch]
    outline.append((0.62 * REACH * np.cos(a + np.pi / SLOTS), 0.62 * REACH * np.sin(a + np.pi / SLOTS)))
wheel = mbd.Body("wheel", mass=0.6, inertia=8e-4, pose=(DISTANCE, 0, np.pi / SLOTS), shape=mbd.Polygon(outline))
stand, slot = mbd.Parameter("stand", np.pi / SLOTS), mbd.Parameter("slot", 0.0)
bearings = [
    mbd.Revolute("crank bearing", mbd.ground.at(0, 0), crank.at(0, 0)),
    mbd.Revolute("wheel bearing", mbd.ground.at(DISTANCE, 0), wheel.at(0, 0)),
]
motor = mbd.Driver("motor", crank.phi, -2.5 + SPEED * mbd.t)
locked = mbd.AbsoluteAngle("lock", wheel.at(0, 0), stand)
to_pin = pin.position - wheel.position
direction = wheel.phi + slot
in_slot = mbd.Constraint("pin in slot", to_pin[1] * mbd.cos(direction) - to_pin[0] * mbd.sin(direction))
dwelling = mbd.Mechanism(
    bodies=[wheel, crank], joints=[*bearings, locked], drivers=[motor], parameters=[stand], name="Geneva drive"
)
turning = mbd.Mechanism(
    bodies=[wheel, crank], joints=[*bearings, in_slot], drivers=[motor], parameters=[slot], name="Geneva drive"
)

# sines of the angle from where the pin enters, and from where it leaves: upwards through zero once in each turn
enters = mbd.Event(
    "pin enters", mbd.sin(crank.phi + ENTRY), direction=1, during=dwelling, becomes=turning,
    reset={slot: mbd.atan2(to_pin[1], to_pin[0]) - wheel.phi},
)  # fmt: skip
leaves = mbd.Event(
    "pin leaves", mbd.sin(crank.phi - ENTRY), direction=1, during=turning, becomes=dwelling, reset={stand: wheel.phi}
)
motion = mbd.simulate(dwelling, np.linspace(0, 2.6, 1301), events=[enters, leaves])
for event in motion.events:
    jump = event.after[wheel.omega] - event.state[wheel.omega]
    stands = np.degrees(event.after[wheel.phi])
    print(f"{event.name} at {event.t:.6f} s, the wheel stands at {stands:7.3f}°, its speed jumps by {jump:.0e} rad/s")

# by hand: while the pin is in the slot, tan(beta) = CRANK sin(a) / (DISTANCE - CRANK cos(a))
ratio, a = CRANK / DISTANCE, np.mod(motion[crank.phi] + np.pi, 2 * np.pi) - np.pi
inside = np.abs(a) < ENTRY
exact = np.where(inside, -SPEED * ratio * (np.cos(a) - ratio) / (1 - 2 * ratio * np.cos(a) + ratio**2), 0)
error = np.max(np.abs(motion[wheel.omega] - exact))
press = motion[in_slot.multipliers[0]]
print(f"largest difference from the formula {error:.1e} rad/s")
print(f"the wheel turns up to {np.ptp(exact) / SPEED:.4f} times as fast as the crank")
print(f"the pin bears up to {np.max(np.abs(press)):.3f} N")

figure = Figure(figsize=(9, 5), layout="constrained")
axes = figure.subplot_mosaic([["drawing", "turning"], ["drawing", "force"]], width_ratios=(1, 1.5))
mbd.draw(motion.at(np.linspace(*[event.t for event in motion.events[:2]], 9)), axes["drawing"], poses=5)
axes["turning"].plot(motion.t, motion[wheel.omega], color="#2a6f97")
axes["turning"].set_ylabel("wheel, rad/s")
axes["force"].plot(motion.t, press, color="#c1553b")
axes["force"].set_ylabel("force of the pin, N")
axes["force"].set_xlabel("t, s")
for name in ("turning", "force"):
    axes[name].spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "geneva_drive.png", dpi=120)
mbd.animate(motion, OUTPUT / "geneva_drive.html", plots={"wheel, rad/s": wheel.omega})
