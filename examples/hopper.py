"""How does a leg with a spring push to hop to the same height again and again, with the least effort?

From apex to apex; when the foot lands and leaves is for the optimum to find. It lands by a plastic
impact. Damping in the leg and the impact dissipate energy that the actuator replaces.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

MASS, FOOT, STIFFNESS, DAMPING, LENGTH, HEIGHT, UP = 10.0, 1.0, 4000.0, 60.0, 1.0, 1.4, np.pi / 2

force = mbd.Input("F", lower=-300, upper=300)
body = mbd.Body("body", mass=MASS, inertia=1.0, pose=(0, HEIGHT, 0), shape=mbd.Rectangle(0.3, 0.2))
foot = mbd.Body("foot", mass=FOOT, inertia=0.1, pose=(0, HEIGHT - LENGTH, 0), shape=mbd.Rectangle(0.16, 0.06))
rail = mbd.Translational("rail", mbd.ground.at(0, 0, UP), body.at(0, 0, UP))
leg = mbd.Translational("leg", body.at(0, 0, UP), foot.at(0, 0, UP))
law = {"stiffness": STIFFNESS, "free_length": LENGTH, "damping": DAMPING}
spring = mbd.TSDA("spring", foot.at(0, 0), body.at(0, 0), **law, actuator=-force)
sole = mbd.RigidContact("sole", mbd.Point(foot.at(0, 0)), mbd.HalfPlane(mbd.ground.at(0, 0)))
hopper = mbd.Mechanism([body, foot], [rail, leg], forces=[mbd.Gravity(), spring, sole], inputs=[force], name="hopper")

hop = mbd.OptimalControlProblem(
    hopper,
    duration=(0.5, 1.0),
    initial=[body.y == HEIGHT, body.vy == 0],
    final=[body.y == HEIGHT, body.vy == 0],
    boundary=[mbd.at_end(foot.y) == mbd.at_start(foot.y), mbd.at_end(foot.vy) == mbd.at_start(foot.vy)],
    running_cost=force**2,
)
solution = mbd.optimize(hop, intervals=60)
motion, check = solution.trajectory, solution.verify()
lands, leaves = (switch.t for switch in solution.switches)
print(
    f"effort {solution.cost:.4f} N² s; stance {leaves - lands:.4f} s, flight {solution.duration - leaves + lands:.4f} s"
)
strike = check.trajectory.events[0]
print(f"the foot lands at {strike.state[foot.vy]:.3f} m/s, and {strike.state[FOOT / 2 * foot.vy**2]:.3f} J are gone")
print(f"impulse of the ground {strike.after[sole.impulse]:.4f} N s")
print(f"simulated, the landing is within {check.time_error:.0e} s of the plan")

figure = Figure(figsize=(9, 5.5), layout="constrained")
axes = figure.subplot_mosaic([["drawing", "height"], ["drawing", "force"]], width_ratios=(1, 2))
mbd.draw(motion, axes["drawing"], poses=6)
fine = motion.at(np.linspace(0, solution.duration, 401))
for part, colour in ((body, "#2a6f97"), (foot, "#c1553b")):
    axes["height"].plot(fine.t, fine[part.y], color=colour, label=part.name)
axes["height"].set_ylabel("height, m")
axes["height"].legend(frameon=False)
axes["force"].plot(fine.t, fine[force], color="#2e8b6f")
axes["force"].set(xlabel="t, s", ylabel="force of the actuator, N")
figure.savefig(OUTPUT / "hopper.png", dpi=120)
mbd.animate(motion, OUTPUT / "hopper.html", plots={"height, m": {"body": body.y, "foot": foot.y}}, speed=0.25)
