"""Values of expressions at one instant or over a motion, for pictures."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ...errors import MechanismError
from ...model.mechanism import Mechanism
from ...numerics.lazy import cached_property
from ...results.phases import PhasedTrajectory
from ...results.state import State
from ...results.trajectory import Trajectory


def between(motion: Trajectory, times: np.ndarray) -> Trajectory:
    """Return a motion at times within its span, with bodies that have left where they were last seen."""
    if not isinstance(motion, PhasedTrajectory):
        return motion.at(times)
    return motion.at(times).with_absent_bodies(motion)


class Sample:
    """Values of expressions over some times.

    Parameters
    ----------
    source : State or Trajectory
        Their source.
    times : numpy.ndarray, optional
        Times of a motion, s; by default those of its outputs.

    Attributes
    ----------
    mechanism : Mechanism
        The model.
    t : numpy.ndarray
        Times (n_t,), s.
    """

    def __init__(self, source: State | Trajectory, times: np.ndarray | None = None):
        self.mechanism: Mechanism = source.mechanism
        self._phases = source if isinstance(source, PhasedTrajectory) else None
        if isinstance(source, PhasedTrajectory) and times is None:
            source = source.with_absent_bodies()
        self._source: Any = source
        self._start: State
        if isinstance(source, State):
            self.t, self._start = np.array([source.t]), source
            return
        if not len(source):
            raise MechanismError("the trajectory holds no times, and so there is nothing to draw")
        self.t = source.t if times is None else np.asarray(times, float)
        if times is not None:
            self._source = between(source, self.t)
        # the times begin at the start of the motion
        self._start = self._source.initial

    @property
    def parameters(self) -> np.ndarray:
        """Values of the parameters of the mechanism."""
        return self._source.parameters

    def appearances(self, part: Any) -> tuple[float, ...] | None:
        """Times at which a body or an element appears and disappears in turn, s; None if it stays."""
        return None if self._phases is None else self._phases.appearances(part)

    def __getitem__(self, expression: Any) -> np.ndarray:
        """Values (n_t, k) of a column of k expressions."""
        column = ca.densify(ca.vec(ca.SX(expression)))
        if not column.numel():
            return np.zeros((self.t.size, 0))
        if column.is_constant():
            return np.tile(np.asarray(ca.DM(column)).ravel(), (self.t.size, 1))
        if isinstance(self._source, State):
            return np.asarray(self._source[column], float).reshape(1, -1)
        return np.asarray(self._source[column], float).reshape(len(self._source), -1)

    def varies(self, expression: Any) -> bool:
        """Return True if an expression changes in another way than with the times, which a fixed sample does not."""
        return False

    def sizes(self, expression: Any) -> np.ndarray:
        """Values (n, k) of loads by which their arrows are scaled."""
        return self[expression]

    def number(self, expression: Any) -> float:
        """Value of a scalar at the first time."""
        if not isinstance(expression, ca.SX):
            return float(expression)
        if expression.is_constant():
            return float(expression)
        return float(self.first(expression)[0])

    def first(self, expression: Any) -> np.ndarray:
        """Values (k,) of a column at the first time."""
        column = ca.densify(ca.vec(ca.SX(expression)))
        if column.is_constant():
            return np.asarray(ca.DM(column)).ravel()
        return np.atleast_1d(np.asarray(self._start[column], float))

    def need_reactions(self, what: str) -> None:
        """Raise an error if the reactions of joints are not known."""
        if self._source.equations.lam.numel() and not self.has_multipliers:
            reason = getattr(self._source, "obstacle", None)
            raise MechanismError(
                f"{what}: forces=True, but the reactions are not known"
                + (f" ({reason})" if reason else "; take the motion from simulate or inverse_dynamics")
            )

    @cached_property
    def has_multipliers(self) -> bool:
        """True if reactions are known."""
        eom = self._source.equations
        if isinstance(self._source, State) and self._source.obstacle is not None:
            return False
        return bool(eom.lam.numel()) and bool(np.all(np.isfinite(self._source.lam)))
