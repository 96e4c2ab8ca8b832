"""How evenly can the motor of a beam pump turn it, six seconds a stroke?

A crank moves the walking beam of an oil well by a pitman; the beam lifts rods
and oil and lowers the rods alone. Each turn must repeat the one
before: the end of the motion is tied to its start. The torque of least ripple
about its mean, a parameter of the problem's own, is optimised for several bands
of speed, without and with a counterweight whose mass and place on the crank
are found at the same time. An IDAS run confirms every turn.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

TURN, GEARBOX = 6.0, 1.0e4  # s; kg m², motor and gears as felt at the crank
HEAD, RODS, OIL = 3.0, 20.0e3, 15.0e3  # m, N, N
CENTRE, POST = (2.5, 1.8), (0.0, 4.8)  # m, of the crank and of the beam

mass = mbd.Parameter("counterweight", 0.0, lower=0.0, upper=6000.0)  # kg
place = mbd.Parameter("its angle to the crank pin", 0.5, lower=-np.pi, upper=np.pi)  # rad
mean = mbd.Parameter("mean torque", 6e3, lower=0.0, upper=1e5)  # N m
tau = mbd.Input("tau")

crank = mbd.Body("crank", mass=300.0, inertia=GEARBOX, pose=(*CENTRE, 0.0))
pitman = mbd.Body("pitman", mass=200.0, inertia=150.0, pose=(3.0, 3.3, 1.9))
# the rods hang from an arc about the beam's bearing: they move as if on the beam
arc = [(-HEAD * np.cos(k), HEAD * np.sin(k)) for k in np.linspace(-0.45, 0.45, 21)]
outline = mbd.Polygon([*arc, (-2.2, 0.15), (2.6, 0.15), (2.6, -0.15), (-2.2, -0.15)])
beam = mbd.Body("beam", mass=1500.0, inertia=4500.0 + RODS / 9.81 * HEAD**2, pose=(*POST, 0.0), shape=outline)
weight = mbd.Body("weight", mass=mass, inertia=0.0, pose=(4.0, 2.0, 0.0))
shaft = mbd.Revolute("shaft", mbd.ground.at(*CENTRE), crank.at(0, 0))
pin = mbd.Revolute("crank pin", crank.at(1.0, 0), pitman.at(-1.5, 0))
tail = mbd.Revolute("tail bearing", pitman.at(1.5, 0), beam.at(2.5, 0))
saddle = mbd.Revolute("saddle bearing", mbd.ground.at(*POST), beam.at(0, 0))
clamp = mbd.Weld("clamp", crank.at(1.5 * mbd.cos(place), 1.5 * mbd.sin(place)), weight.at(0, 0))
well = mbd.Torque("well", beam, HEAD * (RODS + OIL * (1 - mbd.tanh(HEAD * beam.omega / 0.1)) / 2))  # oil while rising
pump = mbd.Mechanism(
    bodies=[crank, weight, pitman, beam],
    joints=[shaft, pin, tail, saddle, clamp],
    forces=[mbd.Gravity(), well, mbd.Torque("motor", crank, tau)],
    inputs=[tau],
    parameters=[mass, place],
    name="beam pump",
)
turn = mbd.OptimalControlProblem(
    pump,
    duration=TURN,
    initial=[shaft.angle == 0],
    boundary=[mbd.at_end(shaft.angle) == mbd.at_start(shaft.angle) + 2 * np.pi]
    + [mbd.at_end(value) == mbd.at_start(value) for value in (crank.omega, tau)],
    running_cost=((tau - mean) / 1e3) ** 2 / TURN,  # (kN m)²
    free_parameters=[mean],
)


def within(band):
    """Path conditions for a speed that stays within a share of its mean."""
    return [mbd.bounded((1 - band) * 2 * np.pi / TURN, crank.omega, (1 + band) * 2 * np.pi / TURN)]


share = mbd.Parameter("share of the speed", 0.2, lower=0.01, upper=0.5)
problems = {"10 %, no counterweight": turn.replace(path=within(0.10))}
problems |= {f"{k} %": turn.replace(path=within(k / 100), free_parameters=[mean, mass, place]) for k in (2, 10)}
even = {"path": [tau == mean, *within(share)], "free_parameters": [mean, mass, place, share]}
problems["torque constant"] = turn.replace(**even, running_cost=0, terminal_cost=share)
found: dict[str, mbd.Solution] = {}
for name, problem in problems.items():
    # an even torque is near to one of little ripple
    found[name] = mbd.optimize(problem, intervals=60, guess=found["10 %"] if name == "torque constant" else None)
for name, solution in found.items():
    print(f"{name}: {solution}\n  the torque varies by {np.ptp(solution.trajectory[tau]) / 1e3:.2f} kN m")
    print(f"  {solution.verify()}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(11, 5.2), layout="constrained")
axes = figure.subplot_mosaic([["scene", "torque"], ["scene", "speed"]])
mbd.draw(found["10 %"], axes["scene"], poses=5)
axes["scene"].plot([-HEAD, -HEAD], [0, POST[1]], color="#5b6770", linewidth=1.5, zorder=0)
for foot, top in ((-0.8, POST), (0.8, POST), (CENTRE[0], CENTRE)):
    axes["scene"].plot([foot, top[0]], [0, top[1]], color="#8a929a", zorder=0)
axes["scene"].axhline(0, color="#8a6d3b", linewidth=3)
axes["scene"].set(ylim=(-0.2, None), title="within 10 %, every 1.5 s")
for (name, solution), colour in zip(found.items(), ("#5b6770", "#e0a030", "#1f5fa8", "#d1495b"), strict=True):
    motion = solution.trajectory.at(np.linspace(0, TURN, 601))
    axes["torque"].plot(motion.t, motion[tau] / 1e3, color=colour, label=name)
    axes["speed"].plot(motion.t, motion[crank.omega], color=colour)
axes["speed"].hlines(np.array([0.9, 0.98, 1.02, 1.1]) * 2 * np.pi / TURN, 0, TURN, "black", "--", linewidth=0.8)
axes["torque"].set(ylabel="torque at the crank, kN m", xlim=(0, TURN), ylim=(-42, 50))
axes["torque"].legend(loc="lower right", fontsize="small", ncols=2)
axes["speed"].set(xlabel="t, s", ylabel="crank speed, rad/s", xlim=(0, TURN))
figure.savefig(OUTPUT / "periodic_linkage.png", dpi=150)
