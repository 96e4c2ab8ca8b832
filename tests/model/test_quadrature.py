"""Quadrature over shapes against exact moments."""

import numpy as np
import pytest

import mbdcasadi as mbd
from mbdcasadi.model.geometry.quadrature import quadrature, triangles

L_SHAPE = mbd.Polygon(((0, 0), (2, 0), (2, 0.5), (0.5, 0.5), (0.5, 3), (0, 3)))
SHAPES = {
    "rectangle": mbd.Rectangle(2.0, 0.7, center=(0.4, -0.3), angle=0.6),
    "disc": mbd.Disc(0.8, center=(1.0, 2.0)),
    "rod": mbd.Rod(1.4, center=(0.2, 0.1), angle=-0.5),
    "triangle": mbd.Polygon(((0, 0), (1, 0.2), (0.3, 0.9))),
    "hollow polygon": L_SHAPE,
    "clockwise polygon": mbd.Polygon(L_SHAPE.points[::-1]),
    "plate with a hole": mbd.Rectangle(2, 1) - mbd.Disc(0.3, center=(0.5, 0.1)),
    "two rods": mbd.Rod(1) + mbd.Rod(1, center=(0.5, 0.5), angle=np.pi / 2),
}


@pytest.mark.parametrize("order", [2, 4])
@pytest.mark.parametrize("name", SHAPES)
def test_area_centroid_and_second_moment_are_exact(name, order):
    """Sums over the points are the closed formulas of the shape."""
    shape = SHAPES[name]
    points, weights = quadrature(shape, order)
    measure, centroid, second = shape.mass_properties(density=1.0)
    assert np.sum(weights) == pytest.approx(measure, rel=1e-13)
    np.testing.assert_allclose(weights @ points / measure, centroid, atol=1e-13)
    assert weights @ np.sum((points - centroid) ** 2, axis=1) == pytest.approx(second, rel=1e-12)


def test_polynomials_of_the_stated_degree():
    """x⁴ y² over a disc and a rectangle, x³ y³ over a triangle with corners 0, (1, 0), (0, 1)."""
    points, weights = quadrature(mbd.Disc(1.0), 4)
    # ∫ r⁷ dr ∫ cos⁴ sin² = 1/8 · π/8
    assert weights @ (points[:, 0] ** 4 * points[:, 1] ** 2) == pytest.approx(np.pi / 64, rel=1e-13)
    points, weights = quadrature(mbd.Rectangle(2.0, 2.0), 4)
    assert weights @ (points[:, 0] ** 4 * points[:, 1] ** 2) == pytest.approx(2 / 5 * 2 / 3, rel=1e-13)
    points, weights = quadrature(mbd.Polygon(((0, 0), (1, 0), (0, 1))), 4)
    assert weights @ (points[:, 0] ** 3 * points[:, 1] ** 3) == pytest.approx(36 / 40320, rel=1e-12)


def test_points_of_a_hollow_polygon_lie_inside():
    """Ears are cut off, so that no point is outside; all weights are positive."""
    points, weights = quadrature(L_SHAPE, 3)
    assert np.all(weights > 0)
    inside = ((points[:, 0] > 0) & (points[:, 0] < 0.5) & (points[:, 1] > 0) & (points[:, 1] < 3)) | (
        (points[:, 0] > 0) & (points[:, 0] < 2) & (points[:, 1] > 0) & (points[:, 1] < 0.5)
    )
    assert np.all(inside)


def test_straight_corners_in_a_polygon():
    """A corner on an edge adds nothing and breaks nothing."""
    square = np.array([(0, 0), (0.5, 0), (1, 0), (1, 0.3), (1, 1), (0, 1.0)])
    pieces = triangles(square)
    areas = [_area(piece) for piece in pieces]
    assert sum(areas) == pytest.approx(1.0)


def _area(t):
    return abs((t[1, 0] - t[0, 0]) * (t[2, 1] - t[0, 1]) - (t[1, 1] - t[0, 1]) * (t[2, 0] - t[0, 0])) / 2


def test_shape_without_quadrature_is_refused():
    """A shape of the user's own."""

    class Own(mbd.Shape):
        pass

    with pytest.raises(mbd.ModelError, match="no quadrature"):
        quadrature(Own(), 3)
