"""How does a pair of legs walk down a slope without a motor, and what brings it back if it is pushed?

Two legs with a hip (Goswami et al. 1998). One foot is pinned, the other one
swings; where it lands, it is pinned by a plastic impact and the first one is released. A rough
simulated step is enough for optimal control over two phases to find the gait; its Floquet
multipliers say how fast a push is forgotten.
"""

import warnings
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"

G, SLOPE = 9.81, np.radians(3)
HIP, LEG, A, B = 10.0, 5.0, 0.5, 0.5  # masses, kg; from the foot to the centre of a leg and on to the hip, m

top = (A + B) * np.array([np.sin(-0.25), np.cos(0.25)])


def leg(name, angle):
    centre = top - B * np.array([np.sin(angle), np.cos(angle)])
    return mbd.Body(name, mass=LEG, inertia=0, pose=(*centre, -angle))


hip = mbd.Body("hip", mass=HIP, inertia=0, pose=(*top, 0))
one, two = leg("leg 1", -0.25), leg("leg 2", 0.25)
foot = two.at(0, -A)
upright = mbd.AbsoluteAngle("hip does not turn", hip.at(0, 0), 0.0)
hips = [mbd.Revolute(f"hip of {x.name}", hip.at(0, 0), x.at(0, B)) for x in (one, two)]
step = mbd.Parameter("step", 0.5, lower=0.1, upper=1.0)
stands = mbd.Revolute("foot 1 stands", mbd.ground.at(0, 0), one.at(0, -A))
landed = mbd.Revolute("foot 2 stands", mbd.ground.at(step, 0), foot)
downhill = mbd.Gravity((G * np.sin(SLOPE), -G * np.cos(SLOPE)))
on_one = mbd.Mechanism(bodies=[hip, one, two], joints=[upright, *hips, stands], forces=[downhill])
on_two = on_one.replace(joints=[upright, *hips, landed], parameters=[step])

# legs without knees pass below the ground at mid-stance, which does not count
height = mbd.if_else(one.phi < -0.05, foot.y, 1.0)
lands = mbd.Event("touch-down", height, direction=-1, becomes=on_two, reset={step: foot.x}, terminal=True)
start = [one.phi == 0.27, two.phi == -0.27, one.omega == -1.1, two.omega == -0.4]
rough = mbd.simulate(on_one, np.linspace(0, 2, 401), initial=start, events=[lands])

swing = mbd.Phase("swing", on_one, duration=(0.3, 1.5), final=[foot.vy <= 0])
touch = mbd.Phase("touch-down", on_two, duration=0)
gait = mbd.OptimalControlProblem(
    phases=[swing, touch],
    boundary=[  # the legs change names
        mbd.at_end(two.phi) == mbd.at_start(one.phi),
        mbd.at_end(two.omega) == mbd.at_start(one.omega),
        mbd.at_end(one.phi) == mbd.at_start(two.phi),
        mbd.at_end(one.omega) == mbd.at_start(two.omega),
    ],
    free_parameters=[step],
)
with warnings.catch_warnings():
    warnings.filterwarnings("ignore", ".*beyond zero before", mbd.MechanismWarning)
    solution = mbd.optimize(gait, intervals=20, guess=rough)
stability, check = solution.stability(), solution.verify()
print(f"a step of {solution.parameters[step]:.6f} m in {solution.duration:.6f} s")
print(f"replayed by IDAS the foot lands within {check.time_error:.0e} s of the plan")
print("Floquet multipliers:", ", ".join(f"{abs(x):.3f}" for x in stability.multipliers))
event = solution.trajectory.events[0]
print(f"impulse of the ground {event.after[landed.impulse_on(two).force]} N s")

figure = Figure(figsize=(7, 6), layout="constrained")
legs, angles = figure.subplots(2, 1)
times = np.linspace(0, solution.duration, 9)
motion = solution.trajectory.at(times)
for body, colour in ((one, "#1f5fa8"), (two, "#d1495b")):
    ends = np.stack([motion[body.at(0, y).position] for y in (-A, B)])
    legs.plot(ends[:, :, 0], ends[:, :, 1], color=colour, alpha=0.7)
legs.axhline(0, color="grey", linewidth=0.8)
legs.set_aspect("equal")
legs.set_xlabel("along the slope, m")
legs.set_ylabel("height over the slope, m")
fine = solution.trajectory
for body, colour in ((one, "#1f5fa8"), (two, "#d1495b")):
    angles.plot(fine[body.phi], fine[body.omega], color=colour, label=body.name)
angles.set_xlabel("angle, rad")
angles.set_ylabel("rate, rad/s")
angles.legend(frameon=False)
for axes in (legs, angles):
    axes.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "compass_walker.png", dpi=120)
