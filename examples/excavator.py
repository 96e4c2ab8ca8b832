"""What must the cylinders of an excavator push and pull while its bucket swings up a load?

The lengths of the three cylinders are prescribed by linear actuators; inverse
dynamics gives their forces, their powers, and what the pins carry.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

beam = [(0, -0.25), (2.6, 1.1), (5.2, 0.55), (5.2, 0.85), (2.6, 1.6), (0, 0.25)]
lever = [(-0.7, 0.1), (0, -0.2), (2.6, -0.12), (2.6, 0.12), (0, 0.25), (-0.7, 0.35)]
scoop = [(0, 0.15), (0.9, 0.2), (1.3, -0.3), (1.0, -1.0), (0.8, -0.5), (0.1, -0.3), (-0.45, 0)]
boom = mbd.Body.from_shape("boom", mbd.Polygon(beam), mass=1500, pose=(2.1, 1.4, 0.3))
stick = mbd.Body.from_shape("stick", mbd.Polygon(lever), mass=700, pose=(5.0, 1.6, -1.0))
bucket = mbd.Body.from_shape("bucket", mbd.Polygon(scoop), mass=500, pose=(5.9, -0.5, -1.4))

foot = mbd.Revolute("boom foot", mbd.ground.at(0, 0), boom.at(0, 0))
elbow = mbd.Revolute("stick pin", boom.at(5.1, 0.7), stick.at(0, 0))
wrist = mbd.Revolute("bucket pin", stick.at(2.5, 0), bucket.at(0, 0))

lift = mbd.Actuator(
    "boom cylinder", mbd.ground.at(0.7, -0.3), boom.at(2.4, 1.15), 2.6 + 0.35 * mbd.step(mbd.t, 1, 0, 4, 1)
)
crowd = mbd.Actuator(
    "stick cylinder", boom.at(2.6, 1.5), stick.at(-0.6, 0.25), 2.75 - 0.35 * mbd.step(mbd.t, 1, 0, 4, 1)
)
curl = mbd.Actuator(
    "bucket cylinder", stick.at(0.1, 0.45), bucket.at(-0.35, 0.05), 2.3 + 0.35 * mbd.step(mbd.t, 0, 0, 2, 1)
)
load = mbd.Force("load", bucket.at(0.7, -0.2), (0, -12e3))

excavator = mbd.Mechanism(
    bodies=[boom, stick, bucket],
    joints=[foot, elbow, wrist],
    drivers=[lift, crowd, curl],
    forces=[mbd.Gravity(), load],
    name="excavator",
)

run = mbd.inverse_dynamics(excavator, np.linspace(0, 5, 251))
for cylinder in excavator.drivers:
    force = run[cylinder.force]
    power = -force * run[mbd.time_derivative(cylinder.length)]
    stroke = np.ptp(run[cylinder.stroke])
    print(
        f"{cylinder.name}: stroke {stroke:.2f} m, "
        f"{-force.max() / 1e3:.0f} to {-force.min() / 1e3:.0f} kN of push, up to {np.abs(power).max() / 1e3:.0f} kW"
    )

figure = mbd.plot(
    run,
    {
        "push, N": {cylinder.name: -cylinder.force for cylinder in excavator.drivers},
        "stroke, m": {cylinder.name: cylinder.stroke for cylinder in excavator.drivers},
        "load of the boom foot, N": mbd.norm(foot.reaction_on(boom).force),
    },
)
figure.savefig(OUTPUT / "excavator.png", dpi=120)
mbd.animate(
    run, OUTPUT / "excavator.html", trace=[bucket.at(1.0, -1.0)], plots={"push of the boom cylinder, N": -lift.force}
)
