"""How far does an elevator fall whose drive fails, and which brake holds it?

The sheave grips the rope of car and counterweight. The brake on its shaft closes after 0.4 s, slips until
the car stands, and sticks from there on. The ways agree with those by hand.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
RADIUS, DELAY, UP = 0.3, 0.4, np.pi / 2  # m, s, rad

car = mbd.Body.from_shape("car", mbd.Rectangle(0.5, 0.8), mass=900, pose=(-RADIUS, -1.0, 0))
weight = mbd.Body.from_shape("counterweight", mbd.Rectangle(0.3, 0.6), mass=600, pose=(RADIUS, -3.0, 0))
sheave = mbd.Body.from_shape("sheave", mbd.Disc(RADIUS), mass=100)
over = mbd.Pulley(sheave.at(0, 0), RADIUS, "clockwise", grips=True)
rope = mbd.Cable("rope", car.at(0, 0.4), weight.at(0, 0.3), [over])
axle = mbd.Revolute("axle", mbd.ground.at(0, 0), sheave.at(0, 0))
left = mbd.Translational("rail of the car", mbd.ground.at(-RADIUS, 0, UP), car.at(0, 0, UP))
right = mbd.Translational("rail of the counterweight", mbd.ground.at(RADIUS, 0, UP), weight.at(0, 0, UP))
closed, couple = mbd.Parameter("closed", 1.0), mbd.Parameter("couple of the brake, N m", 2000.0)
brake = mbd.Clutch("brake", mbd.ground, sheave, closed * couple)
elevator = mbd.Mechanism(
    [car, weight, sheave],
    [axle, left, right, rope, brake],
    forces=[mbd.Gravity()],
    parameters=[closed, couple],
    name="elevator",
)

least = mbd.holding_range(elevator, couple).least
print(f"a brake of {least:.1f} N m holds it, by hand {300 * 9.81 * RADIUS:.1f} N m")

inertia = car.mass + weight.mass + sheave.inertia / RADIUS**2  # kg, at the rope
pull = (car.mass - weight.mass) * 9.81  # N
start = mbd.assemble(elevator, [car.y == -1, car.vy == 0])
free = mbd.simulate(elevator, np.linspace(0, DELAY, 21), initial=start, parameters={closed: 0})
runs = {}
for value in (1500.0, 2000.0, 3000.0):
    run = mbd.simulate(elevator, np.linspace(DELAY, 2, 161), initial=free.final, parameters={closed: 1, couple: value})
    speed = pull / inertia * DELAY
    by_hand = speed * DELAY / 2 + speed**2 / 2 / ((value / RADIUS - pull) / inertia)
    way, stop = -1 - run.final[car.y], run.events[0]
    print(f"{value:.0f} N m: stands after {stop.t:.4f} s and {way:.4f} m, by hand {by_hand:.4f} m")
    runs[f"{value:.0f} N m"] = run

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
mbd.draw(free.final, drawing)
for (name, run), colour in zip(runs.items(), ("#1f5fa8", "#d1495b", "#2e8b6f"), strict=True):
    course.plot(run.t, run[rope.tensions] / 1e3, color=colour, label=[f"car, brake of {name}", "counterweight"])
course.set(xlabel="time, s", ylabel="tension of the rope, kN")
course.legend(frameon=False, fontsize="small")
course.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "elevator.png", dpi=120)
