"""Sizes of a mechanism: what its lengths, angles and constraint rows are measured by.

Ranks and accuracies mean nothing without a scale. It is taken from the
mechanism as a whole, from its levers in several poses, its markers and the
places of its bodies, and not from one Jacobian: in a special pose a column may
hold nothing but rounding, which a scale of its own would blow up.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from .derivation import Equations

#: Poses with random angles in which levers are looked at, beside the estimate.
POSES = 3
#: Levers below this share of the size of the mechanism are rounding.
ROUNDING = 1e-9
#: Lengths below this are rounding, m.
SHORTEST = 1e-12
#: A row that is shorter than this share of its usual length has vanished.
VANISHED = 1e-9


@dataclass(frozen=True)
class Scale:
    """Characteristic sizes of a mechanism.

    Attributes
    ----------
    length : float
        Largest lever with which a turn moves a constrained point; failing levers the distance between the
        parts, or a radius of gyration, m.
    columns : numpy.ndarray
        Change of each coordinate that moves a point by about one metre (n,): 1 for a
        displacement, ``1 / length`` for an angle.
    rows : numpy.ndarray
        Length of each row of ``Phi_q`` with its columns scaled so (m,), the largest in several poses.
    """

    length: float
    columns: np.ndarray
    rows: np.ndarray

    @property
    def coordinates(self) -> np.ndarray:
        """Typical size of each coordinate (n,): the length for displacements, one for angles."""
        return self.length * self.columns

    def row_size(self, jacobian: np.ndarray) -> np.ndarray:
        """Lengths of the rows of ``Phi_q`` with scaled columns (m,); the usual length for one that has vanished."""
        size = np.linalg.norm(jacobian * self.columns, axis=1)
        usual = np.where(self.rows > 0, self.rows, 1.0)
        return np.where(size > VANISHED * usual, size, usual)

    def scaled(self, jacobian: np.ndarray) -> np.ndarray:
        """``Phi_q`` with columns that compare and rows of length one."""
        return jacobian * self.columns / self.row_size(jacobian)[:, None]


def scale_of(eom: Equations, jacobian: ca.Function, p: np.ndarray, mass: np.ndarray) -> Scale:
    """Find the characteristic sizes of a mechanism.

    Parameters
    ----------
    eom : Equations
        Its equations.
    jacobian : casadi.Function
        ``(t, q, p) -> (Phi_q, …)``.
    p : numpy.ndarray
        Parameter values.
    mass : numpy.ndarray
        Diagonal of M (n,).
    """
    estimate = eom.estimate[0]
    poses = np.tile(estimate, (POSES + 1, 1))
    poses[1:, eom.angles] += np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, int(np.sum(eom.angles))))
    found = [np.abs(jacobian(0.0, pose, p)[0].full()) for pose in poses]
    found = [matrix for matrix in found if np.all(np.isfinite(matrix))]
    bodies = np.arange(eom.q.numel()) < 3 * len(eom.mechanism.bodies)
    straight = bodies & ~eom.angles
    length = _length(eom, found, straight, p, mass)
    columns = np.where(eom.angles, 1 / length, 1.0)
    if not np.all(bodies):
        columns[~bodies] = 1 / _levers(found, straight, ~bodies, length)
    rows = [np.linalg.norm(matrix * columns, axis=1) for matrix in found]
    return Scale(length, columns, np.max(rows, axis=0, initial=0.0) if rows else np.ones(eom.lam.numel()))


def _length(
    eom: Equations, jacobians: Sequence[np.ndarray], straight: np.ndarray, p: np.ndarray, mass: np.ndarray
) -> float:
    """Characteristic length, m."""
    lever = 0.0
    for matrix in jacobians:
        moved = np.max(matrix[:, straight], axis=1, initial=0.0)
        turned = np.max(matrix[:, eom.angles], axis=1, initial=0.0)
        lever = max(lever, float(np.max(turned[moved > 0] / moved[moved > 0], initial=0.0)))
    size, gyration = _extent(eom, p), _gyration(eom, mass)
    if lever > max(ROUNDING * max(size, gyration), SHORTEST):
        return lever
    return next((length for length in (size, gyration) if length > SHORTEST), 1.0)


def _levers(jacobians: Sequence[np.ndarray], straight: np.ndarray, extra: np.ndarray, length: float) -> np.ndarray:
    """How far coordinates beside those of the bodies move a point per unit, m (k,)."""
    levers = np.zeros(int(np.sum(extra)))
    for matrix in jacobians:
        moved = np.max(matrix[:, straight], axis=1, initial=0.0)
        rows = moved > 0
        levers = np.maximum(levers, np.max(matrix[rows][:, extra] / moved[rows, None], axis=0, initial=0.0))
    return np.where(levers > ROUNDING * length, levers, 1.0)


def _extent(eom: Equations, p: np.ndarray) -> float:
    """Distance between the parts: bodies as they are estimated, and markers on bodies and on the ground, m."""
    mechanism = eom.mechanism
    q = eom.estimate[0][: 3 * len(mechanism.bodies)].reshape(-1, 3)

    def points() -> tuple[ca.Function, list[bool]]:
        markers = [m for element in mechanism.elements for m in element.markers]
        local = ca.vertcat(ca.SX(0, 1), *[m.local for m in markers])
        return ca.Function("markers", [eom.p], [ca.densify(local)]), [m.body.is_ground for m in markers]

    function, on_ground = mechanism.cache.get_or_create("marker points", points)
    local = function(p).full().reshape(-1, 2)
    ground = local[np.array(on_ground, bool)]
    reach = np.max(np.abs(local[~np.array(on_ground, bool)]), initial=0.0)
    places = np.vstack([q[:, :2], ground])
    spread = np.ptp(places, axis=0)
    extent = float(np.max([*spread, reach]))
    return extent if np.isfinite(extent) else 0.0


def _gyration(eom: Equations, mass: np.ndarray) -> float:
    """Median radius of gyration of the bodies that have mass and inertia, m."""
    own = mass[: 3 * len(eom.mechanism.bodies)].reshape(-1, 3)
    both = (own[:, 0] > 0) & (own[:, 2] > 0)
    return float(np.sqrt(np.median(own[both, 2] / own[both, 0]))) if np.any(both) else 0.0
