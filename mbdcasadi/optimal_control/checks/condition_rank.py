"""Ranks of conditions beside the constraints.

They are taken at consistent states scattered about the estimate: a condition
whose gradient vanishes at one singular pose alone (a dead centre) is none that
the constraints fix.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.cache import Cache
from ...model.conditions import Condition, stacked
from ...numerics.evaluation import Evaluator
from ...numerics.newton import solve
from ...numerics.rank import analyse_rank, unit_rows

if TYPE_CHECKING:
    from ..problem import OptimalControlProblem

#: A consistent state: time, coordinates, velocities, first-order states.
Place = tuple[float, np.ndarray, np.ndarray, np.ndarray]

#: Consistent states at which ranks are taken, and attempts to find them.
STATES, ATTEMPTS = 3, 12
#: Rest of a unit row outside the span of others below which it counts as dependent.
DEPENDENT = 1e-7
#: Rest of a unit row at one state below which a condition counts as met at a singular pose.
SINGULAR = 1e-4
#: By how much the value of an expression may differ from state to state, relative, and count as constant.
LINEAR = 1e-9
#: Results that are kept.
KEPT = 300


def ranks_of(problem: OptimalControlProblem, numeric: NumericEquations, *, timed: bool) -> ConditionRank:
    """Ranks for the conditions of a problem, kept for the last parameters; `timed` where a time may be free."""
    free = [*problem.free_parameters, *([numeric.eom.t] if timed and problem.has_free_times else [])]
    known = problem.ranks.get(len(free))
    if known is None or known.is_full or not np.array_equal(known.numeric.p, numeric.p):
        known = problem.ranks[len(free)] = ConditionRank(numeric, ca.vertcat(ca.SX(0, 1), *free))
    return known


class ConditionRank:
    """Ranks of conditions together with the constraints at position and velocity level.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    free : casadi.SX
        What else the conditions may be met by: free parameters, a free time.
    """

    def __init__(self, numeric: NumericEquations, free: ca.SX):
        self.numeric = numeric
        eom = numeric.eom
        self._x = ca.vertcat(eom.q, eom.v, eom.z, free)
        self._unknowns = 2 * eom.q.numel() + eom.z.numel()
        own = [s for s in ca.vertsplit(free) if s.numel() and s.element_hash() not in eom._known]
        self._own = ca.vertcat(ca.SX(0, 1), *own)
        scale = numeric.column_scale
        self._columns = np.concatenate([scale, scale, np.ones(eom.z.numel() + free.numel())])
        #: by conditions, which are kept beside so that their identities stay theirs
        self._functions: dict[tuple[int, ...], tuple[Evaluator, Sequence[Condition]]] = {}
        self._found = Cache()
        key = ("scattered states", numeric.p.tobytes())
        self.states: list[Place] = eom.mechanism.cache.get_or_create(key, self._scattered)

    def _scattered(self) -> list[Place]:
        """Consistent states about the estimate."""
        numeric, random = self.numeric, np.random.default_rng(1)
        q0, v0, z0 = numeric.eom.estimate
        found: list[Place] = []
        for _ in range(ATTEMPTS):
            moved = q0 + 0.4 * random.uniform(-1, 1, q0.size) * numeric.typical_step
            t = float(random.uniform(0, 1))
            outcome = solve(partial(numeric.position, t), moved, numeric.weights, step_limit=numeric.typical_step)
            if outcome.converged:
                jacobian, nu = numeric.velocity(t, outcome.x)
                v = v0 + random.uniform(-1, 1, v0.size) * numeric.typical_step
                scaled = jacobian * numeric.column_scale
                v -= numeric.column_scale * np.linalg.lstsq(scaled, jacobian @ v - nu, rcond=None)[0]
                found.append((t, outcome.x, v, z0 + random.uniform(-1, 1, z0.size)))
            if len(found) == STATES:
                break
        return found

    @property
    def is_full(self) -> bool:
        """Whether so much is kept that one had better begin anew: conditions change from plan to plan."""
        return len(self._found) > KEPT

    def _evaluated(self, conditions: Sequence[Condition], state: Place) -> tuple[np.ndarray, np.ndarray]:
        """Values (k,) and gradients (k, n) of conditions at a state; of the constraints where there are none."""
        key = _names(conditions)
        if key not in self._functions:
            eom = self.numeric.eom
            arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, self._own]
            rows = stacked(conditions) if conditions else ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
            results = [rows, ca.jacobian(rows, self._x)]
            self._functions[key] = Evaluator(ca.Function("conditions", arguments, results)), tuple(conditions)
        function = self._functions[key][0]

        def evaluate() -> tuple[np.ndarray, np.ndarray]:
            values, slopes = function(*state, self.numeric.p, np.ones(self._own.numel()))
            return values.ravel(), slopes * self._columns

        return self._found.get_or_create(("values", key, _key(state)), evaluate)

    def span(self, state: Place, given: Sequence[Condition] = ()) -> np.ndarray:
        """Orthonormal basis of the gradients of the constraints and of conditions at a state, by row."""

        def found() -> np.ndarray:
            if not given:
                return _span(unit_rows(self._evaluated((), state)[1]))
            constraints = self.span(state)
            return np.vstack([constraints, _span(self._rest(given, state, constraints), DEPENDENT)])

        return self._found.get_or_create(("span", _names(given), _key(state)), found)

    def _rest(self, conditions: Sequence[Condition], state: Place, span: np.ndarray) -> np.ndarray:
        """Unit gradients of conditions less what lies in a span."""
        rows = unit_rows(self._evaluated(conditions, state)[1])
        return rows - rows @ span.T @ span

    def fixed(self, conditions: Sequence[Condition], given: Sequence[Condition] = ()) -> list[bool]:
        """Which conditions depend on the constraints, and on other conditions given, at every state."""
        if not conditions or not self.states:
            return [False] * len(conditions)
        result = np.ones(len(conditions), bool)
        for state in self.states:
            rest = self._rest(conditions, state, self.span(state, given))
            result &= np.linalg.norm(rest, axis=1) <= DEPENDENT
        return result.tolist()

    def count(self, conditions: Sequence[Condition], given: Sequence[Condition] = ()) -> int:
        """How many of the conditions are independent of each other, of the constraints, and of others given."""
        if not self.states or not conditions:
            return len(conditions)

        def counted() -> int:
            rests = (self._rest(conditions, state, self.span(state, given)) for state in self.states)
            return max(analyse_rank(rest, DEPENDENT).rank for rest in rests)

        return self._found.get_or_create(("count", _names(conditions), _names(given)), counted)

    def independent(
        self, conditions: Sequence[Condition], state: Place, given: Sequence[Condition] = ()
    ) -> list[Condition]:
        """Conditions independent of others given: those on positions first, of these the steepest at a state."""
        if self.count(conditions, given) == len(conditions):
            return list(conditions)
        kept: list[Condition] = []
        for level in (False, True):
            group = [c for c in conditions if c.depends_on("velocity") is level]
            count, before = self.count(group, [*given, *kept]), [*given, *kept]
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
        """Whether conditions that are independent elsewhere depend on the constraints at a state: atop a circle."""
        left = np.linalg.svd(self._rest(conditions, state, self.span(state)), compute_uv=False)
        return len(left) < len(conditions) or bool(np.min(left, initial=1.0) < SINGULAR)

    def complete(self, conditions: Sequence[Condition]) -> bool:
        """Whether conditions and constraints together decide the whole state, but for the branch."""
        return any(len(self.span(state, conditions)) >= self._unknowns for state in self.states)

    def value_under(self, limit: Condition, rows: Sequence[Condition]) -> float | None:
        """Value of an expression where a row is met that differs from it by a factor and a constant; None without."""
        found, factors = [], []
        for state in self.states:
            (value,), (slope,) = self._evaluated([limit], state)
            values, slopes = self._evaluated(rows, state)
            k = int(np.argmax(np.abs(unit_rows(slopes) @ slope)))
            factors.append(float(slopes[k] @ slope / max(slopes[k] @ slopes[k], np.finfo(float).tiny)))
            if np.max(np.abs(slope - factors[-1] * slopes[k])) > LINEAR * np.max(np.abs(slope)):
                return None
            found.append(value - factors[-1] * values[k])
        near = found and all(np.ptp(x) <= LINEAR * (1 + np.max(np.abs(x))) for x in (found, factors))
        return float(found[0]) if near else None


def _key(state: Place) -> tuple:
    return state[0], state[1].tobytes(), state[2].tobytes(), state[3].tobytes()


def _names(conditions: Sequence[Condition]) -> tuple[int, ...]:
    return tuple(map(id, conditions))


def _span(rows: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Orthonormal basis of the rows, by row."""
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    return right[: int(np.sum(values > max(1e-9 * np.max(values, initial=0.0), least)))]
