"""Singular poses: which rows take part, and whether the mechanism locks or may go two ways."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..results.validity import broken_at_pose
from .mobility import Mobility, mobility

#: Components of a null vector that count as taking part; and those of rows that prescribe a velocity, which lock
#: however little their row weighs beside the joints'.
TAKES_PART, PRESCRIBES = 0.05, 1e-4


@dataclass(frozen=True)
class SingularPose:
    """A pose at which the rank of the Jacobian drops.

    Attributes
    ----------
    kind : {"lock-up", "bifurcation", "shaky"}
        No velocity meets the drivers; several motions do; or an infinitesimal motion does that goes nowhere.
    rows : tuple of str
        Rows that depend on each other there, the strongest first.
    text : str
        Kind and rows in words.
    """

    kind: str
    rows: tuple[str, ...]
    text: str


#: The kinds in words.
MEANING = {
    "lock-up": "a lock-up: no velocity meets the drivers there",
    "bifurcation": "a bifurcation: several motions are possible there",
    "shaky": "a shaky pose: it cannot move, and yet no finite reactions hold loads along some infinitesimal motion",
}


def singular_pose(numeric: NumericEquations, t: float, q: np.ndarray, z: np.ndarray) -> SingularPose | None:
    """Return the singularity of a pose, to the accuracy of a pose; None if poses nearby have the same rank."""
    around = mobility(numeric, t, q)
    return describe_singularity(numeric, t, q, z, around) if around.singular else None


def describe_singularity(
    numeric: NumericEquations, t: float, q: np.ndarray, z: np.ndarray, around: Mobility | None = None
) -> SingularPose:
    """Return the kind of a singularity at (or very near to) a pose, and the rows that take part.

    The combination of rows with the smallest singular value names the rows.
    It is a lock-up if the prescribed velocity ``nu`` has a part along it, since
    no velocity then meets the drivers. If it has none, it is a bifurcation, or
    a shaky pose if nothing moves by the :func:`.mobility` around it, which is found unless it is given.
    """
    eom = numeric.eom
    jacobian, nu = numeric.velocity(t, q, z)
    size = numeric.scale.row_size(jacobian)
    # the smallest one, whether or not it counts as zero
    left, values, _ = np.linalg.svd(numeric.scale.scaled(jacobian))
    smallest = left[:, min(len(values), left.shape[1]) - 1]
    order = np.argsort(-np.round(np.abs(smallest), 6), kind="stable")  # of rows that weigh the same the first
    counts = np.where(np.abs(nu) > 1e-12, PRESCRIBES, TAKES_PART)
    rows = tuple(eom.row_names[k] for k in order if abs(smallest[k]) > counts[k])
    along = abs(float(smallest @ (nu / size)))
    locks = along > 1e-4 * max(float(np.linalg.norm(nu / size)), 1e-300)
    shaky = not locks and (around or mobility(numeric, t, q)).shaky
    kind = "lock-up" if locks else "shaky" if shaky else "bifurcation"
    remarks = "".join(f"; {sentence}" for sentence in broken_at_pose(numeric, t, q))
    return SingularPose(kind, rows, f"{MEANING[kind]}; the rows that take part are {', '.join(rows)}{remarks}")
