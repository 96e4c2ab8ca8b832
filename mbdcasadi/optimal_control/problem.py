"""An optimal-control problem: phases of a motion, relations between their ends, and the cost."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import casadi as ca

from ..errors import ExpressionError, ModelError
from ..model.conditions import Condition, read_conditions
from ..model.forces.friction.modes import switching
from ..model.mechanism import Mechanism
from ..model.placeholders import PARTS, at_end, placeholders_in, with_values
from ..model.quantities import listed, listed_by_name, refuse_twice, refuse_unknown
from ..model.symbols import Parameter, describe, role_of, symbols_of
from ..numerics.symbolic import symbolic
from ..results.state import State
from .poses.consistency import check_conditions
from .statement.compiled import CompiledProblem
from .statement.cost_parts import CostParts, SoftLimit, hard_and_soft, parameter_parts, price, split_along_path
from .statement.phase import Phase, Waypoint, read_cost
from .statement.sites import Relaxation, relaxation
from .statement.statement import ProblemStatement
from .statement.time_span import span_text, time_span


class OptimalControlProblem(ProblemStatement):
    """Demands on a motion, and the cost to minimise.

    Parameters
    ----------
    mechanism : Mechanism
        Model, the same that is simulated; its inputs are free. Left out if `phases` are given. Where ``DryFriction`` in
        its joints sticks and slides, and where a ``RigidContact`` opens and closes, is found.
    duration : float, (float, float) or between
        Time of the motion, s; two numbers: free between them, with :func:`between` from a guess.
    initial : sequence of relations, or State
        Conditions at the start; what is not stated is free, a state fixes everything. First-order states
        that are not stated, such as the current of a motor, are free, too, while :func:`mbdcasadi.simulate` takes
        their initial values.
    final : sequence of relations, or State
        Conditions at the end, or :func:`mbdcasadi.soft` ones; a state fixes everything.
    path : sequence of relations
        Conditions that hold throughout: equalities, ``<=``, :func:`mbdcasadi.bounded`; in any
        expression of the model, rates of inputs (``tau.rate``) included. Those of :func:`mbdcasadi.soft` may be passed
        at a price, and add an input each.
    running_cost, terminal_cost : expression
        Minimised: the integral of the former and the value of the latter at the
        end, where ``mbd.t`` is the duration and :func:`integral` may occur. :func:`positive_part` and :func:`absolute`
        of an expression add an input each, and a free parameter each in the terminal cost.
    boundary : sequence of relations
        Between :func:`at_start`, :func:`at_end`, :func:`integral` and parameters.
    waypoints : sequence of Waypoint
        Conditions at times in between, in the order of time.
    free_parameters : sequence of Parameter
        Optimised with the motion, within their limits; of the mechanisms, or of this problem alone.
    phases : sequence of Phase, optional
        Motion through mechanisms that follow each other, in place of the first seven arguments and of `waypoints`.

    Attributes
    ----------
    phases : tuple of Phase
        Mechanism, conditions and running cost of the motion, phase by phase.
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
        mechanism: Mechanism | None = None,
        duration: Any = None,
        initial: Any = (),
        final: Any = (),
        path: Any = (),
        running_cost: Any = 0,
        terminal_cost: Any = 0,
        boundary: Any = (),
        waypoints: Iterable[Waypoint] = (),
        free_parameters: Sequence[Parameter] = (),
        phases: Sequence[Phase] | None = None,
    ):
        hard, soft = hard_and_soft(path)
        path = (*hard, *soft)
        one = (mechanism, duration, initial, final, path, running_cost, waypoints)
        cost, rows = read_cost(terminal_cost, "terminal_cost"), read_conditions(boundary)
        #: arguments as they were given, of which parts have become inputs
        self.given = {
            "mechanism": mechanism, "path": path, "running_cost": running_cost, "terminal_cost": cost, "boundary": rows,
        }  # fmt: skip
        if phases is None:
            self.phases, cost, rows = _one_phase(one, cost, rows)
        else:
            self.phases = _read_phases(phases, one)
        #: whether the motion was given by phases
        self.is_phased = phases is not None
        phase = self.phases[0]
        self.mechanism, self.equations, self.duration = phase.mechanism, phase.equations, phase.span
        self.initial, self.final, self.path, self.waypoints = phase.initial, phase.final, phase.path, phase.waypoints
        self.running_cost = phase.running_cost
        free = listed(free_parameters, Parameter, "free_parameters=")
        refuse_twice(free, "free_parameters=")
        parts = parameter_parts()
        #: soft limits of the ends of the phases
        self.soft_ends = tuple(parts.split_soft(self._at_end(phase)) for phase in self.phases)
        #: terminal cost without these
        self.own_terminal_cost = parts.split(cost, "terminal_cost")
        self.terminal_cost = self.own_terminal_cost + sum(map(price, self.soft_ends), ca.SX(0))
        self.boundary = (*rows, *parts.limits)
        own = [*(p for phase in self.phases for w in phase.waypoints for p in w.parameters), *parts.symbols]
        self.free_parameters = (*free, *own)
        #: arguments before parts of the cost have become parameters
        self.whole = {"terminal_cost": cost, "boundary": rows, "free_parameters": free}
        if not self.is_phased:
            self.whole |= {"path": (*phase.path, *phase.soft_limits), "running_cost": phase.own_cost}
            if not isinstance(phase.final, State):
                self.whole["final"] = (*phase.final, *phase.soft_final)
        self.compiled = CompiledProblem()
        self._check()
        #: the same with exact friction and contact as forces to be found; None if there is none
        self.relaxed: tuple[OptimalControlProblem, Relaxation] | None = self._relaxed()
        if self.relaxed is None:
            check_conditions(self)

    def _relaxed(self) -> tuple[OptimalControlProblem, Relaxation] | None:
        frictions = [f for phase in self.phases for f in switching(phase.mechanism)]
        if not frictions:
            return None
        if self.is_phased:
            raise ModelError(
                f"{frictions[0].description}: DryFriction and RigidContact take a problem of one mechanism, whose "
                "phases are found; with phases= take joints that close and open, or laws without switches"
            )
        relaxed = relaxation(self.given["mechanism"])
        whole = relaxed.replaced
        problem = self.replace(
            mechanism=whole.mechanism,
            path=[*whole.conditions(self.given["path"]), *relaxed.conditions],
            running_cost=whole.of(ca.SX(self.given["running_cost"])),
        )
        return problem, relaxed

    def _at_end(self, phase: Phase) -> list[SoftLimit]:
        value = phase.at_end if self.is_phased else at_end
        return [SoftLimit.of(limit.condition, limit.weight, value) for limit in phase.soft_final]

    def replace(self, **changes: Any) -> OptimalControlProblem:
        """Return a new problem with some arguments replaced."""
        names = list(type(self).__signature__.parameters)
        allowed = (
            {"phases", "terminal_cost", "boundary", "free_parameters"} if self.is_phased else {*names} - {"phases"}
        )
        arguments = {name: getattr(self, name) for name in names if name in allowed} | self.whole
        if not self.is_phased and changes.keys() & self.given.keys():  # parts belong to some of these alone
            arguments |= self.given
        refuse_unknown(changes, arguments)
        return OptimalControlProblem(**(arguments | changes))

    # --- checks ------------------------------------------------------------------------------
    def _check(self) -> None:
        for phase in self.phases:
            named = [("path", phase.path), ("final", phase.final)]
            impulses = phase is not self.phases[0]
            start = () if isinstance(phase.initial, State) else phase.initial
            self.check_symbols(phase, "initial", start, impulses=impulses)
            named += [(f"waypoint {k}", w.conditions) for k, w in enumerate(phase.waypoints, start=1)]
            for name, conditions in named:
                self.check_symbols(phase, name, () if isinstance(conditions, State) else conditions)
            costs = {f"cost of waypoint {k}": w.cost for k, w in enumerate(phase.waypoints, start=1)}
            self._check_expressions(phase, {"running_cost": phase.running_cost, **costs})
        expressions = {f"boundary: {row.label}": row.expression for row in self.boundary}
        expressions |= {"terminal_cost": self.terminal_cost}
        self._check_placeholders(expressions)

    def _check_placeholders(self, expressions: dict[str, ca.SX]) -> None:
        """Check the boundary conditions and the terminal cost: each placeholder in its phase, the rest at the end."""
        for where, expression in expressions.items():
            for placeholder in placeholders_in(expression):
                if placeholder.kind in PARTS:
                    raise ExpressionError(f"{where} contains {placeholder.label}, which belongs in a cost")
                phase = self.phases_of(placeholder)[0]
                if phase not in self.phases:
                    raise ExpressionError(
                        f"{where} contains {placeholder.label}, of a phase that does not belong to the problem"
                    )
                if phase.is_instant and placeholder.kind == "integral":
                    raise ExpressionError(f"{where} contains {placeholder.label}, of a phase of no duration")
                self._check_expressions(phase, {where: placeholder.expression})
            rest = with_values(expression, lambda _: 0.0)
            self._check_expressions(self.phases[-1], {where: rest})

    def check_symbols(
        self, phase: Phase, name: str, conditions: Sequence[Condition], *, impulses: bool = False
    ) -> None:
        """Refuse conditions of a phase that contain symbols which the mechanism does not have.

        Raises
        ------
        ExpressionError
            Naming the condition and the symbol.
        """
        self._check_expressions(phase, {f"{name}: {row.label}": row for row in conditions}, impulses=impulses)

    def _check_expressions(
        self, phase: Phase, expressions: Mapping[str, ca.SX | Condition], *, impulses: bool = False
    ) -> None:
        further = (*self.extra_parameters(phase), *([phase.law.impulses] if impulses else []))
        known = phase.symbol_hashes.union(s.element_hash() for group in further for s in ca.vertsplit(group))
        for where, stated in expressions.items():
            is_expression = isinstance(stated, ca.SX)
            expression, symbols = (stated, symbols_of(stated)) if is_expression else (stated.expression, stated.symbols)
            for symbol in symbols:
                if symbol.element_hash() not in known:
                    for misplaced in placeholders_in(expression):
                        place = "a cost" if misplaced.kind in PARTS else "boundary= or terminal_cost="
                        raise ExpressionError(f"{where} contains {misplaced.label}, which belongs in {place}")
                    role = role_of(symbol)
                    is_parameter = role is not None and role.kind == "parameter"
                    hint = "; list it in free_parameters= or in the mechanism" if is_parameter else ""
                    place = f" of phase '{phase.name}'" if self.is_phased else ""
                    lacks = "is not known at an instant" if phase.is_instant and phase.has(symbol) else "does not have"
                    reason = f"the mechanism{place} {lacks}{hint}" if lacks == "does not have" else lacks
                    raise ExpressionError(f"{where} contains {describe(symbol)}, which {reason}")

    def __repr__(self) -> str:
        if self.is_phased:
            return f"OptimalControlProblem(phases=[{', '.join(phase.name for phase in self.phases)}])"
        return f"OptimalControlProblem({self.mechanism!r}, duration {span_text(self.duration)})"


