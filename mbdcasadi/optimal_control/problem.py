"""An optimal-control problem: phases of a motion, relations between their ends, and the cost."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import casadi as ca

from ..errors import ExpressionError, ModelError
from ..model.conditions import Condition, read_conditions
from ..model.immutable import Immutable
from ..model.mechanism import Mechanism
from ..model.quantities import listed, refuse_twice
from ..model.symbols import Parameter, describe, role_of, symbols_of
from ..numerics.symbolic import symbolic
from ..results.state import State
from .checks.consistency import check_conditions
from .nlp.compiled import CompiledProblem
from .phase import Phase, Waypoint, read_cost
from .placeholders import is_marker, placeholders_in


class OptimalControlProblem(Immutable):
    """Demands on a motion, and the cost to minimise.

    Parameters
    ----------
    mechanism : Mechanism
        Model, the same that is simulated; its inputs are free.
    duration : float or (float, float)
        Time of the motion, s; two numbers: free between them.
    initial : sequence of relations, or State
        Conditions at the start; what is not stated is free, a state fixes everything.
    final : sequence of relations, or State
        Conditions at the end; a state fixes everything.
    path : sequence of relations
        Conditions that hold throughout: equalities, ``<=``, :func:`mbdcasadi.bounded`; in any
        expression of the model, rates of inputs (``tau.rate``) included.
    running_cost, terminal_cost : expression
        Minimised: the integral of the former and the value of the latter at the
        end, where ``mbd.t`` is the duration and :func:`integral` may occur.
    boundary : sequence of relations
        Between :func:`at_start`, :func:`at_end`, :func:`integral` and parameters.
    waypoints : sequence of Waypoint
        Conditions at times in between, in the order of time.
    free_parameters : sequence of Parameter
        Optimised with the motion, within their limits; of the mechanism, or of this problem alone.

    Attributes
    ----------
    phases : tuple of Phase
        Mechanism, conditions and running cost of the motion, phase by phase: one today.
    compiled : CompiledProblem
        Programs and solvers that were made for the problem and are used again.

    Raises
    ------
    ConditionError, ExpressionError, ModelError
        For what is not a relation, unknown symbols, limits the wrong way round,
        conditions that contradict each other, and conditions that the constraints already fix.
    """

    _symbolic = True

    @symbolic
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
        phase = Phase("motion", mechanism, duration, initial, final, path, running_cost, waypoints)
        self.phases: tuple[Phase, ...] = (phase,)
        self.mechanism, self.equations, self.duration = phase.mechanism, phase.equations, phase.duration
        self.initial, self.final, self.path, self.waypoints = phase.initial, phase.final, phase.path, phase.waypoints
        self.running_cost = phase.running_cost
        self.free_parameters: tuple[Parameter, ...] = listed(free_parameters, Parameter, "free_parameters=")
        refuse_twice(self.free_parameters, "free_parameters=")
        self.terminal_cost = read_cost(terminal_cost, "terminal_cost")
        self.boundary = read_conditions(boundary)
        self.compiled = CompiledProblem()
        self._check()
        check_conditions(self)

    @property
    def has_free_times(self) -> bool:
        """True if the duration of a phase or the time of a waypoint is free."""
        return any(phase.has_free_times for phase in self.phases)

    def has_input_rates(self, initial: State | Sequence[Condition]) -> bool:
        """Return True if a rate of an input occurs in the problem, or in conditions at its start."""
        start = [] if isinstance(initial, State) else initial
        conditions = [*start, *self.boundary, *(c for phase in self.phases for c in phase.conditions)]
        costs = [self.terminal_cost, *(phase.running_cost for phase in self.phases)]
        symbols = [s for e in (*costs, *(c.expression for c in conditions)) for s in symbols_of(e)]
        return any(role is not None and role.kind == "input rate" for role in map(role_of, symbols))

    def extra_parameters(self, phase: Phase) -> tuple[Parameter, ...]:
        """Return the free parameters that the mechanism of a phase does not have."""
        known = phase.mechanism.parameters
        return tuple(p for p in self.free_parameters if not any(p is other for other in known))

    def replace(self, **changes: Any) -> OptimalControlProblem:
        """Return a new problem with some arguments replaced."""
        arguments = {name: getattr(self, name) for name in type(self).__signature__.parameters}
        unknown = set(changes) - set(arguments)
        if unknown:
            raise ModelError(
                f"replace: unknown argument {', '.join(sorted(unknown))}; known are {', '.join(arguments)}"
            )
        return OptimalControlProblem(**(arguments | changes))

    # --- checks ------------------------------------------------------------------------------
    def _check(self) -> None:
        for phase in self.phases:
            named = [("path", phase.path), ("initial", phase.initial), ("final", phase.final)]
            named += [(f"waypoint {k}", w.conditions) for k, w in enumerate(phase.waypoints, start=1)]
            for name, conditions in named:
                self.check_symbols(phase, name, () if isinstance(conditions, State) else conditions)
            self._check_expressions(phase, {"running_cost": phase.running_cost}, placeholders=False)
        expressions = {f"boundary: {row.label}": row.expression for row in self.boundary}
        expressions |= {"terminal_cost": self.terminal_cost}
        self._check_expressions(self.phases[-1], expressions, placeholders=True)
        inputs = any(phase.mechanism.inputs for phase in self.phases)
        if not inputs and not self.free_parameters and not self.has_free_times:
            raise ModelError(
                "there is nothing to optimise: the mechanism has no inputs and no parameter or time is free"
            )

    def check_symbols(self, phase: Phase, name: str, conditions: Sequence[Condition]) -> None:
        """Refuse conditions of a phase that contain symbols which the mechanism does not have.

        Raises
        ------
        ExpressionError
            Naming the condition and the symbol.
        """
        expressions = {f"{name}: {row.label}": row.expression for row in conditions}
        self._check_expressions(phase, expressions, placeholders=False)

    def _check_expressions(self, phase: Phase, expressions: dict[str, ca.SX], *, placeholders: bool) -> None:
        groups = (*phase.equations.symbols, phase.input_rates, *self.extra_parameters(phase))
        known = {s.element_hash() for group in groups for s in ca.vertsplit(ca.SX(group))}
        for where, expression in expressions.items():
            marked = placeholders_in(expression)
            for misplaced in [x for p in marked for x in placeholders_in(p.expression)] if placeholders else marked:
                raise ExpressionError(
                    f"{where} contains {misplaced.label}, which belongs in boundary= or terminal_cost="
                )
            for symbol in symbols_of(expression):
                if symbol.element_hash() not in known and not (placeholders and is_marker(symbol)):
                    role = role_of(symbol)
                    is_parameter = role is not None and role.kind == "parameter"
                    hint = "; list it in free_parameters= or in the mechanism" if is_parameter else ""
                    raise ExpressionError(
                        f"{where} contains {describe(symbol)}, which the mechanism does not have{hint}"
                    )

    def __repr__(self) -> str:
        low, high = self.duration
        time = f"{low:g} s" if low == high else f"{low:g} … {high:g} s"
        return f"OptimalControlProblem({self.mechanism!r}, duration {time})"
