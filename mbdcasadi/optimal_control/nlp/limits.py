"""Which limits a solution touches, when, and what they cost."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import casadi as ca
import numpy as np

from ...model.conditions import stacked
from ...results.state import State
from ..constraints import with_rates

if TYPE_CHECKING:
    from ..solution import Solution
    from .motion_program import MotionProgram


@dataclass(frozen=True)
class ActiveLimit:
    """A limit that holds the motion.

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


def costates(solution: Solution) -> dict[str, np.ndarray | float]:
    """Costates by label.

    For path limits, the limits of inputs and of states: by interval (N,), the
    decrease of the cost for one unit by which the limit is loosened, per
    second. For equalities at the start, at waypoints, at the end and between
    both: the change of the cost for one unit added to the right-hand side; for
    inequalities there: its decrease for one unit by which they are loosened.
    Path equalities that prescribe the motion are constraints and have none.
    """
    program = solution.program
    multipliers = solution.answer.lam_g
    lengths = np.diff(solution.mesh)
    found: dict[str, Any] = {}
    for k, row in enumerate(program.rows):
        if not row.condition:
            continue
        value = multipliers[k] * program.cost_scale / row.size
        sides = {row.label: value}
        if row.opposite:
            sides = {row.label: max(value, 0.0), row.opposite: max(-value, 0.0)}
        for label, pull in sides.items():
            if k < program.interval_rows:
                found.setdefault(label, np.zeros(lengths.size))[row.interval] += pull / lengths[row.interval]
            else:
                found[label] = float(-pull if row.equality else pull)
    found |= _of_start(solution)
    for label, interval, value in _of_bounds(solution):
        found.setdefault(label, np.zeros(lengths.size))[interval] += value / lengths[interval]
    return found


def _of_start(solution: Solution) -> dict[str, float]:
    """Costates of initial conditions that decide the whole first state: those of its bounds, led back to them."""
    program, problem = solution.program, solution.problem
    if program.initial is not None or isinstance(problem.initial, State):
        return {}
    whole, eom = problem.equations, program.scheme.eom
    conditions = [c for c in problem.initial if c.equality]
    x = ca.vertcat(eom.q, eom.v, eom.z)
    held = with_rates(program.scheme.constraints.held)
    rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu, *eom.of(stacked([*held, *conditions])))
    jacobian = whole.function(ca.jacobian(rows, x))
    first = solution.trajectory
    at = (first.t[0], first.q[0], first.v[0], first.a[0], first.z[0], first.lam[0], first.inputs[0], first.parameters)
    slopes = jacobian(*at).full()
    size = program.node_scale[: x.numel()]
    pull = -solution.answer.lam_x[: x.numel()] * program.cost_scale / size
    # the rows span all states: the pull on the state is a sum of pulls on the rows
    scaled = slopes * size / np.maximum(np.linalg.norm(slopes * size, axis=1, keepdims=True), 1e-300)
    weight = np.linalg.norm(slopes * size, axis=1)
    shares = np.linalg.lstsq(scaled.T, pull * size, rcond=1e-10)[0] / np.maximum(weight, 1e-300)
    return {f"initial: {c.label}": float(v) for c, v in zip(conditions, shares[-len(conditions) :], strict=True)}


def _of_bounds(solution: Solution) -> list[tuple[str, int, float]]:
    """Label, interval and multiplier of the limits that are bounds of variables."""
    program, found = solution.program, []
    multipliers = solution.answer.lam_x * program.cost_scale / program.scale
    for bound in _bounds(program):
        value = max(bound.sign * multipliers[bound.place], 0.0)
        found += [(bound.label, i, value / len(bound.intervals)) for i in bound.intervals]
    return found


@dataclass(frozen=True)
class _Bound:
    """A limit of an input or a first-order state where it is the bound of a variable."""

    label: str
    sign: int
    value: float
    place: int
    #: those that the variable belongs to: two for one of a mesh point between them
    intervals: tuple[int, ...]


