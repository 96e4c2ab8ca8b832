"""Programs whose kinks are rounded: magnitudes, minima and maxima, and comparisons.

The optimum of a program may lie on a kink: a mesh point at which a rope is just taut. No method that follows
derivatives ends there. With the hyperbola ``sqrt(x² + w²)`` in the place of ``|x|`` the program is smooth, and as the
width `w` falls its optimum tends to that of the program itself.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import casadi as ca
import numpy as np

from ...model.cache import Cache
from ...numerics.graph import operands, operation, rewritten
from ...numerics.lending import Lending
from ...numerics.operations import border_of, traits
from ..program.collocation_program import CollocationProgram
from ..program.sparse_program import MappedBlock, SparseProgram
from ..statement.compiled import OPTION_SETS
from .solvers.base import Beginning, NLPSolver, Result

#: Widths of rounded kinks in turn; iterations with the first one, and with each further one.
WIDTHS, FIRST_ITERATIONS, FURTHER_ITERATIONS = (1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4, 3e-5, 1e-5), 150, 60
#: Largest scaled violation of the program itself up to which a solution with rounded kinks is one.
MISSED = 1e-4


class RoundedProgram:
    """A program in which the kinks of another one are rounded.

    Their widths are shares of the largest values that what passes zero at a kink has at the variables `x` and `data`.
    """

    def __init__(self, program: CollocationProgram, x: np.ndarray, data: np.ndarray):
        nlp, width = program.nlp, ca.SX.sym("width")
        values = _at_kinks(nlp, x, data)
        rounded = [
            _rounded(piece, width, np.max(np.abs(own), axis=0, initial=0.0))
            for piece, own in zip(nlp.pieces, values, strict=True)
        ]
        self._first = nlp.parameters.numel()
        self._program = copy(program)
        self._program.nlp = SparseProgram(nlp.size, rounded, ca.vertcat(nlp.parameters, width))
        self._program.solvers, self._program.packed = Lending(alike=np.inf), Cache(OPTION_SETS)

    def solve(self, solver: NLPSolver, begin: Beginning) -> tuple[Result, float] | None:
        """Solve with kinks that get sharper, from the start of the program itself, as far as that succeeds.

        Returned are the last solution, with cost and rows of the program itself, and the width of its kinks, or the
        last iterate if the user stopped before there was one. It is None if the last solution does not meet the rows of
        the program itself nearly enough.
        """
        last, x = None, begin.x
        for width in WIDTHS:
            data = np.insert(begin.data, self._first, width)
            there = replace(begin, program=self._program, x=x, data=data, iterate=None)
            limit, warmth = (FIRST_ITERATIONS, "cold") if last is None else (FURTHER_ITERATIONS, "warm")
            result = _in_sharp(begin, solver.run(there, begin.bounds, warmth, limit=limit))
            if not result.succeeded:
                break
            last, reached, x = result if last is None else result.after(last), width, result.answer["x"]
            if result.interrupted:
                break
            begin = begin.again()
        if last is not None and begin.program.violation(last.answer["g"]) <= MISSED:
            last = last if result.succeeded else last.after(result)
            return replace(last, interrupted=result.interrupted), reached
        return (result, width) if result.interrupted else None


def reaches_kinks(nlp: SparseProgram, x: np.ndarray, data: np.ndarray) -> bool:
    """Return whether variables are so near to a kink, or on both sides of one, that the widest rounding changes them.

    A program with a magnitude of what stays far from zero, as a load that is never taken off, gains nothing by it.
    """
    for values in _at_kinks(nlp, x, data):
        near = np.min(np.abs(values), axis=0, initial=np.inf)
        largest = np.max(np.abs(values), axis=0, initial=0.0)
        both = np.any(values > 0, axis=0) & np.any(values < 0, axis=0)
        if np.any(both | (near <= WIDTHS[0] * largest)):
            return True
    return False


def _at_kinks(nlp: SparseProgram, x: np.ndarray, data: np.ndarray) -> list[np.ndarray]:
    """Values of what passes zero at each kink of the pieces of a program, by copies (n, k)."""
    borders = [_borders(piece) for piece in nlp.pieces]
    pieces = [replace(p, rows=b, cost=ca.SX(0)) for p, b in zip(nlp.pieces, borders, strict=True)]
    values = SparseProgram(nlp.size, pieces, nlp.parameters).evaluate(x, data)[1].full().ravel()
    ends = np.cumsum([b.numel() * p.index.shape[1] for b, p in zip(borders, pieces, strict=True)])
    own = zip(np.split(values, ends[:-1]), borders, pieces, strict=True)
    return [some.reshape(p.index.shape[1], b.numel()) for some, b, p in own]


def _in_sharp(begin: Beginning, result: Result) -> Result:
    """A result with cost and rows of the program itself."""
    cost, rows = (value.full().ravel() for value in begin.program.nlp.evaluate(result.answer["x"], begin.data))
    return replace(result, answer=result.answer | {"f": cost, "g": rows})


def _borders(piece: MappedBlock) -> ca.SX:
    """What passes zero at each kink (k,)."""
    return ca.vertcat(ca.SX(0, 1), *[border_of(op, operands(node)) for op, node in piece.kinks])


def _rounded(piece: MappedBlock, width: ca.SX, sizes: np.ndarray) -> MappedBlock:
    """A piece with its kinks rounded, each by a width times its size."""
    positive: dict[int, ca.SX] = {}
    hashes = [node.element_hash() for _, node in piece.kinks]
    widths = {key: width * float(size or 1.0) for key, size in zip(hashes, sizes, strict=True)}

    def smooth(op: int, node: ca.SX, now: list[ca.SX]) -> ca.SX | None:
        key = node.element_hash()
        if key not in widths:
            return None
        border = border_of(op, now)
        size = ca.sqrt(border**2 + widths[key] ** 2)
        positive[key] = (border + size) / 2
        return _smooth(op, now, border, size)

    def combined(op: int, node: ca.SX, now: list[ca.SX]) -> ca.SX:
        guarded = _guarding(node)
        return _combined(op, now) if guarded is None else positive[guarded]

    rows, cost = rewritten([piece.rows, piece.cost], smooth, combined)
    return replace(piece, rows=rows, cost=cost, parameters=ca.vertcat(piece.parameters, width))


def _smooth(op: int, between: Sequence[ca.SX], border: ca.SX, size: ca.SX) -> ca.SX:
    """A kink with the magnitude of what passes zero rounded to `size`."""
    rounded = traits(op).rounded
    assert rounded is not None, op
    return rounded(between[0], between[-1], border, size)


def _combined(op: int, now: Sequence[ca.SX]) -> ca.SX:
    """An operation on rounded operands: those of logic take truth values between 0 and 1."""
    rounded = None if traits(op).border else traits(op).rounded
    return operation(op, now) if rounded is None else rounded(now[0], now[-1])


def _guarding(node: ca.SX) -> int | None:
    """Hash of ``x > 0`` if an operation is ``x if x > 0 else constant``, which keeps powers from what is negative.

    The positive part of x takes its place: a mixture with the constant would not vanish where x does.
    """
    parts = operands(node)
    if node.op() != ca.OP_ADD or any(part.n_dep() != 2 or part.op() != ca.OP_IF_ELSE_ZERO for part in parts):
        return None
    (on, x), (off, rest) = (operands(part) for part in parts)
    if on.n_dep() != 2 or on.op() != ca.OP_LT or not on.dep(0).is_zero() or not rest.is_constant():
        return None
    key = on.element_hash()
    same = on.dep(1).element_hash() == x.element_hash()
    return key if same and off.n_dep() == 1 and off.op() == ca.OP_NOT and off.dep(0).element_hash() == key else None
