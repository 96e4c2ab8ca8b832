"""Energy of a motion, and how far it leaves its constraints."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .trajectory import Trajectory


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


def violations(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    """Return the largest ``|Phi|`` and the largest ``|Phi_q v - nu|`` over time, each (n_t,).

    Rows that hold in some modes only (stick and slip) do not count at velocity level; of a motion through several
    mechanisms the rows of each one count as long as it holds.
    """
    position, velocity = zip(*map(_violations, motion.phases), strict=True)
    return np.concatenate(position), np.concatenate(velocity)


def _violations(motion: Trajectory) -> tuple[np.ndarray, np.ndarray]:
    eom = motion.equations
    position = motion[eom.Phi].reshape(len(motion), -1)
    always = [k for k, element in enumerate(eom.row_elements) if not getattr(element, "modes", ())]
    velocity = motion[(eom.Phi_q @ eom.v - eom.nu)[always]].reshape(len(motion), -1)
    return np.max(np.abs(position), axis=1, initial=0.0), np.max(np.abs(velocity), axis=1, initial=0.0)
