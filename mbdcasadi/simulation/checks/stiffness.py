"""Speed of the fastest motion, to choose an integrator."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...results.state import State

#: Explicit steps that stability may ask for in one output chunk before the motion counts as stiff.
EXPLICIT_STEPS = 2000
#: Steps of an explicit method per time constant of the fastest motion, by stability.
STABILITY = 3.0


def is_stiff(numeric: NumericEquations, start: State, grid: np.ndarray, redundant: bool) -> bool:
    """True if an explicit integrator would be held back by stability.

    Estimates the spectral radius of the linearised equations of motion at the
    start by power iteration on directional derivatives.
    """
    key = ("stiffness", numeric.light_key, redundant)
    product = numeric.eom.mechanism.cache.get_or_create(key, lambda: _product(numeric, redundant))
    vector = np.random.default_rng(0).standard_normal(product.numel_in(6))
    growth = []
    for _ in range(40):
        vector /= np.linalg.norm(vector)
        vector = product(start.t, start.q, start.v, start.z, start.inputs, numeric.p, vector).full().ravel()
        size = float(np.linalg.norm(vector))
        if size == 0 or not np.isfinite(size):
            return False
        growth.append(np.log(size))
    radius = float(np.exp(np.mean(growth[-20:])))
    return radius * (grid[-1] - grid[0]) / 20 / STABILITY > EXPLICIT_STEPS


def _product(numeric: NumericEquations, redundant: bool) -> ca.Function:
    """``(t, q, v, z, u, p, d) -> A d`` with the Jacobian A of ``(v, a)`` by ``(q, v)``."""
    eom = numeric.eom
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
    a, _ = numeric.forward_dynamics(redundant=redundant)(*arguments)
    rate, x = ca.vertcat(eom.v, a), ca.vertcat(eom.q, eom.v)
    direction = ca.SX.sym("d", x.numel())
    return ca.Function("product", [*arguments, direction], [ca.densify(ca.jtimes(rate, x, direction))])
