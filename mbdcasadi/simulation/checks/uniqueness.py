"""Uniqueness of reactions on which friction depends."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.derivation import Equations
from ...equations.numeric import NumericEquations


class Uniqueness:
    """Checks that only one set of accelerations and multipliers meets the equations.

    With loads as ``|lam|`` the equations are piecewise linear in ``(a, lam)``. The
    solution is unique where the determinants of the pieces have the sign that they have
    without friction; the piece that contains the state is tested, and the one with all
    reactions reversed.

    References
    ----------
    Painlevé, *Leçons sur le frottement*, 1895; Haug, Wu, Yang 1986 (see JointFriction).
    """

    def __init__(self, numeric: NumericEquations):
        self.numeric = numeric
        eom = numeric.eom
        self.needed = eom.Q_depends_on_lam
        if not self.needed:
            return
        self._systems = eom.mechanism.cache.get_or_create("reactions", lambda: _systems(eom))

    def first_lost(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, lam: np.ndarray, u: np.ndarray
    ) -> int | None:
        """Index of the first of some states, by row, at which reactions are not unique."""
        if not self.needed:
            return None
        size = self.numeric.eom.q.numel() + self.numeric.eom.lam.numel()
        lost = ~np.all(np.isfinite(lam), axis=1)
        for side in (lam, -lam):
            systems = self._systems(t[None, :], q.T, v.T, z.T, side.T, u.T, self.numeric.p)
            plain, rough = (np.linalg.slogdet(x.full().T.reshape(-1, size, size))[0] for x in systems)
            plain, rough = np.broadcast_to(plain, t.shape), np.nan_to_num(rough)
            lost |= plain * rough <= 0
        return int(np.argmax(lost)) if np.any(lost) else None

    def sentence(self, time: float) -> str:
        """Remark on the time at which uniqueness is lost."""
        frictions = ", ".join(self.numeric.eom.loaded_by_reactions)
        return (
            f"at t = {time:.6g} s the reactions are not unique any more: {frictions} is so large that the joint "
            "jams, and none or more than one set of reactions meets the equations; lower the coefficient, lengthen the "
            "guide, use a thinner pin, or move the load nearer to the joint"
        )


def _systems(eom: Equations) -> ca.Function:
    """Matrices of the equations for ``(a, lam)`` without and with the forces that depend on lam, as columns."""
    n, m = eom.q.numel(), eom.lam.numel()
    slope = ca.horzcat(ca.SX(n, n), ca.jacobian(eom.Q, eom.lam))
    system = ca.blockcat([[eom.M, eom.Phi_q.T], [eom.Phi_q, ca.SX(m, m)]])
    with_friction = system - ca.vertcat(slope, ca.SX(m, system.size2()))
    arguments = [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.u, eom.p]
    return ca.Function("reactions", arguments, [ca.densify(ca.vec(system)), ca.densify(ca.vec(with_friction))])
