"""Tables in the place of long sums over comparisons, as splines hold them in ``SX``.

A spline of 145 points compares its argument with each point, and multiplies all coefficients by ones and zeros: 2 400
instructions. What depends on the argument through comparisons with numbers alone is constant between two of these. It
is evaluated once for every such range, and looked up.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import NamedTuple

import casadi as ca
import numpy as np

from .graph import operation

#: Comparisons of one quantity from which it is looked up: that takes as long as the sums over some 16 points.
MANY = 16
_COMPARISONS = (ca.OP_LT, ca.OP_LE)
#: What splines do with steps, faster than by CasADi.
_ARITHMETIC = {ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply}


class _Steps(NamedTuple):
    """Values between the numbers with which quantities are compared, one axis for each of the quantities."""

    quantities: tuple[int, ...]
    values: np.ndarray

    def along(self, quantities: tuple[int, ...]) -> np.ndarray:
        """The values with an axis for each of more quantities."""
        return np.expand_dims(self.values, [k for k, x in enumerate(quantities) if x not in self.quantities])


def with_tables(function: ca.Function) -> ca.Function:
    """Return a function that looks up what is constant between many comparisons with numbers.

    Parameters
    ----------
    function : casadi.Function
        Of ``SX`` expressions.

    Returns
    -------
    casadi.Function
        Of ``MX``, with the same values and derivatives; the function itself if there is nothing to look up.
    """
    if not function.is_a("SXFunction"):
        return function
    kinds = map(function.instruction_id, range(function.n_instructions()))
    if sum(kind in _COMPARISONS for kind in kinds) < MANY:
        return function
    graph = _Graph(function)
    return graph.with_tables() if graph.numbers else function


class _Graph:
    """Instructions of a function: their kinds, the instructions that define their operands, and their nodes.

    Attributes
    ----------
    numbers : dict of int to numpy.ndarray
        Numbers with which a quantity is often compared, sorted, by its instruction. It has passed a number from that
        one on; of what is true beyond a number alone, from the next one on.
    """

    def __init__(self, function: ca.Function):
        self._function, self._arguments = function, function.sx_in()
        same = ca.Function("graph", self._arguments, function.call(self._arguments))
        self._kinds = [same.instruction_id(k) for k in range(same.n_instructions())]
        self._nodes, self._operands = same.instructions_sx(), list[list[int]]()
        self._outputs = list[tuple[int, int, int]]()
        defined: dict[int, int] = {}
        for k, kind in enumerate(self._kinds):
            place = same.instruction_output(k)
            given = same.instruction_input(k)
            self._operands.append([] if kind in (ca.OP_INPUT, ca.OP_CONST) else [defined[x] for x in given])
            if kind == ca.OP_INPUT:
                self._nodes[k] = self._arguments[given[0]].nz[given[1]]
            if kind == ca.OP_OUTPUT:
                self._outputs.append((place[0], place[1], self._operands[k][0]))
            else:
                defined[place[0]] = k
        numbers = defaultdict[int, list[float]](list)
        for k, kind in enumerate(self._kinds):
            if kind in _COMPARISONS:
                quantity, number, _ = self._comparison(k)
                numbers[quantity].append(number)
        self.numbers = {x: np.unique(own) for x, own in numbers.items() if x >= 0 and len(own) >= MANY}

    def _comparison(self, k: int) -> tuple[int, float, bool]:
        """Quantity that is compared with a number, -1 if none is, the number that it passes, and if it is then true."""
        left, right = self._operands[k]
        rises = self._kinds[left] == ca.OP_CONST
        if rises == (self._kinds[right] == ca.OP_CONST):
            return -1, 0.0, False
        number = float(self._nodes[left if rises else right])
        passes_at_number = rises == (self._kinds[k] == ca.OP_LE)
        return right if rises else left, number if passes_at_number else float(np.nextafter(number, np.inf)), rises

    def with_tables(self) -> ca.Function:
        """Return the function that looks up the steps."""
        steps, inside, symbols = self._steps(), dict[int, ca.SX](), dict[int, ca.SX]()

        def now(k: int) -> ca.SX:
            if k in steps and steps[k].quantities:
                return symbols.setdefault(k, ca.SX.sym("step"))
            return inside.get(k, self._nodes[k])

        for k, (kind, parts) in enumerate(zip(self._kinds, self._operands, strict=True)):
            if k not in steps and kind != ca.OP_OUTPUT and any(x in inside or x in steps for x in parts):
                inside[k] = operation(kind, [now(x) for x in parts])
        results = [self._function.sparsity_out(k) for k in range(self._function.n_out())]
        entries: list[list[ca.SX]] = [[ca.SX(0)] * pattern.nnz() for pattern in results]
        for result, place, k in self._outputs:
            entries[result][place] = now(k)
        filled = [ca.SX(of, ca.vertcat(ca.SX(0, 1), *own)) for of, own in zip(results, entries, strict=True)]
        rest = ca.Function("rest", [*self._arguments, ca.vertcat(*symbols.values())], filled)
        compared = ca.Function("compared", self._arguments, [ca.vertcat(*(self._nodes[x] for x in self.numbers))])
        given, names = self._function.mx_in(), (self._function.name_in(), self._function.name_out())
        ranges = [
            ca.low(ca.DM([-np.inf, *own, np.inf]), value)
            for own, value in zip(self.numbers.values(), ca.vertsplit(compared(*given)), strict=True)
        ]
        values = _values([steps[k] for k in symbols], dict(zip(self.numbers, ranges, strict=True)))
        return ca.Function(self._function.name(), given, rest.call([*given, values]), *names)

    def _steps(self) -> dict[int, _Steps]:
        """Steps, and constants, by instruction."""
        steps: dict[int, _Steps] = {}
        for k, (kind, parts) in enumerate(zip(self._kinds, self._operands, strict=True)):
            quantity, number, rises = self._comparison(k) if kind in _COMPARISONS else (-1, 0.0, False)
            if kind == ca.OP_CONST:
                steps[k] = _Steps((), np.array(float(self._nodes[k])))
            elif quantity in self.numbers:
                is_true = np.full(self.numbers[quantity].size + 1, float(rises))
                is_true[: self.numbers[quantity].searchsorted(number) + 1] = not rises
                steps[k] = _Steps((quantity,), is_true)
            elif parts and kind != ca.OP_OUTPUT and all(x in steps for x in parts):
                steps[k] = _combined(kind, [steps[x] for x in parts])
        return steps


def _combined(kind: int, parts: Sequence[_Steps]) -> _Steps:
    """Operation on steps."""
    together = max((part.quantities for part in parts), key=len)
    if any(part.quantities and part.quantities != together for part in parts):
        together = tuple(sorted({x for part in parts for x in part.quantities}))
        parts = [_Steps(together, part.along(together)) for part in parts]
    if kind in _ARITHMETIC:
        return _Steps(together, _ARITHMETIC[kind](*(part.values for part in parts)))
    values = np.broadcast_arrays(*(part.values for part in parts))
    columns = [ca.DM(part.ravel()) for part in values]
    result = ca.DM.unary(kind, *columns) if len(columns) == 1 else ca.DM.binary(kind, *columns)
    return _Steps(together, result.full().reshape(values[0].shape))


def _values(steps: Sequence[_Steps], ranges: dict[int, ca.MX]) -> ca.MX:
    """Values of steps where the quantities are in some ranges, by number."""
    together = defaultdict[tuple[int, ...], list[int]](list)
    for k, own in enumerate(steps):
        together[own.quantities].append(k)
    found = []
    for quantities, places in together.items():
        values = np.stack([steps[k].values for k in places])
        place = ca.MX(0)
        for quantity, size in zip(quantities, values.shape[1:], strict=True):
            place = place * size + ranges[quantity]
        found.append(ca.MX(ca.DM(values.reshape(len(places), -1)))[:, place])
    order = np.argsort([k for places in together.values() for k in places])
    return ca.vertcat(*found)[order.tolist()]
