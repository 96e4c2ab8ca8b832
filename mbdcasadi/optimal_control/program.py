"""From a problem and a transcription to a nonlinear program with a label for every row."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..model.conditions import Condition
from ..results.state import State
from .assembly import Piece, SparseProgram
from .gauss import GaussCollocation, Point
from .interval import Rows, Scales
from .problem import OptimalControlProblem, Placeholder, placeholders_in


class MotionProgram:
    """The nonlinear program of an optimal-control problem on a mesh of N intervals.

    Variables are nodes and blocks in turn, then the duration and the free
    parameters, each divided by its typical size. The shares of the mesh are
    data, so that one compiled program serves every mesh of N intervals.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    numeric : NumericEquations
        Equations at the parameters that are not sought.
    scheme : GaussCollocation
        The transcription.
    scales : Scales
        Typical sizes.
    count : int
        Number of intervals.
    fixed_start : bool
        Whether the first node is given.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        numeric: NumericEquations,
        scheme: GaussCollocation,
        scales: Scales,
        count: int,
        *,
        fixed_start: bool,
    ):
        self.problem, self.numeric, self.scheme, self.scales = problem, numeric, scheme, scales
        self.count = count
        self.fixed_start = fixed_start
        eom = problem.equations
        self.placeholders = self._collect_placeholders()
        self.integrals = [p for p in self.placeholders if p.kind == "integral"]
        self.node_size = scheme.node_size + len(self.integrals)
        node_scale, self.block_scale = scheme.scales(scales)
        self.node_scale = np.concatenate([node_scale, np.ones(len(self.integrals))])
        self.global_scale = np.array([scales.time, *[_size_of(p) for p in problem.free_parameters]])
        self.size = count * (self.node_size + scheme.block_size) + self.node_size + self.global_scale.size
        self._given = ca.SX.sym("p", eom.p.numel())
        self._interval = self._interval_piece()
        self._ends = self._ends_piece()
        self.program = SparseProgram(self.size, [self._interval, self._ends], self._given)

    def _collect_placeholders(self) -> list[Placeholder]:
        expressions = [self.problem.terminal_cost, *[c.expression for c in self.problem.boundary]]
        found: dict[int, Placeholder] = {}
        for expression in expressions:
            for placeholder in placeholders_in(expression):
                found[placeholder.element_hash()] = placeholder
        return list(found.values())

    # --- layout ------------------------------------------------------------------------------
    @property
    def stride(self) -> int:
        """Variables of a node and a block."""
        return self.node_size + self.scheme.block_size

    def node_index(self, k: int) -> np.ndarray:
        """Where a node sits among the variables."""
        return np.arange(self.node_size) + k * self.stride

    def block_index(self, i: int) -> np.ndarray:
        """Where the block of an interval sits."""
        return np.arange(self.scheme.block_size) + i * self.stride + self.node_size

    @property
    def global_index(self) -> np.ndarray:
        """Where duration and free parameters sit."""
        return np.arange(self.size - self.global_scale.size, self.size)

    @cached_property
    def scale(self) -> np.ndarray:
        """Size of every variable."""
        one = np.concatenate([self.node_scale, self.block_scale])
        return np.concatenate([np.tile(one, self.count), self.node_scale, self.global_scale])

    # --- symbols --------------------------------------------------------------------------------
    def _globals(self, hat: ca.SX) -> tuple[ca.SX, ca.SX, dict[int, ca.SX]]:
        """Duration, parameter vector, and the problem's own parameters, from scaled globals."""
        values = ca.DM(self.global_scale) * hat
        p = ca.SX(self._given)
        own: dict[int, ca.SX] = {}
        parameters = self.problem.mechanism.parameters
        for k, free in enumerate(self.problem.free_parameters):
            place = next((i for i, x in enumerate(parameters) if x is free), None)
            if place is None:
                own[free.element_hash()] = values[1 + k]
            else:
                p[place] = values[1 + k]
        return values[0], p, own

    def _expression(self, expression: ca.SX) -> ca.Function:
        """Expression of the model as a function of ``(t, q, v, a, z, lam, u, p, own parameters)``."""
        eom = self.problem.equations
        own = ca.vertcat(ca.SX(0, 1), *self.problem.own_parameters)
        return ca.Function("e", [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, eom.p, own], [expression])

    def _own(self, own: dict[int, ca.SX]) -> ca.SX:
        return ca.vertcat(ca.SX(0, 1), *[own[p.element_hash()] for p in self.problem.own_parameters])

    @staticmethod
    def _at(function: ca.Function, point: Point, p: ca.SX, own: ca.SX) -> ca.SX:
        return function(point.t, point.q, point.v, point.a, point.z, point.lam, point.u, p, own)

    # --- one interval ---------------------------------------------------------------------------
    def _interval_piece(self) -> Piece:
        scheme, n = self.scheme, self.node_size
        w0, block, w1 = (ca.SX.sym(x, s) for x, s in (("w0", n), ("b", scheme.block_size), ("w1", n)))
        hats, data = ca.SX.sym("g", self.global_scale.size), ca.SX.sym("d", 2)
        node, next_node = ca.DM(self.node_scale) * w0, ca.DM(self.node_scale) * w1
        inner = ca.DM(self.block_scale) * block
        duration, p, own_by_hash = self._globals(hats)
        own = self._own(own_by_hash)
        start, length = duration * data[0], duration * data[1]
        plain, next_plain = node[: scheme.node_size], next_node[: scheme.node_size]
        stages = scheme.stages(plain, inner, start, length)
        groups = scheme.equations(plain, inner, next_plain, start, length, p, self.scales)
        for k, placeholder in enumerate(self.integrals):
            part = self._quadrature(placeholder.expression, stages, length, p, own)
            row = next_node[scheme.node_size + k] - node[scheme.node_size + k] - part
            groups.append(Rows(row, (f"accumulation of {placeholder.label}",), 1.0, np.ones(1)))
        cost = self._quadrature(self.problem.running_cost, stages, length, p, own)
        limits = self._path_rows(plain, inner, next_plain, stages, start, length, p, own)
        self.interval_groups = [*groups, *limits]
        rows = ca.vertcat(*[g.expression / ca.DM(g.scale) for g in self.interval_groups if g.expression.numel()])
        index = np.column_stack(
            [
                np.concatenate([self.node_index(i), self.block_index(i), self.node_index(i + 1), self.global_index])
                for i in range(self.count)
            ]
        )
        return Piece(ca.vertcat(w0, block, w1, hats), data, self._given, rows, cost, index)

    def _quadrature(self, expression: ca.SX, stages: list[Point], length: ca.SX, p: ca.SX, own: ca.SX) -> ca.SX:
        if expression.is_zero():
            return ca.SX(0)
        function = self._expression(expression)
        total = ca.SX(0)
        for weight, at in zip(self.scheme.coefficients.weights, stages, strict=True):
            total += float(weight) * self._at(function, at, p, own)
        return length * total

    def _path_rows(
        self,
        node: ca.SX,
        block: ca.SX,
        next_node: ca.SX,
        stages: list[Point],
        start: ca.SX,
        length: ca.SX,
        p: ca.SX,
        own: ca.SX,
    ) -> list[Rows]:
        """Path conditions at the stages and at the ends of the interval."""
        ends = [self.scheme.point(node, block, start, length, share) for share in (0.0, 1.0)]
        limits = []
        for condition in [*self.problem.path, *self._own_limits()]:
            function = self._expression(condition.expression)
            jumps = condition.depends_on("acceleration", "multiplier", "input")
            places = list(zip(self.scheme.coefficients.points, stages, strict=True))
            if not condition.equality:
                if jumps:
                    places += [(0.0, ends[0]), (1.0, ends[1])]
                else:
                    q, v, z = self.scheme.split(next_node)
                    places.append((1.0, Point(start + length, q, v, ends[1].a, z, ends[1].lam, ends[1].u)))
            for share, at in places:
                value = self._at(function, at, p, own)
                limits.append(Rows(value, (condition.label,), float(share), np.ones(1), condition.equality))
        return limits

    def _own_limits(self) -> list[Condition]:
        """Limits that inputs and states carry themselves."""
        found = []
        for symbol in (*self.problem.mechanism.inputs, *self.problem.mechanism.states):
            for sign, bound in ((1, symbol.upper), (-1, symbol.lower)):
                if np.isfinite(bound):
                    size = max(abs(bound), 1e-9)
                    text = f"{symbol.label} {'<=' if sign > 0 else '>='} {bound:g}"
                    found.append(Condition(sign * (symbol - bound) / size, False, text))
        return found

    # --- both ends --------------------------------------------------------------------------------
    def _ends_piece(self) -> Piece:
        scheme, n = self.scheme, self.node_size
        names = (("w0", n), ("b0", scheme.block_size), ("wl", n), ("bl", scheme.block_size), ("wN", n))
        w0, b0, w_last, b_last, w_end = (ca.SX.sym(name, size) for name, size in names)
        hats, data = ca.SX.sym("g", self.global_scale.size), ca.SX.sym("d", 2)
        nodes = [ca.DM(self.node_scale) * w for w in (w0, w_last, w_end)]
        blocks = [ca.DM(self.block_scale) * b for b in (b0, b_last)]
        duration, p, own_by_hash = self._globals(hats)
        own = self._own(own_by_hash)
        first, before, last = (node[: scheme.node_size] for node in nodes)
        begin = scheme.point(first, blocks[0], ca.SX(0), duration * data[0], 0.0)
        inner = scheme.point(before, blocks[1], duration * (1 - data[1]), duration * data[1], 1.0)
        q, v, z = scheme.split(last)
        end = Point(duration, q, v, inner.a, z, inner.lam, inner.u)
        groups = self._boundary_rows(first, begin, end, nodes[2] - nodes[0], p, own)
        cost = self._boundary_value(self.problem.terminal_cost, begin, end, nodes[2] - nodes[0], p, own)
        self.end_groups = groups
        rows = ca.vertcat(ca.SX(0, 1), *[g.expression / ca.DM(g.scale) for g in groups if g.expression.numel()])
        index = np.concatenate(
            [
                self.node_index(0),
                self.block_index(0),
                self.node_index(self.count - 1),
                self.block_index(self.count - 1),
                self.node_index(self.count),
                self.global_index,
            ]
        )[:, None]
        return Piece(ca.vertcat(w0, b0, w_last, b_last, w_end, hats), data, self._given, rows, cost, index)

    def _boundary_rows(self, first: ca.SX, begin: Point, end: Point, gained: ca.SX, p: ca.SX, own: ca.SX) -> list[Rows]:
        groups: list[Rows] = []
        problem = self.problem
        if not self.fixed_start:
            groups += [*self.scheme.consistent(first, ca.SX(0), p, self.scales)]
            for condition in () if isinstance(problem.initial, State) else problem.initial:
                value = self._at(self._expression(condition.expression), begin, p, own)
                groups.append(Rows(value, (f"initial: {condition.label}",), 0.0, np.ones(1), condition.equality))
        for condition in problem.final:
            value = self._at(self._expression(condition.expression), end, p, own)
            groups.append(Rows(value, (f"final: {condition.label}",), 1.0, np.ones(1), condition.equality))
        for condition in problem.boundary:
            value = self._boundary_value(condition.expression, begin, end, gained, p, own)
            groups.append(Rows(value, (f"boundary: {condition.label}",), 1.0, np.ones(1), condition.equality))
        return groups

    def _boundary_value(
        self, expression: ca.SX, begin: Point, end: Point, gained: ca.SX, p: ca.SX, own: ca.SX
    ) -> ca.SX:
        """Expression with placeholders put in; other symbols are taken at the end."""
        symbols, values = [], []
        for k, placeholder in enumerate(self.integrals):
            symbols.append(placeholder)
            values.append(gained[self.scheme.node_size + k])
        for placeholder in self.placeholders:
            if placeholder.kind != "integral":
                at = begin if placeholder.kind == "at_start" else end
                symbols.append(placeholder)
                values.append(self._at(self._expression(placeholder.expression), at, p, own))
        bare = [ca.SX.sym(f"e{k}") for k in range(len(symbols))]
        replaced = ca.substitute(expression, ca.vertcat(ca.SX(0, 1), *symbols), ca.vertcat(ca.SX(0, 1), *bare))
        eom = self.problem.equations
        own_symbols = ca.vertcat(ca.SX(0, 1), *self.problem.own_parameters)
        arguments = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, eom.p, own_symbols, *bare]
        function = ca.Function("boundary", arguments, [replaced])
        return function(end.t, end.q, end.v, end.a, end.z, end.lam, end.u, p, own, *values)


def _size_of(parameter: Any) -> float:
    return max(abs(parameter.value), 1e-6)
