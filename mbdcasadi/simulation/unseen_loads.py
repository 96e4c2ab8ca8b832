"""Loads that come and go between two steps of an integrator, which leave no trace in them.

A body at rest, or in uniform motion, lets a method with an adaptive step take steps as long as the run: over a bump
of a road, a force that acts in a short range of a coordinate, a pulse that a flywheel triggers. The graph of the
equations shows what may switch or pass quickly as the motion goes on: the operands of comparisons, of absolute values,
of exponential functions. Their zeros and extrema are looked for on the path between the outputs; around these the
accelerations on the path are integrated and compared with the change of the velocities that the steps found.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..equations.switch_functions import state_switches
from ..integrators.compiled import IntegrationFailure
from .outputs import Outputs
from .path import Path, hermite_states
from .watched_terms import has_gap

#: Points of each output interval at which the quantities are evaluated.
POINTS = 9
#: Steps of bisection and of the golden section towards zeros and extrema.
STEPS = 28
#: Stops around the middle of a transient, in its durations.
AROUND = np.array([-4.0, -2.0, -1.0, -0.5, 0.0, 0.5, 1.0, 2.0, 4.0])
#: Transients that last longer than this many output intervals are noticed by the steps.
LONG = 8.0
#: Change of the state that the steps missed, in tolerances, from which a load counts as unseen: errors of a step, of
#: its dense output, and of the path between outputs are below it.
MISSED = 30.0
#: Instants closer than this share of an output interval are one.
SAME_INSTANT = 1e-7
#: Nodes and weights of Gauss's quadrature over [0, 1].
_NODES, _WEIGHTS = (part / 2 for part in np.polynomial.legendre.leggauss(4))
_NODES = _NODES + 0.5
_GOLDEN = (np.sqrt(5.0) - 1) / 2


@dataclass(frozen=True)
class UnseenLoad:
    """A stretch of a path over which the steps of an integrator passed without its load.

    Attributes
    ----------
    interval : int
        Output interval of the path.
    stops : numpy.ndarray
        Times over which no step may go, the last one the end of the interval, s.
    duration : float
        Time for which it is above half of its peak, s.
    """

    interval: int
    stops: np.ndarray
    duration: float


class UnseenLoads:
    """Looks for loads on the path of a run that its integrator stepped over.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        Inputs, of which expressions may switch with the motion too.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals):
        self._numeric = numeric
        eom = numeric.eom
        switches, transients = state_quantities(numeric, signals)
        self._count = len(switches)
        column = ca.vertcat(ca.SX(0, 1), *switches, *transients)
        self.watched = column.numel()
        if self.watched:
            self._quantities = ca.Function("quantities", [eom.t, eom.q, eom.v, eom.z, eom.p], [ca.densify(column)])
        self._z_rate = eom.function(eom.z_rate) if eom.z.numel() else None
        self._threshold = MISSED

    def first(
        self,
        path: Path,
        outputs: Outputs,
        way_from: Callable[[float, np.ndarray], Callable[[np.ndarray], np.ndarray]],
        reltol: float,
        abstol: float,
    ) -> UnseenLoad | None:
        """First load on a path that its steps missed; None if there is none.

        Parameters
        ----------
        path : Path
            Between the outputs of an integrator.
        outputs : Outputs
            Makes accelerations of states.
        way_from : callable
            ``(time, x) -> (times -> states)``: short integrations, by which a suspicion is verified.
        reltol, abstol : float
            Tolerances of the integrator.
        """
        if not self.watched or path.times.size < 2:
            return None
        instants, durations = self._instants(path)
        if not instants.size:
            return None
        n = self._numeric.eom.q.numel()
        for load in self._suspects(path, outputs, instants, durations, reltol, abstol):
            k = load.interval
            try:
                found = way_from(float(path.times[k]), path.x[k])(load.stops)[-1]
            except IntegrationFailure:  # the run itself will say why
                return load
            missed = np.abs(found - path.x[k + 1])[n:]
            if np.any(missed > self._limits(path, reltol, abstol)):
                return load
            # the path between outputs was not what the integrator followed
            self._threshold *= 2
        return None

    def _limits(self, path: Path, reltol: float, abstol: float) -> np.ndarray:
        """Errors of velocities and first-order states that do not count (n_x - n,)."""
        n, bodies = self._numeric.eom.q.numel(), len(self._numeric.eom.mechanism.bodies)
        size = np.max(np.abs(path.x[:, n:]), axis=0, initial=0.0)
        size[: 3 * bodies] = np.max(size[: 3 * bodies], initial=0.0)
        limits: np.ndarray = self._threshold * (reltol * size + abstol)
        return limits

    # --- where something may happen -------------------------------------------------------
    def _at(self, path: Path, times: np.ndarray) -> np.ndarray:
        """Quantities on the path (quantities, k)."""
        n = self._numeric.eom.q.numel()
        x = hermite_states(path, times, n)
        q, v, z = x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]
        return self._quantities(times[None, :], q.T, v.T, z.T, self._numeric.p).full()

    def _instants(self, path: Path) -> tuple[np.ndarray, np.ndarray]:
        """Instants at which quantities are zero, largest or smallest, and durations there; infinite at switches."""
        lengths = np.diff(path.times)
        share = np.arange(POINTS - 1) / (POINTS - 1)
        times = np.r_[(path.times[:-1, None] + lengths[:, None] * share).ravel(), path.times[-1]]
        values = self._at(path, times)
        step = float(np.max(lengths))
        found, durations = [np.zeros(0)], [np.zeros(0)]
        with np.errstate(all="ignore"):
            rows, places = np.nonzero(np.sign(values[:, :-1]) * np.sign(values[:, 1:]) < 0)
            roots = self._roots(path, rows, times[places], times[places + 1], values[rows, places])
            rows_at, places_at = np.nonzero((values[:, 1:-1] == 0) & np.any(values != 0, axis=1)[:, None])
            rows, roots = np.r_[rows, rows_at], np.r_[roots, times[1:-1][places_at]]
            rises = np.diff(values, axis=1)
            turns, middles = np.nonzero(rises[:, :-1] * rises[:, 1:] < 0)
            tops = self._extrema(path, turns, times[middles], times[middles + 2], values[turns, middles + 1])
            at_top, before, after = self._of_rows(path, turns, tops), values[turns, middles], values[turns, middles + 2]
            # a quantity that is beyond zero between two points alone
            there = (np.sign(at_top) * np.sign(values[turns, middles + 1]) < 0) & (turns < self._count)
            for low, high, at_low, at_high in (
                (times[middles], tops, before, at_top),
                (tops, times[middles + 2], at_top, after),
            ):
                inside = there & (np.sign(at_low) * np.sign(at_high) < 0)
                crossed = self._roots(path, turns[inside], low[inside], high[inside], at_low[inside])
                rows, roots = np.r_[rows, turns[inside]], np.r_[roots, crossed]
            switching = rows < self._count
            found.append(roots[switching])
            durations.append(np.full(int(np.sum(switching)), np.inf))
            rest = ~switching
            width = 1e-4 * step
            ahead, behind = (self._of_rows(path, rows[rest], roots[rest] + side) for side in (width, -width))
            found.append(roots[rest])
            durations.append(2 * width / np.abs(ahead - behind))
            smooth = turns >= self._count
            half = (times[middles + 2] - times[middles])[smooth] / 2
            bend = np.abs(before - 2 * values[turns, middles + 1] + after)[smooth] / half**2
            found.append(tops[smooth])
            durations.append(np.sqrt(2 / bend))
        instants, lasts = np.concatenate(found), np.concatenate(durations)
        counts = np.isfinite(instants) & (np.isinf(lasts) | (lasts < LONG * step))
        return instants[counts], lasts[counts]

    def _of_rows(self, path: Path, rows: np.ndarray, times: np.ndarray) -> np.ndarray:
        """One quantity at each of some times (k,)."""
        if not times.size:
            return np.zeros(0)
        times = np.clip(times, path.times[0], path.times[-1])
        found: np.ndarray = self._at(path, times)[rows, np.arange(times.size)]
        return found

    def _roots(self, path: Path, rows: np.ndarray, low: np.ndarray, high: np.ndarray, at_low: np.ndarray) -> np.ndarray:
        """Zeros in brackets, all at once, by halving (k,)."""
        for _ in range(STEPS if rows.size else 0):
            middle = (low + high) / 2
            same = np.sign(self._of_rows(path, rows, middle)) == np.sign(at_low)
            low, high = np.where(same, middle, low), np.where(same, high, middle)
        return (low + high) / 2

    def _extrema(
        self, path: Path, rows: np.ndarray, low: np.ndarray, high: np.ndarray, inside: np.ndarray
    ) -> np.ndarray:
        """Extrema in brackets, all at once, by the golden section (k,)."""
        if not rows.size:
            return np.zeros(0)
        sign = np.where(inside > self._of_rows(path, rows, low), 1.0, -1.0)
        for _ in range(STEPS):
            first, second = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
            left = sign * self._of_rows(path, rows, first) > sign * self._of_rows(path, rows, second)
            low, high = np.where(left, low, first), np.where(left, second, high)
        return (low + high) / 2

    # --- what the steps missed --------------------------------------------------------------
    def _suspects(
        self,
        path: Path,
        outputs: Outputs,
        instants: np.ndarray,
        durations: np.ndarray,
        reltol: float,
        abstol: float,
    ) -> list[UnseenLoad]:
        """Intervals in which the change of the state is not the integral of its rates on the path."""
        smooth = np.isfinite(durations)
        marks = np.concatenate([instants, (instants[smooth, None] + durations[smooth, None] * AROUND).ravel()])
        marks = np.unique(marks[(marks > path.times[0]) & (marks < path.times[-1])])
        rounding = SAME_INSTANT * float(np.max(np.diff(path.times)))
        owner = np.searchsorted(path.times, marks, side="right") - 1
        intervals = np.unique(owner)
        parts, stops = [], {}
        for k in intervals:
            start, end = float(path.times[k]), float(path.times[k + 1])
            inside = marks[owner == k]
            inside = inside[(inside > start + rounding) & (inside < end - rounding)]
            inside = inside[np.diff(inside, prepend=start) > rounding] if inside.size else inside
            stops[int(k)] = np.r_[inside, end]
            borders = np.r_[start, inside, end]
            parts.append(np.column_stack([np.full(borders.size - 1, k), borders[:-1], np.diff(borders)]))
        if not parts:
            return []
        of, begins, lengths = np.vstack(parts).T
        times = (begins[:, None] + lengths[:, None] * _NODES).ravel()
        weights = (lengths[:, None] * _WEIGHTS).ravel()
        rates = self._rates(path, outputs, times)
        n = self._numeric.eom.q.numel()
        places = np.searchsorted(intervals, np.repeat(of, _NODES.size).astype(int))
        integral = np.zeros((intervals.size, rates.shape[1]))
        np.add.at(integral, places, rates * weights[:, None])
        change = np.diff(path.x[:, n:], axis=0)[intervals]
        share = np.abs(change - integral) / self._limits(path, reltol, abstol)
        found = []
        for row in np.flatnonzero(~np.all(share <= 1, axis=1)):
            k, worst = int(intervals[row]), int(np.argmax(share[row]))
            own = places == row
            load = np.abs(rates[own, worst] - change[row, worst] / (path.times[k + 1] - path.times[k]))
            found.append(UnseenLoad(k, stops[k], _duration(load, weights[own])))
        return found

    def _rates(self, path: Path, outputs: Outputs, times: np.ndarray) -> np.ndarray:
        """Rates of the velocities and first-order states on the path (k, n_x - n)."""
        states = hermite_states(path, times, self._numeric.eom.q.numel())
        t, q, v, a, z, lam, u = outputs.block(times, states)
        if self._z_rate is None:
            return a
        z_rate = self._z_rate(t[None, :], q.T, v.T, a.T, z.T, lam.T, u.T, self._numeric.p).full().T
        return np.hstack([a, z_rate])


