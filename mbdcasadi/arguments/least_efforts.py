"""The least of more inputs than are needed, within their limits."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..errors import MechanismError
from ..model.symbols import Input, positive
from ..numerics.least_squares import least_norm, least_norm_within, null_space
from .values import pairs_of, position_in


class LeastEfforts:
    """Inputs of which the weighted sum of squares is least.

    Parameters
    ----------
    inputs : sequence of Input
        Those that are looked for, with their limits.
    weights : mapping of Input to float, optional
        Positive weights of the squares; 1 for those that are not named.
    analysis, argument : str
        Names of the analysis and of the argument that names the inputs, for messages.
    goal, remedy : str
        What the inputs are to do, and what helps if they cannot, for messages.

    Raises
    ------
    ModelError
        For a weight that is not positive, and one of another input.
    """

    def __init__(self, inputs: Sequence[Input], weights: Any, analysis: str, argument: str, goal: str, remedy: str):
        self.inputs, self._goal, self._remedy = inputs, goal, remedy
        self._weights = np.ones(len(inputs))
        for key, weight in pairs_of(weights, "weights="):
            place = position_in(inputs, key, "weights=", argument)
            self._weights[place] = positive(weight, analysis, "weights")
        self._limits = [np.array([getattr(u, side) for u in inputs]) for side in ("lower", "upper")]

    def beside(self, others: np.ndarray, acting: np.ndarray, right: np.ndarray, t: float) -> np.ndarray:
        """Least inputs u with ``others x + acting u = right`` for some x, which does not count.

        Parameters
        ----------
        others, acting, right : numpy.ndarray
            Matrices (n, m) and (n, n_u), and right sides (n,).
        t : float
            For the message, s.

        Raises
        ------
        MechanismError
            If there are none within the limits: which input would be farthest beyond its own.
        """
        lower, upper = self._limits
        free = null_space(others.T)
        acting, needed = free.T @ acting, free.T @ right
        found = least_norm_within(acting, needed, self._weights, lower, upper)
        if found is not None:
            return found
        root = np.sqrt(self._weights)
        unlimited = least_norm(acting / root, needed) / root
        beyond = np.maximum(lower - unlimited, unlimited - upper)
        worst = int(np.argmax(beyond))
        side = "lower" if unlimited[worst] < lower[worst] else "upper"
        raise MechanismError(
            f"no efforts within their limits {self._goal} at t = {t:.6g} s: of those of least sum of squares "
            f"'{self.inputs[worst].label}' is {unlimited[worst]:.6g}, with {side} = "
            f"{getattr(self.inputs[worst], side):.6g}, and the others cannot take it over; {self._remedy}",
            time=t,
        )
