"""Running costs that are sums of squares."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ....equations.reduced import ReducedEquations

#: Curvature and slope, as shares of the largest ones, that are rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class Effort:
    """A running cost ``|C (s - s_0)|² + c``, with ``s`` the independent coordinates, velocities and inputs."""

    #: C (r, 3 n)
    matrix: np.ndarray
    #: s_0 (3 n,)
    centre: np.ndarray
    #: c
    least: float

    def residuals(self, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        """``C (s - s_0)`` at points (k, r)."""
        rows: np.ndarray = (np.hstack([q, v, u]) - self.centre) @ self.matrix.T
        return rows

    def slopes(self, of_inputs: np.ndarray) -> np.ndarray:
        """Derivatives of the residuals by coordinates, velocities and accelerations (k, r, 3 n), from those of u."""
        n = self.centre.size // 3
        slopes = self.matrix[:, 2 * n :] @ of_inputs
        slopes[:, :, : 2 * n] += self.matrix[:, : 2 * n]
        return slopes


def effort_of(eom: ReducedEquations, running_cost: ca.SX, p: np.ndarray) -> Effort | None:
    """A running cost as a sum of squares; None if it is none in which every input counts."""
    (cost,) = eom.of(running_cost)
    state, n = ca.vertcat(eom.q, eom.v, eom.u), eom.q.numel()
    curvature, slope = ca.hessian(cost, state)
    known = ca.vertcat(state, eom.p)
    if any(not ca.depends_on(known, symbol) for symbol in ca.symvar(cost)) or ca.depends_on(curvature, state):
        return None
    at = ca.Function("effort", [state, eom.p], [ca.densify(curvature), ca.densify(slope), cost])
    matrix, slopes, constant = (value.full() for value in at(0, p))
    values, vectors = np.linalg.eigh(matrix)
    largest = values[-1]
    kept = values > ROUNDING * largest
    centre = -vectors[:, kept] @ ((vectors[:, kept].T @ slopes.ravel()) / values[kept])
    left = np.abs(matrix @ centre + slopes.ravel())
    of_inputs = np.linalg.eigvalsh(matrix[2 * n :, 2 * n :])
    if not values[0] > -ROUNDING * largest or not of_inputs[0] > ROUNDING * largest or largest <= 0:
        return None
    if np.any(left > ROUNDING * np.max(np.abs(slopes))):
        return None
    least = float(constant.item() - centre @ matrix @ centre / 2)
    return Effort(np.sqrt(values[kept] / 2)[:, None] * vectors[:, kept].T, centre, least)