def _bounds(program: MotionProgram) -> Iterator[_Bound]:
    """Limits that are bounds of variables, one by one."""
    scheme, mechanism, count = program.scheme, program.problem.mechanism, program.count
    n, inputs = scheme.eom.q.numel(), len(mechanism.inputs)
    for condition, (symbol, sign) in program.limit_owners.items():
        limit = condition.label, sign, symbol.upper if sign > 0 else symbol.lower
        input_place = next((k for k, u in enumerate(mechanism.inputs) if u is symbol), None)
        if input_place is None:
            node = 2 * n + next(k for k, z in enumerate(mechanism.states) if z is symbol)
        else:
            first = scheme.block_slice("u").start + input_place
            inside = slice(first, first + inputs * len(scheme.inputs.inner), inputs)
            for i in range(count):
                yield from (_Bound(*limit, place, (i,)) for place in program.block_index(i)[inside].tolist())
            node = scheme.node_size - inputs + input_place
        if input_place is None or scheme.inputs.joined:
            for i in range(count + 1):
                around = tuple(k for k in (i - 1, i) if 0 <= k < count)
                yield _Bound(*limit, int(program.node_index(i)[node]), around)


def active_limits(solution: Solution) -> list[ActiveLimit]:
    """Limits that hold the motion back, the costliest first.

    A limit counts where its multiplier outweighs its slack, both scaled.
    """
    program, mesh, found = solution.program, solution.mesh, []
    touched: dict[str, np.ndarray] = {}
    places: dict[str, float] = {}
    for k, row in enumerate(program.rows):
        pull, value = solution.answer.lam_g[k], solution.answer.rows[k]
        if row.equality or not row.condition or not (pull > -value or -pull > value - row.lower):
            continue
        label, i = row.side(pull), row.interval
        if k < program.interval_rows:
            touched.setdefault(label, np.zeros(program.count, bool))[i] = True
        else:
            places[label] = float(mesh[i] + row.share * (mesh[i + 1] - mesh[i]))
    for label, interval in _touched_bounds(solution):
        touched.setdefault(label, np.zeros(program.count, bool))[interval] = True
    for label, active in touched.items():
        found.append(ActiveLimit(label, _spans(active, mesh), float(np.max(solution.costates[label]))))
    for label, time in places.items():
        found.append(ActiveLimit(label, ((time, time),), float(solution.costates[label])))
    found += _global_limits(solution)
    return sorted(found, key=lambda limit: -limit.costate)


def _global_limits(solution: Solution) -> list[ActiveLimit]:
    """Bounds of free parameters, of the duration and of the times of waypoints that are touched."""
    program, problem, found = solution.program, solution.problem, []
    spans = [(f"the time of waypoint {k}", w.time) for k, w in enumerate(problem.waypoints, start=1)]
    spans.append(("the duration", problem.duration))
    bounded = list(zip(program.mark_index[1:], spans, strict=True)) if program.mark_count else []
    parameters = [(p.label, (p.lower, p.upper)) for p in problem.free_parameters]
    for place, (name, (low, high)) in [*bounded, *zip(program.parameter_index, parameters, strict=True)]:
        pull, size = solution.answer.lam_x[place], program.scale[place]
        for sign, bound, word in ((-1, low, ">="), (1, high, "<=")):
            slack = sign * (bound - solution.variables[place]) / size
            if low < high and sign * pull > slack:
                costate = float(sign * pull * program.cost_scale / size)
                found.append(ActiveLimit(f"{name} {word} {bound:g}", ((0.0, solution.duration),), costate))
    return found


def _touched_bounds(solution: Solution) -> list[tuple[str, int]]:
    """Limits that are bounds of variables, with the intervals where these lie on them."""
    program, found = solution.program, []
    x = solution.variables / program.scale
    for bound in _bounds(program):
        slack = bound.sign * (bound.value / program.scale[bound.place] - x[bound.place])
        if bound.sign * solution.answer.lam_x[bound.place] > slack:
            found += [(bound.label, i) for i in bound.intervals]
    return found


def _spans(active: np.ndarray, mesh: np.ndarray) -> tuple[tuple[float, float], ...]:
    """Stretches of intervals that are active."""
    edges = np.flatnonzero(np.diff(np.r_[False, active, False].astype(int)))
    return tuple((float(mesh[a]), float(mesh[b])) for a, b in edges.reshape(-1, 2))


def limit_excess(solution: Solution) -> dict[str, float]:
    """By how much each limit is passed between the points at which it is held, by label."""
    program = solution.program
    limits = [c for c in (*solution.problem.path, *program.limit_owners) if not c.equality]
    if not limits:
        return {}
    shares = np.linspace(0, 1, 21)
    times = np.unique((solution.mesh[:-1, None] + np.diff(solution.mesh)[:, None] * shares).ravel())
    motion = solution.trajectory.at(times)
    return {c.label: max(float(np.max(motion[c.expression])), 0.0) for c in limits}
