"""A driven motion over time, and what all that follow one have in common."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import Interrupted, SingularityError
from .singular import describe_singularity


@dataclass
class DrivenMotion:
    """Positions, velocities and accelerations over time, each (k, n)."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    seconds: float = 0.0

    @classmethod
    def none(cls, n: int) -> DrivenMotion:
        """A motion of n coordinates at no time at all."""
        rows = np.zeros((0, n))
        return cls(np.zeros(0), rows, rows, rows)


class MotionFollower:
    """Follows the pose of a driven mechanism; its errors carry the motion so far."""

    def __init__(self, numeric: NumericEquations):
        self.numeric = numeric

    def _singular(self, t: float, q: np.ndarray, motion: DrivenMotion) -> SingularityError:
        pose = describe_singularity(self.numeric, t, q)
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
