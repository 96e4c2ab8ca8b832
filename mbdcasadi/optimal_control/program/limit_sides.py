"""Sides of the conditions of a program: rows and variables that one name bounds, and bounds without limits."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...model.symbols import Symbol, place_of
from ..transcription.rows import PATH, RowKind, RowName
from .collocation_program import Bounds, CollocationProgram
from .phase_program import PhaseProgram

#: Scaled amounts by which conditions are violated, by name.
Slacks = dict[RowName, float]


@dataclass(frozen=True)
class Side:
    """One place at which a condition holds: a side of a row, or of a variable that has its own limit."""

    name: RowName
    #: 1 if it bounds from above, -1 from below
    sign: int
    #: among the rows, and the variables after them
    place: int
    #: scaled
    bound: float
    size: float
    unit: str
    phase: int
    #: those that it belongs to: two for a variable of a mesh point between them
    intervals: tuple[int, ...]
    tau: float
    #: whether it holds throughout the phase, not at one place
    repeated: bool
    equality: bool = False
    is_row: bool = True


def sides_of(program: CollocationProgram) -> Iterator[Side]:
    """Iterate over all places at which conditions and limits of the user hold."""
    for k, row in enumerate(program.rows):
        if row.is_stated:
            on_row = row.size, row.unit, row.phase, (row.interval,), row.tau, row.repeated, row.equality
            yield Side(row.name, 1, k, 0.0, *on_row)
            if row.opposite:
                yield Side(row.opposite, -1, k, row.lower, *on_row)
    for phase in program.phases:
        for condition, (symbol, sign) in phase.limit_owners.items() if phase.count else ():
            limit, name = symbol.upper if sign > 0 else symbol.lower, RowName(RowKind.CONDITION, condition.label, PATH)
            for place, intervals in _variables_of(phase, symbol):
                size = float(program.scale[place])
                stands = size, condition.unit, phase.number, intervals, 0.0, True
                yield Side(name, sign, program.lower.size + place, limit / size, *stands, is_row=False)


def _variables_of(phase: PhaseProgram, symbol: Symbol) -> Iterator[tuple[int, tuple[int, ...]]]:
    """Variables of an input or a first-order state, and the intervals to which each belongs."""
    scheme, mechanism, count = phase.scheme, phase.phase.mechanism, phase.count
    free = [mechanism.inputs[k] for k in scheme.free_inputs]
    n, inputs, input_place = scheme.eom.q.numel(), len(free), place_of(symbol, free)
    if input_place is None:
        at_point = 2 * n + next(k for k, z in enumerate(mechanism.states) if z is symbol)
    else:
        first = scheme.interval_slice("u").start + input_place
        inside = slice(first, first + inputs * len(scheme.inputs.inner), inputs)
        for i in range(count):
            yield from ((place, (i,)) for place in phase.inner_index(i)[inside].tolist())
        at_point = scheme.point_size - inputs + input_place
    if input_place is None or scheme.inputs.joined:
        for i in range(count + 1):
            yield int(phase.point_index(i)[at_point]), tuple(k for k in (i - 1, i) if 0 <= k < count)


class LimitSides:
    """Limits that hold throughout the phases of a program, by name.

    With `at_places`, those of waypoints, ends and integrals count too, and with `conditions` all that the user stated,
    equalities with both sides.
    """

    def __init__(self, program: CollocationProgram, *, at_places: bool = False, conditions: bool = False):
        self.sides: dict[RowName, list[Side]] = {}
        self.row_count = program.lower.size
        for side in sides_of(program):
            is_limit = side.name.place == PATH or (at_places and side.name.kind is not RowKind.BRANCH)
            if conditions or (is_limit and not side.equality):
                self.sides.setdefault(side.name, []).append(side)

    def places(self, name: RowName, sign: int) -> list[int]:
        """Places that a name bounds on one side, among the rows and the variables after them."""
        return [side.place for side in self.sides[name] if side.sign == sign or side.equality]

    def without(self, bounds: Bounds) -> Bounds:
        """Bounds without these limits."""
        low, high = bounds.of_rows_and_variables
        for name in self.sides:
            high[self.places(name, 1)] = np.inf
            low[self.places(name, -1)] = -np.inf
        return Bounds(low[self.row_count :], high[self.row_count :], low[: self.row_count], high[: self.row_count])

    def excess(self, bounds: Bounds, x: np.ndarray, rows: np.ndarray) -> Slacks:
        """Largest amounts by which limits are passed, scaled, by name; those that hold are left out."""
        (low, high), values, amounts = bounds.of_rows_and_variables, np.r_[rows, x], {}
        for name in self.sides:
            above, below = self.places(name, 1), self.places(name, -1)
            passed = np.r_[values[above] - high[above], low[below] - values[below]]
            most = float(np.max(passed, initial=0.0))
            if most > 0:
                amounts[name] = most
        return amounts
