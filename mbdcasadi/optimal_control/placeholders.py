"""Symbols that stand for a value at the start, at the end, or for an integral over the motion."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca

from ..model.quantities import quantity
from ..model.symbols import register, symbols_of
from ..printing import to_text


class Placeholder(ca.SX):
    """A symbol for an expression at the start, at the end, or integrated over the motion.

    Made by :func:`at_start`, :func:`at_end` and :func:`integral`.
    """

    def __init__(self, kind: str, expression: Any):
        self.kind = kind
        self.expression = ca.SX(quantity(expression, kind, "expression"))
        self.label = f"{kind}({to_text(self.expression)})"
        super().__init__(ca.SX.sym(self.label))
        self._role = register(self, "placeholder", self.label, owner=self)

    def __hash__(self) -> int:
        return self.element_hash()


#: Placeholders live as long as the expressions in which they may stand, which CasADi does not tell.
_PLACEHOLDERS: dict[int, Placeholder] = {}


def _placeholder(kind: str, expression: Any) -> ca.SX:
    made = Placeholder(kind, expression)
    _PLACEHOLDERS[made.element_hash()] = made
    return made


def integral(expression: Any) -> ca.SX:
    """Stand for the integral of an expression over the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar, of the model.
    """
    return _placeholder("integral", expression)


def at_start(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the start of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar, of the model.
    """
    return _placeholder("at_start", expression)


def at_end(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the end of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar, of the model.
    """
    return _placeholder("at_end", expression)


def placeholder_of(symbol: ca.SX) -> Placeholder | None:
    """Return the placeholder that a symbol is, or None."""
    return _PLACEHOLDERS.get(symbol.element_hash())


def placeholders_in(expression: Any) -> list[Placeholder]:
    """Placeholders on which an expression depends."""
    found = (placeholder_of(symbol) for symbol in symbols_of(expression))
    return [p for p in found if p is not None]


def with_values(expression: ca.SX, value: Callable[[Placeholder], Any]) -> ca.SX:
    """Return an expression with a value, or another expression, put in for each of its placeholders."""
    found = placeholders_in(expression)
    values = [ca.SX(value(p)) for p in found]
    return ca.substitute(expression, ca.vertcat(ca.SX(0, 1), *found), ca.vertcat(ca.SX(0, 1), *values))
