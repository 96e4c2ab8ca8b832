"""Limits that a solution touches, when it does, and what they cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...model.conditions import stacked
from ...model.symbols import place_of
from ...results.state import State
from ..phase import BEYOND_STATES, with_rates
from .held_limits import POINTS
from .phase_program import PhaseProgram
from .rows import Row

if TYPE_CHECKING:
    from ..solution import Solution


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
        spans = ", ".join(f"{a:.4g} … {b:.4g} s" if b > a else f"{a:.4g} s" for a, b in self.spans)
        return f"{self.label}: active at {spans}, costate up to {self.costate:.4g}"


def time_of(row: Row, solution: Solution) -> float:
    """Time at which a row of the program stands, s."""
    times = solution.phases[row.phase].mesh_times
    if times.size == 1:
        return float(times[0])
    return float(times[row.interval] + row.tau * (times[row.interval + 1] - times[row.interval]))


def _label(solution: Solution, phase: int, label: str) -> str:
    """Label of a row, with its phase if another one may have the same."""
    if len(solution.phases) == 1 or label.startswith(("boundary: ", "initial: ")) or "phase '" in label:
        return label
    return f"{label} in phase '{solution.phases[phase].phase.name}'"


def costates(solution: Solution) -> dict[str, np.ndarray | float]:
    """Costates by label, see :attr:`Solution.costates`.

    Path equalities that prescribe the motion are constraints and have none.
    """
    program = solution.program
    result: dict[str, Any] = {}

    def add(phase: int, label: str, interval: int, value: float) -> None:
        lengths = np.diff(solution.phases[phase].mesh_times)
        result.setdefault(_label(solution, phase, label), np.zeros(lengths.size))[interval] += value / lengths[interval]

    for row, multiplier in zip(program.rows, solution.answer.lam_g, strict=True):
        if not row.condition:
            continue
        value = multiplier * program.cost_scale / row.size
        sides = {row.label: value}
        if row.opposite:
            sides = {row.label: max(value, 0.0), row.opposite: max(-value, 0.0)}
        for label, pull in sides.items():
            if row.repeated:
                add(row.phase, label, row.interval, pull)
            else:
                result[_label(solution, row.phase, label)] = float(-pull if row.equality else pull)
    result |= _of_start(solution)
    multipliers = solution.answer.lam_x * program.cost_scale / program.scale
    for number, part in enumerate(solution.phases):
        for bound in variable_bounds(part.program) if part.mesh.count else ():
            value = max(bound.sign * multipliers[bound.place], 0.0)
            for i in bound.intervals:
                add(number, bound.label, i, value / len(bound.intervals))
    return result


def _of_start(solution: Solution) -> dict[str, float]:
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
    pull = -solution.answer.lam_x[: x.numel()] * solution.program.cost_scale / size
    # the rows span all states: the pull on the state is a sum of pulls on the rows
    weight = np.maximum(np.linalg.norm(slopes * size, axis=1), 1e-300)
    scaled = slopes * size / weight[:, None]
    pulls = np.linalg.lstsq(scaled.T, pull * size, rcond=1e-10)[0] / weight
    return {f"initial: {c.label}": float(v) for c, v in zip(conditions, pulls[-len(conditions) :], strict=True)}


@dataclass(frozen=True)
class _Bound:
    """A limit of an input or a first-order state that is the bound of a variable."""

    label: str
    sign: int
    value: float
    place: int
    #: those that the variable belongs to: two for one of a mesh point between them
    intervals: tuple[int, ...]


def variable_bounds(program: PhaseProgram) -> Iterator[_Bound]:
    """Limits that are bounds of variables, one by one."""
    scheme, mechanism, count = program.scheme, program.phase.mechanism, program.count
    n, inputs = scheme.eom.q.numel(), len(mechanism.inputs)
    for condition, (symbol, sign) in program.limit_owners.items():
        limit = condition.label, sign, symbol.upper if sign > 0 else symbol.lower
        input_place = place_of(symbol, mechanism.inputs)
        if input_place is None:
            at_point = 2 * n + next(k for k, z in enumerate(mechanism.states) if z is symbol)
        else:
            first = scheme.interval_slice("u").start + input_place
            inside = slice(first, first + inputs * len(scheme.inputs.inner), inputs)
            for i in range(count):
                yield from (_Bound(*limit, place, (i,)) for place in program.inner_index(i)[inside].tolist())
            at_point = scheme.point_size - inputs + input_place
        if input_place is None or scheme.inputs.joined:
            for i in range(count + 1):
                around = tuple(k for k in (i - 1, i) if 0 <= k < count)
                yield _Bound(*limit, int(program.point_index(i)[at_point]), around)


def activity(solution: Solution, slack: float = 0.0, *, inside: bool = False) -> dict[tuple[int, str], np.ndarray]:
    """Shares of the points of each interval at which a limit is active (N,), by phase and label.

    A limit is active if its multiplier outweighs its slack, both scaled, or if the slack is below `slack`. With
    `inside`, mesh points are left out for limits that cannot jump there.
    """
    program, answer = solution.program, solution.answer
    counts: dict[tuple[int, str], np.ndarray] = {}

    def note(phase: int, label: str, interval: int, active: bool) -> None:
        seen = counts.setdefault((phase, label), np.zeros((2, solution.phases[phase].mesh.count)))
        seen[:, interval] += active, 1

    steady = {
        (k, limit.label)
        for k, part in enumerate(solution.phases)
        for limit in part.program.limits_at_points
        if inside and not limit.depends_on(*BEYOND_STATES)
    }
    for row, pull, value in zip(program.rows, answer.lam_g, answer.rows, strict=True):
        at_mesh_point = row.tau in (0.0, 1.0) and (row.phase, row.label) in steady
        if row.repeated and row.condition and not row.equality and not at_mesh_point:
            note(row.phase, row.label, row.interval, max(pull, slack) > -value)
            if row.opposite:
                note(row.phase, row.opposite, row.interval, max(-pull, slack) > value - row.lower)
    x = solution.variables / program.scale
    for number, part in enumerate(solution.phases):
        for bound in variable_bounds(part.program) if part.mesh.count else ():
            left = bound.sign * (bound.value / program.scale[bound.place] - x[bound.place])
            for i in bound.intervals:
                note(number, bound.label, i, max(bound.sign * answer.lam_x[bound.place], slack) > left)
    return {key: active / np.maximum(seen, 1) for key, (active, seen) in counts.items()}


def active_limits(solution: Solution) -> list[ActiveLimit]:
    """Limits that are active, the costliest first, by phase."""
    program, answer = solution.program, solution.answer
    limits, places = [], []
    for row, pull, value in zip(program.rows, answer.lam_g, answer.rows, strict=True):
        if row.condition and not row.equality and not row.repeated and (pull > -value or -pull > value - row.lower):
            label, time = _label(solution, row.phase, row.side(pull)), time_of(row, solution)
            places.append(ActiveLimit(label, ((time, time),), float(solution.costates[label])))
    for (phase, own), shares in activity(solution).items():
        if np.any(shares):
            label = _label(solution, phase, own)
            spans = _spans(shares > 0, solution.phases[phase].mesh_times)
            limits.append(ActiveLimit(label, spans, float(np.max(solution.costates[label]))))
    return sorted([*limits, *places, *_global_limits(solution)], key=lambda limit: -limit.costate)


def _global_limits(solution: Solution) -> list[ActiveLimit]:
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
        pull, size = solution.answer.lam_x[place], program.scale[place]
        for sign, bound, symbol in ((-1, low, ">="), (1, high, "<=")):
            slack = sign * (bound - solution.variables[place]) / size
            if low < high and sign * pull > slack:
                costate = float(sign * pull * program.cost_scale / size)
                limits.append(ActiveLimit(f"{name} {symbol} {bound:g}", ((0.0, solution.duration),), costate))
    return limits


def _spans(active: np.ndarray, times: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Times of the stretches of intervals that are active."""
    edges = np.flatnonzero(np.diff(np.r_[False, active, False].astype(int)))
    return tuple((float(times[a]), float(times[b])) for a, b in edges.reshape(-1, 2))


def limit_excess(solution: Solution) -> dict[str, float]:
    """Amounts by which limits are passed between the points at which they are held, by label."""
    excess: dict[str, float] = {}
    for part in solution.phases:
        if not part.limits:
            continue
        times = part.mesh_times[:-1, None] + np.diff(part.mesh_times)[:, None] * np.linspace(0, 1, POINTS)
        motion = part.trajectory.at(np.unique(times.ravel()))
        for limit in part.limits:
            here = max(float(np.max(motion[limit.expression])), 0.0)
            excess[limit.label] = max(here, excess.get(limit.label, 0.0))
    return excess
