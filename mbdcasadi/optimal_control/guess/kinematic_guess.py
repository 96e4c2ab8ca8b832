"""Poses on the way from the start through the waypoints to the end, by continuation.

The conditions of the next place are moved in steps from the value that they
have in the last pose to their target; each pose is assembled from the one
before. A straight line in the coordinates would tear closed loops apart.
"""

from __future__ import annotations

import itertools
import warnings
from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...assembly.pose import LARGEST_TURN, PoseProblem
from ...equations.numeric import LARGE, NumericEquations
from ...errors import AssemblyError, MechanismWarning, ModelError
from ...model.conditions import Condition, stacked
from ...model.symbols import symbols_of
from ...numerics.least_squares import largest
from ...numerics.newton import solve
from ...numerics.rank import dependent_rows, unit_rows
from ...results.state import State
from ..constraints import held_conditions
from ..placeholders import Placeholder, placeholders_in, with_values
from ..problem import OptimalControlProblem
from .linear_conditions import straight_way

#: Steps from place to place, and parts of a step at great speed, at the most.
STEPS, SUBSTEPS = 40, 20
#: Rows of a unit gradient that are nearer to others than this are not used to steer by.
TOO_NEAR = 1e-3


def nominal_marks(problem: OptimalControlProblem, duration: float) -> np.ndarray:
    """Times of start, waypoints and end to begin with: free ones in the middle of what they may be."""
    marks = [0.0]
    spans = [w.time for w in problem.waypoints]
    for k, (low, high) in enumerate(spans):
        latest = min([duration, *[s[1] for s in spans[k + 1 :]]])
        high, low = min(high, latest), max(low, marks[-1])
        left = len(spans) - k + 1  # phases that are still to come
        even = marks[-1] + (latest - marks[-1]) / left
        marks.append(low if low == high else float(np.clip(even, low, high)))
    marks.append(duration)
    lengths = np.diff(marks)
    if np.any(lengths <= 0):
        raise ModelError(f"the times of the waypoints {marks[1:-1]} leave no motion between them")
    return np.array(marks)


