"""Checks of the numbers, expressions and lists that the user gives."""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..errors import ExpressionError, ModelError, warn
from ..numerics.operations import TRUTHS
from .symbols import Parameter, describe, number, place_of, varying_in


def known_value(value: Any) -> float | None:
    """Return the number behind a constant, a parameter or a plain number; None for other expressions."""
    if isinstance(value, Parameter):
        return value.value
    if isinstance(value, ca.SX):
        return float(value) if value.is_constant() and value.numel() == 1 else None
    return float(value)


@dataclass(frozen=True, eq=False)
class Limit:
    """Range of a quantity of the model, whatever values its parameters have."""

    owner: str
    name: str
    expression: ca.SX
    at_least: float | None = None
    above: float | None = None

    def check(self, value: float, because: str = "") -> None:
        """Raise an error if a value is not finite or out of the limits; `because` gives its origin."""
        low, high = self.at_least, self.above
        if not math.isfinite(value) or (low is not None and value < low) or (high is not None and value <= high):
            raise ModelError(f"{self.objection(value)}{because}")

    def objection(self, value: float) -> str:
        """Return what is wrong with a value that is not finite, or out of the limits."""
        wanted = "finite" if not math.isfinite(value) else f"above {self.above:g}" if self.at_least is None else ""
        return f"{self.owner}: {self.name} must be {wanted or f'at least {self.at_least:g}'}, got {value}"


def quantity(
    value: Any,
    what: str,
    name: str,
    *,
    at_least: float | None = None,
    above: float | None = None,
    fixed: bool = False,
) -> float | ca.SX:
    """Return a scalar quantity: a float if it is a number, else the expression.

    `what` and `name`, the element and the quantity, are for the messages. Its limits are checked here if the number
    behind it is known; those of an expression are added to the list `limits`, which an element keeps as its attribute,
    so that they are checked again for the parameter values of each analysis. A `fixed` quantity, a radius or a ratio,
    may contain parameters only; one that varies raises an :class:`ExpressionError`.
    """
    if isinstance(value, ca.MX):
        raise ModelError(f"{what}: {name} is a casadi.MX; the model is written in casadi.SX")
    if not isinstance(value, ca.SX):
        if isinstance(value, ca.DM | np.ndarray):
            array = value.full() if isinstance(value, ca.DM) else value
            if array.size != 1:
                raise ModelError(f"{what}: {name} must be a scalar, got an array of {array.size} values")
            value = array.reshape(-1)[0]
        if inspect.isfunction(value):
            raise ModelError(
                f"{what}: {name} must be a number or an expression, as mbd.sin(mbd.t), not a Python function"
            )
        value = number(value, what, name)
    elif value.numel() != 1:
        raise ModelError(f"{what}: {name} must be a scalar, got an expression of shape {value.shape}")
    if fixed:
        if varying := varying_in(value):
            raise ExpressionError(
                f"{what}: {name} depends on {describe(varying[0])}; it is a number or an expression in parameters only"
            )
    known = known_value(value)
    if known is None:
        return value
    Limit(what, name, ca.SX(known), at_least, above).check(known)
    return value if isinstance(value, Parameter) else known


class HasQuantities:
    """Base class of objects whose quantities have ranges; :attr:`limits` keeps the ranges of expressions."""

    limits: tuple[Limit, ...] = ()

    @property
    def description(self) -> str:
        """Kind and name, as messages give it."""
        return type(self).__name__

    def read(
        self, value: Any, name: str, *, at_least: float | None = None, above: float | None = None, fixed: bool = False
    ) -> Any:
        """Return a scalar quantity, checked; see :func:`quantity` for the limits that it may have."""
        value = quantity(value, self.description, name, at_least=at_least, above=above, fixed=fixed)
        if isinstance(value, ca.SX):
            self.limits = (*self.limits, Limit(self.description, name, value, at_least, above))
        return value


def in_radians(value: Any, what: str, name: str) -> None:
    """Warn of an angle that looks like one in degrees: beyond a turn, and a multiple of a half."""
    angle = known_value(value)
    if angle is not None and abs(angle) > 2 * math.pi and float(2 * angle).is_integer():
        text = f"{what}: {name} = {angle:g} rad is more than a turn; angles are in radians: np.deg2rad({angle:g})"
        warn(text)


def yes_or_no(value: Any, what: str, name: str) -> bool:
    """Return True or False; refuse a text, a number or an expression."""
    if not isinstance(value, bool | np.bool_):
        raise ModelError(f"{what}: {name} must be True or False, got {value!r}")
    return bool(value)


def one_of(value: Any, choices: Collection[str], what: str, name: str) -> str:
    """Return the choice that a text names; refuse other texts and anything else."""
    if not isinstance(value, str) or value not in choices:
        raise ModelError(f"{what}: {name} must be one of {', '.join(choices)}, got {value!r}")
    return value


def whole(value: Any, what: str, name: str, least: int, most: int | None = None) -> int:
    """Return an integer within limits."""
    number_like = isinstance(value, int | float | np.integer | np.floating) and not isinstance(value, bool)
    if not number_like or not float(value).is_integer() or value < least or (most is not None and value > most):
        limits = f"of at least {least}" if most is None else f"from {least} to {most}"
        raise ModelError(f"{what}: {name} must be a whole number {limits}, got {value!r}")
    return int(value)


