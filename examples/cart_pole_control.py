"""Can a cart keep its pole up while somebody pushes it, if it plans again every 0.05 s?

Model-predictive control: at every sample a step towards the optimum over the next
second is made from the state at hand, and the first force of that plan is applied.
The controller is C, compiled once, which `controller.export(folder)` writes for a
machine. The cart that IDAS simulates feels pushes of which the plans know nothing.
"""

from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure

import mbdcasadi as mbd

OUTPUT = Path(__file__).parent / "output"
SAMPLE, HORIZON, TRACK, FORCE = 0.05, 1.0, 0.3, 10.0  # s, s, m, N

force = mbd.Input("force", lower=-FORCE, upper=FORCE)
cart = mbd.Body("cart", mass=1.0, inertia=0.0)
bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, 0.5, np.pi / 2))  # a point mass on a massless rod
rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
system = mbd.Mechanism(
    bodies=[cart, bob],
    joints=[rail, pole],
    forces=[mbd.Gravity(), mbd.Force("drive", cart.at(0, 0), (force, 0))],
    inputs=[force],
    name="cart and pole",
)


def pulse(begin, end, size):
    """A push between two times."""
    return size * (mbd.step(mbd.t, begin, 0, begin + 0.02, 1) - mbd.step(mbd.t, end, 0, end + 0.02, 1))


push = pulse(0.5, 0.8, 0.5) + pulse(2.0, 2.1, -2.0)  # N, at the bob
pushed = system.replace(forces=[*system.forces, mbd.Force("push", bob.at(0, 0), (push, 0))])

upright = [cart.x == 0, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0]
lean = bob.phi - np.pi / 2
away = 5 * cart.x**2 + cart.vx**2 + 10 * lean**2 + bob.omega**2
plan = mbd.OptimalControlProblem(
    system,
    duration=HORIZON,
    initial=upright,
    path=[mbd.bounded(-TRACK, cart.x, TRACK)],
    running_cost=away + 0.01 * force**2,
    terminal_cost=5 * mbd.at_end(away),
)
controller = mbd.Controller(plan, sample=SAMPLE, intervals=20)
plans = []


def control(now, state):
    """The force of the controller; its plan is kept for the picture."""
    inputs = controller.inputs(state)
    plans.append(controller.plan)
    return inputs


sampled = mbd.SampledController(control, SAMPLE)
motion = mbd.simulate(pushed, np.linspace(0, 4, 401), initial=upright, inputs=sampled)
degrees = np.degrees(motion[lean])
print(motion)
print(f"the pole leans {np.abs(degrees).max():.1f}° at most, {degrees[-1]:.2f}° at the end")
print(f"the cart goes {np.abs(motion[cart.x]).max():.3f} m off, the force reaches {np.abs(motion[force]).max():.2f} N")
print(controller, controller.timing, sep="\n")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(10, 7.2), layout="constrained")
angle, place, effort, clock = figure.subplots(4, 1, sharex=True)
shown = {"lean of the pole, °": lean * 180 / np.pi, "cart, m": cart.x, "force, N": force}
names = controller.state_names
for axes, (label, value) in zip((angle, place, effort), shown.items(), strict=True):
    axes.set_ylabel(label)
    steps = {"drawstyle": "steps-pre"} if value is force else {}
    axes.plot(motion.t, motion[value], color="#1f5fa8", linewidth=2, zorder=2, **steps)
    for ahead in plans[::2]:
        course = {
            angle: np.degrees(ahead.states[:, names.index("bob.phi")] - np.pi / 2),
            place: ahead.states[:, names.index("cart.x")],
            effort: np.append(ahead.inputs[:1, 0], ahead.inputs[:, 0]),
        }[axes]
        axes.plot(ahead.t, course, color="#e0a030", linewidth=0.6, alpha=0.6, zorder=1, **steps)
    for begin, end in ((0.5, 0.82), (2.0, 2.12)):
        axes.axvspan(begin, end, color="#d1495b", alpha=0.2, linewidth=0)
for axes, limit in ((place, TRACK), (effort, FORCE)):
    axes.hlines((-limit, limit), 0, 4, "black", "--", linewidth=0.8)
spent = 1e3 * (controller.timing.feedback + controller.timing.prepare)
clock.bar(SAMPLE * np.arange(len(plans)), spent, 0.8 * SAMPLE, align="edge", color="#5b6770")
clock.axhline(1e3 * SAMPLE, color="black", linewidth=0.8, linestyle="--")
clock.set(yscale="log", ylim=(0.05, 100), ylabel="time of a step, ms", xlabel="t, s", xlim=(0, 4))
angle.set_title("what happened (blue), what was planned (ochre), when it was pushed (red)")
figure.align_ylabels()
figure.savefig(OUTPUT / "cart_pole_control.png", dpi=150)
