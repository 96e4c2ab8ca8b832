"""Values at the start or the end of a motion, and integrals over it, inside expressions.

``at_end(crank.phi)`` is the expression with a marker: a node with two operands, the expression and a symbol
that says which value is meant. A placeholder therefore lives exactly as long as the expressions that contain it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca

from ..errors import ExpressionError
from ..model.conditions import Bounded, Condition, read_conditions
from ..model.quantities import quantity
from ..model.symbols import register, role_of, symbols_of
from ..printing import to_text

#: Kinds of placeholders, and the symbols that mark them.
MARKERS = {kind: ca.SX.sym(kind) for kind in ("at_start", "at_end", "integral")}
_ROLES = [register(marker, "placeholder", kind, owner=kind) for kind, marker in MARKERS.items()]
#: Operation that joins an expression and its marker; no model computes with it.
_MARKED = ca.OP_PRINTME


@dataclass(frozen=True, eq=False)
class Placeholder:
    """Value at the start, value at the end, or integral of an expression.

    Attributes
    ----------
    kind : {"at_start", "at_end", "integral"}
        Value that is meant.
    expression : casadi.SX
        Scalar expression of the model.
    node : casadi.SX
        Node that stands for it in other expressions.
    """

    kind: str
    expression: ca.SX
    node: ca.SX

    @property
    def label(self) -> str:
        """Text as the user wrote it."""
        return f"{self.kind}({to_text(self.expression)})"


class _Marked(ca.SX):
    """An expression with its marker, which prints as the user wrote it."""

    def __init__(self, kind: str, expression: Any):
        inner = ca.SX(quantity(expression, kind, "expression"))
        super().__init__(ca.SX.binary(_MARKED, inner, MARKERS[kind]))
        self._label = f"{kind}({to_text(inner)})"

    def __hash__(self) -> int:
        return self.element_hash()

    def __str__(self) -> str:
        return self._label

    def __repr__(self) -> str:
        return self._label


def integral(expression: Any) -> ca.SX:
    """Stand for the integral of an expression over the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("integral", expression)


def at_start(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the start of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("at_start", expression)


def at_end(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the end of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("at_end", expression)


def is_marker(symbol: ca.SX) -> bool:
    """Whether a symbol marks placeholders."""
    role = role_of(symbol)
    return role is not None and role.kind == "placeholder"


def placeholders_in(expression: Any) -> list[Placeholder]:
    """Return the placeholders in an expression, each once."""
    found: dict[int, Placeholder] = {}

    def collect(placeholder: Placeholder) -> ca.SX:
        return found.setdefault(placeholder.node.element_hash(), placeholder).node

    with_values(ca.SX(expression), collect)
    return list(found.values())


def with_values(expression: ca.SX, value: Callable[[Placeholder], Any]) -> ca.SX:
    """Return an expression (any shape) with a value substituted for each of its placeholders."""
    if not any(is_marker(symbol) for symbol in symbols_of(expression)):
        return expression
    known: dict[int, ca.SX] = {}
    elements = [_rebuilt(element, value, known) for element in ca.vertsplit(ca.vec(expression))]
    return ca.reshape(ca.vertcat(*elements), expression.shape)


def _rebuilt(expression: ca.SX, value: Callable[[Placeholder], Any], known: dict[int, ca.SX]) -> ca.SX:
    """Scalar expression with values for its placeholders; `known` holds new nodes by the hashes of the old ones."""
    stack = [expression]
    while stack:
        node = stack[-1]
        key, operands = node.element_hash(), [node.dep(k) for k in range(node.n_dep())]
        missing = [x for x in operands if x.element_hash() not in known]
        if key in known:
            pass
        elif not operands:
            known[key] = node
        elif node.op() == _MARKED and is_marker(operands[1]):
            known[key] = ca.SX(value(Placeholder(operands[1].name(), operands[0], node)))
        elif missing:
            stack += missing
            continue
        else:
            known[key] = _with_operands(node, operands, [known[x.element_hash()] for x in operands])
        stack.pop()
    return known[expression.element_hash()]


def _with_operands(node: ca.SX, old: list[ca.SX], new: list[ca.SX]) -> ca.SX:
    """The operation of a node on other operands."""
    if all(a.element_hash() == b.element_hash() for a, b in zip(old, new, strict=True)):
        return node
    if node.op() in (ca.OP_CALL, ca.OP_OUTPUT):
        raise ExpressionError(
            "a compiled function is applied to at_start(…), at_end(…) or integral(…); write it inside the brackets"
        )
    return ca.SX.unary(node.op(), *new) if len(new) == 1 else ca.SX.binary(node.op(), *new)


def read_marked_conditions(conditions: Any) -> tuple[Condition, ...]:
    """Read conditions as ``read_conditions`` does; labels name placeholders as the user wrote them."""
    single = isinstance(conditions, ca.SX | Bounded | str | dict) or not isinstance(conditions, Iterable)
    entries = conditions if single else list(conditions)
    rows = read_conditions(entries)
    if not any(map(is_marker, (s for row in rows for s in row.symbols))):
        return rows
    named = read_conditions([_named(entry) for entry in ([entries] if single else entries)])
    result: dict[Condition | None, Condition] = {}
    for row, other in zip(rows, named, strict=True):
        result[row] = row if row is other else replace(row, label=other.label, opposite=result.get(row.opposite))
    return tuple(result.values())


def _named(entry: Any) -> Any:
    """A relation with symbols in place of placeholders, for its label."""
    if isinstance(entry, Bounded):
        return Bounded(_named(entry.lower), _named(entry.expression), _named(entry.upper))
    return with_values(entry, lambda p: ca.SX.sym(p.label)) if isinstance(entry, ca.SX) else entry
