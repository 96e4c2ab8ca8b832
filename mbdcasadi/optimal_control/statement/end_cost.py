"""The cost at the end of a problem of one phase: of its last state, and of integrals."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...equations import Equations
from ...errors import ExpressionError
from ...model.placeholders import Placeholder, with_values


def end_cost(problem: Any) -> ca.SX:
    """Return what the last state adds to the cost of a problem."""
    return with_values(problem.terminal_cost, lambda x: x.expression if x.kind == "at_end" else 0)


def end_values(expression: ca.SX, analysis: str) -> ca.SX:
    """Return an expression of the last state alone, without the marks that it is of the end.

    Raises
    ------
    ExpressionError
        For one that holds integrals or the start.
    """

    def value(x: Placeholder) -> ca.SX:
        if x.kind != "at_end":
            raise ExpressionError(f"{analysis}: positive parts at the end are of the last state alone, got {x.label}")
        return x.expression

    return with_values(expression, value)


def integrated_cost(problem: Any, eom: Equations, analysis: str) -> ca.SX:
    """Return what integrals in the terminal cost add to the running cost.

    Raises
    ------
    ExpressionError
        For a cost of the start, and integrals that are no terms with constant factors.
    """
    integrals: dict[int, tuple[ca.SX, ca.SX]] = {}

    def value(x: Placeholder) -> ca.SX:
        if x.kind == "at_start":
            raise ExpressionError(f"{analysis}: terminal_cost contains {x.label}; the start is measured")
        if x.kind == "at_end":
            return x.expression
        return integrals.setdefault(x.node.element_hash(), (ca.SX.sym("integral"), x.expression))[0]

    cost = with_values(problem.terminal_cost, value)
    moving = ca.vertcat(eom.q, eom.v, eom.z, *(symbol for symbol, _ in integrals.values()))
    added = ca.SX(0)
    for symbol, integrand in integrals.values():
        weight = ca.gradient(cost, symbol)
        if ca.depends_on(weight, moving):
            raise ExpressionError(f"{analysis}: an integral in terminal_cost must be a term with a constant factor")
        added += weight * integrand
    return added
