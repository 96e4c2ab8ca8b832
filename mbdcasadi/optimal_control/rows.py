"""Equations and limits of a transcription, each row with its label and its unit."""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Rows:
    """A group of equations or limits on one interval.

    Attributes
    ----------
    expression : casadi.SX
        (k,); zero, or not above zero for limits.
    labels : tuple of str
        What each row says, in words.
    share : float
        Where in the interval it holds, 0 to 1.
    scale : numpy.ndarray
        Size of each row by which it is divided (k,).
    units : tuple of str
        Unit of each row.
    equality : bool
        Whether the rows are zero, or stay below it.
    condition : bool
        Whether the user stated them: their multipliers are reported.
    """

    expression: ca.SX
    labels: tuple[str, ...]
    share: float
    scale: np.ndarray
    units: tuple[str, ...]
    equality: bool = True
    condition: bool = False

    def first(self, count: int) -> Rows:
        """The first rows of the group."""
        return self._part(slice(0, count))

    def after(self, count: int) -> Rows:
        """The group without its first rows."""
        return self._part(slice(count, len(self.labels)))

    def _part(self, which: slice) -> Rows:
        expression, labels, units = self.expression[which], self.labels[which], self.units[which]
        return replace(self, expression=expression, labels=labels, scale=self.scale[which], units=units)


#: Unit of a row whose expression the user wrote.
OWN_UNIT = "in the units of the condition"


def violations(rows: np.ndarray, equalities: np.ndarray) -> np.ndarray:
    """By how much scaled rows are not met: equalities by their size, limits by what is above zero."""
    return np.where(equalities, np.abs(rows), np.maximum(rows, 0.0))


def stack(groups: list[Rows]) -> ca.SX:
    """All rows of groups, scaled, as one column."""
    filled = [group for group in groups if group.labels]
    sizes = np.concatenate([np.zeros(0), *[group.scale for group in filled]])
    return ca.vertcat(ca.SX(0, 1), *[group.expression for group in filled]) / ca.DM(sizes)
