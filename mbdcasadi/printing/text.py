"""Expressions in plain text, and in any style."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..errors import ModelError
from ..numerics.graph import count_of_operations
from .forms import Form, Forms, Number, Operation, Product, Scaled, Sum, Symbol
from .terms import Term, TextStyle
from .walk import NO_NAMES, Names, forms_of, is_short

#: Most operations, symbols and numbers that are written out.
LIMIT = 400


def to_text(expression: Any, limit: int = LIMIT, names: Names = NO_NAMES) -> str:
    """Scalar expression as plain text.

    The text is valid Python if the names of the symbols are (``crank.x`` is an
    attribute): ``if_else``, ``atan2``, ``fmax`` and the like are functions.
    Sums and products are written without inner parentheses, with like terms
    and repeated factors collected.

    Parameters
    ----------
    expression : casadi.SX or float
        A scalar.
    limit : int
        Most operations, symbols and numbers to write out, shared parts counted
        at each occurrence; a longer expression is written as ``… (N operations)``.
    names : mapping of int to (float, str), optional
        Parts that are written as a sign times a name, by the hash of the element.

    Returns
    -------
    str
        Numbers are exact up to nine digits; longer ones are rounded to six.

    Raises
    ------
    ModelError
        If it is not a scalar expression.

    Examples
    --------
    >>> import casadi as ca
    >>> x, phi, omega = (ca.SX.sym(f"crank.{name}") for name in ("x", "phi", "omega"))
    >>> to_text(-(x - 0.05 * ca.cos(phi)))
    '0.05*cos(crank.phi) - crank.x'
    >>> to_text(0.05 * omega * ca.cos(phi) * omega)
    '0.05*cos(crank.phi)*crank.omega**2'
    """
    return write(scalar(expression, "to_text"), TextStyle(), limit, names)


def scalar(expression: Any, function: str) -> ca.SX:
    """Expression of one entry.

    Raises
    ------
    ModelError
        For anything else.
    """
    try:
        expression = expression if isinstance(expression, ca.SX) else ca.SX(expression)
    except (TypeError, NotImplementedError):
        raise ModelError(f"{function}: takes an expression in casadi.SX or a number, got {expression!r}") from None
    if not expression.is_scalar():
        raise ModelError(f"{function}: takes a scalar, got shape {expression.shape}; use matrix_{function}")
    return expression


def write(expression: ca.SX, style: TextStyle, limit: int, names: Names = NO_NAMES) -> str:
    """Scalar expression in a style."""
    if expression.nnz() == 0:
        return "0"
    if expression.is_symbolic() and not names:
        return style.symbol(expression.name()).signed
    if expression.is_constant():
        return style.number(float(expression)).signed
    if not is_short(expression, limit, names):
        return style.too_long(count_of_operations(expression))
    forms, whole = forms_of(expression, names)
    writer = _Writer(forms, style)
    return writer.term(whole).signed


class _Writer:
    """Terms of all forms of a table; each below those it is made of."""

    def __init__(self, forms: Forms, style: TextStyle) -> None:
        self.forms, self.style = forms.table, style
        self.terms: list[Term] = []
        for form in self.forms:
            self.terms.append(self._form(form))

    def term(self, scaled: Scaled) -> Term:
        """Term of a number times a form."""
        value, place = scaled
        form = self.forms[place]
        if place == Forms.ONE:
            return self.style.number(value)
        if value == 1:
            return self.terms[place]
        if isinstance(form, Product):
            return self._product(value, form)
        if isinstance(form, Sum) and value == -1:
            return self._sum(value, form)
        return self.style.product(value, [self.terms[place]], [])

    def _form(self, form: Form) -> Term:
        if isinstance(form, Number):
            return self.style.number(form.value)
        if isinstance(form, Symbol):
            return self.style.symbol(form.name)
        if isinstance(form, Sum):
            return self._sum(1.0, form)
        if isinstance(form, Product):
            return self._product(1.0, form)
        return self._operation(form)

    def _sum(self, sign: float, form: Sum) -> Term:
        return self.style.sum([self.term((sign * value, place)) for value, place in form.summands])

    def _product(self, value: float, form: Product) -> Term:
        above, below = (
            [self._power(self.terms[place], exponent) for place, exponent in powers]
            for powers in (form.above, form.below)
        )
        if form.over != 1:
            below.insert(0, self.style.number(form.over))
        return self.style.product(value, above, below)

    def _power(self, base: Term, exponent: int) -> Term:
        return base if exponent == 1 else self.style.power(base, Term(str(exponent)))

    def _operation(self, form: Operation) -> Term:
        style, arguments = self.style, [self.term(argument) for argument in form.arguments]
        if form.kind == "power":
            return style.power(*arguments)
        if form.kind == "comparison":
            return style.comparison(arguments[0], form.name, arguments[1])
        if form.kind == "logic":
            return style.logic(form.name, *arguments)
        if form.kind == "negation":
            return style.negation(*arguments)
        if form.kind == "choice":
            return style.choice(*arguments)
        return style.call(form.name, arguments)
