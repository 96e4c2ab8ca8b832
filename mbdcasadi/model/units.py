"""Units of expressions, as far as the symbols in them tell.

The unit of a number in an expression is not known: a length of 0.5 m and the factor 0.5 look the same. What is added to
a quantity has its unit, and a quantity times a number has none that is known; so ``x + 0.5*cos(phi)`` is a length, and
of ``30*x`` nothing is said, which may be the force of a spring.
"""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction

import casadi as ca

from ..numerics.graph import operands, operations
from ..numerics.operations import traits
from .symbols import as_sx, role_of

#: Powers of units, such as {"m": 1, "s": -1}; None for a number, whose unit is not known.
_Powers = dict[str, Fraction]

#: Largest number of operations of an expression that is looked through.
_MOST = 2000
_SUPERSCRIPTS = str.maketrans("0123456789", "⁰¹²³⁴⁵⁶⁷⁸⁹")


def unit_of(expression: ca.SX) -> str:
    """Return the unit of an expression, such as ``"m/s"``; an empty text if it is not known.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> cart = mbd.Body("cart", mass=1, inertia=1)
    >>> unit_of(cart.vx**2 - 4), unit_of(3 * cart.x)
    ('m²/s²', '')
    """
    whole = as_sx(expression)
    if whole.n_dep() == 0:
        return _text(_of_symbol(whole))
    known: dict[int, _Powers | None] = {}
    pure: set[int] = set()

    def powers(node: ca.SX) -> _Powers | None:
        return known[node.element_hash()] if node.n_dep() else _of_symbol(node)

    def is_pure(node: ca.SX) -> bool:
        return node.element_hash() in pure or (node.is_constant() and abs(float(node)) == 1)

    nodes = list(operations(whole))
    if len(nodes) > _MOST:
        return ""
    for kind, node in nodes:
        parts = operands(node)
        units = [powers(part) for part in parts]
        key = node.element_hash()
        of_kind = traits(kind)
        if of_kind.unit == "same":
            known[key] = next((unit for unit in units if unit), None)
        elif of_kind.unit == "angle":
            known[key] = {"rad": Fraction(1)}
        elif of_kind.exponents:
            factors = zip(units, parts, map(Fraction, of_kind.exponents), strict=False)
            known[key] = _product([(unit, exponent) for unit, part, exponent in factors if not is_pure(part)])
        else:
            known[key] = None
        if of_kind.unit == "number" or (kind in (ca.OP_MUL, ca.OP_NEG, ca.OP_SQ) and all(map(is_pure, parts))):
            pure.add(key)
    return _text(powers(whole))


def _product(factors: Sequence[tuple[_Powers | None, Fraction]]) -> _Powers | None:
    """Powers of a product; None if the unit of a factor is not known. An angle is a number beside other quantities."""
    result: _Powers = {}
    for unit, exponent in factors:
        if not unit:
            return None
        for name, power in unit.items():
            result[name] = result.get(name, Fraction(0)) + power * exponent
    if any(name not in ("rad", "s") and power for name, power in result.items()):
        result.pop("rad", None)
    return {name: power for name, power in result.items() if power}


def _of_symbol(symbol: ca.SX) -> _Powers | None:
    role = role_of(symbol) if symbol.is_symbolic() else None
    if role is None:
        return None
    if role.kind == "multiplier":
        return _of_multiplier(symbol, role.owner)
    return _powers(role.unit)


def _of_multiplier(symbol: ca.SX, owner: object) -> _Powers | None:
    """Unit of the reaction of a row: a force for a row that is a length, a couple for one that is an angle."""
    multipliers, rows = getattr(owner, "multipliers", ca.SX(0, 1)), getattr(owner, "rows", ca.SX(0, 1))
    hashes = [s.element_hash() for s in ca.vertsplit(multipliers)]
    k = hashes.index(symbol.element_hash()) if symbol.element_hash() in hashes else rows.numel()
    unit = unit_of(rows[k]) if k < rows.numel() else ""
    return _powers({"m": "N", "rad": "N m"}.get(unit, ""))


def _powers(unit: str) -> _Powers | None:
    """Powers of a unit that is written as ``"N m"`` or ``"rad/s²"``; None for another one, which stays as it is."""
    above, _, below = unit.partition("/")
    result: _Powers = {}
    for text, sign in ((above, 1), (below, -1)):
        for name in text.split():
            bare = name.rstrip("²")
            result[bare] = result.get(bare, Fraction(0)) + sign * (2 if bare != name else 1)
    return result or None


def _text(powers: _Powers | None) -> str:
    if not powers or any(power.denominator > 1 for power in powers.values()):
        return ""

    def side(sign: int) -> str:
        parts = [
            name + ("" if abs(power) == 1 else str(abs(int(power))).translate(_SUPERSCRIPTS))
            for name, power in powers.items()
            if power * sign > 0
        ]
        return " ".join(parts)

    below = side(-1)
    return (side(1) or "1") + (f"/{below}" if below else "")
