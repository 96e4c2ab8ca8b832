"""Multipliers and inputs of a given motion that come nearest to the equations of motion."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.derivation import LARGE
from ...equations.numeric import NumericEquations
from ...equations.recovery import Recovery
from ...equations.reduced import ReducedEquations
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from ..transcription.scaling import Scales

#: Share of its terms from which a sum is not rounding.
ROUNDING = 1e-12


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
    def _system(self) -> Evaluator:
        eom = self.eom

        def make() -> Evaluator:
            free = ca.vertcat(eom.lam, eom.u)
            rest = -ca.substitute(eom.motion, free, ca.SX.zeros(free.numel()))
            loads = ca.horzcat(eom.Phi_q.T, ca.jacobian(eom.motion, eom.u))
            return Evaluator(ca.Function("loads", [*eom.symbols], [ca.densify(loads), ca.densify(rest)]))

        return eom.whole.shared.get_or_create(("loads", eom.curved, eom.angles), make)

    @cached_property
    def _acceleration(self) -> Evaluator:
        eom = self.numeric.eom

        def make() -> Evaluator:
            terms = [ca.densify(eom.Phi_q), ca.densify(eom.gamma)]
            return Evaluator(ca.Function("acceleration", [*eom.symbols], terms))

        return eom.shared.get_or_create("terms of accelerations", make)

    def _evaluate(
        self, evaluator: Evaluator, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray
    ) -> list[np.ndarray]:
        """Matrices at times (k, rows, columns)."""
        function = evaluator.function
        lam = np.zeros(function.numel_in(5))
        values = evaluator.rows(t[:, None], q, v, a, z, lam, self.numeric.eom.input_values, self.numeric.p)
        shapes = [function.size_out(k) for k in range(function.n_out())]
        return [
            np.swapaxes(x.reshape(t.size, columns, rows), 1, 2)
            for x, (rows, columns) in zip(values, shapes, strict=True)
        ]

    def states(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray):
        """Coordinates, velocities and accelerations (k, n) brought onto the constraints."""
        eom = self.numeric.eom
        if not self.eom.rows:
            return q, v, a
        recovery = Recovery(self.numeric, redundant=True)
        q = recovery.positions(t, q, z)
        v = recovery.velocities(t, q, v, z)
        if not eom.is_large:
            jacobian, gamma = self._evaluate(self._acceleration, t, q, v, a, z)
            rows, columns = self.scales.rows, self.scales.q
            residual = (jacobian @ a[:, :, None] - gamma) / rows[:, None]
            scaled = jacobian * columns / rows[:, None]
            a = a - columns * (np.linalg.pinv(scaled, rcond=1e-9) @ residual)[:, :, 0]
        return q, v, a

    def system(
        self, t: np.ndarray, w: np.ndarray, rate: np.ndarray, acceleration: np.ndarray, z: np.ndarray
    ) -> list[np.ndarray]:
        """Equations of motion in independent coordinates, with their rates (k, n): a matrix and its right side.

        The matrix (k, n, m + n_u) multiplies the multipliers that are left and the inputs; the right side is (k, n, 1).
        """
        return self._evaluate(self._system, t, w, rate, acceleration, z)

    def missing(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Loads that a motion needs of inputs and of the multipliers that are left (k, n), by their typical sizes."""
        return self._missing(t, q, v, a, z) / self._reduced_scales.load

    def _missing(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray) -> np.ndarray:
        places = self.eom.independent
        return self.system(t, q[:, places], v[:, places], a[:, places], z)[1][:, :, 0]

    def work(self, t: np.ndarray, q: np.ndarray, z: np.ndarray) -> float:
        """Work that inputs have to do on a chain which passes poses (k, n) slowly, J; `z` (n_z,) stays.

        Zero if the terms of the sum cancel but for rounding.
        """
        still = np.zeros_like(q)
        loads = self._missing(t, q, still, still, np.tile(z, (t.size, 1)))
        terms = -(loads[:-1] + loads[1:]) / 2 * np.diff(q[:, self.eom.independent], axis=0)
        total = float(np.sum(terms))
        return total if abs(total) > ROUNDING * np.sum(np.abs(terms)) else 0.0

    def loads(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, a: np.ndarray, z: np.ndarray, given: np.ndarray | None = None
    ):
        """Multipliers (k, m) and inputs (k, n_u) of least squares; zero for mechanisms of hundreds of bodies.

        Multipliers of rows that are solved stay zero. Inputs may be `given` (k, n_u), NaN for those that are not.
        """
        whole, eom, sizes = self.numeric.eom, self.eom, self._reduced_scales
        rows, n_u = len(eom.rows), eom.u.numel()
        lam = np.zeros((t.size, whole.lam.numel()))
        if not rows + n_u or whole.q.numel() * (whole.lam.numel() + n_u) > LARGE:
            inputs = np.tile(whole.input_values, (t.size, 1))
            return lam, inputs if given is None else np.where(np.isnan(given), inputs, given)
        matrix, load = self.system(t, q[:, eom.independent], v[:, eom.independent], a[:, eom.independent], z)
        if given is not None:
            held = ~np.isnan(given).any(axis=0)
            places = rows + np.flatnonzero(held)
            load = load - matrix[:, :, places] @ given[:, held, None]
            matrix[:, :, places] = 0.0
        finite = np.isfinite(matrix).all(axis=(1, 2)) & np.isfinite(load).all(axis=(1, 2))
        loads = np.zeros((t.size, rows + n_u))
        columns = np.r_[sizes.lam, sizes.u]
        scaled = matrix[finite] * columns / sizes.load[:, None]
        loads[finite] = columns * (np.linalg.pinv(scaled, rcond=1e-9) @ (load[finite] / sizes.load[:, None]))[:, :, 0]
        lam[:, eom.rows] = loads[:, :rows]
        return lam, loads[:, rows:] if given is None else np.where(np.isnan(given), loads[:, rows:], given)
