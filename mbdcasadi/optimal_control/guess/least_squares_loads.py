"""Multipliers and inputs of a given motion that come nearest to the equations of motion."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.numeric import LARGE, NumericEquations
from ...equations.recovery import Recovery
from ...equations.reduced import ReducedEquations
from ...numerics.lazy import cached_property
from ..nlp.scaling import Scales


class LeastSquaresLoads:
    """Completion of a guess: states on the constraints, accelerations, multipliers and inputs to match.

    Drivers and inputs are duals: for a motion that a driver enforced elsewhere, the input that works along the same
    displacement comes out as the driver's effort. Dependent coordinates are ignored if no rows are left; least squares
    weigh by the typical sizes.
    """

    def __init__(self, numeric: NumericEquations, eom: ReducedEquations, scales: Scales):
        self.numeric, self.eom, self.scales = numeric, eom, scales
        self._reduced_scales = scales.of(eom.independent, eom.rows)

    @cached_property
    def _system(self) -> ca.Function:
        eom = self.eom
        free = ca.vertcat(eom.lam, eom.u)
        rest = -ca.substitute(eom.motion, free, ca.SX.zeros(free.numel()))
        loads = ca.horzcat(eom.Phi_q.T, ca.jacobian(eom.motion, eom.u))
        return ca.Function("loads", [*eom.symbols], [ca.densify(loads), ca.densify(rest)])

    @cached_property
    def _acceleration(self) -> ca.Function:
        eom = self.numeric.eom
        return ca.Function("acceleration", [*eom.symbols], [ca.densify(eom.Phi_q), ca.densify(eom.gamma)])

    def _evaluate(
        self, function: ca.Function, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray
    ):
        count, m = t.size, function.numel_in(5)
        u = np.tile(self.numeric.eom.input_values[:, None], (1, count))
        p = np.tile(self.numeric.p[:, None], (1, count))
        values = function(t[None, :], q.T, v.T, a.T, z.T, np.zeros((m, count)), u, p)
        return [np.moveaxis(x.full().reshape(x.size1(), count, -1), 1, 0) for x in values]

    def states(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray):
        """Coordinates, velocities and accelerations (k, n) brought onto the constraints."""
        eom = self.numeric.eom
        if not self.eom.rows:
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
        """Multipliers (k, m) and inputs (k, n_u) of least squares; zero for mechanisms of hundreds of bodies.

        Multipliers of rows that are solved stay zero.
        """
        whole, eom, sizes = self.numeric.eom, self.eom, self._reduced_scales
        rows, n_u = len(eom.rows), eom.u.numel()
        lam = np.zeros((t.size, whole.lam.numel()))
        if not rows + n_u or whole.q.numel() * (whole.lam.numel() + n_u) > LARGE:
            return lam, np.tile(whole.input_values, (t.size, 1))
        matrix, load = self._evaluate(
            self._system, t, q[:, eom.independent], v[:, eom.independent], a[:, eom.independent], z
        )
        finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(load).all(axis=(1, 2))
        loads = np.zeros((t.size, rows + n_u))
        columns = np.r_[sizes.lam, sizes.u]
        scaled = matrix[finite] * columns / sizes.load[:, None]
        loads[finite] = columns * (np.linalg.pinv(scaled, rcond=1e-9) @ (load[finite] / sizes.load[:, None]))[:, :, 0]
        lam[:, eom.rows] = loads[:, :rows]
        return lam, loads[:, rows:]
