"""Roots between two points, and signs of them between samples."""

import numpy as np
import pytest

from mbdcasadi.numerics.roots import bracketed_root, bracketed_roots, nears_zero, sign_changes


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


def test_many_bracketed_roots_with_slopes_and_without():
    targets = np.linspace(0.5, 7.5, 50)
    low, high = np.zeros(50), np.full(50, 3.0)

    def cubes(x):
        return x**3 - targets, 3 * x**2

    roots = bracketed_roots(cubes, low, high, -targets)
    np.testing.assert_allclose(roots, np.cbrt(targets), rtol=1e-15)
    halved = bracketed_roots(lambda x: (cubes(x)[0], None), low, high, -targets)
    np.testing.assert_allclose(halved, np.cbrt(targets), rtol=1e-15)


def test_signs_change_between_samples_or_at_them():
    values = np.array([[1.0, -1.0, 0.0, 2.0], [0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0]])
    (rows, places), (zero_rows, zeros) = sign_changes(values)
    assert (rows.tolist(), places.tolist()) == ([0], [0])
    assert (zero_rows.tolist(), zeros.tolist()) == ([0], [2])
