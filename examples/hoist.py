"""Which couple must the motor of a hoist give to lift and to lower a load that hangs in four falls?

The rope runs from the drum over two wheels at the top and two in the block, and ends at the top. It rubs on each of
them. By hand the tension falls by exp(mu pi) from wheel to wheel while the load rises, and grows while it sinks.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
REEL, WHEEL, TOP, FALLS, MASS, MU, G = 0.25, 0.1, 5.0, 4, 2000.0, 0.03, 9.81  # m, m, m, 1, kg, 1, m/s²

rubs = mbd.DryFriction(MU)
load = mbd.Body.from_shape("load", mbd.Rectangle(1.0, 0.6), mass=MASS, pose=(0.5, 0.6, 0))
drum = mbd.Body.from_shape("drum", mbd.Disc(REEL), mass=80, pose=(-REEL, 0.5, 0))
reel = mbd.Drum(drum.at(0, 0), REEL, "counter-clockwise")
block = [mbd.Pulley(load.at(x, 0.5), WHEEL, "counter-clockwise", friction=rubs) for x in (-0.2, 0.2)]
top = [mbd.Pulley(mbd.ground.at(x, TOP), WHEEL, "clockwise", friction=rubs) for x in (0.1, 0.5)]
rope = mbd.Cable("rope", reel, mbd.ground.at(0.8, TOP), over=[top[0], block[0], top[1], block[1]])
shaft = mbd.Revolute("shaft", mbd.ground.at(-REEL, 0.5), drum.at(0, 0))
rail = mbd.Translational("rail", mbd.ground.at(0.5, 0, np.pi / 2), load.at(0, 0, np.pi / 2))
couple = mbd.Input("couple", value=1e3)
motor = mbd.Torque("motor", drum, -couple)
hoist = mbd.Mechanism([load, drum], [shaft, rail, rope], forces=[mbd.Gravity(), motor], inputs=[couple], name="hoist")

holds, e = mbd.holding_range(hoist, couple), np.exp(MU * np.pi)
rising, sinking = (sum(e ** (sign * k) for k in range(1, FALLS + 1)) for sign in (-1, 1))  # falls, of the first tension
print(f"it rises above {holds.greatest:.4f} N m, by hand {MASS * G * REEL / rising:.4f} N m")
print(f"it sinks below {holds.least:.4f} N m, by hand {MASS * G * REEL / sinking:.4f} N m")
start = 1.05 * holds.greatest
run = mbd.simulate(hoist, np.linspace(0, 2, 101), inputs={couple: start})
a = (start / REEL * rising - MASS * G) / (MASS + drum.inertia * FALLS * rising / REEL**2)
print(f"with {start:.1f} N m it rises by {run.final[load.y] - 0.6:.6f} m within 2 s, by hand {a * 2**2 / 2:.6f} m")

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
mbd.draw(run.final, drawing)
strands = np.arange(FALLS + 1)
for state, what in ((holds.at_greatest, "begins to rise"), (holds.at_least, "begins to sink")):
    course.plot(strands, state[rope.tensions] / 1e3, "o", label=f"it {what}")
    course.plot(strands, state[rope.tensions][0] / 1e3 * e ** (-strands if "rise" in what else strands), color="grey")
course.set(xlabel="strand, from the drum", ylabel="tension, kN", xticks=strands)
course.legend(frameon=False, fontsize="small")
figure.savefig(OUTPUT / "hoist.png", dpi=120)
