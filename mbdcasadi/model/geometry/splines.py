"""Data as an expression: piecewise polynomials in ``casadi.SX``.

SciPy finds the coefficients; the expression picks those of the piece in which
its argument lies. (CasADi's own B-spline is 0 outside its data when it is
expanded to ``SX``, and has no monotone kind.) Each point is a comparison with
the argument in the expression, from which an integrator can find it.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.real import real_array
from ..quantities import one_of
from ..symbols import Numbers

if TYPE_CHECKING:
    from scipy.interpolate import PPoly

LEAST_POINTS = {"cubic": 4, "monotone": 2, "linear": 2}
#: Samples that a curve of degree five takes.
LEAST_SAMPLES = 6
OUTSIDE = ("error", "constant", "linear", "periodic")

#: Part of the data's width by which rounding may carry the argument beyond the data.
ROUNDING = 1e-9


def spline(x: Any, xs: Numbers, ys: Numbers, kind: str = "cubic", outside: str = "error") -> Any:
    """Return a curve through data points, as an expression in `x`.

    The curve meets the points exactly. At a point at which its first, second or third
    derivative jumps, the right-hand one is taken (at the last point the left-hand one).
    ``simulate`` with ``idas`` looks the piece up, so that many points cost little more than few; elsewhere the cost of
    an evaluation is proportional to the number of points, about 0.1 µs each: hundreds are cheap, thousands are slow.

    Parameters
    ----------
    x : casadi.SX, float or array
        Argument of any shape, such as time, an angle or a displacement.
    xs, ys : sequence of float, (n,)
        The points; `xs` increases strictly.
    kind : {"cubic", "monotone", "linear"}, default "cubic"
        - ``"cubic"``: C2, not-a-knot ends; for motions (at least 4 points).
        - ``"monotone"``: C1, monotone between the points; for forces and
          characteristic curves, which a cubic would overshoot (at least 2 points).
        - ``"linear"``: straight lines (at least 2 points).
    outside : {"error", "constant", "linear", "periodic"}, default "error"
        - ``"error"``: the value and its derivatives are NaN outside the data; results
          report it. Numbers for `x` raise an error at once. The curve extends by 1e-9 of the
          width of the data, to allow for rounding of the argument.
        - ``"constant"``: the value of the nearest end.
        - ``"linear"``: the tangent at the nearest end.
        - ``"periodic"``: the data repeat with period ``xs[-1] - xs[0]``; the first and last of
          `ys` are the same, and the kinds are as smooth there as at any other point.

    Returns
    -------
    casadi.SX, float or numpy.ndarray
        As `x`.

    Raises
    ------
    ModelError
        For points that are not finite, not increasing, too few or not periodic, for
        an unknown choice, and for a number outside the data if ``outside="error"``.

    References
    ----------
    C. de Boor, *A Practical Guide to Splines*, 2001, chapter IV.
    F. N. Fritsch, J. Butland, SIAM J. Sci. Stat. Comput. 5 (1984) 300, doi:10.1137/0905021 (monotone).

    Examples
    --------
    >>> angle = spline(ca.SX.sym("t"), [0, 1, 2, 3], [0, 0.5, 0.8, 0.6])
    >>> spline(0.5, [0, 1], [0, 3], kind="linear")
    1.5
    """
    one_of(kind, LEAST_POINTS, "spline", "kind")
    one_of(outside, OUTSIDE, "spline", "outside")
    xs, ys = _points(xs, ys, kind, outside)
    if isinstance(x, ca.MX):
        raise ModelError("spline: x is a casadi.MX; the model is written in casadi.SX")
    if isinstance(x, ca.SX):
        entries = [_curve(entry, xs, ys, kind, outside) for entry in ca.vertsplit(ca.vec(ca.densify(x)))]
        return ca.reshape(ca.vertcat(*entries), *x.shape)
    return _values(x, xs, ys, kind, outside)


def spline_integral(x: ca.SX, xs: Any, ys: Any, kind: str = "cubic", outside: str = "error") -> ca.SX:
    """Return the integral of a :func:`spline` from its first point to `x`, as an expression; not for periodic data."""
    xs, ys = _points(xs, ys, kind, outside)
    if outside == "periodic":
        raise ModelError("spline_integral: the integral of periodic data is not periodic")
    curve = polynomials(xs, ys, kind, periodic=False).antiderivative()
    return piecewise(x, xs, *_with_ends(curve, outside, order=1), outside)


def closed_spline(x: ca.SX, xs: np.ndarray, ys: np.ndarray) -> ca.SX:
    """Return a closed curve of degree five through points, as an expression with four continuous derivatives.

    For outlines of cams: the rows of a follower hold the tangent or the normal of the outline, and ``gamma`` their
    second derivatives, which with cubic splines would jump at every point. Of at least five points (n,) the last value
    is the same as the first; the curve repeats with the period ``xs[-1] - xs[0]``.
    """
    from scipy.interpolate import make_interp_spline

    coefficients = _taylor(make_interp_spline(xs, ys, k=5, bc_type="periodic"), xs[:-1], 6)
    return piecewise(x, xs, xs, np.column_stack([coefficients, coefficients[:, :1]]), "periodic")


def expression_of(x: ca.SX, curve: Any) -> Any:
    """Return a curve of SciPy (``CubicSpline``, ``make_interp_spline``, ``UnivariateSpline``) as an expression in `x`.

    Anything else is returned as it is. Outside its data the value is NaN, as with ``outside="error"``.

    Raises
    ------
    ModelError
        For a curve with several values at a point.
    """
    pieces = _pieces_of(curve)
    if pieces is None:
        return curve
    xs, order = pieces
    if np.ndim(curve(xs[0])):
        raise ModelError(
            f"{type(curve).__name__}: a curve with one value at each point is needed, this one has several"
        )
    return piecewise(x, xs, xs, _taylor(curve, xs, order), "error")


def knots_of(curve: Any) -> np.ndarray | None:
    """Return the places between which a curve of SciPy is a polynomial (n,); None of anything else."""
    pieces = _pieces_of(curve)
    return None if pieces is None else pieces[0]


def _pieces_of(curve: Any) -> tuple[np.ndarray, int] | None:
    """Knots of a curve of SciPy, and the number of coefficients of each piece."""
    if not callable(curve) or isinstance(curve, ca.SX):
        return None
    if hasattr(curve, "get_knots") and hasattr(curve, "get_coeffs"):  # UnivariateSpline and those like it
        knots = np.asarray(curve.get_knots(), float)
        return knots, len(curve.get_coeffs()) - len(knots) + 2
    if all(hasattr(curve, name) for name in ("t", "c", "k")):  # BSpline
        return np.unique(curve.t[curve.k : len(curve.t) - curve.k]), curve.k + 1
    if all(hasattr(curve, name) for name in ("x", "c", "derivative")):  # PPoly and those like it
        return np.asarray(curve.x, float), len(curve.c)
    return None


def through_samples(x: ca.SX, xs: Any, ys: Any) -> ca.SX:
    """Return a curve of degree five through samples of a motion, at least six: its accelerations are smooth."""
    from scipy.interpolate import make_interp_spline

    xs, ys = sampled(xs, ys, "samples of a motion")
    curve: ca.SX = expression_of(x, make_interp_spline(xs, ys, k=LEAST_SAMPLES - 1))
    return curve


def sampled(xs: Any, ys: Any, what: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the times and values of the samples of a motion (n,), checked."""
    xs, ys = _points(xs, ys, "linear", "error", what)
    if len(xs) < LEAST_SAMPLES:
        raise ModelError(f"{what}: at least {LEAST_SAMPLES} are needed, got {len(xs)}")
    return xs, ys


