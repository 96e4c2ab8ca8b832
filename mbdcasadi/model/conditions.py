"""Conditions: relations between expressions, taken apart into rows.

``crank.phi == 0.3``, ``tip.position == (1, 2)``, ``load <= 200``,
``bounded(-5, tau, 5)``. CasADi keeps a relation as an expression whose last
operation is the comparison; this module takes both sides from it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

import casadi as ca

from ..errors import ConditionError
from ..numerics.graph import factors_of_zero
from ..numerics.lazy import cached_property
from .quantities import is_list, quantity
from .symbols import Scalar, role_of, symbols_of
from .texts import text_of
from .units import unit_of


@dataclass(frozen=True, eq=False)
class Condition:
    """One scalar condition, ``expression == 0`` or ``expression <= 0``."""

    #: left side less right side
    expression: ca.SX
    equality: bool
    #: the relation as the user wrote it
    label: str
    #: lower side of a two-sided limit of which this is the upper side, if both limits are numbers
    opposite: Condition | None = None
    #: range of the expression below zero until the opposite side becomes active
    span: float = math.inf
    #: true if it is a component of a length that is to be zero
    component: bool = False
    #: true if it defines the symbol of a part of a cost, so that it can always be met
    definition: bool = False
    #: true if it is a limit about a condition that others imply on one branch
    implied: bool = False
    #: of a limit that holds at stages and mesh points of optimal control alone; with three expressions, factors whose
    #: product is that of the limit and a share of its size that this may reach, one factor is taken at any of these
    #: points and the other one at any other of the same interval
    across: tuple[ca.SX, ...] | None = None

    @cached_property
    def symbols(self) -> list[ca.SX]:
        """Scalar symbols that occur."""
        return symbols_of(self.expression)

    @cached_property
    def kinds(self) -> frozenset[str]:
        """Kinds of the symbols that occur (see ``symbols.KINDS``)."""
        roles = map(role_of, self.symbols)
        return frozenset(role.kind for role in roles if role is not None)

    @cached_property
    def unit(self) -> str:
        """Unit of the expression; empty if it is not known."""
        return unit_of(self.expression)

    def with_unit(self, value: float) -> str:
        """Return a value of the expression as text, with its unit if that is known."""
        return f"{value:.3g} {self.unit}".rstrip()

    def depends_on(self, *kinds: str) -> bool:
        """Return True if a symbol of one of the kinds occurs (see ``symbols.KINDS``)."""
        return not self.kinds.isdisjoint(kinds)

    def __repr__(self) -> str:
        return self.label


def stacked(conditions: Sequence[Condition]) -> ca.SX:
    """Return the expressions of conditions as a column."""
    return ca.vertcat(ca.SX(0, 1), *[c.expression for c in conditions])


@dataclass(frozen=True, eq=False)
class Bounded:
    """``lower <= expression <= upper``, made by :func:`bounded`."""

    lower: ca.SX
    expression: ca.SX
    upper: ca.SX


@dataclass(frozen=True, eq=False)
class Soft:
    """Conditions that may be passed at a price, made by :func:`soft`."""

    conditions: tuple[Condition, ...]
    weight: float | ca.SX

    def __repr__(self) -> str:
        weight = text_of(self.weight) if isinstance(self.weight, ca.SX) else f"{self.weight:g}"
        return f"soft({', '.join(c.label for c in self.conditions)}, weight={weight})"


#: One condition or several.
Relations: TypeAlias = "ca.SX | Bounded | Sequence[ca.SX | Bounded]"
#: The same, or conditions that may be passed.
SoftRelations: TypeAlias = "ca.SX | Bounded | Soft | Sequence[ca.SX | Bounded | Soft]"


def bounded(lower: Scalar, expression: Scalar, upper: Scalar) -> Bounded:
    """Return the two-sided condition ``lower <= expression <= upper``.

    Parameters
    ----------
    lower, upper : float or expression
        Limits; each may contain parameters, or be infinite.
    expression : casadi.SX
        Scalar.

    Returns
    -------
    Bounded
        For lists of conditions.

    Raises
    ------
    ConditionError
        If the lower limit is above the upper one, or the expression is a number.
    """
    what = "bounded"
    value = quantity(expression, what, "expression")
    low, high = (
        x if isinstance(x, float) and x == open_side else quantity(x, what, name)
        for x, name, open_side in ((lower, "lower", -math.inf), (upper, "upper", math.inf))
    )
    if not isinstance(value, ca.SX):
        raise ConditionError(f"bounded: the expression in the middle is the number {value}")
    if not isinstance(low, ca.SX) and not isinstance(high, ca.SX) and low > high:
        raise ConditionError(f"bounded: lower = {low} is above upper = {high} for {text_of(value)}")
    return Bounded(ca.SX(low), value, ca.SX(high))


def soft(relations: Relations, weight: Scalar) -> Soft:
    """Return conditions for ``path=`` and ``final=`` of an optimal-control problem that may be passed at a price.

    The cost grows by ``weight`` times the amount by which a condition is passed, integrated over time: ``max(e, 0)`` of
    a limit ``e <= 0``, ``|e|`` of an equality ``e == 0``. The penalty is exact: if the weight is above the costate of
    the hard condition everywhere, see ``Solution.costates``, the soft one holds; below it, it is passed where that is
    cheaper. A limit that a motion runs into in its positions has an impulse in its costate, and is passed by an amount
    that falls with the weight. Among the conditions of a waypoint, and in ``final=``, the amount at that time counts,
    once.

    Parameters
    ----------
    relations : relation, bounded, or sequence of them
        Each component, and each side of :func:`bounded`, counts by itself.
    weight : float or expression
        Positive; a number or an expression in parameters. Its unit is that of the cost over that of the limit times
        seconds: in ``running_cost=tau**2`` with a limit in N, (N m)²/N; at a waypoint and at the end, that of the
        cost over that of the limit.

    Returns
    -------
    Soft
        For lists of conditions.

    Raises
    ------
    ConditionError
        For what is not a relation, and conditions of parameters and time alone, which no motion can meet or pass.
    ModelError, ExpressionError
        If the weight is not positive, or depends on more than parameters.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> cart = mbd.Body("cart", mass=1, inertia=1)
    >>> mbd.soft(cart.vx <= 0.8, weight=3)
    soft(cart.vx <= 0.8, weight=3)
    """
    conditions = read_conditions(relations)
    for condition in conditions:
        if condition.kinds <= {"parameter", "time"}:
            raise ConditionError(f"soft: {condition.label} contains nothing that a motion changes")
    return Soft(conditions, quantity(weight, "soft", "weight", above=0.0, fixed=True))


_RELATIONS = {ca.OP_EQ: "==", ca.OP_LE: "<=", ca.OP_LT: "<="}


def read_conditions(conditions: Any) -> tuple[Condition, ...]:
    """Return relations, scalars, vectors and :func:`bounded` ones, as scalar conditions.

    A :class:`ConditionError` is raised for an entry that is not a relation, a relation between numbers, or ``!=``.
    """
    if isinstance(conditions, ca.SX | Bounded):
        conditions = [conditions]
    if not is_list(conditions):
        raise ConditionError(f"conditions must be a list of relations such as [body.phi == 0.3], got {conditions!r}")
    result: list[Condition] = []
    for position, entry in enumerate(conditions, start=1):
        result += read_condition(entry, position)
    return tuple(result)


def read_condition(entry: Any, position: int) -> Sequence[Condition]:
    """Return an entry of a list of conditions as scalar ones, with its position for messages."""
    if isinstance(entry, Condition):
        return [entry]
    if isinstance(entry, Bounded):
        sides = (entry.lower <= entry.expression, entry.expression <= entry.upper)
        # CasADi folds a side that always holds, such as 0 <= x**2, to the number 1; so does an infinite one
        infinite = (entry.lower.is_minus_inf(), entry.upper.is_inf())
        kept = [side for side, free in zip(sides, infinite, strict=True) if not free and not side.is_one()]
        conditions = [c for side in kept for c in _relation(side, position)]
        if len(conditions) == 2 and entry.lower.is_constant() and entry.upper.is_constant():
            low, high = conditions
            return [low, replace(high, opposite=low, span=float(entry.upper) - float(entry.lower))]
        return conditions
    if isinstance(entry, ca.SX):
        elements = [entry] if entry.is_scalar() else ca.vertsplit(ca.vec(entry))
        return [c for element in elements for c in _relation(element, position)]
    if isinstance(entry, Soft):
        raise ConditionError(
            f"condition {position} is {entry!r}, which belongs in path=, final= or a waypoint of optimal control"
        )
    hint = "write body.phi == 0.3"
    if isinstance(entry, bool):
        # Python compares an expression with a list of expressions itself, and finds that they are not the same object
        hint = "write body.phi == 0.3; a side of several expressions is a mbd.vertcat(body.x, 2), not a tuple"
    elif hasattr(entry, "__SX__"):
        hint = "NumPy made it of an expression: use mbd.sin, … instead"
    raise ConditionError(f"condition {position} is {entry!r}, which is not a relation between expressions ({hint})")


def _relation(relation: ca.SX, position: int) -> Sequence[Condition]:
    if relation.is_constant():
        truth = "holds always" if float(relation) else "can never hold"
        raise ConditionError(
            f"condition {position} is a relation between numbers that {truth}; a condition contains a model's symbols"
        )
    if relation.op() == ca.OP_NE:
        raise ConditionError(
            f"condition {position} ({text_of(relation)}) uses !=, which no solver can meet; use == or <="
        )
    sign = _RELATIONS.get(relation.op())
    if sign is None:
        raise ConditionError(
            f"condition {position} ({text_of(relation)}) is not a relation; write {text_of(relation)} == value"
        )
    left, right = relation.dep(0), relation.dep(1)
    for side in (left, right):
        if side.is_constant() and not math.isfinite(float(side)):
            raise ConditionError(f"condition {position} ({text_of(relation)}): the value {float(side)} is not finite")
    # Python hands `crank.phi == start` to `start`, an SX of a kind of its own, and CasADi keeps start == crank.phi
    if sign == "==" and _moves(right) and not _moves(left):
        left, right = right, left
    label = f"{text_of(left)} {sign} {text_of(right)}"
    zeros = factors_of_zero(left if right.is_zero() else right) if left.is_zero() or right.is_zero() else None
    if zeros and (sign == "==" or right.is_zero()):
        return _vanishing(zeros, label, position)
    return [Condition(left - right, sign == "==", label)]


def _vanishing(zeros: list[ca.SX], label: str, position: int) -> Sequence[Condition]:
    """Conditions that each component of a length is zero; the length itself has no gradient there."""
    if any(part.is_constant() and not part.is_zero() for part in zeros):
        raise ConditionError(f"condition {position} ({label}) can never hold, since one component is never zero")
    moving = [part for part in zeros if not part.is_constant()]
    labels = [label] if len(moving) == 1 else [f"{label}, with {text_of(part)} = 0" for part in moving]
    several = len(moving) > 1
    return [Condition(part, True, name, component=several) for part, name in zip(moving, labels, strict=True)]


def _moves(side: ca.SX) -> bool:
    """Return True if a side contains anything that changes along a motion; the other one is then its value."""
    kinds = {None if role is None else role.kind for role in map(role_of, symbols_of(side))}
    return bool(kinds - {"parameter", "time", "input", "input rate"})
