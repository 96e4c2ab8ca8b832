"""The course of quantities over a motion: samples at which polynomials follow ``motion.at(t)`` to a tolerance.

A picture at equal distances in time misses peaks, and is wrong between the
times where a motion bends. Here all outputs of the motion and the instants of
its events are looked at, and the motion between them is sampled until
polynomials through the samples are as near to it as asked for.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..results.trajectory import Trajectory
from .drawing.sample import between

#: Points of a polynomial: of degree five, as the interpolation of a motion has.
POINTS = 6
#: Shortest distance of samples, relative to the duration; what changes within it is a jump.
RESOLUTION = 1e-9
#: Outputs that are looked at together, and of which the midpoints are looked at too.
CHUNK, DENSE = 4000, 20_000
#: Values, samples by columns, that are held in memory at most; samples up to which a course is followed in any case.
MOST_VALUES, FEWEST = 15_000_000, 4000
#: A time so far away that a knot there has no weight, s.
FAR_BEYOND = 1e40
#: Samples from one to the next of the knots that are tried first.
STRIDE = 8
#: Unit of which values at knots are multiples, in parts of the tolerance.
QUANTUM = 0.5
#: Pieces of a line from knot to knot.
SMOOTH = 8
#: Instants at which the roughness of values is looked at, and the step, in parts of the distance of samples.
PROBES, TINY = 41, 1e-5
#: Rounds of bisection, which reach from any distance of outputs to the resolution.
ROUNDS = 40


class Course:
    """Samples of quantities over a motion.

    Parameters
    ----------
    motion : Trajectory
        The motion, with two times at least.
    groups : sequence of casadi.SX
        Columns of expressions; those of one group have common knots.

    Attributes
    ----------
    t : numpy.ndarray
        Times of the samples (n,), s, increasing. Those just before and just after a
        jump are no farther apart than the resolution.
    values : list of numpy.ndarray
        By group (n, k).
    rough : set of int
        Groups that could not be followed.
    """

    def __init__(self, motion: Trajectory, groups: Sequence[ca.SX]):
        self._motion = motion
        columns = [ca.densify(ca.vec(ca.SX(group))) for group in groups]
        self._splits = np.cumsum([column.numel() for column in columns])[:-1]
        self._column = ca.vertcat(ca.SX(0, 1), *columns)
        duration = float(motion.t[-1] - motion.t[0])
        self.resolution = max(RESOLUTION * duration, 8 * float(np.spacing(np.max(np.abs(motion.t)))))
        self._limit = max(FEWEST, MOST_VALUES // max(1, self._column.numel()))
        self.t, self._values = self._first_samples()
        self._most_knots = 4 * self.t.size + FEWEST
        self.rough: set[int] = set()

    def _first_samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Knots of the motion and the midpoints between them; of very many knots those that polynomials need."""
        times = self._motion.knots
        if times.size <= DENSE:
            wide = np.diff(times) > 2 * self.resolution
            times = np.union1d(times, (times[:-1] + times[1:])[wide] / 2)
            return times, self._evaluated(times)
        kept_times, kept_values = [], []
        for k in range(0, times.size - 1, CHUNK):
            some = times[k : k + CHUNK + 1]
            values = self._evaluated(some)
            scale = np.maximum(np.abs(values).max(axis=0), 1e-300)
            knots = knots_for(some, values, 1e-7 * scale, self.resolution)
            kept_times.append(some[knots])
            kept_values.append(values[knots])
        t, first = np.unique(np.concatenate(kept_times), return_index=True)
        return t, np.vstack(kept_values)[first]

    def _evaluated(self, times: np.ndarray) -> np.ndarray:
        if not self._column.numel():
            return np.zeros((times.size, 0))
        return np.asarray(between(self._motion, times)[self._column], float).reshape(times.size, -1)

    @property
    def values(self) -> list[np.ndarray]:
        """Values at the samples by group, (n, k)."""
        return np.split(self._values, self._splits, axis=1)

    def noise(self) -> list[np.ndarray]:
        """Return by group (k,) how rough values are from instant to instant: what no polynomial can follow.

        Second differences over a tiny step are rounding errors of the solvers alone, as
        long as the quantity is smooth; jumps, which are few, do not change their median.
        """
        spacing = (self.t[-1] - self.t[0]) / self.t.size
        step = max(TINY * spacing, 1e3 * self.resolution * np.finfo(float).eps / RESOLUTION)
        probes = np.linspace(self.t[0] + step, self.t[-1] - step, PROBES)
        before, at, after = np.split(self._evaluated(np.concatenate([probes - step, probes, probes + step])), 3)
        return np.split(np.median(np.abs(before - 2 * at + after), axis=0), self._splits)

    def select(self, columns: Sequence[np.ndarray]) -> None:
        """Go on with some columns of each group alone, by their numbers in it."""
        ends = np.r_[0, self._splits, self._column.numel()]
        chosen = np.concatenate([start + np.asarray(c, int) for start, c in zip(ends[:-1], columns, strict=True)])
        self._splits = np.cumsum([len(c) for c in columns])[:-1]
        self._column, self._values = self._column[[int(k) for k in chosen]], self._values[:, chosen]
        self._limit = max(FEWEST, MOST_VALUES // max(1, chosen.size))

    def chosen(self, tolerances: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Knots by group such that polynomials are within tolerances at the samples, whatever is between them."""
        return [knots_for(self.t, *pair, self.resolution) for pair in zip(self.values, tolerances, strict=True)]

    def follow(self, tolerances: Sequence[np.ndarray], most: float = np.inf) -> list[np.ndarray] | None:
        """Sample until polynomials through knots among the samples are within tolerances.

        A group that needs very many knots is noise, or changes without end: it
        is given up, and its number is then in :attr:`rough`.

        Parameters
        ----------
        tolerances : sequence of numpy.ndarray
            By group (k,).
        most : float, optional
            Values at knots, over all groups, beyond which nothing is returned.

        Returns
        -------
        list of numpy.ndarray or None
            By group, numbers of the samples that are knots; None if they would be more than
            `most`, or the samples more than fit into memory.
        """
        knots = self.chosen(tolerances)
        self.rough = set()
        for _ in range(ROUNDS):
            if sum(k.size * tolerance.size for k, tolerance in zip(knots, tolerances, strict=True)) > most:
                return None
            self.rough |= {k for k, numbers in enumerate(knots) if numbers.size > self._most_knots}
            # an interval without a sample in it was not looked at
            open_ = [numbers for k, numbers in enumerate(knots) if k not in self.rough]
            adjacent = np.unique(np.concatenate([np.zeros(0, int), *(n[:-1][np.diff(n) == 1] for n in open_)]))
            adjacent = adjacent[np.diff(self.t)[adjacent] > self.resolution]
            if not adjacent.size:
                return knots
            if self.t.size + adjacent.size > self._limit:
                return None
            starts = self._bisect(adjacent, knots)
            knots = [
                start if k in self.rough else knots_for(self.t, values, tolerance, self.resolution, start)
                for k, (values, tolerance, start) in enumerate(zip(self.values, tolerances, starts, strict=True))
            ]
        return knots

    @property
    def samples(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and values, to return to after a course was followed more closely than is needed."""
        return self.t, self._values

    @samples.setter
    def samples(self, samples: tuple[np.ndarray, np.ndarray]) -> None:
        self.t, self._values = samples

    def lines(self, tolerances: Sequence[np.ndarray]) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return times (n,) at which lines are smooth to the eye, and values there by group (n, k)."""
        knots = self.follow(tolerances)
        if knots is None:
            return self.t, self.values
        t = self.t[np.unique(np.concatenate([np.array([0, self.t.size - 1]), *knots]))]
        wide = np.diff(t) > self.resolution
        parts = [t[:-1][wide] + share * np.diff(t)[wide] for share in np.arange(1, SMOOTH) / SMOOTH]
        t = np.unique(np.concatenate([t, *parts]))
        values = [interpolated(self.t[k], v[k], t, self.resolution) for k, v in zip(knots, self.values, strict=True)]
        return t, values

    def _bisect(self, intervals: np.ndarray, knots: list[np.ndarray]) -> list[np.ndarray]:
        """Sample in the middle of intervals; return the numbers that knots have then."""
        middles = (self.t[intervals] + self.t[intervals + 1]) / 2
        self.t = np.insert(self.t, intervals + 1, middles)
        self._values = np.insert(self._values, intervals + 1, self._evaluated(middles), axis=0)
        return [k + np.searchsorted(intervals, k) for k in knots]


def knots_for(
    t: np.ndarray, values: np.ndarray, tolerance: np.ndarray, resolution: float, start: np.ndarray | None = None
) -> np.ndarray:
    """Choose knots among samples, such that polynomials through them pass all other samples within a tolerance.

    Values at knots are rounded to multiples of half the tolerance, as a page keeps them.

    Parameters
    ----------
    t : numpy.ndarray
        Times (n,), s.
    values : numpy.ndarray
        (n, k).
    tolerance : numpy.ndarray
        (k,), positive.
    resolution : float
        Distance of samples, s, across which no polynomial reaches.
    start : numpy.ndarray, optional
        Knots that are there already.

    Returns
    -------
    numpy.ndarray
        Numbers of the knots, increasing; the ends are among them.
    """
    relative = values / np.maximum(tolerance, 1e-300)
    kept = np.floor(relative / QUANTUM + 0.5) * QUANTUM
    chosen = np.zeros(t.size, bool)
    if start is not None:
        chosen[start] = True
    else:
        chosen[::STRIDE] = True
        chosen[-1] = True
        jumps = np.flatnonzero((np.diff(t) <= resolution) & np.any(np.abs(np.diff(relative, axis=0)) > 1, axis=1))
        chosen[jumps] = chosen[jumps + 1] = True
    error = np.zeros(t.size)
    open_ = ~chosen if values.shape[1] else np.zeros(t.size, bool)
    while True:
        knots, rows = np.flatnonzero(chosen), np.flatnonzero(open_)
        if rows.size:
            follows = interpolated(t[knots], kept[knots], t[rows], resolution)
            error[rows] = np.max(np.abs(follows - relative[rows]), axis=1)
        intervals = np.searchsorted(knots, np.arange(t.size))
        error[knots] = 0.0
        worst = _worst_by_interval(intervals, error)
        if not worst.size:
            return knots
        chosen[worst] = True
        # only polynomials through a new knot have changed
        touched = np.zeros(knots.size + 2 * POINTS, bool)
        for shift in range(-(POINTS // 2), POINTS // 2 + 1):
            touched[intervals[worst] + POINTS + shift] = True
        open_ = touched[intervals + POINTS] & ~chosen


def _worst_by_interval(intervals: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Number of the sample with the largest error above 1 in each interval; NaN counts as such."""
    bad = np.flatnonzero(~(error <= 1))
    order = bad[np.lexsort((np.nan_to_num(error[bad], nan=np.inf), intervals[bad]))]
    last = np.r_[np.diff(intervals[order]) != 0, True][: order.size]
    return order[last]


def interpolated(knots: np.ndarray, values: np.ndarray, t: np.ndarray, resolution: float) -> np.ndarray:
    """Evaluate the polynomials through the knots about each time.

    Parameters
    ----------
    knots : numpy.ndarray
        Times (n,), s, increasing.
    values : numpy.ndarray
        (n, k).
    t : numpy.ndarray
        Times (m,) within their span, s.
    resolution : float
        Distance of knots across which no polynomial reaches.

    Returns
    -------
    numpy.ndarray
        (m, k): on the polynomial of degree five through the six knots about the time, of
        lower degree if there are fewer between two jumps; linear within a jump.
    """
    stencil, weights = _stencils(knots, t, resolution)
    return np.einsum("mj,mjk->mk", weights, values[stencil])


def _stencils(knots: np.ndarray, t: np.ndarray, resolution: float) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of the knots of each polynomial, and their Lagrange weights, (m, POINTS)."""
    jumps = np.flatnonzero(np.diff(knots) <= resolution)
    left = np.clip(np.searchsorted(knots, t, side="right") - 1, 0, knots.size - 2)
    firsts, lasts = np.r_[0, jumps + 1], np.r_[jumps, knots.size - 1]
    piece = np.searchsorted(jumps, left)  # of an interval that is a jump, the one before it
    across = np.isin(left, jumps)
    first, last = np.where(across, left, firsts[piece]), np.where(across, left + 1, lasts[piece])
    start = np.maximum(first, np.minimum(left - (POINTS // 2 - 1), last - (POINTS - 1)))
    numbers = start + np.arange(POINTS)[:, None]
    # knots that are not there lie at infinity, and at different ones: their weights vanish
    beyond = (np.arange(POINTS)[:, None] + 1) * FAR_BEYOND
    places = np.where(numbers <= last, knots[np.minimum(numbers, last)] - t, beyond)
    weights = np.empty_like(places)
    for j, place in enumerate(places):
        others = np.delete(places, j, axis=0)
        weights[j] = np.prod(others / (others - place), axis=0)
    return np.minimum(numbers, last).T, weights.T
