"""Regularity of poses: the smallest pivot of the constraint rows, which falls to zero where a linkage could fold."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ...equations.derivation import Equations
from ...equations.numeric import NumericEquations
from ...numerics.evaluation import Evaluator
from ...numerics.rank import dependent_rows
from ..path import Path, hermite_states

#: Fall of the smallest pivot of ``Phi_q W⁻¹ Phi_q^T``, relative to the largest one seen, at which the passage begins.
#: The pivot falls with the square of the distance from the pose: of a parallelogram it is 0.1 rad.
ENTRY = 0.01
#: Turn of a body between two poses at which the pivot is looked at, rad.
PIVOT_TURN = 0.05


class Regularity:
    """The smallest pivot of the constraint rows, relative to their mean: it falls towards zero near a singular pose.

    Parameters
    ----------
    q : numpy.ndarray
        A pose that is not singular; rows that depend on others there are left out.
    t : float
        Its time, s.
    """

    def __init__(self, numeric: NumericEquations, t: float, q: np.ndarray):
        self.numeric = numeric
        self.is_needed = bool(numeric.eom.lam.numel()) and numeric.eom.has_loops
        if not self.is_needed:
            return
        left_out = set()
        if numeric.has_redundant_rows(t, q):
            left_out = set(dependent_rows(numeric.scale.scaled(numeric.velocity(t, q)[0])))
        rows = tuple(k for k in range(numeric.eom.lam.numel()) if k not in left_out)
        eom = numeric.eom
        self._function = eom.mechanism.cache.get_or_create(
            ("regularity", rows), lambda: Evaluator(_regularity(eom, list(rows)))
        )

    def at(self, times: np.ndarray, q: np.ndarray) -> np.ndarray:
        """Smallest relative pivot at poses (k, n)."""
        pivots = self._function.rows(times[:, None], q, self.numeric.p, self.numeric.scale.columns)[0].ravel()
        return np.where(np.isfinite(pivots), pivots, 0.0)

    def along(self, path: Path) -> tuple[np.ndarray, np.ndarray]:
        """Times of a path between which no body turns far, and the smallest relative pivot at them."""
        n, times = self.numeric.eom.q.numel(), finer_times(path, self.numeric.eom)
        return times, self.at(times, hermite_states(path, times, n)[:, :n])


def finer_times(path: Path, eom: Equations) -> np.ndarray:
    """Times of a path between which no body turns far."""
    turned = np.abs(np.diff(path.x[:, np.flatnonzero(eom.angles)], axis=0)).max(axis=1, initial=0.0)
    parts = np.clip(np.ceil(turned / PIVOT_TURN), 1, 400).astype(int)
    owner, last = np.repeat(np.arange(parts.size), parts), np.cumsum(parts)
    share = 1.0 - (last[owner] - 1 - np.arange(owner.size)) / parts[owner]
    inside = path.times[owner] + share * np.diff(path.times)[owner]
    return np.r_[path.times[0], np.where(share == 1.0, path.times[owner + 1], inside)]


def singular_time(numeric: NumericEquations, path: Path) -> float | None:
    """Time at which a motion is nearest to a singular pose; None if it is not near to any."""
    regularity = Regularity(numeric, float(path.times[0]), path.x[0, : numeric.eom.q.numel()])
    if not regularity.is_needed:
        return None
    times, values = regularity.along(path)
    k = int(np.argmin(values))
    return float(times[k]) if values[k] < ENTRY * np.max(values) else None


def _regularity(eom: Equations, rows: list[int]) -> ca.Function:
    columns = ca.SX.sym("scale", eom.q.numel())
    jacobian = eom.Phi_q[rows, :] @ ca.diag(columns)
    size = ca.sum2(jacobian**2)
    normal = ca.diag(1 / ca.sqrt(size + (size == 0))) @ jacobian
    pivots = ca.ldl(normal @ normal.T + 1e-14 * ca.SX.eye(len(rows)))[0]
    return ca.Function("regularity", [eom.t, eom.q, eom.p, columns], [ca.mmin(ca.densify(pivots))])
