"""Does the rear of a motorcycle squat as it accelerates, and what has the place of its sprocket to do with it?

The chain pulls the wheel on its swing arm along its upper strand. The inertia of the frame loads the spring of
the arm; traction and chain relieve it. Balances by hand give what the rear wheel and the spring carry.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
R, SMALL, LARGE, ARM, TILT, BASE, COUPLE, G = 0.31, 0.035, 0.1, 0.57, 0.18, 1.4, 60.0, 9.81

height, centre, axle = mbd.Parameter("height of the sprocket, m", 0.0), np.array([0.7, 0.65]), np.array([0, R])
half = ARM / 2 * np.array([np.cos(TILT), np.sin(TILT)])
hub, fork = axle + 2 * half - centre, np.array([BASE, R]) - centre  # on the frame
outline = [(-0.14, -0.25), (0.2, -0.25), (0.46, 0.0), (0.7, -0.34), (0.52, 0.2), (0.42, 0.2), (-0.7, 0.15)]
frame = mbd.Body("frame", mass=230, inertia=25, pose=(*centre, 0), shape=mbd.Polygon(outline))
arm = mbd.Body.from_shape("arm", mbd.Rod(ARM), mass=8, pose=(*axle + half, TILT))
rear, front = (mbd.Body.from_shape(n, mbd.Disc(R), mass=14, pose=(x, R, 0)) for n, x in (("rear", 0), ("front", BASE)))
sprocket = mbd.Body.from_shape("sprocket", mbd.Disc(SMALL), mass=2, pose=(*hub + centre + (0.07, 0), 0))
bodies, wheels, ends = [frame, arm, rear, front, sprocket], (rear, front), (sprocket.at(0, 0), rear.at(0, 0))
pivot = mbd.Revolute("pivot", frame.at(*hub), arm.at(ARM / 2, 0))
shaft = mbd.Revolute("shaft", frame.at(hub[0] + 0.07, hub[1] + height), sprocket.at(0, 0))
holders = arm.at(-ARM / 2, 0), frame.at(*fork)
axles = [mbd.Revolute(f"{w.name} axle", at, w.at(0, 0)) for w, at in zip(wheels, holders, strict=True)]
tyres = [mbd.Rolling(f"{wheel.name} tyre", wheel.at(0, 0), mbd.ground.at(0, 0), R) for wheel in wheels]
chain = mbd.ElasticBelt("chain", *ends, SMALL, LARGE, stiffness=1e6, damping=1e3, carrier=arm, slack=0.01)
spring = mbd.RSDA("spring", frame.at(*hub), arm.at(ARM / 2, 0), stiffness=8e3, damping=500, free_angle=TILT + 0.08)
engine = mbd.Torque("engine", sprocket, -COUPLE * mbd.step(mbd.t, 0, 0, 0.1, 1), opposite=frame)
forces = [mbd.Gravity(), chain, spring, engine]
bike = mbd.Mechanism(bodies, [pivot, shaft, *axles, *tyres], forces=forces, parameters=[height], name="motorcycle")

turns = {frame: 0, arm: 0, rear: 1 / R, front: 1 / R, sprocket: LARGE / SMALL / R}  # rad for each metre
a = COUPLE * turns[sprocket] / sum(b.mass + b.inertia * turns[b] ** 2 for b in bodies)  # m/s², by hand
pull = (COUPLE - sprocket.inertia * a * turns[sprocket]) / SMALL
traction = (pull * LARGE - rear.inertia * a / R) / R
figure = Figure(figsize=(9.6, 4.2), layout="constrained")
drawing, course = figure.subplots(1, 2)
for place in (-0.05, 0.0, 0.05):
    rest = mbd.equilibrium(bike, parameters={height: place})
    run = mbd.simulate(bike, np.linspace(0, 2, 201), initial=rest, parameters={height: place})
    end, squat = run.final, 1e3 * (run[spring.angle] - rest[spring.angle])
    moments = [b.mass * (G * (end[front.x] - end[b.x]) + a * end[b.y]) + b.inertia * a * turns[b] for b in bodies]
    load = sum(moments) / (end[front.x] - end[rear.x])
    s, d = {b: end[b.position - pivot.a.position] for b in (arm, rear)}, end[sprocket.position - rear.position]
    x, y, lean = *s[rear], np.arctan2(d[1], d[0]) - np.arcsin((LARGE - SMALL) / np.hypot(*d))
    hold = pull * (y * np.cos(lean) - x * np.sin(lean) + LARGE) - x * load + (y - R) * traction - rear.inertia * a / R
    hold += sum(b.mass * (G * s[b][0] - a * s[b][1]) for b in s)
    tyre, couple = end[tyres[0].normal_force], -end[spring.torque]
    print(f"sprocket at {1e3 * place:.0f} mm: the arm turns by {squat[-1]:.2f} mrad at {end[frame.ax]:.4f} m/s²")
    print(f"  tyre {tyre:.2f} N, spring {couple:.2f} N m; by hand {a:.4f} m/s², {load:.2f} N, {hold:.2f} N m")
    course.plot(run.t, squat, label=f"sprocket at {1e3 * place:.0f} mm")
mbd.draw(end, drawing)
course.set(xlabel="time, s", ylabel="turn of the arm, mrad")
course.legend(frameon=False, fontsize="small", loc=(0.6, 0.5))
figure.savefig(OUTPUT / "motorcycle.png", dpi=120)
