"""The growing record of a run: what was reached, whatever happens next."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..results.steps import Interpolation
from ..results.trajectory import EventOccurrence, Statistics, Trajectory
from .changes.modes import Block, Modes


@dataclass
class Span:
    """A part of a run in one mode, in which nothing jumps.

    Attributes
    ----------
    mode : hashable
        The mode.
    levels : numpy.ndarray
        Values of the inputs that are numbers.
    first : int
        Number of its first output.
    start, x : float, numpy.ndarray
        Time and state at its start.
    end, last : float, numpy.ndarray
        Time and state at its end; None of the last span, which ends with its last output.
    """

    mode: Any
    levels: np.ndarray
    first: int
    start: float
    x: np.ndarray
    end: float | None = None
    last: np.ndarray | None = None


#: ``(spans, t, arrays) -> interpolation`` of the outputs ``q, v, a, z, lam, u`` at times t.
Interpolating = Callable[[Sequence[Span], np.ndarray, Any], Interpolation]


class TrajectoryBuilder:
    """Blocks of outputs in the modes of a run, joined into a trajectory when asked for.

    Attributes
    ----------
    events : list of EventOccurrence
        Events that took place.
    statistics : Statistics
        Statistics of the integration.
    """

    def __init__(self, modes: Modes, p: np.ndarray):
        self.modes, self.p = modes, p
        self.events: list[EventOccurrence] = []
        self.statistics = Statistics()
        self.blocks: list[Block] = []
        self._spans: list[Span] = []
        self._count = 0

    def enter(self, time: float, x: np.ndarray, mode: Any) -> None:
        """Note that the motion goes on from a state in a mode."""
        self._spans.append(Span(mode, self.modes.levels.copy(), self._count, time, x))

    def leave(self, time: float, x: np.ndarray) -> None:
        """Note the state at which the motion jumps, or its equations change."""
        if self._spans:
            self._spans[-1].end, self._spans[-1].last = time, x

    def add(self, mode: Any, block: Block) -> None:
        """Append some outputs in a mode."""
        if block[0].size:
            self.blocks.append(self.modes.whole_block(mode, block))
            self._count += block[0].size

    @property
    def is_empty(self) -> bool:
        """True if there are no outputs yet."""
        return not self.blocks

    @property
    def last_time(self) -> float:
        """Time of the last output."""
        return float(self.blocks[-1][0][-1])

    def trajectory(self, interpolating: Interpolating) -> Trajectory:
        """Return everything so far, with the motion between the outputs."""
        t, *arrays = [np.concatenate(parts) for parts in zip(*self.blocks, strict=True)]
        q, v, a, z, lam, u = arrays
        return Trajectory(
            self.modes.mechanism,
            t,
            q,
            v,
            a,
            z,
            lam,
            u,
            self.p,
            events=self.events,
            statistics=self.statistics,
            interpolation=interpolating(list(self._spans), t, (q, v, a, z, lam, u)),
        )