def numbers_of(values: Any, name: str, what: str, dimensions: int = 1) -> np.ndarray:
    """Return data as an array of finite numbers; raise an error for anything else."""
    form = "a sequence of numbers" if dimensions == 1 else "a table of numbers"
    if isinstance(values, ca.DM):
        values = values.full() if dimensions == 2 else values.full().ravel()
    try:
        # Python's float() of a symbol is NaN and no error.
        if isinstance(values, ca.SX) or any(isinstance(value, ca.SX) for value in values):
            raise TypeError
        result = real_array(values)
    except (TypeError, ValueError, RuntimeError, NotImplementedError):
        raise ModelError(f"{what}: {name} must be {form}, got {values!r}") from None
    if result.ndim != dimensions:
        raise ModelError(f"{what}: {name} must be {form}, got shape {result.shape}")
    if not np.all(np.isfinite(result)):
        k = np.unravel_index(int(np.argmin(np.isfinite(result))), result.shape)
        place = ", ".join(str(i) for i in k)
        raise ModelError(f"{what}: {name} must be finite, got {name}[{place}] = {result[k]}")
    return result


def points_of(values: Any, name: str, kind: str, what: str) -> np.ndarray:
    """Return the places of data (n,), which increase strictly and are enough for a kind."""
    xs = numbers_of(values, name, what)
    if len(xs) < LEAST_POINTS[kind]:
        raise ModelError(f"{what}: kind '{kind}' takes at least {LEAST_POINTS[kind]} points, got {len(xs)} in {name}")
    if np.any(np.diff(xs) <= 0):
        k = int(np.argmax(np.diff(xs) <= 0))
        raise ModelError(
            f"{what}: {name} must increase strictly, got {name}[{k}] = {xs[k]} and {name}[{k + 1}] = {xs[k + 1]}"
        )
    return xs


