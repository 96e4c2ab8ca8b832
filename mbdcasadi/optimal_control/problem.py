"""An optimal-control problem: what the motion must do, and what is to be least."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ..equations import Equations, equations
from ..errors import ExpressionError, ModelError
from ..model.conditions import Condition, read_conditions
from ..model.immutable import Immutable
from ..model.mechanism import Mechanism
from ..model.quantities import quantity
from ..model.symbols import Parameter, describe, listed, number, register, role_of, symbols_of
from ..results.state import State


class Placeholder(ca.SX):
    """A symbol for an expression at the start, at the end, or integrated over the motion.

    Made by :func:`at_start`, :func:`at_end` and :func:`integral`.
    """

    def __init__(self, kind: str, expression: Any):
        self.kind = kind
        self.expression = ca.SX(quantity(expression, kind, "expression"))
        self.label = f"{kind}({self.expression})"
        super().__init__(ca.SX.sym(self.label))
        self._role = register(self, "placeholder", self.label, owner=self)

    def __hash__(self) -> int:
        return self.element_hash()


#: Placeholders live as long as the expressions in which they may stand, which CasADi does not tell.
_PLACEHOLDERS: dict[int, Placeholder] = {}


def _placeholder(kind: str, expression: Any) -> ca.SX:
    made = Placeholder(kind, expression)
    _PLACEHOLDERS[made.element_hash()] = made
    return made


def integral(expression: Any) -> ca.SX:
    """Stand for the integral of an expression over the motion, in costs and boundary conditions."""
    return _placeholder("integral", expression)


def at_start(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the start of the motion."""
    return _placeholder("at_start", expression)


def at_end(expression: Any) -> ca.SX:
    """Stand for the value of an expression at the end of the motion."""
    return _placeholder("at_end", expression)


def placeholders_in(expression: Any) -> list[Placeholder]:
    """Placeholders on which an expression depends."""
    found = (_PLACEHOLDERS.get(symbol.element_hash()) for symbol in symbols_of(expression))
    return [p for p in found if p is not None]


def time_span(value: Any, what: str, name: str) -> tuple[float, float]:
    """A time or a span of times as ``(lower, upper)``."""
    try:
        low, high = value
    except TypeError:
        low = high = value
    low, high = number(low, what, name), number(high, what, name)
    if low < 0 or high < low or high == 0:
        raise ModelError(f"{what}: {name} must be positive and the limits in order, got {value!r}")
    return low, high


class OptimalControlProblem(Immutable):
    """What a motion must do and what is to be least.

    Parameters
    ----------
    mechanism : Mechanism
        The model, the same that is simulated; its inputs are sought.
    duration : float or (float, float)
        Time of the motion, s; two numbers: free between them.
    initial : sequence of relations, or State
        Conditions at the start; what is not stated is free, a state fixes all.
    final : sequence of relations
        Conditions at the end.
    path : sequence of relations
        Held all along: equalities, ``<=``, :func:`mbdcasadi.bounded`; in any expression of the model.
    running_cost, terminal_cost : expression
        Minimised: the integral of the one and the value of the other at the
        end, where ``mbd.t`` is the duration and :func:`integral` may occur.
    boundary : sequence of relations
        Between :func:`at_start`, :func:`at_end`, :func:`integral` and parameters.
    free_parameters : sequence of Parameter
        Optimised with the motion, within their limits; of the mechanism, or the problem's own.

    Raises
    ------
    ConditionError, ExpressionError, ModelError
        For what is no relation, unknown symbols, and limits the wrong way round.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        duration: Any,
        initial: Any = (),
        final: Any = (),
        path: Any = (),
        running_cost: Any = 0,
        terminal_cost: Any = 0,
        boundary: Any = (),
        free_parameters: Sequence[Parameter] = (),
    ):
        self.mechanism = mechanism
        self.equations: Equations = equations(mechanism)
        self.duration = time_span(duration, "OptimalControlProblem", "duration")
        self.free_parameters: tuple[Parameter, ...] = listed(free_parameters, Parameter, "free_parameters=")
        self.initial: State | tuple[Condition, ...] = (
            initial if isinstance(initial, State) else read_conditions(initial)
        )
        self.final = read_conditions(final)
        self.path = read_conditions(path)
        self.running_cost = ca.SX(quantity(running_cost, "OptimalControlProblem", "running_cost"))
        self.terminal_cost = ca.SX(quantity(terminal_cost, "OptimalControlProblem", "terminal_cost"))
        self.boundary = read_conditions(boundary)
        self._given = dict(
            mechanism=mechanism, duration=duration, initial=initial, final=final, path=path,
            running_cost=running_cost, terminal_cost=terminal_cost, boundary=boundary,
            free_parameters=free_parameters,
        )  # fmt: skip
        self._check()
        #: compiled programs, kept for the next solve
        self.memory: dict[Any, Any] = {}

    @property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Free parameters that the mechanism does not have."""
        theirs = self.mechanism.parameters
        return tuple(p for p in self.free_parameters if not any(p is other for other in theirs))

    @property
    def is_free_time(self) -> bool:
        """Whether the duration is sought."""
        return self.duration[0] < self.duration[1]

    def replace(self, **changes: Any) -> OptimalControlProblem:
        """Return a new problem with the arguments given replaced."""
        unknown = set(changes) - set(self._given)
        if unknown:
            raise ModelError(
                f"replace: unknown argument {', '.join(sorted(unknown))}; known are {', '.join(self._given)}"
            )
        return OptimalControlProblem(**(self._given | changes))

    # --- checks ------------------------------------------------------------------------
    def _check(self) -> None:
        eom = self.equations
        groups = (eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, eom.p, *self.own_parameters)
        known = {s.element_hash() for group in groups for s in ca.vertsplit(ca.SX(group))}
        for name, rows in (("path", self.path), ("initial", self.initial), ("final", self.final)):
            for row in () if isinstance(rows, State) else rows:
                self._check_symbols(row.expression, known, f"{name}: {row.label}", placeholders=False)
        self._check_symbols(self.running_cost, known, "running_cost", placeholders=False)
        self._check_symbols(self.terminal_cost, known, "terminal_cost", placeholders=True)
        for row in self.boundary:
            self._check_symbols(row.expression, known, f"boundary: {row.label}", placeholders=True)
        if not eom.u.numel() and not self.free_parameters and not self.is_free_time:
            raise ModelError(
                "there is nothing to optimise: the mechanism has no inputs and no parameter or time is free"
            )

    def _check_symbols(self, expression: ca.SX, known: set[int], where: str, *, placeholders: bool) -> None:
        for symbol in symbols_of(expression):
            found = _PLACEHOLDERS.get(symbol.element_hash())
            if found is not None and placeholders:
                self._check_symbols(found.expression, known, f"{where}: {found.label}", placeholders=False)
            elif found is not None:
                raise ExpressionError(f"{where} holds {found.label}, which belongs in boundary= or terminal_cost=")
            elif symbol.element_hash() not in known:
                role = role_of(symbol)
                hint = "; list it in free_parameters= or in the mechanism" if role and role.kind == "parameter" else ""
                raise ExpressionError(f"{where} holds {describe(symbol)}, which the mechanism does not have{hint}")

    def __repr__(self) -> str:
        low, high = self.duration
        time = f"{low:g} s" if low == high else f"{low:g} … {high:g} s"
        return f"OptimalControlProblem({self.mechanism!r}, duration {time})"
