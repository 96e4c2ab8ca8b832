"""Values at the start or the end of a motion, and integrals over it, inside expressions.

``at_end(crank.phi)`` is the expression with a marker: a node with two operands, the expression and a symbol
that says which value is meant. A placeholder therefore lives exactly as long as the expressions that contain it.
"""

from __future__ import annotations

import itertools
import weakref
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from .quantities import quantity
from .symbols import Scalar, as_sx, register, role_of, symbols_of
from .texts import text_of

#: Kinds of placeholders, and the symbols that mark them; their roles have the kind and the phase as owner.
MARKERS = {kind: ca.SX.sym(kind) for kind in ("at_start", "at_end", "integral")}
#: Kinds that stand for parts of an expression in a running cost, and the symbols that mark them.
PARTS = {kind: ca.SX.sym(kind) for kind in ("positive_part", "absolute")}
_ROLES = [register(marker, "placeholder", kind, owner=(kind, None)) for kind, marker in (MARKERS | PARTS).items()]
#: Operation that joins an expression and its marker; no model computes with it.
_MARKED = ca.OP_PRINTME


@dataclass(frozen=True, eq=False)
class Placeholder:
    """Value at the start, value at the end, or integral of an expression, or a part of a cost."""

    #: "at_start", "at_end", "integral", "positive_part" or "absolute"
    kind: str
    #: scalar expression of the model
    expression: ca.SX
    #: node that stands for it in other expressions
    node: ca.SX
    #: phase that is meant; None for the whole motion
    phase: Any = None

    @property
    def label(self) -> str:
        """Text as the user wrote it."""
        return str(text_of(self.node))


def markers_of(name: str, owner: Any) -> dict[str, tuple[ca.SX, Any]]:
    """Return markers that mean the start, the end and the whole of one phase, with roles that live as long."""
    markers = {kind: ca.SX.sym(f"{name}.{kind}") for kind in MARKERS}
    weak = weakref.ref(owner)  # the phase holds its markers
    return {kind: (x, register(x, "placeholder", f"{name}.{kind}", owner=(kind, weak))) for kind, x in markers.items()}


def marked(marker: tuple[ca.SX, Any], expression: Any) -> ca.SX:
    """Return an expression with the marker of a phase."""
    return _Marked(marker[1].label, expression, marker[0])


class _Marked(ca.SX):
    """An expression with its marker, which prints as the user wrote it."""

    def __init__(self, kind: str, expression: Any, marker: ca.SX | None = None):
        inner = ca.SX(quantity(expression, kind, "expression"))
        super().__init__(ca.SX.binary(_MARKED, inner, MARKERS[kind] if marker is None else marker))

    def __hash__(self) -> int:
        return self.element_hash()

    def __repr__(self) -> str:
        return str(text_of(self))

    __str__ = __repr__


def integral(expression: Scalar) -> ca.SX:
    """Stand for the integral of an expression over the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("integral", expression)


def at_start(expression: Scalar) -> ca.SX:
    """Stand for the value of an expression at the start of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("at_start", expression)


def at_end(expression: Scalar) -> ca.SX:
    """Stand for the value of an expression at the end of the motion, in costs and boundary conditions.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression of the model.
    """
    return _Marked("at_end", expression)


def positive_part(expression: Scalar) -> ca.SX:
    """Return a term for ``max(x, 0)`` in a cost, without its kink: work of a motor without recovery.

    An input s that occurs in no force takes its place in a running cost or an integral, with ``s >= x`` and ``s >= 0``
    along the path; a free parameter in the terminal cost or that of a waypoint. This is exact if the cost grows with s;
    an integral of it may have an upper limit.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression x of the model.
    """
    return _Marked("positive_part", expression, PARTS["positive_part"])


