"""The growing record of a run: what was reached, whatever happens next."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from ..model.mechanism import Mechanism
from ..results.trajectory import EventOccurrence, Statistics, Trajectory


class Record:
    """Blocks of outputs, joined into a trajectory when asked for.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    p : numpy.ndarray
        Parameter values.
    refine : callable or None
        How the trajectory interpolates.
    """

    def __init__(self, mechanism: Mechanism, p: np.ndarray, refine: Callable[..., tuple[np.ndarray, ...]] | None):
        self.mechanism = mechanism
        self.p = p
        self.refine = refine
        self.events: list[EventOccurrence] = []
        self.statistics = Statistics()
        self._blocks: list[Sequence[np.ndarray]] = []

    def add(self, *block: np.ndarray) -> None:
        """Append ``t, q, v, a, z, lam, u`` of some outputs, each by row."""
        self._blocks.append(block)

    @property
    def last_time(self) -> float:
        """Time of the last output."""
        return float(self._blocks[-1][0][-1])

    def trajectory(self) -> Trajectory:
        """Everything so far."""
        t, q, v, a, z, lam, u = (np.concatenate(parts) for parts in zip(*self._blocks, strict=True))
        return Trajectory(
            self.mechanism,
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
            refine=self.refine,
        )
