"""Inputs that a motion needs, for mechanisms with an input for each coordinate."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np

from ....equations.numeric import NumericEquations
from ....equations.reduced import ReducedEquations
from ....numerics.evaluation import Evaluator
from ....numerics.lazy import cached_property


class InverseDynamics:
    """Inputs that a motion needs in independent coordinates without rows, an input for each."""

    def __init__(self, eom: ReducedEquations, numeric: NumericEquations):
        self._eom, self._p, self.n = eom, numeric.p, eom.q.numel()

    @cached_property
    def _loads(self) -> Evaluator:
        """Derivative of the equations of motion by the inputs, and what is left without inputs."""
        return self._made("loads", lambda eom, rest: [ca.jacobian(eom.motion, eom.u), rest])

    @cached_property
    def _slopes(self) -> Evaluator:
        """Derivative of the equations of motion by coordinates, velocities and accelerations."""
        return self._made("slopes", lambda eom, _: [ca.jacobian(eom.motion, ca.vertcat(eom.q, eom.v, eom.a))])

    def _made(self, name: str, terms: Callable[[ReducedEquations, ca.SX], list[ca.SX]]) -> Evaluator:
        eom = self._eom

        def make() -> Evaluator:
            rest = ca.substitute(eom.motion, eom.u, ca.SX.zeros(eom.u.numel()))
            results = [ca.densify(x) for x in terms(eom, rest)]
            return Evaluator(ca.Function(name, [*eom.symbols], results))

        return eom.whole.shared.get_or_create(("inverse dynamics", name, eom.curved, eom.angles), make)

    def _at(self, evaluator: Evaluator, t: np.ndarray, places: np.ndarray, u: np.ndarray) -> list[np.ndarray]:
        """Matrices at points (k, n, columns)."""
        nothing = np.zeros(0)
        values = evaluator.rows(t[:, None], places[:, 0], places[:, 1], places[:, 2], nothing, nothing, u, self._p)
        return [np.swapaxes(x.reshape(t.size, -1, self.n), 1, 2) for x in values]

    def inputs(self, t: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Inputs (k, n) of a motion with coordinates, velocities and accelerations `places` (k, 3, n).

        With the derivatives of the equations of motion by them (k, n, n); raises ``LinAlgError`` if one moves nothing.
        """
        by_inputs, rest = self._at(self._loads, t, places, np.zeros(self.n))
        return -np.linalg.solve(by_inputs, rest)[:, :, 0], by_inputs

    def least_inputs(self, t: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The same inputs (k, n), the smallest ones that come nearest to the motion where one moves nothing."""
        by_inputs, rest = self._at(self._loads, t, places, np.zeros(self.n))
        inputs: np.ndarray = -(np.linalg.pinv(by_inputs) @ rest)[:, :, 0]
        return inputs

    def slopes(self, t: np.ndarray, places: np.ndarray, u: np.ndarray, by_inputs: np.ndarray) -> np.ndarray:
        """Derivatives of the inputs by coordinates, velocities and accelerations (k, n, 3 n)."""
        (slopes,) = self._at(self._slopes, t, places, u)
        return -np.linalg.solve(by_inputs, slopes)
