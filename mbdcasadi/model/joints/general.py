"""Constraints written by the user as expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ...printing import to_text
from ..element import BEYOND_COORDINATES, ConstraintElement, holds_coordinates, refuse_kinds
from ..quantities import column, is_relation


class Constraint(ConstraintElement):
    """Any holonomic constraint: ``Phi = expression``.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        (k,) in coordinates, parameters and time, or a list of scalars; it is held at zero. Scale it
        to metres or radians, since tolerances are meant in these.

    Raises
    ------
    ModelError
        For an expression that depends on no coordinate.
    ExpressionError
        For one that depends on velocities, accelerations, multipliers, inputs or states.
    """

    kind = "constraint"

    def __init__(self, name: str, expression: Any):
        what = f"constraint '{name}'"
        rows = held_at_zero(expression, what)
        refuse_kinds(rows, BEYOND_COORDINATES, what, "a Constraint holds coordinates, parameters and time only")
        if rows.numel() == 0 or not holds_coordinates(rows):
            raise ModelError(f"{what} depends on no coordinate: {expression}")
        super().__init__(name, rows)


def held_at_zero(expression: Any, what: str) -> ca.SX:
    """Rows (k,) that the user wrote to be held at zero; a relation is refused."""
    rows = column(expression, what)
    for row in ca.vertsplit(rows):
        if is_relation(row):
            raise ModelError(
                f"{what} is the relation {to_text(row)}; give what is held at zero, left side less right side"
            )
    return rows
