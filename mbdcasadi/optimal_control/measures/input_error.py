"""Errors of the inputs between the stages, estimated by the neighbours of each interval.

An input of an interval is a polynomial through d values, and off by about ``c ω(τ)``, with ω the product of the
distances to the points of these. The next value of a neighbour gives c. Of both neighbours the one counts that agrees
better: at a switch a smooth input has a smooth neighbour on one side only. On long stretches the other one counts, too:
an interval with a kink, whose neighbours it leads astray, agrees with one of them by chance.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from ...numerics.lazy import cached_property
from ...numerics.real import stretches
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from ..transcription.mesh import Mesh
from ..transcription.scaling import SMALLEST_SHARE
from .kinks import Kinks
from .measure import Measure
from .stretch_weight import StretchWeights
from .switches import TOO_NEAR, arcs_of, jumps_of, kinks_and_jumps, known_switches, shares_of
from .time_jumps import points_at_jumps

#: Points of an interval at which the product of the distances is looked at, both ends included.
POINTS = 41
#: Share of the duration below which a stretch in which intervals agree with one neighbour alone may enclose a kink.
KINK_SHARE = 0.01
#: Multiple of the estimate for inputs that are continuous, whose values at the mesh points and between these are off in
#: turn: measured on closed forms, with errors of the order 2 for Hermite–Simpson.
CONTINUOUS = 4.0


def input_errors(
    part: PhaseSolution,
    *,
    worse: bool = False,
    jumps: Sequence[int] = (),
    kinks: float = 0.0,
    mixed: Sequence[int] = (),
) -> np.ndarray:
    """Return the errors of the inputs in each interval as shares of their largest values (N, n_u).

    By the neighbour that agrees better, or by the one that agrees `worse`, except across waypoints, mesh points that
    move with a switch, further `jumps`, and mesh points at which an input may have a kink, since its courses meet there
    within a share of its size, `kinks`.
    An interval alone between two of these is off by its term of the highest degree, or by less, if limits do not begin
    or cease to be active in it, as in `mixed` ones: its kink may meet the course of a neighbour.
    Zero for inputs whose course was chosen, constant or linear. Infinite on a mesh of one interval, which has no
    neighbours, if the inputs are no constants.
    """
    basis, count = part.program.scheme.inputs, part.mesh.count
    courses = part.polynomials.free_inputs
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
    piece = part.mesh.piece + np.searchsorted(np.sort(jumps), np.arange(count), side="right")
    if count > 1:
        alone, degree = np.bincount(piece)[piece] == 1, coefficients.shape[1] - 1
        bent = np.abs(coefficients[:, -1]) * lengths[:, None] ** degree if degree else errors[0]
        errors[0, alone] = np.minimum(errors[0], bent)[alone]
        bends = np.isin(np.arange(count), mixed) & alone
        errors[:, bends] = bent[bends]
    sizes = _sizes(part, coefficients, lengths[:, None] * taus)
    errors_at: np.ndarray = np.min(errors, axis=0)
    if worse:
        gaps = np.abs(_values(coefficients[:-1], lengths[:-1]) - coefficients[1:, 0])
        alike = np.zeros(errors.shape, bool)
        alike[0, 1:] = alike[1, :-1] = (piece[1:] == piece[:-1])[:, None] & (gaps > kinks * sizes)
        errors_at = np.maximum(errors_at, np.max(np.where(alike, errors, 0.0), axis=0))
    return errors_at / sizes * (CONTINUOUS if basis.joined else 1.0)


class UnresolvedInputs(Measure):
    """Errors of the inputs, zero if they meet the tolerance.

    Those that are above it on a stretch that counts so little that it may enclose a switch, see :mod:`stretch_weight`,
    meet it too. At a switch that is found a stretch ends.
    """

    def __init__(self, solution: SolvedMotion, tolerance: float):
        self._shares, self._weights = shares_of(solution), StretchWeights(solution)
        super().__init__(solution, tolerance)

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Largest error of an input in each interval of a phase (N,)."""
        unresolved, lengths = np.zeros(part.mesh.count), np.diff(part.mesh_times)
        shortest = np.sqrt(self.tolerance)
        arcs = arcs_of(part, self._shares)
        in_time = points_at_jumps(part)
        jumps = sorted({*jumps_of(part, arcs), *in_time})
        known = sorted({*known_switches(part, arcs), *in_time})
        mixed = [k for arc in arcs if arc.active is None for k in range(arc.first, arc.end)]
        sizes = _shares_of_largest(part)
        for worse, share in ((False, shortest), (True, max(shortest, KINK_SHARE))):
            by_input = input_errors(part, worse=worse, jumps=jumps, kinks=self.tolerance, mixed=mixed)
            errors = np.max(by_input, axis=1, initial=0.0)
            for run in _divided(stretches(errors > self.tolerance), known):
                off = float(np.max(errors[run]) / np.max(sizes[run], initial=np.max(errors[run])))
                if self._weights.of(part, range(run.start, run.stop), off) > share:
                    unresolved[run] = np.maximum(unresolved[run], errors[run])
        kinks = self._kinks(part)
        for switch in kinks_and_jumps(part, arcs)[0]:
            run = slice(switch.intervals[0], switch.intervals[-1] + 1)
            kink = kinks.at(run.start, run.stop)
            if kink is not None and kink.error * np.sum(lengths[run]) > self.tolerance * part.duration * shortest:
                unresolved[run] = np.maximum(unresolved[run], kink.error)
        return unresolved

    def _kinks(self, part: PhaseSolution) -> Kinks:
        return Kinks(part, self.tolerance)

    def placed(self, part: PhaseSolution, mesh: Mesh) -> Mesh:
        """The mesh of a phase with points at the kinks in stretches in which inputs are off."""
        times = self._kink_times[part.program.number]
        if not times:
            return mesh
        positions = np.interp(times, part.mesh_times, part.mesh.positions)
        return mesh.through_points(positions, TOO_NEAR, mesh.positions[list(mesh.moving)])

    @cached_property
    def _kink_times(self) -> list[list[float]]:
        """Times of the kinks by phase, but for those beside jumps, s."""
        found = []
        for part, all_errors in zip(self.solution.phases, self.errors, strict=True):
            errors = all_errors.copy()
            for switch in kinks_and_jumps(part, arcs_of(part, self._shares))[1] if errors.size else ():
                errors[max(switch.intervals[0] - 1, 0) : switch.intervals[-1] + 2] = 0.0
            found.append([kink.time for kink in self._kinks(part).within(errors)] if errors.size else [])
        return found

    @property
    def step(self) -> float:
        """Longest step from a mesh point to a kink, s."""
        pairs = zip(self.solution.phases, self._kink_times, strict=True)
        return max((float(np.min(np.abs(part.mesh_times - t))) for part, times in pairs for t in times), default=0.0)

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
    def loss(self) -> float:
        """Largest one of a stretch."""
        parts = zip(self.solution.phases, self.errors, strict=True)
        pairs = [(part, errors, run) for part, errors in parts for run in stretches(errors > 0)]
        return max((self._lost(*pair) for pair in pairs), default=0.0)

    def _lost(self, part: PhaseSolution, errors: np.ndarray, run: slice) -> float:
        """Share of the cost that is lost in a stretch."""
        return self._weights.lost(part, range(run.start, run.stop), min(float(np.max(errors[run])), 1.0))

    @property
    def spread(self) -> float:
        """Errors of a stretch times the lengths of its intervals: a peak at its end does not count for all of it."""
        return max(
            (float(np.dot(errors[run], lengths[run])) for errors, lengths, run in self._stretches()), default=0.0
        )

    def _stretches(self) -> Iterator[tuple[np.ndarray, np.ndarray, slice]]:
        """Errors and lengths of the intervals of a phase, and which of them are a stretch with errors."""
        for part, errors in zip(self.solution.phases, self.errors, strict=True):
            for run in stretches(errors > 0):
                yield errors, np.diff(part.mesh_times), run


