"""Expressions as JavaScript: straight-line code that evaluates a compiled function in a browser."""

from __future__ import annotations

import casadi as ca

from ..errors import ExpressionError
from ..numerics.graph import operations
from ..numerics.operations import operation_name, traits

#: Operations of one JavaScript function: engines optimise short functions alone.
PIECE = 1200


def to_javascript(function: ca.Function, name: str) -> str:
    """Return JavaScript that evaluates a function.

    The code defines ``name(x_1, …, x_k, y)``, with an array for each argument of
    the function, named as there, and the array `y` for its one result. It
    holds nothing but assignments, operation after operation.

    Parameters
    ----------
    function : casadi.Function
        Of SX type, with one dense result.
    name : str
        Name of the JavaScript function.

    Raises
    ------
    ExpressionError
        For an operation that has no counterpart in JavaScript.

    Examples
    --------
    >>> x = ca.SX.sym("x", 2)
    >>> print(to_javascript(ca.Function("f", [x], [ca.sin(x[0]) * x[1]], ["x"], ["y"]), "f"))
    const f_w = new Float64Array(2);
    function f_0(x, y, w) {
    w[0]=Math.sin(x[0]);
    w[0]=w[0]*x[1];
    y[0]=w[0];
    }
    function f(x, y) { f_0(x, y, f_w); }
    """
    arguments = ", ".join(function.name_in())
    lines = _statements(function)
    pieces = [lines[k : k + PIECE] for k in range(0, len(lines), PIECE)]
    heads = [f"{name}_{k}({arguments}, y, " for k in range(len(pieces))]
    code = [f"const {name}_w = new Float64Array({function.sz_w()});"]
    code += [f"function {head}w) {{\n{chr(10).join(piece)}\n}}" for head, piece in zip(heads, pieces, strict=True)]
    code.append(f"function {name}({arguments}, y) {{ {' '.join(f'{head}{name}_w);' for head in heads)} }}")
    return "\n".join(code)


def unknown_operation(expressions: ca.SX) -> str | None:
    """Name of the first operation in expressions that JavaScript lacks; None if there is none."""
    return next((operation_name(op) for op, _ in operations(expressions) if not traits(op).javascript), None)


def _statements(function: ca.Function) -> list[str]:
    names = function.name_in()
    # constants and arguments are written where they are used, until their place is taken by another value
    written: dict[int, str] = {}
    lines = []
    for k, op in enumerate(map(function.instruction_id, range(function.n_instructions()))):
        places, to = function.instruction_input(k), function.instruction_output(k)
        if op == ca.OP_OUTPUT:
            lines.append(f"y[{to[1]}]={written.get(places[0], f'w[{places[0]}]')};")
        elif op == ca.OP_CONST:
            written[to[0]] = _number(function.instruction_constant(k))
        elif op == ca.OP_INPUT:
            written[to[0]] = f"{names[places[0]]}[{places[1]}]"
        else:
            value = _operation(op, [written.get(place, f"w[{place}]") for place in places])
            written.pop(to[0], None)
            lines.append(f"w[{to[0]}]={value};")
    return lines


def _operation(op: int, operands: list[str]) -> str:
    template = traits(op).javascript
    if not template:
        raise ExpressionError(f"the operation '{operation_name(op)}' cannot be written as JavaScript")
    return template.format(x=operands[0], y=operands[-1])


def _number(value: float) -> str:
    if value != value:
        return "NaN"
    if value in (float("inf"), float("-inf")):
        return "Infinity" if value > 0 else "(-Infinity)"
    text = repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))
    return f"({text})" if value < 0 or text.startswith("-") else text
