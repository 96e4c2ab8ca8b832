"""At which load does a jointed column give way, and where does it go afterwards?

Two links stand on rotational springs under a dead load. The straight column is
an equilibrium at any load; where it loses its stability is the buckling load,
(3 - √5)/2 k/L in closed form. A small sideways push shows what a real one does.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

K, L = 20.0, 0.5
load = mbd.Parameter("load", 0.0)
push = mbd.Parameter("push", 0.0)

lower = mbd.Body("lower", mass=0.1, inertia=0.002, pose=(0, L / 2, np.pi / 2))
upper = mbd.Body("upper", mass=0.1, inertia=0.002, pose=(0, 1.5 * L, np.pi / 2))
foot = mbd.ground.at(0, 0), lower.at(-L / 2, 0)
elbow = lower.at(L / 2, 0), upper.at(-L / 2, 0)
top = upper.at(L / 2, 0)
column = mbd.Mechanism(
    bodies=[lower, upper],
    joints=[mbd.Revolute("foot", *foot), mbd.Revolute("elbow", *elbow)],
    forces=[
        mbd.RSDA("foot spring", *foot, stiffness=K, free_angle=np.pi / 2),
        mbd.RSDA("elbow spring", *elbow, stiffness=K),
        mbd.Force("load", top, (push, -load)),
    ],
    parameters=[load, push],
)

straight = mbd.equilibrium_path(column, load, 0, 40)
print(straight)
critical = straight.critical[0].value
print(f"buckling load {critical:.6f} N, in closed form {K / L * (3 - 5**0.5) / 2:.6f} N")

figure = mbd.plot_path(straight, {"sideways displacement of the top, m": top.x})
(axes,) = figure.axes
for side, colour in ((0.02, "#d1495b"), (0.2, "#2e8b6f"), (1.0, "#e0a030")):
    bent = mbd.equilibrium_path(column, load, 0, 40, parameters={push: side})
    axes.plot(bent.values, bent[top.x], color=colour, label=f"pushed aside by {side} N")
axes.set(xlabel="load, N", ylim=(-0.1, 1.05))
axes.legend(frameon=False)
figure.savefig(OUTPUT / "buckling.png", dpi=120)
