"""A driven motion over time, and what all that follow one have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import Interrupted, SingularityError
from .singular import describe_singularity


@dataclass
class DrivenMotion:
    """Positions, velocities and accelerations over time, each (k, n), and states that drivers follow (k, n_z).

    The other first-order states, which follow from forces, are NaN.
    """

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    z: np.ndarray
    seconds: float = 0.0

    @classmethod
    def none(cls, numeric: NumericEquations) -> DrivenMotion:
        """A motion at no time at all."""
        rows, states = (np.zeros((0, x.numel())) for x in (numeric.eom.q, numeric.eom.z))
        return cls(np.zeros(0), rows, rows, rows, states)


class MotionFollower:
    """Follows the pose of a driven mechanism; its errors carry the motion so far."""

    def __init__(self, numeric: NumericEquations):
        self.numeric = numeric

    def _without_states(self, count: int) -> np.ndarray:
        """States by row, none of which is known."""
        return np.full((count, self.numeric.eom.z.numel()), np.nan)

    def _singular(self, t: float, q: np.ndarray, motion: DrivenMotion, z: np.ndarray | None = None) -> SingularityError:
        pose = describe_singularity(self.numeric, t, q, self.numeric.eom.estimate[2] if z is None else z)
        return SingularityError(
            f"the motion cannot be continued beyond t = {t:.9g} s: the pose is singular, {pose.text}; "
            "what was computed is in .partial",
            time=t,
            partial=motion,
        )

    def _interrupted(self, motion: DrivenMotion) -> Interrupted:
        reached = float(motion.t[-1])
        return Interrupted(
            f"stopped by the user at t = {reached:.6g} s; what was computed is in .partial",
            time=reached,
            partial=motion,
        )
