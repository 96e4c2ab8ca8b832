"""Which six-bar sweeps a windscreen wiper by 90 degrees and rests at the end of the stroke?

The four-bar of a motor and a rocker is given, and a second four-bar moves the blade
(Watt's six-bar). Its dimensions are found from three positions: the blade stands where
it did after 20 degrees of the crank, and has swept 90 degrees at the other end. They
leave dimensions free; of the list, that which accelerates the blade least is taken.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
SWEEP, REST = 90, 20  # degrees of the blade, and of the crank to either side of the end of the stroke

# drawn where crank and coupler lie in a line: there the rocker turns back
reach, crank = np.array([1.165, 0.577]), 0.3
points = {"A": (0, 0), "D": (1, 0), "B": tuple(reach * crank / np.hypot(*reach)), "C": tuple(reach)}
points |= {"E": (1.5, 0.5), "F": (2.2, 0.9), "G": (2.2, 0.2), "P": (1.6, 0.8)}
model = mbd.library.watt(2, points, point_on="output", gravity=None)
u = model.unknowns
pairs = np.radians([(0, 0), (REST, 0), (189.9, SWEEP)])  # the rocker turns back after 189.9 degrees of the crank
positions = [[model.crank.phi == turn, model.output.phi == -angle] for turn, angle in pairs]
limits = [
    mbd.bounded(1.6, u["Gx"], 2.4),
    mbd.bounded(-0.4, u["Gy"], 0.4),
    mbd.bounded(0.2**2, (u["Ex"] - 1) ** 2 + u["Ey"] ** 2, 0.7**2),
    mbd.bounded(0.2**2, (u["Fx"] - u["Gx"]) ** 2 + (u["Fy"] - u["Gy"]) ** 2, 0.6**2),
    *(u["Px"] == u["Gx"] - 0.6, u["Py"] == u["Gy"] + 0.6),  # the blade
]
free = [u[name + axis] for name in "EFGP" for axis in "xy"]
found = mbd.synthesize(model.mechanism, free, positions, limits, seconds=3)
print(found)


def jolt(linkage):
    """Largest acceleration of the blade at one turn of the crank a second, rad/s²."""
    motion = linkage.motion(outputs=361)
    return np.max(np.abs(motion[model.output.alpha]))


turning = found[:40].where(one_branch=True, crank_turns=True).sorted(jolt)
best = turning[0]
motion = best.motion(outputs=721)
blade = np.degrees(motion[model.output.phi])
dwell = np.ptp(blade[np.cos(motion[model.crank.phi]) >= np.cos(np.radians(REST))])
print(f"{len(turning)} turn; the blade sweeps {np.ptp(blade):.1f}°, and moves {dwell:.2f}° in {2 * REST}° of the crank")

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
best.draw(drawing, trace=[model.point])
course.plot(np.linspace(0, 360, blade.size), blade, color="#1f5fa8")
course.axvspan(0, REST, color="#d1495b", alpha=0.15, lw=0)
course.axvspan(360 - REST, 360, color="#d1495b", alpha=0.15, lw=0)
course.set(xlabel="crank, degrees", ylabel="blade, degrees", xlim=(0, 360))
course.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "wiper.png", dpi=120)
