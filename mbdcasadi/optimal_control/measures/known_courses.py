"""Inputs that were given, between the stages: distances of their polynomials from their courses."""

from __future__ import annotations

import numpy as np

from ..motion.limit_excess import points_of
from ..motion.phase_solution import PhaseSolution
from .measure import Measure


class KnownCourses(Measure):
    """Distances in each interval as shares of the largest values of the inputs."""

    falsifies_cost = True

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Largest share of each interval of a phase (N,)."""
        known = list(part.program.scheme.known)
        if not known:
            return np.zeros(part.mesh.count)
        k, tau = points_of(part)
        # inside the intervals: what jumps at a mesh point belongs to either side
        tau = np.clip(tau, np.min(tau[tau > 0]), np.max(tau[tau < 1]))
        given = self.solution.settings.known.values(part.program.number, part.times_at(k, tau))
        distances = np.abs(part.polynomials.at(k, tau)[6][:, known] - given)
        sizes = np.max(np.abs(given), axis=0)
        shares = np.max(distances / np.where(sizes > 0, sizes, 1.0), axis=1)
        largest: np.ndarray = np.max(shares.reshape(part.mesh.count, -1), axis=1)
        return largest

    def order(self, part: PhaseSolution) -> int:
        """Number of values that an input has in an interval."""
        return int(part.program.scheme.known_basis.taus.size)

    @property
    def loss(self) -> float:
        """Largest share."""
        return self.largest if self.largest > self.tolerance else 0.0

    def sentences(self) -> list[str]:
        """The largest one, with its time and a remedy."""
        if self.largest <= self.tolerance:
            return []
        part, k = self.worst
        return [
            f"inputs that were given, which the motion sees with an error of {self.largest:.2g} of their sizes at "
            f"t = {part.mesh_times[k]:.6g} s (intervals= that end at the samples see them exactly)"
        ]
