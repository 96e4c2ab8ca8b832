"""The curve of solutions of n - 1 equations in n unknowns, followed until it closes on itself."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .homotopy import StepControl
from .newton import Equations, solve
from .tolerances import NEGLIGIBLE

#: Longest step, in sizes of the unknowns, and as a share of the smallest singular value: singular points are noticed.
STEP, SHARE = 0.1, 0.5
#: Share of the longest step down to which steps are divided, and largest number of points.
SMALLEST, MOST_POINTS = 1e-4, 1000
#: Singular value of rows of length one below which a point counts as nearly singular.
NEARLY_SINGULAR = 3e-3
#: Cosine of the angle between the directions of two points that follow each other, and share of a step by which it may
#: be corrected.
STRAIGHT, CORRECTION = 0.95, 0.2
#: Iterations of a correction.
ITERATIONS = 12


@dataclass(frozen=True)
class SolutionCurve:
    """A curve of solutions that closes on itself.

    Attributes
    ----------
    points : numpy.ndarray
        Points in the order of the curve, the first one that from which it was followed (k, n).
    period : numpy.ndarray
        Whole turns of the unknowns from the last point on to the first one (n,); zero if these come back themselves.
    """

    points: np.ndarray
    period: np.ndarray


@dataclass(frozen=True)
class _Point:
    """A point in unknowns divided by their sizes, its direction, and its smallest singular value."""

    y: np.ndarray
    direction: np.ndarray
    regularity: float


def closed_curve(
    equations: Equations, start: np.ndarray, sizes: np.ndarray, turning: np.ndarray
) -> SolutionCurve | None:
    """Follow the solutions through a point until they are back at it.

    None if more or fewer than one direction is free, if a point is nearly singular, through which the curve could go on
    another way, or if it does not close within :data:`MOST_POINTS`.

    Parameters
    ----------
    equations : callable
        ``x -> (residual, jacobian)``; rows may depend on each other.
    start : numpy.ndarray
        A solution (n,).
    sizes : numpy.ndarray
        Sizes that the unknowns typically have (n,).
    turning : numpy.ndarray of bool
        Unknowns of which whole turns, 2 pi, lead back to the same point (n,).
    """
    return _Curve(equations, sizes, turning).closed_from(start / sizes)


class _Curve:
    """Steps along the curve: predicted along its direction, corrected at a given advance along it."""

    def __init__(self, equations: Equations, sizes: np.ndarray, turning: np.ndarray):
        self._equations, self._sizes = equations, sizes
        #: largest length of each row so far: one that vanishes is singular
        self._lengths: np.ndarray | float = 0.0
        self._turn = np.where(turning, 2 * np.pi / sizes, 0.0)

    def closed_from(self, start: np.ndarray) -> SolutionCurve | None:
        first = self.point(start, None)
        if first is None:
            return None
        points = [first]
        for point in itertools.islice(self.after(first), MOST_POINTS - 1):
            period = self._period(first, points[-1], point) if len(points) > 1 else None
            if period is not None:
                y = np.array([p.y for p in points])
                return SolutionCurve(y * self._sizes, period * self._sizes)
            points.append(point)
        return None

    def after(self, point: _Point) -> Iterator[_Point]:
        """Points that follow one, until the next is nearly singular."""
        control = StepControl(STEP, SMALLEST * STEP, STEP)
        while True:
            following = self._advanced(point, min(control.step, SHARE * point.regularity))
            if following is not None:
                control.accept()
                yield following
                point = following
            elif not control.refuse():
                return

    def _scaled(self, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = self._equations(y * self._sizes)
        return residual, jacobian * self._sizes

    def point(self, y: np.ndarray, before: np.ndarray | None) -> _Point | None:
        """The point, with its direction in the sense of the one before; None if not exactly one is free."""
        n = y.size
        jacobian = self._scaled(y)[1]
        self._lengths = np.maximum(self._lengths, np.linalg.norm(jacobian, axis=1))
        lengths = np.where(self._lengths > 0, self._lengths, 1.0)
        _, values, right = np.linalg.svd(jacobian / lengths[:, None])
        regularity = values[n - 2] if values.size >= n - 1 else 0.0
        if regularity < NEARLY_SINGULAR or (values.size >= n and values[n - 1] > NEARLY_SINGULAR):
            return None
        direction = right[-1] if before is None or right[-1] @ before >= 0 else -right[-1]
        return _Point(y, direction, float(regularity))

    def _advanced(self, point: _Point, step: float) -> _Point | None:
        """The point at an advance; None if the curve bends too much for it."""
        direction, predicted = point.direction, point.y + step * point.direction

        def rows(y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = self._scaled(y)
            return np.append(residual, direction @ (y - predicted)), np.vstack([jacobian, direction])

        outcome = solve(rows, predicted, np.ones(predicted.size), iterations=ITERATIONS)
        if not outcome.converged or np.linalg.norm(outcome.x - predicted) > CORRECTION * step:
            return None
        following = self.point(outcome.x, direction)
        if following is None or following.direction @ direction < STRAIGHT:
            return None
        return following

    def _period(self, first: _Point, before: _Point, after: _Point) -> np.ndarray | None:
        """Whole turns after which the first point is met again between two points; None if it is not there."""
        turns = np.where(
            self._turn > 0, np.round((before.y - first.y) / np.where(self._turn > 0, self._turn, 1.0)), 0.0
        )
        ahead = first.y + turns * self._turn - before.y
        step = np.linalg.norm(after.y - before.y)
        along = float(ahead @ before.direction)
        aside = np.linalg.norm(ahead - along * before.direction)
        meets = 0 <= along <= step and aside <= CORRECTION * step and first.direction @ before.direction > STRAIGHT
        return turns * self._turn if meets and self._repeats(first.y, turns * self._turn) else None

    def _repeats(self, y: np.ndarray, period: np.ndarray) -> bool:
        """True if turns lead to the same solution: with gears of unequal teeth they may lead only near to it."""
        change = self._scaled(y + period)[0] - self._scaled(y)[0]
        return bool(np.all(np.abs(change) <= NEGLIGIBLE * (1 + np.max(np.abs(period))) * self._lengths))
