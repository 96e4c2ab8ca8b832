"""The part of a phase of no duration in the program: a state just after a change."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ...results.state import State
from ..transcription.points import CollocationPoint, Interval
from ..transcription.rows import FINAL
from .blocks import Block, Edge, Unknowns, block_of_edges
from .phase_program import PhaseProgram


class InstantProgram(PhaseProgram):
    """Variables of a phase of no duration: the state just after a change, and its time if a time is free."""

    def unknowns(self, free: ca.SX | None = None) -> Unknowns:
        """New symbols; `free` are scaled parameters to be shared."""
        point, times = ca.SX.sym("w", self.point_size), ca.SX.sym("m", self.time_count)
        free = ca.SX.sym("f", self.free_scale.size) if free is None else free
        data, none = ca.SX.sym("d", 2), ca.SX(0, 1)
        p, extra = self.phase.with_free(self.p, self._free, ca.DM(self.free_scale) * free)
        start = self.scales.time * times[0] if self.time_count else data[0]
        values = ca.DM(self.point_scale) * point
        interval = Interval(values, none, values, start, ca.SX(0), p)
        return Unknowns(ca.vertcat(point, times), free, data, interval, none, none, extra)

    def edge(self, at_end: bool, free: ca.SX | None = None) -> Edge:
        """The state, which is start and end at once."""
        unknowns, eom = self.unknowns(free), self.scheme.eom
        parts = self.scheme.split_point(unknowns.interval.first)
        zeros = [ca.SX.zeros(size) for size in (eom.q.numel(), eom.lam.numel(), eom.u.numel(), eom.u.numel())]
        a, lam, u, rate = zeros
        at = CollocationPoint(unknowns.interval.start, parts["q"], parts["v"], a, parts["z"], lam, u, rate)
        index = self._first + np.arange(self.size)
        return Edge(unknowns, at, index[:, None], (self.number, 0))

    def blocks(self, free_index: np.ndarray, p: ca.SX, cost_scale: float) -> list[Block]:
        """Conditions on the state that are stated as those of its end."""
        if not self.final:
            return []
        edge = self.edge(True)
        groups = self._conditions(self.final, edge.at, edge.unknowns, 0.0, FINAL)
        return [block_of_edges([edge], groups, p, free_index)]

    def time_blocks(self, p: ca.SX) -> list[Block]:
        """Nothing: the time is that of the end of the phase before."""
        return []

    def bounds(self, start: State, mesh_times: np.ndarray, pinned: Sequence[int] = ()) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the variables, scaled."""
        n, mechanism = self.scheme.eom.q.numel(), self.phase.mechanism
        sides = []
        for side, (name, infinite) in enumerate((("lower", -np.inf), ("upper", np.inf))):
            z = [getattr(x, name) for x in mechanism.states]
            point = np.r_[np.full(2 * n, infinite), z]
            point = np.r_[point, np.zeros(self.point_size - point.size)]  # inputs have no effect at an instant
            sides.append(np.r_[point, np.full(self.time_count, self.begins[side])] / self.scale)
        return sides[0], sides[1]
