"""Sides of the limits of a program: rows and variables that one limit bounds, and bounds that are loosened."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from .collocation_program import CollocationProgram
from .limits import variable_bounds
from .solvers.base import Bounds


@dataclass(frozen=True)
class Side:
    """Places that a limit bounds: rows and variables, from above and from below."""

    rows_above: list[int] = field(default_factory=list)
    rows_below: list[int] = field(default_factory=list)
    above: list[int] = field(default_factory=list)
    below: list[int] = field(default_factory=list)


class LimitSides:
    """Limits that hold throughout the phases of a program, by label.

    With `conditions`, those at places count too, and equalities with both sides.
    """

    def __init__(self, program: CollocationProgram, *, conditions: bool = False):
        self.sides: dict[str, Side] = {}
        throughout = [{c.label for c in (*p.phase.path, *p.limit_owners)} for p in program.phases]
        for k, row in enumerate(program.rows):
            held = row.phase >= 0 and row.label in throughout[row.phase] and not row.equality
            if not row.condition or not (held or conditions):
                continue
            self._side(row.label).rows_above.append(k)
            if row.equality or np.isfinite(row.lower):
                self._side(row.opposite or row.label).rows_below.append(k)
        for phase in program.phases:
            for bound in variable_bounds(phase) if phase.count else ():
                side = self._side(bound.label)
                places = side.above if bound.sign > 0 else side.below
                if bound.place not in places[-1:]:
                    places.append(bound.place)

    def _side(self, label: str) -> Side:
        return self.sides.setdefault(label, Side())

    def without(self, bounds: Bounds) -> Bounds:
        """Bounds without these limits."""
        return self.loosened(bounds, dict.fromkeys(self.sides, np.inf))

    def loosened(self, bounds: Bounds, amounts: dict[str, float]) -> Bounds:
        """Bounds whose limits may be passed by amounts, scaled, by label."""
        names = ("lower", "upper", "rows_lower", "rows_upper")
        lower, upper, rows_lower, rows_upper = (getattr(bounds, name).copy() for name in names)
        for label, amount in amounts.items():
            side = self.sides[label]
            upper[side.above] += amount
            lower[side.below] -= amount
            rows_upper[side.rows_above] += amount
            rows_lower[side.rows_below] -= amount
        return replace(bounds, lower=lower, upper=upper, rows_lower=rows_lower, rows_upper=rows_upper)

    def excess(self, bounds: Bounds, x: np.ndarray, rows: np.ndarray) -> dict[str, float]:
        """Largest amounts by which limits are passed, scaled, by label; those that hold are left out."""
        amounts = {}
        for label, side in self.sides.items():
            parts = [
                rows[side.rows_above] - bounds.rows_upper[side.rows_above],
                bounds.rows_lower[side.rows_below] - rows[side.rows_below],
                x[side.above] - bounds.upper[side.above],
                bounds.lower[side.below] - x[side.below],
            ]
            most = float(np.max(np.concatenate(parts), initial=0.0))
            if most > 0:
                amounts[label] = most
        return amounts
