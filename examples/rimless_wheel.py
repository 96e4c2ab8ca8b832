"""How fast does a wheel without a rim roll down a slope, and does it find that speed again?

Eight spokes, no rim, no motor (McGeer 1990). The wheel turns about the spoke it stands on; where
the next one lands it is pinned by a plastic impact and the old one is released. Slow starts become
faster and fast ones slower: the largest Floquet multiplier says by how much from step to step.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

SPOKES, LEG, MASS, INERTIA, SLOPE, G = 8, 1.0, 2.0, 0.1, 0.08, 9.81
STEPS = 10
HALF = np.pi / SPOKES

ends = [(LEG * np.sin(HALF * (2 * k + 1)), -LEG * np.cos(HALF * (2 * k + 1))) for k in range(STEPS + 1)]
angles = np.pi / SPOKES * np.arange(2 * SPOKES)  # a star of spokes
star = [(r * np.sin(HALF + x), -r * np.cos(HALF + x)) for x, r in zip(angles, [1.0, 0.12] * SPOKES, strict=True)]
wheel = mbd.Body(
    "wheel", mass=MASS, inertia=INERTIA, pose=(-LEG * np.sin(HALF), LEG * np.cos(HALF), 0), shape=mbd.Polygon(star)
)
feet = [wheel.at(*end) for end in ends]
pins = [mbd.Revolute(f"foot {k}", mbd.ground.at(2 * LEG * np.sin(HALF) * k, 0), foot) for k, foot in enumerate(feet)]
downhill = mbd.Gravity((G * np.sin(SLOPE), -G * np.cos(SLOPE)))
on = [mbd.Mechanism(bodies=[wheel], joints=[pin], forces=[downhill], name="rimless wheel") for pin in pins]
first, second = on[:2]
landings = [
    mbd.Event(f"foot {k} lands", feet[k].y, direction=-1, during=on[k - 1], becomes=on[k]) for k in range(1, STEPS + 1)
]

runs = {}
for speed in (0.96, 1.3, 1.8):
    start = [wheel.phi == 0, wheel.omega == -speed]
    runs[speed] = mbd.simulate(first, np.linspace(0, 7.5, 751), initial=start, events=landings)

# by hand: an impact leaves a share of the speed, and every step adds the same energy
share = (INERTIA + MASS * LEG**2 * np.cos(2 * HALF)) / (INERTIA + MASS * LEG**2)
gain = 4 * MASS * G * LEG * np.sin(HALF) * np.sin(SLOPE) / (INERTIA + MASS * LEG**2)
steady = np.sqrt(share**2 * gain / (1 - share**2))

last = mbd.Event("foot 1 lands", feet[1].y, direction=-1, during=first, becomes=second, terminal=True)
step = mbd.simulate(
    first, np.linspace(0, 2, 41), initial=[wheel.phi == 0, wheel.omega == -steady], events=[last], reltol=1e-11,
    abstol=1e-11,
)  # fmt: skip
again = [
    mbd.at_end(wheel.omega) == mbd.at_start(wheel.omega),
    mbd.at_end(wheel.phi) + 2 * HALF == mbd.at_start(wheel.phi),
]
stability = mbd.stability(step, again, events=[last])
print(f"the steady speed after an impact is {steady:.6f} rad/s, a step takes {step.t[-1]:.6f} s")
print(f"largest Floquet multiplier {stability.multipliers[0]:.6f}, by hand {share**2:.6f}")
loss = step.energy.total[-2] - step.energy.total[-1]
print(f"each impact takes {loss:.4f} J, which is what the slope gives in a step")

figure = Figure(figsize=(8, 6), layout="constrained")
above, below = figure.subplots(2, 1)
mbd.draw(runs[1.8], above, poses=14)
below.axhline(-steady, color="grey", linewidth=0.8, linestyle="--")
for (speed, run), colour in zip(runs.items(), ("#2a6f97", "#5b6770", "#c1553b"), strict=True):
    below.plot(run.t, run[wheel.omega], color=colour, label=f"from {speed:.3g} rad/s")
    after = [event.after[wheel.omega] for event in run.events]
    below.plot([event.t for event in run.events], after, "o", color=colour, markersize=3)
below.set_xlabel("t, s")
below.plot([], [], "o", color="grey", markersize=3, label="after an impact")
below.set_ylabel("rate of turning, rad/s")
below.set_yticks([-2, -1.5, -1, -0.5])
below.legend(frameon=False, fontsize="small", ncols=2)
below.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "rimless_wheel.png", dpi=120)
mbd.animate(runs[1.8], OUTPUT / "rimless_wheel.html", plots={"omega, rad/s": wheel.omega})
