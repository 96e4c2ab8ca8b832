"""Inputs that a motion needs, for mechanisms with an input for each coordinate."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ....numerics.evaluation import Evaluator
from ....numerics.lazy import cached_property
from ...poses.least_squares_loads import LeastSquaresLoads


class InverseDynamics:
    """Inputs that a motion needs in independent coordinates without rows, an input for each."""

    def __init__(self, loads: LeastSquaresLoads):
        self._loads, self._eom, self._p = loads, loads.eom, loads.numeric.p
        self.n = self._eom.q.numel()

    @cached_property
    def _slopes(self) -> Evaluator:
        """Derivative of the equations of motion by coordinates, velocities and accelerations."""
        eom = self._eom

        def make() -> Evaluator:
            slopes = ca.jacobian(eom.motion, ca.vertcat(eom.q, eom.v, eom.a))
            return Evaluator(ca.Function("slopes", [*eom.symbols], [ca.densify(slopes)]))

        return eom.whole.shared.get_or_create(("slopes of inverse dynamics", eom.curved, eom.angles), make)

    def inputs(self, t: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (k, n) of a motion with coordinates, velocities and accelerations `places` (k, 3, n).

        With the derivatives of the equations of motion by them (k, n, n); raises ``LinAlgError`` if one moves nothing.
        """
        by_inputs, load = self._loads.system(t, places[:, 0], places[:, 1], places[:, 2], np.zeros((t.size, 0)))
        return np.linalg.solve(by_inputs, load)[:, :, 0], by_inputs

    def slopes(self, t: np.ndarray, places: np.ndarray, u: np.ndarray, by_inputs: np.ndarray) -> np.ndarray:
        """Derivatives of the inputs by coordinates, velocities and accelerations (k, n, 3 n)."""
        nothing = np.zeros(0)
        arguments = t[:, None], places[:, 0], places[:, 1], places[:, 2], nothing, nothing, u, self._p
        (slopes,) = self._slopes.rows(*arguments)
        return -np.linalg.solve(by_inputs, np.swapaxes(slopes.reshape(t.size, 3 * self.n, self.n), 1, 2))
