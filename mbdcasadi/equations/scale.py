"""Sizes of a mechanism: what its lengths, angles and constraint rows are measured by.

Ranks and accuracies mean nothing without a scale. It is taken from the
mechanism as a whole, from its levers in several poses, its markers and the
places of its bodies, and not from one Jacobian: in a special pose a column may
hold nothing but rounding, which a scale of its own would blow up.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..numerics.scattered import scattered
from ..numerics.tolerances import NEGLIGIBLE
from .derivation import Equations

#: Poses with scattered angles and parameters of curves in which levers are looked at, beside the estimate.
POSES = 3
#: Lengths below this are rounding, m.
SHORTEST = 1e-12
#: Length from which absolute tolerances are the usual ones, m, and the smallest share of these.
SMALL, SMALLEST_SHARE = 1e-2, 1e-7


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

    @property
    def fineness(self) -> float:
        """Share of the usual absolute tolerances that a mechanism takes which is smaller than one centimetre."""
        return max(min(1.0, self.length / SMALL), SMALLEST_SHARE)

    @property
    def usual_rows(self) -> np.ndarray:
        """Usual lengths of the rows (m,); one for a row that vanished in all poses."""
        return np.where(self.rows > 0, self.rows, 1.0)

    def row_size(self, jacobian: np.ndarray) -> np.ndarray:
        """Lengths of the rows of ``Phi_q`` with scaled columns (m,); the usual length for one that has vanished."""
        return self.known_size(np.linalg.norm(jacobian * self.columns, axis=1))

    def known_size(self, size: np.ndarray) -> np.ndarray:
        """Lengths of rows (m,), with the usual length for one that has vanished."""
        return np.where(size > NEGLIGIBLE * self.usual_rows, size, self.usual_rows)

    def scaled(self, jacobian: np.ndarray) -> np.ndarray:
        """``Phi_q`` with columns that compare and rows of length one."""
        return jacobian * self.columns / self.row_size(jacobian)[:, None]


def scale_of(eom: Equations, p: np.ndarray, mass: np.ndarray) -> Scale:
    """Find the characteristic sizes of a mechanism.

    Parameters
    ----------
    mass : numpy.ndarray
        Diagonal of M (n,).
    """
    return eom.shared.get_or_create(("scale", p.tobytes()), lambda: _scale(eom, p, mass), bounded=True)


def generic_poses(eom: Equations) -> np.ndarray:
    """The estimated pose, and the same with scattered angles and parameters of curves (k, n)."""
    extra = eom.mechanism.coordinates
    poses = np.tile(eom.estimate[0], (POSES + 1, 1))
    poses[1:, eom.angles] += np.pi * scattered(POSES, int(np.sum(eom.angles)))
    if extra:
        spans = np.array([coordinate.span for coordinate in extra])
        middle, half = np.mean(spans, axis=1), np.ptp(spans, axis=1) / 2
        poses[1:, -len(extra) :] = middle + half * scattered(POSES, len(extra))
    return poses


def _scale(eom: Equations, p: np.ndarray, mass: np.ndarray) -> Scale:
    n, m = eom.q.numel(), eom.lam.numel()
    rows, columns = (np.array(part, int) for part in eom.slopes.sparsity_out(0).get_triplet())
    poses = generic_poses(eom)
    values = np.array([eom.slopes(0.0, pose, p).nonzeros() for pose in poses]).reshape(len(poses), rows.size)
    values = np.abs(values[np.all(np.isfinite(values), axis=1)])
    of_body = np.arange(n) < 3 * len(eom.mechanism.bodies)
    straight = of_body & ~eom.angles

    def largest_of_rows(chosen: np.ndarray) -> np.ndarray:
        """Largest entry of each row in some of the columns (poses, m)."""
        sizes = np.zeros((len(values), m))
        here = chosen[columns]
        np.maximum.at(sizes.T, rows[here], values[:, here].T)
        return sizes

    moved, turned = largest_of_rows(straight), largest_of_rows(eom.angles)
    held = moved > 0
    lever = float(np.max(turned[held] / moved[held], initial=0.0))
    length = _length(lever, _extent(eom, p), _gyration(eom, mass))
    scaled = np.where(eom.angles, 1 / length, 1.0)
    for k in np.flatnonzero(~of_body):
        slopes = largest_of_rows(np.arange(n) == k)
        lever = float(np.max(slopes[held] / moved[held], initial=0.0))
        scaled[k] = 1 / lever if lever > NEGLIGIBLE * length else 1.0
    squares = np.zeros((len(values), m))
    np.add.at(squares.T, rows, ((values * scaled[columns]) ** 2).T)
    usual = np.sqrt(np.max(squares, axis=0)) if len(values) else np.ones(m)
    return Scale(length, scaled, usual)


def _length(lever: float, extent: float, gyration: float) -> float:
    """Characteristic length of a mechanism with these levers, extent and radius of gyration, m."""
    if lever > max(NEGLIGIBLE * max(extent, gyration), SHORTEST):
        return lever
    return next((length for length in (extent, gyration) if length > SHORTEST), 1.0)


def marker_points(eom: Equations, p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of the markers of all elements in their bodies (k, 2), m, as they are at first; True for the ground."""

    def points() -> tuple[ca.Function, np.ndarray]:
        markers = [m for element in eom.mechanism.elements for m in element.markers]
        local = ca.vertcat(ca.SX(0, 1), *[m.local for m in markers])
        on_ground = np.array([m.body.is_ground for m in markers], bool)
        return ca.Function("markers", list(eom.symbols), [ca.densify(local)]), on_ground

    function, on_ground = eom.shared.get_or_create("marker points", points)
    q, v, z = eom.estimate
    zeros = np.zeros(eom.q.numel()), z, np.zeros(eom.lam.numel())
    return function(0.0, q, v, *zeros, eom.input_values, p).full().reshape(-1, 2), on_ground


def _extent(eom: Equations, p: np.ndarray) -> float:
    """Distance between the parts: bodies as they are estimated, and markers on bodies and on the ground, m."""
    bodies = eom.estimate[0][: 3 * len(eom.mechanism.bodies)].reshape(-1, 3)
    local, on_ground = marker_points(eom, p)
    reach = np.max(np.abs(local[~on_ground]), initial=0.0)
    spread = np.ptp(np.vstack([bodies[:, :2], local[on_ground]]), axis=0)
    extent = float(np.max([*spread, reach]))
    return extent if np.isfinite(extent) else 0.0


def _gyration(eom: Equations, mass: np.ndarray) -> float:
    """Median radius of gyration of the bodies that have mass and inertia, m."""
    properties = mass[: 3 * len(eom.mechanism.bodies)].reshape(-1, 3)
    both = (properties[:, 0] > 0) & (properties[:, 2] > 0)
    squares = np.sort(properties[both, 2] / properties[both, 0])
    # numpy.median imports the masked arrays, which takes as long as an assembly
    middle = squares[(squares.size - 1) // 2 : squares.size // 2 + 1]
    return float(np.sqrt(np.mean(middle))) if middle.size else 0.0
