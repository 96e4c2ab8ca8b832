"""Curves of solutions that close on themselves, against curves in closed form."""

import numpy as np
import pytest

from mbdcasadi.numerics.solution_curve import closed_curve


def followed(rows, start, turning=False):
    start = np.array(start, float)
    return closed_curve(rows, start, np.ones(start.size), np.full(start.size, turning))


def test_an_ellipse():
    """It is followed once round: its perimeter by Ramanujan, less what chords are shorter."""
    a, b = 2.0, 1.0
    curve = followed(lambda x: (np.array([x[0] ** 2 / 4 + x[1] ** 2 - 1]), np.array([[x[0] / 2, 2 * x[1]]])), [2, 0])
    assert np.max(np.abs(curve.points[:, 0] ** 2 / 4 + curve.points[:, 1] ** 2 - 1)) < 1e-10
    chords = np.linalg.norm(np.diff(np.vstack([curve.points, curve.points[:1]]), axis=0), axis=1)
    h = ((a - b) / (a + b)) ** 2
    perimeter = np.pi * (a + b) * (1 + 3 * h / (10 + np.sqrt(4 - 3 * h)))
    assert np.sum(chords) == pytest.approx(perimeter, rel=2e-3) and not np.any(curve.period)


def test_two_angles_that_turn_together():
    """Gears of ratio 2: after one turn of the large one and two of the small one the pose is the first again."""
    curve = followed(lambda x: (np.array([x[1] - 2 * x[0]]), np.array([[-2.0, 1.0]])), [0.3, 0.6], turning=True)
    assert np.abs(curve.period) == pytest.approx([2 * np.pi, 4 * np.pi])


@pytest.mark.parametrize("ratio", [1.001, 2.0005])
def test_turns_that_lead_only_near_to_the_first_point(ratio):
    """Gears whose teeth have no small common multiple: after a turn the pose is nearly the first, but another one."""
    rows = lambda x: (np.array([x[1] - ratio * x[0]]), np.array([[-ratio, 1.0]]))  # noqa: E731
    assert followed(rows, [0.3, 0.3 * ratio], turning=True) is None


def test_dependent_rows_are_taken_twice():
    rows = lambda x: (np.array([x @ x - 1, 2 * x @ x - 2]), np.array([2 * x, 4 * x]))  # noqa: E731
    assert followed(rows, [1, 0]) is not None


@pytest.mark.parametrize(
    ("rows", "start"),
    [
        # a lemniscate crosses itself at the origin
        (
            lambda x: (
                np.array([(x @ x) ** 2 - x[0] ** 2 + x[1] ** 2]),
                np.array([[4 * x[0] * (x @ x) - 2 * x[0], 4 * x[1] * (x @ x) + 2 * x[1]]]),
            ),
            [1, 0],
        ),
        # two directions are free
        (lambda x: (np.array([x[0]]), np.array([[1.0, 0.0, 0.0]])), [0, 0, 0]),
        # none is free
        (lambda x: (x.copy(), np.eye(2)), [0, 0]),
    ],
)
def test_curves_that_meet_others_are_not_followed(rows, start):
    assert followed(rows, start) is None
