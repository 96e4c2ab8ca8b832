"""The part of a phase in the program: its variables, and its rows and cost."""

from __future__ import annotations

import itertools
from collections.abc import Hashable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...model.conditions import Condition, stacked
from ...model.contents import contents_of
from ...model.placeholders import Placeholder
from ...model.symbols import Symbol
from ...numerics.lazy import cached_property
from ...results.state import State
from ..poses.consistency import own_limits
from ..problem import OptimalControlProblem
from ..transcription.mesh import Mesh
from ..transcription.points import MULTIPLIERS, CollocationPoint, Interval
from ..transcription.rows import FINAL, INITIAL, PATH, Place, RowKind, Rows, condition_rows, stack
from ..transcription.scaling import Sizes
from .blocks import Block, Edge, Unknowns
from .setup import PhaseSetup
from .sparse_program import MappedBlock

#: Shortest segment between free times, as a fraction of the typical duration.
SHORTEST_SEGMENT = 1e-3
#: The same of an interval beside a mesh point that moves: one in which an input switches shrinks to it.
SHORTEST_SWITCH = 1e-6


@dataclass(frozen=True)
class PhasePlace:
    """Place of a phase in a program."""

    #: index
    number: int
    #: number of the variables before it
    first: int
    #: times between which it begins, s
    begins: tuple[float, float]
    #: whether a time of the program is free: then all phases have their times among the variables
    timed: bool
    #: sizes of the free parameters
    free_scale: np.ndarray


