"""Energy of a motion, and how far it leaves its constraints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
