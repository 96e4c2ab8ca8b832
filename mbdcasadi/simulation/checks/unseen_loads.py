"""Loads that come and go between two steps of an integrator, which leave no trace in them.

A body at rest, or in uniform motion, lets a method with an adaptive step take steps as long as the run: over a bump
of a road, a force that acts in a short range of a coordinate, a pulse that a flywheel triggers. The graph of the
equations shows what may switch or pass quickly as the motion goes on: the operands of comparisons, of absolute values,
of exponential functions, and divisors. Their zeros and extrema are looked for on the path between the outputs; around
these the accelerations on the path are integrated and compared with the change of the velocities that the steps found.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import casadi as ca
import numpy as np

from ...arguments.inputs import Signals
from ...equations import Equations
from ...integrators.compiled import IntegrationFailure
from ...numerics.collocation import gauss
from ...numerics.roots import Functions, narrowed_extrema, narrowed_roots
from ..path import Path, hermite_states
from ..quantities import quantities_of
from ..stepper import Stepper

#: Points of each output interval at which the quantities are evaluated.
POINTS = 9
#: Stops around the middle of a transient, in its durations.
AROUND = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
#: Stops between two switches, as shares.
BETWEEN = np.array([0.3, 0.7])
#: Doublings or halvings by which the duration of a transient is found, at most.
MOST_DOUBLINGS = 60
#: Transients that last longer than this many steps are noticed by these.
LONG = 8.0
#: Change of the state that the steps missed, in tolerances, from which a load counts as unseen: errors of a step, of
#: its dense output, and of the path between outputs are below it.
MISSED_TOLERANCES = 30.0
#: Largest factor on it where suspicions turned out wrong.
MOST_DOUBT = 1e3
#: Points over a load by which its duration is found, and loads of a path that are looked at, the shortest ones first.
SAMPLES, MOST_LOADS = 33, 500
#: Instants closer than this share of an output interval are one.
SAME_INSTANT = 1e-7


@dataclass(frozen=True)
class UnseenLoad:
    """A stretch of a path over which the steps of an integrator passed without its load.

    Attributes
    ----------
    interval : int
        Output interval of the path.
    stops : numpy.ndarray
        Times that no step may cross, the last one the end of the load's part that was found, s.
    """

    interval: int
    stops: np.ndarray


class UnseenLoads:
    """Looks for loads on the path of a run that its integrator stepped over.

    Parameters
    ----------
    stepper : Stepper
        Method that advances the run, whose short integrations verify suspicions.
    integrands : casadi.SX, optional
        Expressions that are integrated along the motion: their courses are looked at instead of the loads.
    """

    def __init__(self, stepper: Stepper, integrands: ca.SX | None = None):
        self._stepper, self._numeric = stepper, stepper.numeric
        eom = stepper.numeric.eom
        quantities = quantities_of(eom, stepper.signals, integrands)
        self._count, self.watched, self._quantities = quantities.switches, quantities.number, quantities.function
        self._levels = quantities.levels
        rate = eom.z_rate if integrands is None else integrands
        self._moves = integrands is None
        self._rate = eom.function(rate) if rate.numel() else None
        # by how much more than these limits something must be missed to be looked at
        self._doubt = 1.0

    def first(self, path: Path) -> UnseenLoad | None:
        """First load on a path, between the outputs of the integrator, that its steps missed; None if there is none."""
        if not self.watched or path.times.size < 2:
            return None
        longest = LONG * float(np.max(np.diff(path.times)))
        # between outputs that are no steps, a step may be as long as the path
        most = 0.0 if path.of_steps else float(path.times[-1] - path.times[0])
        n = self._numeric.eom.q.numel()
        limits = self._limits(path)
        instants = partial(self._instants, path, longest, most)
        if not self._suspects(path, *instants(closely=False), self._doubt * limits, closely=False):
            return None
        for load in self._suspects(path, *instants(), self._doubt * limits):
            k = load.interval
            try:
                end = self._stepper.states_from(float(path.times[k]), path.x[k])(load.stops)[-1]
            except IntegrationFailure:  # the run itself will say why
                return load
            missed = np.abs(end - path.x[k + 1])[n:]
            if np.any(missed > limits):
                return self._from_its_begin(path, load, limits)
            # the path between outputs was not what the integrator followed
            self._doubt = min(2 * self._doubt, MOST_DOUBT)
        return None

    def shortest(self, path: Path) -> float:
        """Duration of the shortest load on a path, whether steps missed it or not, s; infinite if there is none.

        The path is that of a whole run, as a load begins in one piece of it and may end in another.
        """
        if not self.watched or path.times.size < 2:
            return np.inf
        instants, durations = self._instants(path, float(path.times[-1] - path.times[0]))
        smooth = np.isfinite(durations)
        switches = np.unique(instants[~smooth])
        gaps = np.diff(switches)
        centres = np.r_[instants[smooth], switches[:-1] + gaps / 2]
        halves = np.r_[AROUND[-1] * durations[smooth], 1.5 * gaps]
        shortest_first = np.argsort(halves)[:MOST_LOADS]
        low = np.maximum((centres - halves)[shortest_first], path.times[0])
        high = np.minimum((centres + halves)[shortest_first], path.times[-1])
        low, high = (part[high > low] for part in (low, high))
        if not low.size:
            return np.inf
        share = np.linspace(0, 1, SAMPLES)
        rates = self._rates(path, (low[:, None] + (high - low)[:, None] * share).ravel())
        rates = rates.reshape(low.size, SAMPLES, -1)
        # what comes and goes, over what is there before and after
        loads = np.abs(rates - rates[:, :1] - share[:, None] * (rates[:, -1:] - rates[:, :1]))
        weight = (high - low) / (SAMPLES - 1)
        counts = np.sum(loads, axis=1) * weight[:, None] / self._limits(path)
        shortest = np.inf
        for k in np.flatnonzero(np.max(counts, axis=1) > 1):
            load = loads[k, :, int(np.argmax(counts[k]))]
            shortest = min(shortest, _duration(load, float(weight[k])))
        return shortest

    def _limits(self, path: Path) -> np.ndarray:
        """Errors of velocities and first-order states, or of the integrals, that do not count."""
        reltol, abstol = self._stepper.integrator.tolerances
        if not self._moves:
            return np.array([MISSED_TOLERANCES * abstol])
        n, bodies = self._numeric.eom.q.numel(), len(self._numeric.eom.mechanism.bodies)
        size = np.max(np.abs(path.x[:, n:]), axis=0, initial=0.0)
        size[: 3 * bodies] = np.max(size[: 3 * bodies], initial=0.0)
        limits: np.ndarray = MISSED_TOLERANCES * (reltol * size + abstol)
        return limits

    # --- where something may happen -------------------------------------------------------
    def _at(self, path: Path, times: np.ndarray) -> np.ndarray:
        """Quantities on the path (quantities, k)."""
        n = self._numeric.eom.q.numel()
        x = hermite_states(path, times, n)
        q, v, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
        return self._quantities.rows(times[:, None], q, v, z, self._numeric.p)[0].T

    def _instants(
        self, path: Path, longest: float, most: float = 0.0, *, closely: bool = True
    ) -> tuple[np.ndarray, np.ndarray]:
        """Instants at which quantities are zero, largest or smallest, and durations there; infinite at switches.

        Parameters
        ----------
        longest : float
            Duration from which transients do not count, s.
        most : float
            Duration up to which extrema of longer ones count, too, s: at the points of the path that show them, and
            with a duration of zero, since their load fills the interval.
        closely : bool
            False to take zeros by straight lines where these are much less off than the next zero is away.
        """
        lengths = np.diff(path.times)
        # a load about an end of the path has its peak beyond it
        low, high = self._reach(path)
        share = np.arange(POINTS - 1) / (POINTS - 1)
        begins, lasts = np.r_[low, path.times], np.r_[lengths[0], lengths, lengths[-1]]
        times = np.r_[(begins[:, None] + lasts[:, None] * share).ravel(), high]
        values = self._at(path, times)
        with np.errstate(all="ignore"):
            rows, roots = self._zeros(path, times, values, closely=closely)
            tops, durations, rows_inside, roots_inside = self._turns(path, times, values, longest, most)
            rows, roots = np.r_[rows, rows_inside], np.r_[roots, roots_inside]
            switching = rows < self._count
            width = 1e-4 * float(np.max(lengths))
            of_rows = self._of_rows(path, rows[~switching])
            ahead, behind = (of_rows(roots[~switching] + x) for x in (width, -width))
            passing = 2 * width / np.abs(ahead - behind)
        instants = np.concatenate([roots[switching], roots[~switching], tops])
        lasts = np.concatenate([np.full(int(np.sum(switching)), np.inf), passing, durations])
        counts = np.isfinite(instants) & (np.isinf(lasts) | (lasts < longest))
        return instants[counts], lasts[counts]

    @staticmethod
    def _reach(path: Path) -> tuple[float, float]:
        """Times up to which a path is looked at: by an interval beyond its ends."""
        times = path.times
        return float(2 * times[0] - times[1]), float(2 * times[-1] - times[-2])

    def _zeros(
        self, path: Path, times: np.ndarray, values: np.ndarray, *, closely: bool
    ) -> tuple[np.ndarray, np.ndarray]:
        """Quantities and instants at which they pass one of their levels, or are at one at a point of a path (k,)."""
        rows, places, levels = self._levels.passed(values)
        low, high, at_low = times[places], times[places + 1], values[rows, places] - levels
        roots, loose = np.empty(rows.size), np.ones(rows.size, bool)
        if not closely:
            per_change = (high - low) / (values[rows, places + 1] - values[rows, places])
            roots = low - per_change * at_low
            step = per_change * self._of_rows(path, rows, levels)(roots)
            order = np.argsort(roots)
            gaps = np.diff(roots[order], prepend=-np.inf, append=np.inf)
            loose[order] = ~(POINTS * np.abs(step[order]) < np.minimum(gaps[:-1], gaps[1:]))
            roots -= step

        def narrow(chosen: np.ndarray) -> None:
            of_rows = self._of_rows(path, rows[chosen], levels[chosen])
            roots[chosen] = narrowed_roots(of_rows, low[chosen], high[chosen], at_low[chosen])

        # a jump passes all levels at one instant, which the first and the last one of them show
        is_first = np.diff(rows * times.size + places, prepend=-1) != 0
        cell, is_last = np.cumsum(is_first) - 1, np.r_[is_first[1:], np.ones(min(rows.size, 1), bool)]
        narrow(loose & (is_first | is_last))
        jumps = np.abs(roots[is_last] - roots[is_first]) <= SAME_INSTANT * (high - low)[is_first]
        at_jump = loose & jumps[cell]
        roots[at_jump] = roots[is_first][cell[at_jump]]
        narrow(loose & ~at_jump & ~is_first & ~is_last)
        rows_at, places_at = self._levels.met(values)
        return np.r_[rows, rows_at], np.r_[roots, times[places_at]]

    def _turns(
        self, path: Path, times: np.ndarray, values: np.ndarray, longest: float, most: float
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Extrema of what passes quickly and their durations; and zeros about the extrema of what switches (k,).

        Of three points about an extremum the middle one is nearest to it: the value there is beyond the middle one by
        less than the larger of the two differences between them (of a parabola, by less than an eighth of it).
        """
        rises = np.diff(values, axis=1)
        rows, places = np.nonzero(rises[:, :-1] * rises[:, 1:] < 0)
        before, middle, after = (values[rows, places + k] for k in range(3))
        half = (times[places + 2] - times[places]) / 2
        durations = np.sqrt(2 / (np.abs(before - 2 * middle + after) / half**2))
        beyond = middle + np.sign(middle - before) * np.maximum(np.abs(middle - before), np.abs(after - middle))
        smooth = rows >= self._count
        counts = smooth & (durations < longest)
        lasting = smooth & ~counts & (durations < most)
        shown = times[places[lasting] + 1]
        low, high, sign = times[places], times[places + 2], np.sign(middle - before)
        chosen, at = rows[counts], (low[counts], high[counts], sign[counts])
        tops = narrowed_extrema(self._of_rows(path, chosen), *at)
        durations = self._lasting(path, chosen, tops, durations[counts], longest)
        # a quantity that is beyond a level between two points alone
        turning, levels = self._levels.between(rows[~smooth], middle[~smooth], beyond[~smooth])
        own = np.flatnonzero(~smooth)[turning]
        rows, low, high, sign, before, after = (part[own] for part in (rows, low, high, sign, before, after))
        of_rows = self._of_rows(path, rows, levels)
        summits = narrowed_extrema(of_rows, low, high, sign)
        at_top = of_rows(summits[:, None])[:, 0]
        begin, end = np.r_[low, summits], np.r_[summits, high]
        at_begin, at_end = np.r_[before - levels, at_top], np.r_[at_top, after - levels]
        inside = np.tile(at_top * sign > 0, 2) & (np.sign(at_begin) * np.sign(at_end) < 0)
        rows, levels = np.tile(rows, 2)[inside], np.tile(levels, 2)[inside]
        roots = narrowed_roots(self._of_rows(path, rows, levels), begin[inside], end[inside], at_begin[inside])
        return np.r_[tops, shown], np.r_[durations, np.zeros(shown.size)], rows, roots

    def _lasting(
        self, path: Path, rows: np.ndarray, tops: np.ndarray, durations: np.ndarray, longest: float
    ) -> np.ndarray:
        """Times about extrema in which quantities change by about one, from those of parabolas through far points (k,).

        What is flatter than a parabola lasts longer, a narrow valley in a quantity that hardly changes beside it less.
        """
        durations, at_top = durations.copy(), self._of_rows(path, rows)(tops)
        grown, shrunk = (np.zeros(rows.size, bool) for _ in range(2))
        active = np.arange(rows.size)
        for _ in range(MOST_DOUBLINGS):
            beside = tops[active, None] + durations[active, None] * np.array([-1.0, 1.0])
            change = np.max(np.abs(self._of_rows(path, rows[active])(beside) - at_top[active, None]), axis=1)
            too_short = (change < 0.5) & ~shrunk[active] & (durations[active] < longest)
            too_long = (change > 2.0) & ~grown[active]
            grown[active], shrunk[active] = grown[active] | too_short, shrunk[active] | too_long
            durations[active] *= np.where(too_short, 2.0, np.where(too_long, 0.5, 1.0))
            active = active[too_short | too_long]
            if not active.size:
                break
        return durations

    def _of_rows(self, path: Path, rows: np.ndarray, levels: np.ndarray | float = 0.0) -> Functions:
        """Return quantities less levels, each at one time or at several, of the shape of the times (k,) or (k, m)."""

        def at(times: np.ndarray) -> np.ndarray:
            if not times.size:
                return np.zeros(times.shape)
            repeated = np.repeat(rows, times.size // rows.size)
            values = self._at(path, np.clip(times.ravel(), *self._reach(path)))[repeated, np.arange(times.size)]
            below: np.ndarray = np.reshape(levels, (-1, *(1,) * (times.ndim - 1)))
            return values.reshape(times.shape) - below

        return at

    # --- what the steps missed --------------------------------------------------------------
    def _suspects(
        self,
        path: Path,
        instants: np.ndarray,
        durations: np.ndarray,
        limits: np.ndarray,
        *,
        closely: bool = True,
    ) -> list[UnseenLoad]:
        """Intervals with instants of a load in which the change of the state is not the integral of its rates.

        Parameters
        ----------
        closely : bool
            False for a first look, at fewer points.
        """
        smooth = np.isfinite(durations)
        around = (instants[smooth, None] + durations[smooth, None] * AROUND).ravel()
        # a load may be zero at both of the switches between which it acts, and steps from one to the other miss it
        switches = np.unique(instants[~smooth])
        gaps = np.diff(switches)
        short = (gaps < np.max(np.diff(path.times))) & closely
        between = (switches[:-1, None] + gaps[:, None] * BETWEEN)[short].ravel()
        marks = np.concatenate([instants, around, between])
        rounding = SAME_INSTANT * float(np.max(np.diff(path.times)))
        marks = np.unique(marks[(marks > path.times[0] - rounding) & (marks < path.times[-1] + rounding)])
        # a mark at an output belongs to the intervals on both sides of it: a load may fill one from end to end
        before, behind = (
            np.clip(path.times.searchsorted(x, "right") - 1, 0, path.times.size - 2)
            for x in (marks - rounding, marks + rounding)
        )
        intervals = np.unique(np.r_[before, behind])
        inside = (marks > path.times[before] + rounding) & (marks < path.times[before + 1] - rounding)
        inside &= np.diff(marks, prepend=-np.inf) > rounding
        ends, owners = np.r_[marks[inside], path.times[intervals + 1]], np.r_[before[inside], intervals]
        order = np.argsort(ends)
        ends, owners = ends[order], owners[order]
        missed = self._missed(path, owners, ends, limits, 4 if closely else 2)
        return [UnseenLoad(int(k), ends[owners == k]) for k in missed]

    def _missed(
        self,
        path: Path,
        owners: np.ndarray,
        ends: np.ndarray,
        limits: np.ndarray,
        points: int = 4,
    ) -> np.ndarray:
        """Intervals in which the change of the state is not the integral of its rates (n,).

        Parameters
        ----------
        owners, ends : numpy.ndarray
            Intervals in increasing order, and ends of the parts over which the rates are smooth, the last one of each
            interval its end (k,).
        points : int
            Points of Gauss's quadrature over each part.
        """
        if not owners.size:
            return owners
        nodes, weights = gauss(points).points, gauss(points).weights
        is_first = np.diff(owners, prepend=-1) > 0
        begins = np.where(is_first, path.times[owners], np.r_[0.0, ends[:-1]])
        lengths = ends - begins
        times = (begins[:, None] + lengths[:, None] * nodes).ravel()
        rates = self._rates(path, times) * (lengths[:, None] * weights).ravel()[:, None]
        integral = np.add.reduceat(rates, nodes.size * np.flatnonzero(is_first))
        change = np.diff(path.x[:, self._numeric.eom.q.numel() :], axis=0)[owners[is_first]]
        missed: np.ndarray = owners[is_first][~np.all(np.abs(change - integral) <= limits, axis=1)]
        return missed

    def _from_its_begin(self, path: Path, load: UnseenLoad, limits: np.ndarray) -> UnseenLoad:
        """The load from the first of the intervals before it that the steps passed over just as well."""
        before = np.arange(load.interval)
        missed = self._missed(path, before, path.times[1 : load.interval + 1], limits)
        first = int(np.max(np.setdiff1d(before, missed), initial=-1)) + 1
        return UnseenLoad(first, np.r_[path.times[first + 1 : load.interval + 1], load.stops])

    def _rates(self, path: Path, times: np.ndarray) -> np.ndarray:
        """Rates of the velocities and first-order states on the path (k, n_x - n), or the integrands."""
        states = hermite_states(path, times, self._numeric.eom.q.numel())
        t, q, v, a, z, lam, u = self._stepper.outputs.block(times, states)
        if self._rate is None:
            return a
        rate = self._rate(t[None, :], q.T, v.T, a.T, z.T, lam.T, u.T, self._numeric.p).full().T
        return np.hstack([a, rate]) if self._moves else rate


def meets_loads(eom: Equations, signals: Signals, integrands: ca.SX | None = None) -> bool:
    """Return True if a motion may meet loads, or integrands that come and go, that steps pass over."""
    return bool(quantities_of(eom, signals, integrands).number)


def _duration(load: np.ndarray, spacing: float) -> float:
    """Time for which a load at equal spacing is above half of its peak, of several ones their mean, s."""
    high = load > np.max(load) / 2
    loads = int(np.sum(np.diff(high.astype(int), prepend=0) > 0))
    return spacing * int(np.sum(high)) / max(loads, 1)
