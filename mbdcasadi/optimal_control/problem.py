"""An optimal-control problem: what the motion must do, and what is to be least."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca

from ..equations import Equations, equations
from ..errors import ExpressionError, ModelError
from ..model.cache import Cache
from ..model.conditions import Condition, read_conditions
from ..model.immutable import Immutable
from ..model.mechanism import Mechanism
from ..model.quantities import entries, is_relation, listed, quantity, refuse_twice
from ..model.symbols import Parameter, describe, role_of, symbols_of
from ..printing import to_text
from ..results.state import State
from .checks.condition_rank import ConditionRank
from .checks.consistency import check_conditions, check_end
from .placeholders import placeholder_of, placeholders_in
from .waypoints import Waypoint, time_span


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
    final : sequence of relations, or State
        Conditions at the end; a state fixes all.
    path : sequence of relations
        Held all along: equalities, ``<=``, :func:`mbdcasadi.bounded`; in any
        expression of the model, rates of inputs (``tau.rate``) included.
    running_cost, terminal_cost : expression
        Minimised: the integral of the one and the value of the other at the
        end, where ``mbd.t`` is the duration and :func:`integral` may occur.
    boundary : sequence of relations
        Between :func:`at_start`, :func:`at_end`, :func:`integral` and parameters.
    waypoints : sequence of Waypoint
        Conditions at times between, in the order of time.
    free_parameters : sequence of Parameter
        Optimised with the motion, within their limits; of the mechanism, or the problem's own.

    Raises
    ------
    ConditionError, ExpressionError, ModelError
        For what is no relation, unknown symbols, limits the wrong way round,
        conditions that contradict each other, and conditions that the constraints already fix.
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
        waypoints: Iterable[Waypoint] = (),
        free_parameters: Sequence[Parameter] = (),
    ):
        self.mechanism = mechanism
        self.equations: Equations = equations(mechanism)
        self.duration = time_span(duration, "OptimalControlProblem", "duration")
        self.free_parameters: tuple[Parameter, ...] = listed(free_parameters, Parameter, "free_parameters=")
        refuse_twice(self.free_parameters, "free_parameters=")
        self.initial = _state_or_conditions(initial, mechanism)
        self.final = _state_or_conditions(final, mechanism)
        self.path = read_conditions(path)
        self.running_cost = _cost(running_cost, "running_cost")
        self.terminal_cost = _cost(terminal_cost, "terminal_cost")
        self.boundary = read_conditions(boundary)
        self.waypoints = _in_order(waypoints, self.duration)
        self._given = dict(
            mechanism=mechanism, duration=duration, initial=initial, final=final, path=path,
            running_cost=running_cost, terminal_cost=terminal_cost, boundary=boundary,
            waypoints=self.waypoints, free_parameters=free_parameters,
        )  # fmt: skip
        #: compiled programs, kept for the next solve
        self.cache = Cache()
        #: ranks of conditions, by the number of free quantities
        self.ranks: dict[int, ConditionRank] = {}
        self._check()
        check_conditions(self)

    @property
    def u_rate(self) -> ca.SX:
        """Rates of the inputs (n_u,)."""
        return ca.vertcat(ca.SX(0, 1), *[u.rate for u in self.mechanism.inputs])

    @property
    def has_free_times(self) -> bool:
        """Whether the duration or the time of a waypoint is sought."""
        return any(low < high for low, high in (self.duration, *(w.time for w in self.waypoints)))

    @property
    def has_input_rates(self) -> bool:
        """Whether a rate of an input occurs in it."""
        conditions = [*self.path, *self.boundary, *(c for w in self.waypoints for c in w.conditions)]
        for end in (self.initial, self.final):
            conditions += [] if isinstance(end, State) else end
        expressions = [self.running_cost, self.terminal_cost, *[c.expression for c in conditions]]
        expressions += [p.expression for e in expressions for p in placeholders_in(e)]
        found = [s for e in expressions for s in symbols_of(e)]
        return any(role is not None and role.kind == "input rate" for role in map(role_of, found))

    @property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Free parameters that the mechanism does not have."""
        theirs = self.mechanism.parameters
        return tuple(p for p in self.free_parameters if not any(p is other for other in theirs))

    def replace(self, **changes: Any) -> OptimalControlProblem:
        """Return a new problem with the arguments given replaced."""
        unknown = set(changes) - set(self._given)
        if unknown:
            raise ModelError(
                f"replace: unknown argument {', '.join(sorted(unknown))}; known are {', '.join(self._given)}"
            )
        return OptimalControlProblem(**(self._given | changes))

    def started_from(self, initial: Any) -> OptimalControlProblem:
        """The problem with other conditions at the start, which shares what was compiled."""
        changed: OptimalControlProblem = object.__new__(OptimalControlProblem)
        changed.__dict__.update(self.__dict__)
        given = _state_or_conditions(initial, self.mechanism)
        changed.__dict__.update(initial=given, _given=self._given | {"initial": initial})
        changed._check()
        if not isinstance(given, State):
            check_end(changed, "initial", given)
        return changed

    # --- checks ------------------------------------------------------------------------
    def _check(self) -> None:
        eom = self.equations
        groups = (*eom.symbols, self.u_rate, *self.own_parameters)
        known = {s.element_hash() for group in groups for s in ca.vertsplit(ca.SX(group))}
        named = [("path", self.path), ("initial", self.initial), ("final", self.final)]
        named += [(f"waypoint {k}", w.conditions) for k, w in enumerate(self.waypoints, start=1)]
        for name, rows in named:
            for row in () if isinstance(rows, State) else rows:
                self._check_symbols(row.symbols, known, f"{name}: {row.label}", placeholders=False)
        self._check_symbols(symbols_of(self.running_cost), known, "running_cost", placeholders=False)
        self._check_symbols(symbols_of(self.terminal_cost), known, "terminal_cost", placeholders=True)
        for row in self.boundary:
            self._check_symbols(row.symbols, known, f"boundary: {row.label}", placeholders=True)
        if not eom.u.numel() and not self.free_parameters and not self.has_free_times:
            raise ModelError(
                "there is nothing to optimise: the mechanism has no inputs and no parameter or time is free"
            )

    def _check_symbols(self, symbols: list[ca.SX], known: set[int], where: str, *, placeholders: bool) -> None:
        for symbol in symbols:
            found = placeholder_of(symbol)
            if found is not None and placeholders:
                self._check_symbols(symbols_of(found.expression), known, f"{where}: {found.label}", placeholders=False)
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


