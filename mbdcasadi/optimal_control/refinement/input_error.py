"""Errors of the inputs between the stages, estimated by the neighbours of each interval.

An input of an interval is a polynomial through d values, and off by about ``c ω(τ)``, with ω the product of the
distances to the points of these. The next value of a neighbour gives c. Of both neighbours the one counts that agrees
better: at a switch a smooth input has a smooth neighbour on one side only. On long stretches the other one counts, too:
an interval with a kink, whose neighbours it leads astray, agrees with one of them by chance.
"""

from __future__ import annotations

import numpy as np

from ...numerics.real import stretches
from ..nlp.scaling import SMALLEST_SHARE
from ..phase_solution import PhaseSolution
from .measure import Measure

#: Points of an interval at which the product of the distances is looked at, both ends included.
POINTS = 41
#: Share of the duration below which a stretch in which intervals agree with one neighbour alone may enclose a kink.
KINK_SHARE = 0.01
#: Multiple of the estimate for inputs that are continuous, whose values at the mesh points and between these are off in
#: turn: measured on closed forms, with errors of the order 2 for Hermite–Simpson.
CONTINUOUS = 4.0


def input_errors(part: PhaseSolution, *, worse: bool = False) -> np.ndarray:
    """Return the errors of the inputs in each interval as shares of their largest values (N, n_u).

    By the neighbour that agrees better, or by the one that agrees `worse`, except across waypoints and mesh points that
    move with a switch, where inputs may jump.
    Zero for inputs whose course was chosen, constant or linear. Infinite on a mesh of one interval, which has no
    neighbours, if the inputs are no constants.
    """
    basis, count = part.program.scheme.inputs, part.mesh.count
    courses = part.polynomials.inputs
    lengths = np.diff(part.mesh_times)
    if basis.name != "polynomial" or not courses:
        return np.zeros((count, len(courses)))
    coefficients = np.stack([course.coefficients for course in courses.values()], axis=2)  # (N, d, n_u)
    taus = basis.taus
    before, after = np.max(taus[taus < 1]), np.min(taus[taus > 0])
    largest = np.max(np.abs(_product(np.linspace(0, 1, POINTS), taus)))

    def differences(own: slice, other: slice, since: np.ndarray, tau: float) -> np.ndarray:
        """Errors of intervals by the values of others, at times since their own starts and at a point of the others."""
        errors_at = np.abs(_values(coefficients[own], since) - _values(coefficients[other], tau * lengths[other]))
        share: np.ndarray = largest / np.abs(_product(since / lengths[own], taus))
        return errors_at * share[:, None]

    errors = np.full((2, count, len(courses)), np.inf)
    earlier, later = slice(0, -1), slice(1, None)
    errors[0, later] = differences(later, earlier, (before - 1) * lengths[earlier], before)
    errors[1, earlier] = differences(earlier, later, lengths[earlier] + after * lengths[later], after)
    sizes = _sizes(part, coefficients, lengths[:, None] * taus)
    errors_at: np.ndarray = np.min(errors, axis=0)
    if worse:
        alike = np.zeros((2, count, 1), bool)
        alike[0, 1:, 0] = alike[1, :-1, 0] = part.mesh.piece[1:] == part.mesh.piece[:-1]
        errors_at = np.maximum(errors_at, np.max(np.where(alike, errors, 0.0), axis=0))
    return errors_at / sizes * (CONTINUOUS if basis.joined else 1.0)


class UnresolvedInputs(Measure):
    """Errors of the inputs, zero if they meet the tolerance.

    Those that are above it on a stretch so short that it may enclose a switch, see :mod:`switches`, meet it too.
    """

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Largest error of an input in each interval of a phase (N,)."""
        unresolved, lengths = np.zeros(part.mesh.count), np.diff(part.mesh_times)
        shortest = np.sqrt(self.tolerance)
        for worse, share in ((False, shortest), (True, max(shortest, KINK_SHARE))):
            errors = np.max(input_errors(part, worse=worse), axis=1, initial=0.0)
            for run in stretches(errors > self.tolerance):
                if np.sum(lengths[run]) > part.duration * share:
                    unresolved[run] = np.maximum(unresolved[run], errors[run])
        return unresolved

    def order(self, part: PhaseSolution) -> int:
        """Number of values of an input that belong to an interval."""
        return max(len(part.program.scheme.inputs.inner) + part.program.scheme.inputs.joined, 1)

    def sentences(self) -> list[str]:
        """The largest error, with its time."""
        if not self.largest:
            return []
        part, k = self.worst
        time = part.mesh_times[k]
        return [f"the inputs, which are off by about {self.largest:.2g} of their sizes at t = {time:.6g} s"]

    @property
    def spread(self) -> float:
        """Largest error of a stretch times its length."""
        areas = (
            float(np.max(errors[run]) * np.sum(np.diff(part.mesh_times)[run]))
            for part, errors in zip(self.solution.phases, self.errors, strict=True)
            for run in stretches(errors > 0)
        )
        return max(areas, default=0.0)


def _product(points: np.ndarray, taus: np.ndarray) -> np.ndarray:
    product: np.ndarray = np.prod(points[:, None] - taus, axis=1)
    return product


def _values(coefficients: np.ndarray, since: np.ndarray) -> np.ndarray:
    """Values of polynomials (N, d, n_u) at times since the starts of their intervals (N,)."""
    powers = since[:, None] ** np.arange(coefficients.shape[1])
    values: np.ndarray = np.einsum("nd,ndk->nk", powers, coefficients)
    return values


def _sizes(part: PhaseSolution, coefficients: np.ndarray, since: np.ndarray) -> np.ndarray:
    """Largest values of the inputs at their points, not far below their typical ones (n_u,)."""
    largest = [np.max(np.abs(_values(coefficients, column)), axis=0) for column in since.T]
    sizes: np.ndarray = np.maximum(np.max(largest, axis=0), SMALLEST_SHARE * part.program.scales.u)
    return sizes
