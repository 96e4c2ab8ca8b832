"""Which four-bar with a given base draws the straightest line, as those of Watt and Chebyshev do?

The coupler point passes five places of a line: finitely many four-bars do so exactly, and
a search finds them. Of those whose crank turns and that pass the places in their order,
one is nearest to the line in between.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
HEIGHT = 1.0  # of the line, m; the base is half as long

model = mbd.library.four_bar(0.25, 0.625, 0.625, 0.5, point=(0.9, 0.0), gravity=None, free=True)
u = model.unknowns
# where a polynomial is interpolated best: zeros of Chebyshev's polynomial
places = 0.5 + 0.4 * np.cos(np.pi * (np.arange(5) + 0.5) / 5)
found = mbd.synthesize(
    model.mechanism,
    unknowns=list(u.values()),
    positions=[[model.point.position == (x, HEIGHT)] for x in places],
    conditions=[u["Ax"] == 0, u["Ay"] == 0, u["Dx"] == 0.5, u["Dy"] == 0],
    seconds=12,
)
print(found)


def line(linkage):
    """Path of the point from the first place to the last one."""
    path = linkage.motion(outputs=1001)[model.point.position]
    return path[: int(np.argmin(np.hypot(path[:, 0] - places[-1], path[:, 1] - HEIGHT))) + 1]


def error(linkage):
    """Largest distance from the line, m."""
    return np.max(np.abs(line(linkage)[:, 1] - HEIGHT))


usable = found.where(one_branch=True, in_order=True, crank_turns=True).sorted(error)
best = usable[0]
motion = best.motion()
length = np.ptp(line(best)[:, 0])
print(f"{len(usable)} are usable; the best is off by {1e3 * error(best):.2f} mm on {length:.2f} m")

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, deviation = figure.subplots(1, 2)
mbd.draw(motion, drawing, trace=[model.point])
x, y = line(best).T
deviation.plot(x, 1e3 * (y - HEIGHT), color="#1f5fa8")
deviation.plot(places, 0 * places, "o", color="#d1495b")
deviation.axhline(0, color="0.7", lw=0.8, zorder=0)
deviation.set(xlabel="along the line, m", ylabel="off the line, mm")
deviation.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "straight_line.png", dpi=120)
