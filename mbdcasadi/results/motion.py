"""Quantities of a whole motion, and the interface by which tables, files and summaries read one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from ..equations import Equations
from ..model.mechanism import Mechanism
from ..model.symbols import Expression
from .state import Arguments, EventOccurrence, State


@dataclass(frozen=True)
class Energy:
    """Energy over time, each (n,), J.

    Attributes
    ----------
    kinetic : numpy.ndarray
        ``½ v^T M v``.
    potential : numpy.ndarray
        Of gravity and linear springs; forces with other laws have none.
    """

    kinetic: np.ndarray
    potential: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Kinetic and potential energy, J."""
        return self.kinetic + self.potential


@dataclass(frozen=True)
class Drift:
    """Largest violation of the constraints.

    Attributes
    ----------
    position : float
        Largest ``|Phi|`` (m or rad).
    velocity : float
        Largest ``|Phi_q v - nu|`` (m/s or rad/s).
    """

    position: float
    velocity: float


@dataclass
class Statistics:
    """Statistics of the run that computed a trajectory.

    Attributes
    ----------
    method : str
        Integrator or solver.
    formulation : str
        Form of the equations that it integrated.
    seconds : float
        Wall-clock time of the run, s.
    restarts : int
        Number of starts of the integrator.
    steps : int
        Number of its steps; 0 of a method without steps.
    notes : list of str
        Remarks for the user.
    control_times, control_statuses : list of float, list of int
        Samples of a :class:`Controller`, s, and what its steps returned; empty without one.
    """

    method: str = ""
    formulation: str = ""
    seconds: float = 0.0
    restarts: int = 0
    steps: int = 0
    notes: list[str] = field(default_factory=list)
    control_times: list[float] = field(default_factory=list)
    control_statuses: list[int] = field(default_factory=list)


class Motion(Protocol):
    """Part of a :class:`~mbdcasadi.Trajectory` from which tables, files and summaries are made."""

    mechanism: Mechanism
    t: np.ndarray
    lam: np.ndarray
    parameters: np.ndarray
    events: tuple[EventOccurrence, ...]
    statistics: Statistics
    missing_multipliers: str

    @property
    def equations(self) -> Equations: ...

    @property
    def arguments(self) -> Arguments: ...

    @property
    def interpolates(self) -> bool: ...

    @property
    def knots(self) -> np.ndarray: ...

    @property
    def fine(self) -> Motion: ...

    def at(self, times: np.ndarray | float) -> Motion: ...

    def state(self, index: int) -> State: ...

    @property
    def phases(self) -> Sequence[Motion]: ...

    @property
    def parameters_by_phase(self) -> list[np.ndarray]: ...

    @property
    def energy(self) -> Energy: ...

    @property
    def drift(self) -> Drift: ...

    def __len__(self) -> int: ...

    def __getitem__(self, expression: Expression) -> np.ndarray: ...
