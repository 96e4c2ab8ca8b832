"""What a trajectory says of itself: energy, drift, events, statistics."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from .state import State


@dataclass(frozen=True)
class Energy:
    """Energy over time, each (n,), J.

    Attributes
    ----------
    kinetic : numpy.ndarray
        ``½ v^T M v``.
    potential : numpy.ndarray
        Of gravity and linear springs; forces with laws of their own have none.
    """

    kinetic: np.ndarray
    potential: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """Kinetic and potential energy, J."""
        return self.kinetic + self.potential


@dataclass(frozen=True)
class Drift:
    """How far a motion leaves its constraints.

    Attributes
    ----------
    position : float
        Largest ``|Phi|`` (m or rad).
    velocity : float
        Largest ``|Phi_q v - nu|`` (m/s or rad/s).
    """

    position: float
    velocity: float


@dataclass(frozen=True)
class EventOccurrence:
    """An event that took place.

    Attributes
    ----------
    name : str
        Name of the event.
    t : float
        Time, s.
    state : State
        State at that time; where the event resets velocities, just before.
    after : State or None
        State just after a reset.
    """

    name: str
    t: float
    state: State
    after: State | None = None


@dataclass
class Statistics:
    """How a trajectory was computed.

    Attributes
    ----------
    method : str
        Integrator or solver.
    formulation : str
        Form of the equations it was given.
    seconds : float
        Wall-clock time of the run, s.
    restarts : int
        How often the integrator was started.
    notes : list of str
        What the user should know of the result.
    """

    method: str = ""
    formulation: str = ""
    seconds: float = 0.0
    restarts: int = 0
    notes: list[str] = field(default_factory=list)
