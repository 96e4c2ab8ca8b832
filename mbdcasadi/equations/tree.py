"""The coordinates of a tree of joints in terms of its independent ones, mostly angles: what integrators advance."""

from __future__ import annotations

import casadi as ca

from ..numerics.lazy import cached_property
from .derivation import Equations
from .explicit import tree_rows
from .saddle import Saddle

#: Entries in a row of the inertia of a tree, in the mean, up to which accelerations by it take fewer operations than
#: by that of all bodies (measured on chains, of which one of five links takes as many).
COUPLED = 5


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
    left : list of int
        Constraint rows that give none: those that close loops, hold velocities or depend on time.
    """

    def __init__(self, eom: Equations):
        rows = tree_rows(eom)
        rows = rows if len(rows) < eom.q.numel() else {}  # nothing would be left to advance
        self.dependent = sorted(rows)
        self.independent = [k for k in range(eom.q.numel()) if k not in rows]
        self._eom, self.q, self.v = eom, eom.q, eom.v
        solved = {int(eom.position_rows[place]) for place, _ in rows.values()}
        self.left = [k for k in range(eom.lam.numel()) if k not in solved]
        if not rows:
            return
        solved_for, values = eom.q[self.dependent], ca.vertsplit(eom.q)
        others = ca.vertsplit(ca.substitute(eom.Phi, solved_for, ca.SX.zeros(solved_for.numel())))
        for k, (place, factors) in rows.items():
            known = sum((x * values[j] for j, x in factors.items() if j != k), others[place])
            values[k] = -known / factors[k]
        self.q = ca.vertcat(*values)
        self.v = ca.densify(ca.jtimes(self.q, eom.q[self.independent], eom.v[self.independent]))

    def places_in(self, x: ca.SX) -> list[int]:
        """Places of the independent entries of a state ``(q, v, …)``."""
        n = self.q.numel()
        return [*self.independent, *(n + k for k in self.independent), *range(2 * n, x.numel())]

    @cached_property
    def _slopes(self) -> ca.SX:
        """Derivatives of all coordinates by the independent ones."""
        return ca.jacobian(self.q, self._eom.q[self.independent])

    @property
    def is_light(self) -> bool:
        """True if accelerations by the inertia of the tree take fewer operations than by that of all bodies."""
        by_angle = self._slopes.sparsity()
        coupled = ca.mtimes(ca.SX(by_angle.T), ca.SX(by_angle)).nnz()
        return 0 < coupled <= COUPLED * len(self.independent)

    def accelerations(self, t: ca.SX, z: ca.SX, u: ca.SX, p: ca.SX) -> ca.SX:
        """Accelerations of all coordinates, in the symbols of the independent ones.

        With slopes B of all coordinates by the independent ones, ``a = B a_i + c``, the rows that give coordinates
        hold, and ``B^T M B`` and the rows that are left are fewer unknowns. Forces must not depend on reactions, and
        no body may be without mass.
        """
        eom, slopes = self._eom, self._slopes
        curvature = ca.jtimes(self.v, eom.q[self.independent], eom.v[self.independent])
        known = [eom.t, eom.q, eom.v, eom.z, eom.u, eom.p]
        terms = ca.Function("terms", known, [eom.Q, eom.Phi_q[self.left, :], eom.gamma[self.left, 0]])
        force, jacobian, gamma = terms(t, self.q, self.v, z, u, p)
        inertia = slopes.T @ ca.diag(eom.mass_diagonal) @ slopes
        saddle = Saddle(inertia, jacobian @ slopes, eom.angular_rows[self.left])
        a, _ = saddle.solve(slopes.T @ (force - eom.mass_diagonal * curvature), gamma - jacobian @ curvature)
        return slopes @ a + curvature


def tree_coordinates(eom: Equations) -> TreeCoordinates:
    """:class:`TreeCoordinates` of a mechanism, made once and kept."""
    return eom.mechanism.cache.get_or_create("tree coordinates", lambda: TreeCoordinates(eom))
