"""Pieces of output, and the style of plain text."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import ClassVar

# Precedence of operators, as in Python.
OR, AND, NOT, COMPARISON, SUM, PRODUCT, POWER, ATOM = range(8)


@dataclass(frozen=True)
class Term:
    """A piece of output.

    Attributes
    ----------
    text : str
        Without the leading minus.
    level : int
        Precedence of its outermost operation.
    negative : bool
        True if a minus leads. It belongs to the whole, but to the first summand of a sum.
    function : (str, str) or None
        For a function in LaTeX: its name and its argument, so that the exponent can be written between.
    bare : bool
        True if it ends with an argument without parentheses, which would swallow a factor that follows.
    """

    text: str
    level: int = ATOM
    negative: bool = False
    function: tuple[str, str] | None = None
    bare: bool = False

    @property
    def signed(self) -> str:
        return f"-{self.text}" if self.negative else self.text

    @property
    def opposite(self) -> bool:
        """True if the minus belongs to the whole term."""
        return self.negative and self.level >= PRODUCT


class TextStyle:
    """Style of plain text that Python can read."""

    words: ClassVar[dict[str, str]] = {"and": "and", "or": "or", "not": "not "}

    def symbol(self, name: str) -> Term:
        return Term(name)

    def number(self, value: float) -> Term:
        return Term(digits(abs(value)), negative=value < 0)

    def wrapped(self, text: str) -> str:
        return f"({text})"

    def within(self, term: Term, level: int) -> str:
        """Text of an operand of an operation of a level: in parentheses if it binds less tightly."""
        if term.level < level or (term.negative and level > SUM):
            return self.wrapped(term.signed)
        return term.signed

    def unsigned(self, term: Term) -> Term:
        """Return the term as a factor, whose sign is drawn in front of the product."""
        if term.level >= PRODUCT:
            return replace(term, negative=False)
        return Term(self.wrapped(term.signed))

    def sum(self, terms: Sequence[Term]) -> Term:
        terms = [term if term.level >= SUM else Term(self.wrapped(term.signed)) for term in terms]
        rest = "".join(f" {'-' if term.negative else '+'} {term.text}" for term in terms[1:])
        return Term(terms[0].text + rest, SUM, terms[0].negative)

    def product(self, number: float, above: Sequence[Term], below: Sequence[Term]) -> Term:
        """Write a number times the factors above, over those below."""
        negative = (number < 0) != (sum(term.opposite for term in [*above, *below]) % 2 == 1)
        above, below = list(above), list(below)
        if abs(number) != 1 or not above:
            above.insert(0, self.number(abs(number)))
        return replace(self.fraction(above, below) if below else self.factors(above), negative=negative)

    def factors(self, terms: Sequence[Term]) -> Term:
        terms = [self.unsigned(term) for term in terms]
        if len(terms) == 1:
            return terms[0]
        text = terms[0].text
        for before, term in pairwise(terms):
            text += self.times(before, term) + term.text
        return Term(text, PRODUCT, bare=terms[-1].bare)

    def times(self, a: Term, b: Term) -> str:
        return "*"

    def fraction(self, above: Sequence[Term], below: Sequence[Term]) -> Term:
        return Term(f"{self.factors(above).text}/{self.within(self.factors(below), POWER)}", PRODUCT)

    def power(self, a: Term, exponent: Term) -> Term:
        return Term(f"{self.within(a, ATOM)}**{self.within(exponent, ATOM)}", POWER)

    def comparison(self, a: Term, sign: str, b: Term) -> Term:
        return Term(f"{self.within(a, SUM)} {sign} {self.within(b, SUM)}", COMPARISON)

    def logic(self, word: str, a: Term, b: Term) -> Term:
        level = AND if word == "and" else OR
        return Term(f"{self.within(a, level)} {self.words[word]} {self.within(b, level)}", level)

    def negation(self, a: Term) -> Term:
        return Term(f"{self.words['not']}{self.within(a, NOT)}", NOT)

    def choice(self, condition: Term, a: Term, b: Term) -> Term:
        return self.call("if_else", [condition, a, b])

    def call(self, name: str, arguments: Sequence[Term]) -> Term:
        return Term(f"{name}({', '.join(a.signed for a in arguments)})")

    def too_long(self, count: int) -> str:
        return f"… ({count} operations)"


def digits(value: float) -> str:
    """Shortest decimal text of a number that is not negative; six digits if that is long."""
    exact = repr(float(value)).removesuffix(".0")
    count = len(exact.partition("e")[0].replace(".", "").strip("0"))
    text = exact if count <= 9 else f"{value:.6g}"
    if count <= 3 and value >= 1e6:
        text = f"{value:.3g}"
    mantissa, e, exponent = text.partition("e")
    return f"{mantissa}e{int(exponent)}" if e else mantissa
