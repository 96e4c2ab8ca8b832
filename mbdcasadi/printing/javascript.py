"""Expressions as JavaScript: straight-line code that evaluates a compiled function in a browser."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca

from ..errors import ExpressionError
from ..numerics.graph import operation_name, operations

#: Operations of one JavaScript function: engines optimise short functions alone.
PIECE = 1200

_INFIX = {ca.OP_ADD: "+", ca.OP_SUB: "-", ca.OP_MUL: "*", ca.OP_DIV: "/", ca.OP_FMOD: "%"}
_COMPARISONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "===", ca.OP_NE: "!=="}
_MATH = {
    ca.OP_EXP: "exp", ca.OP_LOG: "log", ca.OP_SQRT: "sqrt", ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan",
    ca.OP_ASIN: "asin", ca.OP_ACOS: "acos", ca.OP_ATAN: "atan", ca.OP_FLOOR: "floor", ca.OP_CEIL: "ceil",
    ca.OP_FABS: "abs", ca.OP_SIGN: "sign", ca.OP_SINH: "sinh", ca.OP_COSH: "cosh", ca.OP_TANH: "tanh",
    ca.OP_ASINH: "asinh", ca.OP_ACOSH: "acosh", ca.OP_ATANH: "atanh", ca.OP_LOG1P: "log1p", ca.OP_EXPM1: "expm1",
    ca.OP_POW: "pow", ca.OP_CONSTPOW: "pow", ca.OP_FMIN: "min", ca.OP_FMAX: "max", ca.OP_ATAN2: "atan2",
    ca.OP_HYPOT: "hypot",
}  # fmt: skip
_OTHERS: dict[int, Callable[..., str]] = {
    ca.OP_ASSIGN: lambda a: a,
    ca.OP_NEG: lambda a: f"-{a}",
    ca.OP_SQ: lambda a: f"{a}*{a}",
    ca.OP_TWICE: lambda a: f"2*{a}",
    ca.OP_INV: lambda a: f"1/{a}",
    ca.OP_NOT: lambda a: f"{a}===0?1:0",
    ca.OP_AND: lambda a, b: f"{a}!==0&&{b}!==0?1:0",
    ca.OP_OR: lambda a, b: f"{a}!==0||{b}!==0?1:0",
    ca.OP_IF_ELSE_ZERO: lambda a, b: f"{a}!==0?{b}:0",
    ca.OP_COPYSIGN: lambda a, b: f"Math.abs({a})*({b}<0||Object.is({b},-0)?-1:1)",
    ca.OP_PRINTME: lambda a, _: a,
}


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
    known = {*_INFIX, *_COMPARISONS, *_MATH, *_OTHERS}
    return next((operation_name(op) for op, _ in operations(expressions) if op not in known), None)


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
    if op in _INFIX:
        return _INFIX[op].join(operands)
    if op in _COMPARISONS:
        return f"{_COMPARISONS[op].join(operands)}?1:0"
    if op in _MATH:
        return f"Math.{_MATH[op]}({','.join(operands)})"
    if op not in _OTHERS:
        raise ExpressionError(f"the operation '{operation_name(op)}' cannot be written as JavaScript")
    return _OTHERS[op](*operands)


def _number(value: float) -> str:
    if value != value:
        return "NaN"
    if value in (float("inf"), float("-inf")):
        return "Infinity" if value > 0 else "(-Infinity)"
    text = repr(int(value)) if value == int(value) and abs(value) < 1e15 else repr(float(value))
    return f"({text})" if value < 0 or text.startswith("-") else text
