"""The proof of a solution: the mechanism simulated with its inputs."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ...errors import MechanismWarning
from ...results.trajectory import Trajectory
from .local_error import local_errors

if TYPE_CHECKING:
    from ..solution import Solution


@dataclass(frozen=True)
class Replay:
    """A simulation with the inputs of a solution.

    Attributes
    ----------
    trajectory : Trajectory
        The simulated motion.
    final_error : float
        Largest difference at the end: of a coordinate, m or rad, or of a first-order state, as a share of its range.
    largest_deviation : float
        The same at any mesh point.
    drift : float
        Largest ``|Phi|`` of the simulated motion.
    defects : numpy.ndarray
        By interval, started anew at each mesh point: largest difference in
        displacements (m) and in angles (rad), (N, 2). A motion that is unstable may have
        small defects and still not replay as a whole.
    """

    trajectory: Trajectory
    final_error: float
    largest_deviation: float
    drift: float
    defects: np.ndarray

    def __repr__(self) -> str:
        worst = np.max(self.defects, axis=0)
        return (
            f"Replay by {self.trajectory.statistics.method}: off by {self.final_error:.2e} at the end, "
            f"{self.largest_deviation:.2e} at most; defects of intervals up to {worst[0]:.1e} m, {worst[1]:.1e} rad"
        )


def replay(solution: Solution, reltol: float, abstol: float) -> Replay:
    """Simulate from the first state of a solution and compare at the mesh points."""
    with warnings.catch_warnings():  # how far limits are passed is told by Solution.limit_excess
        warnings.filterwarnings("ignore", ".*beyond its limits", MechanismWarning)
        motion = solution.simulate(reltol=reltol, abstol=abstol)
    wanted = solution.trajectory.q[:: solution.points_per_interval]
    states = solution.trajectory.z[:: solution.points_per_interval]
    difference = np.abs(np.hstack([motion.q - wanted, (motion.z - states) / solution.state_ranges]))
    return Replay(
        motion,
        float(np.max(difference[-1])),
        float(np.max(difference)),
        motion.drift.position,
        local_errors(solution),
    )
