"""The operations of CasADi's expressions: one row for each, with all that the package knows of it.

C, JavaScript, printed forms, units and switching functions are columns of one table. An operation that is new to
CasADi is one new row.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import casadi as ca
import numpy as np

from ..errors import MechanismError

#: Value of an operation from expressions.
_Value = Callable[..., ca.SX]


@dataclass(frozen=True, kw_only=True)
class Traits:
    """What is known of an operation on one operand `x`, or on two, `x` and `y`.

    Attributes
    ----------
    c, javascript : str
        Code in which ``{x}`` and ``{y}`` stand for the operands; empty if there is none.
    form : tuple of str
        Kind and sign or name of the form in print: ``("comparison", "<")``; of any other one the call of a function.
    latex : str or tuple of str
        Function in LaTeX, or what stands before and behind the operand.
    summands, factors : tuple of int
        Signs of the operands of a sum; exponents of those of a product, without its number.
    exponents : tuple of float
        Exponents of the units of the operands in the unit of the result.
    unit : str
        Unit of the result otherwise: ``same`` as of the operands, an ``angle``, or of a pure ``number``.
    border : callable
        ``(x, y) -> w``: `w` is zero, or a whole number, where the operation is not smooth.
    whole : bool
        True if whole numbers count.
    at_border : str
        ``bends`` if the slope jumps there, ``jumps`` if the value does, ``instant`` if another value is at the border
        alone, ``singular`` if a derivative has no bound.
    held : callable
        ``(x, y, side) -> value`` of what bends or jumps: smooth beyond the border too. The side is 1 for positive `w`,
        else 0; for whole numbers the largest one that is not above `w`.
    rounded : callable
        ``(x, y, w, size) -> value``, with `size` in the place of ``|w|``; ``(x, y) -> value`` for logic, of truth
        values between 0 and 1.
    rests : bool
        True if it may be constant while its operands change.
    transient : bool
        True if it may cause a short transient.
    """

    c: str = ""
    javascript: str = ""
    form: tuple[str, str] = ("call", "")
    latex: str | tuple[str, str] = ""
    summands: tuple[int, ...] = ()
    factors: tuple[int, ...] = ()
    exponents: tuple[float, ...] = ()
    unit: Literal["", "same", "angle", "number"] = ""
    border: _Value | None = None
    whole: bool = False
    at_border: Literal["", "bends", "jumps", "instant", "singular"] = ""
    held: _Value | None = None
    rounded: _Value | None = None
    rests: bool = False
    transient: bool = False


def _written(c: str, **columns: object) -> Traits:
    """Row of an operation whose JavaScript is its C without spaces."""
    return Traits(c=c, javascript=c.replace(" ", ""), **columns)  # type: ignore[arg-type]


def _function(name: str, in_javascript: str | None = None, *, two: bool = False, **columns: object) -> Traits:
    """Row of a function of C and of ``Math``; ``in_javascript`` is its name there, empty if there is none."""
    call = f"{name}({{x}}, {{y}})" if two else f"{name}({{x}})"
    own = name if in_javascript is None else in_javascript
    script = f"Math.{own}{call.removeprefix(name).replace(' ', '')}" if own else ""
    return Traits(c=call, javascript=script, **columns)  # type: ignore[arg-type]


def _truth(c: str, javascript: str, kind: str, sign: str, **columns: object) -> Traits:
    """Row of an operation whose value is true or false."""
    return Traits(c=c, javascript=f"{javascript}?1:0", form=(kind, sign), rests=True, **columns)  # type: ignore[arg-type]


def _extreme(c: str, javascript: str, latex: str, sign: int) -> Traits:
    """Row of the larger operand, or of the smaller one."""
    return Traits(
        c=c, javascript=javascript, latex=latex, unit="same", at_border="bends", rests=True,
        border=lambda x, y: x - y,
        held=lambda x, y, side: side * (x if sign > 0 else y) + (1 - side) * (y if sign > 0 else x),
        rounded=lambda x, y, w, size: (x + y + sign * size) / 2,
    )  # fmt: skip


def _half_plane_angle(x: ca.SX, y: ca.SX, side: ca.SX) -> ca.SX:
    """Angle of a vector from the axis of a half plane, ±π/2."""
    sign = 2 * side - 1
    return -sign * np.pi / 2 + ca.atan2(sign * y, -sign * x)


def _less_rounded(x: ca.SX, y: ca.SX, w: ca.SX, size: ca.SX) -> ca.SX:
    return (1 + w / size) / 2


#: Rows by the names of CasADi, in the order of the codes of tapes.
_ROWS = {
    "ASSIGN": _written("{x}"),
    "ADD": _written("{x} + {y}", summands=(1, 1), unit="same"),
    "SUB": _written("{x} - {y}", summands=(1, -1), unit="same"),
    "MUL": _written("{x} * {y}", factors=(1, 1), exponents=(1, 1)),
    "DIV": _written(
        "{x} / {y}", factors=(1, -1), exponents=(1, -1), border=lambda x, y: y, at_border="singular", transient=True
    ),
    "NEG": _written("-{x}", summands=(-1,), unit="same"),
    "EXP": _function("exp", latex=r"\exp", unit="number", transient=True),
    "LOG": _function("log", latex=r"\ln", unit="number", border=lambda x, y: x, at_border="singular"),
    "POW": _function("pow", two=True, form=("power", ""), border=lambda x, y: x, at_border="singular", transient=True),
    "CONSTPOW": _function(
        "pow", two=True, form=("power", ""), border=lambda x, y: x, at_border="singular", transient=True
    ),
    "SQRT": _function("sqrt", latex=(r"\sqrt{", "}"), exponents=(0.5,), border=lambda x, y: x, at_border="singular"),
    "SQ": _written("{x} * {x}", factors=(2,), exponents=(2,)),
    "TWICE": Traits(c="{x} + {x}", javascript="2*{x}", factors=(1,), unit="same"),
    "SIN": _function("sin", latex=r"\sin", unit="number"),
    "COS": _function("cos", latex=r"\cos", unit="number"),
    "TAN": _function("tan", latex=r"\tan", unit="number", border=lambda x, y: ca.cos(x), at_border="singular"),
    "ASIN": _function("asin", latex=r"\arcsin", unit="angle", border=lambda x, y: x * x - 1, at_border="singular"),
    "ACOS": _function("acos", latex=r"\arccos", unit="angle", border=lambda x, y: x * x - 1, at_border="singular"),
    "ATAN": _function("atan", latex=r"\arctan", unit="angle", transient=True),
    "LT": _truth(
        "{x} < {y}", "{x}<{y}", "comparison", "<", at_border="jumps",
        border=lambda x, y: y - x, held=lambda x, y, side: side, rounded=_less_rounded,
    ),
    "LE": _truth(
        "{x} <= {y}", "{x}<={y}", "comparison", "<=", at_border="jumps",
        border=lambda x, y: y - x, held=lambda x, y, side: side, rounded=_less_rounded,
    ),
    "EQ": _truth("{x} == {y}", "{x}==={y}", "comparison", "==", border=lambda x, y: x - y, at_border="instant"),
    "NE": _truth("{x} != {y}", "{x}!=={y}", "comparison", "!=", border=lambda x, y: x - y, at_border="instant"),
    "NOT": _truth("{x} == 0", "{x}===0", "negation", "not", rounded=lambda x, y: 1 - x),
    "AND": _truth("{x} != 0 && {y} != 0", "{x}!==0&&{y}!==0", "logic", "and", rounded=lambda x, y: x * y),
    "OR": _truth("{x} != 0 || {y} != 0", "{x}!==0||{y}!==0", "logic", "or", rounded=lambda x, y: x + y - x * y),
    "FLOOR": _function(
        "floor", latex=(r"\left\lfloor ", r"\right\rfloor"), rests=True,
        border=lambda x, y: x, whole=True, at_border="jumps", held=lambda x, y, side: side,
    ),
    "CEIL": _function(
        "ceil", latex=(r"\left\lceil ", r"\right\rceil"), rests=True,
        border=lambda x, y: -x, whole=True, at_border="jumps", held=lambda x, y, side: -side,
    ),
    "FMOD": Traits(
        c="fmod({x}, {y})", javascript="{x}%{y}", border=lambda x, y: x / y, whole=True, at_border="jumps",
        held=lambda x, y, side: x - y * (side + (side < 0)),  # it rounds towards zero
    ),
    "FABS": _function(
        "fabs", "abs", latex=(r"\left|", r"\right|"), unit="same", rests=True, border=lambda x, y: x,
        at_border="bends", held=lambda x, y, side: x * (2 * side - 1), rounded=lambda x, y, w, size: size,
    ),
    "SIGN": Traits(
        c="{x} < 0 ? -1.0 : {x} > 0 ? 1.0 : {x}", javascript="Math.sign({x})", latex=r"\operatorname{sgn}",
        unit="number", rests=True, border=lambda x, y: x, at_border="jumps",
        held=lambda x, y, side: 2 * side - 1, rounded=lambda x, y, w, size: w / size,
    ),
    "COPYSIGN": Traits(
        c="copysign({x}, {y})", javascript="Math.abs({x})*({y}<0||Object.is({y},-0)?-1:1)",
        border=lambda x, y: -y, at_border="jumps", held=lambda x, y, side: -ca.fabs(x) * (2 * side - 1),
    ),
    "IF_ELSE_ZERO": Traits(
        c="{x} == 0 ? 0.0 : {y}", javascript="{x}!==0?{y}:0", rests=True, rounded=lambda x, y: x * y
    ),
    "ERF": _function("erf", "", transient=True),
    # as fmin and fmax, which compilers call: of a number and NaN the number
    "FMIN": _extreme("{x} < {y} || {y} != {y} ? {x} : {y}", "Math.min({x},{y})", r"\min", -1),
    "FMAX": _extreme("{x} > {y} || {y} != {y} ? {x} : {y}", "Math.max({x},{y})", r"\max", 1),
    "INV": Traits(
        c="1.0 / {x}", javascript="1/{x}", factors=(-1,), border=lambda x, y: x, at_border="singular", transient=True
    ),
    "SINH": _function("sinh", latex=r"\sinh"),
    "COSH": _function("cosh", latex=r"\cosh"),
    "TANH": _function("tanh", latex=r"\tanh", unit="number", transient=True),
    "ASINH": _function("asinh"),
    "ACOSH": _function("acosh"),
    "ATANH": _function("atanh"),
    # the angle of what lies on the border itself is +π
    "ATAN2": _function(
        "atan2", two=True, unit="angle", border=lambda x, y: -x, at_border="jumps", held=_half_plane_angle
    ),
    "LOG1P": _function("log1p"),
    "EXPM1": _function("expm1", transient=True),
    "HYPOT": _function("hypot", two=True),
    "REMAINDER": Traits(
        c="remainder({x}, {y})", border=lambda x, y: x / y + 0.5, whole=True, at_border="jumps",
        held=lambda x, y, side: x - y * side,
    ),
    "PRINTME": Traits(javascript="{x}"),
}  # fmt: skip

#: Operations by CasADi's numbers.
OPERATIONS = {getattr(ca, f"OP_{name}"): row for name, row in _ROWS.items()}
#: Operations whose slope jumps where their operands are equal, or the only one is zero.
BENDING = frozenset(op for op, row in OPERATIONS.items() if row.at_border == "bends")
#: Operations whose value jumps where a quantity passes zero, or a whole number. Of equalities nothing remains but
#: instants; absolute values, minima and maxima bend without a jump.
JUMPING = frozenset(op for op, row in OPERATIONS.items() if row.at_border == "jumps")
#: Operations whose value is true or false.
TRUTHS = frozenset(op for op, row in OPERATIONS.items() if row.form[0] in ("comparison", "logic", "negation"))
_UNKNOWN = Traits()
#: Names of the operations of CasADi, in small letters.
_NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}


def operation_name(kind: int) -> str:
    """Return the name of a kind of operation, with its number if CasADi gives it none."""
    return _NAMES.get(kind, f"operation_{kind}")


def traits(kind: int) -> Traits:
    """Return what is known of a kind of operation; of one that is not in the table, as a call, nothing."""
    return OPERATIONS.get(kind, _UNKNOWN)


def border_of(kind: int, operands: Sequence[ca.SX]) -> ca.SX:
    """Return the quantity that is zero, or a whole number, where an operation is not smooth.

    Raises
    ------
    MechanismError
        For an operation that is smooth.
    """
    border = traits(kind).border
    if border is None:
        raise MechanismError(f"the operation '{operation_name(kind)}' is smooth and has no border")
    return border(operands[0], operands[-1])
