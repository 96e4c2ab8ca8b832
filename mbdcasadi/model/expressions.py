"""Functions of expressions and numbers.

The functions of Python's ``math`` return NaN for symbols, NumPy's give a notice
of CasADi, which begins with the remedy here, and some of CasADi's have no derivative at a point that a mechanism
passes through (the norm of a force that vanishes, the power of a penetration at
first touch). The functions here
accept ``casadi.SX`` and numbers; :func:`norm`, :func:`distance`,
:func:`positive_power` and :func:`step` have finite first and second
derivatives as documented.

The elementary functions are CasADi's own. Their derivatives are infinite
at singular points (``sqrt`` at zero, ``asin`` at one), and one half at the
corner of ``fmax`` and ``fmin``.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from casadi import (
    acos,
    asin,
    atan,
    atan2,
    cos,
    cosh,
    exp,
    fabs,
    floor,
    fmax,
    fmin,
    fmod,
    log,
    logic_and,
    logic_not,
    logic_or,
    sign,
    sin,
    sinh,
    sqrt,
    sumsqr,
    tan,
    tanh,
    vertcat,
)

from ..errors import ModelError
from ..numerics.real import real_array
from .geometry.splines import spline
from .geometry.tables import table
from .symbols import Scalar

__all__ = [
    "acos",
    "asin",
    "atan",
    "atan2",
    "cos",
    "cosh",
    "distance",
    "dot",
    "exp",
    "fabs",
    "floor",
    "fmax",
    "fmin",
    "fmod",
    "if_else",
    "log",
    "logic_and",
    "logic_not",
    "logic_or",
    "norm",
    "positive_power",
    "sign",
    "sin",
    "sinh",
    "spline",
    "sqrt",
    "step",
    "sumsqr",
    "table",
    "tan",
    "tanh",
    "vertcat",
]

# CasADi gives its notice for every expression, the sums and products of symbols included, for which a class of our own
# would not be asked. It recommends a mode that returns expressions of another type.
_NOTICE = getattr(ca.casadi, "_NUMPY_LEGACY_NOTICE", "")
_REMEDY = (
    "in expressions of mbdcasadi write mbd.sin for np.sin, mbd.norm for np.linalg.norm, mbd.if_else for np.where, "
    "mbd.spline for np.interp; what follows is the notice of CasADi, whose setNumpyMode(1) does not help here"
)
if _NOTICE and not _NOTICE.startswith(_REMEDY):
    ca.casadi._NUMPY_LEGACY_NOTICE = f"{_REMEDY}\n{_NOTICE}"


def _plain(value: Any) -> Any:
    """Return a float for a numeric scalar, anything else as it is."""
    return float(value) if isinstance(value, ca.DM) and value.numel() == 1 else value


def _constant(value: Any) -> float | None:
    """Return the value of a constant scalar; None for an expression."""
    if isinstance(value, ca.SX) and not (value.is_scalar() and value.is_constant()):
        return None
    try:
        return float(value)
    except (TypeError, ValueError, RuntimeError, NotImplementedError):
        return None


def _operand(value: Any, where: str, name: str) -> Any:
    """Return an operand of a function as it is: numbers that are finite, or expressions; refuse anything else."""
    if isinstance(value, ca.SX | ca.MX | ca.DM):
        return value
    try:
        finite = np.all(np.isfinite(real_array(value))) and not isinstance(value, str | bytes | bool)
    except (TypeError, ValueError):
        finite = False
    if not finite:
        raise ModelError(f"{where}: {name} must be an expression or a finite number, got {value!r}")
    return value if isinstance(value, np.ndarray) else _plain(ca.DM(real_array(value)))


def _column(value: Any, where: str) -> ca.SX | ca.DM:
    """Return the components of a vector, or of the position of a marker or body, as a column."""
    value = getattr(value, "position", value)
    if isinstance(value, ca.MX):
        raise ModelError(f"{where}: got a casadi.MX; the model is written in casadi.SX")
    try:
        if not isinstance(value, ca.SX | ca.DM):
            # An array of objects contains symbols: only its entries can be concatenated.
            value = ca.vertcat(*np.ravel(np.asarray(value, dtype=object)))
        return ca.densify(ca.vec(value))
    except (TypeError, ValueError, NotImplementedError):
        raise ModelError(f"{where}: takes a vector, a marker or a body, got {value!r}") from None


def if_else(condition: Any, a: Scalar, b: Scalar) -> Any:
    """Return `a` if the condition holds, else `b`.

    Both branches are evaluated. The value of the branch that is not taken does not affect
    the result, but a derivative of it that is not finite may: make its argument
    harmless then, as :func:`positive_power` does.

    Parameters
    ----------
    condition : relation
        As ``x > 0``; Python's own ``if`` and ``and`` do not work on symbols.
    a, b : float or casadi.SX
        The two branches.

    Returns
    -------
    float or casadi.SX

    Examples
    --------
    >>> x = ca.SX.sym("x")
    >>> pull = if_else(x > 0, 200 * x, 0)
    """
    try:
        return _plain(ca.if_else(condition, a, b))
    except NotImplementedError:  # CasADi's word for arguments of other types
        raise ModelError(
            f"if_else takes a relation and two numbers or expressions, got {condition!r}, {a!r} and {b!r}"
        ) from None


def positive_power(base: Scalar, exponent: Scalar) -> Any:
    """Return ``base**exponent`` for ``base > 0``, else 0.

    The force of a contact, ``k δ^n``, as a function of the penetration.
    ``fmax(δ, 0)**n`` would have the second derivative NaN without contact.

    Parameters
    ----------
    base : float or casadi.SX
        Penetration. The first and second derivatives are finite everywhere, and zero for ``base <= 0``.
    exponent : float or casadi.SX
        Above 0.

    Returns
    -------
    float or casadi.SX

    Raises
    ------
    ModelError
        For an exponent that is a number and not above 0.
    """
    known = _constant(exponent)
    if known is not None and not known > 0:
        raise ModelError(f"positive_power: the exponent must be above 0, got {known}")
    base, exponent = _operand(base, "positive_power", "base"), _operand(exponent, "positive_power", "exponent")
    on = base > 0
    return if_else(on, if_else(on, base, 1) ** exponent, 0)


def norm(vector: Any) -> Any:
    """Return the Euclidean length of a vector, with finite first and second derivatives at zero.

    The gradient at zero is 0 (that of ``casadi.norm_2`` is NaN), so that ``norm(force) <= 40``
    can be a condition in optimal control even if the force vanishes. ``norm(vector) == 0`` is
    read as a condition for each component.

    Parameters
    ----------
    vector : casadi.SX, sequence of float or casadi.SX, Marker or Body
        Any number of components; of a marker or body, its position.

    Returns
    -------
    float or casadi.SX
        Scalar, in the unit of the components.
    """
    square = ca.sumsqr(_column(vector, "norm"))
    # 1 at zero only: it moves the root to sqrt(1), whose derivatives are finite.
    zero = square == 0
    return _plain(ca.sqrt(square + zero) - zero)


def _pair(a: Any, b: Any, where: str) -> tuple[Any, Any]:
    first, second = _column(a, where), _column(b, where)
    if first.numel() != second.numel():
        raise ModelError(
            f"{where}: both vectors must have the same size, got {first.numel()} and {second.numel()} components"
        )
    return first, second


def dot(a: Any, b: Any) -> Any:
    """Return the scalar product of two vectors.

    Parameters
    ----------
    a, b : casadi.SX, sequence of float or casadi.SX, Marker or Body
        Of the same size; of a marker or body, its position.

    Returns
    -------
    float or casadi.SX

    Raises
    ------
    ModelError
        For vectors of different size.
    """
    return _plain(ca.dot(*_pair(a, b, "dot")))


def distance(a: Any, b: Any) -> Any:
    """Return the distance of two points, with finite first and second derivatives even if they coincide.

    ``distance(a, b) == 0`` is read as a condition for each component.

    Parameters
    ----------
    a, b : Marker, Body, casadi.SX or sequence of float or casadi.SX
        Points; of a marker or body, its position, m.

    Returns
    -------
    float or casadi.SX
        m.

    Raises
    ------
    ModelError
        For points of different size.
    """
    first, second = _pair(a, b, "distance")
    return norm(second - first)


def step(x: Scalar, x0: Scalar, y0: Scalar, x1: Scalar, y1: Scalar) -> Any:
    """Return a smooth step from `y0` at `x0` to `y1` at `x1`, constant outside.

    ``y0 + (y1 - y0) (10 s³ - 15 s⁴ + 6 s⁵)`` with ``s = (x - x0)/(x1 - x0)``: value,
    first and second derivative are continuous.

    Parameters
    ----------
    x : float or casadi.SX
        Argument, usually time, s.
    x0, x1 : float or casadi.SX
        Start and end of the step, ``x0 < x1``.
    y0, y1 : float or casadi.SX
        Values before and after.

    Returns
    -------
    float or casadi.SX

    Raises
    ------
    ModelError
        If `x0` and `x1` are numbers and `x1` is not above `x0`.

    Examples
    --------
    >>> step(0.5, 0, 0, 1, 10)
    5.0
    """
    start, end = _constant(x0), _constant(x1)
    if start is not None and end is not None and not end > start:
        raise ModelError(f"step: x1 must be above x0, got x0 = {start} and x1 = {end}")
    given = {"x": x, "x0": x0, "y0": y0, "x1": x1, "y1": y1}
    x, x0, y0, x1, y1 = (_operand(value, "step", name) for name, value in given.items())
    s = (x - x0) / (x1 - x0)
    s = if_else(s > 0, if_else(s < 1, s, 1), 0)
    return _plain(y0 + (y1 - y0) * s**3 * (10 + s * (6 * s - 15)))
