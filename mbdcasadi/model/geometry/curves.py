"""Plane curves in the frame of a marker, as expressions in one parameter."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ExpressionError, ModelError
from ..immutable import HoldsSymbols, Immutable
from ..quantities import called, column, function_of, yes_or_no
from ..symbols import describe, number, symbols_of, values_of, varying_in
from .splines import closed_spline, spline

#: Number of samples at which a curve is checked when it is made.
SAMPLES = 1440


class Curve(Immutable, HoldsSymbols):
    """A plane curve ``s'(alpha)``, for a slot, a rail or the outline of a cam.

    Parameters
    ----------
    point : callable
        ``point(alpha)`` returns the coordinates (x, y), m; alpha is a ``casadi.SX``.
        They may contain parameters of the model, and are twice differentiable.
    lower, upper : float
        First and last parameter.
    closed : bool, default False
        True if it closes, with the period ``upper - lower``; `point` must then be periodic.

    Raises
    ------
    ModelError
        For limits out of order, a curve with a cusp (no tangent), and a closed curve that
        does not close.
    ExpressionError
        For symbols other than parameters.

    Examples
    --------
    A slot along a parabola::

        Curve(lambda s: (s, 2 * s**2), -0.1, 0.1)
    """

    _called = "Curve"

    def __init__(self, point: Callable[[ca.SX], Any], lower: float, upper: float, closed: bool = False):
        what = self._called
        symbol = ca.SX.sym("alpha")
        function = function_of(point, what, "point", "the parameter")
        coordinates = column(called(function, what, "point", symbol), f"{what}: point")
        if coordinates.numel() != 2:
            raise ModelError(f"{what}: point must return two coordinates, got {coordinates.numel()}")
        self._define(symbol, coordinates, ca.jacobian(coordinates, symbol), lower, upper, closed)

    def _define(self, symbol: ca.SX, point: ca.SX, tangent: ca.SX, lower: float, upper: float, closed: bool) -> None:
        """Keep the curve as expressions in a symbol, and check it."""
        what = self._called
        self.lower, self.upper = number(lower, what, "lower"), number(upper, what, "upper")
        if not self.upper > self.lower:
            raise ModelError(f"{what}: upper must be above lower, got {lower} and {upper}")
        self.closed = yes_or_no(closed, what, "closed")
        if varying := varying_in(ca.vertcat(point, tangent), besides=symbol):
            raise ExpressionError(f"{what}: a curve may contain parameters only, not {describe(varying[0])}")
        self._symbol, self._point, self._tangent = symbol, ca.densify(point), ca.densify(tangent)
        self._check(what)

    def _check(self, what: str) -> None:
        alpha = self.samples
        values = self.sampled(ca.vertcat(self._point, self._tangent), alpha)
        if not np.all(np.isfinite(values)):
            k = int(np.argmax(~np.all(np.isfinite(values), axis=0)))
            raise ModelError(f"{what}: the curve has no finite point or tangent at the parameter {alpha[k]:.6g}")
        self.size = float(np.max(np.ptp(values[:2], axis=1)))
        speed = np.hypot(values[2], values[3]) * (self.upper - self.lower)
        turning = np.sum(values[2:, 1:] * values[2:, :-1], axis=0)
        if np.min(speed) <= 1e-6 * self.size or np.min(turning) <= 0:
            k = int(np.argmin(speed) if np.min(speed) <= 1e-6 * self.size else np.argmin(turning))
            raise ModelError(
                f"{what}: the curve has a cusp or a corner, without a tangent, near the parameter {alpha[k]:.6g}"
            )
        if self.closed:
            ends = self.sampled(ca.vertcat(self._point, self._tangent), np.array([self.lower, self.upper]))
            apart = np.abs(ends[:, 1] - ends[:, 0]) / np.r_[np.full(2, self.size), np.full(2, np.max(speed))]
            if np.max(apart) > 1e-6:
                raise ModelError(
                    f"{what}: the curve does not close: it ends at ({ends[0, 1]:.6g}, {ends[1, 1]:.6g}) m and begins "
                    f"at ({ends[0, 0]:.6g}, {ends[1, 0]:.6g}) m, or the tangents there differ"
                )

    @classmethod
    def through(cls, points: Any, closed: bool = False) -> Curve:
        """Return the curve through points by splines over the length of their chords.

        Cubic ones, twice differentiable, for an open curve; of degree five for a closed one.

        Parameters
        ----------
        points : sequence of (float, float)
            (k, 2), m; at least four, five for a closed curve. The parameter is the length along the chords, m.
        closed : bool, default False
            If True, the curve continues from the last point to the first, which is not repeated.
        """
        closed = yes_or_no(closed, cls.__name__, "closed")
        points = checked_points(points, cls.__name__, least_points=5 if closed else 4)
        knots, points = chord_lengths(points, closed)

        def point(place: ca.SX) -> list[ca.SX]:
            if closed:
                return [closed_spline(place, knots, coordinate) for coordinate in points.T]
            return [spline(place, knots, coordinate, outside="linear") for coordinate in points.T]

        return Curve(point, 0.0, knots[-1], closed)

    # --- the curve as expressions -----------------------------------------------------------
    def _at(self, expression: ca.SX, parameter: Any) -> ca.SX:
        return ca.substitute(expression, self._symbol, ca.SX(parameter))

    def point(self, parameter: Any) -> ca.SX:
        """Return the point (2,) in the frame of the marker, m."""
        return self._at(self._point, parameter)

    def tangent(self, parameter: Any) -> ca.SX:
        """Return the derivative of the point by the parameter (2,), not of unit length."""
        return self._at(self._tangent, parameter)

    def direction(self, parameter: Any) -> ca.SX:
        """Return the smoothest vector along the tangent (2,), for constraints on its direction."""
        return self._at(self._direction_at_symbol(), parameter)

    def _direction_at_symbol(self) -> ca.SX:
        return self._tangent

    def normal(self, parameter: Any) -> ca.SX:
        """Return the unit normal (2,) to the right of the tangent: outward for a counter-clockwise outline."""
        return self._at(self._normal_at_symbol(), parameter)

    def _normal_at_symbol(self) -> ca.SX:
        g = self._tangent
        return ca.vertcat(g[1], -g[0]) / ca.norm_2(g)

    def curvature(self, parameter: Any) -> ca.SX:
        """Return the curvature, 1/m; positive if the curve turns left (an outline is then convex)."""
        return self._at(self._curvature_at_symbol(), parameter)

    def _curvature_at_symbol(self) -> ca.SX:
        g, bend = self._tangent, ca.jacobian(self._tangent, self._symbol)
        return (g[0] * bend[1] - g[1] * bend[0]) / ca.norm_2(g) ** 3

    def beside(self, parameter: Any, distance: Any) -> ca.SX:
        """Return the point (2,) at a distance from the curve along its normal, m: the centre of a roller."""
        if not isinstance(distance, ca.SX) and distance == 0:
            return self.point(parameter)
        return self.point(parameter) + distance * self.normal(parameter)

    # --- numbers ------------------------------------------------------------------------------
    @property
    def span(self) -> tuple[float, float]:
        """First and last parameter."""
        return self.lower, self.upper

    @property
    def samples(self) -> np.ndarray:
        """Evenly spaced parameters over the whole curve."""
        return np.linspace(self.lower, self.upper, SAMPLES, endpoint=not self.closed)

    def sampled(self, expression: ca.SX, parameters: np.ndarray) -> np.ndarray:
        """Return the values (k, n) of an expression along the curve, with the parameters' own values."""
        return values_over(expression, self._symbol, parameters)

    def points_and_normals(self, parameters: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return points and normals (2, n) at parameters."""
        values = self.sampled(ca.vertcat(self._point, self._normal_at_symbol()), parameters)
        return values[:2], values[2:]

    def curvatures(self, parameters: np.ndarray) -> np.ndarray:
        """Return the curvatures (n,) at parameters, 1/m."""
        return self.sampled(self._curvature_at_symbol(), parameters).ravel()


def values_over(expression: ca.SX, symbol: ca.SX, places: np.ndarray) -> np.ndarray:
    """Return the values (k, n) of a column in one symbol at places (n,), with the parameters' own values."""
    others = [s for s in symbols_of(expression) if not ca.is_equal(s, symbol)]
    function = ca.Function("curve", [symbol, *others], [ca.densify(expression)])
    values = function(places[None, :], *[float(values_of(other)[0, 0]) for other in others]).full()
    return np.tile(values, (1, places.size)) if values.shape[1] < places.size else values


def checked_points(points: Any, what: str, least_points: int = 4) -> np.ndarray:
    """Return the points of a curve as an array (k, 2)."""
    try:
        result = np.array(points, dtype=float)
    except (TypeError, ValueError, RuntimeError):
        raise ModelError(f"{what}: points must be pairs of numbers, got {points!r}") from None
    if result.ndim != 2 or result.shape[1] != 2 or len(result) < least_points:
        raise ModelError(f"{what}: points must be at least {least_points} pairs (x, y), got shape {result.shape}")
    if not np.all(np.isfinite(result)):
        raise ModelError(f"{what}: points must be finite, got {result[~np.all(np.isfinite(result), axis=1)][0]}")
    return result


def chord_lengths(points: np.ndarray, closed: bool) -> tuple[np.ndarray, np.ndarray]:
    """Return the chord length up to each point (k,), and the points, with the first repeated at the end if closed."""
    if closed:
        points = np.vstack([points, points[:1]])
    chords = np.hypot(*np.diff(points, axis=0).T)
    if np.any(chords <= 0):
        k = int(np.argmin(chords))
        raise ModelError(f"a curve through points: the points {k} and {(k + 1) % (len(points) - 1)} coincide")
    return np.r_[0.0, np.cumsum(chords)], points


def crossing(points: np.ndarray) -> np.ndarray | None:
    """Return a point (2,) at which the closed polygon through points (k, 2) crosses itself, or None."""
    sides = np.roll(points, -1, axis=0) - points

    def side_of(targets: np.ndarray) -> np.ndarray:
        """Return True for each target (j) to the left of each side (i)."""
        off = targets[None, :, :] - points[:, None, :]
        return sides[:, None, 0] * off[..., 1] - sides[:, None, 1] * off[..., 0] > 0

    left = side_of(points)
    apart = left != np.roll(left, -1, axis=1)  # side i separates the ends of side j
    k = np.arange(len(points))
    distance = np.abs(k[:, None] - k)
    neighbours = np.minimum(distance, len(points) - distance) <= 1
    crossings = np.argwhere(apart & apart.T & ~neighbours)
    return points[crossings[0, 0]] if len(crossings) else None


def least(function: Callable[[np.ndarray], np.ndarray], curve: Curve) -> float:
    """Return the parameter of a curve at which a function is least, by successively finer grids.

    The function may have many local minima, at which SciPy's minimisers would stop.
    """
    grid = curve.samples
    step = grid[1] - grid[0]
    best = float(grid[np.argmin(function(grid))])
    while step > 1e-12 * (curve.upper - curve.lower):
        grid = best + step * np.linspace(-1, 1, 21)
        if not curve.closed:
            grid = np.clip(grid, curve.lower, curve.upper)
        best = float(grid[np.argmin(function(grid))])
        step /= 8
    return best
