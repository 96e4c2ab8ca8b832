"""Ranks of conditions beside the constraints.

They are taken at consistent states scattered about the estimate: a condition
whose gradient vanishes at one singular pose alone (a dead centre) is not one
that the constraints fix.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.cache import Cache
from ...model.conditions import Condition, stacked
from ...numerics.evaluation import Evaluator
from ...numerics.lazy import cached_property
from ...numerics.least_squares import project_velocity
from ...numerics.newton import solve
from ...numerics.rank import analyse_rank, unit_rows
from ...numerics.tolerances import NEGLIGIBLE
from .phase import Phase
from .statement import ProblemStatement

#: A consistent state: time, coordinates, velocities, first-order states.
Place = tuple[float, np.ndarray, np.ndarray, np.ndarray]

#: Consistent states at which ranks are taken, and attempts to find them.
STATES, ATTEMPTS = 3, 12
#: Rest of a unit row outside the span of others below which it counts as dependent.
DEPENDENCE_TOLERANCE = 1e-7
#: Rest of a unit row at one state below which a condition counts as met at a singular pose.
SINGULARITY_TOLERANCE = 1e-4
#: Results that are kept: conditions at the start may change from solve to solve.
RECENT = 300


def ranks_of(problem: ProblemStatement, phase: Phase, numeric: NumericEquations, *, timed: bool) -> ConditionRank:
    """Return the ranks for the conditions of a phase; `timed` if a time of the problem may be among the unknowns."""
    timed = timed and problem.has_free_times
    free = [*problem.free_parameters, *([numeric.eom.t] if timed else [])]
    key = phase, timed, numeric.p.tobytes()
    make = partial(ConditionRank, numeric, ca.vertcat(ca.SX(0, 1), *free))
    return problem.compiled.ranks.get_or_create(key, make, bounded=True)


class ConditionRank:
    """Ranks of conditions together with the constraints at position and velocity level.

    They may be met by further unknowns `free`: free parameters, a free time.
    """

    def __init__(self, numeric: NumericEquations, free: ca.SX):
        self.numeric = numeric
        eom = numeric.eom
        self._x = ca.vertcat(eom.q, eom.v, eom.z, free)
        self._unknowns = 2 * eom.q.numel() + eom.z.numel()
        extra = [s for s in ca.vertsplit(free) if s.numel() and s.element_hash() not in eom.symbol_hashes]
        self._extra = ca.vertcat(ca.SX(0, 1), *extra)
        scale = numeric.column_scale
        self._columns = np.concatenate([scale, scale, np.ones(eom.z.numel() + free.numel())])
        self._functions, self._results = Cache(RECENT), Cache(RECENT)

    @cached_property
    def states(self) -> list[Place]:
        """Consistent states about the estimate."""
        numeric = self.numeric
        key = ("scattered states", numeric.p.tobytes())
        return numeric.eom.shared.get_or_create(key, lambda: _scattered_states(numeric), bounded=True)

    def _evaluated(self, conditions: Sequence[Condition], state: Place) -> tuple[np.ndarray, np.ndarray]:
        """Values (k,) and gradients (k, n) of conditions at a state; of the constraints if there are none."""
        key = tuple(conditions)

        def compiled() -> Evaluator:
            eom = self.numeric.eom
            arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, self._extra]
            rows = stacked(conditions) if conditions else ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
            return Evaluator(ca.Function("conditions", arguments, [rows, ca.jacobian(rows, self._x)]))

        def evaluate() -> tuple[np.ndarray, np.ndarray]:
            function = self._functions.get_or_create(key, compiled, bounded=True)
            values, slopes = function(*state, self.numeric.p, np.ones(self._extra.numel()))
            return values.ravel(), slopes * self._columns

        return self._results.get_or_create(("values", key, _key(state)), evaluate, bounded=True)

    def span(self, state: Place, others: Sequence[Condition] = ()) -> np.ndarray:
        """Orthonormal basis of the gradients of the constraints and of other conditions at a state, by row."""

        def basis() -> np.ndarray:
            if not others:
                return _span(unit_rows(self._evaluated((), state)[1]))
            constraints = self.span(state)
            return np.vstack([constraints, _span(self._rest(others, state, constraints), DEPENDENCE_TOLERANCE)])

        return self._results.get_or_create(("span", tuple(others), _key(state)), basis, bounded=True)

    def _rest(self, conditions: Sequence[Condition], state: Place, span: np.ndarray) -> np.ndarray:
        """Unit gradients of conditions less what lies in a span."""
        rows = unit_rows(self._evaluated(conditions, state)[1])
        return rows - rows @ span.T @ span

    def fixed(self, conditions: Sequence[Condition], others: Sequence[Condition] = ()) -> list[bool]:
        """Return for each condition whether it depends on the constraints, and on other conditions, at every state."""
        if not conditions or not self.states:
            return [False] * len(conditions)
        result = np.ones(len(conditions), bool)
        for state in self.states:
            rest = self._rest(conditions, state, self.span(state, others))
            result &= np.linalg.norm(rest, axis=1) <= DEPENDENCE_TOLERANCE
        return result.tolist()

    def count(self, conditions: Sequence[Condition], others: Sequence[Condition] = ()) -> int:
        """Number of conditions that are independent of each other, of the constraints, and of other conditions."""
        if not self.states or not conditions:
            return len(conditions)

        def counted() -> int:
            rests = (self._rest(conditions, state, self.span(state, others)) for state in self.states)
            return max(analyse_rank(rest, DEPENDENCE_TOLERANCE).rank for rest in rests)

        return self._results.get_or_create(("count", tuple(conditions), tuple(others)), counted, bounded=True)

    def independent(
        self, conditions: Sequence[Condition], state: Place, others: Sequence[Condition] = ()
    ) -> list[Condition]:
        """Conditions that are independent of others: those on positions first, of these the steepest at a state."""
        if self.count(conditions, others) == len(conditions):
            return list(conditions)
        kept: list[Condition] = []
        for level in (False, True):
            group = [c for c in conditions if c.depends_on("velocity") is level]
            count, before = self.count(group, [*others, *kept]), [*others, *kept]
            if count < len(group):
                rest = self._rest(group, state, self.span(state, before))
                order = np.argsort(-np.linalg.norm(rest, axis=1), kind="stable")
                chosen: list[Condition] = []
                for k in order.tolist():
                    if self.count([*chosen, group[k]], before) > len(chosen):
                        chosen.append(group[k])
                group = [c for c in group if c in chosen]
            kept += group
        return [c for c in conditions if c in kept]

    def meets_singular(self, conditions: Sequence[Condition], state: Place) -> bool:
        """Return True if conditions depend on the constraints at this state, though not elsewhere: atop a circle."""
        left = np.linalg.svd(self._rest(conditions, state, self.span(state)), compute_uv=False)
        return len(left) < len(conditions) or bool(np.min(left, initial=1.0) < SINGULARITY_TOLERANCE)

    def each_singular(self, conditions: Sequence[Condition], state: Place) -> list[bool]:
        """Return the same for each condition by itself."""
        rest: np.ndarray = np.linalg.norm(self._rest(conditions, state, self.span(state)), axis=1)
        return [bool(size < SINGULARITY_TOLERANCE) for size in rest]

    def complete(self, conditions: Sequence[Condition]) -> bool:
        """Return True if conditions and constraints together decide the whole state, but for the branch."""
        return any(len(self.span(state, conditions)) >= self._unknowns for state in self.states)

    def values_under(self, limits: Sequence[Condition], rows: Sequence[Condition]) -> list[float | None]:
        """Values of expressions if a row is met that differs from them by a factor and a constant; else None."""
        if not limits:
            return []
        places = [(*self._evaluated(limits, state), *self._evaluated(rows, state)) for state in self.states]
        return [
            _value_under([(values[k], slopes[k], *row) for values, slopes, *row in places]) for k in range(len(limits))
        ]


def _value_under(places: Sequence[tuple[float, np.ndarray, np.ndarray, np.ndarray]]) -> float | None:
    """Value of an expression from its value and gradient, and those of the rows, at each of some states."""
    constants, factors = [], []
    for value, slope, row_values, slopes in places:
        k = int(np.argmax(np.abs(unit_rows(slopes) @ slope)))
        factors.append(float(slopes[k] @ slope / max(slopes[k] @ slopes[k], np.finfo(float).tiny)))
        if np.max(np.abs(slope - factors[-1] * slopes[k])) > NEGLIGIBLE * np.max(np.abs(slope)):
            return None
        constants.append(value - factors[-1] * row_values[k])
    constant = all(np.ptp(x) <= NEGLIGIBLE * (1 + np.max(np.abs(x))) for x in (constants, factors) if x)
    return float(constants[0]) if constants and constant else None


def _scattered_states(numeric: NumericEquations) -> list[Place]:
    """Consistent states about the estimate."""
    random = np.random.default_rng(1)
    q0, v0, z0 = numeric.eom.estimate
    states: list[Place] = []
    for _ in range(ATTEMPTS):
        moved = q0 + 0.4 * random.uniform(-1, 1, q0.size) * numeric.typical_step
        t = float(random.uniform(0, 1))
        z = z0 + random.uniform(-1, 1, z0.size)
        rows = partial(numeric.position, t, z=z)
        outcome = solve(rows, moved, numeric.weights, step_limit=numeric.typical_step)
        if outcome.converged:
            jacobian, nu = numeric.velocity(t, outcome.x, z)
            v = v0 + random.uniform(-1, 1, v0.size) * numeric.typical_step
            v = project_velocity(jacobian, nu, v, numeric.column_scale**-2)
            states.append((t, outcome.x, v, z))
        if len(states) == STATES:
            break
    return states


def _key(state: Place) -> tuple:
    return state[0], state[1].tobytes(), state[2].tobytes(), state[3].tobytes()


def _span(rows: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Orthonormal basis of the rows, by row."""
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    return right[: int(np.sum(values > max(1e-9 * np.max(values, initial=0.0), least)))]
