"""How strong must the opener of a garage door be if its spring balances the door, and if the spring is broken?

Rollers guide three panels round a bend. A cable from the bottom of the door winds up on a drum, whose torsion
spring is stretched while the door is closed. The opener turns the drum. Couples and works by hand confirm it.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.integrate import trapezoid

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
PANEL, MASS, BEND, REEL, TOP, WAY, G = 0.7, 30.0, 0.4, 0.06, 2.2, 2.35, 9.81  # m, kg, m, m, m, m, m/s²


def track(s):
    """Place on the track: up to TOP, round the bend, and back under the roof."""
    angle = mbd.fmin(mbd.fmax((s - TOP) / BEND, 0), np.pi / 2)
    straight = mbd.fmax(s - TOP - BEND * np.pi / 2, 0)
    return BEND * (1 - mbd.cos(angle)) + straight, mbd.fmin(s, TOP) + BEND * mbd.sin(angle)


rail = mbd.Curve(track, -0.1, 6.0)
shape = mbd.Rectangle(PANEL, 0.04)
panels = [mbd.Body.from_shape(f"panel {k}", shape, mass=MASS, pose=(0, (k + 0.5) * PANEL, np.pi / 2)) for k in range(3)]
drum = mbd.Body.from_shape("drum", mbd.Disc(REEL), mass=5, pose=(REEL, TOP + BEND + 0.2, 0))
low, high = ([panel.at(x, 0) for panel in panels] for x in (-PANEL / 2, PANEL / 2))
rollers = [
    mbd.PointOnCurve(f"roller {k}", mbd.ground.at(0, 0), marker, rail) for k, marker in enumerate([*low, high[-1]])
]
hinges = [mbd.Revolute(f"hinge {k}", high[k - 1], low[k]) for k in (1, 2)]
shaft = mbd.Revolute("shaft", mbd.ground.at(REEL, TOP + BEND + 0.2), drum.at(0, 0))
cable = mbd.Cable("cable", mbd.Drum(drum.at(0, 0), REEL, "counter-clockwise"), low[0])
stiffness = mbd.Parameter("stiffness of the spring, N m/rad", 1.1)
spring = mbd.RSDA("spring", shaft.a, drum.at(0, 0), stiffness=stiffness, free_angle=-46)
opener = mbd.Driver("opener", shaft.angle, -WAY / REEL * mbd.step(mbd.t, 0, 0, 12, 1))
joints, forces = [*rollers, *hinges, shaft, cable], [mbd.Gravity(), spring]
door = mbd.Mechanism([*panels, drum], joints, [opener], forces, parameters=[stiffness], name="garage door")

figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
for what, value in (("with the spring", 1.1), ("with a broken spring", 0.0)):
    run = mbd.inverse_dynamics(door, np.linspace(0, 12, 1201), parameters={stiffness: value})
    couple, angle = -run[opener.effort], run[shaft.angle]
    first, raised = 3 * MASS * G * REEL - value * 46, sum(run[panel.y][-1] - run[panel.y][0] for panel in panels)
    work, by_hand = trapezoid(-couple, angle), MASS * G * raised + value / 2 * ((angle[-1] + 46) ** 2 - 46**2)
    print(f"{what} {couple[0]:.4f} N m lift the closed door, by hand {first:.4f}; up to {couple.max():.1f} later")
    print(f"  it takes {work:.1f} J to open it, by hand {by_hand:.1f} J")
    course.plot(-angle * REEL, couple, label=what)
mbd.draw(run, drawing, poses=5)
course.set(xlabel="cable wound up, m", ylabel="couple of the opener, N m")
course.legend(frameon=False, fontsize="small")
figure.savefig(OUTPUT / "garage_door.png", dpi=120)
