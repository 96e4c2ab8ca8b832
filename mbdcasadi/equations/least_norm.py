"""Multipliers of least norm, of rows that depend on each other.

Effective masses depend on the directions of the axes, and a norm of their size with them: beside light bodies the
multipliers are brought to the least norm by weights that are more nearly alike, and a norm in which moments count by
the levers of the forces.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..numerics.tolerances import ACCURACY, NEGLIGIBLE
from .derivation import Equations
from .saddle import REPORTED, Saddle, row_sizes

#: Largest ratio of moments in the norm by levers to those by masses, with which the regularised solution converges.
MOST_BY_LEVERS = 1e3


def of_least_norm(eom: Equations, lam: ca.SX, weights: np.ndarray) -> ca.SX:
    """Multipliers with the same loads (m, k), of least norm by levers."""
    saddle = Saddle(ca.SX(ca.DM(weights)), eom.Phi_q, eom.angular_rows, REPORTED, norm=sizes_by_levers(eom, weights))
    more = lam - saddle.multipliers(saddle.schur @ lam)
    # of rows that are independent it is rounding, which small multipliers are spared; zeros have derivatives
    rounding = ACCURACY * ca.repmat(ca.mmax(ca.fabs(lam)), *lam.shape)
    is_known = ca.logic_or(more == 0, ca.fabs(more) > rounding)
    return lam - ca.if_else(is_known, more, 0)


def norm_of_multipliers(eom: Equations, weights: np.ndarray | None) -> ca.SX:
    """Diagonal D in which multipliers of redundant rows have the least norm (m,).

    By masses, or :func:`by levers <sizes_by_levers>` with weights, as beside light bodies.
    """
    if weights is not None:
        return sizes_by_levers(eom, weights)
    return row_sizes(ca.sum2(eom.Phi_q**2 @ ca.diag(1 / eom.own_masses)), eom.angular_rows)


def sizes_by_levers(eom: Equations, weights: np.ndarray) -> ca.SX:
    """Diagonal D in which multipliers beside light bodies have the least norm (m,).

    Of rows in m it is their mean by the weights, of rows in rad that over the mean square of the levers in the others:
    the same in any units, axes and order, whichever masses are zero.

    Parameters
    ----------
    weights : numpy.ndarray
        Masses that are more nearly alike, of the coordinates (n,).
    """
    angular, angles = eom.angular_rows, eom.angles
    sizes = row_sizes(ca.sum2(eom.Phi_q**2 @ ca.diag(ca.DM(1 / weights))), angular)
    if np.all(angular) or not np.any(angular):
        return sizes
    in_metres, in_radians = np.flatnonzero(~angular).tolist(), np.flatnonzero(angular).tolist()
    straight = (np.arange(angles.size) < 3 * len(eom.mechanism.bodies)) & ~angles
    squares = ca.sum1(eom.Phi_q[in_metres, :] ** 2)
    moved, turned = (ca.sum2(squares[np.flatnonzero(part).tolist()]) for part in (straight, angles))
    least = NEGLIGIBLE * float(np.max(weights[angles]) / np.max(weights[straight]))
    by_levers, by_masses = sizes[in_metres[0]] * moved / (turned + least * moved), sizes[in_radians[0]]
    sizes[in_radians] = ca.fmin(ca.fmax(by_levers, by_masses / MOST_BY_LEVERS), by_masses * MOST_BY_LEVERS)
    return sizes


class ImpliedRows:
    """Multipliers of equations of which some rows imply the others.

    Parameters
    ----------
    rows : list of int
        Independent rows that imply all others.
    weights : numpy.ndarray
        Sizes of the columns: a metric of the coordinates (n,).
    """

    def __init__(self, eom: Equations, rows: list[int], weights: np.ndarray):
        self._eom, self._rows, self._weights = eom, rows, weights
        self._implied = [k for k in range(eom.lam.numel()) if k not in set(rows)]
        saddle = Saddle(ca.SX(ca.DM(weights)), eom.Phi_q[rows, :], eom.angular_rows[rows])
        #: loads of the independent rows that equal those of each implied row, by column
        self._shares = saddle.multipliers(saddle.columns.T @ eom.Phi_q[self._implied, :].T)

    def independent(self) -> ca.Function:
        """Compile ``(t, q, lam, p) -> lam``: multipliers with the same loads that are zero for implied rows."""
        lam = ca.SX(self._eom.lam.numel(), 1)
        lam[self._rows] = self._eom.lam[self._rows] + self._shares @ self._eom.lam[self._implied]
        return self._function("independent", lam)

    def least_norm(self, *, light: bool) -> ca.Function:
        """Compile ``(t, q, lam, p) -> lam``: multipliers with the same loads, of least norm.

        They are those of the forward dynamics, without its regularisation, so that they may be differentiated
        twice. `light` if some bodies are light or have no mass.
        """
        eom, count = self._eom, len(self._implied)
        internal = ca.SX(eom.lam.numel(), count)  # multipliers without loads, by column
        internal[self._rows, :], internal[self._implied, :] = -self._shares, ca.SX.eye(count)
        sizes = norm_of_multipliers(eom, self._weights if light else None)
        weighted = internal.T @ ca.diag(sizes)
        return self._function("least_norm", eom.lam - internal @ ca.solve(weighted @ internal, weighted @ eom.lam))

    def _function(self, name: str, lam: ca.SX) -> ca.Function:
        eom = self._eom
        return ca.Function(name, [eom.t, eom.q, eom.lam, eom.p], ca.cse([ca.densify(lam)]))
