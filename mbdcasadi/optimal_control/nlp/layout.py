"""The variables of a program: where they sit, how large they are, what they stand for on one interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ...model.conditions import Condition
from ...model.symbols import Symbol
from ..checks.consistency import own_limits
from ..placeholders import Placeholder, placeholders_in, with_values
from ..preparation import Preparation
from ..refinement.mesh import Mesh
from ..transcription.points import Interval
from .scaling import Sizes, parameter_size


@dataclass(frozen=True)
class Unknowns:
    """Scaled variables and data of one interval, and what they stand for.

    Attributes
    ----------
    variables, free, data : casadi.SX
        Scaled variables without the free parameters, those, and the data.
    interval : Interval
        In physical units.
    gained, next_gained : casadi.SX
        Integrals up to the mesh points before and after.
    own : casadi.SX
        The problem's own parameters.
    """

    variables: ca.SX
    free: ca.SX
    data: ca.SX
    interval: Interval
    gained: ca.SX
    next_gained: ca.SX
    own: ca.SX


class Layout:
    """Variables of the nonlinear program on a mesh of N intervals.

    Nodes and blocks in turn, then the times of the waypoints and the end where
    one of them is free, then the free parameters; each divided by its typical size.

    Parameters
    ----------
    prepared : Preparation
        Problem, transcription, sizes, conditions at the ends.
    mesh : Mesh
        Intervals of each phase.
    """

    def __init__(self, prepared: Preparation, mesh: Mesh):
        problem, scheme = prepared.problem, prepared.scheme
        scales, reduced = prepared.scales, scheme.eom
        #: sizes of what the transcription works in
        self.own_scales = replace(scales.of(reduced.independent, reduced.rows), steps=mesh.count)
        self.problem, self.scheme, self.scales = problem, scheme, scales
        self.count, self._phase = mesh.count, mesh.phase
        eom = problem.equations
        own = ca.vertcat(ca.SX(0, 1), *problem.own_parameters)
        #: what an expression of the problem may hold
        self.arguments = [eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, problem.u_rate, eom.p, own]
        values = np.array([p.value for p in problem.own_parameters])
        self.sizes = Sizes(prepared.numeric, scales, self.arguments, values)
        self.placeholders = self._collect_placeholders()
        self.integrals = [p for p in self.placeholders if p.kind == "integral"]
        self.node_size = scheme.node_size + len(self.integrals)
        node_scale, self.block_scale = scheme.sizes(self.own_scales)
        self.node_scale = np.concatenate([node_scale, [self._typical(p) for p in self.integrals]])
        self.mark_count = len(problem.waypoints) + 2 if problem.has_free_times else 0
        free = [parameter_size(p.value, p.lower, p.upper) for p in problem.free_parameters]
        self.global_scale = np.r_[np.full(self.mark_count, scales.time), free]
        self.size = self.count * self.stride + self.node_size + self.global_scale.size
        self.given = ca.SX.sym("p", eom.p.numel())

    def _collect_placeholders(self) -> list[Placeholder]:
        expressions = [self.problem.terminal_cost, *[c.expression for c in self.problem.boundary]]
        return list({p.element_hash(): p for e in expressions for p in placeholders_in(e)}.values())

    @cached_property
    def cost_scale(self) -> float:
        """Typical size of the cost, so that the solver's tolerance means the same in any unit."""
        running, terminal = self.problem.running_cost, self.problem.terminal_cost
        size = 0.0 if running.is_zero() else self.scales.time * self.sizes.of_values(running)
        if not terminal.is_zero():
            size += self.sizes.of_values(with_values(terminal, self._typical))
        return size or 1.0

    def _typical(self, placeholder: Placeholder) -> float:
        """Typical value of a placeholder."""
        span = self.scales.time if placeholder.kind == "integral" else 1.0
        return span * self.sizes.of_values(placeholder.expression)

    # --- layout ------------------------------------------------------------------------------
    @cached_property
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
    def mark_index(self) -> np.ndarray:
        """Where the times of start, waypoints and end sit, if one of them is free."""
        first = self.size - self.global_scale.size
        return np.arange(first, first + self.mark_count)

    @property
    def parameter_index(self) -> np.ndarray:
        """Where the free parameters sit."""
        return np.arange(self.size - self.global_scale.size + self.mark_count, self.size)

    @cached_property
    def scale(self) -> np.ndarray:
        """Size of every variable."""
        one = np.concatenate([self.node_scale, self.block_scale])
        return np.concatenate([np.tile(one, self.count), self.node_scale, self.global_scale])

    def interval_index(self, intervals: Sequence[int]) -> np.ndarray:
        """Variables of intervals, each a column: its nodes, its block, the times of its phase."""
        own = np.arange(self.stride + self.node_size)[:, None] + self.stride * np.asarray(intervals, int)
        if not self.mark_count:
            return own
        return np.vstack([own, self.mark_index[self._phase[intervals] + np.arange(2)[:, None]]])

    # --- symbols of one interval -----------------------------------------------------------------
    def unknowns(self, free: ca.SX | None = None) -> Unknowns:
        """New symbols for one interval; `free` are scaled parameters to be shared with another one."""
        marks = 2 if self.mark_count else 0
        sizes = [self.node_size, self.scheme.block_size, self.node_size, marks]
        node, block, next_node, times = (ca.SX.sym(x, size) for x, size in zip("wbxm", sizes, strict=True))
        free = ca.SX.sym("f", len(self.problem.free_parameters)) if free is None else free
        data = ca.SX.sym("d", 2)
        before, after = (ca.DM(self.node_scale) * x for x in (node, next_node))
        p, own = self._parameters(ca.DM(self.global_scale[self.mark_count :]) * free)
        start, length = data[0], data[1]
        if marks:
            phase = self.scales.time * (times[1] - times[0])
            start, length = self.scales.time * times[0] + data[0] * phase, data[1] * phase
        plain = self.scheme.node_size
        inner = ca.DM(self.block_scale) * block
        interval = Interval(before[:plain], inner, after[:plain], start, length, p)
        variables = ca.vertcat(node, block, next_node, times)
        return Unknowns(variables, free, data, interval, before[plain:], after[plain:], own)

    def _parameters(self, free: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Parameters of the mechanism and the problem's own, with the free ones put in."""
        problem, p, own = self.problem, ca.SX(self.given), []
        for k, symbol in enumerate(problem.free_parameters):
            place = next((i for i, x in enumerate(problem.mechanism.parameters) if x is symbol), None)
            if place is None:
                own.append(free[k])
            else:
                p[place] = free[k]
        return p, ca.vertcat(ca.SX(0, 1), *own)

    @cached_property
    def limit_owners(self) -> dict[Condition, tuple[Symbol, int]]:
        """Limits that inputs and first-order states carry themselves, with the symbol and the side."""
        return own_limits(self.problem.mechanism)
