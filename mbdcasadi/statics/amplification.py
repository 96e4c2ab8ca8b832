"""Reactions in and near singular poses, in which small loads bring about large ones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..errors import warn
from ..kinematics.mobility import mobility
from ..kinematics.singular import describe_singularity
from ..numerics.tolerances import RANK
from .statics import Statics

#: Relative singular value below which reactions may be amplified, and by how much before it is reported.
NEAR_SINGULAR_LOADS, REPORTED = 1e-4, 1e3


@dataclass(frozen=True)
class Amplification:
    """Amplification of the loads in a pose.

    Attributes
    ----------
    factor : float
        Reactions by the load that they hold; 0 if they are not amplified.
    reaction : float
        The amplified reactions, N.
    singular : bool
        True if the pose is singular, to the accuracy of a pose.
    text : str
        The pose and the rows that take part, in words.
    """

    factor: float
    reaction: float
    singular: bool
    text: str


def amplification(statics: Statics, x: np.ndarray) -> Amplification | None:
    """Return how a pose amplifies loads; None if it does not and is not singular."""
    numeric = statics.numeric
    q, z, lam, _ = statics.split(x)
    if not lam.size:
        return None
    jacobian = numeric.jacobian(statics.t, q)
    # the combinations of rows that nearly vanish are needed, which no sparse factorisation has; once an equilibrium
    left, values, _ = np.linalg.svd(numeric.scale.scaled(jacobian), full_matrices=False)
    relative = values / max(float(np.max(values)), np.finfo(float).tiny)
    if np.min(relative) > NEAR_SINGULAR_LOADS:
        return None
    reactions = left.T @ (numeric.scale.row_size(jacobian) * lam)
    load = float(np.linalg.norm(values * reactions))
    near = (relative > RANK) & (relative < NEAR_SINGULAR_LOADS)
    reaction = float(np.linalg.norm(reactions[near]))
    factor = reaction / load if reaction > REPORTED * load > 0 else 0.0
    around = mobility(numeric, statics.t, q)
    if not factor and not around.singular:
        return None
    pose = describe_singularity(numeric, statics.t, q, z, around)
    return Amplification(factor, reaction, around.singular, pose.text)


def warn_of(pose: Amplification) -> None:
    """Warn of a pose in which reactions have few significant digits."""
    if pose.factor:
        what = (
            f"the pose is nearly singular: reactions of {pose.reaction:.3g} N hold a load {pose.factor:.2g} times "
            f"smaller, and change as much with a small change of the pose; {pose.text}"
        )
    else:
        what = f"the pose is singular, and reactions to other loads than these may be without bound; {pose.text}"
    warn(f"equilibrium: {what}")
