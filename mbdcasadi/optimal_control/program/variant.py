"""Variants of a program that are easier to solve than the program itself: a motion of one is a guess for the next.

A variant has the rows and the variables of its program, and other bounds. A sequence of variants that ends with the
program itself is a homotopy: limits that close in, or a motion that becomes faster.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...results.state import State
from ..transcription.mesh import Mesh
from .collocation_program import Bounds, CollocationProgram
from .limit_sides import LimitSides

#: Share of the limits of speeds and accelerations below which these do not count.
BELOW = 0.99


@dataclass(frozen=True)
class Variant:
    """A program with or without its limits, and with limits of speeds.

    Parameters
    ----------
    limits : bool, default True
        False if limits do not count; phases of free duration then end no earlier than in the guess, since a least time
        without limits has forces without end.
    speeds : sequence of numpy.ndarray, optional
        Largest speeds and accelerations of the independent coordinates by phase (2, n).
    """

    limits: bool = True
    speeds: tuple[np.ndarray, ...] | None = None

    @property
    def is_itself(self) -> bool:
        """True if a solution is one of the problem."""
        return self.limits and self.speeds is None

    def bounds(
        self,
        program: CollocationProgram,
        start: State,
        meshes: Sequence[Mesh],
        times: Sequence[np.ndarray],
        x: np.ndarray,
    ) -> Bounds:
        """Bounds of variables and rows, scaled, for a guess `x`; see :meth:`CollocationProgram.bounds`."""
        bounds = program.bounds(start, meshes, times, self.speeds)
        if self.limits:
            return bounds
        bounds = LimitSides(program).without(bounds)
        ends = [phase.stated_time_index[-1] for phase in program.phases if phase.time_count]
        lower = bounds.lower.copy()
        lower[ends] = np.clip(x[ends], bounds.lower[ends], bounds.upper[ends])
        return replace(bounds, lower=lower)

    def faster(self, factor: float) -> Variant:
        """Return the variant with speeds and accelerations that are higher by a factor."""
        assert self.speeds is not None
        return replace(self, speeds=tuple(factor * of_phase for of_phase in self.speeds))


#: The program itself, and without its limits.
ITSELF, WITHOUT_LIMITS = Variant(), Variant(limits=False)


def is_below(x: np.ndarray, limited: Bounds, free: Bounds) -> bool:
    """Return True if variables stay below the bounds that a variant adds to those of its program."""
    above = (limited.upper < free.upper) & (x > BELOW * limited.upper)
    under = (limited.lower > free.lower) & (x < BELOW * limited.lower)
    return not bool(np.any(above | under))
