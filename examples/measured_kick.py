"""Which torques at hip and knee make a kick, if markers on the leg are measured to a millimetre?

Four markers are eight coordinates of a leg with two degrees of freedom: the motion that is nearest to them is
taken. Accelerations amplify noise, so that samples as they are give torques of noise, and a warning says so.
"""

import warnings
from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
TIMES = np.linspace(0, 1.2, 121)  # s
NOISE, CUTOFF = 1e-3, 5.0  # m, Hz

thigh = mbd.Body.from_shape("thigh", mbd.Rectangle(0.42, 0.12), mass=8.0, pose=(0, -0.21, -np.pi / 2))
shank = mbd.Body.from_shape("shank", mbd.Rectangle(0.44, 0.09), mass=4.5, pose=(0, -0.64, -np.pi / 2))
hip = mbd.Revolute("hip", mbd.ground.at(0, 0), thigh.at(-0.21, 0))
knee = mbd.Revolute("knee", thigh.at(0.21, 0), shank.at(-0.22, 0))
torques = [mbd.Input(f"{joint.name} torque", unit="N m") for joint in (hip, knee)]
muscles = [
    mbd.Torque("hip muscles", thigh, torques[0]),
    mbd.Torque("knee muscles", shank, torques[1], opposite=thigh),
]
leg = mbd.Mechanism([thigh, shank], [hip, knee], forces=[mbd.Gravity(), *muscles], inputs=torques, name="leg")
points = [thigh.at(-0.1, 0.06), thigh.at(0.17, 0.06), shank.at(-0.15, 0.05), shank.at(0.2, 0.05)]
markers = [coordinate for point in points for coordinate in (point.x, point.y)]

# the kick that a camera sees: the thigh is thrown forward, and the shank follows later
kick = {
    thigh.phi: 0.15 + 0.55 * mbd.tanh(7 * (mbd.t - 0.5)) - np.pi / 2,
    shank.phi: -0.15 + 1.05 * mbd.tanh(7 * (mbd.t - 0.62)) - np.pi / 2,
}
exact = mbd.inverse_dynamics(leg, TIMES, motion=kick, efforts=torques)
random = np.random.default_rng(3)
measured = [exact[marker] + NOISE * random.standard_normal(TIMES.size) for marker in markers]

with warnings.catch_warnings(record=True) as remarks:
    warnings.simplefilter("always")
    rough = mbd.inverse_dynamics(leg, TIMES, motion=list(zip(markers, measured, strict=True)), efforts=torques)
curves = [mbd.smoothing_spline(TIMES, samples, cutoff=CUTOFF) for samples in measured]
found = mbd.inverse_dynamics(leg, TIMES, motion=list(zip(markers, curves, strict=True)), efforts=torques)
for torque in torques:
    largest = [np.max(np.abs(run[torque])) for run in (exact, found, rough)]
    print(f"{torque.label}: {largest[0]:.0f} N m, found {largest[1]:.0f}, of samples as they are {largest[2]:.0f}")
print(f"remark: {str(remarks[0].message).split(' (')[0]}")

figure = mbd.plot(found, {torque.quantity: torque for torque in torques})
for axes, torque in zip(figure.axes, torques, strict=True):
    axes.plot(TIMES, exact[torque], "k--", label="of the kick itself")
    axes.legend()
figure.savefig(OUTPUT / "measured_kick.png", dpi=120)
