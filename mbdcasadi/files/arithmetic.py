"""Arithmetic in time, as the field ``fun`` of a model file holds it.

The text is read by Python's own grammar into a syntax tree, and the tree is
walked: anything but arithmetic is refused, and nothing is ever run as code.
"""

from __future__ import annotations

import ast
import math
import re
from collections.abc import Callable
from typing import Any

import casadi as ca

from ..errors import FileError
from ..model.symbols import t

#: Longest text that is read; longer ones are data, which belong into a spline.
LONGEST = 10_000

CONSTANTS = {"pi": math.pi}

FUNCTIONS: dict[str, Callable[[Any], ca.SX]] = {
    "sin": ca.sin,
    "cos": ca.cos,
    "tan": ca.tan,
    "asin": ca.asin,
    "acos": ca.acos,
    "atan": ca.atan,
    "sinh": ca.sinh,
    "cosh": ca.cosh,
    "tanh": ca.tanh,
    "exp": ca.exp,
    "log": ca.log,
    "sqrt": ca.sqrt,
    "abs": ca.fabs,
}

_BINARY: dict[type, Callable[[Any, Any], ca.SX]] = {
    ast.Add: lambda a, b: a + b,
    ast.Sub: lambda a, b: a - b,
    ast.Mult: lambda a, b: a * b,
    ast.Div: lambda a, b: a / b,
    ast.Pow: lambda a, b: a**b,
}
_UNARY: dict[type, Callable[[Any], ca.SX]] = {ast.UAdd: lambda a: a, ast.USub: lambda a: -a}

#: Powers as in Matlab, and its operations by element, which are the ordinary ones for numbers.
_SPELLINGS = re.compile(r"\.?\^|\.\*|\./")
_FOREIGN = re.compile(r"[^0-9A-Za-z_.+\-*/^(), \t\r\n]")


def parse_arithmetic(text: str, what: str) -> ca.SX:
    """Read arithmetic in ``t`` as an expression.

    Numbers, ``t``, ``pi``, ``+ - * /``, powers as ``^`` or ``**``, parentheses
    and the functions of :data:`FUNCTIONS`. A power binds more tightly than the
    sign before it: ``-t^2`` is ``-(t^2)``. A power of a power needs
    parentheses, since ``2^3^2`` is 64 in Matlab and 512 in Python.

    Parameters
    ----------
    text : str
        The arithmetic.
    what : str
        Its place in the file, for messages: ``"constraint 'driver': fun"``.

    Returns
    -------
    casadi.SX
        Scalar expression in :data:`mbdcasadi.t`.

    Raises
    ------
    FileError
        With the text and the place in it, for anything that is not arithmetic in ``t``.

    Examples
    --------
    >>> parse_arithmetic("2*t^2 + sin(pi*t)", "an example")
    SX(((2.*sq(t))+sin((3.14159*t))))
    """
    return _Reader(text, what).expression()


class _Reader:
    """Parser of one text."""

    def __init__(self, text: str, what: str):
        self.text = text
        self.description = what
        self.places: list[int] = []  # place in the text as written, for each character that Python reads

    def refuse(self, reason: str, place: int | None = None) -> FileError:
        shown = self.text if len(self.text) <= 200 else self.text[:200] + "…"
        at = "" if place is None else f" at character {place + 1}"
        return FileError(
            f"{self.description} = {shown!r}: {reason}{at}; it must be arithmetic in t: numbers, t, pi, + - * / ^, "
            f"parentheses and {', '.join(FUNCTIONS)}"
        )

    def expression(self) -> ca.SX:
        if len(self.text) > LONGEST:
            raise self.refuse(f"it has {len(self.text)} characters, more than {LONGEST}")
        if not self.text.strip():
            raise self.refuse("it is empty")
        foreign = _FOREIGN.search(self.text)
        if foreign:
            raise self.refuse(f"the character {foreign.group()!r} has no meaning", foreign.start())
        try:
            value = self.value(ast.parse(self.as_python(), mode="eval").body)
        except SyntaxError as error:
            place = self.places[min(error.offset or 1, len(self.places)) - 1]
            raise self.refuse("it cannot be read", place) from None
        except (ValueError, RecursionError, MemoryError) as error:
            if isinstance(error, FileError):
                raise
            raise self.refuse("it is nested too deeply, or a number in it is too long") from None
        if value.is_constant() and not math.isfinite(float(value)):
            raise self.refuse(f"its value is {float(value)}")
        return value

    def as_python(self) -> str:
        """Return the text in Python's spelling, on one line and without space before it."""
        pieces, position = [], len(self.text) - len(self.text.lstrip())
        text = self.text.rstrip()
        self.places = []
        for match in [*_SPELLINGS.finditer(text), None]:
            plain = text[position : match.start() if match else len(text)]
            pieces.append(re.sub(r"\s", " ", plain))
            self.places += range(position, position + len(plain))
            if match:
                operation = match.group().lstrip(".").replace("^", "**")
                pieces.append(operation)
                self.places += [match.start()] * len(operation)
                position = match.end()
        return "".join(pieces)

    def value(self, node: ast.AST) -> ca.SX:
        """Value of a node of the syntax tree, or an error with its place in the text."""
        match node:
            case ast.Constant(value=bool() | complex() | str() | bytes() | None):
                pass
            case ast.Constant(value=int() | float() as number):
                return self.number(number, node)
            case ast.Name(id="t"):
                return t
            case ast.Name(id=name) if name in CONSTANTS:
                return ca.SX(CONSTANTS[name])
            case ast.UnaryOp(op=operation, operand=operand) if type(operation) in _UNARY:
                return _UNARY[type(operation)](self.value(operand))
            case ast.BinOp(left=left, op=operation, right=right) if type(operation) in _BINARY:
                self.check_power(operation, right)
                return _BINARY[type(operation)](self.value(left), self.value(right))
            case ast.Call(func=ast.Name(id=name), args=[argument], keywords=[]) if name in FUNCTIONS:
                return FUNCTIONS[name](self.value(argument))
            case ast.Call(func=ast.Name(id=name)) if name in FUNCTIONS:
                raise self.refuse(f"{name} takes one argument", self.place(node))
            case ast.Name(id=name) | ast.Call(func=ast.Name(id=name)):
                raise self.refuse(f"{name!r} is not known", self.place(node))
        raise self.refuse("this is not arithmetic", self.place(node))

    def number(self, value: float, node: ast.AST) -> ca.SX:
        try:
            number = float(value)
        except OverflowError:
            number = math.inf
        if not math.isfinite(number):
            raise self.refuse("a number is too large", self.place(node))
        return ca.SX(number)

    def check_power(self, operation: ast.operator, exponent: ast.expr) -> None:
        """Refuse ``a^b^c``; Python groups it as a^(b^c), so that only the text shows parentheses."""
        if not isinstance(operation, ast.Pow):
            return
        while isinstance(exponent, ast.UnaryOp):
            exponent = exponent.operand
        if isinstance(exponent, ast.BinOp) and isinstance(exponent.op, ast.Pow):
            before = self.text[: self.place(exponent)].rstrip()
            if not before.endswith("("):
                raise self.refuse("a power of a power needs parentheses", self.place(exponent))

    def place(self, node: ast.AST) -> int:
        return self.places[min(getattr(node, "col_offset", 0), len(self.places) - 1)]
