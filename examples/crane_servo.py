"""How fast can a crane carry a load over 5 m, if the servo of its trolley limits speed, acceleration and jerk?

The trolley follows three states, the last of which the command changes: the jerk. The load swings
freely on its rope and must hang at rest at the end.
"""

from pathlib import Path

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
WAY, LENGTH = 5.0, 3.0  # m

jerk = mbd.Input("jerk", lower=-6, upper=6, unit="m/s³")
place = mbd.StateVariable("place")
speed = mbd.StateVariable("speed", lower=-1.5, upper=1.5)
acceleration = mbd.StateVariable("acceleration", lower=-1, upper=1)
trolley = mbd.Body.from_shape("trolley", mbd.Rectangle(0.6, 0.25), mass=50)
load = mbd.Body.from_shape("load", mbd.Rectangle(0.5, 0.5), mass=200, pose=(0, -LENGTH, 0))
rail = mbd.Translational("rail", mbd.ground.at(0, 0), trolley.at(0, 0))
rope = mbd.Distance("rope", trolley.at(0, 0), load.at(0, 0), LENGTH)
upright = mbd.AbsoluteAngle("upright", load.at(0, 0), 0)
servo = mbd.Driver("servo", trolley.x, place)
crane = mbd.Mechanism(
    [trolley, load],
    [rail, rope, upright],
    [servo],
    forces=[mbd.Gravity()],
    inputs=[jerk],
    states={place: speed, speed: acceleration, acceleration: jerk},
    name="crane",
)


def at_rest(x):
    """Trolley and load stand at a place, and the servo is at rest."""
    return [trolley.x == x, trolley.vx == 0, acceleration == 0, load.x == x, load.vx == 0]


problem = mbd.OptimalControlProblem(
    crane, duration=(2, 20), initial=at_rest(0), final=at_rest(WAY), terminal_cost=mbd.t, path=[rope.tension >= 0]
)
fastest = mbd.optimize(problem, intervals=50, control="constant")
motion = fastest.trajectory
print(f"{fastest.duration:.3f} s; simulated, it arrives within {fastest.verify().final_error:.0e} m")
print(f"largest force of the servo {motion.maximum(mbd.fabs(servo.effort)).value:.0f} N")
print(f"largest lead of the trolley {motion.maximum(trolley.x - load.x).value:.3f} m")

figure = mbd.plot(
    motion,
    {
        "place, m": {"trolley": trolley.x, "load": load.x},
        "speed, m/s": speed,
        "acceleration, m/s²": acceleration,
        "jerk, m/s³": jerk,
    },
)
figure.savefig(OUTPUT / "crane_servo.png", dpi=120)
