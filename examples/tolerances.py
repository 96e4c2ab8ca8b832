"""Which dimension of a slider-crank must be made most exactly?

Derivatives of the stroke and of the bearing load by every length, exact and
from one run; then a sweep over a Latin hypercube of real machines, in two
processes, to see whether the linear picture holds (the hypercube is that of SciPy).
"""

from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

crank_length, rod_length = mbd.Parameter("crank", 0.10, lower=0.01), mbd.Parameter("rod", 0.30, lower=0.1)
offset = mbd.Parameter("offset", 0.0)
crank = mbd.Body("crank", mass=0.3, inertia=4e-4, pose=(0.05, 0, 0))
rod = mbd.Body("rod", mass=0.5, inertia=4e-3, pose=(0.25, 0, 0))
slider = mbd.Body("slider", mass=2.0, inertia=1e-3, pose=(0.40, 0, 0))
main = mbd.Revolute("main bearing", mbd.ground.at(0, 0), crank.at(-crank_length / 2, 0))
engine = mbd.Mechanism(
    bodies=[crank, rod, slider],
    joints=[
        main,
        mbd.Revolute("crank pin", crank.at(crank_length / 2, 0), rod.at(-rod_length / 2, 0)),
        mbd.Revolute("wrist pin", rod.at(rod_length / 2, 0), slider.at(0, 0)),
        mbd.Translational("guide", mbd.ground.at(0, offset), slider.at(0, 0)),
    ],
    forces=[mbd.Gravity(), mbd.TSDA("gas", mbd.ground.at(0.6, 0), slider.at(0, 0), stiffness=400, free_length=0.25)],
    parameters=[crank_length, rod_length, offset],
)
lengths = [crank_length, rod_length, offset]
start = [main.angle == 0.2, crank.omega == 15]
times = np.linspace(0, 0.8, 161)
outputs = {"slider": slider.x, "load": mbd.norm(main.reaction_on(crank).force)}


def run() -> None:
    """Differentiate, sweep, draw."""
    found = mbd.sensitivities(engine, times, outputs, wrt=lengths, initial=start)
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True)
    for length, colour in zip(lengths, ("#1f5fa8", "#d1495b", "#2e8b6f"), strict=True):
        # per millimetre
        above.plot(times, found["load", length] * 1e-3, color=colour, label=length.label)
    above.set_ylabel("bearing load by length, N/mm")
    above.legend(frameon=False)

    near = {length: (length.value - 2e-4, length.value + 2e-4) for length in lengths}
    with ProcessPoolExecutor(2) as executor:
        swept = mbd.sweep(engine, times, mbd.latin_hypercube(near, 200, seed=1), outputs, start, executor=executor)
    change = sum(found["load", x] * (swept.cases[x] - x.value)[:, None] for x in lengths)
    print(swept)
    print(f"spread of the load {np.ptp(swept['load'], axis=0).max():.3f} N;", end=" ")
    print(f"the derivatives miss it by {np.abs(found['load'] + change - swept['load']).max():.4f} N at most")
    below.plot(times, (swept["load"] - found["load"]).T, color="#1f5fa8", alpha=0.06)
    below.set_ylabel("load of 200 machines less nominal, N")
    below.set_xlabel("t, s")
    figure.savefig(OUTPUT / "tolerances.png", dpi=120)


if __name__ == "__main__":  # the worker processes read this file too
    run()
