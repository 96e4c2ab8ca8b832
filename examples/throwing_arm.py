"""How does an arm throw a ball at a target with the least effort, and when is it best to let go?

Two links with motors at shoulder and elbow swing from rest and let the ball go; in the flight the
arm is no longer of interest, and the second mechanism is the ball alone. Positions and velocities
of the ball are continuous when the hand opens. A given time of the swing is compared with a longer one.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

M1, M2, L1, L2, BALL, MARK, DOWN = 2.0, 1.5, 0.40, 0.35, 0.4, (2.5, 0.5), -np.pi / 2

upper = mbd.Body("upper arm", mass=M1, inertia=M1 * L1**2 / 12, pose=(0, -L1 / 2, DOWN))
fore = mbd.Body("forearm", mass=M2, inertia=M2 * L2**2 / 12, pose=(0, -L1 - L2 / 2, DOWN))
ball = mbd.Body("ball", mass=BALL, inertia=4e-4, pose=(0, -L1 - L2, DOWN), shape=mbd.Disc(0.05))
shoulder_torque, elbow_torque = mbd.Input("shoulder torque"), mbd.Input("elbow torque")
shoulder = mbd.Revolute("shoulder", mbd.ground.at(0, 0), upper.at(-L1 / 2, 0))
elbow = mbd.Revolute("elbow", upper.at(L1 / 2, 0), fore.at(-L2 / 2, 0))
hand = mbd.Weld("hand", fore.at(L2 / 2, 0), ball.at(0, 0))
motors = [
    mbd.Torque("at shoulder", upper, shoulder_torque),
    mbd.Torque("at elbow", fore, elbow_torque, opposite=upper),
]
holding = mbd.Mechanism(
    bodies=[upper, fore, ball],
    joints=[shoulder, elbow, hand],
    forces=[mbd.Gravity(), *motors],
    inputs=[shoulder_torque, elbow_torque],
    name="throwing arm",
)
flying = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
rest = [upper.phi == DOWN, fore.phi == DOWN, upper.omega == 0, fore.omega == 0]


def throw(time, guess=None):
    """Least effort for a swing of some time, s."""
    effort = shoulder_torque**2 + elbow_torque**2
    swing = mbd.Phase("swing", holding, time, initial=rest, running_cost=effort)
    flight = mbd.Phase("flight", flying, (0.1, 1.2), final=[ball.x == MARK[0], ball.y == MARK[1]])
    return mbd.optimize(mbd.OptimalControlProblem(phases=[swing, flight]), intervals=40, guess=guess)


quick = throw(0.4)
solutions = {0.4: quick, 0.5: throw(0.5, quick)}
for time, solution in solutions.items():
    release = solution.trajectory.events[0]
    speed = np.hypot(*release.state[ball.velocity])
    print(f"swing of {time} s: effort {solution.cost:.6f} N² m² s, let go at {speed:.3f} m/s", end=", ")
    print(f"replayed {solution.verify().final_error:.0e} off")

figure = Figure(figsize=(7, 7), layout="constrained")
path, torques = figure.subplots(2, 1, height_ratios=(2, 1))
mbd.draw(quick.phases[0].trajectory, path, poses=7)
path.plot(quick.trajectory[ball.x], quick.trajectory[ball.y], color="#7b4f8e", linewidth=1)
path.set(xlim=(-0.4, 2.7), ylim=(-0.9, 1.1))
path.plot(*MARK, marker="x", color="#c1553b", markersize=10)
for (time, solution), style in zip(solutions.items(), ("-", "--"), strict=True):
    swing = solution.phases[0].trajectory
    for name, torque, colour in (("shoulder", shoulder_torque, "#2a6f97"), ("elbow", elbow_torque, "#c1553b")):
        torques.plot(swing.t, swing[torque], style, color=colour, label=f"{name}, {time} s")
torques.set_xlabel("t, s")
torques.set_ylabel("torque, N m")
torques.legend(frameon=False, fontsize="small", ncols=2)
torques.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "throwing_arm.png", dpi=120)
mbd.animate(quick.trajectory, OUTPUT / "throwing_arm.html", trace=[ball.at(0, 0)], speed=0.25)
