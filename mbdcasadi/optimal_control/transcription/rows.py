"""Equations and limits of a transcription: what each row says, of what, where, and in which unit."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from enum import Enum
from typing import NamedTuple

import casadi as ca
import numpy as np

from ...model.conditions import Condition
from ...numerics.lazy import cached_property


class RowKind(Enum):
    """What a row says: a number, and its text with braces for an owner."""

    #: of a scheme of the user's own, of times, and path conditions that are differentiated like constraints
    EQUATION = 0, "{}"
    MOTION = 1, "equation of motion of {}"
    CONSTRAINT = 2, "constraint {}"
    VELOCITY = 3, "velocity equation of {}"
    ACCELERATION = 4, "acceleration equation of {}"
    #: of coordinates and first-order states
    CONTINUITY = 5, "continuity of {}"
    VELOCITY_CONTINUITY = 6, "continuity of the velocity of {}"
    STATE_RATE = 7, "rate of {}"
    ACCUMULATION = 8, "accumulation of {}"
    MOMENTUM = 9, "momentum of {}"
    CLOSING = 10, "{} closes"
    #: stated by the user, or a limit that an input or a first-order state carries
    CONDITION = 11, "{}"
    #: a limit about a condition that others imply on one branch
    BRANCH = 12, "{}"
    #: of the symbol of a part of a cost, which can always be met
    DEFINITION = 13, "{}"


class Place(NamedTuple):
    """Where rows stand, in the words before their labels; `unique` if no other phase has a place of that name."""

    name: str = ""
    unique: bool = False


PATH, INITIAL, FINAL, BOUNDARY = Place(), Place("initial", True), Place("final"), Place("boundary", True)


class RowName(NamedTuple):
    """What a row says, of which element, coordinate, condition or time, and where."""

    kind: RowKind
    owner: str
    place: Place

    @property
    def label(self) -> str:
        """Text for people."""
        text = self.kind.value[1].format(self.owner)
        return f"{self.place.name}: {text}" if self.place.name else text


class Row(NamedTuple):
    """One row of a program; see :class:`Rows`.

    ``phase`` and ``interval`` say where it stands, by index (-1: nowhere); ``repeated`` is true for a row that
    every interval has, false for one of a single place. ``lower`` is its lower bound, scaled, and ``opposite`` the
    name of that side, if it has one.
    """

    name: RowName
    opposite: RowName | None
    unit: str
    size: float
    lower: float
    equality: bool
    phase: int
    interval: int
    repeated: bool
    tau: float

    @property
    def label(self) -> str:
        """Text for people."""
        return self.name.label

    @property
    def kind(self) -> RowKind:
        """What it says."""
        return self.name.kind

    @property
    def is_stated(self) -> bool:
        """True if it comes from a condition of the user, so that its multiplier is reported."""
        return self.kind in (RowKind.CONDITION, RowKind.BRANCH)

    def side(self, value: float) -> RowName:
        """Name of the side on which a value, or a multiplier, lies."""
        return self.opposite if self.opposite and value < 0 else self.name


@dataclass(frozen=True)
class Rows:
    """A group of equations or limits on one interval."""

    #: (k,); zero, or not above zero for limits
    expression: ca.SX
    #: element, coordinate, condition or time of each row
    owners: tuple[str, ...]
    #: point of the interval at which it holds, 0 to 1
    tau: float
    #: size of each row by which it is divided (k,)
    scale: np.ndarray
    units: tuple[str, ...]
    kind: RowKind = RowKind.EQUATION
    #: whether the rows are zero, or stay below it
    equality: bool = True
    place: Place = PATH
    #: amount by which each limit may fall below zero, in its unit (k,), and owners of the lower sides: two-sided limits
    spans: np.ndarray | None = None
    opposites: tuple[str, ...] = ()

    @property
    def lower(self) -> np.ndarray:
        """Lower bounds of the rows, scaled: zero for equalities."""
        if self.equality:
            return np.zeros(len(self.owners))
        return np.full(len(self.owners), -np.inf) if self.spans is None else -self.spans / self.scale

    def on(self, phase: int, interval: int, *, repeated: bool) -> list[Row]:
        """The rows one by one, on an interval of a phase."""
        where = self.equality, phase, interval, repeated, self.tau
        return [Row(*entry, *where) for entry in self._entries]

    @cached_property
    def _entries(self) -> list[tuple[RowName, RowName | None, str, float, float]]:
        """Names, names of the opposite sides, units, sizes and lower bounds."""
        names = [RowName(self.kind, owner, self.place) for owner in self.owners]
        others = [RowName(self.kind, owner, self.place) if owner else None for owner in self.opposites]
        sides = others or [None] * len(names)
        return list(zip(names, sides, self.units, self.scale.tolist(), self.lower.tolist(), strict=True))

    def part(self, which: slice) -> Rows:
        """Some rows of the group."""
        expression, owners, units = self.expression[which], self.owners[which], self.units[which]
        return replace(self, expression=expression, owners=owners, scale=self.scale[which], units=units)


def violations(rows: np.ndarray, lower: np.ndarray) -> np.ndarray:
    """Amounts by which scaled rows are above zero, or below their lower bounds, which are zero for equalities."""
    return np.maximum(np.maximum(rows, lower - rows), 0.0)


def stack(groups: list[Rows]) -> ca.SX:
    """All rows of groups, scaled, as one column."""
    filled = [group for group in groups if group.owners]
    sizes = np.concatenate([np.zeros(0), *[group.scale for group in filled]])
    return ca.vertcat(ca.SX(0, 1), *[group.expression for group in filled]) / ca.DM(sizes)


def condition_rows(
    values: dict[Condition, ca.SX], sizes: dict[Condition, float], tau: float, place: Place = PATH
) -> list[Rows]:
    """Conditions with their values at a place: equalities, and limits, of which two-sided ones are one row."""
    groups = []
    lower_sides = {c.opposite for c in values if c.opposite in values}
    kinds = (RowKind.CONDITION, RowKind.BRANCH, RowKind.DEFINITION)
    for kind, equality in itertools.product(kinds, (True, False)):
        chosen = [c for c in values if (_kind_of(c), c.equality) == (kind, equality) and c not in lower_sides]
        if chosen:
            pairs = [c.opposite if c.opposite in lower_sides else None for c in chosen]
            group = Rows(
                ca.vertcat(*[values[c] for c in chosen]),
                tuple(c.label for c in chosen),
                tau,
                np.array([sizes[c] for c in chosen]),
                tuple(c.unit for c in chosen),
                kind,
                equality,
                place,
                spans=np.array([c.span if other else np.inf for c, other in zip(chosen, pairs, strict=True)]),
                opposites=tuple(other.label if other else "" for other in pairs),
            )
            groups.append(group)
    return groups


def _kind_of(condition: Condition) -> RowKind:
    if condition.definition:
        return RowKind.DEFINITION
    return RowKind.BRANCH if condition.implied else RowKind.CONDITION