def _points(xs: Any, ys: Any, kind: str, outside: str, what: str = "spline") -> tuple[np.ndarray, np.ndarray]:
    """Return the points as arrays (n,), checked."""
    xs, ys = points_of(xs, "xs", kind, what), numbers_of(ys, "ys", what)
    if len(xs) != len(ys):
        raise ModelError(f"{what}: xs and ys must have the same length, got {len(xs)} and {len(ys)}")
    if outside == "periodic":
        # Data such as sin(2 pi) close only up to rounding.
        if abs(ys[-1] - ys[0]) > ROUNDING * np.max(np.abs(ys)):
            raise ModelError(
                f"{what}: periodic data must end with the value they start with, "
                f"got ys[0] = {ys[0]} and ys[-1] = {ys[-1]}"
            )
        ys = np.append(ys[:-1], ys[0])
    return xs, ys


def _values(x: Any, xs: np.ndarray, ys: np.ndarray, kind: str, outside: str) -> Any:
    """Return the values at numbers: a float or an array like `x`."""
    try:
        numbers = real_array(x.full() if isinstance(x, ca.DM) else x)
    except (TypeError, ValueError):
        raise ModelError(f"spline: x must be an expression or numbers, got {x!r}") from None
    slack = ROUNDING * (xs[-1] - xs[0])
    if outside == "error" and np.any(bad := (numbers < xs[0] - slack) | (numbers > xs[-1] + slack)):
        raise ModelError(
            f"spline: x = {numbers[bad].flat[0]} is outside the data, {xs[0]} … {xs[-1]}; "
            "give outside='constant', 'linear' or 'periodic' to extend them"
        )
    symbol = ca.SX.sym("x")
    curve = ca.Function("spline", [symbol], [_curve(symbol, xs, ys, kind, outside)])
    if numbers.size == 0:
        return numbers
    result = curve(numbers.reshape(1, -1)).full().reshape(numbers.shape)
    return float(result) if result.ndim == 0 else result


def _curve(x: ca.SX, xs: np.ndarray, ys: np.ndarray, kind: str, outside: str) -> ca.SX:
    """Return the curve as an expression in a scalar."""
    anchors, coefficients = _with_ends(polynomials(xs, ys, kind, outside == "periodic"), outside)
    # met exactly, not up to the rounding of a polynomial's end
    coefficients[0, anchors == xs[-1]] = ys[-1]
    return piecewise(x, xs, anchors, coefficients, outside)


