"""Singular poses: which rows take part, and whether the mechanism locks or may go two ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..results.validity import broken_at_pose

#: Components of a null vector that count as taking part; and those of rows that prescribe a velocity, which lock
#: however little their row weighs beside the joints'.
TAKES_PART, PRESCRIBES = 0.05, 1e-4


@dataclass(frozen=True)
class SingularPose:
    """A pose at which the rank of the Jacobian drops.

    Attributes
    ----------
    kind : {"lock-up", "bifurcation"}
        No velocity meets the drivers; or several motions do.
    rows : tuple of str
        Rows that depend on each other there, the strongest first.
    text : str
        The same in words.
    """

    kind: str
    rows: tuple[str, ...]
    text: str


def describe_singularity(numeric: NumericEquations, t: float, q: np.ndarray) -> SingularPose:
    """Tell what is singular at (or very near to) a pose.

    The combination of rows with the smallest singular value names the rows.
    It is a lock-up where the prescribed velocity ``nu`` has a part along it,
    since no velocity then meets the drivers, and a bifurcation where it has none.
    """
    eom = numeric.eom
    jacobian, nu = numeric.velocity(t, q)
    scaled = jacobian * numeric.column_scale
    size = np.linalg.norm(scaled, axis=1)
    size = np.where(size > 1e-12, size, 1.0)
    left, values, _ = np.linalg.svd(scaled / size[:, None])
    smallest = left[:, min(len(values), left.shape[1]) - 1]
    order = np.argsort(-np.abs(smallest))
    counts = np.where(np.abs(nu) > 1e-12, PRESCRIBES, TAKES_PART)
    rows = tuple(eom.row_names[k] for k in order if abs(smallest[k]) > counts[k])
    along = abs(float(smallest @ (nu / size)))
    kind = "lock-up" if along > 1e-4 * max(float(np.linalg.norm(nu / size)), 1e-300) else "bifurcation"
    meaning = (
        "a lock-up: no velocity meets the drivers there"
        if kind == "lock-up"
        else "a bifurcation: several motions are possible there"
    )
    remarks = "".join(f"; {sentence}" for sentence in broken_at_pose(numeric, t, q))
    return SingularPose(kind, rows, f"{meaning}; the rows that take part are {', '.join(rows)}{remarks}")
