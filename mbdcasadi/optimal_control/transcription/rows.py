"""Equations and limits of a transcription, each row with its label and its unit."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import numpy as np

from ...model.conditions import Condition


class Row(NamedTuple):
    """One row of a program; see :class:`Rows`.

    ``phase`` and ``interval`` say where it stands, by index (-1: nowhere); ``repeated`` is true for a row that
    every interval has, false for one of a single place. ``lower`` is its lower bound, scaled.
    """

    label: str
    unit: str
    size: float
    equality: bool
    condition: bool
    phase: int
    interval: int
    repeated: bool
    tau: float
    lower: float
    opposite: str

    def side(self, value: float) -> str:
        """Label of the side on which a value, or a multiplier, lies."""
        return self.opposite if self.opposite and value < 0 else self.label


@dataclass(frozen=True)
class Rows:
    """A group of equations or limits on one interval."""

    #: (k,); zero, or not above zero for limits
    expression: ca.SX
    #: description of each row, in words
    labels: tuple[str, ...]
    #: point of the interval at which it holds, 0 to 1
    tau: float
    #: size of each row by which it is divided (k,)
    scale: np.ndarray
    units: tuple[str, ...]
    #: whether the rows are zero, or stay below it
    equality: bool = True
    #: whether the user stated them: their multipliers are reported
    condition: bool = False
    #: amount by which each limit may fall below zero, in its unit (k,), and labels of the lower sides: two-sided limits
    spans: np.ndarray | None = None
    opposites: tuple[str, ...] = ()

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds of the rows, scaled: zero for equalities."""
        if self.equality:
            return np.zeros(len(self.labels))
        return np.full(len(self.labels), -np.inf) if self.spans is None else -self.spans / self.scale

    def on(self, phase: int, interval: int, *, repeated: bool) -> list[Row]:
        """The rows one by one, on an interval of a phase."""
        opposites = self.opposites or ("",) * len(self.labels)
        entries = zip(self.labels, self.units, self.scale.tolist(), self.lower.tolist(), opposites, strict=True)
        where = phase, interval, repeated, self.tau
        return [
            Row(label, unit, size, self.equality, self.condition, *where, lower, opposite)
            for label, unit, size, lower, opposite in entries
        ]

    def first(self, count: int) -> Rows:
        """The first rows of the group."""
        return self._part(slice(0, count))

    def after(self, count: int) -> Rows:
        """The group without its first rows."""
        return self._part(slice(count, len(self.labels)))

    def _part(self, which: slice) -> Rows:
        expression, labels, units = self.expression[which], self.labels[which], self.units[which]
        return replace(self, expression=expression, labels=labels, scale=self.scale[which], units=units)


def violations(rows: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Amounts by which scaled rows are above zero, or below their lower bounds, which are zero for equalities."""
    return np.maximum(np.maximum(rows, lower - rows), 0.0)


def stack(groups: list[Rows]) -> ca.SX:
    """All rows of groups, scaled, as one column."""
    filled = [group for group in groups if group.labels]
    sizes = np.concatenate([np.zeros(0), *[group.scale for group in filled]])
    return ca.vertcat(ca.SX(0, 1), *[group.expression for group in filled]) / ca.DM(sizes)


def condition_rows(
    values: dict[Condition, ca.SX], sizes: dict[Condition, float], tau: float, prefix: str = ""
) -> list[Rows]:
    """Conditions with their values at a place: equalities, and limits, of which two-sided ones are one row."""
    groups = []
    lower_sides = {c.opposite for c in values if c.opposite in values}
    for equality, definition in ((True, False), (False, False), (False, True)):
        chosen = [c for c in values if (c.equality, c.definition) == (equality, definition) and c not in lower_sides]
        if chosen:
            pairs = [c.opposite if c.opposite in lower_sides else None for c in chosen]
            group = Rows(
                ca.vertcat(*[values[c] for c in chosen]),
                tuple(prefix + c.label for c in chosen),
                tau,
                np.array([sizes[c] for c in chosen]),
                tuple(c.unit for c in chosen),
                equality,
                condition=not definition,
                spans=np.array([c.span if other else np.inf for c, other in zip(chosen, pairs, strict=True)]),
                opposites=tuple(prefix + other.label if other else "" for other in pairs),
            )
            groups.append(group)
    return groups
