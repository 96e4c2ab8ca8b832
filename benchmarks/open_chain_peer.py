"""Plain Gauss collocation of an open chain in its angles, by hand in CasADi: the peer of ``open_chains.py``.

Angles and their rates at the stages and mesh points are unknowns, the guess is the straight line from pose to pose
without torque, and IPOPT has its default options.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

#: Intervals, stages of each, and acceleration of gravity, m/s².
INTERVALS, DEGREE, GRAVITY = 60, 3, 9.81


def rates(lengths: tuple, centres: tuple, inertias: tuple, driven: str) -> ca.Function:
    """Rates of both angles from the horizontal, and of their rates, for links of 1 kg."""
    x, tau = ca.SX.sym("x", 4), ca.SX.sym("tau")
    (first, _), (c_1, c_2) = lengths, centres
    phi, omega = x[:2], x[2:]
    coupling, turn = first * c_2, phi[0] - phi[1]
    mass = ca.blockcat([
        [inertias[0] + c_1**2 + first**2, coupling * ca.cos(turn)],
        [coupling * ca.cos(turn), inertias[1] + c_2**2],
    ])  # fmt: skip
    load = ca.vertcat(
        -coupling * ca.sin(turn) * omega[1] ** 2 - GRAVITY * (c_1 + first) * ca.cos(phi[0]),
        coupling * ca.sin(turn) * omega[0] ** 2 - GRAVITY * c_2 * ca.cos(phi[1]),
    )
    torques = ca.vertcat(tau, 0) if driven == "shoulder" else ca.vertcat(-tau, tau)
    return ca.Function("rates", [x, tau], [ca.vertcat(omega, ca.solve(mass, load + torques))])


def swing_up(lengths: tuple, centres: tuple, inertias: tuple, driven: str, duration: float) -> tuple[float, int]:
    """Cost and iterations from hanging to standing; raises RuntimeError if IPOPT does not succeed."""
    f = rates(lengths, centres, inertias, driven)
    derivative, at_end, weights = ca.collocation_coeff(ca.collocation_points(DEGREE, "legendre"))
    step = duration / INTERVALS
    nodes = ca.SX.sym("x", 4, INTERVALS + 1)
    stages = ca.SX.sym("xs", 4, DEGREE * INTERVALS)
    inputs = ca.SX.sym("u", 1, DEGREE * INTERVALS)
    begin, end = np.r_[-np.pi / 2, -np.pi / 2, 0, 0], np.r_[np.pi / 2, np.pi / 2, 0, 0]
    rows, cost = [nodes[:, 0] - begin, nodes[:, -1] - end], 0
    for k in range(INTERVALS):
        own = slice(DEGREE * k, DEGREE * (k + 1))
        points = ca.horzcat(nodes[:, k], stages[:, own])
        slopes = ca.horzcat(*[f(stages[:, j], inputs[j]) for j in range(own.start, own.stop)])
        rows += [ca.vec(points @ derivative - step * slopes), points @ at_end - nodes[:, k + 1]]
        cost += step * (inputs[:, own] ** 2) @ weights
    shares = np.linspace(0, 1, INTERVALS + 1)
    inside = (shares[:-1, None] + np.array(ca.collocation_points(DEGREE, "legendre")) / INTERVALS).ravel()
    guess = [begin[:, None] + (end - begin)[:, None] * at for at in (shares, inside)]
    program = {"x": ca.veccat(nodes, stages, inputs), "f": cost, "g": ca.vertcat(*rows)}
    quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": False, "error_on_fail": True}
    solver = ca.nlpsol("solver", "ipopt", program, quiet)
    x = np.concatenate([*(g.ravel(order="F") for g in guess), np.zeros(inputs.numel())])
    answer = solver(x0=x, lbg=0, ubg=0)
    return float(answer["f"]), int(solver.stats()["iter_count"])