def function_of(value: Any, what: str, name: str, *arguments: str) -> Callable[..., Any]:
    """Return a function that the user gave, checked to accept the given arguments."""
    wanted = " and ".join(arguments)
    if not callable(value):
        raise ModelError(f"{what}: {name} must be a function of {wanted}, got {value!r}")
    try:
        signature = inspect.signature(value)
    except (TypeError, ValueError):  # some functions of compiled modules have none
        return value
    try:
        signature.bind(*arguments)
    except TypeError as error:
        raise ModelError(f"{what}: {name} must be a function of {wanted}: {error} in {name}{signature}") from None
    return value


def called(function: Callable[..., Any], what: str, name: str, *arguments: Any) -> Any:
    """Return what a user's function gives for expressions; branches of Python on them are refused."""
    try:
        return function(*arguments)
    except RuntimeError as error:
        if "truth value" not in str(error):
            raise
        raise ModelError(
            f"{what}: {name} compares expressions by if, and, or, max or min of Python, which need numbers; "
            "use mbd.if_else, mbd.logic_and, mbd.logic_or, mbd.fmax or mbd.fmin"
        ) from None


def value_of(function: Callable[..., Any], what: str, name: str, *arguments: Any) -> Any:
    """Return the quantity that a user's function gives for expressions; see :func:`called`."""
    return quantity(called(function, what, name, *arguments), what, name)


def vector2(value: Any, what: str, name: str) -> ca.SX:
    """Return a plane vector (2,) as an expression."""
    if isinstance(value, ca.SX | ca.DM):
        parts = list(ca.vertsplit(ca.vec(ca.SX(value)))) if value.numel() == 2 else []
    else:
        try:
            parts = list(value)
        except TypeError:
            parts = []
    if len(parts) != 2:
        raise ModelError(f"{what}: {name} must have two components, got {value!r}")
    return ca.vertcat(*[ca.SX(quantity(p, what, f"{name} {axis}")) for p, axis in zip(parts, "xy", strict=True)])


def is_relation(value: ca.SX) -> bool:
    """Return True if a scalar is a truth value, 0 or 1, instead of a quantity."""
    return any(value.is_op(op) for op in TRUTHS)


def no_relation(value: Any, what: str, name: str) -> Any:
    """Return a scalar quantity as it is; refuse a relation, whose value is 0 or 1."""
    if isinstance(value, ca.SX) and is_relation(value):
        raise ModelError(f"{what}: {name} is the relation {value}, 0 or 1; give the quantity itself")
    return value


def column(value: Any, what: str) -> ca.SX:
    """Return a scalar, a vector, or a list of scalars as a column of expressions."""
    if isinstance(value, ca.SX | ca.DM):
        return ca.densify(ca.vec(ca.SX(value)))
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
        return ca.vertcat(ca.SX(0, 1), *[column(entry, what) for entry in value])
    if not isinstance(value, int | float | np.number):
        raise ModelError(f"{what} takes an expression in casadi.SX or a list of them, got {value!r}")
    return ca.SX(value)


def number_pairs(values: Any, what: str) -> np.ndarray:
    """Return points of the plane, in finite numbers, as an array (k, 2)."""
    try:
        points = [[number(x, what, "points") for x in point] for point in values]
    except TypeError:
        points = [[]]
    if any(len(point) != 2 for point in points):
        raise ModelError(f"{what}: points must be a list of (x, y), got {values!r}")
    return np.array(points).reshape(-1, 2)


def triple(value: Any, what: str, name: str, form: str) -> np.ndarray:
    """Return three finite numbers as an array (3,)."""
    try:
        if isinstance(value, str | bytes):  # its entries are not numbers
            raise TypeError
        values = [number(v, what, name) for v in value]
    except TypeError:
        raise ModelError(f"{what}: {name} must be three numbers {form}, got {value!r}") from None
    if len(values) != 3:
        raise ModelError(f"{what}: {name} must be three numbers {form}, got {len(values)} of them: {value!r}")
    return np.array(values)


def is_list(values: Any) -> bool:
    """Return True for a list of parts; matrices of CasADi, texts and mappings have entries, but are none."""
    if isinstance(values, ca.SX | ca.MX | ca.DM | str | bytes | Mapping) or not isinstance(values, Iterable):
        return False
    return not isinstance(values, np.ndarray) or values.ndim > 0


def entries(values: Any, argument: str) -> tuple:
    """Return the entries of a list as a tuple; refuse a single part without brackets and other objects."""
    if not is_list(values):
        raise ModelError(f"{argument} takes a list, got {values!r}; write {argument}[…]")
    return tuple(values)


def refuse_twice(symbols: Iterable[Any], what: str) -> None:
    """Raise an error if a symbol occurs in a list twice."""
    seen: list[Any] = []
    for symbol in symbols:
        if place_of(symbol, seen) is not None:
            raise ModelError(f"{what} contains '{symbol.label}' twice")
        seen.append(symbol)


def listed(values: Any, kind: type, what: str) -> tuple:
    """Return the symbols of a list as a tuple; refuse anything of another kind."""
    result = entries(values, what)
    for value in result:
        if not isinstance(value, kind):
            raise ModelError(f"{what} takes {kind.__name__} objects, got {value!r}")
    return result


def listed_by_name(values: Any, kind: type, what: str) -> tuple:
    """Return the parts of a list as :func:`listed` does; refuse a name that occurs twice."""
    parts = listed(values, kind, what)
    names = [part.name for part in parts]
    if len(set(names)) < len(names):
        raise ModelError(f"{what} contains a name twice: {', '.join(names)}")
    return parts


def refuse_unknown(changes: Iterable[str], known: Collection[str]) -> None:
    """Raise an error if ``replace`` is to change an argument that does not exist."""
    unknown = sorted(set(changes) - set(known))
    if unknown:
        raise ModelError(f"replace: unknown argument {', '.join(unknown)}; known are {', '.join(known)}")
