"""How does a leg with a spring push to hop to the same height again and again, with the least effort?

Stance, flight up to a prescribed height, flight down, and the state after the landing, which
is where the next hop begins: four phases and two mechanisms. The foot is pinned while it stands; it
lands by a plastic impact. Damping in the leg and the impact dissipate energy that the actuator replaces.
"""

from pathlib import Path

from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

MASS, FOOT, STIFFNESS, DAMPING, LENGTH, HEIGHT = 10.0, 1.0, 4000.0, 60.0, 1.0, 1.4

force = mbd.Input("F")
body = mbd.Body("body", mass=MASS, inertia=1.0, pose=(0, LENGTH, 0), shape=mbd.Rectangle(0.3, 0.2))
foot = mbd.Body("foot", mass=FOOT, inertia=0.1, pose=(0, 0, 0), shape=mbd.Rectangle(0.16, 0.06))
up = 1.5707963267948966
rail = mbd.Translational("rail", mbd.ground.at(0, 0, up), body.at(0, 0, up))
leg = mbd.Translational("leg", body.at(0, 0, up), foot.at(0, 0, up))
stands = mbd.Revolute("stands", mbd.ground.at(0, 0), foot.at(0, 0))
spring = mbd.TSDA(
    "spring", foot.at(0, 0), body.at(0, 0), stiffness=STIFFNESS, free_length=LENGTH, damping=DAMPING, actuator=-force
)
air = mbd.Mechanism(
    bodies=[body, foot], joints=[rail, leg], forces=[mbd.Gravity(), spring], inputs=[force], name="hopper"
)
stance = air.replace(joints=[rail, leg, stands])

hop = mbd.OptimalControlProblem(
    phases=[
        mbd.Phase("stance", stance, (0.1, 0.4), running_cost=force**2),
        mbd.Phase("up", air, (0.1, 0.4), running_cost=force**2, final=[body.y == HEIGHT, body.vy == 0]),
        mbd.Phase("down", air, (0.1, 0.4), running_cost=force**2),
        mbd.Phase("landed", stance, 0),
    ],
    boundary=[
        mbd.at_end(body.y) == mbd.at_start(body.y),
        mbd.at_end(body.vy) == mbd.at_start(body.vy),
    ],
)
solution = mbd.optimize(hop, intervals=20)
motion, check = solution.trajectory, solution.verify()
print(
    f"effort {solution.cost:.4f} N² s; stance {solution.durations[0]:.4f} s, "
    f"flight {sum(solution.durations[1:3]):.4f} s"
)
landing = motion.events[-1]
lost = landing.state[FOOT / 2 * foot.vy**2]
print(f"the foot lands at {landing.state[foot.vy]:.3f} m/s, and {lost:.3f} J are gone")
print(f"impulse of the ground {landing.after[stands.impulse_on(foot).force][1]:.4f} N s")
print(f"replayed by IDAS the landing is within {check.time_error:.0e} s of the plan")
pressed = solution.phases[0].trajectory[stands.reaction_on(foot).force[1]]
print(f"the ground presses with {pressed.min():.1f} … {pressed.max():.1f} N and never pulls")

figure = Figure(figsize=(9, 5.5), layout="constrained")
axes = figure.subplot_mosaic([["drawing", "height"], ["drawing", "force"]], width_ratios=(1, 2))
mbd.draw(motion, axes["drawing"], poses=6)
fine = motion.at([motion.t[0] + (motion.t[-1] - motion.t[0]) * k / 400 for k in range(401)])
for part, colour in ((body, "#2a6f97"), (foot, "#c1553b")):
    axes["height"].plot(fine.t, fine[part.y], color=colour, label=part.name)
axes["height"].set_ylabel("height, m")
axes["height"].legend(frameon=False)
axes["force"].plot(fine.t, fine[force], color="#2e8b6f")
axes["force"].set_ylabel("force of the actuator, N")
axes["force"].set_xlabel("t, s")
for name in ("height", "force"):
    axes[name].spines[["top", "right"]].set_visible(False)
    for event in motion.events:
        axes[name].axvline(event.t, color="grey", linewidth=0.7, linestyle="--")
figure.savefig(OUTPUT / "hopper.png", dpi=120)
mbd.animate(motion, OUTPUT / "hopper.html", plots={"height, m": {"body": body.y, "foot": foot.y}}, speed=0.25)
