"""Whether the conditions of a problem can hold together, told before anything is solved.

Ranks are taken at consistent states scattered about the estimate: a condition
whose gradient vanishes at one singular pose alone (a dead centre) is none that
the constraints fix.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ..analysis.assembly import assemble_at
from ..analysis.inputs import read_signals
from ..equations.numeric import LARGE, NumericEquations
from ..errors import AssemblyError, ConditionError, MechanismWarning
from ..model.conditions import Condition, stacked
from ..model.mechanism import Mechanism
from ..model.symbols import Symbol, symbols_of
from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import solve
from ..numerics.rank import analyse_rank, unit_rows
from ..results.state import State
from .placeholders import placeholders_in, with_values

if TYPE_CHECKING:
    from .problem import OptimalControlProblem

#: Consistent states at which ranks are taken, and attempts to find them.
STATES, ATTEMPTS = 3, 12
#: Rest of a unit row outside the span of others below which it counts as dependent.
DEPENDENT = 1e-7
#: Rest of a unit row at one state below which a condition counts as met at a singular pose.
SINGULAR = 1e-4
#: Violation of a limit that counts, relative to its values.
COUNTS = 1e-6


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
        self._constraints = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
        scale = numeric.column_scale
        self._columns = np.concatenate([scale, scale, np.ones(eom.z.numel() + free.numel())])
        self._spans: dict[bytes, np.ndarray] = {}
        self._functions: dict[tuple[int, ...], Evaluator] = {}
        self.states = self._kept_states()

    def _kept_states(self) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
        """Scattered states, found once for a mechanism and its parameters."""
        memory, key = self.numeric.eom.mechanism.memory, ("scattered states", self.numeric.p.tobytes())
        if key not in memory:
            memory[key] = self._scattered()
        return memory[key]

    def _scattered(self) -> list[tuple[float, np.ndarray, np.ndarray, np.ndarray]]:
        """Consistent states about the estimate."""
        numeric, random = self.numeric, np.random.default_rng(1)
        q0, v0, z0 = numeric.eom.estimate
        found: list[tuple[float, np.ndarray, np.ndarray, np.ndarray]] = []
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

    def gradients(self, expressions: ca.SX, state: tuple) -> np.ndarray:
        """Gradients of expressions at a state, scaled to size one by row."""
        eom, key = self.numeric.eom, tuple(e.element_hash() for e in ca.vertsplit(expressions))
        if key not in self._functions:
            arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, self._own]
            slopes = ca.jacobian(expressions, self._x)
            self._functions[key] = Evaluator(ca.Function("gradients", arguments, [slopes]))
        rows = self._functions[key](*state, self.numeric.p, np.ones(self._own.numel()))[0]
        return unit_rows(rows * self._columns)

    def constraints_span(self, state: tuple) -> np.ndarray:
        """Orthonormal basis of the gradients of the constraints at a state, by row."""
        key = state[1].tobytes()
        if key not in self._spans:
            self._spans[key] = _span(self.gradients(self._constraints, state))
        return self._spans[key]

    def span(self, state: tuple, given: Sequence[Condition]) -> np.ndarray:
        """Orthonormal basis of the gradients of the constraints and of conditions at a state, by row."""
        constraints = self.constraints_span(state)
        if not given:
            return constraints
        rows = self.gradients(stacked(given), state)
        return np.vstack([constraints, _span(rows - rows @ constraints.T @ constraints, DEPENDENT)])

    def fixed(self, conditions: Sequence[Condition], given: Sequence[Condition] = ()) -> list[bool]:
        """Which conditions depend on the constraints, and on other conditions given, at every state."""
        if not conditions or not self.states:
            return [False] * len(conditions)
        result = np.ones(len(conditions), bool)
        for state in self.states:
            span = self.span(state, given)
            rows = self.gradients(stacked(conditions), state)
            result &= np.linalg.norm(rows - rows @ span.T @ span, axis=1) <= DEPENDENT
        return result.tolist()

    def count(self, conditions: Sequence[Condition], given: Sequence[Condition] = ()) -> int:
        """How many of the conditions are independent of each other, of the constraints, and of others given."""
        counts = [len(conditions)] if not self.states or not conditions else []
        for state in self.states if conditions else []:
            span = self.span(state, given)
            rows = self.gradients(stacked(conditions), state)
            counts.append(analyse_rank(rows - rows @ span.T @ span, DEPENDENT).rank)
        return max(counts)

    def independent(
        self, conditions: Sequence[Condition], state: tuple, given: Sequence[Condition] = ()
    ) -> list[Condition]:
        """Conditions independent of others given: those on positions first, of these the steepest at a state."""
        kept: list[Condition] = []
        for level in (False, True):
            group = [c for c in conditions if c.depends_on("velocity") is level]
            count, before = self.count(group, [*given, *kept]), [*given, *kept]
            if count < len(group):
                span = self.span(state, before)
                rows = self.gradients(stacked(group), state)
                order = np.argsort(-np.linalg.norm(rows - rows @ span.T @ span, axis=1), kind="stable")
                chosen: list[Condition] = []
                for k in order.tolist():
                    if self.count([*chosen, group[k]], before) > len(chosen):
                        chosen.append(group[k])
                group = [c for c in group if c in chosen]
            kept += group
        return [c for c in conditions if c in kept]

    def meets_singular(self, conditions: Sequence[Condition], state: tuple) -> bool:
        """Whether conditions that are independent elsewhere depend on the constraints at a state: atop a circle."""
        span = self.constraints_span(state)
        rows = self.gradients(stacked(conditions), state)
        left = np.linalg.svd(rows - rows @ span.T @ span, compute_uv=False)
        return len(left) < len(conditions) or bool(np.min(left, initial=1.0) < SINGULAR)

    def complete(self, conditions: Sequence[Condition]) -> bool:
        """Whether conditions and constraints together decide the whole state, but for the branch."""
        return any(len(self.span(state, conditions)) >= self._unknowns for state in self.states)


def _span(rows: np.ndarray, least: float = 0.0) -> np.ndarray:
    """Orthonormal basis of the rows, by row."""
    _, values, right = np.linalg.svd(rows, full_matrices=False)
    return right[: int(np.sum(values > max(1e-9 * np.max(values, initial=0.0), least)))]


def on_states(conditions: Sequence[Condition]) -> list[Condition]:
    """Conditions that positions, velocities and first-order states decide."""
    return [c for c in conditions if not c.depends_on("acceleration", "multiplier", "input", "input rate")]


def own_limits(mechanism: Mechanism) -> dict[Condition, tuple[Symbol, int]]:
    """Limits that inputs and first-order states carry themselves, with the symbol and the side."""
    found = {}
    for symbol in (*mechanism.inputs, *mechanism.states):
        for sign, bound in ((1, symbol.upper), (-1, symbol.lower)):
            if np.isfinite(bound):
                text = f"{symbol.label} {'<=' if sign > 0 else '>='} {bound:g}"
                found[Condition(sign * (symbol - bound), False, text)] = symbol, sign
    return found


def check_conditions(problem: OptimalControlProblem) -> None:
    """Refuse conditions that contradict each other, and those that the constraints already fix.

    Mechanisms of hundreds of bodies are left to the solver.

    Raises
    ------
    ConditionError
        Naming the conditions.
    """
    _refuse_empty_limits(problem)
    _refuse_fixed_path(problem)
    if not isinstance(problem.initial, State):
        check_end(problem, "initial", problem.initial)
    if not isinstance(problem.final, State):
        check_end(problem, "final", [*problem.final, *_at_end_alone(problem)])
    for k, waypoint in enumerate(problem.waypoints, start=1):
        check_end(problem, f"waypoint {k}", waypoint.conditions, waypoint.time[1])


def _at_end_alone(problem: OptimalControlProblem) -> list[Condition]:
    """Boundary conditions that speak of the end alone, as conditions there."""
    found = []
    for condition in problem.boundary:
        if all(p.kind == "at_end" for p in placeholders_in(condition.expression)):
            expression = with_values(condition.expression, lambda p: p.expression)
            found.append(Condition(expression, condition.equality, condition.label))
    return found


def _refuse_fixed_path(problem: OptimalControlProblem) -> None:
    """Refuse path equalities that the constraints decide."""
    eom = problem.equations
    rows = on_states([c for c in problem.path if c.equality])
    if not rows or eom.q.numel() * eom.lam.numel() > LARGE:
        return
    free = ca.vertcat(ca.SX(0, 1), *problem.free_parameters)
    fixed = ConditionRank(NumericEquations(eom, eom.parameter_values), free).fixed(rows)
    if any(fixed):
        label = rows[fixed.index(True)].label
        raise ConditionError(f"path: {label} is already decided by the constraints alone; leave it out")


def check_end(
    problem: OptimalControlProblem, name: str, conditions: Sequence[Condition], time: float | None = None
) -> None:
    """Check the conditions at the start, at the end, or at another time of a motion."""
    eom = problem.equations
    rows = on_states([c for c in conditions if c.equality])
    if not rows or eom.q.numel() * eom.lam.numel() > LARGE:
        return
    free = [*problem.free_parameters] + ([eom.t] if name != "initial" and problem.has_free_times else [])
    ranks = ConditionRank(NumericEquations(eom, eom.parameter_values), ca.vertcat(ca.SX(0, 1), *free))
    for condition, fixed in zip(rows, ranks.fixed(rows), strict=True):
        if fixed:
            raise ConditionError(f"{name}: {condition.label} is already decided by the constraints alone; leave it out")
    limits = on_states([c for c in problem.path if not c.equality])
    limits = [c for c, fixed in zip(limits, ranks.fixed(limits, rows), strict=True) if fixed]
    contradiction = ranks.count(rows) < len(rows)
    if not limits and not contradiction:
        return
    try:
        when = 0.0 if name == "initial" else problem.duration[1] if time is None else time
        with warnings.catch_warnings():  # what is found is not used as a pose: the branch does not matter
            warnings.simplefilter("ignore", MechanismWarning)
            state = assemble_at(ranks.numeric, rows, when, read_signals(eom, None))
    except (AssemblyError, ConditionError) as error:
        if contradiction:
            raise ConditionError(f"{name}: the conditions contradict each other or the constraints: {error}") from None
        return  # whether the linkage reaches there is for the solver to find out
    for limit in limits:
        amount = float(state[limit.expression])
        if amount > COUNTS * (1 + abs(float(state[limit.expression.dep(0)]) if limit.expression.n_dep() else 0.0)):
            raise ConditionError(f"{name}: the conditions contradict the path condition {limit.label} by {amount:.3g}")


def _refuse_empty_limits(problem: OptimalControlProblem) -> None:
    """Refuse limits of one quantity that leave nothing between them."""
    sides: list[tuple[ca.SX, str]] = []
    for condition in problem.path:
        sides.append((condition.expression, condition.label))
        if condition.equality:
            sides.append((-condition.expression, condition.label))
    sides += [(limit.expression, limit.label) for limit in own_limits(problem.mechanism)]
    for (one, first), (other, second) in itertools.combinations(sides, 2):
        gap = _constant(one + other)
        if gap is not None and gap > 1e-12 and first != second:
            raise ConditionError(f"path: {first} and {second} contradict each other by {gap:.6g}")


def _constant(expression: Any) -> float | None:
    """Value of an expression that depends on nothing, though symbols occur in it; else None."""
    symbols = symbols_of(expression)
    vector = ca.vertcat(ca.SX(0, 1), *symbols)
    function = ca.Function("sum", [vector], [expression, ca.densify(ca.jacobian(expression, vector))])
    random = np.random.default_rng(2)
    values = []
    for _ in range(2):
        value, slopes = function(random.uniform(0.5, 1.5, len(symbols)))
        if not np.max(np.abs(slopes.full()), initial=0.0) <= 1e-12:
            return None
        values.append(float(value))
    return values[0] if abs(values[0] - values[1]) <= 1e-9 * (1 + abs(values[0])) else None
