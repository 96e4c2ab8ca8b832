"""How far does a trebuchet throw, and would a longer sling or a later release throw farther?

The ball slides in the trough, hangs on the sling, and flies: three mechanisms of the same bodies.
It leaves the trough when the reaction vanishes, and the sling at a given angle between sling and
beam. Derivatives of the range are carried through all changes, whose instants move too; they give
the direction of ascent, and one or two steps along it throw farther.
"""

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"


class Sling(mbd.Distance):
    """A rope that stays taut."""


@mbd.glyph.register
def _(sling: Sling, pen):
    """As a line: a length that is a parameter would be drawn as a cylinder."""
    pen.between(sling.a.position, sling.b.position).draw("belt", [[0, 0, 0, 0], [0, 1, 0, 0]])


LONG, SHORT, HANG, HEIGHT = 6.0, 1.5, 1.2, 5.0  # m
BEAM, WEIGHT, BALL = 200.0, 3000.0, 30.0  # kg

tilt = np.pi + np.arcsin((HEIGHT - 0.5) / LONG)
along_beam = np.array([np.cos(tilt), np.sin(tilt)])
tip = np.array([0, HEIGHT]) + LONG * along_beam
middle = np.array([0, HEIGHT]) + (LONG - SHORT) / 2 * along_beam
pivot_to_weight = -SHORT * along_beam + np.array([0, HEIGHT - HANG])

length, angle = mbd.Parameter("sling", 5.0), mbd.Parameter("release", np.radians(40))
inertia = BEAM * (LONG + SHORT) ** 2 / 12
beam = mbd.Body("beam", mass=BEAM, inertia=inertia, pose=(*middle, tilt), shape=mbd.Rectangle(LONG + SHORT, 0.3))
weight = mbd.Body("counterweight", mass=WEIGHT, inertia=500.0, pose=(*pivot_to_weight, 0), shape=mbd.Rectangle(1, 1))
ball = mbd.Body("ball", mass=BALL, inertia=0.5, pose=(tip[0] + np.sqrt(25 - tip[1] ** 2), 0, 0), shape=mbd.Disc(0.3))
end, hook = beam.at((LONG + SHORT) / 2, 0), mbd.ground.at(0, HEIGHT)
pivot = mbd.Revolute("pivot", hook, beam.at(-(LONG - SHORT) / 2, 0))
hang = mbd.Revolute("hang", beam.at(-(LONG + SHORT) / 2, 0), weight.at(0, HANG))
sling = Sling("sling", end, ball.at(0, 0), length)
trough = mbd.AbsoluteY("trough", ball.at(0, 0), 0.0)
sliding = mbd.Mechanism(
    bodies=[beam, weight, ball],
    joints=[pivot, hang, sling, trough],
    forces=[mbd.Gravity()],
    parameters=[length, angle],
    name="trebuchet",
)
slung = sliding.replace(joints=[pivot, hang, sling])
flying = mbd.Mechanism(bodies=[ball], forces=[mbd.Gravity()])
opening = mbd.dot(ball.position - end.position, end.position - hook.position) / (length * LONG)
events = [
    mbd.Event("lifts off", trough.reaction_on(ball).force[1], direction=-1, becomes=slung),
    mbd.Event("release", opening - mbd.cos(angle), direction=1, during=slung, becomes=flying),
    mbd.Event("lands", ball.y, direction=-1, during=flying, terminal=True),
]
start = [beam.phi == tilt, beam.omega == 0, weight.phi == 0, weight.omega == 0]
times = np.linspace(0, 12, 601)

design, found = np.array([5.0, np.radians(40)]), []
for _ in range(2):
    values = {length: design[0], angle: design[1]}
    slopes = mbd.sensitivities(
        sliding, times[::50], [ball.x], [length, angle], start, parameters=values, events=events
    ).events[-1]
    found.append((*design, slopes[ball.x]))
    print(f"sling {design[0]:.3f} m, {np.degrees(design[1]):.2f}°: range {slopes[ball.x]:.3f} m, ", end="")
    uphill = np.array([slopes[ball.x, length], slopes[ball.x, angle]])
    print(f"{uphill[0]:+.2f} m by a metre of sling, {np.radians(uphill[1]):+.2f} m by a degree")
    design = design + 0.5 * uphill * [1, 1 / 25] / np.hypot(uphill[0], uphill[1] / 5)  # half a metre, or 6°

shots = [
    mbd.simulate(sliding, times, initial=start, parameters={length: d[0], angle: d[1]}, events=events)
    for d in (found[0], design)
]
for shot in shots:
    print(", ".join(f"{event.name} at {event.t:.4f} s" for event in shot.events), f"{shot.final[ball.x]:.6f} m")

figure = Figure(figsize=(8, 6.5), layout="constrained")
near, far = figure.subplots(2, 1, height_ratios=(2, 1))
swing = shots[0].at(np.linspace(0, shots[0].events[1].t, 60))
mbd.draw(swing, near, poses=9, trace=[ball.at(0, 0)])
for shot, label, colour in zip(shots, ("as it was", "better"), ("#5b6770", "#c1553b"), strict=True):
    far.plot(shot[ball.x], shot[ball.y], color=colour, label=f"{label}, {shot.final[ball.x]:.0f} m")
far.set_xlabel("x, m")
far.set_ylabel("y, m")
far.legend(frameon=False)
far.spines[["top", "right"]].set_visible(False)
figure.savefig(OUTPUT / "trebuchet.png", dpi=120)
film = shots[0].at(np.linspace(0, shots[0].events[1].t + 0.15, 121))
mbd.animate(film, OUTPUT / "trebuchet.html", trace=[ball.at(0, 0)], speed=0.4)
