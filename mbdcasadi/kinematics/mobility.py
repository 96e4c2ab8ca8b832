"""Mobility of a mechanism near a pose: which of the infinitesimal motions are motions.

The rank of ``Phi_q`` counts the infinitesimal motions of one pose. Some of
these may go nowhere (a plate on three bars that meet in a point is *shaky*),
or only a part of them at a time (a flat parallelogram may turn into an
antiparallelogram). Excursions along them decide: the pose is moved a little and
brought back onto the constraints.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..equations.numeric import NumericEquations
from ..numerics.least_squares import largest
from ..numerics.newton import Equations, refine_root, solve
from ..numerics.rank import RankAnalysis, analyse_rank
from ..numerics.tolerances import NEARLY_SINGULAR

#: Distances by which a pose is moved to see whether a loss of rank is particular to it, in characteristic lengths.
EXCURSIONS = (0.03, 0.03, 0.03, 0.01, 0.003)
#: Largest number of further trials if several loops are singular at once.
SEARCH = 5
#: Distance by which it is moved to see whether a direction can be followed at all.
PROBE = 1e-3
#: Share of a displacement that must be left for the direction to count as a motion.
FOLLOWED_SHARE = 0.3
#: A pose with a small singular value is singular if it is below this share of its value in poses nearby.
SINGULAR_SHARE = 1e-3
#: Share of a random displacement that must be lost for single directions to be looked at.
LOST_SHARE = 0.02


@dataclass(frozen=True)
class Mobility:
    """Rank of the constraints near a pose.

    Attributes
    ----------
    rank : int
        Number of constraints that count: coordinates less degrees of freedom.
    pose : numpy.ndarray
        Pose near the given one in which the rank is largest (n,).
    analysis : RankAnalysis
        Of the Jacobian there.
    shaky : int
        Number of infinitesimal motions there that cannot be followed.
    singular : bool
        True if the given pose is singular: its own rank is lower, to the accuracy of a pose.
    """

    rank: int
    pose: np.ndarray
    analysis: RankAnalysis
    shaky: int = 0
    singular: bool = False


def mobility(numeric: NumericEquations, t: float, q: np.ndarray) -> Mobility:
    """Find the rank of the constraints in poses near a consistent one; drivers are released for the excursions.

    References
    ----------
    Wohlhart, "Degrees of shakiness", Mechanism and Machine Theory 34, 1999; Müller, "Generic mobility of rigid body
    mechanisms", Mechanism and Machine Theory 44, 2009.
    """
    m, n = numeric.eom.lam.numel(), q.size
    here = numeric.rank(t, q)
    certain = here.rank_at(NEARLY_SINGULAR)
    if certain in (m, n):
        return Mobility(here.rank, q, here)
    joints = Joints(numeric, t)
    rank, pose, analysis = certain, q, here
    tries = list(EXCURSIONS) if joints.motions(q).size else []
    searched = False
    while tries and rank < min(m, n):
        moved = joints.advanced(q, joints.random_motion(q), tries.pop(0))
        if moved is None:
            continue
        there = numeric.rank(t, moved)
        if there.rank_at(NEARLY_SINGULAR) > rank:
            rank, pose, analysis = there.rank_at(NEARLY_SINGULAR), moved, there
        if there.rank > there.rank_at(NEARLY_SINGULAR) > certain and not searched:
            # of several flat loops some have moved, and others are as flat as they were
            tries, searched = tries + SEARCH * list(EXCURSIONS), True
    blocked = joints.blocked(pose)
    if len(blocked):
        rank = analyse_rank(np.vstack([numeric.scaled_jacobian(t, pose), blocked])).rank
        return Mobility(rank, pose, analysis, len(blocked), singular=rank > certain)
    lost = rank > certain and here.singular_values[rank - 1] < SINGULAR_SHARE * analysis.singular_values[rank - 1]
    return Mobility(rank, pose, analysis, singular=bool(lost))


class Joints:
    """Position constraints without drivers, and excursions on them, in coordinates scaled to metres."""

    def __init__(self, numeric: NumericEquations, t: float):
        self._numeric, self._t = numeric, t
        eom = numeric.eom
        self._kept = [
            k for k, row in enumerate(eom.position_rows) if eom.row_elements[row] not in eom.mechanism.drivers
        ]
        self._rows = eom.position_rows[self._kept]
        self._random = np.random.default_rng(1)

    def _equations(self, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        numeric = self._numeric  # rows of drivers, which alone follow states, are left out
        phi, jacobian = numeric.position(self._t, pose, numeric.eom.estimate[2])
        return phi[self._kept], jacobian[self._kept]

    def motions(self, pose: np.ndarray) -> np.ndarray:
        """Orthonormal basis of the infinitesimal motions (n, k)."""
        scaled = self._numeric.scaled_jacobian(self._t, pose)[self._rows]
        return analyse_rank(scaled, NEARLY_SINGULAR).null_columns if len(scaled) else np.eye(pose.size)

    def random_motion(self, pose: np.ndarray) -> np.ndarray:
        """A random infinitesimal motion, its largest entry 1 (n,)."""
        motions = self.motions(pose)
        # a random vector projected: the basis of several motions is arbitrary, and differs from processor to processor
        motion = motions @ (motions.T @ self._random.standard_normal(pose.size))
        return motion / largest(motion)

    def moved(self, pose: np.ndarray, motion: np.ndarray, distance: float) -> np.ndarray | None:
        """Pose displaced along a motion, its largest entry a distance, and brought back; None if it stays open."""
        return self._solved(self._equations, pose + distance * self._numeric.scale.coordinates * motion)

    def advanced(self, pose: np.ndarray, motion: np.ndarray, distance: float) -> np.ndarray | None:
        """Pose at a distance, as measured along a motion; None if there is none.

        Without the distance Newton's method is drawn back to a singular pose from anywhere near it.
        """
        size = self._numeric.scale.coordinates
        row = motion / (motion @ motion) / size

        def with_distance(moved: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            phi, jacobian = self._equations(moved)
            return np.append(phi, row @ (moved - pose) - distance), np.vstack([jacobian, row])

        return self._solved(with_distance, pose + distance * size * motion)

    def _solved(self, equations: Equations, start: np.ndarray) -> np.ndarray | None:
        # in lengths and angles alone: mobility does not depend on masses
        sizes = self._numeric.scale.coordinates
        outcome = solve(equations, start, 1 / sizes**2, sizes=sizes, iterations=60)
        return refine_root(equations, outcome.x, 1 / sizes**2, sizes=sizes) if outcome.converged else None

    def blocked(self, pose: np.ndarray) -> np.ndarray:
        """Infinitesimal motions that cannot be followed, orthonormal (k, n)."""
        motions = self.motions(pose)
        count = motions.shape[1]
        if not count or self._followed(pose, motions, self._random.standard_normal((count,))):
            return np.zeros((0, pose.size))
        reached = np.zeros((count, count))
        for k, direction in enumerate(np.linalg.qr(self._random.standard_normal((count, count)))[0].T):
            reached[:, k] = self._reached(pose, motions, direction)
        # dense and small: as many rows as the joints leave motions
        left, values, _ = np.linalg.svd(reached)
        return (motions @ left[:, values < FOLLOWED_SHARE]).T

    def _followed(self, pose: np.ndarray, motions: np.ndarray, direction: np.ndarray) -> bool:
        direction = np.asarray(direction / np.linalg.norm(direction))
        return bool(np.linalg.norm(self._reached(pose, motions, direction) - direction) < LOST_SHARE)

    def _reached(self, pose: np.ndarray, motions: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Remainder of a unit displacement in a direction among the motions, after it was brought back (k,)."""
        motion = motions @ direction
        size = PROBE / largest(motion)
        moved = self.moved(pose, motion, size)
        if moved is None:
            return np.zeros(direction.size)
        return motions.T @ ((moved - pose) / self._numeric.scale.coordinates) / size
