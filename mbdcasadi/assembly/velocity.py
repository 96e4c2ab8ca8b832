"""The velocity nearest to an estimate that meets constraints and conditions."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ConditionError
from ..model.conditions import Condition, stacked
from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import largest, project_velocity
from ..numerics.nearest import multipliers_at, nearest, nearest_by_ipopt, project_with_inequalities
from ..numerics.newton import Equations, refine_root, solve
from ..numerics.rank import analyse_rank

#: Violation of an inequality by which it counts as held, m/s or rad/s.
HELD_TOLERANCE = 1e-6


class VelocityProblem:
    """Velocity constraints and conditions of a mechanism in one pose.

    Parameters
    ----------
    conditions : sequence of Condition
        On velocities.
    t : float
        Time, s.
    q, z : numpy.ndarray
        Pose and first-order states, which conditions may hold.
    """

    def __init__(
        self, numeric: NumericEquations, conditions: Sequence[Condition], t: float, q: np.ndarray, z: np.ndarray
    ):
        self.numeric = numeric
        self.t = t
        self.equalities = [c for c in conditions if c.equality]
        self.inequalities = [c for c in conditions if not c.equality]
        self._jacobian, self._nu = numeric.velocity(t, q)
        eom = numeric.eom
        self._known = ca.vertcat(eom.q, eom.z, eom.t, eom.p), ca.vertcat(q, z, t, numeric.p)

    def solve(self, estimate: np.ndarray) -> np.ndarray:
        """Return the velocity (n,), or raise with what stays open."""
        v = self._consistent(estimate)
        if not self.equalities and not self.inequalities:
            return v
        v = self._meet(self.equalities, v, estimate)
        return self._within(v, estimate) if self.inequalities else v

    def _consistent(self, estimate: np.ndarray) -> np.ndarray:
        """Nearest velocity with ``Phi_q v = nu``."""
        jacobian, nu = self._jacobian, self._nu
        v = project_velocity(jacobian, nu, estimate, self.numeric.weights)
        left_over = jacobian @ v - nu
        if largest(left_over) > 1e-8 * (1 + largest(nu) + largest(v)):
            eom = self.numeric.eom
            names = [eom.row_names[k] for k in np.argsort(-np.abs(left_over))[:4]]
            raise AssemblyError(
                f"cannot assemble velocities at t = {self.t:.6g} s: the pose is singular and no velocity meets the "
                f"rows {', '.join(names)}",
                residuals=_by_element(eom.row_elements, left_over),
                time=self.t,
            )
        return v

    # --- inequalities -----------------------------------------------------------------
    def _within(self, v: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest velocity under the inequalities, from the nearest one without them."""
        obstacle: ConditionError | None = None
        try:
            velocity = self._active_set(v, estimate)
        except ConditionError as error:
            velocity, obstacle = None, error
        if velocity is not None:
            return velocity
        start = self._by_optimisation(v)
        if start is None:
            raise obstacle or self._refusal([*self.equalities, *self.inequalities], np.zeros(0))
        near = np.flatnonzero(np.abs(self._values(self.inequalities, start)) <= HELD_TOLERANCE)
        try:
            velocity = self._active_set(start, estimate, [int(k) for k in near])
        except ConditionError:
            velocity = None
        return start if velocity is None else velocity

    def _active_set(self, start: np.ndarray, estimate: np.ndarray, active: Sequence[int] = ()) -> np.ndarray | None:
        limits = self.inequalities

        def held(active: Sequence[int]) -> list[Condition]:
            return [*self.equalities, *[limits[k] for k in active]]

        def pushes(v: np.ndarray, active: Sequence[int]) -> np.ndarray:
            jacobian = self._with(held(active))(v)[1]
            return multipliers_at(jacobian, v - estimate, self.numeric.weights)[len(jacobian) - len(active) :]

        def meet(active: Sequence[int]) -> np.ndarray:
            return self._meet(held(active), start, estimate)

        return project_with_inequalities(meet, lambda v: self._values(limits, v), pushes, active)

    def _by_optimisation(self, start: np.ndarray) -> np.ndarray | None:
        """Nearest velocity by IPOPT, or None."""
        # independent rows only: with more rows than velocities IPOPT does not start
        rank = analyse_rank(self._jacobian)
        free = rank.null_columns
        basis = np.linalg.svd(free, full_matrices=True)[0][:, free.shape[1] :].T
        rows = ca.DM(basis) @ (self.numeric.eom.v - ca.DM(start))
        equal, unequal = (
            [ca.substitute(c.expression, *self._known) for c in part] for part in (self.equalities, self.inequalities)
        )
        v = nearest_by_ipopt(self.numeric.eom.v, [rows, *equal], unequal, start, self.numeric.weights)
        outcome = solve(self._with(self.equalities), v, self.numeric.weights, iterations=20)
        met = largest(np.maximum(self._values(self.inequalities, outcome.x), 0)) <= HELD_TOLERANCE / 10
        return outcome.x if outcome.converged and met else None

    # --- conditions -------------------------------------------------------------------
    def _function(self, conditions: Sequence[Condition]) -> Evaluator:
        v = self.numeric.eom.v
        values = ca.substitute(stacked(conditions), *self._known)
        return Evaluator(ca.Function("conditions", [v], [values, ca.jacobian(values, v)]))

    def _values(self, conditions: Sequence[Condition], v: np.ndarray) -> np.ndarray:
        return self._function(conditions)(v)[0].ravel()

    def _with(self, conditions: Sequence[Condition]) -> Equations:
        function = self._function(conditions)

        def rows(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slope = function(v)
            residual = np.concatenate([self._jacobian @ v - self._nu, values.ravel()])
            return residual, np.vstack([self._jacobian, slope])

        return rows

    def _meet(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest velocity at which the conditions hold as equalities."""
        rows, weights = self._with(conditions), self.numeric.weights
        outcome = solve(rows, start, weights)
        if not outcome.converged:
            raise self._refusal(conditions, outcome.residual[self._nu.size :])
        return refine_root(rows, nearest(rows, outcome.x, estimate, weights), weights)

    @staticmethod
    def _refusal(conditions: list[Condition], left_over: np.ndarray) -> ConditionError:
        open_rows = [row.label for row, value in zip(conditions, left_over, strict=False) if abs(value) > 1e-9]
        return ConditionError(
            f"the velocity conditions cannot all be met: {'; '.join(open_rows or [row.label for row in conditions])} "
            "contradicts the joints and drivers, or another condition; state as many as there are degrees of freedom"
        )


def _by_element(elements: Any, values: np.ndarray) -> dict[str, float]:
    """Largest absolute value by element, largest first."""
    largest_values: dict[str, float] = {}
    for element, value in zip(elements, values, strict=True):
        largest_values[element.name] = max(largest_values.get(element.name, 0.0), abs(float(value)))
    return dict(sorted(largest_values.items(), key=lambda item: -item[1]))
