"""Variants of a program that are easier to solve than the program itself: a motion of one is a guess for the next.

A variant has the rows and the variables of its program, and other bounds. A sequence of variants that ends with the
program itself is a homotopy, such as limits that close in.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...results.state import State
from ..transcription.mesh import Mesh
from .collocation_program import Bounds, CollocationProgram
from .limit_sides import LimitSides


@dataclass(frozen=True)
class Variant:
    """A program with or without its limits.

    Parameters
    ----------
    limits : bool, default True
        False if limits do not count; phases of free duration then end no earlier than in the guess, since a least time
        without limits has forces without end.
    """

    limits: bool = True

    @property
    def is_itself(self) -> bool:
        """True if a solution is one of the problem."""
        return self.limits

    def bounds(
        self,
        program: CollocationProgram,
        start: State,
        meshes: Sequence[Mesh],
        times: Sequence[np.ndarray],
        x: np.ndarray,
    ) -> Bounds:
        """Bounds of variables and rows, scaled, for a guess `x`; see :meth:`CollocationProgram.bounds`."""
        bounds = program.bounds(start, meshes, times)
        if self.limits:
            return bounds
        bounds = LimitSides(program).without(bounds)
        ends = [phase.stated_time_index[-1] for phase in program.phases if phase.time_count]
        lower = bounds.lower.copy()
        lower[ends] = np.clip(x[ends], bounds.lower[ends], bounds.upper[ends])
        return replace(bounds, lower=lower)


#: The program itself, and without its limits.
ITSELF, WITHOUT_LIMITS = Variant(), Variant(limits=False)
