"""Poses at the start, at the waypoints and at the end of a phase, with the free parameters among the unknowns.

A pendulum of free length reaches places that it does not reach with the length of its estimate. All places are
assembled together, since they share the parameters, within the limits of these.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from ...equations.numeric import LARGE, NumericEquations
from ...model.conditions import Condition
from ...model.symbols import Parameter
from ...numerics.least_squares import largest
from ...numerics.nearest import nearest_by_ipopt
from ...numerics.newton import solve
from ...results.state import State
from ..phase import Phase, on_positions
from ..placeholders import Placeholder, placeholders_in, with_values

if TYPE_CHECKING:
    from ..problem import OptimalControlProblem

#: Excess of a limit up to which it counts as met.
LIMIT_TOLERANCE = 1e-6
#: Weight of a change of a parameter by its own size, relative to that of a typical step of the heaviest body.
PARAMETER_WEIGHT = 1e-2


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
    problem: OptimalControlProblem,
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
    if not problem.free_parameters or eom.q.numel() * eom.lam.numel() > LARGE:
        return None
    system = _System(problem, phase, numeric, places)
    if not ca.depends_on(ca.vertcat(*system.equalities, *system.limits), system.free):
        return None
    return system.solve(np.tile(eom.estimate[0], (len(places), 1)) if near is None else near)


class _System:
    """Conditions of all places: the unknowns are the poses and the parameters."""

    def __init__(
        self,
        problem: OptimalControlProblem,
        phase: Phase,
        numeric: NumericEquations,
        places: Sequence[PosedPlace],
    ):
        self._phase, self._numeric, self._places = phase, numeric, places
        self._parameters = problem.free_parameters
        self._extra = problem.extra_parameters(phase)
        n = phase.equations.q.numel()
        self.free = ca.SX.sym("f", len(self._parameters))
        self._poses = [ca.SX.sym("q", n) for _ in places]
        self.unknowns = ca.vertcat(*self._poses, self.free)
        self.equalities: list[ca.SX] = []
        self.limits: list[ca.SX] = []
        for k, place in enumerate(places):
            self._hold(k, place)
        if len(places) > 1:
            self._relate(problem)

    def _hold(self, k: int, place: PosedPlace) -> None:
        eom = self._phase.equations
        self.equalities.append(self._value(eom.Phi, k))
        if isinstance(place.conditions, State):
            self.equalities.append(self._poses[k] - ca.DM(place.conditions.q))
            return
        for condition in [*place.conditions, *self._phase.path]:
            if on_positions(condition.expression):
                rows = self.equalities if condition.equality else self.limits
                rows.append(self._value(condition.expression, k))

    def _relate(self, problem: OptimalControlProblem) -> None:
        """Boundary conditions between positions at the start and at the end."""
        last = len(self._places) - 1

        def value(mark: Placeholder) -> ca.SX:
            return self._value(mark.expression, last if mark.kind == "at_end" else 0)

        for condition in problem.boundary:
            marks = placeholders_in(condition.expression)
            rest = with_values(condition.expression, lambda _: 0.0)
            if (
                marks
                and condition.equality
                and all(m.kind != "integral" and on_positions(m.expression) for m in marks)
                and on_positions(rest, allow_none=True)
            ):
                named = with_values(condition.expression, value)
                self.equalities.append(self._value(named, last))

    def _value(self, expression: ca.SX, k: int) -> ca.SX:
        """An expression at a place, with the unknowns substituted for poses and free parameters."""
        eom = self._phase.equations
        p, extra = ca.SX(ca.DM(self._numeric.p)), []
        for j, symbol in enumerate(self._parameters):
            place = next(
                (i for i, parameter in enumerate(self._phase.mechanism.parameters) if parameter is symbol), None
            )
            if place is None:
                extra.append(self.free[j])
            else:
                p[place] = self.free[j]
        z = ca.DM(eom.estimate[2])
        symbols = [eom.t, eom.q, eom.z, eom.p, ca.vertcat(ca.SX(0, 1), *self._extra)]
        values = [ca.SX(self._places[k].time), self._poses[k], z, p, ca.vertcat(ca.SX(0, 1), *extra)]
        return ca.substitute([ca.SX(expression)], symbols, values)[0]

    def solve(self, near: np.ndarray) -> FreePoses | None:
        """Solve by IPOPT within the limits, and to rounding by Newton's method."""
        numeric, count = self._numeric, len(self._places)
        initial_values = np.array([p.value for p in self._parameters])
        sizes = np.where(initial_values != 0, np.abs(initial_values), 1.0)
        heavy = float(np.max(numeric.weights * numeric.typical_step**2))
        weights = np.r_[np.tile(numeric.weights, count), PARAMETER_WEIGHT * heavy / sizes**2]
        estimate = np.r_[near.ravel(), initial_values]
        bounds = [
            sign * (self.free[k] - bound)
            for k, p in enumerate(self._parameters)
            for sign, bound in ((-1, p.lower), (1, p.upper))
            if np.isfinite(bound)
        ]
        x = nearest_by_ipopt(self.unknowns, self.equalities, [*self.limits, *bounds], estimate, weights)
        rows = ca.vertcat(*self.equalities)
        slopes = ca.jacobian(rows, self.unknowns)
        function = ca.Function("rows", [self.unknowns], [ca.densify(rows), ca.densify(slopes)])

        def equations(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            residual, jacobian = function(x)
            return residual.full().ravel(), jacobian.full()

        outcome = solve(equations, x, weights, iterations=20)
        excess = ca.Function("limits", [self.unknowns], [ca.vertcat(ca.SX(0, 1), *self.limits, *bounds)])
        passed = np.max(excess(outcome.x).full(), initial=0.0) > LIMIT_TOLERANCE
        if not outcome.converged or passed or not largest(outcome.x) < np.inf:
            return None
        low, high = (np.array([getattr(p, side) for p in self._parameters]) for side in ("lower", "upper"))
        values = np.clip(outcome.x[near.size :], low, high)
        poses = outcome.x[: near.size].reshape(near.shape)
        return FreePoses(poses, dict(zip(self._parameters, values.tolist(), strict=True)))
