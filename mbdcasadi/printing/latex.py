"""Expressions in LaTeX."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

from ..numerics.operations import OPERATIONS, operation_name
from .names import escaped, latex_name
from .terms import ATOM, NOT, POWER, PRODUCT, Term, TextStyle, digits
from .text import LIMIT, scalar, write


class LatexStyle(TextStyle):
    """Style of LaTeX."""

    words: ClassVar[dict[str, str]] = {"and": r"\land", "or": r"\lor", "not": r"\lnot "}
    signs: ClassVar[dict[str, str]] = {"<=": r"\leq", ">=": r"\geq", "==": "=", "!=": r"\neq"}
    functions: ClassVar[dict[str, str]] = {
        operation_name(op): known.latex
        for op, known in OPERATIONS.items()
        if known.latex and isinstance(known.latex, str)
    }
    fences: ClassVar[dict[str, tuple[str, str]]] = {
        **{operation_name(op): known.latex for op, known in OPERATIONS.items() if isinstance(known.latex, tuple)},
        "norm": (r"\left\|\left(", r"\right)\right\|"),
    }

    def symbol(self, name: str) -> Term:
        return Term(latex_name(name))

    def number(self, value: float) -> Term:
        text = digits(abs(value))
        if text in ("inf", "nan"):
            return Term({"inf": r"\infty", "nan": r"\mathrm{NaN}"}[text], negative=value < 0)
        mantissa, _, exponent = text.partition("e")
        if not exponent:
            return Term(text, negative=value < 0)
        power = f"10^{{{int(exponent)}}}"
        if mantissa == "1":
            return Term(power, POWER, value < 0)
        return Term(rf"{mantissa} \cdot {power}", PRODUCT, value < 0)

    def wrapped(self, text: str) -> str:
        return rf"\left({text}\right)"

    def times(self, a: Term, b: Term) -> str:
        # Two numbers need a dot between them, and so does what follows a bare argument.
        return r" \cdot " if a.bare or b.text[0].isdigit() else r" \, "

    def fraction(self, above: Sequence[Term], below: Sequence[Term]) -> Term:
        # A fraction holds sums without parentheses.
        texts = []
        for terms in (above, below):
            alone = len(terms) == 1 and not terms[0].opposite
            texts.append(terms[0].signed if alone else self.factors(terms).text)
        return Term(rf"\frac{{{texts[0]}}}{{{texts[1]}}}", PRODUCT)

    def power(self, a: Term, exponent: Term) -> Term:
        if a.function is not None and not a.negative:
            name, argument = a.function
            # cos^-1 would be read as the inverse function.
            if exponent.signed.isdigit():
                return Term(f"{name}^{{{exponent.text}}}{argument}", POWER, bare=a.bare)
            return Term(f"{self.wrapped(a.text)}^{{{exponent.signed}}}", POWER)
        return Term(f"{self.within(a, ATOM)}^{{{exponent.signed}}}", POWER)

    def comparison(self, a: Term, sign: str, b: Term) -> Term:
        return super().comparison(a, self.signs.get(sign, sign), b)

    def negation(self, a: Term) -> Term:
        return Term(f"{self.words['not']}{self.within(a, ATOM)}", NOT)

    def choice(self, condition: Term, a: Term, b: Term) -> Term:
        # Iverson's bracket: 1 if the condition holds, else 0.
        parts = [(condition, a), (self.negation(condition), b)]
        terms = [self._bracket(c, value) for c, value in parts if value.text != "0"]
        if len(terms) < 2:
            return terms[0] if terms else Term("0")
        return self.sum(terms)

    def _bracket(self, condition: Term, value: Term) -> Term:
        factor = self.unsigned(value)
        text = rf"\left[{condition.signed}\right] \, {factor.text}"
        return Term(text, PRODUCT, value.opposite, bare=factor.bare)

    def call(self, name: str, arguments: Sequence[Term]) -> Term:
        inside = ", ".join(a.signed for a in arguments)
        if name in self.fences:
            return Term(inside.join(self.fences[name]))
        head = self.functions.get(name, rf"\operatorname{{{escaped(name)}}}")
        alone = len(arguments) == 1 and arguments[0].level == ATOM and not arguments[0].negative
        bare = alone and name in self.functions and arguments[0].function is None
        argument = f"{{{inside if bare else self.wrapped(inside)}}}"
        return Term(head + argument, function=(head, argument), bare=bare)

    def too_long(self, count: int) -> str:
        return rf"\ldots\;\text{{({count} operations)}}"


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
        ``if_else(c, a, b)`` is written with Iverson's bracket, ``[c] a + [¬c] b``: 1 if c holds, else 0.

    Raises
    ------
    ModelError
        If it is not a scalar expression.

    Examples
    --------
    >>> import casadi as ca
    >>> print(to_latex(ca.SX.sym("crank.vx") ** 2 / 2))
    \frac{\dot{x}_{\mathrm{crank}}^{2}}{2}
    """
    return write(scalar(expression, "to_latex"), LatexStyle(), limit)
