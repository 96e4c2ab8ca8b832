"""Verification of a solution: the mechanism simulated with its inputs."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ...numerics.console import without_warnings
from ...results.trajectory import Trajectory
from .local_error import local_errors

if TYPE_CHECKING:
    from ..solution import Solution


@dataclass(frozen=True)
class Verification:
    """A simulation with the inputs of a solution, compared with it.

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
        By interval, started again at each mesh point: largest difference in
        displacements (m) and in angles (rad), (N, 2). A motion that is unstable may have
        small defects and still not be followed by the simulation as a whole.
    event_times : numpy.ndarray
        Times of the changes from phase to phase in the simulation, s; NaN if a joint did not close near its time.
    time_error : float
        Largest difference of one of them from the planned time, s.
    impulse_error : float
        Largest difference of an impulse, as a share of the largest one of its change.
    """

    trajectory: Trajectory
    final_error: float
    largest_deviation: float
    drift: float
    defects: np.ndarray
    event_times: np.ndarray = field(default_factory=lambda: np.zeros(0))
    time_error: float = 0.0
    impulse_error: float = 0.0

    def __repr__(self) -> str:
        worst = np.max(self.defects, axis=0)
        changes = f"; changes off by up to {self.time_error:.1e} s" if self.event_times.size else ""
        return (
            f"Verification by {self.trajectory.statistics.method}: off by {self.final_error:.2e} at the end, "
            f"{self.largest_deviation:.2e} at most; defects of intervals up to {worst[0]:.1e} m, {worst[1]:.1e} rad"
            f"{changes}"
        )


def verification(solution: Solution, reltol: float, abstol: float) -> Verification:
    """Simulate from the first state of a solution and compare at the mesh points."""
    with without_warnings(".*beyond its limits"):  # Solution.limit_excess says how far limits are passed
        motion = solution.simulate(reltol=reltol, abstol=abstol)
    part = solution.phases[0]
    planned = part.trajectory.q[:: part.points_per_interval], part.trajectory.z[:: part.points_per_interval]
    difference = np.abs(np.hstack([motion.q - planned[0], (motion.z - planned[1]) / part.state_ranges]))
    return Verification(
        motion, float(np.max(difference[-1])), float(np.max(difference)), motion.drift.position, local_errors(part)
    )
