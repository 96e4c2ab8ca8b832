"""Statement of a problem of optimal control: phases, relations between their ends, a cost, and what is free."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import casadi as ca

from ...model.cache import Cache
from ...model.conditions import Condition
from ...model.contents import contents_of, values_of_contents
from ...model.immutable import Immutable
from ...model.placeholders import MARKERS, Placeholder
from ...model.symbols import Parameter, place_of, role_of, symbols_of
from ...numerics.lazy import cached_property
from ...results.state import State
from .compiled import CompiledProblem
from .phase import Phase, contains_any, prescribes_motion


class ProblemStatement(Immutable):
    """Phases, relations between their ends, cost and free parameters of a problem, with programs made for it.

    Base class of :class:`OptimalControlProblem`, which reads and checks its arguments. Guesses and checks see no more.
    """

    phases: tuple[Phase, ...]
    terminal_cost: ca.SX
    boundary: tuple[Condition, ...]
    free_parameters: tuple[Parameter, ...]
    compiled: CompiledProblem

    @cached_property
    def contents(self) -> Hashable | None:
        """Key that is equal for problems of equal contents; None if these are not known."""
        mechanisms = [phase.equations.contents for phase in self.phases]
        if None in mechanisms:
            return None
        stated: list[Any] = [self.terminal_cost, self.boundary, self.free_parameters]
        own = {p for phase in self.phases for p in phase.mechanism.parameters}
        groups: list[ca.SX] = [*MARKERS.values(), *(p for p in self.free_parameters if p not in own)]
        for phase in self.phases:
            ends = [end.arguments if isinstance(end, State) else end for end in (phase.initial, phase.final)]
            stated += [phase.name, phase.span, *ends, phase.path, phase.running_cost, phase.waypoints]
            groups += [*phase.equations.symbols, phase.input_rates]
            if len(self.phases) > 1:
                groups += [marker for marker, _ in phase.markers.values()]
            if phase is not self.phases[0]:  # joints of the change alone belong to no mechanism
                stated += [phase.law.row_names, phase.law.momentary, list(phase.restitution.values())]
                groups.append(phase.law.impulses)
        symbols, common = _distinct(groups) if len(self.phases) > 1 else (groups, ())
        read = contents_of(*stated, symbols=symbols)
        return None if read is None else (*mechanisms, common, read)

    @cached_property
    def shared(self) -> Cache:
        """What holds no symbols, numbers and compiled functions, shared with problems of equal contents."""
        return values_of_contents(self.contents)

    @property
    def has_free_times(self) -> bool:
        """True if the duration of a phase or the time of a waypoint is free."""
        return any(phase.has_free_times for phase in self.phases)

    def has_input_rates(self, initial: State | Sequence[Condition]) -> bool:
        """Return True if a rate of an input occurs in the problem, or in conditions at its start."""
        start = [] if isinstance(initial, State) else initial
        conditions = [*start, *self.boundary, *(c for phase in self.phases for c in phase.conditions)]
        costs = [self.terminal_cost, *(phase.running_cost for phase in self.phases)]
        costs += [w.cost for phase in self.phases for w in phase.waypoints]
        symbols = [*(s for c in conditions for s in c.symbols), *(s for cost in costs for s in symbols_of(cost))]
        return any(role is not None and role.kind == "input rate" for role in map(role_of, symbols))

    def extra_parameters(self, phase: Phase) -> tuple[Parameter, ...]:
        """Return the free parameters that the mechanism of a phase does not have."""
        known = phase.mechanism.parameters
        return tuple(p for p in self.free_parameters if place_of(p, known) is None)

    def differentiated_path_constraints(self, phase: Phase) -> list[Condition]:
        """Return path conditions that prescribe the motion; those with free parameters hold at the stages alone."""
        free = self.free_parameters
        return [c for c in phase.path if prescribes_motion(c) and not contains_any(c.expression, free)]

    def phases_of(self, placeholder: Placeholder) -> tuple[Phase, ...]:
        """Return the phase that a placeholder means; for an integral over the motion, those that have its symbols."""
        if placeholder.phase is not None:
            return (placeholder.phase,)
        if placeholder.kind != "integral":
            return (self.phases[0 if placeholder.kind == "at_start" else -1],)
        known = [phase for phase in self.phases if not phase.is_instant and phase.has(placeholder.expression)]
        return tuple(known) or self.phases[-1:]


def _distinct(groups: Sequence[ca.SX]) -> tuple[list[ca.SX], tuple[int, ...]]:
    """Symbols of groups, each once, and for each of those of the groups its place among them."""
    every = [symbol for group in groups for symbol in ca.vertsplit(group)]
    symbols = {symbol.element_hash(): symbol for symbol in every}
    places = {key: k for k, key in enumerate(symbols)}
    return list(symbols.values()), tuple(places[symbol.element_hash()] for symbol in every)
