"""Constraints that give a coordinate explicitly, in terms of others.

A pin between two bodies says where the second one is once the angles are
known: ``x_2 = x_1 + l_1 cos(phi_1) + l_2 cos(phi_2)``. Such a row is linear in a
coordinate with a constant factor, and can be solved for it once and for all;
the last row of a loop cannot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import casadi as ca

from .derivation import Equations
from .switching.switches import jumps_anywhere

#: Coordinates in which another may be given: more would make the equations of long chains dense.
MOST = 6
#: Coordinates in which another may be given otherwise than linearly, in open chains. Measured on sixty swing-ups of
#: one to three links: with two angles and more the solver lost its way in nine of them, in all coordinates in one; of
#: ninety pendulums and cart-poles, with one angle, the same were solved, in half the time.
CURVED = 1
#: Such coordinates in loops, and in open chains in angles alone, there also as many as inputs. Fifty four-bars,
#: slider-cranks, five-bars, six-bars, lifts and platforms took the same iterations as in all coordinates, and a third
#: to two thirds of the time. With guesses at rest, and residuals of the equations of motion in plain loads, chains of
#: two and three links took a third of the time that they take in all coordinates; five with one motor took as long.
#: With a motor in every joint five and ten took as long for both guesses as in all coordinates for one, to optima that
#: were cheaper by up to a third in each of five cases.
ANGLES = 3
#: A row is solved for a coordinate whose factor is at least this share of its largest one; less is rounding.
LEAST = 1e-3


@dataclass
class _Row:
    """Coordinates in a row: those with constant factors, and those that enter in another way."""

    linear: dict[int, float] = field(default_factory=dict)
    curved: set[int] = field(default_factory=set)

    @property
    def coordinates(self) -> set[int]:
        return self.curved | set(self.linear)

    def with_definitions(self, definitions: dict[int, _Row]) -> _Row:
        """The row with explicitly given coordinates substituted."""
        substituted = _Row()
        for k in self.curved:
            substituted.curved |= definitions[k].coordinates if k in definitions else {k}
        for k, factor in self.linear.items():
            inner = definitions[k] if k in definitions else _Row({k: 1.0})
            substituted.curved |= inner.curved
            for j, part in inner.linear.items():
                substituted.linear[j] = substituted.linear.get(j, 0.0) + factor * part
        return substituted

    def is_short(self, curved: int) -> bool:
        """Return True if few coordinates occur, and at most so many otherwise than linearly."""
        return len(self.coordinates) <= max(MOST, curved) and len(self.curved) <= curved

    def solved_for(self, k: int) -> _Row:
        """A coordinate in terms of the others."""
        factor = self.linear[k]
        return _Row({j: -x / factor for j, x in self.linear.items() if j != k}, set(self.curved))


@dataclass(frozen=True)
class ExplicitRow:
    """A position row that gives a coordinate.

    Attributes
    ----------
    place : int
        Of the row in ``Phi``.
    coordinate : int
        The coordinate that it gives, by place.
    factor : float
        Of the coordinate, with those given before substituted.
    """

    place: int
    coordinate: int
    factor: float


def explicit_rows(eom: Equations, *, curved: bool = True, angles: bool = False) -> list[ExplicitRow]:
    """Position rows that give coordinates, in the order in which they are to be solved.

    Of loops these are the pins of a tree, and those that close the loops are
    left. If one turning body follows another in an open chain, they are the
    linear rows alone: in angles only, long chains bend more than in all
    coordinates, and an optimal control that finds its way there may get lost.

    Parameters
    ----------
    curved : bool
        True if rows that are not linear are solved as well.
    angles : bool
        True if those of chains are solved, too, if no row is left then.
    """
    rows = _rows(eom)
    positions = [rows[int(k)] for k in eom.position_rows]
    if not curved:
        return _solve(positions, set(range(eom.q.numel())), CURVED)
    if angles:
        solved_rows = _solve(positions, set(), max(ANGLES, eom.u.numel()))
        if len(solved_rows) == len(rows):
            return solved_rows
    if len(_solve(positions, set(), eom.q.numel())) < len(rows):
        return _solve(positions, set(), ANGLES)
    linear_rows = _solve(positions, set(), CURVED)
    solved = {int(eom.position_rows[row.place]) for row in linear_rows}
    left = {k for place, row in enumerate(rows) if place not in solved for k in row.coordinates}
    return _solve(positions, connected(positions, left), CURVED) if left else linear_rows


def tree_rows(eom: Equations) -> dict[int, tuple[int, dict[int, float]]]:
    """Position rows that give coordinates one after the other, from the ground along the pins of a tree.

    A coordinate may be given in any number of others; those that remain are mostly angles. Rows that
    depend on time or states are left out, and all of them if one has a value that jumps.

    Returns
    -------
    dict
        Coordinate to its row's place in ``Phi``, and the factors of the given coordinates in that row.
    """
    if jumps_anywhere([eom.Phi]):
        return {}
    rows, still = _rows(eom), [ca.SX(rate).is_zero() for rate in ca.vertsplit(eom.nu)]
    follows = [bool(eom.follows_states and ca.depends_on(row, eom.z)) for row in ca.vertsplit(eom.Phi)]
    able = {place: rows[int(k)] for place, k in enumerate(eom.position_rows) if still[int(k)] and not follows[place]}
    linear = {k for row in able.values() for k in row.linear} - {k for row in able.values() for k in row.curved}
    unknown = {place: linear & set(row.linear) for place, row in able.items()}
    solved: dict[int, tuple[int, dict[int, float]]] = {}
    for place, k in _outwards(unknown):
        factors = able[place].linear
        if abs(factors[k]) >= LEAST * max(map(abs, factors.values())):
            solved[k] = place, {j: x for j, x in factors.items() if j == k or j in solved}
    return solved


def _outwards(unknown: dict[int, set[int]]) -> Iterator[tuple[int, int]]:
    """Rows, each with the only coordinate that those before leave unknown in it; these are taken out of the sets.

    Of a part that floats one coordinate counts as known.
    """
    holding = _rows_holding(unknown)
    ready = deque(place for place, coordinates in unknown.items() if len(coordinates) == 1)
    waiting = deque(sorted(holding))
    while ready or waiting:
        if not ready:
            k = waiting.popleft()
        elif unknown[place := ready.popleft()]:
            (k,) = unknown[place]
            yield place, k
        else:  # it closes a loop
            continue
        for place in holding.pop(k, ()):
            unknown[place].discard(k)
            ready += [place] if len(unknown[place]) == 1 else []


def _rows_holding(rows: Mapping[int, set[int]]) -> dict[int, list[int]]:
    """Rows by coordinate."""
    holding: dict[int, list[int]] = {}
    for place, coordinates in rows.items():
        for k in coordinates:
            holding.setdefault(k, []).append(place)
    return holding


def _solve(rows: list[_Row], lasting: set[int], curved: int) -> list[ExplicitRow]:
    """Solve rows for coordinates, those in the fewest angles first; if they hold lasting ones, linear rows alone."""
    definitions: dict[int, _Row] = {}
    solved: dict[int, ExplicitRow] = {}
    linear_first = sorted(enumerate(rows), key=lambda item: bool(item[1].curved))
    for most in (*range(1, min(curved, ANGLES)), curved):
        for place, plain_row in linear_first:
            row = plain_row.with_definitions(definitions)
            k = _pivot(row, LEAST * max((abs(x) for x in plain_row.linear.values()), default=0.0))
            if place in solved or k is None or (row.curved and row.coordinates & lasting):
                continue
            definition = {k: row.solved_for(k)}
            moved = {j: d.with_definitions(definition) for j, d in definitions.items() if k in d.coordinates}
            if all(d.is_short(most) for d in (*definition.values(), *moved.values())):
                solved[place] = ExplicitRow(place, k, row.linear[k])
                definitions |= moved | definition
    return list(solved.values())


def connected(rows: list[_Row], coordinates: set[int]) -> set[int]:
    """Coordinates that rows connect with some."""
    holding = _rows_holding({place: row.coordinates for place, row in enumerate(rows)})
    connected, new = set(coordinates), list(coordinates)
    while new:
        near = {j for place in holding.get(new.pop(), ()) for j in rows[place].coordinates} - connected
        connected |= near
        new += near
    return connected


def _pivot(row: _Row, least: float) -> int | None:
    """Coordinate to solve a row for: of those with the largest factor the last one."""
    able = {k: abs(x) for k, x in row.linear.items() if k not in row.curved and abs(x) > least}
    largest = max(able.values(), default=0.0)
    return max((k for k, x in able.items() if x >= 0.99 * largest), default=None)


def _rows(eom: Equations) -> list[_Row]:
    """Coordinates in each row."""
    rows = [_Row() for _ in range(eom.lam.numel())]
    for i, k, slope in zip(*eom.Phi_q.sparsity().get_triplet(), eom.Phi_q.nonzeros(), strict=True):
        if slope.is_constant():
            rows[i].linear[k] = float(slope)
        else:
            rows[i].curved.add(k)
    return rows