def kinematic_poses(
    problem: OptimalControlProblem, numeric: NumericEquations, start: State, marks: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Times (k,) and poses (k, n) from the start through the waypoints to the end.

    Parameters
    ----------
    problem : OptimalControlProblem
        Whose conditions are met, as far as they are equalities in positions.
    numeric : NumericEquations
        Equations at given parameters.
    start : State
        First state.
    marks : numpy.ndarray
        Times of start, waypoints and end, s.
    """
    held = _on_positions(problem, problem.path)
    speeds = [c for c in held_conditions(problem) if c.depends_on("velocity")]
    places = [_on_positions(problem, w.conditions) for w in problem.waypoints]
    last = problem.final
    if isinstance(last, State):
        places.append(_steering(numeric, last.t, last.q))
    else:
        places.append(_on_positions(problem, [*last, *_periodic(problem, start)]))
    times, poses, begin = [np.zeros(1)], [start.q], 0.0
    for k, conditions in enumerate(places):
        if conditions or k == len(places) - 1:  # a place without conditions is passed on the way to the next one
            span = np.linspace(begin, marks[k + 1], STEPS + 1)
            times.append(span[1:])
            if conditions or not (np.any(start.v) or speeds):
                poses += _leg(numeric, conditions, held, poses[-1], start.z, span)
            else:
                poses += _coasting(numeric, held, speeds, start, poses[-1], span)
            begin = float(marks[k + 1])
    return np.concatenate(times), np.array(poses)


def goes_nowhere(problem: OptimalControlProblem) -> bool:
    """Whether no condition after the start speaks of positions: the motion may go where it likes."""
    if isinstance(problem.final, State):
        return False
    later = [*problem.final, *problem.path, *problem.boundary, *(c for w in problem.waypoints for c in w.conditions)]
    inner = [p.expression for c in later for p in placeholders_in(c.expression)]
    held = held_conditions(problem)
    positions = [c for c in later if c.equality and c.depends_on("position")]
    return not positions and not held and not any(Condition(e, True, "").depends_on("position") for e in inner)


def _leg(
    numeric: NumericEquations,
    conditions: list[Condition],
    held: list[Condition],
    q: np.ndarray,
    z: np.ndarray,
    span: np.ndarray,
) -> list[np.ndarray]:
    """Poses from one place to the next; the last one stays where the linkage does not reach further."""
    rows = [*conditions, *held]
    if not rows and not numeric.eom.nu.numel():
        return [q] * (span.size - 1)
    straight = None if held else straight_way(numeric, conditions, q, z, span)
    if straight is not None:
        return list(straight)
    place = PoseProblem(numeric, rows, float(span[0]), z)
    first = place.values(conditions, q)
    path: list[np.ndarray] = []
    for k in range(1, span.size):
        place.t = float(span[k])
        offset = np.r_[(1 - k / (span.size - 1)) * first, np.zeros(len(held))]
        outcome = solve(
            place.rows_with(rows, offset), q, numeric.weights, iterations=30, step_limit=numeric.typical_step
        )
        if not outcome.converged:
            return _towards_found(numeric, place, q, z, span) or path + [q] * (span.size - 1 - len(path))
        q = outcome.x
        path.append(q)
    return path


def _towards_found(
    numeric: NumericEquations, place: PoseProblem, q: np.ndarray, z: np.ndarray, span: np.ndarray
) -> list[np.ndarray]:
    """Poses to one that meets all conditions, steered by its coordinates; none where no such pose is found.

    Conditions may be met together without a way on which each moves evenly:
    both coordinates of a point on a circle.
    """
    if place.t != span[1]:  # the way broke off further on: whether it goes on is for the solver to find out
        return []
    place.t = float(span[-1])
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", MechanismWarning)
            target = place.solve(q)
    except AssemblyError:
        return []
    path: list[np.ndarray] = []
    steering = _steering(numeric, float(span[-1]), target)
    way = PoseProblem(numeric, steering, float(span[0]), z)
    first = way.values(steering, q)
    for k in range(1, span.size):
        way.t = float(span[k])
        rows = way.rows_with(steering, (1 - k / (span.size - 1)) * first)
        outcome = solve(rows, q, numeric.weights, iterations=30, step_limit=numeric.typical_step)
        if not outcome.converged:
            return []
        q = outcome.x
        path.append(q)
    return path


def _coasting(
    numeric: NumericEquations,
    held: list[Condition],
    speeds: list[Condition],
    start: State,
    q: np.ndarray,
    span: np.ndarray,
) -> list[np.ndarray]:
    """Poses passed at speeds that are held or, else, at the speed of the start, as straight as the joints let it."""
    eom = numeric.eom
    place = PoseProblem(numeric, held, float(span[0]), start.z)
    rows = stacked(speeds)
    slopes = ca.Function(
        "speeds", [eom.t, eom.q, eom.v, eom.p], [ca.densify(ca.jacobian(rows, eom.v)), ca.densify(rows)]
    )
    v, path = start.v, []
    for before, now in itertools.pairwise(span.tolist()):
        turn = largest(v[eom.angles]) * (now - before)
        count = int(np.clip(np.ceil(turn / LARGEST_TURN), 1, SUBSTEPS))
        for k in range(1, count + 1):
            place.t = before + (now - before) * k / count
            moved = q + (now - before) / count * v
            outcome = solve(place.rows_with(held), moved, numeric.weights, iterations=30)
            q = outcome.x if outcome.converged else q
            jacobian, nu = numeric.velocity(place.t, q)
            slope, missing = (part.full() for part in slopes(place.t, q, v, numeric.p))
            residual = np.r_[jacobian @ v - nu, missing.ravel()]
            scaled = np.vstack([jacobian, slope]) * numeric.column_scale
            v = v - numeric.column_scale * np.linalg.lstsq(scaled, residual, rcond=1e-9)[0]
        path.append(q)
    return path


def _on_positions(problem: OptimalControlProblem, conditions: Sequence[Condition]) -> list[Condition]:
    """Equalities in positions, with the values of the problem's own parameters put in."""
    others = ("velocity", "acceleration", "multiplier", "input", "input rate")
    found = [c for c in conditions if c.equality and c.depends_on("position") and not c.depends_on(*others)]
    own = ca.vertcat(ca.SX(0, 1), *problem.own_parameters)
    values = ca.DM([p.value for p in problem.own_parameters])
    return [Condition(ca.substitute(c.expression, own, values), True, c.label) for c in found] if own.numel() else found


def _periodic(problem: OptimalControlProblem, start: State) -> list[Condition]:
    """Boundary conditions as conditions at the end, with the start's values put in."""

    def value(placeholder: Placeholder) -> Any:
        inner = placeholder.expression
        return float(start[inner]) if placeholder.kind == "at_start" else inner

    found = []
    own = {p.element_hash() for p in problem.own_parameters}
    for condition in problem.boundary:
        placeholders = placeholders_in(condition.expression)
        inner = [s.element_hash() for p in placeholders for s in symbols_of(p.expression)]
        kinds = {p.kind for p in placeholders}
        if not kinds <= {"at_start", "at_end"} or own & {*inner} or not condition.equality:
            continue
        if any(p.kind == "at_start" and _unknown_at_start(p.expression, problem) for p in placeholders):
            continue
        found.append(Condition(with_values(condition.expression, value), True, condition.label))
    return found


def _unknown_at_start(expression: ca.SX, problem: OptimalControlProblem) -> bool:
    eom = problem.equations
    return bool(ca.depends_on(expression, ca.vertcat(eom.a, eom.lam, eom.u, problem.u_rate)))


def _steering(numeric: NumericEquations, t: float, target: np.ndarray) -> list[Condition]:
    """Independent coordinates of a pose and their values; angles first, since they know the number of turns."""
    eom = numeric.eom
    symbols = ca.vertsplit(eom.q)
    order = [*np.flatnonzero(eom.angles).tolist(), *np.flatnonzero(~eom.angles).tolist()]
    conditions = [Condition(symbols[k] - float(target[k]), True, symbols[k].name()) for k in order]
    if eom.q.numel() * eom.lam.numel() > LARGE:
        return conditions
    joints = unit_rows(numeric.velocity(t, target)[0] * numeric.column_scale)
    coordinates = np.eye(eom.q.numel())[order]
    dependent = set(dependent_rows(np.vstack([joints, coordinates]), TOO_NEAR))
    return [c for k, c in enumerate(conditions) if k + len(joints) not in dependent]
