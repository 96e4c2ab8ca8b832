"""States that a stretch returns: the ends of steps, and outputs inside them, which are projected all at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..native.stretch import ACCURACY, LOOSE, PROJECTIONS, ExplicitSystem, Stretch
from .step_functions import Steps


class _Part(NamedTuple):
    """The end of a step, or outputs inside it, which are still to be brought onto the constraints.

    Attributes
    ----------
    times, places : numpy.ndarray
        Times and their places among those of the stretch, or -1 (k,).
    rows : numpy.ndarray
        States and integrals (k, n_y).
    inside : bool
        True for outputs inside a step.
    """

    times: np.ndarray
    places: np.ndarray
    rows: np.ndarray
    inside: bool


#: What is joined of the parts.
_PARTS = ("rows", "times", "places")


class Recording:
    """States of a stretch, step by step.

    Parameters
    ----------
    steps : Steps
        The present step.
    system : ExplicitSystem
        The equations.
    s : Stretch
        The stretch.

    Attributes
    ----------
    times : list of float
        Times of the stretch.
    reached : int
        Number of them that were reached.
    """

    def __init__(self, steps: Steps, system: ExplicitSystem, s: Stretch):
        self._f, self._system, self._s = steps, system, s
        self.times, self.reached = s.times.tolist(), 0
        self._parts: list[_Part] = []

    @property
    def is_complete(self) -> bool:
        """True if the last time was reached."""
        return self.reached == len(self.times)

    @property
    def last_time(self) -> float:
        """Last time that is kept; that of the start if none is."""
        return float(self._parts[-1].times[-1]) if self._parts else self._s.start

    def add(self, t: float, y: np.ndarray, index: int) -> None:
        """Keep the end of a step."""
        self._parts.append(_Part(np.array([t]), np.array([index]), y[None].copy(), inside=False))

    def arrive(self, t: float, y: np.ndarray, *, keep: bool) -> bool:
        """Keep the end of a step if a time of the stretch is due there, or in any case; return True if one is."""
        due = not self.is_complete and self.times[self.reached] == t
        if due or keep:
            self.add(t, y, self.reached if due else -1)
        self.reached += due
        return due

    def add_inside(self, t: float, h: float, end: float, samples: int) -> None:
        """Keep outputs inside the present step, and evenly spread samples, in order of time."""
        times, first = self.times, self.reached
        while self.reached < len(times) and times[self.reached] < end:
            self.reached += 1
        inside, index = self._s.times[first : self.reached], np.arange(first, self.reached)
        if samples:
            between = t + h * np.arange(1, samples + 1) / (samples + 1)
            between = between[(between > t) & (between < end) & ~np.isin(between, inside)]
            inside, index = np.r_[inside, between], np.r_[index, np.full(between.size, -1)]
            order = np.argsort(inside, kind="stable")
            inside, index = inside[order], index[order]
        self._parts.append(_Part(inside, index, self._f.inside((inside - t) / h), inside=True))

    def states(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, bool]:
        """Return times, their places among those of the stretch, states on the constraints, and if these are all.

        They end before the first state that cannot be brought onto the constraints.
        """
        times, index, rows, inside = self._rows()
        count = self._brought_onto_constraints(times, rows, inside)
        return times[:count], index[:count], rows[:count], count == len(rows)

    def _rows(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Times, places among the times of the stretch, states, and which are inside steps, not on the constraints."""
        kept = self._parts
        if not kept:
            return np.zeros(0), np.zeros(0, np.int64), np.zeros((0, self._f.functions.n_y)), np.zeros(0, bool)
        rows, times, index = (np.concatenate([getattr(part, name) for part in kept]) for name in _PARTS)
        inside = np.repeat([part.inside for part in kept], [part.times.size for part in kept])
        return times, index.astype(np.int64), rows, inside

    def _brought_onto_constraints(self, times: np.ndarray, rows: np.ndarray, inside: np.ndarray) -> int:
        """Project the outputs inside steps, in place; the number of rows up to the first that cannot be."""
        n, s, most = self._system.coordinates, self._s, len(rows)
        waiting = np.flatnonzero(inside) if self._system.multipliers else np.zeros(0, int)
        before = np.full(most, np.inf)
        for _ in range(PROJECTIONS):
            if not waiting.size:
                break
            columns = times[waiting, None], rows[waiting, :n], rows[waiting, n : 2 * n]
            q, v, left = self._f.functions.projection_rows.rows(*columns, s.p, s.weights)
            rest = np.where(np.isfinite(left[:, 0]), left[:, 0], np.inf)
            finite = np.isfinite(rest)
            rows[waiting[finite], :n], rows[waiting[finite], n : 2 * n] = q[finite], v[finite]
            size = 1.0 + np.max(np.abs(rows[waiting, :n]), axis=1, initial=0.0)
            done = rest <= ACCURACY * size
            stuck = ~done & (rest >= before[waiting] / 2)
            failed = ~finite | (stuck & (rest > LOOSE * size))
            most = min([most, *waiting[failed].tolist()])
            before[waiting] = rest
            waiting = waiting[~(done | stuck | failed)]
        return min([most, *waiting[before[waiting] > LOOSE].tolist()])
