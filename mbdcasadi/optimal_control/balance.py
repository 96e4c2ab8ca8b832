"""Multipliers and inputs of a motion that is given: what comes nearest to the equations of motion."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..equations.numeric import LARGE, NumericEquations
from ..equations.recovery import Recovery
from .scaling import Scales


class Balance:
    """Makes guesses consistent: states on the constraints, accelerations, multipliers and inputs to match.

    Drivers and inputs are duals: for a motion that a driver enforced elsewhere,
    the input that works along the same displacement comes out as the driver's effort.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    scales : Scales
        Typical sizes, by which least squares weigh.
    """

    def __init__(self, numeric: NumericEquations, scales: Scales):
        self.numeric, self.scales = numeric, scales
        eom = numeric.eom
        loads = ca.horzcat(eom.Phi_q.T, -ca.jacobian(eom.Q, eom.u))
        unloaded = ca.vertcat(eom.u, eom.lam)
        rest = ca.substitute(eom.Q - eom.mass_diagonal * eom.a, unloaded, ca.SX.zeros(unloaded.numel()))
        self._system = ca.Function("loads", [*eom.symbols], [ca.densify(loads), ca.densify(rest)])
        self._acceleration = ca.Function("acceleration", [*eom.symbols], [ca.densify(eom.Phi_q), ca.densify(eom.gamma)])

    def _evaluate(
        self, function: ca.Function, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray
    ):
        eom = self.numeric.eom
        count, m = t.size, eom.lam.numel()
        u = np.tile(eom.input_values[:, None], (1, count))
        p = np.tile(self.numeric.p[:, None], (1, count))
        found = function.map(count)(t[None, :], q.T, v.T, a.T, z.T, np.zeros((m, count)), u, p)
        return [np.moveaxis(x.full().reshape(x.size1(), count, -1), 1, 0) for x in found]

    def states(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray):
        """Coordinates, velocities and accelerations (k, n) brought onto the constraints."""
        eom = self.numeric.eom
        if not eom.lam.numel():
            return q, v, a
        recovery = Recovery(self.numeric, redundant=True)
        q = recovery.positions(t, q)
        v = recovery.velocities(t, q, v)
        if eom.q.numel() * eom.lam.numel() <= LARGE:
            jacobian, gamma = self._evaluate(self._acceleration, t, q, v, a, z)
            rows, columns = self.scales.rows, self.scales.q
            residual = (jacobian @ a[:, :, None] - gamma) / rows[:, None]
            scaled = jacobian * columns / rows[:, None]
            a = a - columns * (np.linalg.pinv(scaled, rcond=1e-9) @ residual)[:, :, 0]
        return q, v, a

    def loads(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray):
        """Multipliers (k, m) and inputs (k, n_u) of least squares; zero for mechanisms of hundreds of bodies."""
        eom = self.numeric.eom
        m, n_u = eom.lam.numel(), eom.u.numel()
        if not m + n_u or eom.q.numel() * (m + n_u) > LARGE:
            return np.zeros((t.size, m)), np.tile(eom.input_values, (t.size, 1))
        matrix, load = self._evaluate(self._system, t, q, v, a, z)
        finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(load).all(axis=(1, 2))
        found = np.zeros((t.size, m + n_u))
        rows, columns = self.scales.load, np.r_[self.scales.lam, self.scales.u]
        scaled = matrix[finite] * columns / rows[:, None]
        found[finite] = columns * (np.linalg.pinv(scaled, rcond=1e-9) @ (load[finite] / rows[:, None]))[:, :, 0]
        return found[:, :m], found[:, m:]
