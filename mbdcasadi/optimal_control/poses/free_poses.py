"""Poses at the start, at the waypoints and at the end of a phase, with the free parameters among the unknowns.

A pendulum of free length reaches places that it does not reach with the length of its estimate. All places are
assembled together, since they share the parameters, within the limits of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...equations.numeric import NumericEquations
from ...model.conditions import Condition
from ...model.symbols import Parameter
from ...numerics.least_squares import largest
from ...numerics.nearest import nearest_by_ipopt
from ...numerics.newton import solve
from ...numerics.tolerances import MET
from ...results.state import State
from ..statement.phase import Phase, on_positions
from ..statement.statement import ProblemStatement
from .pose_system import Place, PoseSystem, newton_rows


@dataclass(frozen=True)
class PosedPlace:
    """A time, s, and what holds there: conditions, or a state."""

    time: float
    conditions: State | Sequence[Condition]


@dataclass(frozen=True)
class FreePoses:
    """Poses by place (k, n), and values of the free parameters with which the linkage reaches them."""

    poses: np.ndarray
    values: dict[Parameter, float]


def places_of(phase: Phase, initial: State | Sequence[Condition], segment_times: np.ndarray) -> list[PosedPlace]:
    """Return start, waypoints and end of a phase with their conditions."""
    conditions = [initial, *(w.conditions for w in phase.waypoints), phase.final]
    return [PosedPlace(float(t), c) for t, c in zip(segment_times, conditions, strict=True)]


def free_poses(
    problem: ProblemStatement,
    phase: Phase,
    numeric: NumericEquations,
    places: Sequence[PosedPlace],
    near: np.ndarray | None = None,
) -> FreePoses | None:
    """Return poses that meet the conditions of all places; None if no free parameter helps, or none are found.

    The places are in the order of time. Path conditions on positions hold at all of them, and boundary conditions if
    the first and the last one are start and end of the phase. Estimates `near` (k, n) may take the place of that of the
    bodies.
    """
    eom = phase.equations
    if not problem.free_parameters or eom.is_large:
        return None
    system = _PlaceSystem(problem, phase, numeric, places)
    if not ca.depends_on(ca.vertcat(*system.equalities, *system.limits), system.free):
        return None
    return system.solve(np.tile(eom.estimate[0], (len(places), 1)) if near is None else near)


class _PlaceSystem(PoseSystem):
    """Conditions of all places of a phase: the unknowns are the poses and the parameters."""

    def __init__(
        self, problem: ProblemStatement, phase: Phase, numeric: NumericEquations, places: Sequence[PosedPlace]
    ):
        super().__init__(problem, {phase: numeric})
        self._numeric = numeric
        self._places: list[Place] = [(phase, p.time, ca.SX.sym("q", numeric.eom.q.numel())) for p in places]
        self.unknowns = ca.vertcat(*[pose for *_, pose in self._places], self.free)
        self.equalities: list[ca.SX] = []
        self.limits: list[ca.SX] = []
        for stated, place in zip(places, self._places, strict=True):
            self._hold(stated.conditions, place)
        if len(places) > 1:
            self.equalities += self.relations(lambda _, at_end: self._places[-1 if at_end else 0])

    def _hold(self, conditions: State | Sequence[Condition], place: Place) -> None:
        phase, _, pose = place
        self.equalities.append(self.value(phase.equations.closing, place))
        if isinstance(conditions, State):
            self.equalities.append(pose - ca.DM(conditions.q))
            return
        for condition in [*conditions, *phase.path]:
            if on_positions(condition.expression):
                rows = self.equalities if condition.equality else self.limits
                rows.append(self.value(condition.expression, place))

    def solve(self, near: np.ndarray) -> FreePoses | None:
        """Solve by IPOPT within the limits, and to rounding by Newton's method."""
        weights = self.weights([self._numeric] * len(near))
        bounds = [
            sign * (self.free[k] - bound)
            for k, p in enumerate(self.parameters)
            for sign, bound in ((-1, p.lower), (1, p.upper))
            if np.isfinite(bound)
        ]
        limits, estimate = [*self.limits, *bounds], np.r_[near.ravel(), self.values]
        x = nearest_by_ipopt(self.unknowns, self.equalities, limits, estimate, weights)
        outcome = solve(newton_rows(ca.vertcat(*self.equalities), self.unknowns), x, weights, iterations=20)
        excess = ca.Function("limits", [self.unknowns], [ca.vertcat(ca.SX(0, 1), *limits)])
        passed = np.max(excess(outcome.x).full(), initial=0.0) > MET
        if not outcome.converged or passed or not largest(outcome.x) < np.inf:
            return None
        values = self.within_limits(outcome.x[near.size :])
        poses = outcome.x[: near.size].reshape(near.shape)
        return FreePoses(poses, dict(zip(self.parameters, values.tolist(), strict=True)))
