"""Operations in the graphs of expressions."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterator, Sequence

import casadi as ca

#: Instructions that are not operations.
_ENDS = frozenset((ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_PARAMETER))


def operations(
    expressions: Sequence[ca.SX] | ca.SX, kinds: Collection[int] | None = None
) -> Iterator[tuple[int, ca.SX]]:
    """Yield the operations of expressions, operands before the operations on them: their kinds and nodes.

    Parameters
    ----------
    expressions : casadi.SX or sequence of these
        Of any shapes.
    kinds : collection of int, optional
        Only operations of these kinds, by CasADi's numbers.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> [node for _, node in operations(ca.sin(x) + 2)]
    [SX(sin(x)), SX((sin(x)+2))]
    """
    column = expressions if isinstance(expressions, ca.SX) else ca.veccat(*expressions)
    function = ca.Function("graph", [ca.vertcat(ca.SX(0, 1), *ca.symvar(column))], [column])
    nodes = function.instructions_sx()
    for k, kind in enumerate(map(function.instruction_id, range(function.n_instructions()))):
        if kind in kinds if kinds is not None else kind not in _ENDS:
            yield kind, nodes[k]


def count_of_operations(expressions: ca.SX) -> int:
    """Return the number of operations of expressions, shared ones counted once."""
    return sum(1 for _ in operations(expressions))


def operands(node: ca.SX) -> list[ca.SX]:
    """Return the operands of an operation."""
    return [node.dep(k) for k in range(node.n_dep())]


def operation(kind: int, operands: Sequence[ca.SX]) -> ca.SX:
    """Return the operation of a kind on one or two operands."""
    return ca.SX.unary(kind, operands[0]) if len(operands) == 1 else ca.SX.binary(kind, *operands)


def rewritten(
    expressions: Sequence[ca.SX],
    replace: Callable[[int, ca.SX, list[ca.SX]], ca.SX | None],
    combine: Callable[[int, ca.SX, list[ca.SX]], ca.SX] = lambda kind, _, operands: operation(kind, operands),
) -> list[ca.SX]:
    """Return expressions with others in the place of some of their operations.

    Parameters
    ----------
    expressions : sequence of casadi.SX
        Of any shapes.
    replace : callable
        ``(kind, node, operands) -> expression``: what takes the place of an operation, or None; the operands are those
        that the node has by now. It is called for one after the other, for operands before the operations on them.
    combine : callable, optional
        The same for other operations of which an operand has changed: what they are on the new operands.

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> rewritten([ca.sin(x) + 2], lambda kind, node, operands: ca.cos(x) if kind == ca.OP_SIN else None)
    [SX((cos(x)+2))]
    """
    replaced: dict[int, ca.SX] = {}

    def now(nodes: Sequence[ca.SX]) -> list[ca.SX]:
        return [replaced.get(node.element_hash(), node) for node in nodes]

    for kind, node in list(operations(expressions)):
        before = operands(node)
        new = replace(kind, node, now(before))
        if new is None and any(x.element_hash() in replaced for x in before):
            new = combine(kind, node, now(before))
        if new is not None:
            replaced[node.element_hash()] = new
    entries = [now([e.nz[k] for k in range(e.nnz())]) for e in expressions]
    return [ca.SX(e.sparsity(), ca.vertcat(ca.SX(0, 1), *new)) for e, new in zip(expressions, entries, strict=True)]


def components_of_norm(node: ca.SX) -> list[ca.SX] | None:
    """Components of a vector whose length ``norm`` made: ``sqrt(s + (s == 0)) - (s == 0)``, s the sum of squares."""
    if node.n_dep() != 2 or node.op() != ca.OP_SUB:
        return None
    root, zero = node.dep(0), node.dep(1)
    if root.n_dep() != 1 or root.op() != ca.OP_SQRT or zero.n_dep() != 2 or zero.op() != ca.OP_EQ:
        return None
    moved = root.dep(0)
    if moved.n_dep() != 2 or moved.op() != ca.OP_ADD:
        return None
    square, shift = moved.dep(0), moved.dep(1)
    if shift.element_hash() != zero.element_hash() or square.element_hash() != zero.dep(0).element_hash():
        return None
    return _components_of_square(square)


def _components_of_square(square: ca.SX) -> list[ca.SX] | None:
    """Components of a vector of which this is the sum of squares; None for another expression."""
    components, stack = [], [square]
    while stack:
        part = stack.pop()
        if part.n_dep() == 2 and part.op() == ca.OP_ADD:
            stack.extend((part.dep(1), part.dep(0)))
        elif part.n_dep() == 1 and part.op() == ca.OP_SQ:
            components.append(part.dep(0))
        elif part.is_constant() and float(part) > 0:
            components.append(ca.SX(math.sqrt(float(part))))
        elif not part.is_zero():
            return None
    return components


def factors_of_zero(expression: ca.SX) -> list[ca.SX] | None:
    """Expressions that all vanish where a length, a root, a magnitude or a sum of squares does.

    Such an expression is never negative, and where it is zero its gradient is zero or does not exist, so that no
    method of Newton's kind meets ``expression == 0``; the expressions that are returned have gradients there. None
    for an expression of any other kind.
    """
    if expression.is_constant():
        return None
    components = components_of_norm(expression)
    if components is None and expression.n_dep() == 1 and expression.op() in (ca.OP_SQRT, ca.OP_FABS):
        inner = expression.dep(0)
        components = factors_of_zero(inner) or [inner]
    if components is None:
        components = _components_of_square(expression)
    if not components:
        return None
    return [deeper for part in components for deeper in factors_of_zero(part) or [part]]
