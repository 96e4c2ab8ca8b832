"""What a picture is taken of: the values of expressions at one instant or over a motion."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..errors import MechanismError
from ..model.mechanism import Mechanism
from ..results.state import State
from ..results.trajectory import Trajectory


class Sample:
    """Values of expressions over some times.

    Parameters
    ----------
    source : State or Trajectory
        Where they come from.
    times : numpy.ndarray, optional
        Times of a motion, s; its own where none are given.

    Attributes
    ----------
    mechanism : Mechanism
        The model.
    t : numpy.ndarray
        Times (n_t,), s.
    """

    def __init__(self, source: State | Trajectory, times: np.ndarray | None = None):
        self.mechanism: Mechanism = source.mechanism
        self._source: Any = source
        self._between: np.ndarray | None = None
        if isinstance(source, State):
            self.t = np.array([source.t])
            return
        if not len(source):
            raise MechanismError("the trajectory holds no times, and so there is nothing to draw")
        self.t = source.t if times is None else np.asarray(times, float)
        if times is not None and source.interpolates:
            self._source = source.at(self.t)
        elif times is not None:
            # read from arrays, and without a way back to the constraints: values are taken on straight lines
            self._between = self.t

    @property
    def parameters(self) -> np.ndarray:
        """Values of the parameters of the mechanism."""
        return self._source.parameters

    def __getitem__(self, expression: Any) -> np.ndarray:
        """Values (n_t, k) of a column of k expressions."""
        column = ca.densify(ca.vec(ca.SX(expression)))
        if not column.numel():
            return np.zeros((self.t.size, 0))
        if isinstance(self._source, State):
            return np.asarray(self._source[column], float).reshape(1, -1)
        values = np.asarray(self._source[column], float).reshape(len(self._source), -1)
        if self._between is None:
            return values
        return np.column_stack([np.interp(self._between, self._source.t, row) for row in values.T])

    def number(self, expression: Any) -> float:
        """Value of a scalar at the first time."""
        if not isinstance(expression, ca.SX):
            return float(expression)
        if expression.is_constant():
            return float(expression)
        return float(self[expression][0, 0])

    @property
    def has_multipliers(self) -> bool:
        """Whether reactions are known."""
        eom = self._source.equations
        if isinstance(self._source, State) and self._source._obstacle is not None:
            return False
        return bool(eom.lam.numel()) and bool(np.all(np.isfinite(self._source.lam)))
