"""Forces of contact and friction that the motion leaves open: of all that bring it about, those of least norm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...numerics.least_squares import largest, least_distance, row_scale
from ...numerics.rank import analyse_rank
from ...numerics.tolerances import ACCURACY, NEGLIGIBLE
from .friction_modes import SENSE


@dataclass(frozen=True)
class Bearing:
    """One place at which a force may act.

    Attributes
    ----------
    normal, tangent : int or None
        Its rows.
    status : str
        ``"closed"``, ``"sticks"``, ``"forth"`` or ``"back"``.
    coefficient : float
        Of friction: at rest if it sticks.
    load : float
        Load of what has no normal row, N.
    """

    normal: int | None
    tangent: int | None
    status: str
    coefficient: float = 0.0
    load: float = 0.0


class SharedForces:
    """The forces of some places that bring about one motion: ``x = x0 + N y`` within the laws of contact and friction.

    Parameters
    ----------
    rows, jacobian : numpy.ndarray
        Velocities along which the forces act (r, n), and those that joints hold (m, n).
    sizes : numpy.ndarray
        Sizes of the velocities (n,).
    bearings : sequence of Bearing
        The places.
    kept : sequence of int
        Rows of joints whose multipliers stay what they are, as friction that slides depends on them.

    Attributes
    ----------
    directions : numpy.ndarray
        N (r, k), orthonormal.
    joints : numpy.ndarray
        Multipliers of the joints by y (m, k).
    """

    def __init__(
        self,
        rows: np.ndarray,
        jacobian: np.ndarray,
        sizes: np.ndarray,
        bearings: Sequence[Bearing],
        kept: Sequence[int] = (),
    ):
        unit = np.eye(len(rows))
        along, limits, offsets = list[np.ndarray](), list[np.ndarray](), list[float]()
        for place in bearings:
            normal = np.zeros(len(rows)) if place.normal is None else unit[place.normal]
            tangent = np.zeros(len(rows)) if place.tangent is None else unit[place.tangent]
            sense = SENSE.get(place.status, 0.0)
            if place.normal is not None:
                along.append(normal - sense * place.coefficient * tangent)
                limits.append(normal)
                offsets.append(0.0)
            if place.status == "sticks":
                along.append(tangent)
                limits += [place.coefficient * normal + way * tangent for way in (1, -1)]
                offsets += [place.coefficient * place.load] * 2
        forces = np.reshape(along, (len(along), len(rows)))
        self._limits, self._offsets = np.reshape(limits, (len(limits), len(rows))), np.array(offsets)
        both = np.vstack([forces @ rows, jacobian]) * sizes
        scale = row_scale(both, np.ones(sizes.size))
        null = analyse_rank(both * scale[:, None]).null_rows
        if len(kept):
            fixed = null[:, [len(forces) + k for k in kept]]
            null = analyse_rank(fixed, NEGLIGIBLE).null_rows @ null
        turned, shares, _ = np.linalg.svd(null[:, : len(forces)])
        null = (turned.T @ null)[: int(np.sum(shares > NEGLIGIBLE))] * scale
        self.directions, triangle = np.linalg.qr((null[:, : len(forces)] @ forces).T)
        self.joints = -np.linalg.solve(triangle.T, null[:, len(forces) :]).T

    def least(self, forces: np.ndarray) -> np.ndarray:
        """Return the forces of least norm that do what others do (r,)."""
        start = forces - self.directions @ (self.directions.T @ forces)
        missing = -self._limits @ start - self._offsets
        most = np.max(missing, initial=0.0)
        if most <= ACCURACY * largest(start):
            return start
        share = least_distance(self._limits @ self.directions, missing / most)
        return start if share is None else start + most * self.directions @ share

    def by_joints(self, change: np.ndarray) -> np.ndarray:
        """Return the change of the multipliers of the joints (m,) with one of the forces (r,)."""
        answer: np.ndarray = self.joints @ (self.directions.T @ change)
        return answer
