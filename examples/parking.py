"""How is a sledge parked that cannot move sideways?

A blade behind the centre of mass lets the sledge go only where it points: a
constraint on velocities, which no constraint on positions implies. Left alone
it turns until it runs straight ahead; with a rudder and a screw it can be
brought to any place, and the cheapest way there is found.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

sledge = mbd.Body("sledge", mass=1.3, inertia=0.1)
blade = mbd.KnifeEdge("blade", sledge.at(-0.2, 0))
forward = mbd.dot(blade.marker.x_axis, blade.marker.velocity)
across = mbd.dot(blade.marker.y_axis, blade.marker.velocity)

# --- left alone: Chaplygin's sleigh -----------------------------------------------------
free = mbd.Mechanism([sledge], [blade])
run = mbd.simulate(free, duration=4.0, initial=[forward == -0.5, sledge.omega == 4.0])
print(f"it starts backwards at {run[forward][0]:.2f} m/s and ends forwards at {run[forward][-1]:.2f} m/s")
print(f"energy changes by {np.ptp(run.energy.total):.1e} J, the blade slips by {np.abs(run[across]).max():.1e} m/s")

# --- parked 0.4 m to the side ---------------------------------------------------------------
rudder, screw = mbd.Input("rudder"), mbd.Input("screw")
forces = [mbd.Torque("rudder", sledge, rudder), mbd.Force("screw", blade.marker, (screw, 0), frame="body")]
steered = mbd.Mechanism([sledge], [blade], forces=forces, inputs=[rudder, screw])
rest = [sledge.omega == 0, forward == 0]
problem = mbd.OptimalControlProblem(
    steered,
    duration=2.0,
    initial=[sledge.x == 0, sledge.y == 0, sledge.phi == 0, *rest],
    final=[sledge.x == 0.5, sledge.y == 0.4, sledge.phi == 0, *rest],
    running_cost=rudder**2 + screw**2,
)
solution = mbd.optimize(problem, intervals=30)
print(f"parked with the effort {solution.cost:.3f}; replayed by IDAS it is off by {solution.verify().final_error:.1e}")

figure = mbd.plot(
    solution.trajectory,
    {
        "position, m": sledge.position,
        "angle, rad": sledge.phi,
        "rudder, N m": rudder,
        "side force of the blade, N": blade.side_force,
    },
)
figure.savefig(OUTPUT / "parking.png", dpi=120)
mbd.animate(solution, OUTPUT / "parking.html", trace=[sledge], plots={"rudder, N m": rudder})