class PhaseProgram:
    """Variables, rows and cost of a phase on a mesh of N intervals.

    The variables are those of the mesh points and of the intervals in turn, then the times of the knots (start,
    waypoints, mesh points that move, end) if one of them is free; each divided by its typical size. The mesh fractions
    are data, so that one compiled program serves every mesh with as many intervals in each piece.

    Values of `integrals` accumulate along it. At the points `enforced` of every interval path limits hold, by label,
    besides stages and mesh points.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        setup: PhaseSetup,
        mesh: Mesh,
        place: PhasePlace,
        integrals: Sequence[Placeholder] = (),
        enforced: Sequence[tuple[str, float]] = (),
    ):
        self.number, self._first, self.begins = place.number, place.first, place.begins
        self.setup, self.phase, self.scheme, self.scales = setup, setup.phase, setup.scheme, setup.scales
        # not the problem itself: it holds the program
        self._free, self.extra_parameters = problem.free_parameters, setup.extra_parameters
        reduced = self.scheme.eom
        #: sizes of what the transcription works in
        self.reduced_scales = replace(self.scales.of(reduced.independent, reduced.rows), steps=max(mesh.count, 1))
        self.count = mesh.count
        self._knots, self._piece, self._waypoints, self._longest = mesh.knots, mesh.piece, mesh.waypoints, mesh.longest
        stated = {0, *mesh.waypoints.tolist(), mesh.count}
        #: places of the start, the waypoints and the end among the knots of the mesh
        self.stated_knots = [k for k, point in enumerate(mesh.knots.tolist()) if point in stated]
        self.arguments = setup.arguments
        self.integrals, self._enforced = list(integrals), enforced
        self.point_size = self.scheme.point_size + len(self.integrals)
        point_scale, self.inner_scale = self.scheme.sizes(self.reduced_scales)
        self.point_scale = np.concatenate([point_scale, [self.typical_value(p) for p in self.integrals]])
        self.time_count = mesh.knots.size if place.timed else 0
        self.free_scale = place.free_scale
        self.size = self.count * self.stride + self.point_size + self.time_count
        #: parameters of the mechanism, of which free ones are not used
        self.p = ca.SX.sym("p", self.phase.equations.p.numel())
        self.initial, self.final = setup.ends.initial, setup.ends.final
        self._functions: dict[tuple[Condition, ...], ca.Function] = {}

    @property
    def sizes(self) -> Sizes:
        """Sizes of expressions of the problem."""
        return self.setup.sizes

    def typical_value(self, placeholder: Placeholder) -> float:
        """Typical value of a placeholder."""
        span = self.scales.time if placeholder.kind == "integral" else 1.0
        return span * self.sizes.of_values(placeholder.expression)

    @property
    def follows(self) -> bool:
        """True if another phase comes before."""
        return self.number > 0

    def edge(self, at_end: bool, free: ca.SX | None = None) -> Edge:
        """Start or end with new symbols; `free` are scaled parameters to be shared."""
        unknowns, k = self.unknowns(free), self.count - 1 if at_end else 0
        at = (self.scheme.end if at_end else self.scheme.start)(unknowns.interval)
        return Edge(unknowns, at, self.interval_index([k]), (self.number, k))

    # --- places of the variables ----------------------------------------------------------
    @cached_property
    def stride(self) -> int:
        """Number of variables of a mesh point and the interval after it."""
        return self.point_size + self.scheme.interval_size

    def point_index(self, k: int | np.ndarray) -> np.ndarray:
        """Places of the variables of a mesh point, or of several (k, 1), a row for each."""
        return self._first + np.arange(self.point_size) + k * self.stride

    def inner_index(self, i: int | np.ndarray) -> np.ndarray:
        """Places of the variables of an interval alone, or of several (k, 1), a row for each."""
        return self._first + np.arange(self.scheme.interval_size) + i * self.stride + self.point_size

    @property
    def time_index(self) -> np.ndarray:
        """Places of the times of the knots, if a time is free."""
        end = self._first + self.size
        return np.arange(end - self.time_count, end)

    @property
    def stated_time_index(self) -> np.ndarray:
        """Places of the times of start, waypoints and end, if a time is free."""
        return self.time_index[self.stated_knots] if self.time_count else self.time_index

    @cached_property
    def scale(self) -> np.ndarray:
        """Size of every variable."""
        one = np.concatenate([self.point_scale, self.inner_scale])
        times = np.full(self.time_count, self.scales.time)
        return np.concatenate([np.tile(one, self.count), self.point_scale, times])

    def interval_index(self, intervals: Sequence[int]) -> np.ndarray:
        """Variables of intervals, each a column: mesh points and interval, and the times of its piece."""
        places = np.arange(self.stride + self.point_size)[:, None] + self.stride * np.asarray(intervals, int)
        if not self.time_count:
            return self._first + places
        return np.vstack([self._first + places, self.time_index[self._piece[intervals] + np.arange(2)[:, None]]])

    # --- symbols of one interval ----------------------------------------------------------
    def unknowns(self, free: ca.SX | None = None) -> Unknowns:
        """New symbols for one interval; `free` are scaled parameters to be shared with another one."""
        times_count = 2 if self.time_count else 0
        sizes = [self.point_size, self.scheme.interval_size, self.point_size, times_count]
        first, inner, last, times = (ca.SX.sym(x, size) for x, size in zip("wbxm", sizes, strict=True))
        free = ca.SX.sym("f", self.free_scale.size) if free is None else free
        data = ca.SX.sym("d", 2 + self.scheme.known_size)
        before, after = (ca.DM(self.point_scale) * x for x in (first, last))
        p, extra = self.phase.with_free(self.p, self._free, ca.DM(self.free_scale) * free)
        start, length = data[0], data[1]
        if times_count:
            segment = self.scales.time * (times[1] - times[0])
            start, length = self.scales.time * times[0] + data[0] * segment, data[1] * segment
        plain = self.scheme.point_size
        within = ca.vertcat(ca.DM(self.inner_scale) * inner, data[2:])
        interval = Interval(before[:plain], within, after[:plain], start, length, p)
        variables = ca.vertcat(first, inner, last, times)
        return Unknowns(variables, free, data, interval, before[plain:], after[plain:], extra)

    @cached_property
    def limit_owners(self) -> dict[Condition, tuple[Symbol, int]]:
        """Limits that inputs and first-order states carry themselves, with the symbol and the side."""
        known = [self.phase.mechanism.inputs[k] for k in self.scheme.known]
        owned = own_limits(self.phase.mechanism)
        return {c: owner for c, owner in owned.items() if not any(owner[0] is u for u in known)}

    # --- expressions ----------------------------------------------------------------------
    def value(self, expression: ca.SX, at: CollocationPoint, unknowns: Unknowns) -> ca.SX:
        """An expression of the problem at a point of an interval."""
        return self._applied(ca.Function("e", self.arguments, [expression]), at, unknowns)

    def _applied(self, function: ca.Function, at: CollocationPoint, unknowns: Unknowns) -> ca.SX:
        loads = self.scheme.redundant and function.jac_sparsity(0, MULTIPLIERS).nnz() > 0
        at = self.scheme.expanded(at, unknowns.interval.p, loads=loads)
        return function(*at.values, unknowns.interval.p, unknowns.extra)

    def quadrature(self, expression: ca.SX) -> tuple[np.ndarray, np.ndarray]:
        """Points and weights by which an expression is integrated over an interval."""
        dense = self._leaves_inputs(expression)
        return self.scheme.dense_rule if dense else (self.scheme.stages, self.scheme.quadrature)

    def _integral(self, expression: ca.SX, unknowns: Unknowns) -> ca.SX:
        if expression.is_zero():
            return ca.SX(0)
        function = ca.Function("e", self.arguments, [expression])
        scheme, interval = self.scheme, unknowns.interval
        points, weights = (x.tolist() for x in self.quadrature(expression))
        values = (self._applied(function, scheme.at(interval, tau), unknowns) for tau in points)
        return interval.length * sum((w * value for w, value in zip(weights, values, strict=True)), ca.SX(0))

    def _leaves_inputs(self, expression: ca.SX) -> bool:
        """True if the states alone decide by an integral about an input, which may then be within its limits."""
        eom = self.phase.equations
        states, others = ca.vertcat(eom.q, eom.v, eom.z), ca.vertcat(eom.a, eom.lam, self.phase.input_rates)
        if not ca.depends_on(expression, states) or any(ca.which_depends(expression, others, 2, False)):
            return False
        return not all(ca.which_depends(expression, eom.u, 2, False))

    def _conditions(
        self, conditions: Sequence[Condition], at: CollocationPoint, unknowns: Unknowns, tau: float, where: Place = PATH
    ) -> list[Rows]:
        """Conditions at a point."""
        if not conditions:
            return []
        key = tuple(conditions)
        if key not in self._functions:
            self._functions[key] = ca.Function("c", self.arguments, [stacked(conditions)])
        values = ca.vertsplit(self._applied(self._functions[key], at, unknowns))
        return condition_rows(dict(zip(conditions, values, strict=True)), self.condition_sizes, tau, where)

    @cached_property
    def condition_sizes(self) -> dict[Condition, float]:
        """Typical sizes of the conditions of the phase."""
        waypoints = [c for w in self.phase.waypoints for c in w.conditions]
        start = [c for c in self.initial or () if not c.depends_on("impulse")]
        conditions = [*start, *self.final, *self.phase.path, *waypoints, *own_limits(self.phase.mechanism)]
        limits = [c for c in conditions if not c.equality]
        equalities = [c for c in conditions if c.equality]

        def sizes() -> list[float]:
            of_limits = self.sizes.of_limits([c.expression for c in limits])
            changes = self.sizes.of_changes([c.expression for c in equalities])
            return [*of_limits.tolist(), *changes.tolist()]

        found = self.setup.cache.get_or_create("sizes of conditions", sizes)
        return dict(zip([*limits, *equalities], found, strict=True))

    # --- blocks ---------------------------------------------------------------------------
    def blocks(self, free_index: np.ndarray, p: ca.SX, cost_scale: float) -> list[Block]:
        """Intervals, then start, waypoints and end.

        `free_index` are the places of the free parameters, `p` the parameters of the mechanisms of all phases.
        """

        def block(unknowns: Unknowns, groups: list[Rows], cost: ca.SX, intervals: Sequence[int], **more: Any) -> Block:
            free = np.tile(free_index[:, None], (1, len(intervals)))
            index = np.vstack([self.interval_index(intervals), free])
            variables = ca.vertcat(unknowns.variables, unknowns.free)
            states = unknowns.interval.states()
            piece = MappedBlock(variables, unknowns.data, p, stack(groups), cost / cost_scale, index, *states)
            copies = tuple(((self.number, i),) for i in intervals)
            return Block(piece, [g for g in groups if g.owners], copies, **more)

        blocks = [block(*self._interval_rows(), list(range(self.count)), repeated=True)]
        for unknowns, groups, interval in [*self._start_rows(), *self._place_rows()]:
            blocks.append(block(unknowns, groups, ca.SX(0), [interval]))
        for expression, intervals in self._waypoint_costs():
            unknowns = self.unknowns()
            cost = self.value(expression, self.scheme.end(unknowns.interval), unknowns)
            blocks.append(block(unknowns, [], cost, intervals))
        return blocks

    def _waypoint_costs(self) -> list[tuple[ca.SX, list[int]]]:
        """Costs of waypoints, each with the intervals that end there: those of samples are all alike."""
        costs: dict[Hashable, tuple[ca.SX, list[int]]] = {}
        for waypoint, point in zip(self.phase.waypoints, self._waypoints.tolist(), strict=True):
            if not waypoint.cost.is_zero():
                key = contents_of(waypoint.cost, symbols=self.arguments) or point
                costs.setdefault(key, (waypoint.cost, []))[1].append(point - 1)
        return list(costs.values())

    def _interval_rows(self) -> tuple[Unknowns, list[Rows], ca.SX]:
        """Rows of an interval, and its part of the running cost."""
        unknowns = self.unknowns()
        unknowns = replace(unknowns, interval=unknowns.interval.with_symbols())
        points = self.scheme.points(unknowns.interval)
        groups = self.scheme.equations(unknowns.interval, self.reduced_scales)
        for k, placeholder in enumerate(self.integrals):
            gain = unknowns.next_integrals[k] - unknowns.integrals[k]
            row = gain - self._integral(placeholder.expression, unknowns)
            size = self.point_scale[self.scheme.point_size + k :][:1]
            groups.append(Rows(row, (placeholder.label,), 1.0, size, ("",), RowKind.ACCUMULATION))
        groups += self._path_rows(unknowns, points)
        return unknowns, groups, self._integral(self.phase.running_cost, unknowns)

    def _path_rows(self, unknowns: Unknowns, points: list[CollocationPoint]) -> list[Rows]:
        """Path conditions at the stages and at the ends of the interval; limits of inputs at their control points."""
        scheme, groups = self.scheme, []
        start, end = scheme.start(unknowns.interval), scheme.end(unknowns.interval)
        equalities = [c for c in self._path_at_stages if c.equality]
        limits = [c for c in self.limits_at_points if c not in self.limit_owners]
        limits += [c for c in self.phase.path if c.across == ()]

        def place(some: list[Condition], at: CollocationPoint, tau: float) -> None:
            groups.extend(self._conditions(some, at, unknowns, tau))

        jumping = [c for c in limits if c.depends_on("acceleration", "multiplier", "input", "input rate")]
        place(jumping, start, 0.0)
        for tau, at in zip(scheme.stages.tolist(), points, strict=True):
            # if inputs are joined, the end of the interval before has the row at the start
            here = equalities if tau > 0 or not scheme.inputs.joined else []
            place([*here, *([*limits, *self._limits_of_states] if 0 < tau < 1 else [])], at, tau)
        place(limits, end, 1.0)
        for tau in sorted({tau for _, tau in self._enforced}):
            here = [c for c in self.limits_at_points if tau in self.enforced_at(c)]
            place(here, scheme.at(unknowns.interval, tau), tau)
        groups += self._rows_across([start, *points, end], points, unknowns)
        return groups + self._input_limit_rows(unknowns, end)

    def _rows_across(
        self, everywhere: list[CollocationPoint], stages: list[CollocationPoint], unknowns: Unknowns
    ) -> list[Rows]:
        """Products that vanish across the interval: one factor anywhere times the sum of the other over the stages.

        The sum counts as long as the interval lasts, in lengths of equal ones: it is an impulse, which stays as it is
        if the interval of an impact shrinks.
        """
        groups, share_of_length = [], unknowns.interval.length * self.count / self.scales.time
        for condition in self.phase.path:
            if condition.across:
                first, second, share = condition.across
                size = float(self.sizes.of_changes([condition.expression])[0])
                total = share_of_length * sum((self.value(second, at, unknowns) for at in stages), ca.SX(0))
                for at in everywhere:
                    value = self.value(first, at, unknowns) * total - self.value(share, at, unknowns) * size
                    groups += condition_rows({condition: value}, {condition: size}, 1.0, PATH)
        return groups

    def _input_limit_rows(self, unknowns: Unknowns, at: CollocationPoint) -> list[Rows]:
        """Limits of inputs and of their rates alone, at the control points of their polynomials."""
        groups: list[Rows] = []
        if self._own_limits_in_rows or any(self._limits_of_inputs.values()):
            columns = self.scheme.input_control_points(unknowns.interval)
            for (kind, limits), points in zip(self._limits_of_inputs.items(), columns, strict=True):
                count, ends = points.size2(), kind == "u" and self.scheme.inputs.joined
                for j in range(count):
                    # if inputs are joined, the end of the interval before has the row at the start, and own limits are
                    # bounds of the variables at both ends
                    here = [] if ends and j == 0 else list(limits)
                    here += self._own_limits_in_rows if kind == "u" and not (ends and j in (0, count - 1)) else []
                    at_control_point = replace(at, **{kind: points[:, j]})
                    groups += self._conditions(here, at_control_point, unknowns, j / max(count - 1, 1))
        return groups

    @property
    def _path_at_stages(self) -> list[Condition]:
        """Path conditions that are imposed at points: those that are not differentiated."""
        differentiated = set(self.scheme.constraints.path_constraints)
        return [c for c in self.phase.path if c not in differentiated]

    @cached_property
    def limits_at_points(self) -> list[Condition]:
        """Limits that hold at single points of the intervals: those of the path and of first-order states."""
        of_inputs = [c for limits in self._limits_of_inputs.values() for c in limits]
        path = [c for c in self.phase.path if not c.equality and c.across is None and c not in of_inputs]
        return [*path, *self._limits_of_states]

    def enforced_at(self, condition: Condition) -> list[float]:
        """Points of an interval at which a limit is enforced besides stages and mesh points."""
        return [tau for label, tau in self._enforced if label == condition.label]

    @cached_property
    def _limits_of_states(self) -> list[Condition]:
        """Limits of first-order states, which are bounds of variables at the mesh points alone."""
        return [c for c in self.limit_owners if c.depends_on("state")]

    @cached_property
    def _own_limits_in_rows(self) -> list[Condition]:
        """Limits that inputs carry themselves, if the bounds of their unknowns do not keep them everywhere."""
        return [] if self.scheme.inputs.bounded else [c for c in self.limit_owners if c.depends_on("input")]

    @cached_property
    def _limits_of_inputs(self) -> dict[str, list[Condition]]:
        """Path limits of inputs alone, and of their rates alone, that are linear in them: ``u``, ``u_rate``."""
        eom, rates = self.phase.equations, self.phase.input_rates
        limits: dict[str, list[Condition]] = {}
        for name, kind, symbols in (("u", "input", eom.u), ("u_rate", "input rate", rates)):
            alone = [c for c in self.phase.path if kind in c.kinds and c.kinds <= {kind, "parameter"}]
            limits[name] = [
                c for c in alone if not c.equality and not ca.depends_on(ca.jacobian(c.expression, symbols), symbols)
            ]
        return limits

    def _start_rows(self) -> list[tuple[Unknowns, list[Rows], int]]:
        """Rows at the start, with the interval on which they stand."""
        unknowns = self.unknowns()
        interval, at = unknowns.interval, self.scheme.start(unknowns.interval)
        groups = self.scheme.start_rows(interval, self.reduced_scales)
        if self.scheme.inputs.joined and self.scheme.stages[0] == 0:
            equalities = [c for c in self._path_at_stages if c.equality]
            groups += self._conditions(equalities, at, unknowns, 0.0)
        if self.scheme.inputs.joined:
            groups += self._conditions(self._limits_of_inputs["u"], at, unknowns, 0.0)
        if self.initial is not None and not self.follows:
            groups += self.scheme.constraint_rows(at.q, at.v, at.t, interval.p, 0.0, self.reduced_scales, at.z)
            groups += self._conditions(self.initial, at, unknowns, 0.0, INITIAL)
        return [(unknowns, groups, 0)] if groups else []

    def _place_rows(self) -> list[tuple[Unknowns, list[Rows], int]]:
        """Conditions at waypoints and at the end, with the intervals that they end."""
        waypoints = zip(self.phase.waypoints, self._waypoints.tolist(), strict=True)
        places: list[tuple[Place, Sequence[Condition], int]] = [
            (Place(f"waypoint {k}"), w.conditions, point) for k, (w, point) in enumerate(waypoints, start=1)
        ]
        result = []
        for place, conditions, point in [*places, (FINAL, self.final, self.count)]:
            if conditions:
                unknowns = self.unknowns()
                at = self.scheme.end(unknowns.interval)
                result.append((unknowns, self._conditions(conditions, at, unknowns, 1.0, place), point - 1))
        return result

    def time_blocks(self, p: ca.SX) -> list[Block]:
        """Order of the free times of waypoints and of mesh points that move."""
        begins_late = self.time_count > 0 and self.begins[0] < self.begins[1]
        times = ca.SX.sym("m", self.time_count)

        def block(groups: list[Rows]) -> Block:
            piece = MappedBlock(times, ca.SX(0, 1), p, stack(groups), ca.SX(0), self.time_index[:, None])
            return Block(piece, groups, ((),))

        durations = [block(self._duration_rows(times))] if begins_late else []
        if self.time_count < 3:
            return durations
        count = self.time_count - 1
        names = [f"the time of switch {k}" for k in range(count + 1)]
        for k, place in enumerate(self.stated_knots):
            names[place] = f"the time of waypoint {k}"
        names[0], names[-1] = "the start", "the end"
        orders = tuple(f"{name} after {before}" for before, name in itertools.pairwise(names))
        moving = np.setdiff1d(np.arange(count + 1), self.stated_knots)
        shortest = np.full(count, SHORTEST_SEGMENT)
        shortest[np.r_[moving - 1, moving]] = SHORTEST_SWITCH
        gaps = times[:-1] - times[1:] + ca.DM(shortest)
        rows = [Rows(gaps, orders, 1.0, np.ones(count), ("durations",) * count, equality=False)]
        if self._longest is not None:
            most = times[1:] - times[:-1] - self._longest * (times[-1] - times[0])
            owners = tuple(f"the longest interval, before {name}" for name in names[1:])
            rows.append(Rows(most, owners, 1.0, np.ones(count), ("durations",) * count, equality=False))
        return [*durations, block(rows)]

    def _duration_rows(self, times: ca.SX) -> list[Rows]:
        """Limits of the duration and of the times of waypoints, if the time at which the phase begins is free."""
        spans = self.phase.time_spans[1:]
        names = [*(f"waypoint {k}" for k in range(1, len(spans))), "the duration"]
        groups = []
        for k, ((low, high), name) in enumerate(zip(spans, names, strict=True), start=1):
            since, size = times[self.stated_knots[k]] - times[0], np.ones(1)
            owner = f"{name} of phase '{self.phase.name}'"
            low, high = low / self.scales.time, high / self.scales.time
            if low == high:
                groups.append(Rows(since - low, (owner,), 1.0, size, ("durations",)))
            else:
                limits = ca.vertcat(since - high, low - since)
                ends = (f"upper limit of {owner}", f"lower limit of {owner}")
                groups.append(Rows(limits, ends, 1.0, np.ones(2), ("durations",) * 2, equality=False))
        return groups

    # --- bounds of the variables ----------------------------------------------------------
    def bounds(self, start: State, mesh_times: np.ndarray, pinned: Sequence[int] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the variables, scaled.

        `start` is the first state if the initial conditions decide it. Of `mesh_times`, the mesh points to begin with,
        s, those that move stay between their neighbours, or where they are if they are `pinned`.
        """
        scheme, mechanism = self.scheme, self.phase.mechanism
        n, bounds = scheme.eom.q.numel(), []
        for side, (name, infinite) in enumerate((("lower", -np.inf), ("upper", np.inf))):
            inputs = [mechanism.inputs[k] for k in scheme.free_inputs]
            u, z = ([getattr(x, name) for x in symbols] for symbols in (inputs, mechanism.states))
            point = np.r_[np.full(2 * n, infinite), z, u if scheme.inputs.joined else []]
            point = np.r_[point, np.full(self.point_size - point.size, infinite)]
            inner = np.full(scheme.interval_size, infinite)
            inner[scheme.interval_slice("u")] = np.tile(u, len(scheme.inputs.inner))
            times = mesh_times[np.clip(self._knots + (2 * side - 1), 0, self.count)][: self.time_count]
            if self.time_count:
                stays = np.isin(self._knots, pinned)
                times[stays] = mesh_times[self._knots[stays]]
                times[self.stated_knots] = [self.begins[side] + span[side] for span in self.phase.time_spans]
            bound = np.r_[np.tile(np.r_[point, inner], self.count), point, times] / self.scale
            if self.initial is None and not self.follows:
                state = np.r_[start.q[scheme.eom.independent], start.v[scheme.eom.independent], start.z]
                bound[: state.size] = state / self.point_scale[: state.size]
            bound[scheme.point_size : self.point_size] = 0.0
            bounds.append(bound)
        return bounds[0], bounds[1]
