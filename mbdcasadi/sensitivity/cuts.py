"""Instants at which a motion is cut, since its equations jump there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Cut:
    """An instant at which a motion is cut.

    Attributes
    ----------
    time : float
        s.
    interval : int
        Output interval in which it lies, the end of it included.
    at_output : bool
        True if it is the time of the output that ends the interval, which comes before it.
    joined : bool
        True if it is at the instant of the cut before.
    switches : tuple of int
        Switches that change their sides, by whose first one its derivative is found; none of a mere stop.
    border : float
        Value of the quantity of that one at its border.
    sides : tuple of float
        Sides of all switches afterwards.
    impulse : bool
        True if velocities jump.
    """

    time: float
    interval: int
    at_output: bool
    joined: bool
    switches: tuple[int, ...]
    border: float
    sides: tuple[float, ...]
    impulse: bool = False


@dataclass(frozen=True)
class Cuts:
    """The cuts of a motion at values of the parameters.

    Attributes
    ----------
    stops : numpy.ndarray
        Times over which no step may go, s.
    jumps : numpy.ndarray
        Times at which the equations jump, whatever the parameters are, s.
    max_step : float or None
        Longest step, s.
    cuts : tuple of Cut
        Instants that depend on the parameters, or at which sides change.
    sides : tuple of float
        Sides of the switches at the start.
    """

    stops: np.ndarray
    jumps: np.ndarray
    max_step: float | None
    cuts: tuple[Cut, ...] = ()
    sides: tuple[float, ...] = ()

    @property
    def pattern(self) -> tuple[Any, ...]:
        """Hashable: courses with the same pattern share compiled functions."""
        cuts = tuple((c.interval, c.at_output, c.joined, c.switches[:1], c.impulse) for c in self.cuts)
        return cuts, self.stops.tobytes(), self.jumps.tobytes(), self.max_step, len(self.sides)

    @property
    def arguments(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times of the cuts, sides of the switches in all pieces by column, and borders."""
        sides = np.array([self.sides, *(cut.sides for cut in self.cuts)]).T.reshape(-1, len(self.cuts) + 1)
        times = np.array([cut.time for cut in self.cuts])
        return times, sides, np.array([cut.border for cut in self.cuts])

    @property
    def symbols(self) -> list[ca.MX]:
        """Symbols for these arguments."""
        count = len(self.cuts)
        shapes = {"cuts": (count, 1), "sides": (len(self.sides), count + 1), "borders": (count, 1)}
        return [ca.MX.sym(name, *shape) for name, shape in shapes.items()]

    def with_cuts(self, grid: np.ndarray, cuts: Sequence[Cut], first_sides: np.ndarray) -> Cuts:
        """Return the course with cuts; in intervals of `grid` that are cut, stops and jumps are cuts too.

        What lies between them there may change.
        """
        cut_intervals, cuts = {cut.interval for cut in cuts}, list(cuts)
        kept: list[np.ndarray] = []
        tolerance = 1e-9 * float(grid[-1] - grid[0])
        for times in (self.stops, self.jumps):
            inside = times[(times > grid[0]) & (times < grid[-1])]
            intervals = np.searchsorted(grid, inside) - 1
            moved = np.isin(intervals, list(cut_intervals))
            kept.append(inside[~moved])
            for time, interval in zip(inside[moved], intervals[moved], strict=True):
                others = [*grid[interval : interval + 2], *[cut.time for cut in cuts]]
                if np.min(np.abs(np.array(others) - time)) > tolerance:
                    cuts.append(Cut(float(time), int(interval), False, False, (), 0.0, ()))
        cuts.sort(key=lambda cut: cut.time)
        sides = tuple(first_sides.tolist())
        filled, now = [], sides
        for cut in cuts:
            now = cut.sides or now
            filled.append(replace(cut, sides=now))
        return Cuts(kept[0], kept[1], self.max_step, tuple(filled), sides)