def _one_phase(
    one: Sequence[Any], cost: ca.SX, rows: Sequence[Condition]
) -> tuple[tuple[Phase, ...], ca.SX, tuple[Condition, ...]]:
    """The motion of one mechanism as a phase, and terminal cost and boundary conditions by its symbols."""
    mechanism, duration, initial, final, path, running_cost, waypoints = one
    if mechanism is None or duration is None:
        raise ModelError("OptimalControlProblem: give a mechanism and a duration, or phases=")

    def split(parts: CostParts) -> list[ca.SX]:
        split = [parts.split_integrals(cost, "terminal_cost")]
        return split + [parts.split_integrals(c.expression, f"boundary: {c.label}") for c in rows]

    hard, soft = hard_and_soft(path)
    mechanism, path, (cost, *sides) = split_along_path(mechanism, hard, split)
    phase = Phase("motion", mechanism, duration, initial, final, (*path, *soft), running_cost, waypoints)
    time_span(duration, "phase 'motion'", "duration")  # refuses 0
    boundary = tuple(_with_side(c, side) for c, side in zip(rows, sides, strict=True))
    return (phase,), cost, boundary


def _with_side(condition: Condition, side: ca.SX) -> Condition:
    """A boundary condition with symbols in place of the parts in its integrals."""
    if side.element_hash() == condition.expression.element_hash():
        return condition
    if condition.equality:
        raise ExpressionError(
            f"boundary: {condition.label} prescribes an integral with positive_part or absolute, which can have an "
            "upper limit alone"
        )
    return replace(condition, expression=side)


