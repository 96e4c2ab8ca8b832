"""Batches of elements whose expressions differ in numbers alone: derived and compiled once for all of them.

Thirty discs have 435 contacts with each other, and one formula. The instructions
of the expressions of each element are compared; those of one batch have the
same ones, on other symbols and with other constants. From the instructions the
expressions are built again, in symbols of the batch's own.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..numerics.c_code import CONSTANT, INPUT, OUTPUT, Tape, UnsupportedOperation, applied, tape_of
from ..numerics.lazy import cached_property
from .derivation import Equations

#: Order of the groups of symbols in the values that batches take, behind time.
GROUPS = ("q", "v", "a", "z", "lam", "u", "p")


class Values:
    """Places of the symbols of a mechanism in one column of numbers: ``[t, q, v, a, z, lam, u, p, rates of z, 0, 1]``.

    Attributes
    ----------
    size : int
        Length of the column.
    """

    def __init__(self, eom: Equations):
        self._eom = eom
        self._starts, start = {"t": 0}, 1
        for group in (*GROUPS, "z_rate"):
            self._starts[group] = start
            start += getattr(eom, group).numel()
        self._zero, self._one = start, start + 1
        self.size = start + 2
        self._places = {eom.t.element_hash(): (0, "t")}
        for group in GROUPS:
            symbols = ca.vertsplit(getattr(eom, group))
            self._places |= {s.element_hash(): (self._starts[group] + k, group) for k, s in enumerate(symbols)}

    def start(self, group: str) -> int:
        """Place of the first symbol of a group."""
        return self._starts[group]

    def count(self, group: str) -> int:
        """Number of symbols of a group."""
        return int(getattr(self._eom, group).numel())

    def place(self, symbol: ca.SX) -> tuple[int, str] | None:
        """Place of a symbol and its group; None if the mechanism does not have it."""
        return self._places.get(symbol.element_hash())

    def rate_places(self, places: np.ndarray) -> np.ndarray:
        """Places of the rates of change of symbols at places; the place of zero if no rate is known."""
        rates = np.full(places.shape, self._zero)
        rates[places == 0] = self._one
        for group, rate in (("q", "v"), ("v", "a"), ("z", "z_rate")):
            start, count = self._starts[group], getattr(self._eom, group).numel()
            inside = (places >= start) & (places < start + count)
            rates[inside] = places[inside] - start + self._starts[rate]
        return rates

    def coordinate(self, places: np.ndarray) -> np.ndarray:
        """Numbers of the coordinates at places."""
        return places - self._starts["q"]

    def bodies(self, places: list[int]) -> tuple[tuple[int, int], ...]:
        """First place of the same body, and number among the three coordinates, by place of a coordinate.

        Elements of one batch belong to bodies in the same way. (-1, -1) for anything else.
        """
        start, count = self._starts["q"], 3 * len(self._eom.mechanism.bodies)
        first: dict[int, int] = {}
        pairs = []
        for k, place in enumerate(places):
            body, which = divmod(place - start, 3)
            pairs.append((first.setdefault(body, k), which) if 0 <= place - start < count else (-1, -1))
        return tuple(pairs)

    def of_others(self, places: list[int], bodies: Sequence[Any], others: Sequence[Any]) -> list[int] | None:
        """Places of the symbols of some bodies, in the order of those of other bodies; None if one is of neither."""
        number = {body: k for k, body in enumerate(self._eom.mechanism.bodies)}
        shift = {number[a]: 3 * (number[b] - number[a]) for a, b in zip(bodies, others, strict=True) if a in number}
        moved = []
        for place in places:
            group = next((g for g in ("q", "v", "a") if 0 <= place - self._starts[g] < 3 * len(number)), "")
            if group:
                place += shift[(place - self._starts[group]) // 3]
            elif self._starts["z"] <= place < self._starts["p"]:
                return None
            moved.append(place)
        return moved

    def column(self, *groups: Any, z_rate: Any) -> Any:
        """Values of ``t, q, v, a, z, lam, u, p`` and of the rates of z, as one column of expressions."""
        return ca.vertcat(*groups, z_rate, 0.0, 1.0)

    def table(
        self,
        times: np.ndarray,
        q: np.ndarray,
        v: np.ndarray,
        z: np.ndarray,
        p: np.ndarray,
        z_rate: np.ndarray | None = None,
    ) -> np.ndarray:
        """Values at some times (size, k); NaN for those that are not given.

        Parameters
        ----------
        times : numpy.ndarray
            (k,), s.
        q, v, z, z_rate : numpy.ndarray
            By row (k, …).
        p : numpy.ndarray
            Parameters.
        """
        table = np.full((self.size, times.size), np.nan)
        table[0], table[self._zero], table[self._one] = times, 0.0, 1.0
        for group, part in (("q", q.T), ("v", v.T), ("z", z.T), ("p", p[:, None])):
            start = self._starts[group]
            table[start : start + part.shape[0]] = part
        if z_rate is not None:
            start = self._starts["z_rate"]
            table[start : start + z_rate.shape[1]] = z_rate.T
        return table


@dataclass(frozen=True, eq=False)
class Batch:
    """Elements with the same expressions.

    Attributes
    ----------
    values : Values
        The column in which the places count.
    numbers : numpy.ndarray of int
        The elements, as numbers in the sequence that they were taken from (n,).
    places : numpy.ndarray of int
        Places of their symbols (n, k).
    constants : numpy.ndarray
        Their constants that differ between elements (n, c).
    symbols, rates, parameters : casadi.SX
        Symbols of the batch (k,), their rates of change (k,), and the constants (c,).
    groups : tuple of str
        Group of each symbol.
    parts : tuple of casadi.SX
        The expressions, in these symbols.
    """

    values: Values
    numbers: np.ndarray
    places: np.ndarray
    constants: np.ndarray
    symbols: ca.SX
    rates: ca.SX
    parameters: ca.SX
    groups: tuple[str, ...]
    parts: tuple[ca.SX, ...]

    @cached_property
    def rate_places(self) -> np.ndarray:
        """Places of the rates of change of their symbols (n, k)."""
        return self.values.rate_places(self.places)

    def rate(self, expression: ca.SX) -> ca.SX:
        """Rate of change of a column in the symbols of the batch."""
        return ca.jtimes(expression, self.symbols, self.rates) if expression.numel() else expression

    def of_groups(self, *groups: str) -> list[int]:
        """Mask of the symbols that belong to some groups (k,)."""
        return [k for k, group in enumerate(self.groups) if group in groups]

    def function(self, name: str, expression: ca.SX) -> ca.Function:
        """Compile ``(symbols, rates, constants) -> expression``."""
        return ca.Function(name, [self.symbols, self.rates, self.parameters], [ca.densify(ca.cse(expression))])

    def evaluated(self, function: ca.Function, table: np.ndarray, chosen: np.ndarray | None = None) -> np.ndarray:
        """Results of a function of the batch for each element at each time (n, rows, times).

        Parameters
        ----------
        function : casadi.Function
            As :meth:`function` makes it.
        table : numpy.ndarray
            Values at some times (size, times).
        chosen : numpy.ndarray of int, optional
            Elements by column: then each element at its own time, (1, rows, times).
        """
        count, moments = (len(self.places), table.shape[1]) if chosen is None else (1, table.shape[1])
        if chosen is None:
            symbols, rates = (table[which].transpose(1, 0, 2) for which in (self.places, self.rate_places))
            constants = np.repeat(self.constants.T[:, :, None], moments, axis=2)
        else:
            columns = np.arange(moments)
            symbols, rates = (table[which[chosen].T, columns] for which in (self.places, self.rate_places))
            constants = self.constants[chosen].T
        shaped = [part.reshape(part.shape[0], count * moments) for part in (symbols, rates, constants)]
        results = np.array(function(*shaped).full())
        return results.reshape(-1, count, moments).transpose(1, 0, 2)

    def expanded(self, function: ca.Function, column: Any) -> list[Any]:
        """Results of a function of the batch for each element, as expressions of the column of values."""
        return [
            function(column[[int(k) for k in symbols]], column[[int(k) for k in rates]], ca.DM(constants))
            for symbols, rates, constants in zip(self.places, self.rate_places, self.constants, strict=True)
        ]


def batches_of(
    eom: Equations, values: Values, elements: Sequence[Any], parts_of: Callable[[Any], Sequence[ca.SX]]
) -> list[Batch]:
    """Return the batches of some elements, in the order of their first ones.

    Parameters
    ----------
    parts_of : callable
        Returns expressions of an element, columns in the symbols of the mechanism.

    Raises
    ------
    ExpressionError
        For a symbol that the mechanism does not have.
    """
    kinds: dict[tuple[Any, ...], list[tuple[int, Tape, list[int]]]] = {}
    batches: dict[tuple[Any, ...], Batch | None] = {}
    first_alike: dict[Hashable, tuple[tuple[Any, ...], Any, Tape, list[int]]] = {}
    for number, element in enumerate(elements):
        likeness = getattr(element, "likeness_of_expressions", None)
        if likeness is not None and likeness in first_alike:
            key, first, tape, places = first_alike[likeness]
            own_symbols = values.of_others(places, first.bodies, element.bodies)
            if own_symbols is not None:
                kinds[key].append((number, tape, own_symbols))
                continue
        parts = [ca.densify(part) for part in parts_of(element)]
        column = ca.vertcat(ca.SX(0, 1), *parts)
        symbols_inside = ca.symvar(column)
        symbols = ca.vertcat(ca.SX(0, 1), *symbols_inside)
        known = [entry for entry in map(values.place, symbols_inside) if entry is not None]
        if len(known) < len(symbols_inside):
            eom.function(column)  # raises, and says which symbol
        places, groups = [place for place, _ in known], tuple(group for _, group in known)
        try:
            tape = tape_of(ca.Function("element", [symbols], [column]))
        except UnsupportedOperation:  # as the call of a function: it is a batch of its own
            own_places, none, rates = np.array([places], int), np.zeros((1, 0)), ca.SX.sym("r", len(groups))
            batches[(number,)] = Batch(
                values, np.array([number]), own_places, none, symbols, rates, ca.SX(0, 1), groups, tuple(parts)
            )
            continue
        key = tuple(part.numel() for part in parts), groups, values.bodies(places), tape.instructions.tobytes()
        batches[key] = None
        kinds.setdefault(key, []).append((number, tape, places))
        first_alike.setdefault(likeness, (key, element, tape, places))
    return [_batch(values, key[0], key[1], kinds[key]) if batch is None else batch for key, batch in batches.items()]


def _batch(
    values: Values, sizes: tuple[int, ...], groups: tuple[str, ...], members: list[tuple[int, Tape, list[int]]]
) -> Batch:
    """Build the batch of elements with the same instructions."""
    numbers = np.array([number for number, _, _ in members], int)
    places = np.array([place for _, _, place in members], int).reshape(len(members), len(groups))
    constants = np.array([tape.constants for _, tape, _ in members]).reshape(len(members), -1)
    varies = np.any(constants != constants[0], axis=0) & ~np.all(np.isnan(constants), axis=0)
    symbols, rates = (ca.SX.sym(name, len(groups)) for name in ("s", "r"))
    parameters = ca.SX.sym("c", int(np.sum(varies)))
    known = [ca.SX(float(constant)) for constant in constants[0]]
    for k, place in enumerate(np.flatnonzero(varies)):
        known[int(place)] = parameters[k]
    column = _rebuilt(members[0][1], symbols, known, sum(sizes))
    ends = np.cumsum(sizes).tolist()
    parts = tuple(column[end - size : end] for size, end in zip(sizes, ends, strict=True))
    return Batch(values, numbers, places, constants[:, varies], symbols, rates, parameters, groups, parts)


def _rebuilt(tape: Tape, symbols: ca.SX, constants: Sequence[ca.SX], size: int) -> ca.SX:
    """Expressions of a tape in other symbols and with other constants."""
    work: dict[int, ca.SX] = {}
    results = [ca.SX(0)] * size
    inputs = ca.vertsplit(symbols)
    for code, result, first, second in tape.instructions.tolist():
        if code == CONSTANT:
            work[result] = constants[first]
        elif code == OUTPUT:
            results[second] = work[first]
        elif code == INPUT:
            work[result] = inputs[second]
        else:
            work[result] = applied(code, work[first], work[second])
    return ca.vertcat(ca.SX(0, 1), *results)
