"""Small complementarity problems, beside non-negative least squares and by hand."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import nnls

from mbdcasadi.simulation.changes import complementarity
from mbdcasadi.simulation.changes.complementarity import Complementarity
from mbdcasadi.simulation.changes.spots import Spot


@pytest.mark.parametrize("seed", range(6))
def test_without_friction_it_is_a_least_squares_problem(seed):
    """With ``D = B^T B``, ``c = -B^T b`` the solution is that of ``min |B x - b|, x >= 0``."""
    generator = np.random.default_rng(seed)
    matrix, right = generator.standard_normal((7, 5)), generator.standard_normal(7)
    d, c = matrix.T @ matrix, -matrix.T @ right
    spots = [Spot(k, None, ("closed", "open")) for k in range(5)]
    (solution,) = Complementarity(d, c, np.diag(d), spots).solutions()
    np.testing.assert_allclose(solution.forces, nnls(matrix, right)[0], atol=1e-12)


def test_places_that_slide_together_share_the_friction():
    """Two corners of a block stick by one row, up to the sum of both limits."""
    rows = np.array([[0, 1, -1.0], [0, 1, 1], [1, 0, 0.5], [1, 0, 0.5]])  # inertia and mass of one
    d = rows @ rows.T
    stuck = ("sticks", "forth", "back", "open")
    spots = [Spot(0, 2, stuck, 0.3, 0.3), Spot(1, 3, stuck, 0.3, 0.3)]
    for push, expected in ((0.9, ("sticks", "shares")), (3.1, ("forth", "forth"))):
        c = rows @ [push, -10, 0]
        found = Complementarity(d, c, np.diag(d), spots).solutions()
        assert found[0].statuses == expected
        assert found[0].forces[:2].sum() == pytest.approx(10)


def test_parts_that_do_not_act_on_each_other():
    """Rows are joined by a place or by the motion of one body."""
    d = np.diag([1.0, 1, 2, 2, 3])
    d[0, 4] = d[4, 0] = 0.5
    spots = [Spot(0, 1, ("sticks", "open")), Spot(2, 3, ("sticks", "open")), Spot(4, None, ("closed", "open"))]
    assert Complementarity(d, np.ones(5), np.diag(d), spots).parts() == [([0, 2], [0, 1, 4]), ([1], [2, 3])]


def test_what_no_force_moves_neither_closes_nor_sticks():
    """A place that joints hold has no effect on the motion, and bears nothing."""
    d = np.diag([1e-20, 1.0])
    spots = [Spot(0, None, ("closed", "open")), Spot(1, None, ("closed", "open"))]
    (solution,) = Complementarity(d, np.array([0.0, -2.0]), np.ones(2), spots).solutions()
    assert solution.statuses == ("idle", "closed")
    np.testing.assert_allclose(solution.forces, [0, 2])


@pytest.mark.parametrize("seed", range(3))
def test_inequalities_leave_out_no_solution(seed, monkeypatch):
    """Choices that are left out before all places are decided, beside every choice looked at by itself."""
    generator = np.random.default_rng(seed)
    stuck = ("sticks", "forth", "back", "open")
    found, number = [], 0
    for _ in range(15):
        rows = generator.standard_normal((6, 4))
        if generator.random() < 0.5:
            rows[4] = rows[3] * generator.choice([-1, 1])  # two places slide together
        d, c = rows @ rows.T, rows @ generator.standard_normal(4)
        frictions = generator.choice([0.2, 1.5], 3)
        spots = [Spot(k, 3 + k, stuck, mu, mu * generator.choice([1, 1.2])) for k, mu in enumerate(frictions)]
        both = []
        for few in (4**3, 1):
            monkeypatch.setattr(complementarity, "FEW", few)
            both.append({solution.statuses for solution in Complementarity(d, c, np.diag(d), spots).solutions()})
        found.append(both)
        number += len(both[0])
    assert all(every == left for every, left in found) and number > 10
