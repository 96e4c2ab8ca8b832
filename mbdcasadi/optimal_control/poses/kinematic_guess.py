"""Poses on the way from the start through the waypoints to the end, by continuation.

The conditions of the next place are moved in steps from the value that they
have in the last pose to their target; each pose is assembled from the one
before. A straight line in the coordinates would tear closed loops apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...assembly.followed_states import without_servos
from ...assembly.pose import LARGEST_TURN, PoseProblem
from ...equations.numeric import NumericEquations
from ...errors import AssemblyError
from ...model.conditions import Condition, stacked
from ...model.placeholders import Placeholder, placeholders_in, with_values
from ...model.symbols import Parameter
from ...numerics.console import without_warnings
from ...numerics.least_squares import largest, least_norm
from ...numerics.newton import solve
from ...numerics.tolerances import MET
from ...results.state import State
from ..statement.phase import BEYOND_STATES, Phase, contains_any, with_parameters
from ..statement.state_conditions import pose_conditions
from ..statement.statement import ProblemStatement
from .linear_conditions import straight_path

#: Largest number of steps from place to place, and of parts of a step at high speed.
STEPS, SUBSTEPS = 40, 20


@dataclass(frozen=True)
class KinematicPath:
    """Poses of a phase from its start through the waypoints to its end."""

    #: of start, waypoints and end, s
    segment_times: np.ndarray
    #: of the poses (k,), s
    times: np.ndarray
    #: (k, n)
    poses: np.ndarray
    #: whether the linkage was seen to reach all places
    complete: bool = True

    def pose_at(self, time: float) -> np.ndarray:
        """The pose nearest to a time."""
        pose: np.ndarray = self.poses[int(np.argmin(np.abs(self.times - time)))]
        return pose


def kinematic_path(
    problem: ProblemStatement,
    phase: Phase,
    numeric: NumericEquations,
    start: State,
    segment_times: np.ndarray,
    values: Mapping[Parameter, float] | None = None,
    poses: Mapping[int, np.ndarray] | None = None,
    *,
    through: bool = True,
) -> KinematicPath:
    """Return poses that meet the conditions of the places on the way, as far as they are equalities in positions.

    `segment_times` are those of start, waypoints and end, s. `poses` by the index of these may take the place of
    conditions, and `values` that of the free parameters' own. Conditions of waypoints are met unless `through` is
    False. Drivers that follow states do not hold the pose: the states follow it, see :func:`led_states`.
    """
    numeric = without_servos(numeric)
    own = {p: phase.mechanism.value_of(p, p.value) for p in problem.extra_parameters(phase)}
    extra = own if values is None else {p: values[p] for p in own}
    final, given, places = phase.final, poses or {}, list[list[Condition]]()
    if not isinstance(final, State) and len(phase.waypoints) + 1 not in given:
        final = (*final, *_periodic(problem, phase, start))
    for k, stated in enumerate([*(w.conditions if through else () for w in phase.waypoints), final], start=1):
        if k in given:
            places.append(pose_conditions(numeric, float(segment_times[k]), given[k]))
        elif isinstance(stated, State):
            places.append(pose_conditions(numeric, stated.t, stated.q))
        else:
            places.append(_on_positions(stated, extra))
    prescribed = problem.differentiated_path_constraints(phase)
    speeds = [c for c in prescribed if c.depends_on("velocity")]
    return _Way(numeric, start, _on_positions(phase.path, extra), speeds).through(places, segment_times)


def has_free_path(problem: ProblemStatement, phase: Phase) -> bool:
    """Return True if no condition after the start contains positions: the motion may go anywhere."""
    if isinstance(phase.final, State):
        return False
    later = [*phase.conditions, *problem.boundary]
    inner = [p.expression for c in later for p in placeholders_in(c.expression)]
    prescribed = problem.differentiated_path_constraints(phase)
    positions = [c for c in later if c.equality and c.depends_on("position")]
    return not positions and not prescribed and not any(Condition(e, True, "").depends_on("position") for e in inner)


class _Way:
    """The way from a start through places, on which path conditions on positions, and those on speeds, hold."""

    def __init__(self, numeric: NumericEquations, start: State, path: list[Condition], speeds: list[Condition]):
        self._numeric, self._start, self._path, self._speeds = numeric, start, path, speeds

    def through(self, places: list[list[Condition]], segment_times: np.ndarray) -> KinematicPath:
        """Poses through places with conditions, of which the last one is the end."""
        begin = float(segment_times[0])
        times, poses, complete = [np.array([begin])], [self._start.q], True
        for k, conditions in enumerate(places):
            if conditions or k == len(places) - 1:  # a place without conditions is passed on the way to the next one
                span = np.linspace(begin, segment_times[k + 1], STEPS + 1)
                times.append(span[1:])
                if conditions or not (np.any(self._start.v) or self._speeds):
                    leg, reached = self._leg(conditions, poses[-1], span)
                    poses += leg
                    complete = complete and reached
                else:
                    poses += self._coasting(poses[-1], span)
                begin = float(segment_times[k + 1])
        return KinematicPath(segment_times, np.concatenate(times), np.array(poses), complete)

    def _place(self, conditions: list[Condition], time: float) -> PoseProblem:
        return PoseProblem(self._numeric, conditions, float(time), self._start.z)

    def _leg(self, conditions: list[Condition], q: np.ndarray, span: np.ndarray) -> tuple[list[np.ndarray], bool]:
        """Poses from one place to the next, and whether this is reached; if not, the last pose is repeated."""
        rows, numeric = [*conditions, *self._path], self._numeric
        if not rows and not numeric.eom.nu.numel():
            return [q] * (span.size - 1), True
        straight = None if self._path else straight_path(numeric, conditions, q, self._start.z, span)
        if straight is not None:
            return list(straight), True
        place = self._place(rows, span[0])
        poses = self._steps(place, conditions, self._path, q, span)
        if len(poses) == span.size - 1:
            return poses, True
        if not poses:  # if the path ends further on: whether it continues is for the solver to find out
            poses = self._to_assembled_pose(place, q, span)
        missing = span.size - 1 - len(poses)
        poses += [poses[-1] if poses else q] * missing
        # the coordinates that steer may lead to a pose of another branch
        return poses, not missing and largest(place.values(rows, poses[-1])) <= MET

    def _steps(
        self, place: PoseProblem, conditions: list[Condition], path: list[Condition], q: np.ndarray, span: np.ndarray
    ) -> list[np.ndarray]:
        """Poses at the times of a span after the first, with conditions moved evenly to zero, as far as they exist."""
        first, poses, numeric = place.values(conditions, q), list[np.ndarray](), self._numeric
        for k in range(1, span.size):
            place.t = float(span[k])
            offset = np.r_[(1 - k / (span.size - 1)) * first, np.zeros(len(path))]
            rows = place.rows_with([*conditions, *path], offset)
            outcome = solve(rows, q, numeric.projection_weights, iterations=30, step_limit=numeric.typical_step)
            if not outcome.converged:
                break
            q = outcome.x
            poses.append(q)
        return poses

    def _to_assembled_pose(self, place: PoseProblem, q: np.ndarray, span: np.ndarray) -> list[np.ndarray]:
        """Poses to one that meets all conditions, steered by its coordinates; none if no such pose is found.

        Conditions may be met together without a path on which each moves evenly:
        both coordinates of a point on a circle.
        """
        place.t = float(span[-1])
        try:
            with without_warnings():
                target = place.solve(q)
        except AssemblyError:
            return []
        steering = pose_conditions(self._numeric, place.t, target)
        poses = self._steps(self._place(steering, span[0]), steering, [], q, span)
        return poses if len(poses) == span.size - 1 else []

    def _coasting(self, q: np.ndarray, span: np.ndarray) -> list[np.ndarray]:
        """Poses passed at prescribed speeds or, else, at the speed of the start, as straight as the joints let it."""
        numeric, eom, path = self._numeric, self._numeric.eom, self._path
        place, rows = self._place(path, span[0]), stacked(self._speeds)
        slopes = ca.Function(
            "speeds", [eom.t, eom.q, eom.v, eom.p], [ca.densify(ca.jacobian(rows, eom.v)), ca.densify(rows)]
        )
        v, poses = self._start.v, []
        for before, now in itertools.pairwise(span.tolist()):
            turn = largest(v[eom.angles]) * (now - before)
            count = int(np.clip(np.ceil(turn / LARGEST_TURN), 1, SUBSTEPS))
            for k in range(1, count + 1):
                place.t = before + (now - before) * k / count
                moved = q + (now - before) / count * v
                outcome = solve(place.rows_with(path), moved, numeric.projection_weights, iterations=30)
                q = outcome.x if outcome.converged else q
                jacobian, nu = numeric.velocity(place.t, q, place.z)
                slope, missing = (part.full() for part in slopes(place.t, q, v, numeric.p))
                residual = np.r_[jacobian @ v - nu, missing.ravel()]
                v = v - least_norm(np.vstack([jacobian, slope]), residual, numeric.column_scale**-2)
            poses.append(q)
        return poses


def _on_positions(conditions: Sequence[Condition], extra: Mapping[Parameter, float]) -> list[Condition]:
    """Equalities in positions, with values substituted for parameters that the mechanism does not have."""
    rows = [c for c in conditions if c.equality and c.depends_on("position")]
    rows = [c for c in rows if not c.depends_on("velocity", *BEYOND_STATES)]
    return with_parameters(rows, list(extra), extra)


def _periodic(problem: ProblemStatement, phase: Phase, start: State) -> list[Condition]:
    """Boundary conditions as conditions at the end, with the values at the start substituted."""

    def value(placeholder: Placeholder) -> Any:
        inner = placeholder.expression
        return float(start[inner]) if placeholder.kind == "at_start" else inner

    eom, extra, rows = phase.equations, problem.extra_parameters(phase), []
    unknown_at_start = ca.vertcat(eom.a, eom.lam, eom.u, phase.input_rates)
    for condition in problem.boundary:
        placeholders = placeholders_in(condition.expression)
        if not {p.kind for p in placeholders} <= {"at_start", "at_end"} or not condition.equality:
            continue
        if any(contains_any(p.expression, extra) for p in placeholders):
            continue
        if any(p.kind == "at_start" and ca.depends_on(p.expression, unknown_at_start) for p in placeholders):
            continue
        rows.append(Condition(with_values(condition.expression, value), True, condition.label))
    return rows
