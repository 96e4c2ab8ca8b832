"""Conditions at the start and at the end of a phase that are independent of the constraints and of each other."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from copy import copy
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...equations.reduced import reduced_equations
from ...model.cache import Cache
from ...model.conditions import Condition, stacked
from ...results.state import State
from ..poses.consistency import at_end_alone
from ..poses.kinematic_guess import KinematicPath
from ..problem import OptimalControlProblem
from ..statement.condition_rank import ConditionRank, Place, ranks_of
from ..statement.phase import Phase, contains_any, on_states, with_rates
from ..statement.state_conditions import WINDOW, state_conditions, window

#: Ranks of conditions; ``timed=True`` if a free time may be among the unknowns.
Ranks = Callable[..., ConditionRank]


class EndConditions:
    """Independent conditions at the ends of a phase, in place of those that the user stated.

    `start` is the first state as far as the initial conditions decide it, `path` the poses from the start to the end;
    what was found about them is in `cache`.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        phase: Phase,
        numeric: NumericEquations,
        start: State,
        initial: State | Sequence[Condition],
        path: KinematicPath,
        cache: Cache,
    ):
        self._phase, self._numeric, self._start, self._path, self._cache = phase, numeric, start, path, cache
        self._free = problem.free_parameters
        self._at_end = at_end_alone(problem) if phase is problem.phases[-1] else []
        self._follows = phase is not problem.phases[0]
        # not kept, since the problem holds this
        ranks = partial(ranks_of, problem, phase, numeric)
        self._prescribed = with_rates(problem.differentiated_path_constraints(phase))
        self._few_rows = not phase.equations.is_large
        #: conditions that others imply on one branch, with half the width of the window that is left to them; they are
        #: checked in the solution
        self.implied: dict[Condition, float] = {}
        self._final_key: tuple[Any, ...] = ()
        self._initial_key: tuple[Any, ...] = ()
        self.final = self._final(ranks)
        #: None if they give the whole state
        self.initial = self._initial(initial, ranks)
        #: of a program with these conditions: the stated ones, and which of them are kept
        self.key = (self._final_key, self._initial_key)
        #: whether conditions of a place say nothing to first order there, such as at the top of a circle
        self.are_singular: bool = cache.get_or_create("singular", lambda: self._are_singular(ranks))

    def at(
        self,
        problem: OptimalControlProblem,
        numeric: NumericEquations,
        start: State,
        initial: State | Sequence[Condition],
    ) -> EndConditions:
        """Return the same conditions at the end with another start, and at other values of the parameters."""
        other = copy(self)
        other._numeric, other._start, other._cache = numeric, start, Cache()
        began = {*(self.initial or []), *self._initial_key}
        other.implied = {c: width for c, width in self.implied.items() if c not in began}
        other.initial = other._initial(initial, partial(ranks_of, problem, self._phase, numeric))
        other.key = (self._final_key, other._initial_key)
        return other

    @property
    def _duration(self) -> float:
        return float(self._path.segment_times[-1] - self._path.segment_times[0]) or 1.0

    @property
    def _end(self) -> float:
        return float(self._path.segment_times[-1])

    def _final(self, ranks: Ranks) -> list[Condition]:
        """Independent conditions at the end."""
        end = self._phase.final
        if isinstance(end, State):
            state = (self._end, end.q, end.v, end.z)
            final = state_conditions(self._phase.equations, end)
        else:
            state = (self._end, self._path.poses[-1], np.zeros(self._start.q.size), self._start.z)
            final = list(end)
        rows = [c for c in on_states(final) if c.equality]
        if not rows or (not self._few_rows and not isinstance(end, State)):
            return final

        def found() -> tuple[list[int], list[bool]]:
            """Places of the rows that are independent, and whether each is singular."""
            timed = ranks(timed=True)
            independent = timed.independent(rows, state, self._prescribed)
            return list(map(rows.index, independent)), timed.each_singular(independent, state)

        places, singular = self._cache.get_or_create("final conditions", found)
        independent = [rows[k] for k in places]
        stationary = {c: self._stationary(c) for c, is_so in zip(independent, singular, strict=True) if is_so}
        kept = [c for c in independent if not stationary.get(c)]
        self._final_key = tuple(map(rows.index, independent)), tuple(map(rows.index, kept))
        others = [c for c in final if c in kept or c not in rows]
        return [*others, *itertools.chain(*stationary.values()), *self._windows(rows, kept, partial(ranks, timed=True))]

    def _stationary(self, condition: Condition) -> list[Condition]:
        """Conditions to first order in place of one that is met at an extremum: its slopes vanish.

        The height of a pendulum is that of its top where its slope by the angle is zero; the condition itself has
        no slope there, and no multiplier. None if constraints are left in which slopes would have to be taken.
        """
        eom = reduced_equations(self._phase.equations)
        if eom.rows or condition.depends_on("velocity"):
            return []
        (expression,) = eom.of(condition.expression)
        slopes = ca.jacobian(expression, eom.q)
        bent = [k for k in range(eom.q.numel()) if ca.depends_on(slopes[k], eom.q)]
        return [
            Condition(slopes[k], True, f"the slope of {condition.label} by {eom.coordinate_names[k]}") for k in bent
        ]

    def _windows(self, rows: list[Condition], kept: list[Condition], ranks: Ranks) -> list[Condition]:
        """Limits about conditions that others imply: they are implied on one branch alone."""
        windows = []
        for condition in rows:
            if condition not in kept:
                width = self.implied[condition] = self._window(condition, ranks())
                windows += window(condition, width)
        return windows

    def _window(self, condition: Condition, ranks: ConditionRank) -> float:
        """Half the width of such a limit: a share of what the quantity changes by."""
        eom, numeric = self._phase.equations, self._numeric
        slopes = eom.function(ca.jacobian(condition.expression, ca.vertcat(eom.q, eom.v, eom.z)))
        zero, m = np.zeros(eom.q.numel()), np.zeros(eom.lam.numel())
        values = [
            np.abs(slopes(t, q, v, zero, z, m, eom.input_values, numeric.p).full()) for t, q, v, z in ranks.states
        ]
        typical = np.r_[numeric.typical_step, numeric.typical_step / self._duration, np.ones(eom.z.numel())]
        return WINDOW * max((float(np.max(x * typical, initial=0.0)) for x in values), default=1.0)

    def _initial(self, initial: State | Sequence[Condition], ranks: Ranks) -> list[Condition] | None:
        """Independent conditions at the start; None if they give the whole state."""
        if isinstance(initial, State):
            return None
        eom = self._phase.equations
        self._initial_key = tuple(initial)
        if not initial or not self._few_rows or self._follows:
            return list(initial)
        begin: Place = (0.0, self._start.q, self._start.v, self._start.z)
        rows = [c for c in on_states(initial) if c.equality]
        others = [c for c in initial if c not in rows]

        def found() -> tuple[list[int], bool]:
            """Places of the rows that are independent, and whether they alone give the whole state."""
            untimed = ranks(timed=False)
            kept = untimed.independent(rows, begin, self._prescribed)
            fixed = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu, stacked([*self._prescribed, *kept]))
            # nothing that is free may occur in the rows
            complete = not others and not contains_any(fixed, self._free)
            return list(map(rows.index, kept)), complete and untimed.complete([*self._prescribed, *kept])

        places, complete = self._cache.get_or_create("initial conditions", found)
        if complete:
            self._initial_key = ()
            return None
        kept = [rows[k] for k in places]
        self._initial_key = (*initial, *places)
        return [*kept, *others, *self._windows(rows, kept, partial(ranks, timed=False))]

    def _are_singular(self, ranks: Ranks) -> bool:
        phase, times = self._phase, self._path.segment_times
        if not self._few_rows:
            return False
        at_end = [] if isinstance(phase.final, State) else [*self.final, *self._at_end]
        places = [(float(times[0]), list(self.initial or [])), (self._end, at_end)]
        places += [(float(t), list(w.conditions)) for t, w in zip(times[1:-1], phase.waypoints, strict=True)]
        for t, conditions in places:
            rows = [c for c in on_states(conditions) if c.equality]
            q = self._path.pose_at(t)
            at: Place = (t, q, np.zeros(q.size), self._start.z)
            timed = ranks(timed=True)
            if rows and timed.meets_singular(timed.independent(rows, at), at):
                return True
        return False
