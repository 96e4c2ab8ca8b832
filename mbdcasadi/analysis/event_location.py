"""Events between two outputs, located by integrating again to trial times."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ModelError
from ..model.events import Event
from ..numerics.roots import bracketed_root


class EventWatch:
    """Looks for events among consecutive outputs.

    Parameters
    ----------
    eom : Equations
        Equations of the mechanism.
    events : sequence of Event
        What to look for.
    """

    def __init__(self, eom: Equations, events: Sequence[Event]):
        self.events = tuple(events)
        for event in self.events:
            if not isinstance(event, Event):
                raise ModelError(f"events= takes Event objects, got {event!r}")
        names = [event.name for event in self.events]
        if len(set(names)) < len(names):
            raise ModelError(f"events= holds a name twice: {', '.join(names)}")
        self._values = eom.function(ca.vertcat(ca.SX(0, 1), *[e.expression for e in self.events]))

    def values(self, arguments: Sequence[np.ndarray]) -> np.ndarray:
        """Expressions of all events at outputs (k, n_events); arguments by row, parameters last."""
        *by_row, p = arguments
        return self._values(*[np.atleast_2d(x).T for x in by_row], p).full().T

    @staticmethod
    def _crossed(event: Event, before: float, after: float) -> bool:
        rising, falling = before < 0 <= after, before > 0 >= after
        return rising if event.direction > 0 else falling if event.direction < 0 else rising or falling

    def crossings(self, before: np.ndarray, after: np.ndarray) -> list[int]:
        """Events that take place between two outputs, by index."""
        return [k for k, e in enumerate(self.events) if self._crossed(e, before[k], after[k])]

    def locate(
        self,
        index: int,
        low: float,
        high: float,
        before: float,
        after: float,
        value_at: Callable[[float], np.ndarray],
    ) -> float:
        """Time of an event between two outputs, to rounding."""
        accuracy = 4e-16 * max(abs(low), abs(high)) + 1e-13 * (high - low)
        return bracketed_root(lambda time: float(value_at(time)[index]), low, high, before, after, accuracy)
