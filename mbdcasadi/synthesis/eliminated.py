"""Rows of all positions, and their least squares and rank with the poses eliminated, each by its own rows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Rows:
    """Rows at one start, and their slopes.

    Attributes
    ----------
    fixed, fixed_slopes : numpy.ndarray
        Those of the unknowns alone (m,), (m, n).
    values, to_pose, to_unknown : numpy.ndarray
        Those of each position (c, r), by its pose (c, r, k) and the unknowns (c, r, n); zero where `present` is not.
    present : numpy.ndarray
        True for rows that are there (c, r): positions may have more or fewer relations.
    """

    fixed: np.ndarray
    fixed_slopes: np.ndarray
    values: np.ndarray
    to_pose: np.ndarray
    to_unknown: np.ndarray
    present: np.ndarray

    @property
    def all(self) -> np.ndarray:
        """All values, those of the unknowns alone first."""
        return np.concatenate([self.fixed, self.values[self.present]])

    @property
    def are_finite(self) -> bool:
        """True if all values and slopes are finite."""
        return all(np.isfinite(x).all() for x in (self.all, self.fixed_slopes, self.to_pose, self.to_unknown))

    def times(self, factors: np.ndarray) -> Rows:
        """The rows times factors, in the order of `all`."""
        first, of_positions = factors[: self.fixed.size], np.zeros(self.present.shape)
        of_positions[self.present] = factors[self.fixed.size :]
        return Rows(
            self.fixed * first,
            self.fixed_slopes * first[:, None],
            self.values * of_positions,
            self.to_pose * of_positions[..., None],
            self.to_unknown * of_positions[..., None],
            self.present,
        )

    def of_length_one(self) -> Rows:
        """The rows divided by the lengths of their slopes."""
        both = np.concatenate([self.to_pose, self.to_unknown], axis=2)
        lengths = [np.linalg.norm(self.fixed_slopes, axis=1), np.linalg.norm(both, axis=2)[self.present]]
        length = np.concatenate(lengths)
        return self.times(1 / np.where(length > 0, length, 1.0))


class Eliminated:
    """Rows in the unknowns alone that are left if each pose meets as many of its own rows as it can.

    With singular values of the slopes of a position by its pose, ``J_y = U S V^T``, the rows ``U^T J_p`` of those that
    vanish are left, and the others give the pose.

    Parameters
    ----------
    rows : Rows
        All rows.
    tolerance : float
        Singular value, relative to the largest one of the position, below which it counts as zero.

    Attributes
    ----------
    slopes, values : numpy.ndarray
        Of the rows that are left (m, n), (m,).
    rank_of_poses : int
        Number of rows that give poses.
    """

    def __init__(self, rows: Rows, tolerance: float):
        left, sizes, self._right = np.linalg.svd(rows.to_pose)
        left = left.swapaxes(1, 2)
        slopes, values = left @ rows.to_unknown, (left @ rows.values[..., None])[..., 0]
        count = sizes.shape[1]
        kept = sizes > tolerance * np.max(sizes, axis=1, keepdims=True, initial=np.finfo(float).tiny)
        self.rank_of_poses, gone = int(np.sum(kept)), np.ones(values.shape, bool)
        gone[:, :count] = ~kept
        self.slopes = np.vstack([rows.fixed_slopes, slopes[gone]])
        self.values = np.concatenate([rows.fixed, values[gone]])
        inverse = np.where(kept, 1 / np.where(kept, sizes, 1.0), 0.0)
        self._slopes, self._values = inverse[..., None] * slopes[:, :count], inverse * values[:, :count]

    def along(self, dp: np.ndarray) -> np.ndarray:
        """Steps of the poses (c, k) that go with one of the unknowns, the rows held."""
        return self._of_poses(self._slopes @ dp)

    def step(self) -> tuple[np.ndarray, np.ndarray]:
        """Steps of poses (c, k) and unknowns (n,) to the least sum of squares."""
        dp = -np.linalg.lstsq(self.slopes, self.values, rcond=None)[0]
        return self._of_poses(self._slopes @ dp + self._values), dp

    def _of_poses(self, own: np.ndarray) -> np.ndarray:
        moved: np.ndarray = -(own[:, None] @ self._right[:, : own.shape[1]])[:, 0]
        return moved
