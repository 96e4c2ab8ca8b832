"""Symbols of a model: time, inputs, parameters, first-order states, and the role of each symbol.

A CasADi symbol has a name and nothing else. The registry in this module keeps,
as long as the owner of a symbol lives, its meaning (its *role*) and its rate of
change, for :func:`time_derivative` and for messages in terms of the model.
"""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, TypeAlias

import casadi as ca
import numpy as np

from ..errors import ExpressionError, ModelError, warn
from .immutable import HoldsSymbols

#: Kinds of symbols.
KINDS = (
    "time",
    "position",
    "velocity",
    "acceleration",
    "multiplier",
    "impulse",
    "input",
    "input rate",
    "parameter",
    "state",
)


@dataclass(frozen=True, eq=False)
class Role:
    """Meaning of a symbol."""

    #: one of :data:`KINDS`
    kind: str
    #: name to print
    label: str
    #: body, element or symbol that it belongs to
    owner: Any
    #: its rate of change, if that is a symbol or a number
    rate: Any = None
    #: its unit; empty if it is not known
    unit: str = ""
    #: its value at the estimated poses and t = 0, of coordinates and time
    estimate: float | None = None


_ROLES: weakref.WeakValueDictionary[int, Role] = weakref.WeakValueDictionary()


def register(
    symbol: ca.SX,
    kind: str,
    label: str,
    owner: Any = None,
    rate: Any = None,
    unit: str = "",
    estimate: float | None = None,
) -> Role:
    """Register the role of a symbol; it lasts as long as the caller keeps the :class:`Role`."""
    role = Role(kind, label, owner, rate, unit, estimate)
    _ROLES[symbol.element_hash()] = role
    return role


def role_of(symbol: ca.SX) -> Role | None:
    """Return the role of a scalar symbol, or None for a symbol that belongs to no model."""
    return _ROLES.get(symbol.element_hash())


def check_name(name: Any, what: str) -> str:
    """Return the name; raise an error if it is not a non-empty text."""
    if not isinstance(name, str) or not name.strip():
        raise ModelError(f"{what}: the name must be a text that is not empty, got {name!r}")
    return name


def number(value: Any, what: str, quantity: str, *, infinite: bool = False) -> float:
    """Return a finite float, or raise an error that names the owner, the quantity and the value."""
    if type(value) is float and math.isfinite(value):
        return value
    if hasattr(value, "__SX__") and not isinstance(value, ca.SX):
        # CasADi's type that behaves as an array: NumPy's functions return it after GlobalOptions.setNumpyMode(1)
        raise ModelError(f"{what}: {quantity} is {value!r}, which NumPy made of an expression; use mbd.sin, … instead")
    try:
        # float() would read "1.0" and True, and make nan of a symbol
        if isinstance(value, str | bytes | bool | np.bool_) or (isinstance(value, ca.SX) and not value.is_constant()):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, RuntimeError, NotImplementedError):
        raise ModelError(f"{what}: {quantity} must be a number, got {value!r}") from None
    if math.isnan(result):
        raise ModelError(
            f"{what}: {quantity} must be finite, got nan (if it comes from math.sin or float of an expression, "
            "use mbd.sin, …)"
        )
    if math.isinf(result) and not infinite:
        raise ModelError(f"{what}: {quantity} must be finite, got {result}")
    return result


def positive(value: Any, what: str, quantity: str) -> float:
    """Return a finite float above zero, or raise an error that names the owner, the quantity and the value."""
    result = number(value, what, quantity)
    if result <= 0:
        raise ModelError(f"{what}: {quantity} must be positive, got {result:g}")
    return result


#: Attributes of symbols that stay what they were made with: models and what is compiled for them are found by these.
SEALED = frozenset({"label", "value", "lower", "upper", "unit"})


#: What arguments take: one number or expression; a vector of them; several numbers; what results are asked for.
Scalar: TypeAlias = "ca.SX | float | np.floating[Any] | np.integer[Any]"
Vector: TypeAlias = "ca.SX | np.ndarray | Sequence[Scalar]"
Numbers: TypeAlias = "np.ndarray | Sequence[float]"
Expression: TypeAlias = "ca.SX | Sequence[Scalar]"