def _divided(runs: Iterable[slice], points: Sequence[int]) -> Iterator[slice]:
    """Runs of intervals, divided at mesh points."""
    for run in runs:
        ends = [run.start, *sorted(k for k in points if run.start < k < run.stop), run.stop]
        yield from (slice(begin, end) for begin, end in itertools.pairwise(ends))


def _product(points: np.ndarray, taus: np.ndarray) -> np.ndarray:
    product: np.ndarray = np.prod(points[:, None] - taus, axis=1)
    return product


def _values(coefficients: np.ndarray, since: np.ndarray) -> np.ndarray:
    """Values of polynomials (N, d, n_u) at times since the starts of their intervals (N,)."""
    powers = since[:, None] ** np.arange(coefficients.shape[1])
    values: np.ndarray = np.einsum("nd,ndk->nk", powers, coefficients)
    return values


def _shares_of_largest(part: PhaseSolution) -> np.ndarray:
    """Largest value of an input at the ends of each interval, as a share of the largest one of all (N,)."""
    shares = np.zeros(part.mesh.count)
    for course in part.polynomials.free_inputs.values():
        c, powers = course.coefficients, np.arange(course.terms)
        last = np.sum(c * np.diff(part.mesh_times)[:, None] ** powers, axis=1)
        values = np.maximum(np.abs(c[:, 0]), np.abs(last))
        shares = np.maximum(shares, values / (np.max(values) or 1.0))
    return shares


def _sizes(part: PhaseSolution, coefficients: np.ndarray, since: np.ndarray) -> np.ndarray:
    """Largest values of the inputs at their points, not far below their typical ones (n_u,)."""
    largest = [np.max(np.abs(_values(coefficients, column)), axis=0) for column in since.T]
    typical = part.program.scales.u[part.program.scheme.free_inputs]
    sizes: np.ndarray = np.maximum(np.max(largest, axis=0), SMALLEST_SHARE * typical)
    return sizes
