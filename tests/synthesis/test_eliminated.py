"""Least squares with the poses eliminated, against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from mbdcasadi.synthesis.eliminated import Eliminated, Rows

POSITIONS, ROWS, POSE, UNKNOWNS = 3, 4, 2, 5


def rows(singular=False):
    """Random rows, the last one of the second position not there; and their dense matrix."""
    random = np.random.default_rng(3)
    present = np.ones((POSITIONS, ROWS), bool)
    present[1, -1] = False
    values, to_pose, to_unknown = (random.normal(size=(POSITIONS, ROWS, *n)) for n in ((), (POSE,), (UNKNOWNS,)))
    if singular:
        to_pose[0, :, 1] = 2 * to_pose[0, :, 0]
    given = Rows(
        random.normal(size=2),
        random.normal(size=(2, UNKNOWNS)),
        values * present,
        to_pose * present[..., None],
        to_unknown * present[..., None],
        present,
    )
    dense = np.zeros((2 + POSITIONS * ROWS, POSITIONS * POSE + UNKNOWNS))
    dense[:2, POSITIONS * POSE :] = given.fixed_slopes
    for k in range(POSITIONS):
        part = slice(2 + k * ROWS, 2 + (k + 1) * ROWS)
        dense[part, k * POSE : (k + 1) * POSE] = given.to_pose[k]
        dense[part, POSITIONS * POSE :] = given.to_unknown[k]
    return given, dense[np.concatenate([[True, True], present.ravel()])]


def test_the_step_is_that_of_all_rows_at_once():
    given, dense = rows()
    dy, dp = Eliminated(given, 1e-11).step()
    whole = -np.linalg.lstsq(dense, given.all, rcond=None)[0]
    assert np.allclose(np.concatenate([dy.ravel(), dp]), whole, rtol=1e-12)
    factors = np.array([1, 0, *([1, 1, 1, 0] * 2), 1, 1, 0])
    dy, dp = Eliminated(given.times(factors), 1e-11).step()
    kept = factors.astype(bool)
    least = dense[kept] @ np.concatenate([dy.ravel(), dp]) + given.all[kept]
    assert np.linalg.norm(dense[kept].T @ least) < 1e-12


@pytest.mark.parametrize("singular", [False, True])
def test_the_rank_is_that_of_all_rows(singular):
    """Also if a pose is not given by its rows; what moves along the unknowns keeps these rows."""
    given, dense = rows(singular)
    eliminated = Eliminated(given.of_length_one(), 1e-9)
    assert eliminated.rank_of_poses + np.linalg.matrix_rank(eliminated.slopes) == np.linalg.matrix_rank(dense)
    dp = np.arange(1.0, 1 + UNKNOWNS)
    moved = np.concatenate([Eliminated(given, 1e-9).along(dp).ravel(), dp])
    poses = dense[2:, : POSITIONS * POSE]
    assert np.linalg.norm(poses.T @ (dense[2:] @ moved)) < 1e-12
