"""The pose nearest to an estimate that meets constraints and conditions.

Closing the linkage comes first, from the estimate; then the conditions are
approached by continuation from the values they have there, which keeps the
branch. IPOPT is the fallback if Gauss–Newton steps do not converge.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, UnmetConditionsError, warn
from ..model.conditions import Condition, stacked
from ..numerics.evaluation import Evaluator
from ..numerics.homotopy import Step, follow
from ..numerics.least_squares import largest
from ..numerics.nearest import nearest_by_ipopt
from ..numerics.newton import Equations, Outcome, refine_root
from ..numerics.scattered import scattered
from ..numerics.tolerances import MET
from .nearest_problem import NearestProblem, residuals_by_element

#: Largest turn of a body in one step of the continuation, rad.
LARGEST_TURN = 0.3
#: Miss of a condition, rad, from which whole turns are made at once, and rounding of rows after them by radian turned.
MANY_TURNS, TURNED = 1000.0, 1e-12
#: Displacement of an estimate out of a singular pose, rad and characteristic lengths.
SINGULAR_PERTURBATION = 1e-4


class PoseProblem(NearestProblem):
    """Position constraints and conditions of a mechanism at one time.

    Parameters
    ----------
    conditions, t
        On positions; see the base class.
    z : numpy.ndarray
        First-order states, which conditions may hold.
    """

    refusal = AssemblyError

    def __init__(self, numeric: NumericEquations, conditions: Sequence[Condition], t: float, z: np.ndarray):
        super().__init__(numeric, conditions, t)
        self.z = z
        eom = numeric.eom
        self.sizes = numeric.scale.coordinates
        self._arguments = [eom.q, eom.t, eom.z, eom.p]
        self._functions: dict[tuple[Condition, ...], Evaluator] = {}

    def solve(self, estimate: np.ndarray) -> np.ndarray:
        """Return the pose (n,), or raise with what stays open."""
        closed = self._close(estimate)
        q = self._meet(self.equalities, closed, estimate)
        if self.inequalities:
            q = self._within(q, estimate)
        return refine_root(self.rows_with(self.equalities), q, self.numeric.weights, sizes=self.sizes)

    # --- closing the linkage -------------------------------------------------------------
    def _rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.numeric.position(self.t, q, self.z)

    def _close(self, estimate: np.ndarray) -> np.ndarray:
        outcomes = []
        for guess in (estimate, self._perturbed(estimate)):
            outcomes.append(self._solve(self._rows, guess, step_limit=self.numeric.step_limit))
            if outcomes[-1].converged:
                return self._nearest(self._rows, outcomes[-1].x, estimate)
        best = self._by_optimisation(estimate, [], [])
        if best is None:
            best = self._from_other_starts(self._rows, estimate)
        if best is None:
            raise self._parts_apart(_closest(outcomes))
        return self._nearest(self._rows, best, estimate)

    def _perturbed(self, q: np.ndarray) -> np.ndarray:
        """Pose beside one in which a row may have no slope (the ends of a link at one point); always the same."""
        return q + SINGULAR_PERTURBATION * self.sizes * scattered(q.size)

    def _from_other_starts(self, rows: Equations, estimate: np.ndarray) -> np.ndarray | None:
        """Gauss–Newton from a few turned estimates; the solution nearest to the estimate."""
        generator = np.random.default_rng(0)
        poses = []
        for _ in range(12):
            start = estimate + self.numeric.step_limit * generator.uniform(-1, 1, estimate.size)
            outcome = self._solve(rows, start, step_limit=self.numeric.step_limit)
            if outcome.converged:
                poses.append(outcome.x)
        return min(poses, key=lambda q: float(np.sum(self.numeric.weights * (q - estimate) ** 2)), default=None)

    def _optimised(self, start: np.ndarray, estimate: np.ndarray) -> np.ndarray | None:
        return self._by_optimisation(estimate, self.equalities, self.inequalities)

    def _by_optimisation(
        self, estimate: np.ndarray, equalities: Sequence[Condition], inequalities: Sequence[Condition]
    ) -> np.ndarray | None:
        """Nearest pose by IPOPT, or None."""
        numeric, eom = self.numeric, self.numeric.eom
        known = ca.vertcat(eom.t, eom.z, eom.p), ca.vertcat(self.t, self.z, numeric.p)
        equal, unequal = (
            ca.substitute(ca.vertcat(ca.SX(0, 1), *rows), *known)
            for rows in ([eom.Phi, *[c.expression for c in equalities]], [c.expression for c in inequalities])
        )
        q = nearest_by_ipopt(eom.q, [equal], [unequal], estimate, numeric.weights)
        return self._refined(q, equalities, inequalities)

    # --- meeting conditions ------------------------------------------------------------------
    def values(self, conditions: Sequence[Condition], q: np.ndarray) -> np.ndarray:
        """Values of conditions in a pose (k,)."""
        return self._compile(conditions)(q, self.t, self.z, self.numeric.p)[0].ravel()

    def _relative(self, conditions: Sequence[Condition], q: np.ndarray) -> np.ndarray:
        """Values by what a displacement of characteristic size changes them (k,)."""
        values, slope = self._compile(conditions)(q, self.t, self.z, self.numeric.p)
        change = np.abs(slope) @ self.sizes
        return values.ravel() / np.where(change > 0, change, 1.0)

    def _compile(self, conditions: Sequence[Condition]) -> Evaluator:
        key = tuple(conditions)
        if key not in self._functions:
            values = stacked(conditions)
            results = [values, ca.jacobian(values, self.numeric.eom.q)]
            self._functions[key] = Evaluator(ca.Function("conditions", self._arguments, results))
        return self._functions[key]

    def rows_with(self, conditions: Sequence[Condition], offset: np.ndarray | float = 0.0) -> Equations:
        """Constraint rows and conditions less an offset, as one system."""
        if not conditions:
            return self._rows
        function = self._compile(conditions)

        def rows(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            phi, jacobian = self._rows(q)
            values, slope = function(q, self.t, self.z, self.numeric.p)
            return np.concatenate([phi, values.ravel() - offset]), np.vstack([jacobian, slope])

        return rows

    def _meet(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        """Nearest pose at which the conditions hold as equalities, on the branch of the start."""
        q: np.ndarray | None = start
        if conditions:
            q = self._continue_to(conditions, self._many_turns_on(conditions, start))
        if q is None:
            q = self._without_continuation(conditions, start, estimate)
        return self._nearest(self.rows_with(conditions), q, estimate)

    def _many_turns_on(self, conditions: list[Condition], start: np.ndarray) -> np.ndarray:
        """The pose after as many whole turns as conditions on angles are away from it; itself if these are few.

        Constraints hold after whole turns as before, unless gears or racks count them: then the way is followed.
        """
        angles, (values, slope) = self.numeric.eom.angles, self.rows_with(conditions)(start)
        rows = self.numeric.eom.position_rows.size
        if not MANY_TURNS < largest(values[rows:]) < np.inf or not np.isfinite(slope).all():
            return start
        turns = np.zeros(start.size)
        turns[angles] = np.round(np.linalg.lstsq(slope[rows:, angles], -values[rows:], rcond=None)[0] / (2 * np.pi))
        there = start + 2 * np.pi * turns
        change = self.rows_with(conditions)(there)[0] - values
        change[rows:] -= 2 * np.pi * slope[rows:] @ turns
        return there if largest(change) <= TURNED * (1 + largest(there)) else start

    def _continue_to(self, conditions: list[Condition], start: np.ndarray) -> np.ndarray | None:
        """Move the conditions from their value at the start to their target, in steps that turn no body far."""
        first = self.values(conditions, start)

        def moved(q: np.ndarray, _: float, to: float) -> Step[np.ndarray] | None:
            outcome = self._solve(self.rows_with(conditions, (1 - to) * first), q, iterations=15)
            turned = largest((outcome.x - q)[self.numeric.eom.angles])
            if not outcome.converged or turned > LARGEST_TURN:
                return None
            return Step(outcome.x, easily=turned < LARGEST_TURN / 3)

        path = follow(start, moved)
        return path.point if path.complete else None

    def _without_continuation(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        target = self.rows_with(conditions)
        guesses = (start, estimate, self._perturbed(start))
        outcomes = [self._solve(target, guess, step_limit=self.numeric.step_limit) for guess in guesses]
        poses = [outcome.x for outcome in outcomes if outcome.converged]
        q = poses[0] if poses else self._by_optimisation(estimate, conditions, [])
        if q is None:
            q = self._from_other_starts(target, estimate)
        if q is None:
            raise self._conditions_missed(conditions, _closest(outcomes))
        warn(
            f"assembly: {', '.join(c.label for c in conditions)} cannot be reached from the estimated pose without "
            "passing a singular pose or coming apart; the pose that was found may lie on another branch of the linkage"
        )
        return q

    # --- messages --------------------------------------------------------------------------------
    def _parts_apart(self, outcome: Outcome) -> AssemblyError:
        residuals = self._residuals(outcome.residual)
        parts = ", ".join(f"'{name}' ({value:.3g})" for name, value in self.open_parts(outcome.residual).items())
        return AssemblyError(
            f"cannot assemble the mechanism at t = {self.t:.6g} s: the parts do not reach each other, or constraints "
            f"contradict each other; left open (m or rad) are {parts}; check lengths, points and angles of these",
            residuals=residuals,
            time=self.t,
        )

    def _conditions_missed(self, conditions: list[Condition], outcome: Outcome) -> AssemblyError:
        rows = self.numeric.eom.Phi.numel()
        residuals = self._residuals(outcome.residual[:rows])
        missed = {c.label: abs(float(value)) for c, value in zip(conditions, outcome.residual[rows:], strict=True)}
        shown = {name: value for name, value in missed.items() if value > MET}
        shown |= self.open_parts(outcome.residual[:rows])
        if not shown:  # conditions that contradict each other by little
            shown = dict([max(missed.items(), key=lambda item: item[1])])
        parts = ", ".join(f"{name} ({value:.3g})" for name, value in shown.items())
        return UnmetConditionsError(
            f"cannot assemble the mechanism at t = {self.t:.6g} s so that {', '.join(c.label for c in conditions)}: "
            f"left open (m or rad) are {parts}; the linkage does not reach there, or the conditions contradict "
            "the joints or each other",
            residuals=missed | residuals,
            time=self.t,
        )

    def _limits_missed(self) -> AssemblyError:
        labels = "; ".join(c.label for c in (*self.equalities, *self.inequalities))
        return UnmetConditionsError(
            f"cannot assemble the mechanism at t = {self.t:.6g} s: no pose was found that meets all of {labels}",
            time=self.t,
        )

    def open_parts(self, values: np.ndarray) -> dict[str, float]:
        """Residuals of the elements that stay open, largest first."""
        angular, length = self.numeric.eom.position_angular_rows, self.numeric.scale.length
        closed = np.abs(values) <= MET * np.where(angular, 1.0, length)
        return {name: value for name, value in self._residuals(np.where(closed, 0.0, values)).items() if value > 0}

    def _residuals(self, values: np.ndarray) -> dict[str, float]:
        eom = self.numeric.eom
        return residuals_by_element([eom.row_elements[k] for k in eom.position_rows], values)


def _closest(outcomes: Sequence[Outcome]) -> Outcome:
    return min(outcomes, key=lambda outcome: float(outcome.residual @ outcome.residual))
