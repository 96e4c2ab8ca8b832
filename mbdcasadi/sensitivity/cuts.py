"""Instants at which a motion is cut, since its equations jump there, and warnings of one-sided derivatives."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ..equations.switching.switches import Switch
from ..errors import warn


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
        Times that no step may cross, s.
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


class OneSidedWarnings:
    """Warnings of switches at which the derivatives to both sides differ: at an output, or several at one instant.

    Parameters
    ----------
    unmoved : collection of int
        Switches in time whose instants no parameter moves: these have no derivative of their own.
    differentiates : bool
        False if nothing is differentiated, so that no warning is due.
    """

    def __init__(self, unmoved: Collection[int], *, differentiates: bool):
        self._unmoved, self._warned = frozenset(unmoved), set[str]()
        self._differentiates = differentiates

    def report(self, cuts: Sequence[Cut], switches: Sequence[Switch]) -> None:
        """Warn of the cuts of a motion by some switches."""
        together: list[str] = []
        previous: Cut | None = None
        for cut in (c for c in cuts if c.switches):
            first = switches[cut.switches[0]]
            names = [first.description] if first.node not in self._unmoved else []
            together = together if previous is not None and cut.joined and cut.time == previous.time else []
            previous, before = cut, together
            together = [*before, *names]
            if before and names:
                self._warn_once(
                    f"{' and '.join(dict.fromkeys(together))} jump together at t = {cut.time:.6g} s, in an order that "
                    "changes with the parameters: derivatives from there on are one-sided, for the order taken"
                )
            elif names and cut.at_output:
                self.at_output(names[0], cut.time)

    def at_output(self, name: str, time: float) -> None:
        """Warn of a switch at an output."""
        self._warn_once(
            f"{name} jumps at the output t = {time:.6g} s: derivatives at this output are one-sided, those before "
            "the jump; move the output off the jump"
        )

    def _warn_once(self, sentence: str) -> None:
        if self._differentiates and sentence not in self._warned:
            self._warned.add(sentence)
            warn(sentence)