def _cost(given: Any, name: str) -> ca.SX:
    value = ca.SX(quantity(given, "OptimalControlProblem", name))
    if is_relation(value):
        raise ExpressionError(
            f"{name} is the relation {to_text(value)}; a cost is an expression, conditions go to path="
        )
    return value


def _state_or_conditions(given: Any, mechanism: Mechanism) -> State | tuple[Condition, ...]:
    if not isinstance(given, State):
        return read_conditions(given)
    theirs, ours = equations(given.mechanism), equations(mechanism)
    for one, other in ((theirs.q, ours.q), (theirs.z, ours.z)):
        hashes = ([s.element_hash() for s in ca.vertsplit(x)] for x in (one, other))
        if next(hashes) != next(hashes):
            raise ModelError(f"OptimalControlProblem: the state belongs to {given.mechanism!r}, not to {mechanism!r}")
    return given


def _in_order(waypoints: Any, duration: tuple[float, float]) -> tuple[Waypoint, ...]:
    """Waypoints, whose times must follow each other within the duration."""
    found = entries(waypoints, "waypoints=")
    before = (0.0, 0.0)
    for k, waypoint in enumerate(found, start=1):
        if not isinstance(waypoint, Waypoint):
            raise ModelError(f"waypoints= takes Waypoint objects, got {waypoint!r}")
        low, high = waypoint.time
        if high <= before[0] or (low == high and before[0] == before[1] and low <= before[0]):
            raise ModelError(f"waypoint {k} at {high:g} s does not come after what is before it, at {before[0]:g} s")
        if low >= duration[1]:
            raise ModelError(f"waypoint {k} at {low:g} s does not come before the end at {duration[1]:g} s")
        before = waypoint.time
    return found
