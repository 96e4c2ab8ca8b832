"""Limits that a motion passes between the points at which they are enforced, as errors of the mesh."""

from __future__ import annotations

import numpy as np

from ..motion.limit_excess import LIMIT_TOLERANCE, excess_of_motion, passed_limits
from ..motion.phase_solution import PhaseSolution
from .measure import Measure


class PassedLimits(Measure):
    """Largest shares of their sizes by which limits are passed in each interval."""

    falsifies_cost = True

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Shares of the intervals of a phase (N,)."""
        shares = np.zeros(part.mesh.count)
        for excess in excess_of_motion(part):
            shares[excess.intervals] = np.maximum(shares[excess.intervals], excess.shares)
        return shares

    def order(self, part: PhaseSolution) -> int:
        """Two: where a limit begins to hold a motion back the slopes jump, and it is passed on the way to a stage."""
        return 2

    @property
    def loss(self) -> float:
        """Largest share by which a limit is passed."""
        return self.largest if self.largest > self.tolerance else 0.0

    def sentences(self) -> list[str]:
        """Limits with the amounts by which they are passed."""
        passed = passed_limits(self.solution, self.tolerance)
        return [f"the limit {x.label}, which is passed by {x.amount:.3g} at t = {x.time:.6g} s" for x in passed]


class FarPassedLimits(PassedLimits):
    """Shares as multiples of the largest one without a warning, in tolerances; intervals above are halved."""

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Shares of the intervals of a phase (N,)."""
        return self.tolerance * super().of(part) / LIMIT_TOLERANCE

    def pieces(self, part: PhaseSolution) -> np.ndarray:
        """Two of an interval in which a limit is passed by more (N,)."""
        return np.where(self.errors[part.program.number] > self.tolerance, 2, 1)

    @property
    def spread(self) -> float:
        """Shares times their stretches, s."""
        return self.over_stretches

    @property
    def loss(self) -> float:
        """None: how much the cost lacks is not known."""
        return 0.0
