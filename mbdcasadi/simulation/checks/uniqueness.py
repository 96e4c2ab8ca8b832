"""Uniqueness of reactions on which friction depends."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...numerics.tolerances import RANK


class Uniqueness:
    """Checks that only one set of accelerations and multipliers meets the equations.

    With loads as ``|lam|`` the equations are piecewise linear in ``(a, lam)``. The
    solution is unique where the determinants of the pieces have the sign that they have
    without friction, so that ``det S`` is positive; the piece that contains the state is
    tested, and the one with all reactions reversed. If rows depend on each other, the quotient of both determinants on
    the range of S counts.

    Parameters
    ----------
    redundant : bool
        True if rows depend on each other.

    References
    ----------
    Painlevé, *Leçons sur le frottement*, 1895; Haug, Wu, Yang 1986 (see JointFriction).
    """

    def __init__(self, numeric: NumericEquations, *, redundant: bool = False):
        self.numeric, self._redundant = numeric, redundant
        eom = numeric.eom
        self.needed = eom.Q_depends_on_lam
        if not self.needed:
            return
        #: ``S`` with the forces that depend on lam to first order, and without them, as columns
        self._schur = eom.mechanism.cache.get_or_create(("reactions", numeric.light_key), self._make)

    def _make(self) -> ca.Function:
        eom = self.numeric.eom
        both = [self.numeric.saddle(under_reactions=under).schur for under in (True, False)]
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.lam, eom.u, eom.p]
        return ca.Function("reactions", arguments, [ca.densify(ca.vec(schur)) for schur in both])

    def first_lost(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, lam: np.ndarray, u: np.ndarray
    ) -> int | None:
        """Index of the first of some states, by row, at which reactions are not unique."""
        if not self.needed:
            return None
        m = self.numeric.eom.lam.numel()
        lost = ~np.all(np.isfinite(lam), axis=1)
        for side in (lam, -lam):
            found = self._schur(t[None, :], q.T, v.T, z.T, side.T, u.T, self.numeric.p)
            under, bare = (schur.full().T.reshape(-1, m, m) for schur in found)
            lost |= ~(np.linalg.slogdet(self._on_range(under, bare) if self._redundant else under)[0] > 0)
        return int(np.argmax(lost)) if np.any(lost) else None

    @staticmethod
    def _on_range(under: np.ndarray, bare: np.ndarray) -> np.ndarray:
        """``I + S⁺ (S' - S)`` (k, m, m), of which the determinant is that of the quotient on the range of S."""
        sizes = np.einsum("kii->ki", bare)
        root = 1 / np.sqrt(np.where(sizes > 0, sizes, 1.0))
        scale = root[:, :, None] * root[:, None, :]
        quotient: np.ndarray = np.linalg.pinv(bare * scale, rcond=RANK, hermitian=True) @ ((under - bare) * scale)
        return np.eye(bare.shape[1]) + quotient

    def sentence(self, time: float) -> str:
        """Remark on the time at which uniqueness is lost."""
        frictions = ", ".join(self.numeric.eom.loaded_by_reactions)
        return (
            f"at t = {time:.6g} s the reactions are not unique any more: {frictions} is so large that the joint "
            "jams, and none or more than one set of reactions meets the equations; lower the coefficient, lengthen the "
            "guide, use a thinner pin, or move the load nearer to the joint"
        )
