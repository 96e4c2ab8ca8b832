"""How fast does an arm pick up a load in the swing, if the impulse on its grip is limited?

The arm starts from rest, takes a resting load along without stopping, and brings it to rest further
on. The grip closes by a plastic impact: the faster the arm moves, the more speed it loses there, and
the larger the impulse. It is an unknown of the optimal-control problem, and so it can be limited.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

LENGTH, TORQUE, AT, BEYOND = 1.0, 4.0, 2.0, 0.3  # m, N m, rad
ARM, LOAD = (1.5, 0.2), (0.6, 0.05)  # masses and moments of inertia, kg, kg m²

place = LENGTH * np.array([np.cos(AT), np.sin(AT)])
arm = mbd.Body("arm", mass=ARM[0], inertia=ARM[1], pose=(LENGTH / 2, 0, 0))
load = mbd.Body("load", mass=LOAD[0], inertia=LOAD[1], pose=(*place, AT), shape=mbd.Rectangle(0.12, 0.12))
tau = mbd.Input("tau", lower=-TORQUE, upper=TORQUE)
hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(-LENGTH / 2, 0))
table = mbd.Weld("table", mbd.ground.at(*place, angle=AT), load.at(0, 0))
grip = mbd.Weld("grip", arm.at(LENGTH / 2, 0), load.at(0, 0))
motor = mbd.Torque("motor", arm, tau)
reaching = mbd.Mechanism(bodies=[arm, load], joints=[hinge, table], forces=[motor], inputs=[tau], name="gripper")
carrying = reaching.replace(joints=[hinge, grip])
blow = mbd.norm(grip.impulse_on(load).force)


def fastest(limit, guess=None):
    """Least time with an impulse of at most `limit`, N s, or of any size without one."""
    reach = mbd.Phase("reach", reaching, (0.05, 3), initial=[hinge.angle == 0, arm.omega == 0])
    carry = mbd.Phase(
        "carry",
        carrying,
        (0.05, 3),
        initial=[] if limit is None else [blow <= limit],
        final=[hinge.angle == AT + BEYOND, arm.omega == 0],
    )
    problem = mbd.OptimalControlProblem(phases=[reach, carry], terminal_cost=mbd.t)
    return mbd.optimize(problem, intervals=20, guess=guess)


free = fastest(None)
solutions = {None: free} | {limit: fastest(limit, free) for limit in (0.6, 0.3, 0.1)}
for limit, solution in solutions.items():
    before, after = solution.phases[0].final[arm.omega], solution.phases[1].initial[arm.omega]
    allowed = "any blow" if limit is None else f"a blow of {limit} N s"
    print(f"{allowed}: {solution.duration:.4f} s, the grip takes the arm from {before:.3f} to {after:.3f} rad/s")
check = free.verify()
print(f"replayed by IDAS the grip closes within {check.time_error:.0e} s of the plan")

# by hand: full torque, then no faster than can be braked with the load
first = ARM[1] + ARM[0] * (LENGTH / 2) ** 2
second = first + LOAD[0] * LENGTH**2 + LOAD[1]
hit = np.sqrt(2 * TORQUE / second * BEYOND) * second / first
peak = np.sqrt((hit**2 + 2 * TORQUE / first * AT) / 2)
exact = (2 * peak - hit) * first / TORQUE + first / second * hit * second / TORQUE
print(f"the least time of all by hand {exact:.6f} s, found {free.duration:.6f} s")

figure = Figure(figsize=(8, 6), layout="constrained")
pictures, curves = figure.subplots(2, 1, height_ratios=(1.4, 1))
mbd.draw(free.trajectory, pictures, poses=10)
for (limit, solution), colour in zip(solutions.items(), ("#c1553b", "#d99a2b", "#2e8b6f", "#2a6f97"), strict=True):
    label = "any blow" if limit is None else f"at most {limit} N s"
    curves.plot(solution.trajectory.t, solution.trajectory[arm.omega], color=colour, label=label)
curves.set_xlabel("t, s")
curves.set_ylabel("turning, rad/s")
curves.legend(frameon=False, fontsize="small")
curves.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "gripper.png", dpi=120)
mbd.animate(free.trajectory, OUTPUT / "gripper.html", plots={"tau, N m": tau, "omega, rad/s": arm.omega}, speed=0.4)
