"""Operations in the graphs of expressions."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import casadi as ca

#: Names of the operations of CasADi, in small letters.
_NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
#: Instructions that are no operations.
_ENDS = frozenset((ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_CONST, ca.OP_PARAMETER))


def operations(
    expressions: Sequence[ca.SX] | ca.SX, kinds: Collection[int] | None = None
) -> Iterator[tuple[int, ca.SX]]:
    """Yield the operations of expressions, operands before what is made of them: their kinds and nodes.

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


def operation_name(kind: int) -> str:
    """Return the name of a kind of operation, with its number if CasADi gives it none."""
    return _NAMES.get(kind, f"operation_{kind}")


def count_of_operations(expressions: ca.SX) -> int:
    """Return the number of operations of expressions, shared ones counted once."""
    return sum(1 for _ in operations(expressions))


def operands(node: ca.SX) -> list[ca.SX]:
    """Return the operands of an operation."""
    return [node.dep(k) for k in range(node.n_dep())]
