"""Can a cart keep its pole up while somebody pushes it, if it plans again every 0.05 s?

Model-predictive control: at every sample a step towards the optimum over the next
second is made from the state at hand, and the first force of that plan is applied.
The controller is C, compiled once, which `controller.export(folder)` writes for a
machine. The cart that IDAS simulates feels pushes of which the plans know nothing.
"""

from pathlib import Path

import numpy as np

import mbdcasadi as mbd

TRACK = 0.3  # m
force = mbd.Input("force", lower=-10, upper=10)
cart = mbd.Body("cart", mass=1.0, inertia=0.0)
bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, 0.5, np.pi / 2))  # a point mass on a massless rod
rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
loads = [mbd.Gravity(), mbd.Force("drive", cart.at(0, 0), (force, 0))]
system = mbd.Mechanism([cart, bob], [rail, pole], forces=loads, inputs=[force], name="cart and pole")

lean = bob.phi - np.pi / 2
away = 5 * cart.x**2 + cart.vx**2 + 10 * lean**2 + bob.omega**2
plan = mbd.OptimalControlProblem(
    system,
    duration=1.0,
    path=[mbd.bounded(-TRACK, cart.x, TRACK)],
    running_cost=away + 0.01 * force**2,
    terminal_cost=5 * mbd.at_end(away),
)
controller = mbd.Controller(plan, sample=0.05, intervals=20)

push = mbd.step(mbd.t, 0.5, 0, 0.52, 0.5) - mbd.step(mbd.t, 0.8, 0, 0.82, 0.5)  # N, at the bob
push += mbd.step(mbd.t, 2.1, 0, 2.12, 2) - mbd.step(mbd.t, 2.0, 0, 2.02, 2)
pushed = system.replace(forces=[*loads, mbd.Force("push", bob.at(0, 0), (push, 0))])
upright = [cart.x == 0, cart.vx == 0, lean == 0, bob.omega == 0]
motion = mbd.simulate(pushed, np.linspace(0, 4, 401), initial=upright, inputs=controller)
degrees = np.degrees(motion[lean])
print(motion)
print(f"the pole leans {np.abs(degrees).max():.1f}° at most, {degrees[-1]:.2f}° at the end")
print(f"the cart goes {np.abs(motion[cart.x]).max():.3f} m off, the force reaches {np.abs(motion[force]).max():.2f} N")
print(controller, controller.timing, sep="\n")

shown = {"lean, °": lean * 180 / np.pi, "cart, m": cart.x, "force, N": force, "push, N": push}
mbd.plot(motion, shown).savefig(Path(__file__).parent / "output" / "cart_pole_control.png", dpi=150)
