"""Positive parts and magnitudes in costs, split without kinks by symbols that occur in no force."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import casadi as ca

from ...errors import ExpressionError
from ...model.conditions import Bounded, Condition, Soft, read_condition, read_conditions
from ...model.mechanism import Mechanism
from ...model.placeholders import PARTS, Placeholder, absolute, integral, positive_part, with_values
from ...model.quantities import is_list
from ...model.symbols import Input, Parameter, Symbol

#: What is left of costs once their parts are split.
Expressions = TypeVar("Expressions")


@dataclass(frozen=True, eq=False)
class SoftLimit:
    """A condition that may be passed at a price."""

    condition: Condition
    #: of the amount in the cost
    weight: float | ca.SX
    #: by which it is passed: a part of a cost, or the symbol in place of it
    amount: ca.SX

    @staticmethod
    def of(condition: Condition, weight: float | ca.SX, value: Callable[[ca.SX], ca.SX] = ca.SX) -> SoftLimit:
        """Return the soft limit of a condition, with a value of its expression, such as that at the end."""
        part = absolute if condition.equality else positive_part
        return SoftLimit(condition, weight, part(value(condition.expression)))


class Amount(Input):
    """An input in place of a part of a cost."""

    acts = False


def hard_and_soft(conditions: Any) -> tuple[tuple[Condition, ...], tuple[SoftLimit, ...]]:
    """Return conditions that hold, and those that may be passed."""
    given = [conditions] if isinstance(conditions, ca.SX | Bounded | Soft) else conditions
    if not is_list(given):
        return read_conditions(given), ()
    hard, soft = list[Condition](), list[SoftLimit]()
    for position, entry in enumerate(given, start=1):
        if isinstance(entry, SoftLimit):
            soft.append(entry)
        elif isinstance(entry, Soft):
            soft += [SoftLimit.of(condition, entry.weight) for condition in entry.conditions]
        else:
            hard += read_condition(entry, position)
    return tuple(hard), tuple(soft)


def price(soft: Iterable[SoftLimit]) -> ca.SX:
    """Return what soft limits add to the cost, or to its integrand."""
    return sum((limit.weight * limit.amount for limit in soft), ca.SX(0))


class CostParts:
    """Symbols in place of the parts in costs, and the limits below which they cannot fall.

    `make` makes a symbol from its label: an input along the path, a parameter at an instant.
    """

    def __init__(self, make: Callable[[str], Symbol]):
        self.symbols: list[Symbol] = []
        self._make, self._limits, self._known = make, list[ca.SX](), dict[int, Symbol]()

    @property
    def limits(self) -> tuple[Condition, ...]:
        """``s >= x``, and ``s >= 0`` or ``s >= -x``, of each symbol s."""
        return tuple(replace(limit, definition=True) for limit in read_conditions(self._limits))

    def split(self, cost: ca.SX, where: str) -> ca.SX:
        """Return a cost with a symbol for each :func:`positive_part` and :func:`absolute`; it must grow with them."""
        return self._refuse_falling(with_values(cost, self._value), where)

    def split_integrals(self, expression: ca.SX, where: str) -> ca.SX:
        """Return a cost, or the left side of ``<= 0``, with symbols for the parts inside its integrals."""

        def value(placeholder: Placeholder) -> ca.SX:
            if placeholder.kind != "integral" or placeholder.phase is not None:
                return placeholder.node
            integrand = with_values(placeholder.expression, self._value)
            same = integrand.element_hash() == placeholder.expression.element_hash()
            return placeholder.node if same else integral(integrand)

        return self._refuse_falling(with_values(expression, value), where)

    def split_soft(self, soft: Iterable[SoftLimit]) -> tuple[SoftLimit, ...]:
        """Return soft limits with symbols in place of the amounts by which they are passed."""
        return tuple(replace(limit, amount=self.split(limit.amount, limit.condition.label)) for limit in soft)

    def _refuse_falling(self, expression: ca.SX, where: str) -> ca.SX:
        if not self.symbols:
            return expression
        slopes = ca.densify(ca.jacobian(expression, ca.vertcat(*self.symbols)))
        for symbol, slope in zip(self.symbols, ca.horzsplit(slopes), strict=True):
            if slope.is_constant() and float(slope) < 0:
                raise ExpressionError(
                    f"{where} falls with {symbol.label}; positive_part and absolute belong in costs, and in upper "
                    "limits of integrals, that grow with them"
                )
        return expression

    def _value(self, part: Placeholder) -> ca.SX:
        if part.kind not in PARTS:
            return part.node
        key = part.node.element_hash()
        if key not in self._known:
            slack = self._known[key] = self._make(part.label)
            self.symbols.append(slack)
            other = 0 if part.kind == "positive_part" else -part.expression
            self._limits += [slack >= part.expression, slack >= other]
        return self._known[key]


def split_along_path(
    mechanism: Mechanism, path: tuple[Condition, ...], split: Callable[[CostParts], Expressions]
) -> tuple[Mechanism, tuple[Condition, ...], Expressions]:
    """Return mechanism and path conditions with an input for each part that is split, and the expressions."""
    parts = CostParts(Amount)
    expressions = split(parts)
    if not parts.symbols:
        return mechanism, path, expressions
    return mechanism.replace(inputs=[*mechanism.inputs, *parts.symbols]), (*path, *parts.limits), expressions


def parameter_parts() -> CostParts:
    """Return parts of costs at an instant, each with a parameter."""
    return CostParts(lambda label: Parameter(label, 0.0))
