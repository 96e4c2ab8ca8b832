"""Operations at which the value of an expression jumps, and expressions in which they are held.

A comparison, a sign, a whole number below … has the same value on either side
of a surface ``w = 0`` and another one beyond. With a symbol in its place the
expression is smooth: the side on which a motion is becomes an argument, which
the motion may change at an instant that has a derivative.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...numerics.graph import operands, operations, rewritten

#: Operations whose slope jumps where their operands are equal, or the only one is zero.
BENDING = (ca.OP_FABS, ca.OP_FMAX, ca.OP_FMIN)
#: Operations whose value jumps where a quantity passes zero, or a whole number. Of equalities nothing remains but
#: instants; absolute values, minima and maxima bend without a jump.
JUMPING = frozenset(
    (ca.OP_LT, ca.OP_LE, ca.OP_SIGN, ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD, ca.OP_REMAINDER, ca.OP_COPYSIGN, ca.OP_ATAN2)
)
#: Those that jump at whole numbers.
_AT_WHOLE_NUMBERS = frozenset((ca.OP_FLOOR, ca.OP_CEIL, ca.OP_FMOD, ca.OP_REMAINDER))


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
        The same with nothing held.
    whole : bool
        True if whole numbers count.
    description : str
        The element, state or input to which it belongs, in words.
    """

    node: int
    side: ca.SX
    quantity: ca.SX
    natural: ca.SX
    whole: bool
    description: str = ""


def jumps_anywhere(expressions: Sequence[ca.SX]) -> bool:
    """True if expressions contain an operation whose value jumps."""
    return any(operations(expressions, JUMPING))


def hold(
    expressions: Sequence[ca.SX],
    description: str = "",
    *,
    free: Collection[int] = (),
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

    def held(op: int, node: ca.SX, now: list[ca.SX]) -> ca.SX | None:
        key = node.element_hash()
        if op not in JUMPING or key in free:
            return None
        side, whole = symbol(f"side {len(switches)}"), op in _AT_WHOLE_NUMBERS
        quantity, natural = quantity_of(op, now), quantity_of(op, operands(node))
        switches.append(Switch(key, side, quantity, natural, whole, description))
        return _held(op, now, side)

    return rewritten(expressions, held), switches


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


def quantity_of(op: int, operands: Sequence[ca.SX]) -> ca.SX:
    """Return the quantity that passes zero, or whole numbers, where an operation bends or jumps."""
    a, b = operands[0], operands[-1]
    if op in BENDING:
        return a if len(operands) == 1 else a - b
    if op in (ca.OP_LT, ca.OP_LE):
        return b - a
    if op == ca.OP_CEIL:
        return -a
    if op == ca.OP_COPYSIGN:
        return b
    if op == ca.OP_FMOD:
        return a / b
    if op == ca.OP_REMAINDER:
        return a / b + 0.5
    return a


def _held(op: int, operands: Sequence[ca.SX], side: ca.SX) -> ca.SX:
    """The value of an operation on a side, smooth in its operands beyond the border too."""
    a, b = operands[0], operands[-1]
    sign = 2 * side - 1
    if op in (ca.OP_LT, ca.OP_LE, ca.OP_FLOOR):
        return side
    if op == ca.OP_SIGN:
        return sign
    if op == ca.OP_CEIL:
        return -side
    if op == ca.OP_COPYSIGN:
        return ca.fabs(a) * sign
    if op == ca.OP_FMOD:  # rounds towards zero
        return a - b * (side + (side < 0))
    if op == ca.OP_REMAINDER:
        return a - b * side
    # the angle from the axis of its half plane, ±π/2
    return sign * np.pi / 2 + ca.atan2(-sign * b, sign * a)
