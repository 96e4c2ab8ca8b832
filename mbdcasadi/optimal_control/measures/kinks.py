"""Kinks of inputs, at which their slopes jump: where a limit of a velocity or a position begins or ceases to hold.

A mesh point that moves is led astray there, since its place hardly counts for the cost. The courses of the intervals
around a kink are smooth, and meet at it: a mesh point is put there, and once more from the next solution.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.polynomial import Polynomial

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...numerics.real import stretches
from ..motion.phase_solution import PhaseSolution

#: Share of an interval by which a kink may lie beyond the ones in which it is sought.
BEYOND = 0.25
#: Multiple of the usual difference of neighbours, seen at the far end of one, from which on it is that of a kink.
BENT = 4.0
#: Share of the usual difference by which courses beside a mesh point are off there.
NEAR = 0.1


class Kink(NamedTuple):
    """A kink of an input."""

    #: s
    time: float
    #: error of the input since the next mesh point is at a distance, as a share of its size
    error: float


class Kinks:
    """Kinks of the inputs of a phase that no mesh point resolves to a tolerance."""

    def __init__(self, part: PhaseSolution, tolerance: float):
        self.part, self.tolerance = part, tolerance
        self._courses = part.polynomials.free_inputs.values() if part.program.scheme.inputs.name == "polynomial" else ()
        self._times, self._lengths = part.mesh_times, np.diff(part.mesh_times)

    def within(self, unresolved: np.ndarray) -> list[Kink]:
        """Kinks in stretches of intervals with errors (N,)."""
        found = (self.at(run.start, run.stop) for run in stretches(unresolved > 0))
        return [kink for kink in found if kink is not None]

    def at(self, first: int, last: int) -> Kink | None:
        """The kink at the sharpest bend between two mesh points, of the input of which it is the sharpest."""
        found = (self._of(course, first, last) for course in self._courses)
        kinks = [kink for kink in found if kink is not None and kink.error > self.tolerance]
        return max(kinks, key=lambda kink: kink.error, default=None)

    def _of(self, course: PiecewisePolynomial, first: int, last: int) -> Kink | None:
        """The kink of one input.

        It bends the interval in which it is, whose neighbours meet there; those beside a mesh point meet if neither is.
        """
        points = np.arange(max(first, 1), min(last, len(self._lengths) - 1) + 1)
        points = np.setdiff1d(points, self.part.mesh.knots)
        if not points.size:
            return None
        c, size = course.coefficients, float(np.max(np.abs(course.coefficients[:, 0]))) or 1.0
        slopes = _slopes(c, self._lengths)
        k = int(points[np.argmax(np.abs(slopes[points] - slopes[points - 1]))])
        (before, usual_before), (after, usual_after) = self._bend(c, k - 1, -1, size), self._bend(c, k, 1, size)
        pairs = [(k - 2, k, usual_before), (k - 1, k + 1, usual_after)]
        near = k - 1, k, NEAR * max(usual_before, usual_after)
        pairs = pairs if before >= after else pairs[::-1]
        for i, j, error in [*pairs, near] if before or after else [near, *pairs]:
            met = self._meeting(c, i, j, k)
            if met is not None:
                distance, off = met[0], met[1] * abs(met[0])
                return Kink(float(self._times[k]) + distance, off / size) if off > error else None
        return None

    def _bend(self, c: np.ndarray, i: int, step: int, size: float) -> tuple[float, float]:
        """Difference of an interval from the course of its neighbour, at its far end, and one of smooth courses there.

        The former is zero if it is as small.
        """
        own, usual = self._difference(c, i, step), self._difference(c, i + step, step)
        usual *= (self._span(i, step) / self._span(i + step, step)) ** c.shape[1]
        return (own if own > max(BENT * usual, self.tolerance * size) else 0.0), usual

    def _span(self, i: int, step: int) -> float:
        """Length of an interval and its neighbour, s."""
        places = np.clip([i, i + step], 0, len(self._lengths) - 1)
        return float(np.sum(self._lengths[places]))

    def _difference(self, c: np.ndarray, i: int, step: int) -> float:
        """Difference of an interval from the course of a neighbour at the end that is not theirs; zero without one."""
        j, piece = i + step, self.part.mesh.piece
        if not 0 <= j < len(piece) or not 0 <= i < len(piece) or piece[i] != piece[j]:
            return 0.0
        end = self._times[i + (step < 0)]
        return abs(float(self._course(c, i, end)(0.0) - self._course(c, j, end)(0.0)))

    def _course(self, c: np.ndarray, i: int, origin: float) -> Polynomial:
        """Course of an interval in the time since an origin."""
        return Polynomial(c[i])(Polynomial([origin - self._times[i], 1.0]))

    def _meeting(self, c: np.ndarray, i: int, j: int, k: int) -> tuple[float, float] | None:
        """Place, from a mesh point, at which the courses of two intervals meet, and the jump of the slope there."""
        times, lengths, piece = self._times, self._lengths, self.part.mesh.piece
        if i < 0 or j >= len(lengths) or piece[i] != piece[j]:
            return None
        difference = self._course(c, i, times[k]) - self._course(c, j, times[k])
        roots = difference.roots()
        roots = np.real(roots[np.isreal(roots)]) + times[k]
        inside = (roots >= times[i + 1] - BEYOND * lengths[i]) & (roots <= times[j] + BEYOND * lengths[j])
        if not np.any(inside):
            return None
        distances = roots[inside] - times[k]
        distance = float(distances[np.argmin(np.abs(distances))])
        return distance, abs(float(difference.deriv()(distance)))


def _slopes(coefficients: np.ndarray, lengths: np.ndarray) -> np.ndarray:
    """Slopes of polynomials (N, d) halfway through their intervals (N,)."""
    powers = np.arange(1, coefficients.shape[1])
    slopes: np.ndarray = np.sum(powers * coefficients[:, 1:] * (lengths[:, None] / 2) ** (powers - 1), axis=1)
    return slopes
