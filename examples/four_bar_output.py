"""A rocker has to swing by a given law: what torque must act at the *input* crank?

The motion is prescribed at one place and the actuator sits at another; both
follow from the same equations. Forward dynamics with the torque that was found
gives the motion back.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

crank = mbd.Body("crank", mass=0.3, inertia=0.3 * 0.10**2 / 12, pose=(0.04, 0.02, 0.5))
coupler = mbd.Body("coupler", mass=0.8, inertia=0.8 * 0.28**2 / 12, pose=(0.19, 0.14, 0.7))
rocker = mbd.Body("rocker", mass=0.7, inertia=0.7 * 0.24**2 / 12, pose=(0.30, 0.12, 1.6))
tau = mbd.Input("tau")

o2 = mbd.Revolute("O2", mbd.ground.at(0, 0), crank.at(-0.05, 0))
pin_a = mbd.Revolute("A", crank.at(0.05, 0), coupler.at(-0.14, 0))
pin_b = mbd.Revolute("B", coupler.at(0.14, 0), rocker.at(0.12, 0))
o4 = mbd.Revolute("O4", mbd.ground.at(0.30, 0), rocker.at(-0.12, 0))
linkage = mbd.Mechanism(
    bodies=[crank, coupler, rocker],
    joints=[o2, pin_a, pin_b, o4],
    forces=[mbd.Gravity(), mbd.Torque("motor", crank, tau)],
    inputs=[tau],
    name="four-bar",
)
print(mbd.check(linkage))

start = mbd.assemble(linkage, [o2.angle == 0.9])
first = start[o4.angle]
swing = first + 0.25 * mbd.step(mbd.t, 0.0, 0.0, 0.5, 1.0)
times = np.linspace(0, 0.5, 201)
run = mbd.inverse_dynamics(linkage, times, motion={o4.angle: swing}, efforts=[tau])
print(f"torque at the crank: {run[tau].min():.3f} to {run[tau].max():.3f} N m")

replay = mbd.simulate(linkage, times, initial=run.initial, inputs={tau: run[tau]})
print(f"replayed: the rocker is off by {np.abs(replay[o4.angle] - run[o4.angle]).max():.1e} rad")

figure = mbd.plot(
    run,
    {
        "rocker angle, rad": o4.angle,
        "crank torque, N m": tau,
        "bearing O4, N": mbd.norm(o4.reaction_on(rocker).force),
    },
)
figure.savefig(OUTPUT / "four_bar_output.png", dpi=120)
