"""What does the crank of an engine feel, and what torque keeps it at constant speed?

The mechanism is simulated by IDAS under a constant torque; then the crank is
driven instead, and inverse dynamics gives the torque and the bearing loads.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

crank = mbd.Body("crank", mass=0.12, inertia=1.0e-4, pose=(0.05, 0.0, 0.0))
rod = mbd.Body("rod", mass=0.50, inertia=4.0e-3, pose=(0.25, 0.0, 0.0))
slider = mbd.Body("slider", mass=2.00, inertia=1.0e-3, pose=(0.40, 0.0, 0.0))
tau = mbd.Input("tau", lower=-50, upper=50)

main = mbd.Revolute("main bearing", mbd.ground.at(0, 0), crank.at(-0.05, 0))
pin = mbd.Revolute("crank pin", crank.at(0.05, 0), rod.at(-0.15, 0))
wrist = mbd.Revolute("wrist pin", rod.at(0.15, 0), slider.at(0, 0))
guide = mbd.Translational("guide", mbd.ground.at(0, 0), slider.at(0, 0))

engine = mbd.Mechanism(
    bodies=[crank, rod, slider],
    joints=[main, pin, wrist, guide],
    forces=[mbd.Gravity(), mbd.Torque("motor", crank, tau)],
    inputs=[tau],
    name="engine",
)

motion = mbd.simulate(
    engine, np.linspace(0, 1, 401), initial=[main.angle == 0.3, crank.omega == 20], inputs={tau: 0.05}
)
print(motion)

driven = engine.replace(drivers=[mbd.Driver("speed", main.angle, 0.3 + 20 * mbd.t)])
run = mbd.inverse_dynamics(driven, np.linspace(0, 2 * np.pi / 20, 401))
torque = run[driven.joint("speed").effort]
print(f"torque for 20 rad/s: {torque.min():.2f} to {torque.max():.2f} N m, mean {torque[:-1].mean():.3f} N m")

shaking = mbd.shaking_force(driven)
figure = mbd.plot(
    run,
    {
        "torque, N m": driven.joint("speed").effort,
        "load of the crank pin, N": mbd.norm(pin.reaction_on(rod).force),
        "force on the foundation, N": shaking.force,
        "slider, m": slider.x,
    },
)
figure.savefig(OUTPUT / "slider_crank.png", dpi=120)
mbd.animate(
    run, OUTPUT / "slider_crank.html", trace=[rod.at(0, 0)], plots={"torque, N m": driven.joint("speed").effort}
)
