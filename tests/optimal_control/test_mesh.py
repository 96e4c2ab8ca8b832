"""Mesh points that move."""

import numpy as np

from mbdcasadi.optimal_control.transcription.mesh import Mesh


def test_points_that_met_stay_points_of_the_mesh():
    """Points that meet, pass others or leave their segment are in order and apart; others stay as they were found."""
    mesh = Mesh((np.linspace(0, 1, 5), np.linspace(0, 1, 4)), moving=(1, 2, 3, 5, 6))
    times = np.array([0, 0, 0.5, 0.4, 1, 1.2, 3.5, 3])  # s
    moved = mesh.moved(times)
    assert moved.counts == mesh.counts and moved.moving == mesh.moving
    found = moved.times(np.array([0, 1, 3.0]))
    assert np.all(np.diff(found) > 0)
    np.testing.assert_allclose(found, [0, 0, 0.5, 0.5, 1, 1.2, 3, 3], atol=1e-8)


def test_points_apart_are_moved_as_they_are():
    """What is found is not changed by rounding."""
    mesh = Mesh((np.linspace(0, 1, 4),), moving=(1, 2))
    assert np.array_equal(mesh.moved(np.array([0, 0.25, 0.5, 1])).positions, [0, 0.25, 0.5, 1])
