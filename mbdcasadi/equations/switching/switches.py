"""Operations at which the value of an expression jumps, and expressions in which they are held.

A comparison, a sign, a whole number below … has the same value on either side
of a surface ``w = 0`` and another one beyond. With a symbol in its place the
expression is smooth: the side on which a motion is becomes an argument, which
the motion may change at an instant that has a derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ...numerics.graph import operands, operations, rewritten
from ...numerics.operations import BENDING, JUMPING, border_of, traits


@dataclass(frozen=True, eq=False)
class Switch:
    """An operation whose value jumps.

    Attributes
    ----------
    node : int
        Hash of the operation in the graph that it was found in.
    side : casadi.SX
        Symbol of the side: 1 where the quantity is positive, else 0; of a `whole` one the largest whole number that
        is not above the quantity.
    quantity : casadi.SX
        Expression that passes zero, or whole numbers, with the switches inside it held.
    natural : casadi.SX
        That expression with nothing held.
    whole : bool
        True if whole numbers count.
    description : str
        The element, state or input to which it belongs, in words.
    share : casadi.SX
        Jump of the value at the border, as a share of the largest: one, but zero where a direction is continuous.
    """

    node: int
    side: ca.SX
    quantity: ca.SX
    natural: ca.SX
    whole: bool
    description: str = ""
    share: ca.SX = field(default_factory=lambda: ca.SX(1))


def jumps_anywhere(expressions: Sequence[ca.SX], *, bends: bool = False) -> bool:
    """True if expressions contain an operation whose value jumps; with `bends` also one whose slope does."""
    return any(operations(expressions, _held_operations(bends)))


def _held_operations(bends: bool) -> frozenset[int]:
    return JUMPING | BENDING if bends else JUMPING


def hold(
    expressions: Sequence[ca.SX],
    description: str = "",
    *,
    free: Collection[int] = (),
    bends: bool = False,
    symbol: Callable[[str], ca.SX] = ca.SX.sym,
) -> tuple[list[ca.SX], list[Switch]]:
    """Put symbols in the place of operations whose value jumps.

    Parameters
    ----------
    expressions : sequence of casadi.SX
        Of any shape.
    description : str
        To whom they belong, in words.
    free : collection of int
        Hashes of operations that are left as they are.
    bends : bool
        True if operations whose slope jumps are held too.
    symbol : callable
        Makes the symbol of a side from its name.

    Returns
    -------
    held : list of casadi.SX
        The expressions, smooth for given sides.
    switches : list of Switch
        Switches that were held; one that is inside another comes before it.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> held, switches = hold([ca.if_else(x > 2, 5.0, 1.0)])
    >>> ca.symvar(held[0]), switches[0].quantity
    ([SX(side 0)], SX((x-2)))
    """
    switches: list[Switch] = []
    of_interest = _held_operations(bends)

    def held(op: int, node: ca.SX, now: list[ca.SX]) -> ca.SX | None:
        key = node.element_hash()
        if op not in of_interest or key in free:
            return None
        side, whole = symbol(f"side {len(switches)}"), traits(op).whole
        quantity, natural = border_of(op, now), border_of(op, operands(node))
        turn = _held(op, now, ca.SX(0)) - _held(op, now, ca.SX(1)) if op == ca.OP_ATAN2 else 2 * np.pi
        switches.append(Switch(key, side, quantity, natural, whole, description, ca.SX(turn) / (2 * np.pi)))
        return _held(op, now, side)

    return rewritten(expressions, held), switches


def strictly_compared(expressions: Sequence[ca.SX]) -> list[ca.SX]:
    """Return the same expressions, in which a switch has its value at zero wherever its quantity is not positive.

    A quantity may be zero over a stretch, as a penetration, ``fmax(x, 0)``, or a dead zone. Then ``<=`` is true there
    and a sign zero: they are put together from ``<``, which of ``fmax(x, 0) > 0`` makes ``x > 0``.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> strictly_compared([ca.fmax(x, 0) <= 0, ca.sign(ca.if_else(ca.fabs(x) > 1, x, 0)), ca.sign(x)])
    [SX((!(0<x))), SX(@1=0, @2=((1<fabs(x))?x:0), ((@1<@2)-(@2<@1))), SX(sign(x))]
    """

    def strict(op: int, node: ca.SX, now: list[ca.SX]) -> ca.SX | None:
        a, b = now[0], now[-1]
        if op == ca.OP_LT:
            return _less(a, b)
        if op == ca.OP_LE:
            return ca.logic_not(_less(b, a))
        if op == ca.OP_SIGN and any(traits(kind).rests for kind, _ in operations(a)):
            return _less(ca.SX(0), a) - _less(a, ca.SX(0))
        return None

    return rewritten(expressions, strict)


def _less(a: ca.SX, b: ca.SX) -> ca.SX:
    """``a < b``, of quantities that are not equal over a stretch if there are such."""
    zero = ca.SX(0)
    while True:
        if _beside(ca.OP_FMAX, a, b) is not None or _beside(ca.OP_FMIN, b, a) is not None:
            return zero  # fmax(x, b) < b
        for left, right in (
            (a, _beside(ca.OP_FMAX, b, a)),  # a < fmax(x, a)
            (_beside(ca.OP_FMIN, a, b), b),
            (zero, _of_equal_sign(b) if a.is_zero() else None),
            (_of_equal_sign(a) if b.is_zero() else None, zero),
            (b.dep(0) if a.is_zero() and b.op() == ca.OP_NEG else None, zero),
            (zero, a.dep(0) if b.is_zero() and a.op() == ca.OP_NEG else None),
            (b.dep(1), b.dep(0)) if a.is_zero() and b.op() == ca.OP_SUB else (None, None),
            (a.dep(0), a.dep(1)) if b.is_zero() and a.op() == ca.OP_SUB else (None, None),
        ):
            if left is not None and right is not None:
                a, b = left, right
                break
        else:
            return a < b


def _beside(op: int, node: ca.SX, known: ca.SX) -> ca.SX | None:
    """The other operand of an operation of which one is known; None if it is another operation, or on others."""
    if node.op() != op:
        return None
    for one, other in ((0, 1), (1, 0)):
        part = node.dep(one)
        equal = part.is_constant() and known.is_constant() and float(part) == float(known)
        if equal or part.element_hash() == known.element_hash():
            return node.dep(other)
    return None


def _of_equal_sign(node: ca.SX) -> ca.SX | None:
    """What is positive, zero and negative where a multiple or a bounded value of it is; None for anything else."""
    op = node.op()
    if op == ca.OP_TWICE:
        return node.dep(0)
    if op not in (ca.OP_MUL, ca.OP_DIV, ca.OP_FMIN, ca.OP_FMAX):
        return None
    for one, other in ((1, 0), (0, 1)):
        part = node.dep(one)
        if part.is_constant() and (float(part) < 0 if op == ca.OP_FMAX else float(part) > 0):
            return None if op == ca.OP_DIV and one == 0 else node.dep(other)
    return None


def sides_of(values: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Sides of switches at values of their quantities, by row."""
    whole = whole.reshape(-1, *[1] * (values.ndim - 1))
    return np.where(whole, np.floor(values), values > 0).astype(float)


def margins_of(values: np.ndarray, sides: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Distances of quantities from the borders of their sides, by row; negative beyond."""
    shape = (-1, *[1] * (values.ndim - 1))
    sides, whole = sides.reshape(shape), whole.reshape(shape)
    return np.where(whole, np.minimum(values - sides, sides + 1 - values), np.where(sides > 0, values, -values))


def margin_rates_of(values: np.ndarray, rates: np.ndarray, sides: np.ndarray, whole: np.ndarray) -> np.ndarray:
    """Rates of the distances from the nearest borders, by row."""
    shape = (-1, *[1] * (values.ndim - 1))
    sides, whole = sides.reshape(shape), whole.reshape(shape)
    towards_above = np.where(whole, values - sides < 0.5, sides > 0)
    return np.where(towards_above, rates, -rates)


def _held(op: int, operands: Sequence[ca.SX], side: ca.SX) -> ca.SX:
    """The value of an operation on a side, smooth in its operands beyond the border too."""
    held = traits(op).held
    assert held is not None, op
    return held(operands[0], operands[-1], side)
