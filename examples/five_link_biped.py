"""How does a two-legged robot walk with the least torque, and how hard does its foot strike?

Five links, four motors and no ankles (parameters of RABBIT; M. Kelly, SIAM Review 59, 2017). In the
swing one foot is pinned; the other one lands by a plastic impact, the legs swap their roles, and
the next step must begin as this one did. The poses at both ends are assembled together for the guess.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

STEP, PERIOD = 0.5, 0.7  # m, s
NAMES = ["tibia 1", "femur 1", "torso", "femur 2", "tibia 2"]
MASS, INERTIA = [3.2, 6.8, 20.0, 6.8, 3.2], [0.93, 1.08, 2.22, 1.08, 0.93]
LENGTH, CENTRE = [0.4, 0.4, 0.625, 0.4, 0.4], [0.128, 0.163, 0.2, 0.163, 0.128]  # centre: from the upper end
ANGLES = [-0.3, 0.7, 0.0, -0.5, -0.6]


def up(angle):
    return np.array([-np.sin(angle), np.cos(angle)])


knee = LENGTH[0] * up(ANGLES[0])
hip = knee + LENGTH[1] * up(ANGLES[1])
other_knee = hip - LENGTH[3] * up(ANGLES[3])
upper = [knee, hip, hip + LENGTH[2] * up(ANGLES[2]), hip, other_knee]
links = [
    mbd.Body(NAMES[k], mass=MASS[k], inertia=INERTIA[k], pose=(*(upper[k] - CENTRE[k] * up(ANGLES[k])), ANGLES[k]))
    for k in range(5)
]
tibia, femur, torso, other_femur, other_tibia = links
top = [link.at(0, c) for link, c in zip(links, CENTRE, strict=True)]
low = [link.at(0, c - length) for link, c, length in zip(links, CENTRE, LENGTH, strict=True)]
joints = [
    mbd.Revolute("knee 1", top[0], low[1]),
    mbd.Revolute("hip 1", top[1], low[2]),
    mbd.Revolute("hip 2", low[2], top[3]),
    mbd.Revolute("knee 2", low[3], top[4]),
]
torques = [mbd.Input(f"torque of {joint.name}", lower=-100, upper=100) for joint in joints]
motors = [mbd.Torque(f"motor {k}", links[k + 1], u, opposite=links[k]) for k, u in enumerate(torques)]
stands = mbd.Revolute("foot 1", mbd.ground.at(0, 0), low[0])
lands = mbd.Revolute("foot 2", mbd.ground.at(STEP, 0), low[4])
on_one = mbd.Mechanism(
    bodies=links, joints=[*joints, stands], forces=[mbd.Gravity(), *motors], inputs=torques, name="five-link biped"
)
on_two = on_one.replace(joints=[*joints, lands])

pairs = list(zip(links, reversed(links), strict=True))
walk = mbd.OptimalControlProblem(
    phases=[
        mbd.Phase(
            "swing",
            on_one,
            duration=PERIOD,
            running_cost=sum(u**2 for u in torques),
            initial=[low[4].vy >= 0],
            final=[low[4].vy <= 0],
            path=[mbd.bounded(-10, link.omega, 10) for link in links],
        ),
        mbd.Phase("touch-down", on_two, duration=0, initial=[lands.impulse_on(other_tibia).force[1] >= 0]),
    ],
    boundary=[mbd.at_end(after.phi) == mbd.at_start(before.phi) for before, after in pairs]
    + [mbd.at_end(after.omega) == mbd.at_start(before.omega) for before, after in pairs],
)
solution = mbd.optimize(walk, intervals=10)
event, check = solution.trajectory.events[0], solution.verify()
print(f"effort {solution.cost:.4f} N² m² s, found in {solution.statistics.iterations} iterations")
print(f"impulse of the ground {event.after[lands.impulse_on(other_tibia).force].round(4)} N s")
before, after = (sum(s[link.mass * mbd.sumsqr(link.velocity) + link.inertia * link.omega**2] for link in links) / 2
                 for s in (event.state, event.after))  # fmt: skip
print(f"the strike takes {before - after:.3f} of {before:.3f} J")
print(f"replayed by IDAS the foot lands within {check.time_error:.0e} s of the plan")

figure = Figure(figsize=(8, 7), layout="constrained")
sticks, curves = figure.subplots(2, 1, height_ratios=(1.6, 1))
mbd.draw(solution.trajectory, sticks, poses=6, trace=[low[4], top[2]])
fine = solution.trajectory.at(np.linspace(0, PERIOD, 401))
for u, colour in zip(torques, ("#2a6f97", "#2e8b6f", "#d99a2b", "#c1553b"), strict=True):
    curves.plot(fine.t, fine[u], color=colour, label=u.label)
curves.set_xlabel("t, s")
curves.set_ylabel("torque, N m")
curves.legend(frameon=False, fontsize="small")
curves.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "five_link_biped.png", dpi=120)
mbd.animate(solution.trajectory, OUTPUT / "five_link_biped.html", trace=[low[4]], speed=0.2)
