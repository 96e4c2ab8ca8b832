"""A cart swings a pole up: the tutorial problem of trajectory optimisation (Kelly, SIAM Review 2017).

The force is found by direct collocation on the same equations that IDAS
integrates, and proved by simulating the cart with it.
"""

import numpy as np

import mbdcasadi as mbd

force = mbd.Input("force", lower=-20, upper=20)
cart = mbd.Body("cart", mass=1.0, inertia=0.0)
bob = mbd.Body("bob", mass=0.3, inertia=0.0, pose=(0, -0.5, -np.pi / 2))  # a point mass on a massless rod
rail = mbd.Translational("rail", mbd.ground.at(0, 0), cart.at(0, 0))
pole = mbd.Revolute("pole", cart.at(0, 0), bob.at(-0.5, 0))
system = mbd.Mechanism(
    bodies=[cart, bob],
    joints=[rail, pole],
    forces=[mbd.Gravity(), mbd.Force("push", cart.at(0, 0), (force, 0))],
    inputs=[force],
    name="cart and pole",
)

swing_up = mbd.OptimalControlProblem(
    system,
    duration=2.0,
    initial=[cart.x == 0, cart.vx == 0, bob.phi == -np.pi / 2, bob.omega == 0],
    final=[cart.x == 1, cart.vx == 0, bob.phi == np.pi / 2, bob.omega == 0],
    path=[mbd.bounded(-2, cart.x, 2)],
    running_cost=force**2,
)
solution = mbd.optimize(swing_up, intervals=50)
print(solution)
print(solution.verify())

figure = mbd.plot(
    solution.trajectory,
    {
        "force, N": force,
        "cart, m": cart.x,
        "pole, rad": bob.phi,
        "load of the pole's pin, N": mbd.norm(pole.reaction_on(bob).force),
    },
)
figure.savefig("cart_pole.png", dpi=120)
