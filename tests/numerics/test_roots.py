"""Roots between two points, and signs of them between samples."""

import numpy as np
import pytest

from mbdcasadi.numerics.roots import (
    TO_ROUNDING,
    Levels,
    bracketed_root,
    may_touch,
    narrowed_extrema,
    narrowed_roots,
    nears_zero,
    sign_changes,
)


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


def test_many_roots_to_rounding():
    targets = np.linspace(0.5, 7.5, 50)
    low, high = np.zeros(50), np.full(50, 3.0)
    roots = narrowed_roots(lambda x: x**3 - targets[:, None], low, high, -targets, TO_ROUNDING)
    np.testing.assert_allclose(roots, np.cbrt(targets), rtol=1e-15)


def test_signs_change_between_samples_or_at_them():
    values = np.array([[1.0, -1.0, 0.0, 2.0], [0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 1.0, 0.0]])
    (rows, places), (zero_rows, zeros) = sign_changes(values)
    assert (rows.tolist(), places.tolist()) == ([0], [0])
    assert (zero_rows.tolist(), zeros.tolist()) == ([0], [2])


def test_levels_between_samples_and_at_them():
    levels = Levels([[3.0, 1.0, 2.0, 2.0], [0.0]])
    values = np.array([[0.0, 2.5, 2.0, 0.5], [1.0, -1.0, 0.0, 2.0]])
    rows, places, passed = levels.passed(values)
    found = sorted(zip(rows.tolist(), places.tolist(), passed.tolist(), strict=True))
    assert found == [(0, 0, 1.0), (0, 0, 2.0), (0, 2, 1.0), (1, 0, 0.0)]
    rows, places = levels.met(values)
    assert sorted(zip(rows.tolist(), places.tolist(), strict=True)) == [(0, 2), (1, 2)]
    assert levels.met(np.full((2, 5), 2.0))[0].size == 0
    own, inside = levels.between(np.array([0, 1, 0]), np.array([2.0, 1.0, 3.5]), np.array([0.5, 2.0, 0.5]))
    assert (own.tolist(), inside.tolist()) == ([0, 2, 2, 2], [1.0, 1.0, 2.0, 3.0])


@pytest.mark.parametrize("count", [1, 3, 2000])
def test_narrowed_roots_and_extrema_of_many_functions(count):
    """``sin(x - c)`` has a zero at c and a maximum at c + π/2; brackets are cut into fewer parts if they are many."""
    centres = np.linspace(-1, 1, count)

    def waves(x):
        return np.sin(x - centres[:, None])

    low, high = centres - 0.7, centres + 0.9
    roots = narrowed_roots(waves, low, high, np.sin(low - centres))
    np.testing.assert_allclose(roots, centres, atol=1.6 * 2.0**-28)
    tops = narrowed_extrema(waves, centres, centres + 3, np.ones(count))
    np.testing.assert_allclose(tops, centres + np.pi / 2, atol=3 * 2.0**-19)
    bottoms = narrowed_extrema(lambda x: -waves(x), centres, centres + 3, -np.ones(count))
    np.testing.assert_array_equal(bottoms, tops)


def test_of_several_roots_the_first_that_samples_show():
    low, high = np.array([0.0]), np.array([7 * np.pi / 2])
    (root,) = narrowed_roots(np.cos, low, high, np.ones(1))
    assert root == pytest.approx(np.pi / 2, abs=1e-7)


def test_no_brackets_have_no_roots():
    none = np.zeros(0)
    assert narrowed_roots(np.cos, none, none, none).size == narrowed_extrema(np.cos, none, none, none).size == 0


@pytest.mark.parametrize(("low", "wanted"), [(0.5, False), (0.01, True), (-0.01, True)])
def test_parabolas_that_may_touch_zero(low, wanted):
    """``(x - 0.4)² + low`` through 0, 1 and 2: near to zero or beyond it between samples of one sign."""
    times = np.array([0.0, 1.0, 2.0])
    values = (times[:, None] - 0.4) ** 2 + low
    for sign in (1, -1):
        np.testing.assert_array_equal(may_touch(times, sign * values), [[wanted], [False]])
    assert not may_touch(times, values * np.array([[-1], [1], [1]]))[0, 0]
    assert not may_touch(times[:2], values[:2]).any()