def piecewise(x: ca.SX, xs: np.ndarray, anchors: np.ndarray, coefficients: np.ndarray, outside: str) -> ca.SX:
    """Return the polynomial ``c0 + c1 d + c2 d² + …`` of the piece in which a scalar `x` lies, d from its anchor.

    The pieces lie between the points `xs` (n,). There are anchors (p,) and coefficients (k, p), one from each point on,
    and first and last those outside, if `outside` is "constant" or "linear".
    """
    if outside == "periodic":
        period = xs[-1] - xs[0]
        x = x - period * ca.floor((x - xs[0]) / period)
    # passed[k] is 1 if x has reached piece k; the piece is the last one that is reached. Multiplying
    # by these ones and zeros is exact, and a comparison has the derivative zero, so that the
    # derivatives are those of the polynomial that is picked.
    passed = [x >= start for start in xs[1:]]
    if outside in ("constant", "linear"):
        passed = [x >= xs[0], *passed, x > xs[-1]]
    reached = ca.vertcat(1, *passed)
    picked = reached - ca.vertcat(*passed, 0)
    anchor, *terms = ca.vertsplit(ca.mtimes(ca.DM(np.vstack([anchors, coefficients])), picked))
    if outside == "error":
        # Added to every coefficient, so that the derivatives are NaN too; inside, 0 changes nothing.
        slack = ROUNDING * (xs[-1] - xs[0])
        inside = ca.logic_and(x >= xs[0] - slack, x <= xs[-1] + slack)
        terms = [term + ca.if_else(inside, 0, np.nan) for term in terms]
    d = x - anchor
    *terms, value = terms
    for term in reversed(terms):
        value = term + d * value
    return value


def polynomials(xs: np.ndarray, ys: np.ndarray, kind: str, periodic: bool) -> PPoly:
    """Return curves through points (n, …) as SciPy's piecewise polynomial, one piece from each point but the last."""
    from scipy.interpolate import CubicSpline, PchipInterpolator, PPoly

    if kind == "linear":
        return PPoly(np.stack([(np.diff(ys, axis=0).T / np.diff(xs)).T, ys[:-1]]), xs)
    if kind == "cubic":
        return CubicSpline(xs, ys, bc_type="periodic" if periodic else "not-a-knot")
    if not periodic:
        return PchipInterpolator(xs, ys)
    # the slope at a point follows from its neighbours: one more on either side closes the curve
    around = np.r_[xs[0] - (xs[-1] - xs[-2]), xs, xs[-1] + (xs[1] - xs[0])]
    curve = PchipInterpolator(around, np.concatenate([ys[-2:-1], ys, ys[1:2]]))
    return PPoly(curve.c[:, 1:-1], xs)


def _with_ends(curve: PPoly, outside: str, order: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return anchors (p,) and coefficients (k, p) of the pieces ``c0 + c1 d + c2 d² + …``, d from the anchor.

    There is one for each interval, one that begins at the last point, and one on either side if these differ; for
    a curve that was integrated `order` times the latter have as many terms more.
    """
    anchors = curve.x
    coefficients = np.column_stack([curve.c[::-1], _taylor(curve, anchors[-1:], len(curve.c))])
    if outside in ("constant", "linear"):
        ends = coefficients[:, [0, -1]].copy()
        ends[(2 if outside == "linear" else 1) + order :] = 0
        coefficients = np.column_stack([ends[:, 0], coefficients, ends[:, 1]])
        anchors = np.concatenate([anchors[:1], anchors, anchors[-1:]])
    return anchors, coefficients


def _taylor(curve: Any, places: np.ndarray, count: int) -> np.ndarray:
    """Return the coefficients (count, n) of a SciPy curve in powers of the distance from places (n,)."""
    factorials = np.cumprod(np.r_[1.0, np.arange(1, count)])
    return np.array([curve(places, nu) for nu in range(count)]) / factorials[:, None]