class Symbol(ca.SX, HoldsSymbols):
    """A named scalar of the model: a ``casadi.SX`` with a label, a value and limits."""

    label: str
    value: float
    lower: float = -math.inf
    upper: float = math.inf
    _kind = ""

    def __init__(self, label: str):
        check_name(label, type(self).__name__)
        super().__init__(ca.SX.sym(label))
        self.label = label
        self._role = register(self, self._kind, label, owner=None)

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__ and name in SEALED:
            raise AttributeError(
                f"{self!r} does not change after construction; instead of setting {name}, give analyses other values "
                "in inputs= or parameters=, or make a new symbol"
            )
        super().__setattr__(name, value)

    def __copy__(self) -> Symbol:
        return self

    def __deepcopy__(self, memo: dict) -> Symbol:
        return self

    def __hash__(self) -> int:
        return self.element_hash()

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.label!r})"

    def _take(self, what: str, value: Any, lower: Any, upper: Any, *, may_be_zero: bool = True) -> None:
        """Check the limits and the value, which is within them or may be zero, and keep them."""
        self.value = number(value, what, "value")
        self.lower, self.upper = (number(x, what, n, infinite=True) for x, n in ((lower, "lower"), (upper, "upper")))
        if self.lower > self.upper:
            raise ModelError(f"{what}: lower = {self.lower} is above upper = {self.upper}")
        if (self.value or not may_be_zero) and not self.lower <= self.value <= self.upper:
            hint = "; the arguments are label, value, lower, upper: limits alone are given by name, as lower=, upper="
            raise ModelError(f"{what}: value = {self.value} is not within {self.lower} … {self.upper}{hint}")

    @property
    def typical_size(self) -> float:
        """Size of the value, or of the limits if it is zero; zero if that is not known."""
        return abs(self.value) or max((abs(x) for x in (self.lower, self.upper) if math.isfinite(x)), default=0.0)


class Input(Symbol):
    """A control: a force, torque, voltage or any other quantity given from outside.

    Parameters
    ----------
    label : str
        Its name.
    value : float, default 0
        Value in analyses that are given no other one; within the limits, or zero.
    lower, upper : float, default -inf and inf
        Limits: enforced in optimal control; ``simulate`` warns if they are exceeded.
    unit : str, optional
        Unit, for the axes of plots: ``"N m"``.

    Attributes
    ----------
    quantity : str
        Label with the unit, as plots show it.
    rate : casadi.SX
        Its rate of change, for costs and path conditions of optimal control only.

    Examples
    --------
    >>> tau = Input("tau", lower=-50, upper=50)
    >>> tau.label, tau.upper
    ('tau', 50.0)
    """

    _kind = "input"
    #: False for one in place of a part of a cost, which occurs in no force
    acts: ClassVar[bool] = True

    def __init__(
        self,
        label: str,
        value: float = 0.0,
        lower: float = -math.inf,
        upper: float = math.inf,
        unit: str | None = None,
    ):
        """Make the symbol; see the class for its arguments."""
        super().__init__(label)
        if unit is not None:
            check_name(unit, f"input '{label}': unit")
        self.unit = unit
        self.rate = ca.SX.sym(f"{label}.rate")
        per_second = "" if unit is None else f"{unit}/s"
        self._rate_role = register(self.rate, "input rate", f"{label}.rate", owner=self, unit=per_second)
        self._role = register(self, "input", label, rate=self.rate, unit=unit or "")
        self._take(f"input '{label}'", value, lower, upper)

    @property
    def quantity(self) -> str:
        """Label with the unit, as plots show it."""
        return self.label if self.unit is None else f"{self.label}, {self.unit}"


class Parameter(Symbol):
    """A constant of the model that can be changed without deriving the equations again.

    Parameters
    ----------
    label : str
        Its name.
    value : float
        Value in analyses that are given no other one; within the limits.
    lower, upper : float, default -inf and inf
        Limits for identification and optimisation.
    """

    _kind = "parameter"

    def __init__(self, label: str, value: float, lower: float = -math.inf, upper: float = math.inf):
        """Make the symbol; see the class for its arguments."""
        super().__init__(label)
        self._take(f"parameter '{label}'", value, lower, upper, may_be_zero=False)
        _PARAMETERS[self.element_hash()] = self


#: Parameters by the hash of their node, as long as they live: from an expression back to the values behind it.
_PARAMETERS: weakref.WeakValueDictionary[int, Parameter] = weakref.WeakValueDictionary()


class StateVariable(Symbol):
    """A first-order state ``z``; its rate is given in ``Mechanism(states={z: rate})``.

    Parameters
    ----------
    label : str
        Its name.
    value : float, default 0
        Value at the start, if no condition gives another one; within the limits, or zero.
    lower, upper : float, default -inf and inf
        Limits for optimal control.
    initial : float, optional
        Former name of `value`.
    """

    _kind = "state"

    def __init__(
        self,
        label: str,
        value: float = 0.0,
        lower: float = -math.inf,
        upper: float = math.inf,
        initial: float | None = None,
    ):
        """Make the symbol; see the class for its arguments."""
        super().__init__(label)
        what = f"state variable '{label}'"
        if initial is not None:
            warn(f"{what}: initial= is called value= now", DeprecationWarning)
            value = initial
        self._take(what, value, lower, upper)

    @property
    def initial(self) -> float:
        """Former name of ``value``."""
        warn(f"state variable '{self.label}': initial is called value now", DeprecationWarning)
        return self.value


