"""Variables of a phase: their places in the program, their sizes, and what they stand for on one interval."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import casadi as ca
import numpy as np

from ...model.conditions import Condition
from ...model.symbols import Symbol
from ..checks.consistency import own_limits
from ..placeholders import Placeholder
from ..problem import OptimalControlProblem
from ..refinement.mesh import Mesh
from ..transcription.points import Interval
from .scaling import Sizes, parameter_size
from .setup import PhaseSetup


@dataclass(frozen=True)
class Unknowns:
    """Scaled variables and data of one interval, and what they stand for.

    Attributes
    ----------
    variables, free, data : casadi.SX
        Scaled variables without the free parameters, those, and the data.
    interval : Interval
        In physical units.
    integrals, next_integrals : casadi.SX
        Integrals up to the mesh points before and after.
    extra : casadi.SX
        Free parameters that the mechanism does not have.
    """

    variables: ca.SX
    free: ca.SX
    data: ca.SX
    interval: Interval
    integrals: ca.SX
    next_integrals: ca.SX
    extra: ca.SX


class PhaseLayout:
    """Variables of a phase on a mesh of N intervals.

    Those of the mesh points and of the intervals in turn, then the times of start, waypoints and end if
    a time of the problem is free; each divided by its typical size.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to which the phase belongs.
    setup : PhaseSetup
        Transcription, sizes, conditions at the ends.
    mesh : Mesh
        Intervals of each segment.
    integrals : sequence of Placeholder
        Integrals that are accumulated.
    first : int
        Number of variables of the phases before.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        setup: PhaseSetup,
        mesh: Mesh,
        integrals: Sequence[Placeholder] = (),
        first: int = 0,
    ):
        self.problem, self.setup, self.phase, self.scheme, self.scales = (
            problem, setup, setup.phase, setup.scheme, setup.scales,
        )  # fmt: skip
        reduced = self.scheme.eom
        #: sizes of what the transcription works in
        self.reduced_scales = replace(self.scales.of(reduced.independent, reduced.rows), steps=mesh.count)
        self.count, self._segment, self._first = mesh.count, mesh.segment, first
        eom, extra = self.phase.equations, problem.extra_parameters(self.phase)
        self._extra = ca.vertcat(ca.SX(0, 1), *extra)
        #: symbols that an expression of the problem may contain
        self.arguments = [
            eom.t, eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u, self.phase.input_rates, eom.p, self._extra,
        ]  # fmt: skip
        self.sizes = Sizes(setup.numeric, self.scales, self.arguments, np.array([p.value for p in extra]))
        self.integrals = list(integrals)
        self.point_size = self.scheme.point_size + len(self.integrals)
        point_scale, self.inner_scale = self.scheme.sizes(self.reduced_scales)
        self.point_scale = np.concatenate([point_scale, [self.typical_value(p) for p in self.integrals]])
        self.time_count = len(self.phase.waypoints) + 2 if problem.has_free_times else 0
        self.free_scale = np.array([parameter_size(p.value, p.lower, p.upper) for p in problem.free_parameters])
        self.size = self.count * self.stride + self.point_size + self.time_count
        #: parameters of the mechanism that are given
        self.given = ca.SX.sym("p", eom.p.numel())

    def typical_value(self, placeholder: Placeholder) -> float:
        """Typical value of a placeholder."""
        span = self.scales.time if placeholder.kind == "integral" else 1.0
        return span * self.sizes.of_values(placeholder.expression)

    # --- places of the variables ----------------------------------------------------------
    @cached_property
    def stride(self) -> int:
        """Number of variables of a mesh point and the interval after it."""
        return self.point_size + self.scheme.interval_size

    def point_index(self, k: int) -> np.ndarray:
        """Places of the variables of a mesh point."""
        return self._first + np.arange(self.point_size) + k * self.stride

    def inner_index(self, i: int) -> np.ndarray:
        """Places of the variables of an interval alone."""
        return self._first + np.arange(self.scheme.interval_size) + i * self.stride + self.point_size

    @property
    def time_index(self) -> np.ndarray:
        """Places of the times of start, waypoints and end, if a time is free."""
        end = self._first + self.size
        return np.arange(end - self.time_count, end)

    @cached_property
    def scale(self) -> np.ndarray:
        """Size of every variable."""
        one = np.concatenate([self.point_scale, self.inner_scale])
        times = np.full(self.time_count, self.scales.time)
        return np.concatenate([np.tile(one, self.count), self.point_scale, times])

    def interval_index(self, intervals: Sequence[int]) -> np.ndarray:
        """Variables of intervals, each a column: mesh points and interval, and the times of its segment."""
        places = np.arange(self.stride + self.point_size)[:, None] + self.stride * np.asarray(intervals, int)
        if not self.time_count:
            return self._first + places
        return np.vstack([self._first + places, self.time_index[self._segment[intervals] + np.arange(2)[:, None]]])

    # --- symbols of one interval ----------------------------------------------------------
    def unknowns(self, free: ca.SX | None = None) -> Unknowns:
        """New symbols for one interval; `free` are scaled parameters to be shared with another one."""
        times_count = 2 if self.time_count else 0
        sizes = [self.point_size, self.scheme.interval_size, self.point_size, times_count]
        first, inner, last, times = (ca.SX.sym(x, size) for x, size in zip("wbxm", sizes, strict=True))
        free = ca.SX.sym("f", self.free_scale.size) if free is None else free
        data = ca.SX.sym("d", 2)
        before, after = (ca.DM(self.point_scale) * x for x in (first, last))
        p, extra = self._parameters(ca.DM(self.free_scale) * free)
        start, length = data[0], data[1]
        if times_count:
            segment = self.scales.time * (times[1] - times[0])
            start, length = self.scales.time * times[0] + data[0] * segment, data[1] * segment
        plain = self.scheme.point_size
        interval = Interval(before[:plain], ca.DM(self.inner_scale) * inner, after[:plain], start, length, p)
        variables = ca.vertcat(first, inner, last, times)
        return Unknowns(variables, free, data, interval, before[plain:], after[plain:], extra)

    def _parameters(self, free: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Parameters of the mechanism with the free ones substituted, and free parameters that it does not have."""
        p, extra = ca.SX(self.given), []
        for k, symbol in enumerate(self.problem.free_parameters):
            place = next((i for i, x in enumerate(self.phase.mechanism.parameters) if x is symbol), None)
            if place is None:
                extra.append(free[k])
            else:
                p[place] = free[k]
        return p, ca.vertcat(ca.SX(0, 1), *extra)

    @cached_property
    def limit_owners(self) -> dict[Condition, tuple[Symbol, int]]:
        """Limits that inputs and first-order states carry themselves, with the symbol and the side."""
        return own_limits(self.phase.mechanism)
