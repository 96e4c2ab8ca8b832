"""The block and the cart-pole of ``exact_switching.py`` in nosnoc, by explicit equations: cost, time, complementarity.

``python exact_switching_peer.py NAME`` in an environment with nosnoc; :mod:`exact_switching` runs it.
"""

from __future__ import annotations

import sys
import time

import casadi as ca
import nosnoc
import numpy as np


def block() -> tuple[nosnoc.NosnocModel, nosnoc.NosnocOcp, float]:
    """1 kg, friction of 0.3, 0.5 m in two seconds with the least effort."""
    x, u = ca.SX.sym("x", 2), ca.SX.sym("u")
    friction = 0.3 * 9.81
    fields = [ca.vertcat(x[1], u - sign * friction) for sign in (1, -1)]
    model = nosnoc.NosnocModel(x=x, F=[ca.horzcat(*fields)], S=[np.array([[1], [-1]])], c=[x[1]], x0=np.zeros(2), u=u)
    ocp = nosnoc.NosnocOcp(lbu=np.array([-20.0]), ubu=np.array([20.0]), f_q=u**2, g_terminal=x - np.array([0.5, 0.0]))
    return model, ocp, 2.0


def cart_pole() -> tuple[nosnoc.NosnocModel, nosnoc.NosnocOcp, float]:
    """1 kg and 0.1 kg, 1 m, friction of 2 N, swing-up in five seconds with the least effort."""
    x, u = ca.SX.sym("x", 4), ca.SX.sym("u")  # place, angle from hanging, and their rates
    low = 0.1 * ca.cos(x[1])
    mass = ca.vertcat(ca.horzcat(1.1, low), ca.horzcat(low, 0.1))
    force = ca.vertcat(u + 0.1 * x[3] ** 2 * ca.sin(x[1]), -0.1 * 9.81 * ca.sin(x[1]))
    rates = [ca.vertcat(x[2:], ca.inv(mass) @ (force - ca.vertcat(sign * 2.0, 0))) for sign in (1, -1)]
    model = nosnoc.NosnocModel(
        x=x, F=[ca.horzcat(*rates)], S=[np.array([[1], [-1]])], c=[x[2]], x0=np.array([1.0, 0, 0, 0]), u=u
    )
    wide = np.array([5.0, np.inf, np.inf, np.inf])
    ocp = nosnoc.NosnocOcp(
        lbu=np.array([-30.0]), ubu=np.array([30.0]), lbx=-wide, ubx=wide, f_q=u**2,
        g_terminal=x - np.array([0.0, np.pi, 0.0, 0.0]),
    )  # fmt: skip
    return model, ocp, 5.0


def main(name: str) -> None:
    """Solve a case on twenty and on forty stages of two elements each."""
    for stages in (20, 40):
        model, ocp, duration = {"least effort, 0.5 m": block, "cart-pole": cart_pole}[name]()
        options = nosnoc.NosnocOpts()
        options.n_s, options.N_stages, options.N_finite_elements, options.terminal_time = 2, stages, 2, duration
        begin = time.process_time()
        solver = nosnoc.NosnocSolver(options, model, ocp)
        found = solver.solve()
        print(f"  nosnoc, {stages} stages: {found['cost_val']:.6f} in {time.process_time() - begin:.1f} s", flush=True)


if __name__ == "__main__":
    main(sys.argv[1])
