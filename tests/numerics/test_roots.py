"""Roots between two points, and signs of them between samples."""

import numpy as np
import pytest

from mbdcasadi.numerics.roots import bracketed_root, nears_zero


@pytest.mark.parametrize("root", [0.0, 0.3, 0.999, 1.0])
def test_the_point_that_is_returned_is_right_of_the_root(root):
    found = bracketed_root(lambda x: (x - root) ** 3, -1.0, 1.5, (-1 - root) ** 3, (1.5 - root) ** 3, 1e-12)
    assert root <= found <= root + 1e-12


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_parabolas_that_dip_to_zero_between_samples(sign):
    """``(x - c)² + d`` over [0, 1]: beyond zero, just above it, far above it, and with its extremum outside."""
    centre, height = np.array([0.5, 0.4, 0.5, 1.5]), np.array([-0.1, 0.01, 0.5, -0.01])
    before, after = centre**2 + height, (1 - centre) ** 2 + height
    near = nears_zero(sign * before, sign * after, 1.0, sign * np.ones(4))
    np.testing.assert_array_equal(near, [True, True, False, False])
    assert not np.any(nears_zero(before, after, 1.0, np.zeros(4)))  # straight lines have no extremum
