"""Effective masses of constraint rows: accurate solutions for bodies that are light or have no mass.

With ``S = Phi_q M⁻¹ Phi_q^T`` the multipliers of a body of little inertia are
differences of large numbers: the pin of a pendulum of 50 kg with an inertia of
1e-9 kg m² yields to a force across the arm 1e11 times as much as to one along
it. ``M + Phi_q^T A Phi_q`` in place of ``M`` takes the constraints in before
it is inverted. The solution stays what it was for any positive diagonal A; it
is most accurate if A holds the effective masses of the rows, ``diag(S⁻¹)``:
the mass that a row accelerates if all others hold. The eigenvalues of
``A^½ S A^½`` are then above ``1/m`` with m rows, however masses differ.
"""

from __future__ import annotations

import numpy as np

from ..numerics.tolerances import MET
from .derivation import Equations
from .scale import Scale, generic_poses

#: Largest dependence of rows on each other, 1 / (1 - R²), without effective masses: rounding times it remains.
DEPENDENCE = 1e6
#: Mass in place of zero, relative to the largest one.
NONE = 1e-24


def effective_masses(eom: Equations, p: np.ndarray, mass: np.ndarray, scale: Scale) -> np.ndarray | None:
    """Effective masses of the rows (m,), to powers of four; None if no body is light.

    Parameters
    ----------
    mass : numpy.ndarray
        Diagonal of M (n,).
    scale : Scale
        Sizes of the mechanism.
    """
    alike = mass * scale.coordinates**2
    most = float(np.max(alike, initial=0.0))
    if not eom.lam.numel() or np.min(alike, initial=np.inf) > MET * most:
        return None
    total = float(np.sum(alike)) or 1.0
    jacobians = [np.asarray(eom.slopes(0.0, pose, p).full()) for pose in generic_poses(eom)]
    units = scale.length * scale.usual_rows
    scaled = [matrix * scale.coordinates / units[:, None] for matrix in jacobians if np.all(np.isfinite(matrix))]
    if not scaled:
        return total / units**2 if np.any(mass == 0) else None
    # a coordinate without mass counts as much as the lightest one with mass: a force on it is balanced by multipliers,
    # and their rounding is divided by this mass
    lightest = float(np.min(alike[alike > 0], initial=total))
    root = np.sqrt(np.maximum(np.where(alike > 0, alike, lightest), NONE * total))
    masses = np.array([_effective(matrix / root, total) for matrix in scaled])
    yielding = np.array([np.sum((matrix / root) ** 2, axis=1) for matrix in scaled])
    if not np.any(mass == 0) and np.max(masses * yielding) < DEPENDENCE:
        return None
    return 4.0 ** np.round(np.log2(np.max(masses, axis=0) / units**2) / 2)


def _effective(matrix: np.ndarray, total: float) -> np.ndarray:
    """Diagonal of ``(B B^T + I / total)⁻¹`` (m,): accurate though the columns of B differ by any order of magnitude.

    By QR with rows in the order of their size and columns by pivoting, which is stable row by row.

    References
    ----------
    Cox, Higham, "Stability of Householder QR factorization for weighted least squares problems", 1998.
    """
    from scipy.linalg import qr, solve_triangular

    rows = np.vstack([matrix.T, np.eye(len(matrix)) / np.sqrt(total)])
    order = np.argsort(-np.max(np.abs(rows), axis=1), kind="stable")
    triangle, pivots = qr(rows[order], mode="r", pivoting=True)
    triangle = triangle[: len(matrix)]
    inverse = solve_triangular(triangle, np.eye(len(matrix)))
    masses = np.empty(len(matrix))
    masses[pivots] = np.sum(inverse**2, axis=1)
    return masses