def _duration(load: np.ndarray, weights: np.ndarray) -> float:
    """Time for which a load is above half of its peak, of several ones their mean, s."""
    high = load > np.max(load) / 2
    loads = int(np.sum(np.diff(high.astype(int), prepend=0) > 0))
    return float(np.sum(weights[high])) / max(loads, 1)


def state_quantities(numeric: NumericEquations, signals: Signals) -> tuple[list[ca.SX], list[ca.SX]]:
    """Quantities of a motion at whose zeros the equations switch, and at whose zeros or extrema loads pass quickly.

    Contacts, stops and smoothed friction are left out: these are watched by :class:`~.resolution.Resolution`.
    """
    eom = numeric.eom
    inputs = ca.SX(eom.u)
    for k, kind in enumerate(signals.structure):
        if isinstance(kind, tuple) and kind[0] == "expression":
            inputs[k] = signals.expressions[k]
    elements = [e for e in eom.mechanism.elements if not has_gap(e) and not getattr(e, "smoothings", ())]
    loads = [ca.vec(ca.SX(x)) for e in elements for pair in e.virtual_work for x in pair]
    loads += [ca.vec(ca.SX(rate)) for rate in eom.mechanism.state_rates.values()]
    loads += [eom.Phi, eom.velocity_rows]
    everything = ca.vertcat(ca.SX(0, 1), *loads)
    if eom.u.numel() and ca.depends_on(everything, eom.u):
        everything = ca.substitute(everything, eom.u, inputs)
    unknown = ca.vertcat(eom.a, eom.lam, eom.u)
    state = ca.vertcat(eom.q, eom.v, eom.z)
    return state_switches(everything, state, unknown)
