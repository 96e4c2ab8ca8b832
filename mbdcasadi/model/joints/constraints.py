"""Constraints given as expressions, on positions or velocities."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ...errors import ModelError
from ...numerics.lazy import cached_property
from ..bodies import Marker, as_marker
from ..element import BEYOND_COORDINATES, ConstraintElement, holds_coordinates, refuse_kinds
from ..quantities import column, is_relation
from ..symbols import Scalar, role_of, symbols_of
from ..texts import text_of


class Constraint(ConstraintElement):
    """Any holonomic constraint: ``Phi = expression``.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        (k,) in coordinates, parameters and time, or a list of scalars, constrained to zero. Scale it
        to metres or radians, the units of the tolerances.

    Raises
    ------
    ModelError
        For an expression that depends on no coordinate.
    ExpressionError
        For one that depends on velocities, accelerations, multipliers, inputs or states.
    """

    kind = "constraint"

    def __init__(self, name: str, expression: Scalar):
        what = f"constraint '{name}'"
        rows = held_at_zero(expression, what)
        refuse_kinds(rows, BEYOND_COORDINATES, what, "a Constraint contains coordinates, parameters and time only")
        if rows.numel() == 0 or not holds_coordinates(rows):
            raise ModelError(f"{what} depends on no coordinate: {expression}")
        super().__init__(name, rows)


def held_at_zero(expression: Any, what: str) -> ca.SX:
    """Return the rows (k,) of a constraint; raise an error for a relation."""
    rows = column(expression, what)
    for row in ca.vertsplit(rows):
        if is_relation(row):
            raise ModelError(
                f"{what} is the relation {text_of(row)}; give the expression that is zero, left side less right side"
            )
    return rows


class NonholonomicConstraint(ConstraintElement):
    """Any expression linear in velocities, constrained to zero: a blade, a wheel, a skate.

    ``J(q, t) v + c(q, t) = 0`` (k rows, m/s or rad/s). It restricts the
    velocities in a pose, not the poses that the mechanism can reach.

    Parameters
    ----------
    name : str
        Its name.
    expression : casadi.SX
        (k,), linear in velocities, in coordinates, parameters and time; or a list of scalars.

    Raises
    ------
    ModelError
        For an expression without velocities or not linear in them.
    ExpressionError
        For one that depends on accelerations, multipliers, inputs or states.

    References
    ----------
    Goldstein, Poole, Safko, *Classical Mechanics*, 2002, sections 1.3 and 2.4.
    """

    kind = "constraint"

    def __init__(self, name: str, expression: Scalar):
        rows = _velocity_rows(name, expression)
        super().__init__(name, ca.SX(0, 1), velocity_rows=rows)


class KnifeEdge(ConstraintElement):
    """Blade or thin wheel: a point of a body moves along the marker's x axis only.

    ``y_P · ṙ^P = 0`` (1 row, m/s).

    Parameters
    ----------
    name : str
        Its name.
    marker : Marker
        Point P and direction of the blade, on a body that moves.
    """

    kind = "constraint"

    def __init__(self, name: str, marker: Marker):
        self.marker = as_marker(marker, f"constraint '{name}'", "marker")
        row = _velocity_rows(name, ca.dot(self.marker.y_axis, self.marker.velocity))
        super().__init__(name, ca.SX(0, 1), (), (self.marker,), velocity_rows=row)

    @cached_property
    def side_force(self) -> ca.SX:
        """Force on the blade along its y axis, N."""
        return -self.multipliers


def _velocity_rows(name: str, expression: Any) -> ca.SX:
    what = f"constraint '{name}'"
    rows = held_at_zero(expression, what)
    if rows.numel() == 0:
        raise ModelError(f"{what} is empty; give an expression in velocities that is zero")
    others = ("acceleration", "multiplier", "input", "state")
    refuse_kinds(
        rows, others, what, "a velocity-level constraint contains velocities, coordinates, parameters and time"
    )
    roles = [(symbol, role_of(symbol)) for symbol in symbols_of(rows)]
    speeds = ca.vertcat(ca.SX(0, 1), *[s for s, role in roles if role is not None and role.kind == "velocity"])
    slope = ca.jacobian(rows, speeds)
    for k, row in enumerate(ca.vertsplit(rows)):
        if slope[k, :].nnz() == 0:
            raise ModelError(f"{what} contains no velocity in {text_of(row)}; for positions use Constraint")
        if ca.depends_on(slope[k, :], speeds):
            raise ModelError(f"{what} is not linear in the velocities: {text_of(row)}")
    return rows
