"""What are the spring and the damping of a hinge, from a film of its swing?

The camera was uneven in time, missed some frames and saw the tip of the rod
with an error of a millimetre. How sure are we of the result?
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

stiffness = mbd.Parameter("stiffness", 3.0, lower=0.0)
damping = mbd.Parameter("damping", 0.05, lower=0.0)
first = mbd.Parameter("first angle", 0.3)

rod = mbd.Body.from_shape("rod", mbd.Rod(0.7), mass=1.2, pose=(0, 0, 0))
ends = mbd.ground.at(0, 0), rod.at(-0.35, 0)
hinge = mbd.Revolute("hinge", *ends)
lever = mbd.Mechanism(
    bodies=[rod],
    joints=[hinge],
    forces=[mbd.Gravity(), mbd.RSDA("hinge spring", *ends, stiffness=stiffness, damping=damping)],
    parameters=[stiffness, damping, first],
)
released = [rod.phi == first, rod.omega == 0]
tip = rod.at(0.35, 0).position

# what the camera saw, made here with values that the identification does not know
generator = np.random.default_rng(4)
times = np.sort(np.r_[0.0, generator.uniform(0.02, 2.0, 120)])
truth = {stiffness: 6.2, damping: 0.21, first: 0.42}
seen = mbd.simulate(lever, times, initial=released, parameters=truth)[tip]
seen = seen + 1e-3 * generator.standard_normal(seen.shape)
seen[generator.random(times.size) < 0.1] = np.nan

fit = mbd.identify(lever, times, data=[(tip, seen)], unknowns=[stiffness, damping, first], initial=released)
print(fit)
print("correlation\n", fit.correlation.round(3))
for symbol, value in truth.items():
    print(f"{symbol.label}: off by {(fit[symbol] - value) / fit.standard_error[symbol]:+.1f} standard errors")
mbd.plot_residuals(fit, ["tip x, m", "tip y, m"]).savefig(OUTPUT / "identify_friction.png", dpi=120)
