"""Quadrature points and weights over homogeneous shapes, for integrals of smooth fields."""

from __future__ import annotations

from functools import singledispatch

import numpy as np

from ...errors import ModelError
from .shapes import Composite, Disc, Polygon, Rectangle, Rod, Shape, rotation_matrix

#: Points (k, 2) in the shape's frame, m, and weights (k,), m² (of rods: m).
Rule = tuple[np.ndarray, np.ndarray]


@singledispatch
def quadrature(shape: Shape, order: int) -> Rule:
    """Return a Gauss rule over a shape: points (k, 2) and weights (k,), whose sum is the area (the length of rods).

    There are `order` points in each direction, on each triangle of a polygon too: polynomials of total degree ``2 order
    - 2`` are integrated exactly (``2 order - 1`` on rectangles, discs and rods). A composite takes the points of its
    parts and, with negative weights, of its holes.
    """
    raise ModelError(f"a field over {shape!r}: this kind of shape has no quadrature; use the shapes of the package")


def _line(order: int) -> Rule:
    """Return the Gauss–Legendre rule on 0 … 1."""
    points, weights = np.polynomial.legendre.leggauss(order)
    return (points + 1) / 2, weights / 2


def _turned(points: np.ndarray, angle: float, center: tuple[float, float]) -> np.ndarray:
    return points @ rotation_matrix(angle).T + center


@quadrature.register
def _(shape: Rectangle, order: int) -> Rule:
    x, w = _line(order)
    u, v = np.meshgrid((x - 0.5) * shape.width, (x - 0.5) * shape.height, indexing="ij")
    points = np.column_stack([u.ravel(), v.ravel()])
    return _turned(points, shape.angle, shape.center), shape.width * shape.height * np.outer(w, w).ravel()


@quadrature.register
def _(shape: Rod, order: int) -> Rule:
    x, w = _line(order)
    along = np.column_stack([(x - 0.5) * shape.length, np.zeros(order)])
    return _turned(along, shape.angle, shape.center), shape.length * w


@quadrature.register
def _(shape: Disc, order: int) -> Rule:
    # in the square of the radius the weight is constant; around, evenly spaced points are exact below their number
    square, w = _line(order)
    count = 2 * order
    angles = 2 * np.pi * (np.arange(count) + 0.5) / count
    radii = shape.radius * np.sqrt(square)
    points = np.stack([np.outer(radii, np.cos(angles)).ravel(), np.outer(radii, np.sin(angles)).ravel()], axis=1)
    return points + shape.center, np.repeat(np.pi * shape.radius**2 * w / count, count)


@quadrature.register
def _(shape: Polygon, order: int) -> Rule:
    rules = [_triangle(corners, order) for corners in triangles(shape.outlines()[0].points)]
    return np.vstack([points for points, _ in rules]), np.concatenate([weights for _, weights in rules])


@quadrature.register
def _(shape: Composite, order: int) -> Rule:
    rules = [quadrature(part, order) for part in shape.parts]
    rules += [(points, -weights) for points, weights in (quadrature(hole, order) for hole in shape.holes)]
    return np.vstack([points for points, _ in rules]), np.concatenate([weights for _, weights in rules])


def _triangle(corners: np.ndarray, order: int) -> Rule:
    """Return a Gauss rule on a triangle: that of a square with one side collapsed to a corner."""
    x, w = _line(order)
    u, v = (part.ravel() for part in np.meshgrid(x, x, indexing="ij"))
    first, second = corners[1] - corners[0], corners[2] - corners[0]
    points = corners[0] + np.outer(u * (1 - v), first) + np.outer(u * v, second)
    return points, abs(first[0] * second[1] - first[1] * second[0]) * np.outer(w, w).ravel() * u


def triangles(corners: np.ndarray) -> list[np.ndarray]:
    """Return a triangulation (3, 2) of a polygon with corners (k, 2) in counter-clockwise order, by ear clipping.

    SciPy triangulates the convex hull only.
    """
    left, ears = list(range(len(corners))), []
    while len(left) > 3:
        for k in range(len(left)):
            i, j, m = left[k - 1], left[k], left[(k + 1) % len(left)]
            ear = corners[[i, j, m]]
            others = corners[[n for n in left if n not in (i, j, m)]]
            if _area(*ear) > 0 and not any(_inside(ear, point) for point in others):
                ears.append(ear)
                left.pop(k)
                break
        else:  # only straight corners are left, or the edges touch: the thinnest one adds nothing
            k = int(np.argmin([abs(_area(*corners[[left[n - 1], left[n], left[(n + 1) % len(left)]]])) for n in
                               range(len(left))]))  # fmt: skip
            left.pop(k)
    return [*ears, corners[left]]


def _area(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> float:
    """Return twice the area of a triangle, positive if counter-clockwise."""
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _inside(ear: np.ndarray, point: np.ndarray) -> bool:
    """Return True if a point lies inside a triangle or on its border, and is not a corner."""
    sides = [_area(ear[k], ear[(k + 1) % 3], point) for k in range(3)]
    return min(sides) >= 0 and not any(np.array_equal(point, corner) for corner in ear)
