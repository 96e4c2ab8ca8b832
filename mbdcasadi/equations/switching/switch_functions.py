"""Functions whose zeros, or whole values, are the instants at which an expression switches.

The graph of an expression shows them: each operation that switches (a comparison, ``fabs``, ``floor``, ``fmax`` …) is a
function of time, or of the state, that passes zero there.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...numerics.graph import operands, operations
from ...numerics.operations import BENDING, JUMPING, OPERATIONS, border_of, traits

#: Operations that switch. The values of comparisons are compared in their turn by and, or, not and if_else.
_SWITCHING = frozenset(op for op, known in OPERATIONS.items() if known.at_border)
_TRANSIENT = frozenset(op for op, known in OPERATIONS.items() if known.transient)
#: Operations that switch with the motion. Of equalities nothing remains but instants, which no load is: their operands
#: may switch, and are looked at themselves. The lengths of springs compare for zero. The angle of a vector is smooth on
#: one side of its border.
_IN_STATE = (BENDING | JUMPING) - {ca.OP_ATAN2}
#: Operations by whose values geometry divides: the lengths of springs, and powers of these.
_OF_GEOMETRY = (ca.OP_SQRT, ca.OP_CONST, ca.OP_HYPOT)


def time_switches(parts: ca.SX, t: ca.SX) -> tuple[list[ca.SX], list[ca.SX], list[ca.SX]]:
    """Functions that switch at zero, that switch at integers, and that cause a transient."""
    zeros: list[ca.SX] = []
    integers: list[ca.SX] = []
    transients: list[ca.SX] = []
    for op, node in operations(parts, _SWITCHING | _TRANSIENT):
        if op in _SWITCHING:
            (integers if traits(op).whole else zeros).append(border_of(op, operands(node)))
        if op in _TRANSIENT:
            transients += _of_transient(op, node)
    return depending_on_time(zeros, t), depending_on_time(integers, t), depending_on_time(transients, t)


def state_switches(expressions: ca.SX, state: ca.SX, unknown: ca.SX) -> tuple[list[ca.SX], list[ca.SX]]:
    """Functions of a state at whose zeros expressions switch, and at whose zeros or extrema they may pass quickly.

    Parameters
    ----------
    expressions : casadi.SX
        Of any shape.
    state : casadi.SX
        Symbols on one of which a function must depend.
    unknown : casadi.SX
        Symbols on none of which it may depend.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> state_switches(ca.if_else(x > 2, ca.exp(-(x**2)), 0), x, ca.SX(0, 1))
    ([SX((x-2))], [SX((-sq(x)))])
    """
    switches, transients = [], []
    for op, node in operations(expressions, _IN_STATE | _TRANSIENT):
        if op in _IN_STATE:
            switch = border_of(op, operands(node))
            switches.append(ca.sin(np.pi * switch) if traits(op).whole else switch)
        else:
            transients += [x for x in _of_transient(op, node) if x.op() not in _OF_GEOMETRY]
    return _moving(switches, state, unknown), _moving(transients, state, unknown)


def as_level(switch: ca.SX) -> tuple[ca.SX, float]:
    """Return a quantity and its value where a function is zero: of a difference from a number this number.

    Examples
    --------
    >>> as_level(ca.SX.sym("x") - 2)
    (SX(x), 2.0)
    """
    if switch.op() == ca.OP_SUB:
        left, right = operands(switch)
        if left.is_constant() or right.is_constant():
            return (right, float(left)) if left.is_constant() else (left, float(right))
    return switch, 0.0


def _of_transient(op: int, node: ca.SX) -> list[ca.SX]:
    """Operand of an operation that may cause a short transient; of powers only if they may divide.

    What divides has the logarithm of its size, too: a quotient passes as quickly as its divisor changes beside its own
    least size, whatever its unit.
    """
    a, *_, b = 2 * operands(node)
    if op in (ca.OP_POW, ca.OP_CONSTPOW) and b.is_constant() and float(b) >= 0:
        return []
    divisor = b if op == ca.OP_DIV else a
    divides = op in (ca.OP_DIV, ca.OP_INV, ca.OP_POW, ca.OP_CONSTPOW) and divisor.op() not in _OF_GEOMETRY
    return [divisor, ca.log(ca.fabs(divisor))] if divides else [divisor]


def _moving(functions: list[ca.SX], state: ca.SX, unknown: ca.SX) -> list[ca.SX]:
    """Functions that depend on a state and on nothing unknown, each once."""
    functions = distinct(functions)
    if not functions:
        return []
    column = ca.vertcat(*functions)
    moving = ca.which_depends(column, state, 1, True)
    blurred = ca.which_depends(column, unknown, 1, True) if unknown.numel() else [False] * len(functions)
    return [f for f, moves, blur in zip(functions, moving, blurred, strict=True) if moves and not blur]


def divisors_among(rest: ca.SX, names: Sequence[ca.SX], parts: Sequence[ca.SX]) -> list[ca.SX]:
    """Parts by which other expressions are divided."""
    known = {name.element_hash(): part for name, part in zip(names, parts, strict=True)}
    divisors = (node.dep(1).element_hash() for _, node in operations(rest, (ca.OP_DIV,)))
    return [known[divisor] for divisor in divisors if divisor in known]


def depending_on_time(functions: list[ca.SX], t: ca.SX) -> list[ca.SX]:
    """Functions that depend on time, each once."""
    functions = distinct(functions)
    flags = ca.which_depends(ca.vertcat(*functions), t, 1, True) if functions else []
    return [f for f, flag in zip(functions, flags, strict=True) if flag]


def distinct(functions: list[ca.SX]) -> list[ca.SX]:
    return list({f.element_hash(): f for f in functions}.values())


def nesting_depths(column: ca.SX) -> np.ndarray:
    """Number of operations that switch, nested in each of the functions (k,)."""
    depths: dict[int, int] = {}
    for op, node in operations(column) if any(operations(column, _SWITCHING)) else ():
        # the quotient that passes whole numbers divides: it is one level above the operands, its remainder another
        added = 2 if op in (ca.OP_FMOD, ca.OP_REMAINDER) else int(op in _SWITCHING)
        depths[node.element_hash()] = added + max((depths.get(x.element_hash(), 0) for x in operands(node)), default=0)
    return np.array([depths.get(function.element_hash(), 0) for function in ca.vertsplit(column)])
