"""Can a cart keep its pole up while somebody pushes it, if it plans again every 0.05 s?

Model-predictive control: at every sample the optimum over the next second is
found from the state at hand, its first force is applied, and the last plan
is the guess of the next. The program is built and compiled once, in the first
solve. The cart that IDAS simulates feels pushes of which the plans know nothing.
"""

import time
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
plans, seconds = [], []


def control(now, state):
    """The first force of a plan for the next second."""
    began = time.perf_counter()
    last = plans[-1] if plans else None
    plans.append(mbd.optimize(plan, initial=state, guess=last, intervals=20, control="constant"))
    seconds.append(time.perf_counter() - began)
    return {force: plans[-1].trajectory[force][0]}


controller = mbd.SampledController(control, SAMPLE)
motion = mbd.simulate(pushed, np.linspace(0, 4, 401), initial=upright, inputs=controller)
later, iterations = 1e3 * np.array(seconds[2:]), [p.statistics.iterations for p in plans]
degrees = np.degrees(motion[lean])
print(motion)
print(f"the pole leans {np.abs(degrees).max():.1f}° at most, {degrees[-1]:.2f}° at the end")
print(f"the cart goes {np.abs(motion[cart.x]).max():.3f} m off, the force reaches {np.abs(motion[force]).max():.2f} N")
print(f"first plan {1e3 * seconds[0]:.0f} ms, {1e3 * plans[0].statistics.build_seconds:.0f} ms of it for building")
print(f"later plans {np.median(later):.0f} ms (median) to {later.max():.0f} ms, up to {max(iterations)} iterations")
strongest = plans[int(np.argmax(np.abs([p.trajectory[force][0] for p in plans])))]
print(f"the plan of the strongest force: {strongest.verify()}")

# --- picture ---------------------------------------------------------------------------------
matplotlib.rcParams.update({"axes.spines.top": False, "axes.spines.right": False, "legend.frameon": False})
figure = Figure(figsize=(10, 7.2), layout="constrained")
angle, place, effort, clock = figure.subplots(4, 1, sharex=True)
shown = {"lean of the pole, °": lean * 180 / np.pi, "cart, m": cart.x, "force, N": force}
for axes, (label, value) in zip((angle, place, effort), shown.items(), strict=True):
    axes.set_ylabel(label)
    for k in range(0, len(plans), 2):
        ahead = plans[k].trajectory
        axes.plot(k * SAMPLE + ahead.t, ahead[value], color="#e0a030", linewidth=0.6, alpha=0.6, zorder=1)
    style = "steps-pre" if value is force else "default"
    axes.plot(motion.t, motion[value], color="#1f5fa8", linewidth=2, zorder=2, drawstyle=style)
    for begin, end in ((0.5, 0.82), (2.0, 2.12)):
        axes.axvspan(begin, end, color="#d1495b", alpha=0.2, linewidth=0)
for axes, limit in ((place, TRACK), (effort, FORCE)):
    axes.hlines((-limit, limit), 0, 4, "black", "--", linewidth=0.8)
clock.bar(SAMPLE * np.arange(len(plans)), 1e3 * np.array(seconds), 0.8 * SAMPLE, align="edge", color="#5b6770")
clock.axhline(1e3 * SAMPLE, color="black", linewidth=0.8, linestyle="--")
clock.set(yscale="log", ylim=(5, 1000), ylabel="time of a plan, ms", xlabel="t, s", xlim=(0, 4))
angle.set_title("what happened (blue), what was planned (ochre), when it was pushed (red)")
figure.align_ylabels()
figure.savefig(OUTPUT / "cart_pole_control.png", dpi=150)
