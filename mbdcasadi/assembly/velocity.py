"""The velocity nearest to an estimate that meets constraints and conditions."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ConditionError
from ..model.conditions import Condition, stacked
from ..numerics.evaluation import Evaluator
from ..numerics.least_squares import largest, project_velocity
from ..numerics.nearest import nearest_finder
from ..numerics.newton import Equations, refine_root
from ..numerics.rank import analyse_rank
from ..numerics.scattered import scattered
from ..numerics.tolerances import EPSILON
from .nearest_problem import NearestProblem, residuals_by_element

#: Sizes of random velocities beside the first one from which one is looked for that meets the conditions, m/s or rad/s.
ELSEWHERE = (1.0, 1.0, 1e-3, 1e-6)
#: Smallest size of a condition without a slope at rest, as a share of what speeds of typical sizes change it by:
#: the slopes of rows that are divided by smaller ones leave no digits for the joints.
SMALLEST_SIZE = EPSILON**0.5


class VelocityProblem(NearestProblem):
    """Velocity constraints and conditions of a mechanism in one pose.

    Parameters
    ----------
    conditions, t
        On velocities; see the base class.
    q, z : numpy.ndarray
        Pose and first-order states, which conditions may hold.
    """

    refusal = ConditionError

    def __init__(
        self, numeric: NumericEquations, conditions: Sequence[Condition], t: float, q: np.ndarray, z: np.ndarray
    ):
        super().__init__(numeric, conditions, t)
        self._jacobian, self._nu = numeric.velocity(t, q, z)
        eom = numeric.eom
        self._known = ca.vertcat(eom.q, eom.z, eom.t, eom.p), ca.vertcat(q, z, t, numeric.p)
        self.sizes = numeric.scale.coordinates  # in one second

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
        v = project_velocity(jacobian, nu, estimate, self.numeric.weights, self.sizes)
        left_over = jacobian @ v - nu
        sizes = np.abs(nu) + np.abs(jacobian) @ self.sizes * (1 + largest(v / self.sizes))
        if np.any(np.abs(left_over) > 1e-8 * sizes):
            eom = self.numeric.eom
            names = [eom.row_names[k] for k in np.argsort(-np.abs(left_over))[:4]]
            raise AssemblyError(
                f"cannot assemble velocities at t = {self.t:.6g} s: the pose is singular and no velocity meets the "
                f"rows {', '.join(names)}",
                residuals=residuals_by_element(eom.row_elements, left_over),
                time=self.t,
            )
        return v

    def _optimised(self, start: np.ndarray, estimate: np.ndarray) -> np.ndarray | None:
        # independent rows only: with more rows than velocities IPOPT does not start
        free = analyse_rank(self._jacobian).null_columns
        rows = ca.DM(analyse_rank(free.T).null_columns.T) @ (self.numeric.eom.v - ca.DM(start))
        equal, unequal = (
            [ca.substitute(c.expression, *self._known) for c in part] for part in (self.equalities, self.inequalities)
        )
        find = nearest_finder(self.numeric.eom.v, [rows, *equal], unequal, self.numeric.weights)
        # a square is met in both senses, and IPOPT does not come from one to the other through rest
        other = 2 * self._consistent(estimate) - start
        candidates: tuple[Callable[[], np.ndarray], ...] = (lambda: other, lambda: find(start), lambda: find(other))
        refined = (self._refined(v(), self.equalities, self.inequalities) for v in candidates)
        return next((v for v in refined if v is not None), None)

    # --- conditions -------------------------------------------------------------------
    def _function(self, conditions: Sequence[Condition]) -> Evaluator:
        v = self.numeric.eom.v
        values = ca.substitute(stacked(conditions), *self._known)
        return Evaluator(ca.Function("conditions", [v], [values, ca.jacobian(values, v)]))

    def _relative(self, conditions: Sequence[Condition], v: np.ndarray) -> np.ndarray:
        """Values by their typical sizes (k,)."""
        function = self._function(conditions)
        return function(v)[0].ravel() / self._typical(function)

    def _typical(self, function: Evaluator) -> np.ndarray:
        """Typical sizes of conditions (k,): by what speeds of typical sizes change them.

        One without a slope at rest, as the square of a speed, has the size of its value there, which is the number in
        it: a speed of micrometres per second has to be met, too.
        """
        with np.errstate(all="ignore"):
            at_rest, slope = function(np.zeros(self.sizes.size))
            change = np.abs(function(self.sizes * scattered(self.sizes.size))[1]) @ self.sizes
        change = np.where(np.isfinite(change) & (change > 0), change, 1.0)
        at_rest, has_slope = np.abs(at_rest.ravel()), np.all(np.isfinite(slope), axis=1) & np.any(slope, axis=1)
        return np.where(has_slope | ~(at_rest > 0), change, np.clip(at_rest, SMALLEST_SIZE * change, change))

    def rows_with(self, conditions: Sequence[Condition]) -> Equations:
        function = self._function(conditions)
        held = np.abs(self._jacobian) @ self.sizes
        sizes = np.concatenate([np.where(held > 0, held, 1.0), self._typical(function)])

        def rows(v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            values, slope = function(v)
            residual = np.concatenate([self._jacobian @ v - self._nu, values.ravel()])
            return residual / sizes, np.vstack([self._jacobian, slope]) / sizes[:, None]

        return rows

    def _meet(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest velocity at which the conditions hold as equalities."""
        rows = self.rows_with(conditions)
        outcome = self._solve(rows, start)
        if not outcome.converged:  # a speed has no slope at rest
            free, random = analyse_rank(self._jacobian).null_columns, np.random.default_rng(0)
            moved = (start + speed * free @ random.normal(size=free.shape[1]) for speed in ELSEWHERE)
            others = (self._solve(rows, velocity) for velocity in moved)
            outcome = next((other for other in others if other.converged), outcome)
        if not outcome.converged:
            raise self._refused(conditions, outcome.residual[self._nu.size :])
        return refine_root(rows, self._nearest(rows, outcome.x, estimate), self.numeric.weights)

    def _limits_missed(self) -> ConditionError:
        return self._refused([*self.equalities, *self.inequalities], np.zeros(0))

    @staticmethod
    def _refused(conditions: list[Condition], left_over: np.ndarray) -> ConditionError:
        open_rows = [row.label for row, value in zip(conditions, left_over, strict=False) if abs(value) > 1e-9]
        return ConditionError(
            f"the velocity conditions cannot all be met: {'; '.join(open_rows or [row.label for row in conditions])} "
            "contradicts the joints and drivers, or another condition; state as many as there are degrees of freedom"
        )
