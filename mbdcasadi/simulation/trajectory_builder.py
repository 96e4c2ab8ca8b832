"""The growing record of a run: what was reached, whatever happens next."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..results.trajectory import EventOccurrence, Statistics, Trajectory
from .changes.modes import Block, Modes

#: ``(t, q, v, z, u) -> (q, v, a, lam, u)``: interpolated states brought back onto the constraints.
Refine = Callable[..., tuple[np.ndarray, ...]]


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
        self._blocks: list[Block] = []
        self._spans: list[tuple[float, Any, Refine]] = []

    def enter(self, time: float, mode: Any, refine: Refine) -> None:
        """Note that a mode holds from a time on, and how states in it are interpolated."""
        self._spans.append((time, mode, refine))

    def add(self, mode: Any, block: Block) -> None:
        """Append some outputs in a mode."""
        if block[0].size:
            self._blocks.append(self.modes.whole_block(mode, block))

    @property
    def is_empty(self) -> bool:
        """True if there are no outputs yet."""
        return not self._blocks

    @property
    def last_time(self) -> float:
        """Time of the last output."""
        return float(self._blocks[-1][0][-1])

    def trajectory(self) -> Trajectory:
        """Return everything so far."""
        t, q, v, a, z, lam, u = [np.concatenate(parts) for parts in zip(*self._blocks, strict=True)]
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
            refine=self._refined(),
        )

    def _refined(self) -> Refine:
        """Interpolation in the mode that holds at each time."""
        spans, modes = list(self._spans), self.modes
        starts = np.array([start for start, *_ in spans])

        def refined(
            t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
        ) -> tuple[np.ndarray, ...]:
            which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
            parts: list[tuple[np.ndarray, ...]] = []
            for k in np.unique(which):
                rows = which == k
                _, mode, refine = spans[k]
                own_q, own_v, a, lam, own_u = refine(t[rows], q[rows], v[rows], z[rows], u[rows])
                block = modes.whole_block(mode, (t[rows], own_q, own_v, a, z[rows], lam, own_u))
                parts.append((np.flatnonzero(rows), own_q, own_v, a, block[5], own_u))
            rows, *columns = (np.concatenate(part) for part in zip(*parts, strict=True))
            order = np.argsort(rows)
            q, v, a, lam, u = (column[order] for column in columns)
            return q, v, a, lam, u

        return refined
