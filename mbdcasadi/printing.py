r"""Expressions as in a textbook: plain text and LaTeX.

CasADi prints the graph of an expression, with ``sq(x)``, a pair of parentheses
for each operation, and names ``@1`` for what is shared. Here shared parts are
written out, parentheses stand where precedence asks for them, and LaTeX
knows the coordinates of bodies: ``crank.vx`` is ``\dot{x}_{\mathrm{crank}}``.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import casadi as ca

from .errors import ModelError

#: Most operations, symbols and numbers that are written out.
LIMIT = 400

# What binds how tightly, as in Python.
_OR, _AND, _NOT, _COMPARISON, _SUM, _PRODUCT, _POWER, _ATOM = range(8)

_OP_NAMES = {getattr(ca, name): name[3:].lower() for name in dir(ca) if name.startswith("OP_")}
_LEAVES = (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT, ca.OP_PARAMETER)
_COMPARISONS = {ca.OP_LT: "<", ca.OP_LE: "<=", ca.OP_EQ: "==", ca.OP_NE: "!="}
_TURNED = {"<": ">", "<=": ">=", "==": "==", "!=": "!="}


@dataclass(frozen=True)
class _Term:
    """A piece of output.

    Attributes
    ----------
    text : str
        Without the leading minus.
    level : int
        How tightly its outermost operation binds.
    negative : bool
        Whether a minus leads. It belongs to the whole, but to the first summand of a sum.
    base : (int, int, _Term) or None
        For ``b**n`` with a whole n: hash of b, n and b, so that x x² becomes x³.
    function : (str, str) or None
        For a function in LaTeX: its name and its argument, so that the exponent can stand between.
    bare : bool
        Whether it ends with an argument without parentheses, which would swallow a factor that follows.
    """

    text: str
    level: int = _ATOM
    negative: bool = False
    base: tuple[int, int, _Term] | None = None
    function: tuple[str, str] | None = None
    bare: bool = False

    @property
    def signed(self) -> str:
        return f"-{self.text}" if self.negative else self.text


class _Text:
    """How to write the pieces in plain text; Python can read it."""

    words: ClassVar[dict[str, str]] = {"and": "and", "or": "or", "not": "not "}

    def symbol(self, name: str) -> _Term:
        return _Term(name)

    def number(self, value: float) -> _Term:
        return _Term(_digits(abs(value)), negative=value < 0)

    def wrapped(self, text: str) -> str:
        return f"({text})"

    def within(self, term: _Term, level: int) -> str:
        """Text of an operand of an operation of a level: in parentheses where it binds less tightly."""
        if term.level < level or (term.negative and level > _SUM):
            return self.wrapped(term.signed)
        return term.signed

    def unsigned(self, term: _Term) -> _Term:
        """Return the term as a factor, whose sign is drawn in front of the product."""
        if term.level >= _PRODUCT:
            return replace(term, negative=False)
        return _Term(self.wrapped(term.signed))

    def opposite(self, a: _Term) -> _Term:
        return replace(self.unsigned(a), negative=not _sign(a), base=None, function=None)

    def sum(self, a: _Term, b: _Term, minus: bool) -> _Term:
        if a.level < _SUM:
            a = _Term(self.wrapped(a.signed))
        if b.level < _SUM or (minus and b.level == _SUM):
            b = _Term(self.wrapped(b.signed))
        sign = "-" if minus != b.negative else "+"
        return _Term(f"{a.text} {sign} {b.text}", _SUM, a.negative)

    def product(self, a: _Term, b: _Term) -> _Term:
        negative = _sign(a) != _sign(b)
        a, b = self.unsigned(a), self.unsigned(b)
        return _Term(self.times(a, b), _PRODUCT, negative, bare=b.bare)

    def times(self, a: _Term, b: _Term) -> str:
        return f"{a.text}*{b.text}"

    def quotient(self, a: _Term, b: _Term) -> _Term:
        negative = _sign(a) != _sign(b)
        a, b = self.unsigned(a), self.unsigned(b)
        return _Term(f"{a.text}/{self.within(b, _POWER)}", _PRODUCT, negative)

    def power(self, a: _Term, exponent: _Term) -> _Term:
        return _Term(f"{self.within(a, _ATOM)}**{self.within(exponent, _ATOM)}", _POWER)

    def comparison(self, a: _Term, sign: str, b: _Term) -> _Term:
        return _Term(f"{self.within(a, _SUM)} {sign} {self.within(b, _SUM)}", _COMPARISON)

    def logic(self, word: str, a: _Term, b: _Term) -> _Term:
        level = _AND if word == "and" else _OR
        return _Term(f"{self.within(a, level)} {self.words[word]} {self.within(b, level)}", level)

    def negation(self, a: _Term) -> _Term:
        return _Term(f"{self.words['not']}{self.within(a, _NOT)}", _NOT)

    def choice(self, condition: _Term, a: _Term, b: _Term) -> _Term:
        return self.call("if_else", [condition, a, b])

    def call(self, name: str, arguments: Sequence[_Term]) -> _Term:
        return _Term(f"{name}({', '.join(a.signed for a in arguments)})")

    def too_long(self, count: int) -> str:
        return f"… ({count} operations)"


class _Latex(_Text):
    """How to write the pieces in LaTeX."""

    words: ClassVar[dict[str, str]] = {"and": r"\land", "or": r"\lor", "not": r"\lnot "}
    signs: ClassVar[dict[str, str]] = {"<=": r"\leq", ">=": r"\geq", "==": "=", "!=": r"\neq"}
    functions: ClassVar[dict[str, str]] = {
        **{name: rf"\{name}" for name in ("sin", "cos", "tan", "sinh", "cosh", "tanh", "exp")},
        **{"log": r"\ln", "asin": r"\arcsin", "acos": r"\arccos", "atan": r"\arctan"},
        **{"fmax": r"\max", "fmin": r"\min", "sign": r"\operatorname{sgn}"},
    }
    fences: ClassVar[dict[str, tuple[str, str]]] = {
        "sqrt": (r"\sqrt{", "}"),
        "fabs": (r"\left|", r"\right|"),
        "floor": (r"\left\lfloor ", r"\right\rfloor"),
        "ceil": (r"\left\lceil ", r"\right\rceil"),
    }

    def symbol(self, name: str) -> _Term:
        return _Term(_latex_name(name))

    def number(self, value: float) -> _Term:
        digits = _digits(abs(value))
        if digits in ("inf", "nan"):
            return _Term({"inf": r"\infty", "nan": r"\mathrm{NaN}"}[digits], negative=value < 0)
        mantissa, _, exponent = digits.partition("e")
        if not exponent:
            return _Term(digits, negative=value < 0)
        power = f"10^{{{int(exponent)}}}"
        if mantissa == "1":
            return _Term(power, _POWER, value < 0)
        return _Term(rf"{mantissa} \cdot {power}", _PRODUCT, value < 0)

    def wrapped(self, text: str) -> str:
        return rf"\left({text}\right)"

    def times(self, a: _Term, b: _Term) -> str:
        # Two numbers need a dot between them, and so does what follows a bare argument.
        return f"{a.text} \\cdot {b.text}" if a.bare or b.text[0].isdigit() else f"{a.text} \\, {b.text}"

    def quotient(self, a: _Term, b: _Term) -> _Term:
        # A fraction holds sums without parentheses.
        negative = _sign(a) != _sign(b)
        above, below = (t.text if _sign(t) else t.signed for t in (a, b))
        return _Term(rf"\frac{{{above}}}{{{below}}}", _PRODUCT, negative)

    def power(self, a: _Term, exponent: _Term) -> _Term:
        if a.function is not None and not a.negative:
            name, argument = a.function
            # cos^-1 would be read as the inverse function.
            if exponent.signed.isdigit():
                return _Term(f"{name}^{{{exponent.text}}}{argument}", _POWER, bare=a.bare)
            return _Term(f"{self.wrapped(a.text)}^{{{exponent.signed}}}", _POWER)
        return _Term(f"{self.within(a, _ATOM)}^{{{exponent.signed}}}", _POWER)

    def comparison(self, a: _Term, sign: str, b: _Term) -> _Term:
        return super().comparison(a, self.signs.get(sign, sign), b)

    def negation(self, a: _Term) -> _Term:
        return _Term(f"{self.words['not']}{self.within(a, _ATOM)}", _NOT)

    def choice(self, condition: _Term, a: _Term, b: _Term) -> _Term:
        # Iverson's bracket: 1 where the condition holds, else 0.
        parts = [(condition, a), (self.negation(condition), b)]
        terms = [self._bracket(c, value) for c, value in parts if value.text != "0"]
        if len(terms) < 2:
            return terms[0] if terms else _Term("0")
        return self.sum(terms[0], terms[1], minus=False)

    def _bracket(self, condition: _Term, value: _Term) -> _Term:
        factor = self.unsigned(value)
        text = rf"\left[{condition.signed}\right] \, {factor.text}"
        return _Term(text, _PRODUCT, _sign(value), bare=factor.bare)

    def call(self, name: str, arguments: Sequence[_Term]) -> _Term:
        inside = ", ".join(a.signed for a in arguments)
        if name in self.fences:
            return _Term(inside.join(self.fences[name]))
        head = self.functions.get(name, rf"\operatorname{{{_escaped(name)}}}")
        alone = len(arguments) == 1 and arguments[0].level == _ATOM and not arguments[0].negative
        bare = alone and name in self.functions and arguments[0].function is None
        argument = f"{{{inside if bare else self.wrapped(inside)}}}"
        return _Term(head + argument, function=(head, argument), bare=bare)

    def too_long(self, count: int) -> str:
        return rf"\ldots\;\text{{({count} operations)}}"


def _sign(term: _Term) -> bool:
    """Whether the minus belongs to the whole term."""
    return term.negative and term.level >= _PRODUCT


def _digits(value: float) -> str:
    """Shortest decimal text of a number that is not negative; six digits where that is long."""
    exact = repr(float(value)).removesuffix(".0")
    digits = len(exact.partition("e")[0].replace(".", "").strip("0"))
    text = exact if digits <= 9 else f"{value:.6g}"
    if digits <= 3 and value >= 1e6:
        text = f"{value:.3g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else mantissa


_GREEK = (
    "alpha beta gamma delta epsilon zeta eta theta iota kappa lambda mu nu xi pi rho sigma tau upsilon phi "
    "chi psi omega Gamma Delta Theta Lambda Xi Pi Sigma Upsilon Phi Psi Omega"
).split()
_LETTERS = {**{name: rf"\{name}" for name in _GREEK}, "lam": r"\lambda"}
_COORDINATES = {
    **{"x": "x", "y": "y", "phi": r"\phi", "vx": r"\dot{x}", "vy": r"\dot{y}", "omega": r"\dot{\phi}"},
    **{"ax": r"\ddot{x}", "ay": r"\ddot{y}", "alpha": r"\ddot{\phi}"},
}
_RATES = {"velocity": r"\dot", "acceleration": r"\ddot"}
_SPECIAL = {
    **{c: rf"\{c}" for c in "_ %&#${}"},
    **{"\\": r"\backslash ", "^": r"\wedge ", "~": r"\sim ", "-": r"\text{-}"},
}


def _escaped(text: str) -> str:
    return "".join(_SPECIAL.get(c, c) for c in text)


def _roman(text: str) -> str:
    return rf"\mathrm{{{_escaped(text)}}}"


def _latex_word(name: str) -> tuple[str, str]:
    """Letter and index of a name without an owner: ``tau_1`` is a tau with index 1."""
    letter, _, index = name.partition("_")
    if letter in _LETTERS or len(letter) == 1:
        letter = _LETTERS.get(letter, letter if letter.isalnum() else _escaped(letter))
        if not index and not name.endswith("_"):
            return letter, ""
        if index.isalnum():
            return letter, index if index.isdigit() or len(index) == 1 else _roman(index)
    return _roman(name), ""


def _latex_name(name: str) -> str:
    """Symbol in LaTeX: a coordinate or multiplier carries its owner as index."""
    owner, _, level = name.rpartition(".")
    index = [_roman(owner)] if owner else []
    count = re.fullmatch(r"lam(?:_(\d+)|\[(\d+)\])", level)
    if owner and level in _RATES:
        letter, below = _latex_word(owner)
        letter, index = f"{_RATES[level]}{{{letter}}}", [below] if below else []
    elif owner and level in _COORDINATES:
        letter = _COORDINATES[level]
    elif owner and count:
        letter = r"\lambda"
        index.append(count[1] or count[2])
    else:
        letter, below = _latex_word(level)
        index += [below] if below else []
    return f"{letter}_{{{', '.join(index)}}}" if index else letter


def _is_short(expression: ca.SX, limit: int) -> bool:
    """Whether the expression, with its shared parts written out, has at most `limit` nodes."""
    stack, count = [expression], 0
    while stack:
        node = stack.pop()
        count += 1
        # What waits counts too: the walk ends after `limit` steps, however often parts are shared.
        if count + len(stack) > limit:
            return False
        stack.extend(node.dep(k) for k in range(node.n_dep()))
    return True


def _operations(expression: ca.SX) -> int:
    """Number of operations, shared ones counted once."""
    function = ca.Function("f", ca.symvar(expression), [expression])
    return sum(function.instruction_id(k) not in _LEAVES for k in range(function.n_instructions()))


def _write(expression: ca.SX, style: _Text, limit: int) -> str:
    if expression.nnz() == 0:
        return "0"
    if not _is_short(expression, limit):
        return style.too_long(_operations(expression))
    terms: dict[int, _Term] = {}
    stack = [expression]
    while stack:
        node = stack[-1]
        parts = [node.dep(k) for k in range(node.n_dep())]
        missing = [part for part in parts if part.element_hash() not in terms]
        if missing:
            stack.extend(missing)
        else:
            terms[stack.pop().element_hash()] = _term(node, parts, terms, style)
    return terms[expression.element_hash()].signed


def _term(node: ca.SX, parts: list[ca.SX], terms: dict[int, _Term], style: _Text) -> _Term:
    """Return the term of a node from those of its parts."""
    if node.is_constant():
        return style.number(float(node))
    if node.is_symbolic():
        return style.symbol(node.name())
    op = node.op()
    if op == ca.OP_ADD and (branches := _branches(*parts)):
        return style.choice(*(terms[branch.element_hash()] for branch in branches))
    found = [terms[part.element_hash()] for part in parts]
    if op in (ca.OP_SQ, ca.OP_MUL):
        bases = [term.base or (part.element_hash(), 1, term) for part, term in zip(parts, found, strict=True)]
        if bases[0][0] == bases[-1][0]:
            exponent = 2 * bases[0][1] if op == ca.OP_SQ else bases[0][1] + bases[1][1]
            key, _, base = bases[0]
            return replace(style.power(base, _Term(str(exponent))), base=(key, exponent, base))
    if op in _COMPARISONS:
        a, b, sign = *found, _COMPARISONS[op]
        # CasADi turns x > 0 into 0 < x: what varies is better read on the left.
        if parts[0].is_constant():
            return style.comparison(b, _TURNED[sign], a)
        return style.comparison(a, sign, b)
    if op == ca.OP_IF_ELSE_ZERO:
        condition, zero = found[0], _Term("0")
        if parts[0].op() == ca.OP_NOT:
            return style.choice(terms[parts[0].dep(0).element_hash()], zero, found[1])
        return style.choice(condition, found[1], zero)
    if op in _WRITERS:
        return _WRITERS[op](style, *found)
    return style.call(_function_name(node), found)


def _branches(a: ca.SX, b: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX] | None:
    """Condition and branches of ``if_else``, which CasADi writes as ``(c ? x : 0) + (!c ? y : 0)``."""
    for first, second in ((a, b), (b, a)):
        if first.n_dep() == second.n_dep() == 2 and first.op() == second.op() == ca.OP_IF_ELSE_ZERO:
            opposite = second.dep(0)
            if opposite.n_dep() == 1 and opposite.op() == ca.OP_NOT:
                if opposite.dep(0).element_hash() == first.dep(0).element_hash():
                    return first.dep(0), first.dep(1), second.dep(1)
    return None


def _function_name(node: ca.SX) -> str:
    if node.is_call():
        return node.which_function().name()
    if node.is_output():
        return f"output_{node.which_output()}"
    return _OP_NAMES.get(node.op(), f"operation_{node.op()}")


_ONE, _TWO = _Term("1"), _Term("2")
_WRITERS: dict[int, Callable[..., _Term]] = {
    ca.OP_ADD: lambda style, a, b: style.sum(a, b, minus=False),
    ca.OP_SUB: lambda style, a, b: style.sum(a, b, minus=True),
    ca.OP_NEG: lambda style, a: style.opposite(a),
    ca.OP_MUL: lambda style, a, b: style.product(a, b),
    ca.OP_TWICE: lambda style, a: style.product(_TWO, a),
    ca.OP_DIV: lambda style, a, b: style.quotient(a, b),
    ca.OP_INV: lambda style, a: style.quotient(_ONE, a),
    ca.OP_POW: lambda style, a, b: style.power(a, b),
    ca.OP_CONSTPOW: lambda style, a, b: style.power(a, b),
    ca.OP_AND: lambda style, a, b: style.logic("and", a, b),
    ca.OP_OR: lambda style, a, b: style.logic("or", a, b),
    ca.OP_NOT: lambda style, a: style.negation(a),
}


def _scalar(expression: Any, where: str) -> ca.SX:
    try:
        expression = ca.SX(expression)
    except (TypeError, NotImplementedError):
        raise ModelError(
            f"{where}: takes an expression in casadi.SX or a number, got {expression!r}"
        ) from None
    if not expression.is_scalar():
        raise ModelError(f"{where}: takes a scalar, got shape {expression.shape}; use matrix_{where}")
    return expression


def to_text(expression: Any, limit: int = LIMIT) -> str:
    """Scalar expression as plain text.

    What Python can read, if the names of the symbols are (``crank.x`` is an
    attribute): ``if_else``, ``atan2``, ``fmax`` and the like stand for functions.

    Parameters
    ----------
    expression : casadi.SX or float
        A scalar.
    limit : int
        Most operations, symbols and numbers to write out, shared parts counted
        wherever they stand; a longer expression is given as ``… (N operations)``.

    Returns
    -------
    str
        Numbers are exact up to nine digits; longer ones are rounded to six.

    Raises
    ------
    ModelError
        For what is no scalar expression.

    Examples
    --------
    >>> x, phi = ca.SX.sym("crank.x"), ca.SX.sym("crank.phi")
    >>> to_text(x + 0.05 * ca.cos(phi) - 0.1)
    'crank.x + 0.05*cos(crank.phi) - 0.1'
    """
    return _write(_scalar(expression, "to_text"), _Text(), limit)


def to_latex(expression: Any, limit: int = LIMIT) -> str:
    r"""Scalar expression in LaTeX, for math mode.

    Parameters
    ----------
    expression : casadi.SX or float
        A scalar.
    limit : int
        As in :func:`to_text`.

    Returns
    -------
    str
        ``if_else(c, a, b)`` is written with Iverson's bracket, ``[c] a + [¬c] b``: 1 where c holds, else 0.

    Raises
    ------
    ModelError
        For what is no scalar expression.

    Examples
    --------
    >>> print(to_latex(ca.SX.sym("crank.vx") ** 2 / 2))
    \frac{\dot{x}_{\mathrm{crank}}^{2}}{2}
    """
    return _write(_scalar(expression, "to_latex"), _Latex(), limit)


def _entries(matrix: Any, style: _Text, limit: int, where: str) -> list[list[str]]:
    try:
        matrix = ca.SX(matrix)
    except (TypeError, NotImplementedError):
        raise ModelError(f"{where}: takes a matrix in casadi.SX or of numbers, got {matrix!r}") from None
    rows, columns = matrix.shape
    return [[_write(matrix[i, j], style, limit) for j in range(columns)] for i in range(rows)]


def _names(names: Sequence[str] | None, count: int, what: str) -> list[str]:
    names = [""] * count if names is None else [str(name) for name in names]
    if len(names) != count:
        raise ModelError(f"matrix_to_text: got {len(names)} {what} names for {count} {what}s")
    return names


def matrix_to_text(
    matrix: Any,
    row_names: Sequence[str] | None = None,
    column_names: Sequence[str] | None = None,
    limit: int = LIMIT,
) -> str:
    """Matrix or vector as plain text, with aligned columns.

    Parameters
    ----------
    matrix : casadi.SX, casadi.DM or numpy.ndarray
        Any shape; a vector is a column.
    row_names, column_names : sequence of str, optional
        Names in front of the rows and above the columns.
    limit : int
        As in :func:`to_text`, for each entry.

    Returns
    -------
    str
        One line a row.

    Raises
    ------
    ModelError
        For what is no matrix, and for names that do not match its shape.

    Examples
    --------
    >>> print(matrix_to_text(ca.diag(ca.SX.sym("m", 2)), row_names=["x", "y"]))
    x [ m_0    0 ]
    y [   0  m_1 ]
    """
    entries = _entries(matrix, _Text(), limit, "matrix_to_text")
    rows, columns = ca.SX(matrix).shape
    row_names, heads = _names(row_names, rows, "row"), _names(column_names, columns, "column")
    widths = [max(map(len, [head, *column])) for head, *column in zip(heads, *entries, strict=True)]
    margin = max(map(len, row_names), default=0)
    margin += margin > 0

    def line(name: str, values: Sequence[str], left: str, right: str) -> str:
        cells = "  ".join(value.rjust(width) for value, width in zip(values, widths, strict=True))
        return f"{name.ljust(margin)}{left} {cells} {right}".rstrip()

    lines = [line("", heads, " ", "")] if any(heads) else []
    lines += [line(name, row, "[", "]") for name, row in zip(row_names, entries, strict=True)]
    return "\n".join(lines)


def matrix_to_latex(matrix: Any, limit: int = LIMIT) -> str:
    """Matrix or vector in LaTeX, as a ``bmatrix`` (package amsmath).

    Parameters
    ----------
    matrix : casadi.SX, casadi.DM or numpy.ndarray
        Any shape; a vector is a column.
    limit : int
        As in :func:`to_text`, for each entry.

    Returns
    -------
    str
        For math mode.

    Raises
    ------
    ModelError
        For what is no matrix.
    """
    rows = [" & ".join(row) for row in _entries(matrix, _Latex(), limit, "matrix_to_latex")]
    return "\\begin{bmatrix}\n" + " \\\\\n".join(rows) + "\n\\end{bmatrix}"
