"""The coordinates of a tree of joints in terms of its independent ones, mostly angles: what integrators advance."""

from __future__ import annotations

import casadi as ca

from .derivation import Equations
from .explicit import tree_rows


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
        rows = rows if len(rows) < eom.q.numel() else {}  # nothing would be left to advance
        self.dependent = sorted(rows)
        self.independent = [k for k in range(eom.q.numel()) if k not in rows]
        self.q, self.v = eom.q, eom.v
        if not rows:
            return
        given, values = eom.q[self.dependent], ca.vertsplit(eom.q)
        others = ca.vertsplit(ca.substitute(eom.Phi, given, ca.SX.zeros(given.numel())))
        for k, (place, factors) in rows.items():
            known = sum((x * values[j] for j, x in factors.items() if j != k), others[place])
            values[k] = -known / factors[k]
        self.q = ca.vertcat(*values)
        self.v = ca.densify(ca.jtimes(self.q, eom.q[self.independent], eom.v[self.independent]))

    def places_in(self, x: ca.SX) -> list[int]:
        """Places of what is independent in a state ``(q, v, …)``."""
        n = self.q.numel()
        return [*self.independent, *(n + k for k in self.independent), *range(2 * n, x.numel())]


def tree_coordinates(eom: Equations) -> TreeCoordinates:
    """:class:`TreeCoordinates` of a mechanism, made once and kept."""
    return eom.mechanism.cache.get_or_create("tree coordinates", lambda: TreeCoordinates(eom))
