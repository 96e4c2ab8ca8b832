"""Numbers without a pattern."""

import numpy as np
import pytest

from mbdcasadi.numerics.scattered import scattered


@pytest.mark.parametrize("shape", [(), (1,), (0,), (4, 0), (500, 3)])
def test_shape_and_range(shape):
    numbers = scattered(*shape)
    assert numbers.shape == shape
    assert np.all(np.abs(numbers) <= 1)
    np.testing.assert_array_equal(numbers, scattered(*shape))


def test_they_are_spread_evenly():
    counts, _ = np.histogram(scattered(20_000), bins=20, range=(-1, 1))
    assert 900 < counts.min() and counts.max() < 1100


def test_neighbours_have_nothing_to_do_with_each_other():
    numbers = scattered(20_000)
    for lag in (1, 2, 3, 5, 8, 13):
        assert abs(np.corrcoef(numbers[lag:], numbers[:-lag])[0, 1]) < 0.03


def test_a_square_of_them_is_regular():
    assert np.linalg.cond(scattered(30, 30)) < 1e4
