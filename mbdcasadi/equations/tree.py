"""The coordinates of a tree of joints in terms of its independent ones, mostly angles: what integrators advance."""

from __future__ import annotations

import casadi as ca

from .derivation import Equations
from .explicit import solved_coordinates, tree_rows


class TreeCoordinates:
    """All coordinates and velocities in terms of those that explicit rows do not give.

    Unlike :class:`~mbdcasadi.equations.reduced.ReducedEquations`, these leave the equations of
    motion as they are: accelerations of all coordinates, and multipliers of all rows.

    Attributes
    ----------
    independent, dependent : list of int
        Places of the coordinates of each kind.
    q, v : casadi.SX
        All coordinates and velocities, in the symbols of the independent ones.
    """

    def __init__(self, eom: Equations):
        rows = tree_rows(eom)
        rows = rows if len(rows) < eom.q.numel() else []  # nothing would be left to advance
        given = {row.coordinate for row in rows}
        self.dependent = sorted(given)
        self.independent = [k for k in range(eom.q.numel()) if k not in given]
        self.q, self.v = eom.q, eom.v
        if rows:
            self.q = ca.densify(solved_coordinates(eom, rows, ca.SX.zeros(len(rows))))
            self.v = ca.densify(ca.jtimes(self.q, eom.q[self.independent], eom.v[self.independent]))


def tree_coordinates(eom: Equations) -> TreeCoordinates:
    """:class:`TreeCoordinates` of a mechanism, made once and kept."""
    return eom.mechanism.cache.get_or_create("tree coordinates", lambda: TreeCoordinates(eom))
