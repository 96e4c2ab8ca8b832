"""Algebra of printed expressions: sums and products flattened, with like terms and factors collected.

CasADi keeps the binary operations in the order in which they were called, so
that derivatives come as ``0.4*w*cos(phi)*w`` and ``-(-0.25*x - 0.4*y)``. A
table of forms holds them as a textbook has them. Each form is there once,
below the forms it is made of, so that a pass through the table needs no recursion.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterable
from dataclasses import dataclass

#: A number times the form at a place in the table.
Scaled = tuple[float, int]


@dataclass(frozen=True)
class Number:
    """A number that is not a coefficient: one, zero, or a number that is not finite."""

    value: float


@dataclass(frozen=True)
class Symbol:
    """A symbol; those of one name are distinguished."""

    name: str
    identity: int


@dataclass(frozen=True)
class Sum:
    """At least two summands; the first has a positive coefficient."""

    summands: tuple[Scaled, ...]


@dataclass(frozen=True)
class Product:
    """``above / (over * below)``: powers of forms with whole positive exponents over a positive number and others."""

    over: float
    above: tuple[tuple[int, int], ...]
    below: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class Operation:
    """Anything else.

    Attributes
    ----------
    kind : str
        ``power``, ``comparison``, ``logic``, ``negation``, ``choice`` or ``call``.
    name : str
        Of the function, or sign of the operation.
    arguments : tuple of (float, int)
        Operands.
    identity : int
        Distinguishes operations of the same name and operands.
    """

    kind: str
    name: str
    arguments: tuple[Scaled, ...]
    identity: int = 0


Form = Number | Symbol | Sum | Product | Operation


class Forms:
    """Table of the forms of an expression."""

    #: Place of the number one.
    ONE = 0

    def __init__(self) -> None:
        self.table: list[Form] = []
        self._places: dict[Hashable, int] = {}
        self._place(Number(1.0))

    def _place(self, form: Form, same: Hashable = None) -> int:
        """Place of a form, or of the one that is the same up to its order."""
        same = form if same is None else same
        if same not in self._places:
            self._places[same] = len(self.table)
            self.table.append(form)
        return self._places[same]

    def of(self, form: Symbol | Operation) -> Scaled:
        return 1.0, self._place(form)

    def number(self, value: float) -> Scaled:
        if math.isfinite(value):
            return value, self.ONE
        return -1.0 if value < 0 else 1.0, self._place(Number(abs(value)))

    def sum(self, parts: Iterable[Scaled]) -> Scaled:
        """Sum with like terms collected, in order of first appearance.

        One that would lead with a minus starts with its first positive summand
        instead; if there is none, the minus is taken out.
        """
        totals: dict[int, float] = {}
        largest: dict[int, float] = {}
        for value, place in parts:
            form = self.table[place]
            flat = form.summands if isinstance(form, Sum) and abs(value) == 1 else ((1.0, place),)
            for part, term in flat:
                totals[term] = totals.get(term, 0.0) + value * part
                largest[term] = max(largest.get(term, 0.0), abs(part * value))
        # coefficients that cancel except for rounding errors are zero
        summands = [
            self.product([((total, term), 1)]) if abs(total) != largest[term] else (total, term)
            for term, total in totals.items()
            if abs(total) > 1e-14 * largest[term]
        ]
        if not summands:
            return 0.0, self.ONE
        positive = [k for k, (value, _) in enumerate(summands) if value > 0]
        sign = 1.0 if positive else -1.0
        if positive and positive[0] > 0:
            lead = next((k for k in positive if summands[k][1] != self.ONE), positive[0])
            summands.insert(0, summands.pop(lead))
        if len(summands) == 1:
            return summands[0]
        summands = [(sign * value, term) for value, term in summands]
        return sign, self._place(Sum(tuple(summands)), ("sum", frozenset(summands)))

    def product(self, factors: Iterable[tuple[Scaled, int]]) -> Scaled:
        """Product of powers with whole exponents: one number, and each factor once, at its last place."""
        number, over = 1.0, 1.0
        above: dict[int, int] = {}
        below: dict[int, int] = {}
        for (value, place), exponent in factors:
            if value < 0 and exponent % 2:
                number = -number
            numbers, powers = self._factors(abs(value), place, exponent)
            for part, power in powers:
                _multiply(above if power > 0 else below, [(part, abs(power))])
            for size, power in numbers:
                if size == 0 and power > 0:
                    return 0.0, self.ONE
                total = _times_power(number if power > 0 else over, size, abs(power))
                if total is None:
                    _multiply(above if power > 0 else below, [(self._place(Number(size)), abs(power))])
                elif power > 0:
                    number = total
                else:
                    over = total
        if (abs(number), over) != (1, 1) and 1e-100 < abs(number) < 1e100 and 1e-100 < over < 1e100:
            number, over = number * self._take_out(above), over * self._take_out(below)
            number, over = math.copysign(number, number * over), abs(over)
        return self._fraction(*_lowest_terms(number, over), self._ordered(above), self._ordered(below))

    def _factors(self, size: float, place: int, exponent: int) -> tuple[list[tuple[float, int]], list[tuple[int, int]]]:
        """Numbers and forms with their exponents of which a power consists."""
        form = self.table[place]
        # The square of a fraction stays one.
        if isinstance(form, Product) and (abs(exponent) == 1 or not form.below):
            powers = [*form.above, *((part, -n) for part, n in form.below)]
            return [(size, exponent), (form.over, -exponent)], [(part, exponent * n) for part, n in powers]
        return [(size, exponent)], [] if place == self.ONE else [(place, exponent)]

    def _take_out(self, powers: dict[int, int]) -> float:
        """Take out the coefficient that all summands of a factor share, as of ``0.5*(2*a + 2*b)``."""
        number = 1.0
        for place, exponent in list(powers.items()):
            form = self.table[place]
            if isinstance(form, Sum) and exponent == 1:
                common = form.summands[0][0]
                if not 1e-9 < common < 1e9 or any(abs(value) != common for value, _ in form.summands):
                    continue
                sign, rest = self.sum((math.copysign(1.0, value), term) for value, term in form.summands)
                if isinstance(self.table[rest], Sum):
                    number *= sign * common
                    del powers[place]
                    _multiply(powers, [(rest, 1)])
        return number

    def _ordered(self, powers: dict[int, int]) -> tuple[tuple[int, int], ...]:
        """Powers with those of sums at the end."""
        return tuple(sorted(powers.items(), key=lambda power: isinstance(self.table[power[0]], Sum)))

    def _fraction(
        self, number: float, over: float, above: tuple[tuple[int, int], ...], below: tuple[tuple[int, int], ...]
    ) -> Scaled:
        if not above and not below:
            return number / over, self.ONE
        if over == 1 and not below and len(above) == 1 and above[0][1] == 1:
            place = above[0][0]
            if number == -1 and isinstance(self.table[place], Sum):
                return self.sum([(number, place)])
            return number, place
        same = ("product", over, frozenset(above), frozenset(below))
        return number, self._place(Product(over, above, below), same)


def _multiply(powers: dict[int, int], factors: Iterable[tuple[int, int]]) -> None:
    """Multiply factors to powers; one that was there moves to the end."""
    for place, exponent in factors:
        powers[place] = powers.pop(place, 0) + exponent


def _times_power(total: float, size: float, exponent: int) -> float | None:
    """``total * size**exponent``, or None if a float does not hold it."""
    if size == 1:
        return total
    try:
        result = total * size**exponent
    except OverflowError:
        return None
    return result if result and math.isfinite(result) else None


def _lowest_terms(number: float, over: float) -> tuple[float, float]:
    """Number and denominator of a fraction; one number if a decimal is as short."""
    if over == 1:
        return number, over
    if number.is_integer() and over.is_integer():
        common = math.gcd(int(number), int(over))
        return number / common, over / common
    quotient = number / over
    short = len(repr(abs(quotient)).partition("e")[0].replace(".", "").strip("0")) <= 9
    if short and quotient * over == number and (abs(number) != 1 or quotient.is_integer()):
        return quotient, 1.0
    return number, over
