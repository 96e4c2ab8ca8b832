"""Consistency of the conditions of a problem, checked before anything is solved."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial

import casadi as ca
import numpy as np

from ...arguments.inputs import read_signals
from ...assembly.consistent_start import consistent_start
from ...assembly.pose import PoseProblem
from ...equations.numeric import NumericEquations
from ...errors import AssemblyError, ConditionError, ModelError
from ...model.conditions import Condition, stacked
from ...model.mechanism import Mechanism
from ...model.placeholders import placeholders_in, with_values
from ...model.symbols import Symbol, symbols_of
from ...numerics.console import without_warnings
from ...numerics.evaluation import Evaluator
from ...numerics.newton import solve
from ...numerics.tolerances import MET
from ...results.state import State
from ..statement.condition_rank import ConditionRank, ranks_of
from ..statement.phase import Phase, contains_any, on_positions, on_states
from ..statement.statement import ProblemStatement
from .free_poses import PosedPlace, free_poses

#: Random poses from which other branches of a linkage are looked for.
BRANCHES = 48


def own_limits(mechanism: Mechanism) -> dict[Condition, tuple[Symbol, int]]:
    """Limits that inputs and first-order states carry themselves, with the symbol and the side."""
    kept: dict[Condition, tuple[Symbol, int]] = mechanism.cache.get_or_create(
        "own limits", partial(_own_limits, mechanism)
    )
    return kept


def _own_limits(mechanism: Mechanism) -> dict[Condition, tuple[Symbol, int]]:
    limits = {}
    for symbol in (*mechanism.inputs, *mechanism.states):
        low = Condition(symbol.lower - symbol, False, f"{symbol.label} >= {symbol.lower:g}")
        high = Condition(symbol - symbol.upper, False, f"{symbol.label} <= {symbol.upper:g}")
        if np.isfinite(symbol.lower):
            limits[low] = symbol, -1
            high = replace(high, opposite=low, span=symbol.upper - symbol.lower)
        if np.isfinite(symbol.upper):
            limits[high] = symbol, 1
    return limits


def check_conditions(problem: ProblemStatement) -> None:
    """Refuse conditions that contradict each other, and those that the constraints already fix.

    Mechanisms of hundreds of bodies are left to the solver.
    """
    problem.shared.get_or_create_quietly("consistent", partial(_check_conditions, problem))


def _check_conditions(problem: ProblemStatement) -> None:
    _refuse_if_nothing_is_free(problem)
    for phase in problem.phases:
        with naming_phase(problem, phase):
            _check_phase(problem, phase)


@contextmanager
def naming_phase(problem: ProblemStatement, phase: Phase) -> Iterator[None]:
    """Give errors about conditions the name of their phase, if there are several."""
    try:
        yield
    except ConditionError as error:
        if len(problem.phases) == 1:
            raise
        raise ConditionError(f"phase '{phase.name}': {error}") from None


def _check_phase(problem: ProblemStatement, phase: Phase) -> None:
    _refuse_empty_limits(phase)
    _refuse_fixed_path(problem, phase)
    if not isinstance(phase.initial, State):
        check_end(problem, phase, "initial", phase.initial)
    if phase.is_instant:
        return
    if not isinstance(phase.final, State):
        boundary = at_end_alone(problem) if phase is problem.phases[-1] else []
        check_end(problem, phase, "final", [*phase.final, *boundary])
    for k, waypoint in enumerate(phase.waypoints, start=1):
        check_end(problem, phase, f"waypoint {k}", waypoint.conditions, waypoint.time[1])


def _refuse_if_nothing_is_free(problem: ProblemStatement) -> None:
    """Refuse a problem whose motion is decided: by a start that is given whole, without inputs, parameters or times."""
    first = problem.phases[0]
    inputs = any(phase.mechanism.inputs for phase in problem.phases)
    if inputs or problem.free_parameters or problem.has_free_times or first.equations.is_large:
        return
    if not isinstance(first.initial, State):
        rows = on_states([c for c in first.initial if c.equality])
        numeric = NumericEquations(first.equations, first.equations.parameter_values)
        if not ranks_of(problem, first, numeric, timed=False).complete(rows):
            return
    raise ModelError(
        "there is nothing to optimise: the mechanism has no inputs, no parameter or time is free, and initial= gives "
        "the whole start"
    )


def at_end_alone(problem: ProblemStatement) -> list[Condition]:
    """Boundary conditions that contain values at the end alone, as conditions there."""
    rows = []
    for condition in problem.boundary:
        if all(p.kind == "at_end" and p.phase is None for p in placeholders_in(condition.expression)):
            expression = with_values(condition.expression, lambda p: p.expression)
            rows.append(Condition(expression, condition.equality, condition.label, definition=condition.definition))
    return rows


def _refuse_fixed_path(problem: ProblemStatement, phase: Phase) -> None:
    """Refuse path equalities that the constraints decide."""
    eom = phase.equations
    rows = on_states([c for c in phase.path if c.equality])
    if not rows or eom.is_large:
        return
    fixed = ranks_of(problem, phase, NumericEquations(eom, eom.parameter_values), timed=False).fixed(rows)
    if any(fixed):
        raise ConditionError(f"path: {_decided(rows[fixed.index(True)])}")


def _decided(condition: Condition) -> str:
    """Reason and remedy for a condition that the constraints decide."""
    remedy = "state the other components alone" if condition.component else "leave it out"
    return f"{condition.label} is already decided by the constraints alone; {remedy}"


def check_end(
    problem: ProblemStatement, phase: Phase, name: str, conditions: Sequence[Condition], time: float | None = None
) -> None:
    """Check the conditions at the start, at the end, or at another time of a phase.

    A :class:`ConditionError` names a condition that the constraints decide, or conditions that contradict each other or
    a path limit.
    """
    eom = phase.equations
    rows = on_states([c for c in conditions if c.equality])
    if not rows or eom.is_large:
        return
    ranks = ranks_of(problem, phase, NumericEquations(eom, eom.parameter_values), timed=name != "initial")
    for condition, fixed in zip(rows, ranks.fixed(rows), strict=True):
        if fixed:
            raise ConditionError(f"{name}: {_decided(condition)}")
    limits = _limits_of_states(phase)
    limits = [c for c, fixed in zip(limits, ranks.fixed(limits, rows), strict=True) if fixed]
    contradiction = ranks.count(rows) < len(rows)
    if not contradiction:
        limits = _left_open(limits, rows, ranks, name)
        if not limits:
            return
    when = 0.0 if name == "initial" else phase.span[1] if time is None else time
    try:
        state = _state_under(ranks.numeric, rows, when)
    except (AssemblyError, ConditionError) as error:
        if contradiction and not _may_be_met(problem, phase, ranks.numeric, name, rows, when):
            raise ConditionError(f"{name}: the conditions contradict each other or the constraints: {error}") from None
        return  # whether the linkage reaches there is looked at before the problem is solved
    broken = _broken(_excess(limits, state))
    if broken and name != "initial":  # a motion may end on another branch than that of the estimate
        broken = _broken_everywhere(broken, ranks.numeric, rows, when)
    _refuse_broken(f"{name}: the conditions contradict", broken)


def _may_be_met(
    problem: ProblemStatement,
    phase: Phase,
    numeric: NumericEquations,
    name: str,
    rows: Sequence[Condition],
    time: float,
) -> bool:
    """True if conditions that are not met near the estimate are in another pose, or with other free parameters."""
    if name != "initial" and _are_met_elsewhere(numeric, rows, time):
        return True
    return free_poses(problem, phase, numeric, [PosedPlace(time, rows)]) is not None


def _left_open(
    limits: Sequence[Condition], rows: Sequence[Condition], ranks: ConditionRank, name: str
) -> list[Condition]:
    """Limits on which conditions do not decide by linear equations alone; raises if these contradict one."""
    known = dict(zip(limits, ranks.values_under(limits, rows), strict=True))
    decided = {limit: (value, 1.0) for limit, value in known.items() if value is not None}
    _refuse_broken(f"{name}: the conditions contradict", decided)
    return [limit for limit in limits if known[limit] is None]


def refuse_beyond_limits(
    problem: ProblemStatement, phase: Phase, numeric: NumericEquations, name: str, given: State
) -> None:
    """Refuse a state, given at an end of a phase, that is beyond limits of the path; raises as :func:`check_end`.

    Limits that contain free parameters, or at a free end the time, are left to the solver.
    """
    eom = phase.equations
    is_open = name == "final" and phase.span[0] < phase.span[1]
    limits = [c for c in _limits_of_states(phase) if not contains_any(c.expression, problem.free_parameters)]
    limits = [c for c in limits if not (is_open and c.depends_on("time"))]
    time = phase.span[1] if name == "final" else 0.0
    a, lam = np.zeros(eom.a.numel()), np.zeros(eom.lam.numel())
    state = State(phase.mechanism, time, given.q, given.v, a, given.z, lam, eom.input_values, numeric.p)
    _refuse_broken(f"{name}: the state contradicts", _excess(limits, state))


def _limits_of_states(phase: Phase) -> list[Condition]:
    """Limits along a phase that positions, velocities and first-order states decide."""
    return on_states([*(c for c in phase.path if not c.equality), *own_limits(phase.mechanism)])


def _state_under(
    numeric: NumericEquations, rows: Sequence[Condition], time: float, near: np.ndarray | None = None
) -> State:
    """A state that meets conditions; raises as :func:`consistent_start` does."""
    with without_warnings():
        return consistent_start(numeric, rows, time, read_signals(numeric.eom, None), near)


def _are_met_elsewhere(numeric: NumericEquations, rows: Sequence[Condition], time: float) -> bool:
    """True if conditions that are more than the degrees of freedom are met together in a pose far from the estimate."""
    place = PoseProblem(numeric, [c for c in rows if on_positions(c.expression)], time, numeric.eom.estimate[2])
    equations = place.rows_with(place.equalities)
    for near in _random_poses(numeric):
        outcome = solve(equations, near, numeric.weights, step_limit=numeric.step_limit)
        if outcome.converged:
            try:
                _state_under(numeric, rows, time, outcome.x)
                return True
            except (AssemblyError, ConditionError):
                continue
    return False


def _random_poses(numeric: NumericEquations) -> Iterator[np.ndarray]:
    """Random poses around the estimate, which mostly do not meet the constraints."""
    random, turn = np.random.default_rng(0), 2 * np.pi * numeric.typical_step
    for _ in range(BRANCHES):
        yield numeric.eom.estimate[0] + turn * random.uniform(-1, 1, turn.size)


def _excess(limits: Iterable[Condition], state: State) -> dict[Condition, tuple[float, float]]:
    """Values of limits in a state, each with its size."""
    listed, eom = list(limits), state.equations
    if not listed:
        return {}

    def evaluator() -> Evaluator:
        parts = [c.expression.dep(0) if c.expression.n_dep() else ca.SX(0) for c in listed]
        return Evaluator(ca.Function("limits", [*eom.symbols], [ca.densify(ca.vertcat(stacked(listed), *parts))]))

    kept = eom.mechanism.cache.get_or_create(("limits of states", *listed), evaluator, bounded=True)
    excess, sizes = np.split(kept(*state.arguments)[0].ravel(), 2)
    if np.isnan(excess).any():
        state[stacked(listed)]  # an error that names the expression
    return dict(zip(listed, zip(excess.tolist(), (1 + np.abs(sizes)).tolist(), strict=True), strict=True))


def _broken(values: dict[Condition, tuple[float, float]]) -> dict[Condition, tuple[float, float]]:
    """Limits that are not met, with their values and sizes."""
    return {c: pair for c, pair in values.items() if pair[0] > MET * pair[1]}


def _broken_everywhere(
    broken: dict[Condition, tuple[float, float]], numeric: NumericEquations, rows: Sequence[Condition], time: float
) -> dict[Condition, tuple[float, float]]:
    """Limits that are broken on all branches that are found from random poses."""
    for near in _random_poses(numeric):
        try:
            there = _broken(_excess(broken, _state_under(numeric, rows, time, near)))
        except (AssemblyError, ConditionError):
            continue
        broken = {c: pair for c, pair in broken.items() if c in there}
        if not broken:
            break
    return broken


def _refuse_broken(what: str, values: dict[Condition, tuple[float, float]]) -> None:
    """Refuse limits that values at a place, each with its size, do not meet."""
    for limit, (amount, _size) in _broken(values).items():
        raise ConditionError(f"{what} the path condition {limit.label} by {limit.with_unit(amount)}")


def _refuse_empty_limits(phase: Phase) -> None:
    """Refuse limits of one quantity that leave nothing between them."""
    sides: list[tuple[ca.SX, str]] = []
    # an input may be fixed by its limits, and an equality implies limits
    alone = {condition.label for condition in phase.path if not condition.equality}
    for condition in phase.path:
        sides.append((condition.expression, condition.label))
        if condition.equality:
            sides.append((-condition.expression, condition.label))
    sides += [(limit.expression, limit.label) for limit in own_limits(phase.mechanism)]
    sums = _constant_sums([expression for expression, _ in sides])
    for (k, (_, first)), (j, (_, second)) in itertools.combinations(enumerate(sides), 2):
        gap = sums[k, j]
        if gap > 1e-12 and first != second:
            raise ConditionError(f"path: {first} and {second} contradict each other by {gap:.6g}")
        if abs(gap) <= 1e-12 and first != second and {first, second} <= alone:
            raise ConditionError(
                f"path: {first} and {second} leave nothing between them; write an equality (==) in their place"
            )


def _constant_sums(expressions: list[ca.SX]) -> np.ndarray:
    """Sums of two expressions each that depend on nothing, though symbols occur in them; else nan (k, k)."""
    stack = ca.vertcat(ca.SX(0, 1), *expressions)
    vector = ca.vertcat(ca.SX(0, 1), *symbols_of(stack))
    function = ca.Function("sums", [vector], [ca.densify(stack), ca.densify(ca.jacobian(stack, vector))])
    random = np.random.default_rng(2)
    points = [function(random.uniform(0.5, 1.5, vector.numel())) for _ in range(2)]
    values, slopes = (np.array([point[k].full() for point in points]) for k in range(2))
    sums = values + values.transpose(0, 2, 1)
    bend = np.abs(slopes[:, :, None, :] + slopes[:, None, :, :]).max(axis=(0, 3), initial=0.0)
    constant = (bend <= 1e-12) & (np.abs(sums[0] - sums[1]) <= 1e-9 * (1 + np.abs(sums[0])))
    return np.where(constant, sums[0], np.nan)
