"""Data over two variables as an expression: piecewise products of polynomials in ``casadi.SX``.

On each cell of the grid the table is a Hermite patch, by values and slopes at its four corners. SciPy's splines along
the grid lines give the slopes. The expression picks the corners of the cell in which its arguments lie; these do not
depend on the arguments otherwise, so that derivatives of any order cost no more than those of one patch.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...numerics.real import real_array
from ..quantities import one_of
from ..symbols import Numbers
from .splines import LEAST_POINTS, OUTSIDE, ROUNDING, numbers_of, points_of, polynomials


def table(
    x: Any, y: Any, xs: Numbers, ys: Numbers, values: Any, kind: str = "cubic", outside: str | Sequence[str] = "error"
) -> Any:
    """Return a surface through data on a grid, as an expression in `x` and `y`.

    The surface meets the data exactly; along a grid line it is the :func:`spline` of the data there, except for
    ``"monotone"``. Derivatives that jump at a border of cells are the right-hand ones (at the last one, left-hand).
    The cost of an evaluation is proportional to the number of values.

    Parameters
    ----------
    x, y : casadi.SX, float or array
        Arguments of the same shape, or one of them scalar, such as a speed and a throttle.
    xs, ys : sequence of float, (n,) and (m,)
        The grid; both increase strictly.
    values : sequence of sequence of float, (n, m)
        ``values[i, j]`` belongs to ``xs[i]`` and ``ys[j]``.
    kind : {"cubic", "monotone", "linear"}, default "cubic"
        - ``"cubic"``: C2, the product of splines with not-a-knot ends, which reproduces products of cubics; at least
          4 values in each direction.
        - ``"monotone"``: C1; in each cell it grows, or falls, in x and in y as the data at its borders do, and does not
          overshoot. The patches are bicubic; of all slopes with which the Bézier net of each patch is monotone, those
          nearest to the slopes of monotone splines along the grid lines are taken.
        - ``"linear"``: bilinear in each cell.
    outside : {"error", "constant", "linear", "periodic"} or a pair of these, default "error"
        As in :func:`spline`, for both variables or for `x` and `y`.

    Returns
    -------
    casadi.SX, float or numpy.ndarray
        As `x` and `y`.

    Raises
    ------
    ModelError
        For data that are not finite, not increasing, too few, of another shape or not periodic, for an unknown
        choice, and for a number outside the data if ``outside="error"``.

    References
    ----------
    R. E. Carlson, F. N. Fritsch, SIAM J. Numer. Anal. 22 (1985) 386, doi:10.1137/0722023 (monotone bicubic patches).

    Examples
    --------
    The torque of an engine, from its speed and its throttle::

        torque = mbd.table(shaft.omega, throttle, speeds, [0, 0.5, 1], measured, kind="monotone")

    >>> table(0.5, 0.25, [0, 1], [0, 1], [[0, 0], [0, 8]], kind="linear")
    1.0
    """
    one_of(kind, LEAST_POINTS, "table", "kind")
    pair = outside if isinstance(outside, list | tuple) else (outside, outside)
    if len(pair) != 2:
        raise ModelError(f"table: outside takes one choice, or one for x and one for y, got {outside!r}")
    for one in pair:
        one_of(one, OUTSIDE, "table", "outside")
    axes = [
        (points_of(at, name, kind, "table"), one) for at, name, one in zip((xs, ys), ("xs", "ys"), pair, strict=True)
    ]
    if isinstance(x, ca.MX) or isinstance(y, ca.MX):
        raise ModelError("table: an argument is a casadi.MX; the model is written in casadi.SX")
    corners = _corners(_data(values, axes), axes, kind)
    if not isinstance(x, ca.SX) and not isinstance(y, ca.SX):
        return _values(x, y, axes, corners)
    x, y = _checked(x, "x", axes[0]), _checked(y, "y", axes[1])
    if x.shape != y.shape and not x.is_scalar() and not y.is_scalar():
        raise ModelError(f"table: x and y must have the same shape, got {x.shape} and {y.shape}")
    shape = y.shape if x.is_scalar() else x.shape
    pairs = zip(*[ca.vertsplit(ca.vec(ca.repmat(at, *shape) if at.is_scalar() else at)) for at in (x, y)], strict=True)
    return ca.reshape(ca.vertcat(*[_surface(a, b, axes, corners) for a, b in pairs]), *shape)


# --- data ------------------------------------------------------------------------------------------
#: Places of the data along a variable (n,), and what is outside.
Axis = tuple[np.ndarray, str]


def _data(values: Any, axes: Sequence[Axis]) -> np.ndarray:
    """Return the values (n, m), checked."""
    data = numbers_of(values, "values", "table", 2)
    shape = tuple(len(at) for at, _ in axes)
    if data.shape != shape:
        raise ModelError(
            f"table: values must have one row for each of xs and one column for each of ys, {shape}, got {data.shape}"
        )
    data = data.copy()
    for name, (_, outside), lines in zip(("first row", "first column"), axes, (data, data.T), strict=True):
        if outside == "periodic":
            if np.max(np.abs(lines[-1] - lines[0])) > ROUNDING * np.max(np.abs(lines)):
                raise ModelError(f"table: periodic data must end with the values they start with, those of the {name}")
            lines[-1] = lines[0]
    return data


def _corners(data: np.ndarray, axes: Sequence[Axis], kind: str) -> list[list[np.ndarray]]:
    """Return values and slopes at the grid, the order of the derivative in x and in y first."""
    if kind == "linear":
        return [[data]]

    def slopes(of: np.ndarray, axis: int) -> np.ndarray:
        at, outside = axes[axis]
        curves = polynomials(at, np.moveaxis(of, axis, 0), kind, outside == "periodic")
        return np.moveaxis(curves(at, 1), 0, axis)

    in_x, in_y = slopes(data, 0), slopes(data, 1)
    twist = (slopes(in_x, 1) + slopes(in_y, 0)) / 2
    corners = [[data, in_y], [in_x, twist]]
    return corners if kind == "cubic" else _monotone(corners, axes)


def _monotone(corners: list[list[np.ndarray]], axes: Sequence[Axis]) -> list[list[np.ndarray]]:
    """Return corners whose slopes are as near as possible to those given so that each patch is monotone.

    The control points of all patches are ``B_x F B_y^T`` with the values and slopes F at the grid. Their differences
    along x may not have another sign than those of the data on the grid line beside them (of the other line of the
    cell, if these are zero); along y likewise. Slopes are compared in control points.
    """
    from scipy.sparse import csc_array, kron, vstack

    data = corners[0][0]
    size = max(np.max(np.abs(np.diff(data, axis=axis))) for axis in (0, 1))
    if size == 0:
        return corners
    # unknown are the slopes, in control points relative to the size; those at a seam are the same
    number = np.arange(4 * data.size).reshape(2 * len(data), -1)
    for lines, (at, outside) in zip((number, number.T), axes, strict=True):
        if outside == "periodic":
            lines[len(at) - 1], lines[-1] = lines[0], lines[len(at)]
    inner = np.ones(number.shape, bool)
    inner[: len(data), : data.shape[1]] = False
    unknown, place = np.unique(number[inner], return_inverse=True)
    widths = [np.concatenate([np.ones(len(at)), np.gradient(at)]) for at, _ in axes]
    scale = (size / np.outer(*widths)).ravel()[number.ravel()]
    wanted = np.block(corners).ravel() / scale

    nets = [_bezier(at) for at, _ in axes]
    steps = [np.diff(net, axis=0) for net in nets]
    rows = csc_array(vstack([kron(steps[0], nets[1]), kron(nets[0], steps[1])]))
    rows = csc_array(rows * (scale / size))
    given = rows[:, ~inner.ravel()] @ wanted[~inner.ravel()]
    merged = csc_array((np.ones(place.size), (np.arange(place.size), place)))
    rows = csc_array(rows[:, inner.ravel()] @ merged)
    rows.sort_indices()
    senses = np.concatenate([_senses(data).ravel(), _senses(data.T).T.ravel()])
    found = _nearest(wanted[unknown], ca.DM(rows), given, senses)
    slopes = np.zeros(number.shape)
    slopes[inner] = found[place] * scale[inner.ravel()]
    (_, in_y), (in_x, twist) = (np.split(half, 2, axis=1) for half in np.split(slopes, 2, axis=0))
    return [[data, in_y], [in_x, twist]]


def _bezier(at: np.ndarray) -> np.ndarray:
    """Return the matrix (3n-2, 2n) from values and slopes at places to the control points of the cubics between."""
    n, k, third = len(at), np.arange(len(at) - 1), np.diff(at) / 3
    net = np.zeros((3 * n - 2, 2 * n))
    net[3 * np.arange(n), np.arange(n)] = 1
    net[3 * k + 1, k], net[3 * k + 1, n + k] = 1, third
    net[3 * k + 2, k + 1], net[3 * k + 2, n + k + 1] = 1, -third
    return net


def _senses(data: np.ndarray) -> np.ndarray:
    """Return the sense of growth down each line of control points (3n-3, 3m-2).

    It is that of the data on the grid line beside it; if these are equal, that on the other side of its cell.
    """
    own = np.sign(np.diff(data, axis=0))
    left, right = own[:, :-1], own[:, 1:]
    inside = [left, np.where(left == 0, right, left), np.where(right == 0, left, right)]
    lines = np.column_stack([np.stack(inside, axis=2).reshape(len(own), -1), own[:, -1]])
    return np.repeat(lines, 3, axis=0)


def _nearest(wanted: np.ndarray, rows: ca.DM, given: np.ndarray, senses: np.ndarray) -> np.ndarray:
    """Return the unknowns nearest to those wanted with which ``rows @ unknowns + given`` has given senses, or is 0."""
    programme = {"h": ca.DM.eye(wanted.size).sparsity(), "a": rows.sparsity()}
    exact = {"verbose": False, "eps_abs": ROUNDING, "eps_rel": ROUNDING, "max_iter": 1_000_000}
    solver = ca.conic("nearest", "osqp", programme, {"osqp": exact})
    lower, upper = np.where(senses >= 0, -given, -np.inf), np.where(senses <= 0, -given, np.inf)
    return solver(h=1, g=-wanted, a=rows, lba=lower, uba=upper)["x"].full().ravel()


# --- evaluation ------------------------------------------------------------------------------------
def _values(x: Any, y: Any, axes: Sequence[Axis], corners: list[list[np.ndarray]]) -> Any:
    """Return the values at numbers: a float or an array as `x` and `y`."""
    given = [_numbers(value, name, axis) for value, name, axis in zip((x, y), "xy", axes, strict=True)]
    try:
        numbers = np.broadcast_arrays(*given)
    except ValueError:
        raise ModelError(f"table: x and y must be expressions or numbers of one shape, got {x!r} and {y!r}") from None
    symbols = ca.SX.sym("x"), ca.SX.sym("y")
    surface = ca.Function("table", symbols, [_surface(*symbols, axes, corners)])
    if numbers[0].size == 0:
        return numbers[0].copy()
    result = surface(*[given.reshape(1, -1) for given in numbers]).full().reshape(numbers[0].shape)
    return float(result) if result.ndim == 0 else result


def _numbers(value: Any, name: str, axis: Axis) -> np.ndarray:
    """Return an argument that is no expression, within the data unless these are extended."""
    at, outside = axis
    try:
        if value is None:  # NumPy takes it for NaN
            raise TypeError
        given = real_array(value.full() if isinstance(value, ca.DM) else value)
    except (TypeError, ValueError, RuntimeError, NotImplementedError):
        raise ModelError(
            f"table: x and y must be expressions or numbers of one shape, got {name} = {value!r}"
        ) from None
    slack = ROUNDING * (at[-1] - at[0])
    if outside == "error" and np.any(bad := ~((given >= at[0] - slack) & (given <= at[-1] + slack))):
        raise ModelError(
            f"table: {name} = {given[bad].flat[0]} is outside the data, {at[0]} … {at[-1]}; "
            "give outside='constant', 'linear' or 'periodic' to extend them"
        )
    return given


def _checked(value: Any, name: str, axis: Axis) -> ca.SX:
    """Return an argument of a surface that is an expression; numbers in it are checked."""
    column = ca.densify(ca.SX(value if isinstance(value, ca.SX) else ca.DM(_numbers(value, name, axis))))
    for entry in ca.vertsplit(ca.vec(column)):
        if entry.is_constant():
            _numbers(float(entry), name, axis)
    return column


def _surface(x: ca.SX, y: ca.SX, axes: Sequence[Axis], corners: list[list[np.ndarray]]) -> ca.SX:
    """Return the surface as an expression in two scalars."""
    (in_x, weights_x), (in_y, weights_y) = (
        _weights(argument, *axis, smooth=len(corners) > 1) for argument, axis in zip((x, y), axes, strict=True)
    )
    value = ca.SX(0)
    for k, across in enumerate(zip(*corners, strict=True)):  # of one order in y, by order in x
        for corner, ends in zip(across, weights_x, strict=True):
            low, high = (ca.mtimes(in_x.T, ca.DM(part)) for part in (corner[:-1], corner[1:]))
            for line, weight in ((low, ends[0]), (high, ends[1])):
                left, right = ca.mtimes(line[:-1], in_y), ca.mtimes(line[1:], in_y)
                value += weight * (left * weights_y[k][0] + right * weights_y[k][1])
    return value


def _weights(x: ca.SX, at: np.ndarray, outside: str, smooth: bool) -> tuple[ca.SX, list[tuple[ca.SX, ca.SX]]]:
    """Return the piece in which an argument lies, as ones and zeros (n-1,), and the weights of what is at its ends.

    These are those of values, and of slopes if it is smooth.
    """
    if outside == "periodic":
        period = at[-1] - at[0]
        x = x - period * ca.floor((x - at[0]) / period)
    # a comparison has the derivative zero, so that derivatives are those of the piece that is picked
    within = ca.if_else(x < at[0], at[0], ca.if_else(x > at[-1], at[-1], x)) if outside in ("constant", "linear") else x
    passed = [within >= start for start in at[1:-1]]
    piece = ca.vertcat(1, *passed) - ca.vertcat(*passed, 0)
    width = ca.dot(piece, ca.DM(np.diff(at)))
    s = (within - ca.dot(piece, ca.DM(at[:-1]))) / width
    if outside == "error":
        slack = ROUNDING * (at[-1] - at[0])
        inside = ca.logic_and(x >= at[0] - slack, x <= at[-1] + slack)
        s *= ca.if_else(inside, 1, np.nan)  # a factor, so that the derivatives are NaN too
    weights, rates = [(1 - s, s)], [(-1, 1)]
    if smooth:
        weights = [((1 + 2 * s) * (1 - s) ** 2, s**2 * (3 - 2 * s)), (width * s * (1 - s) ** 2, width * s**2 * (s - 1))]
        rates = [(-6 * s * (1 - s), 6 * s * (1 - s)), (width * (1 - s) * (1 - 3 * s), width * s * (3 * s - 2))]
    if outside == "linear":
        beyond = (x - within) / width
        weights = [
            tuple(weight + beyond * rate for weight, rate in zip(*pair, strict=True))
            for pair in zip(weights, rates, strict=True)
        ]
    return piece, weights
