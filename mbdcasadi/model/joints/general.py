"""Constraints written by the user as expressions."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ..elements import ConstraintElement, owners, refuse_kinds


class Constraint(ConstraintElement):
    """Any holonomic constraint: ``Phi = expression``.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        (k,) in coordinates, parameters and time; it is held at zero. Scale it
        to metres or radians, since tolerances are meant in these.

    Raises
    ------
    ModelError
        For an expression that depends on no coordinate.
    ExpressionError
        For one that depends on velocities, accelerations, multipliers, inputs or states.
    """

    word = "constraint"

    def __init__(self, name: str, expression: Any):
        rows = ca.vec(ca.SX(expression))
        what = f"constraint '{name}'"
        refuse_kinds(
            rows,
            ("velocity", "acceleration", "multiplier", "input", "state"),
            what,
            "a Constraint holds coordinates, parameters and time only",
        )
        if rows.numel() == 0 or not owners(rows):
            raise ModelError(f"{what} depends on no coordinate of a body: {expression}")
        super().__init__(name, rows)
