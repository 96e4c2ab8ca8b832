"""How does the foot of Jansen's walking linkage move, how level is its step, and what do the bearings carry?

Eleven bars and one crank. The drawing shows the leg in seven poses with the path
of its foot; the film and the page show it walking.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

leg = mbd.library.jansen(density=2.0)
walk = leg.driven(crank=-2 * np.pi * mbd.t / 3)  # one turn in three seconds, clockwise
step = mbd.inverse_dynamics(walk, np.linspace(0, 3, 181))

x, y = step[leg.foot.position].T
down = y < y.min() + 0.03
print(f"step of {np.ptp(x[down]):.3f} m, level within 30 mm for {100 * down.mean():.0f} % of the time")
print(f"the foot is lifted by {np.ptp(y):.3f} m")
speed = step[leg.foot.vx][down]
spread = np.ptp(np.quantile(speed, [0.1, 0.9])) / 2
print(f"over the ground it goes at {np.median(speed):.2f} m/s, within ±{spread:.2f} m/s")
drive = walk.joint("crank drive")
loads = {j.name: np.hypot(*step[j.reaction_on(j.b.body).force].T).max() for j in walk.joints}
worst = max(loads, key=lambda name: loads[name])
torque = step[drive.effort]
print(f"torque {torque.min():.2f} to {torque.max():.2f} N m; '{worst}' carries {loads[worst]:.0f} N")

axes = mbd.draw(step, trace=[leg.foot], poses=7)
axes.set_title("Jansen's leg, every half second")
axes.figure.savefig(OUTPUT / "walking_leg.png", dpi=120)
mbd.animate(step, OUTPUT / "walking_leg.gif", trace=[leg.foot], fps=10)
mbd.animate(
    step, OUTPUT / "walking_leg.html", trace=[leg.foot], plots={"foot, m": leg.foot.y, "torque, N m": drive.effort}
)
