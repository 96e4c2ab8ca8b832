"""What do the floor and the servos of a walker carry, which falls on its feet and then bends its knees?

The walker is a file of MuJoCo: its geoms that may touch become contacts, its position actuators inputs. The time
of the fall, the weight, and the moment of what is above the knees confirm what is found.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT, MODELS = Path(__file__).parent / "output", Path(__file__).parent / "models"
SIDES, HEIGHT, G = ("left", "right"), 0.1, 9.81  # of the feet above the floor, m; m/s²

robot = mbd.read_mjcf(MODELS / "walker.xml")
feet = [robot.force(f"{side} foot on floor") for side in SIDES]
bend = mbd.step(mbd.t, 0.6, 0, 1.4, 1)
angles = {"hip": 0.5 * bend, "knee": -1.0 * bend, "ankle": 0.5 * bend}
orders = {robot.input(f"{side} {joint} servo"): angle for side in SIDES for joint, angle in angles.items()}
lands = mbd.Event("lands", feet[0].gap, direction=-1)
run = mbd.simulate(robot, np.linspace(0, 5, 501), inputs=orders, events=[lands])

weight, end = G * sum(body.mass for body in robot.bodies), run.final
floor = sum(foot.normal_force for foot in feet)
knee, servo = robot.joint("left knee"), robot.force("left knee servo")
upper = [robot.body("trunk"), *(robot.body(f"{side} thigh") for side in SIDES)]
couple = G * sum(body.mass * (end[knee.a.position[0]] - end[body.x]) for body in upper) / 2
print(f"it lands after {run.events[0].t:.5f} s, by hand {np.sqrt(2 * HEIGHT / G):.5f} s")
print(f"the floor carries {end[floor]:.3f} N, the weight is {weight:.3f} N")
print(f"the servo of a knee holds {end[servo.forces]:.3f} N m, by hand {couple:.3f} N m")

figure = Figure(figsize=(9.6, 4.8), layout="constrained")
drawing, course = figure.subplots(1, 2)
mbd.draw(run, drawing, poses=4)
course.plot(run.t, run[floor] / weight, label="load of the floor, weights")
course.plot(run.t, run[servo.forces] / 10, label="couple of a knee, 10 N m")
course.set(xlabel="time, s")
course.legend(frameon=False, fontsize="small")
figure.savefig(OUTPUT / "robot_walker.png", dpi=120)
