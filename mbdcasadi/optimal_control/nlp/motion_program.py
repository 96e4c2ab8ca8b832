"""From a problem and a transcription to a nonlinear program with a label for every row."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.cache import Cache
from ...model.conditions import Condition, stacked
from ..placeholders import with_values
from ..preparation import Preparation
from ..refinement.mesh import Mesh
from ..transcription.points import Point
from .layout import Layout, Unknowns
from .rows import OWN_UNIT, Row, Rows, stack, violations
from .sparse_program import Piece, SparseProgram

#: Least length of a phase between free times, as a share of the typical duration.
LEAST_PHASE = 1e-3


@dataclass(frozen=True)
class Block:
    """Rows of one kind, and for each copy of them the intervals that they see; they stand on the last one."""

    groups: list[Rows]
    copies: tuple[tuple[int, ...], ...]


class MotionProgram(Layout):
    """The nonlinear program of an optimal-control problem on a mesh of N intervals.

    The shares of the mesh are data, so that one compiled program serves every
    mesh with as many intervals in each phase.

    Parameters
    ----------
    prepared : Preparation
        Problem, transcription, sizes, conditions at the ends.
    mesh : Mesh
        Intervals of each phase.
    """

    def __init__(self, prepared: Preparation, mesh: Mesh):
        super().__init__(prepared, mesh)
        self.initial, self.final = prepared.initial, prepared.final
        self.blocks: list[Block] = []
        self._compiled = Cache()
        pieces = [self._interval_piece(), *self._place_pieces(), *self._end_pieces(), *self._time_pieces()]
        self.program = SparseProgram(self.size, pieces, self.given)

    # --- expressions ------------------------------------------------------------------------------
    def _value(self, expression: ca.SX, at: Point, unknowns: Unknowns) -> ca.SX:
        return self._put_in(ca.Function("e", self.arguments, [expression]), at, unknowns)

    def _put_in(self, function: ca.Function, at: Point, unknowns: Unknowns) -> ca.SX:
        at = self.scheme.expanded(at, unknowns.interval.p)
        return function(*at.arguments, unknowns.interval.p, unknowns.own)

    def _integral(self, expression: ca.SX, points: Sequence[Point], unknowns: Unknowns) -> ca.SX:
        if expression.is_zero():
            return ca.SX(0)
        values = (self._value(expression, at, unknowns) for at in points)
        weighted = (float(w) * value for w, value in zip(self.scheme.quadrature, values, strict=True))
        return unknowns.interval.length * sum(weighted, ca.SX(0))

    def _rows_of(
        self, conditions: Sequence[Condition], values: Sequence[ca.SX], share: float, word: str = ""
    ) -> list[Rows]:
        """Conditions with their values at a place: equalities, and limits, of which two-sided ones are one row."""
        groups = []
        known = dict(zip(conditions, values, strict=True))
        lower_sides = {c.opposite for c in conditions if c.opposite in known}
        for equality in (True, False):
            chosen = [c for c in conditions if c.equality is equality and c not in lower_sides]
            if chosen:
                pairs = [c.opposite if c.opposite in lower_sides else None for c in chosen]
                group = Rows(
                    ca.vertcat(*[known[c] for c in chosen]),
                    tuple(word + c.label for c in chosen),
                    share,
                    np.array([self._condition_sizes[c] for c in chosen]),
                    (OWN_UNIT,) * len(chosen),
                    equality,
                    condition=True,
                    spans=np.array([c.span if other else np.inf for c, other in zip(chosen, pairs, strict=True)]),
                    opposites=tuple(word + other.label if other else "" for other in pairs),
                )
                groups.append(group)
        return groups

    def _conditions(
        self, conditions: Sequence[Condition], at: Point, unknowns: Unknowns, share: float, word: str = ""
    ) -> list[Rows]:
        """Conditions at a point."""
        if not conditions:
            return []
        key = "conditions", *map(id, conditions)
        function = self._compiled.get_or_create(key, lambda: ca.Function("c", self.arguments, [stacked(conditions)]))
        return self._rows_of(conditions, ca.vertsplit(self._put_in(function, at, unknowns)), share, word)

    @cached_property
    def _condition_sizes(self) -> dict[Condition, float]:
        problem = self.problem
        waypoints = [c for w in problem.waypoints for c in w.conditions]
        given = [*(self.initial or ()), *self.final, *problem.path, *waypoints, *self.limit_owners]
        limits = [c for c in given if not c.equality]
        found = dict(zip(limits, self.sizes.of_limits([c.expression for c in limits]), strict=True))
        equalities = [c for c in given if c.equality]
        expressions = [c.expression for c in equalities]
        expressions += [with_values(c.expression, lambda p: p.expression) for c in problem.boundary]
        return found | dict(zip([*equalities, *problem.boundary], self.sizes.of_changes(expressions), strict=True))

    # --- pieces -----------------------------------------------------------------------------------
    def _piece(self, unknowns: Unknowns, groups: list[Rows], cost: ca.SX, intervals: Sequence[int]) -> Piece:
        self.blocks.append(Block([g for g in groups if g.labels], tuple((i,) for i in intervals)))
        free = np.tile(self.parameter_index[:, None], (1, len(intervals)))
        index = np.vstack([self.interval_index(intervals), free])
        variables = ca.vertcat(unknowns.variables, unknowns.free)
        return Piece(variables, unknowns.data, self.given, stack(groups), cost / self.cost_scale, index)

    def _interval_piece(self) -> Piece:
        unknowns = self.unknowns()
        points = self.scheme.points(unknowns.interval)
        groups = self.scheme.equations(unknowns.interval, self.own_scales)
        for k, placeholder in enumerate(self.integrals):
            gain = unknowns.next_gained[k] - unknowns.gained[k]
            row = gain - self._integral(placeholder.expression, points, unknowns)
            size = self.node_scale[self.scheme.node_size + k :][:1]
            groups.append(Rows(row, (f"accumulation of {placeholder.label}",), 1.0, size, (OWN_UNIT,)))
        groups += self._path_rows(unknowns, points)
        return self._piece(
            unknowns, groups, self._integral(self.problem.running_cost, points, unknowns), list(range(self.count))
        )

    def _path_rows(self, unknowns: Unknowns, points: list[Point]) -> list[Rows]:
        """Path conditions at the stages and at the ends of the interval."""
        scheme, groups = self.scheme, []
        start, end = scheme.start(unknowns.interval), scheme.end(unknowns.interval)
        held = set(scheme.constraints.held)
        conditions = [c for c in (*self.problem.path, *self.limit_owners) if c not in held]
        equalities = [c for c in conditions if c.equality]
        limits = [c for c in conditions if not c.equality]

        def place(some: list[Condition], at: Point, share: float) -> None:
            here = [c for c in some if share not in self._held_by_bounds.get(c, ())]
            groups.extend(self._conditions(here, at, unknowns, share))

        jumping = [c for c in limits if c.depends_on("acceleration", "multiplier", "input", "input rate")]
        place(jumping, start, 0.0)
        for share, at in zip(scheme.stages.tolist(), points, strict=True):
            # where inputs are joined, the end of the interval before has the row at the start
            here = equalities if share > 0 or not scheme.inputs.joined else []
            place([*here, *(limits if 0 < share < 1 else [])], at, share)
        place(limits, end, 1.0)
        return groups

    def _path_rows_at_start(self, at: Point, unknowns: Unknowns) -> list[Rows]:
        """Path equalities at the first mesh point, where a stage lies on it and the inputs are joined."""
        if not self.scheme.inputs.joined or self.scheme.stages[0] > 0:
            return []
        held = set(self.scheme.constraints.held)
        conditions = [c for c in self.problem.path if c.equality and c not in held]
        return self._conditions(conditions, at, unknowns, 0.0)

    @cached_property
    def _held_by_bounds(self) -> dict[Condition, tuple[float, ...]]:
        """Shares at which a limit is a bound of a variable and needs no row."""
        shares = tuple(self.scheme.inputs.shares.tolist())
        return {c: shares if c.depends_on("input") else (1.0,) for c in self.limit_owners}

    def _place_pieces(self) -> list[Piece]:
        """Conditions at the start, at waypoints and at the end."""
        pieces = []
        unknowns = self.unknowns()
        interval, at = unknowns.interval, self.scheme.start(unknowns.interval)
        groups = [*self.scheme.start_rows(interval, self.own_scales), *self._path_rows_at_start(at, unknowns)]
        if self.initial is not None:
            groups += self.scheme.constraint_rows(at.q, at.v, at.t, interval.p, 0.0, self.own_scales)
            groups += self._conditions(self.initial, at, unknowns, 0.0, "initial: ")
        if groups:
            pieces.append(self._piece(unknowns, groups, ca.SX(0), [0]))
        nodes = [int(np.sum(self._phase <= k)) for k in range(len(self.problem.waypoints))]
        places = [(f"waypoint {k + 1}", w.conditions, nodes[k]) for k, w in enumerate(self.problem.waypoints)]
        for word, conditions, node in [*places, ("final", self.final, self.count)]:
            if conditions:
                unknowns = self.unknowns()
                at = self.scheme.end(unknowns.interval)
                groups = self._conditions(conditions, at, unknowns, 1.0, f"{word}: ")
                pieces.append(self._piece(unknowns, groups, ca.SX(0), [node - 1]))
        return pieces

    def _end_pieces(self) -> list[Piece]:
        """Boundary conditions and the terminal cost, which see the start and the end."""
        problem = self.problem
        if problem.terminal_cost.is_zero() and not problem.boundary:
            return []
        first = self.unknowns()
        last = self.unknowns(first.free)
        conditions = problem.boundary
        values = [self._boundary_value(c.expression, first, last) for c in conditions]
        groups = self._rows_of(conditions, values, 1.0, "boundary: ")
        cost = self._boundary_value(problem.terminal_cost, first, last) / self.cost_scale
        self.blocks.append(Block(groups, ((0, self.count - 1),)))
        first_and_last = self.interval_index([0, self.count - 1]).T.ravel()
        index = np.r_[first_and_last, self.parameter_index][:, None]
        variables = ca.vertcat(first.variables, last.variables, first.free)
        return [Piece(variables, ca.vertcat(first.data, last.data), self.given, stack(groups), cost, index)]

    def _boundary_value(self, expression: ca.SX, first: Unknowns, last: Unknowns) -> ca.SX:
        """Expression with placeholders put in; other symbols are taken at the end."""
        begin, end = self.scheme.start(first.interval), self.scheme.end(last.interval)
        gained = last.next_gained - first.gained
        values = []
        for placeholder in self.placeholders:
            if placeholder.kind == "integral":
                values.append(gained[next(k for k, x in enumerate(self.integrals) if x is placeholder)])
            else:
                at, unknowns = (begin, first) if placeholder.kind == "at_start" else (end, last)
                values.append(self._value(placeholder.expression, at, unknowns))
        symbols = ca.vertcat(ca.SX(0, 1), *self.placeholders)
        function = ca.Function("boundary", [*self.arguments, symbols], [expression])
        end = self.scheme.expanded(end, last.interval.p)
        return function(*end.arguments, last.interval.p, last.own, ca.vertcat(ca.SX(0, 1), *values))

    def _time_pieces(self) -> list[Piece]:
        """Order of the free times of waypoints."""
        if self.mark_count < 3:
            return []
        times = ca.SX.sym("m", self.mark_count)
        count = self.mark_count - 1
        names = [*[f"the time of waypoint {k}" for k in range(1, count)], "the end"]
        labels = tuple(f"{name} after {before}" for name, before in zip(names, ["the start", *names], strict=False))
        rows = Rows(times[:-1] - times[1:] + LEAST_PHASE, labels, 1.0, np.ones(count), ("durations",) * count, False)
        self.blocks.append(Block([rows], ((),)))
        return [Piece(times, ca.SX(0, 1), self.given, stack([rows]), ca.SX(0), self.mark_index[:, None])]

    # --- what enters a solve --------------------------------------------------------------------
    def data(self, numeric: NumericEquations, mesh: Mesh, marks: np.ndarray) -> np.ndarray:
        """Parameters of the compiled program: those of the mechanism, and the intervals."""
        if self.mark_count:
            begin, length = mesh.begin, mesh.length
        else:
            times = mesh.times(marks)
            begin, length = times[:-1], np.diff(times)
        seen = [k for block in self.blocks for copy in block.copies for k in copy]
        return np.r_[numeric.p, np.column_stack([begin[seen], length[seen]]).ravel()]

    @cached_property
    def rows(self) -> list[Row]:
        """All rows, in the order of the program."""
        return [
            row
            for block in self.blocks
            for copy in block.copies
            for group in block.groups
            for row in group.on(copy[-1] if copy else -1)
        ]

    def with_integrals(self, x: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """Variables with the integrals that belong to the motion, from the rows where they are zero."""
        x, first = x.copy(), self.scheme.node_size
        names = {f"accumulation of {p.label}": k for k, p in enumerate(self.integrals)}
        gains = np.zeros((self.count, len(self.integrals)))
        for k, row in enumerate(self.rows[: self.interval_rows]):
            if row.label in names:
                gains[row.interval, names[row.label]] = -rows[k]
        total = np.cumsum(np.nan_to_num(gains), axis=0)
        for i in range(self.count):
            x[self.node_index(i + 1)[first:]] = total[i]
        return x

    def violation(self, rows: np.ndarray) -> float:
        """Largest violation of scaled rows."""
        return float(np.max(violations(rows, self.lower), initial=0.0))

    @cached_property
    def interval_rows(self) -> int:
        """How many of the rows belong to the intervals; those of places follow."""
        return self.count * sum(len(group.labels) for group in self.blocks[0].groups)

    @cached_property
    def lower(self) -> np.ndarray:
        """Lower bounds of the rows, scaled: zero for equalities; the upper ones are zero."""
        return np.array([row.lower for row in self.rows])