def state_of(owner: Any, label: str, value: Any = 0.0) -> StateVariable:
    """Return the state of an element: the one that is given as `value`, or a new one that belongs to the element."""
    if isinstance(value, StateVariable):
        return value
    state = StateVariable(label, value)
    state._role = register(state, "state", label, owner)
    return state


class Coordinate(Symbol):
    """A position-level coordinate without inertia, held by constraints (a contact parameter of a cam).

    Parameters
    ----------
    label : str
        Its name.
    value : float, default 0
        Estimate of the value at the start.
    span : (float, float), optional
        First and last value that it takes as a rule: by how much a change of it moves points is measured between them,
        and not at the start alone, where it may be little.

    Attributes
    ----------
    velocity, acceleration : casadi.SX
        Its rates.
    """

    _kind = "position"

    def __init__(self, label: str, value: float = 0.0, span: tuple[float, float] | None = None):
        """Make the symbol; see the class for its arguments."""
        super().__init__(label)
        what = f"coordinate '{label}'"
        self.value = number(value, what, "value")
        ends = (self.value, self.value) if span is None else span
        if not isinstance(ends, list | tuple | np.ndarray) or len(ends) != 2:
            raise ModelError(f"{what}: span takes its first and last value, (lower, upper), got {span!r}")
        self.span = tuple(number(end, what, "span") for end in ends)
        self.velocity = ca.SX.sym(f"{label}.velocity")
        self.acceleration = ca.SX.sym(f"{label}.acceleration")
        self._role = register(self, "position", label, rate=self.velocity, estimate=self.value)
        self._rates = (
            register(self.velocity, "velocity", f"{label}.velocity", rate=self.acceleration),
            register(self.acceleration, "acceleration", f"{label}.acceleration"),
        )


#: Time, s.
t = ca.SX.sym("t")
_TIME_ROLE = register(t, "time", "t", rate=ca.SX(1), unit="s", estimate=0.0)


def as_expression(value: Any, what: str) -> ca.SX:
    """Return an expression, of a list of them a column; raise an error if CasADi cannot make one."""
    try:
        return ca.SX(value)
    except (NotImplementedError, TypeError, RuntimeError):
        if isinstance(value, list | tuple):
            return ca.vertcat(*[as_expression(part, what) for part in value])
        known = [name for name in ("position", "angle", "displacement", "force") if hasattr(value, name)]
        instead = f"; take one of its quantities, such as .{known[0]}" if known else ""
        raise ExpressionError(f"{what}: expected a casadi.SX expression or numbers, got {value!r}{instead}") from None


def as_sx(value: Any) -> ca.SX:
    """Return a number as an expression, and an expression as it is: copies by ``casadi.SX`` take 50 µs each."""
    return value if isinstance(value, ca.SX) else ca.SX(value)


def place_of(symbol: Any, symbols: Sequence[Any]) -> int | None:
    """Return the place of a symbol in a list, or None; by identity, since ``==`` makes a relation of symbols."""
    return next((k for k, other in enumerate(symbols) if other is symbol), None)


def symbols_of(expression: Any) -> list[ca.SX]:
    """Return the scalar symbols on which an expression depends, in the order in which they occur."""
    expression = as_sx(expression)
    if expression.is_constant():  # most are numbers or symbols, of which CasADi makes a list in 20 µs
        return []
    return [expression] if expression.is_scalar() and expression.is_symbolic() else ca.symvar(expression)


def values_of(expression: Any) -> np.ndarray:
    """Return the value of an expression (same shape) with the parameters' own values.

    An :class:`ExpressionError` is raised if it depends on anything but parameters.
    """
    expression = ca.SX(expression)
    used = symbols_of(expression)
    parameters = [_PARAMETERS.get(symbol.element_hash()) for symbol in used]
    for symbol, parameter in zip(used, parameters, strict=True):
        if parameter is None:
            raise ExpressionError(f"a number is needed here, and {describe(symbol)} has none; use parameters only")
    at = ca.DM([p.value for p in parameters if p is not None])
    return ca.Function("value", [ca.vertcat(ca.SX(0, 1), *used)], [ca.densify(expression)])(at).full()


def varying_in(expression: Any, besides: ca.SX | None = None) -> list[ca.SX]:
    """Return the symbols of an expression that are not parameters, except `besides`."""
    roles = [(symbol, role_of(symbol)) for symbol in symbols_of(expression)]
    varying = [symbol for symbol, role in roles if role is None or role.kind != "parameter"]
    return [symbol for symbol in varying if besides is None or not ca.is_equal(symbol, besides)]


def describe(symbol: ca.SX) -> str:
    """Return kind and name of a symbol, for messages."""
    role = role_of(symbol)
    return f"{role.kind} '{role.label}'" if role else f"symbol '{symbol.name()}'"
