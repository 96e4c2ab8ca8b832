"""Which couple must the motor of a hoist give to lift, to hold and to lower a load that hangs in four falls?

The rope runs from the drum over two wheels at the top and two in the block, and ends at the top. The motor
turns the drum up and down again. A quarter of the weight and of the inertia of the load confirms the couple.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
REEL, WHEEL, TOP, FALLS, MASS, G = 0.25, 0.1, 5.0, 4, 2000.0, 9.81  # m, m, m, 1, kg, m/s²

load = mbd.Body.from_shape("load", mbd.Rectangle(1.0, 0.6), mass=MASS, pose=(0.5, 0.6, 0))
drum = mbd.Body.from_shape("drum", mbd.Disc(REEL), mass=80, pose=(-REEL, 0.5, 0))
reel = mbd.Drum(drum.at(0, 0), REEL, "counter-clockwise")
block = [mbd.Pulley(load.at(x, 0.5), WHEEL, "counter-clockwise") for x in (-0.2, 0.2)]
top = [mbd.Pulley(mbd.ground.at(x, TOP), WHEEL, "clockwise") for x in (0.1, 0.5)]
rope = mbd.Cable("rope", reel, mbd.ground.at(0.8, TOP), over=[top[0], block[0], top[1], block[1]])
shaft = mbd.Revolute("shaft", mbd.ground.at(-REEL, 0.5), drum.at(0, 0))
rail = mbd.Translational("rail", mbd.ground.at(0.5, 0, np.pi / 2), load.at(0, 0, np.pi / 2))
up, down = mbd.step(mbd.t, 0, 0, 2, 20), mbd.step(mbd.t, 3, 0, 5, 20)
motor = mbd.Driver("motor", shaft.angle, down - up)
hoist = mbd.Mechanism([load, drum], [shaft, rail, rope], [motor], [mbd.Gravity()], name="hoist")

run = mbd.inverse_dynamics(hoist, np.linspace(0, 5, 501))
couple, a = -run[motor.effort], run[load.ay]
by_hand = MASS * (G + a) / FALLS * REEL + drum.inertia * FALLS * a / REEL
print(f"it lifts by {run[load.y].max() - run[load.y][0]:.4f} m, by hand {20 * REEL / FALLS:.4f} m")
print(f"it holds with {couple[250]:.4f} N m, by hand {MASS * G * REEL / FALLS:.4f} N m")
print(
    f"couple from {couple.min():.2f} to {couple.max():.2f} N m, by hand {by_hand.min():.2f} to {by_hand.max():.2f} N m"
)

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
mbd.draw(run.at([2.5]), drawing)
course.plot(run.t, couple, label="found")
course.plot(run.t, by_hand, "--", label="by hand")
course.set(xlabel="time, s", ylabel="couple of the motor, N m")
course.legend(frameon=False, fontsize="small")
figure.savefig(OUTPUT / "hoist.png", dpi=120)
