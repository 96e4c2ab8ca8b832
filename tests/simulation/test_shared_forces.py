"""Forces that the motion leaves open, beside a general optimiser."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize

from mbdcasadi.simulation.changes.shared_forces import Bearing, SharedForces


@pytest.mark.parametrize("seed", range(4))
def test_least_norm_within_the_laws(seed):
    """Three rough places on one body: the same load on the body, within the cones, and no smaller forces do."""
    generator, mu = np.random.default_rng(seed), 0.6
    rows, sizes = generator.standard_normal((6, 3)), np.array([1.0, 1.0, 0.2])
    normal = 1 + generator.random(3)
    forces = np.r_[normal, mu * normal * generator.uniform(-1, 1, 3)]
    bearings = [Bearing(k, 3 + k, "sticks", mu) for k in range(3)]
    shared = SharedForces(rows, np.zeros((0, 3)), sizes, bearings)
    least = shared.least(forces)
    assert shared.directions.shape == (6, 3)
    np.testing.assert_allclose(rows.T @ least, rows.T @ forces, atol=1e-12)
    assert np.all(np.abs(least[3:]) <= mu * least[:3] + 1e-12)
    cones = np.block([[mu * np.eye(3), np.eye(3)], [mu * np.eye(3), -np.eye(3)]])
    best = minimize(
        lambda x: x @ x,
        forces,
        constraints=[
            {"type": "eq", "fun": lambda x: rows.T @ (x - forces)},
            {"type": "ineq", "fun": lambda x: cones @ x},
        ],
        options={"ftol": 1e-14, "maxiter": 300},
    )
    assert least @ least == pytest.approx(best.fun, rel=1e-6)


def test_joints_answer_and_what_slides_keeps_its_ratio():
    """A guided block on two corners that slide: the guide takes the couple, and friction follows each normal force."""
    rows = np.array([[0, 1, -1.0], [0, 1, 1], [1, 0, 0.5], [1, 0, 0.5]])
    guide = np.array([[1.0, 0, 0], [0, 0, 1]])
    bearings = [Bearing(k, 2 + k, "forth", 0.2) for k in range(2)]
    shared = SharedForces(rows, guide, np.ones(3), bearings)
    forces = np.array([10.0, 0, -2, 0])
    least = shared.least(forces)
    np.testing.assert_allclose(least, [5, 5, -1, -1], atol=1e-12)
    change = least - forces
    np.testing.assert_allclose(guide.T @ shared.by_joints(change), rows.T @ change, atol=1e-12)
    kept = SharedForces(rows, guide, np.ones(3), bearings, kept=[1])  # the couple is the load of what slides
    np.testing.assert_allclose(kept.least(forces), forces)


def test_forces_that_are_unique():
    """Two normal forces on one body are told apart by its turning."""
    shared = SharedForces(
        np.array([[0, 1, -1.0], [0, 1, 1]]), np.zeros((0, 3)), np.ones(3), [Bearing(0, None, "closed")]
    )
    np.testing.assert_allclose(shared.least(np.array([2.0, 3.0])), [2, 3])