def _read_phases(phases: Any, others: Sequence[Any]) -> tuple[Phase, ...]:
    """Phases that follow each other, checked."""
    read = listed_by_name(phases, Phase, "phases=")
    if not read:
        raise ModelError("OptimalControlProblem: phases= is empty")
    if any(x is not None for x in others[:2]) or any(
        isinstance(x, ca.SX) or x != () for x in (*others[2:5], others[6])
    ):
        raise ModelError(
            "OptimalControlProblem: with phases=, mechanisms, durations, conditions and waypoints belong to the phases"
        )
    if isinstance(others[5], ca.SX) or others[5] != 0:
        raise ModelError("OptimalControlProblem: with phases=, running_cost= belongs to the phases")
    if read[0].is_instant:
        raise ModelError(f"phase '{read[0].name}' is the first one and must have a duration")
    if read[0].restitution:
        raise ModelError(
            f"phase '{read[0].name}' is the first one; restitution= belongs to a phase that follows another"
        )
    for before, phase in itertools.pairwise(read):
        _refuse_coming(before, phase)
    for phase in read:
        if phase.span[0] == 0 < phase.span[1]:
            raise ModelError(
                f"phase '{phase.name}': the duration may shrink to 0, at which an optimum is a spurious one; give a "
                f"range with a positive lower limit, or a duration of exactly 0, got {phase.span}"
            )
        if phase is not read[0] and isinstance(phase.initial, State):
            raise ModelError(
                f"phase '{phase.name}': its state follows from the phase before; initial= takes conditions"
            )
    return read


def _refuse_coming(before: Phase, phase: Phase) -> None:
    """Refuse a body, or a coordinate, that the phase before does not have."""
    known = {s.element_hash() for s in ca.vertsplit(before.equations.q)}
    for symbol in ca.vertsplit(phase.equations.q):
        if symbol.element_hash() not in known:
            role = role_of(symbol)
            owner = getattr(role.owner, "name", symbol.name()) if role is not None else symbol.name()
            raise ModelError(
                f"phase '{phase.name}': '{owner}' is not in the phase '{before.name}' before it, and so its place is "
                "not known; bodies may be removed, not added"
            )