def absolute(expression: Scalar) -> ca.SX:
    """Return a term for ``|x|`` in a cost, without its kink: fuel, or work of a motor in both directions.

    An input s that occurs in no force takes its place in a running cost or an integral, with ``s >= x`` and ``s >= -x``
    along the path; a free parameter in the terminal cost or that of a waypoint. This is exact if the cost grows with s;
    an integral of it may have an upper limit.

    Parameters
    ----------
    expression : casadi.SX
        Scalar expression x of the model.
    """
    return _Marked("absolute", expression, PARTS["absolute"])


def is_marker(symbol: ca.SX) -> bool:
    """Return True if a symbol marks placeholders."""
    role = role_of(symbol)
    return role is not None and role.kind == "placeholder"


def placeholders_in(expression: Any) -> list[Placeholder]:
    """Return the placeholders in an expression, each once."""
    placeholders: dict[int, Placeholder] = {}

    def collect(placeholder: Placeholder) -> ca.SX:
        return placeholders.setdefault(placeholder.node.element_hash(), placeholder).node

    with_values(as_sx(expression), collect)
    return list(placeholders.values())


def with_values(expression: ca.SX, value: Callable[[Placeholder], Any]) -> ca.SX:
    """Return an expression (any shape) with a value substituted for each of its placeholders."""
    if not any(is_marker(symbol) for symbol in symbols_of(expression)):
        return expression
    known: dict[int, ca.SX] = {}
    elements = [_rebuilt(element, value, known) for element in ca.vertsplit(ca.vec(expression))]
    return ca.reshape(ca.vertcat(*elements), expression.shape)


def with_symbols(placeholders: Sequence[Placeholder]) -> tuple[ca.SX, Callable[[ca.SX], ca.SX]]:
    """Return a column of new symbols for placeholders, and the function that substitutes them in an expression."""
    symbols = ca.vertcat(ca.SX(0, 1), *[ca.SX.sym("x") for _ in placeholders])
    known = {x.node.element_hash(): symbols[k] for k, x in enumerate(placeholders)}
    return symbols, lambda expression: with_values(expression, lambda x: known[x.node.element_hash()])


def _rebuilt(expression: ca.SX, value: Callable[[Placeholder], Any], known: dict[int, ca.SX]) -> ca.SX:
    """Scalar expression with values for its placeholders; `known` holds new nodes by the hashes of the old ones."""
    stack = [expression]
    while stack:
        node = stack[-1]
        key, source = node.element_hash(), node.dep(0) if node.is_output() else node
        operands = [source.dep(k) for k in range(source.n_dep())]
        missing = [x for x in operands if x.element_hash() not in known]
        if key in known:
            pass
        elif not operands:
            known[key] = node
        elif node.op() == _MARKED and is_marker(operands[1]):
            known[key] = ca.SX(value(_placeholder(operands[1], operands[0], node)))
        elif missing:
            stack += missing
            continue
        else:
            known[key] = _with_operands(node, operands, [known[x.element_hash()] for x in operands])
        stack.pop()
    return known[expression.element_hash()]


def _placeholder(marker: ca.SX, expression: ca.SX, node: ca.SX) -> Placeholder:
    role = role_of(marker)
    assert role is not None
    kind, phase = role.owner
    return Placeholder(kind, expression, node, None if phase is None else phase())


def _with_operands(node: ca.SX, old: list[ca.SX], new: list[ca.SX]) -> ca.SX:
    """The operation of a node, or the compiled function of which it is an output, on other operands."""
    if all(a.element_hash() == b.element_hash() for a, b in zip(old, new, strict=True)):
        return node
    if node.is_output():
        function = node.dep(0).which_function()
        ends = np.cumsum([0, *(function.nnz_in(k) for k in range(function.n_in()))]).tolist()
        parts = [ca.vertcat(ca.SX(0, 1), *new[first:last]) for first, last in itertools.pairwise(ends)]
        outputs = function.call([ca.SX(function.sparsity_in(k), part) for k, part in enumerate(parts)])
        return ca.vertcat(*[ca.vec(x.nz[:]) for x in outputs])[node.which_output()]
    return ca.SX.unary(node.op(), *new) if len(new) == 1 else ca.SX.binary(node.op(), *new)
