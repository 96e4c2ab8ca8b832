"""Limits that a solution touches, when it does, and what they cost."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import casadi as ca
import numpy as np

from ...model.conditions import Condition, stacked
from ...numerics.real import stretches
from ...results.state import State
from ..program.limit_sides import Side, sides_of
from ..statement.phase import BEYOND_STATES, with_rates
from ..transcription.rows import FINAL, INITIAL, PATH, Place, RowKind, RowName
from .limit_excess import points_of
from .solved_motion import SolvedMotion

#: Share of its size by which a soft limit must be passed to be reported: interior points come up to a tenth of it.
PASSED = 1e-4


@dataclass(frozen=True)
class ActiveLimit:
    """A limit that is active.

    Attributes
    ----------
    label : str
        The limit.
    spans : tuple of (float, float)
        Times between which it is touched, s.
    costate : float
        Largest decrease of the cost for one unit by which the limit is
        loosened over one second; for a condition at a place, for one unit.
    """

    label: str
    spans: tuple[tuple[float, float], ...]
    costate: float

    def __repr__(self) -> str:
        return f"{self.label}: active at {_text(self.spans)}, costate up to {self.costate:.4g}"


@dataclass(frozen=True)
class SoftLimitUse:
    """What became of a soft limit.

    Attributes
    ----------
    label : str
        The condition.
    amount : float
        Largest amount by which it is passed, in its unit; 0 if it holds.
    time : float
        When, s.
    spans : tuple of (float, float)
        Times between which it is passed, s.
    cost : float
        Its part of the cost: the weight times the integral of the amount, or the amount at a waypoint or at the end.
    """

    label: str
    amount: float
    time: float
    spans: tuple[tuple[float, float], ...]
    cost: float

    def __repr__(self) -> str:
        if not self.spans:
            return f"{self.label}: holds"
        return f"{self.label}: passed by up to {self.amount:.3g} at {_text(self.spans)}, at a cost of {self.cost:.4g}"


def _text(spans: Iterable[tuple[float, float]]) -> str:
    return ", ".join(f"{a:.4g} … {b:.4g} s" if b > a else f"{a:.4g} s" for a, b in spans)


def label_of(solution: SolvedMotion, phase: int, name: RowName) -> str:
    """Return the label of a row, with its phase if another one may have the same."""
    if len(solution.phases) == 1 or phase < 0 or name.place.unique:
        return name.label
    return f"{name.label} in phase '{solution.phases[phase].phase.name}'"


def _multipliers(solution: SolvedMotion) -> np.ndarray:
    """Scaled multipliers of the rows and then of the variables."""
    return np.r_[solution.answer.lam_g, solution.answer.lam_x]


def _slacks(solution: SolvedMotion) -> Callable[[Side], float]:
    """Scaled distances from the bound, by side."""
    values = np.r_[solution.answer.rows, solution.variables / solution.program.scale]
    return lambda side: side.sign * (side.bound - values[side.place])


def costates(solution: SolvedMotion) -> dict[str, np.ndarray | float]:
    """Costates by label, see :attr:`Solution.costates`.

    Path equalities that prescribe the motion are constraints and have none.
    """
    program, multipliers = solution.program, _multipliers(solution)
    result: dict[str, Any] = {}
    for side in sides_of(program):
        multiplier = multipliers[side.place] * program.cost_scale / side.size
        value = multiplier if side.equality else max(side.sign * multiplier, 0.0)
        label = label_of(solution, side.phase, side.name)
        if not side.repeated:
            result[label] = float(-value if side.equality else value)
            continue
        lengths = np.diff(solution.phases[side.phase].mesh_times)
        by_interval = result.setdefault(label, np.zeros(lengths.size))
        for i in side.intervals:
            by_interval[i] += value / len(side.intervals) / lengths[i]
    return result | _of_start(solution)


def _of_start(solution: SolvedMotion) -> dict[str, float]:
    """Costates of initial conditions that decide the whole first state: those of its bounds, led back to them."""
    part = solution.phases[0]
    program, initial = part.program, solution.initial
    if program.initial is not None or isinstance(initial, State):
        return {}
    eom = program.scheme.eom
    conditions = [c for c in initial if c.equality]
    x = ca.vertcat(eom.q, eom.v, eom.z)
    prescribed = with_rates(program.scheme.constraints.path_constraints)
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu, *eom.of(stacked([*prescribed, *conditions])))
    first = part.trajectory
    at = (first.t[0], first.q[0], first.v[0], first.a[0], first.z[0], first.lam[0], first.inputs[0], first.parameters)
    slopes = part.phase.equations.function(ca.jacobian(rows, x))(*at).full()
    size = program.point_scale[: x.numel()]
    multiplier = -solution.answer.lam_x[: x.numel()] * solution.program.cost_scale / size
    # the rows span all states: the multiplier on the state is a sum of multipliers on the rows
    weight = np.maximum(np.linalg.norm(slopes * size, axis=1), 1e-300)
    scaled = slopes * size / weight[:, None]
    multipliers = np.linalg.lstsq(scaled.T, multiplier * size, rcond=1e-10)[0] / weight
    names = [RowName(RowKind.CONDITION, c.label, INITIAL) for c in conditions]
    return {name.label: float(v) for name, v in zip(names, multipliers[-len(names) :], strict=True)}


def activity(
    solution: SolvedMotion, slack: float = 0.0, *, inside: bool = False
) -> dict[tuple[int, RowName], np.ndarray]:
    """Shares of the points of each interval at which a limit is active (N,), by phase and name.

    A limit is active if its multiplier outweighs its slack, both scaled, or if the slack is below `slack`. With
    `inside`, mesh points are left out for limits that cannot jump there.
    """
    program, multipliers, slack_of = solution.program, _multipliers(solution), _slacks(solution)
    counts: dict[tuple[int, RowName], np.ndarray] = {}
    steady = {
        (k, limit.label)
        for k, part in enumerate(solution.phases)
        for limit in part.program.limits_at_points
        if inside and not limit.depends_on(*BEYOND_STATES)
    }
    for side in sides_of(program):
        key = side.phase, side.name
        at_mesh_point = side.is_row and side.tau in (0.0, 1.0) and (side.phase, side.name.owner) in steady
        if side.repeated and not side.equality and not at_mesh_point:
            active = max(side.sign * multipliers[side.place], slack) > slack_of(side)
            seen = counts.setdefault(key, np.zeros((2, solution.phases[side.phase].mesh.count)))
            for i in side.intervals:
                seen[:, i] += active, 1
    return {key: active / np.maximum(seen, 1) for key, (active, seen) in counts.items()}


def active_limits(solution: SolvedMotion, costates: Mapping[str, np.ndarray | float]) -> list[ActiveLimit]:
    """Limits that are active, the costliest first, by phase; `costates` as :func:`costates` returns them."""
    multipliers, slack_of, limits = _multipliers(solution), _slacks(solution), []
    for side in sides_of(solution.program):
        if not side.repeated and not side.equality and side.sign * multipliers[side.place] > slack_of(side):
            label = label_of(solution, side.phase, side.name)
            time = solution.phases[side.phase].time_at(side.intervals[0], side.tau)
            limits.append(ActiveLimit(label, ((time, time),), float(costates[label])))
    for (phase, name), shares in activity(solution).items():
        if np.any(shares):
            label = label_of(solution, phase, name)
            times = solution.phases[phase].mesh_times
            spans = tuple((float(times[run.start]), float(times[run.stop])) for run in stretches(shares > 0))
            limits.append(ActiveLimit(label, spans, float(np.max(costates[label]))))
    return sorted([*limits, *_global_limits(solution)], key=lambda limit: -limit.costate)


def _global_limits(solution: SolvedMotion) -> list[ActiveLimit]:
    """Bounds of free parameters, of the duration and of the times of waypoints that are touched."""
    program, limits = solution.program, []
    bounded = [
        (place, p.label, (p.lower, p.upper))
        for place, p in zip(program.parameter_index, solution.problem.free_parameters, strict=True)
    ]
    for part in solution.phases:
        phase, index = part.phase, part.program.stated_time_index
        names = [f"the time of waypoint {k}" for k in range(1, len(phase.waypoints) + 1)]
        if index.size > 1:  # a phase of no duration has one time
            bounded += zip(index[1:], [*names, "the duration"], phase.time_spans[1:], strict=True)
    for place, name, (low, high) in bounded:
        multiplier, size = solution.answer.lam_x[place], program.scale[place]
        for sign, bound, symbol in ((-1, low, ">="), (1, high, "<=")):
            slack = sign * (bound - solution.variables[place]) / size
            if low < high and sign * multiplier > slack:
                costate = float(sign * multiplier * program.cost_scale / size)
                limits.append(ActiveLimit(f"{name} {symbol} {bound:g}", ((0.0, solution.duration),), costate))
    return limits


def soft_limits(solution: SolvedMotion) -> list[SoftLimitUse]:
    """Soft limits of all phases, waypoints and ends, those that cost most first."""
    uses = []
    for number, part in enumerate(solution.phases):
        use, points = partial(_use, solution, number), points_of(part)
        for limit in part.phase.soft_limits:
            (amounts,), cost = part.by_polynomials([limit.amount], *points), part.integral(limit.weight * limit.amount)
            uses.append(use(PATH, limit.condition, part.times_at(*points), amounts.ravel(), cost))
        places = [(Place(f"waypoint {k}"), w.soft_limits) for k, w in enumerate(part.phase.waypoints, start=1)]
        places.append((FINAL, solution.problem.soft_ends[number]))
        for (place, limits), time in zip(places, part.segment_times[1:], strict=True):
            for limit in limits:
                amount, weight = solution.parameters[limit.amount], part.trajectory.initial[ca.SX(limit.weight)]
                uses.append(use(place, limit.condition, np.array([time]), np.array([amount]), float(weight) * amount))
    return sorted(uses, key=lambda use: -use.cost)


def _use(
    solution: SolvedMotion,
    phase: int,
    place: Place,
    limit: Condition,
    times: np.ndarray,
    amounts: np.ndarray,
    cost: float,
) -> SoftLimitUse:
    """What became of a soft limit, from the amounts at times, s, by which it is passed, and its part of the cost."""
    size = float(solution.phases[phase].program.sizes.of_limits([limit.expression])[0])
    label = label_of(solution, phase, RowName(RowKind.CONDITION, limit.label, place))
    passed, most = amounts > PASSED * size, int(np.argmax(amounts))
    if not passed[most]:
        return SoftLimitUse(label, 0.0, float(times[most]), (), 0.0)
    spans = tuple((float(times[run.start]), float(times[run.stop - 1])) for run in stretches(passed))
    return SoftLimitUse(label, float(amounts[most]), float(times[most]), spans, cost)
