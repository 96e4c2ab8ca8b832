"""Least squares from many random starts at once."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from .residuals import POSE_STEP, Residuals

#: Decades of sizes, in those of the drawing, that random dimensions have: from a thirtieth to thirty times these.
DECADES = 1.5
#: Iterations, and of these on poses alone before the first.
ITERATIONS, FIRST = 100, 8
#: Damping at first, its factors after a step that comes nearer and one that does not, and that at which a start ends.
DAMPING, LESS, MORE, MOST = 1e-2, 0.5, 3.0, 1e8
#: Sum of squares of residuals, divided by their sizes, from which Newton's method finds the solution.
MET = 1e-20
#: Share of the ends on some of the positions that go on to all, and random starts of their poses.
NEAREST, POSED = 0.05, 10
#: Sum of squares that is rounding, share by which an iteration must lessen it, and size of dimensions that diverge.
ROUNDING, PROGRESS, FARTHEST = 1e-26, 1e-9, 1e3


@dataclass(frozen=True, eq=False)
class Range:
    """What random starts are taken from.

    Attributes
    ----------
    p, lower, upper : numpy.ndarray
        Unknowns as they are drawn, and their limits (n,).
    sizes : numpy.ndarray
        Sizes of the unknowns (n,).
    y, turning : numpy.ndarray
        The drawn pose, and True for its angles (k,).
    length : float
        Size of the drawing, m.
    """

    p: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    sizes: np.ndarray
    y: np.ndarray
    turning: np.ndarray
    length: float

    def starts(self, count: int, positions: int, random: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Poses (count, positions, k) and unknowns (count, n)."""
        size = 10 ** random.uniform(-DECADES, DECADES, size=(count, 1))
        p = self.p + size * self.sizes * random.normal(size=(count, self.p.size))
        # beyond two limits anywhere between them, beyond one at it
        low, high = (np.where(np.isfinite(x), x, self.p) for x in (self.lower, self.upper))
        outside = ((p < self.lower) | (p > self.upper)) & np.isfinite(self.lower) & np.isfinite(self.upper)
        p = np.clip(np.where(outside, random.uniform(low, high, size=p.shape), p), self.lower, self.upper)
        turned = random.uniform(-np.pi, np.pi, size=(count, positions, self.y.size))
        moved = self.length * size[..., None] * random.normal(size=turned.shape)
        return self.y + np.where(self.turning, turned, moved), p


def descend(
    residuals: Residuals, y: np.ndarray, p: np.ndarray, end: float = np.inf
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Damped Gauss-Newton steps from starts: poses, unknowns and sums of squares at their ends, or at a time (s)."""
    y, value = residuals.settled(y, p, FIRST)
    damping, active = np.full(len(p), DAMPING), np.arange(len(p))
    for _ in range(ITERATIONS):
        dy, dp = residuals.step(y[active], p[active], damping[active])
        trial = p[active] + dp
        moved, there = residuals.settled(y[active] + np.clip(dy, -POSE_STEP, POSE_STEP), trial, 1)
        before = value[active]
        nearer = there < before
        taken = active[nearer]
        p[taken], y[taken], value[taken] = trial[nearer], moved[nearer], there[nearer]
        damping[active] = damping[active] * np.where(nearer, LESS, MORE)
        stalls = nearer & (there > (1 - PROGRESS) * before)
        within = np.max(np.abs(p[active]) / residuals.sizes, axis=1) < FARTHEST
        active = active[(damping[active] < MOST) & (value[active] > ROUNDING) & within & ~stalls]
        if not active.size or clock.monotonic() > end:
            break
    return y, p, value


def searched(
    residuals: Residuals, within: Range, count: int, seed: tuple[int, ...], coarse: Residuals | None, end: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ends of descents from random starts that meet all residuals, without those where joints of a body coincide.

    Parameters
    ----------
    count : int
        Number of starts.
    seed : tuple of int
        Of the random numbers.
    coarse : Residuals, optional
        Those of some of the positions: the starts go down on these, then the nearest ends on all; these are returned.
    end : float
        Time at which starts that still go down are left, on the clock that never goes back, s.

    Returns
    -------
    y, p, value : numpy.ndarray
        Poses, unknowns and sums of squares.
    """
    random = np.random.default_rng(seed)
    first = residuals if coarse is None else coarse
    with np.errstate(all="ignore"):  # starts at which a residual is not finite are left
        y, p = within.starts(count, first.count, random)
        if coarse is None and first.m:  # first what holds of the dimensions alone
            p = descend(residuals.only([]), y[:, :0], p)[1]
        y, p, value = descend(first, y, p, end)
        value = _counted(first, p, value)
        if coarse is None:
            chosen = np.flatnonzero(value < MET)
            return y[chosen], p[chosen], value[chosen]
        p = p[np.argsort(nearness(first, p, value))[: max(1, int(NEAREST * count))]]
        y, p, value = descend(residuals, posed(residuals, within, p, random), p, end)
        value = _counted(residuals, p, value)
    chosen = np.flatnonzero(np.isfinite(value))
    return y[chosen], p[chosen], value[chosen]


def nearness(residuals: Residuals, p: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Sums of squares with distances as shares of the shortest bar (starts,).

    A gap that is as long as a bar lets it point anywhere: by the sums alone, linkages of which a bar vanishes look
    nearest, and miss everything once their joints are closed.
    """
    missed: np.ndarray = value / residuals.shortest(p) ** 2
    return missed


def _counted(residuals: Residuals, p: np.ndarray, value: np.ndarray) -> np.ndarray:
    """Sums of squares, infinite where joints of a body coincide or nothing is finite."""
    return np.where(np.isfinite(value) & ~residuals.degenerate(p), value, np.inf)


def posed(residuals: Residuals, within: Range, p: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Poses nearest to the positions at given dimensions (starts, positions, k), of those from random starts."""
    y = within.starts(POSED * len(p), residuals.count, random)[0]
    y, value = residuals.settled_each(y, np.repeat(p, POSED, axis=0))
    y, value = (x.reshape(len(p), POSED, *x.shape[1:]) for x in (y, value))
    best = np.argmin(np.where(np.isfinite(value), value, np.inf), axis=1)
    taken: np.ndarray = np.take_along_axis(y, best[:, None, :, None], axis=1)[:, 0]
    return taken
