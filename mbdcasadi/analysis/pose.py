"""The pose nearest to an estimate that meets constraints and conditions.

Closing the linkage comes first, from the estimate; then the conditions are
approached by continuation from the values they have there, which keeps the
branch. IPOPT is the fallback where Gauss–Newton steps do not settle.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ConditionError, MechanismWarning
from ..model.conditions import Condition
from ..numerics.console import quiet
from ..numerics.least_squares import Outcome, largest, nearest, solve

#: Largest turn of a body in one step of the continuation, rad.
LARGEST_TURN = 0.3
#: Residual from which a row counts as open in a message, m or rad.
OPEN = 1e-6


class PoseProblem:
    """Position constraints and conditions of a mechanism at one time.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at given parameters.
    conditions : sequence of Condition
        On positions.
    t : float
        Time, s.
    z : numpy.ndarray
        First-order states, which conditions may hold.
    """

    def __init__(self, numeric: NumericEquations, conditions: Sequence[Condition], t: float, z: np.ndarray):
        self.numeric = numeric
        self.t = t
        self.z = z
        self.equalities = [c for c in conditions if c.equality]
        self.inequalities = [c for c in conditions if not c.equality]
        eom = numeric.eom
        self._arguments = [eom.q, eom.t, eom.z, eom.p]

    def solve(self, estimate: np.ndarray) -> np.ndarray:
        """Return the pose (n,), or raise with what stays open."""
        closed = self._close(estimate)
        active = list(self.equalities)
        q = self._meet(active, closed, estimate)
        for _ in range(len(self.inequalities)):
            broken = [c for c in self.inequalities if c not in active and self._values([c], q)[0] > 1e-10]
            if not broken:
                break
            active += broken
            try:
                q = self._meet(active, q, estimate)
            except AssemblyError:
                # on the way to the limit the linkage locks: look for a pose on the right side of it at once
                found = self._by_optimisation(estimate, self.equalities, self.inequalities)
                if found is None:
                    raise
                return found
        return q

    # --- closing the linkage -------------------------------------------------------------
    def _rows(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.numeric.position(self.t, q)

    def _close(self, estimate: np.ndarray) -> np.ndarray:
        weights = self.numeric.weights
        first = solve(self._rows, estimate, weights, step_limit=1.0)
        if first.converged:
            return nearest(self._rows, first.x, estimate, weights)
        best = self._by_optimisation(estimate, [], [])
        if best is None:
            best = self._from_other_starts(self._rows, estimate)
        if best is None:
            raise self._parts_apart(first)
        return nearest(self._rows, best, estimate, weights)

    def _from_other_starts(self, rows, estimate: np.ndarray) -> np.ndarray | None:
        """Gauss–Newton from a few turned estimates; the solution nearest to the estimate."""
        generator = np.random.default_rng(0)
        found = []
        for _ in range(12):
            outcome = solve(
                rows, estimate + generator.uniform(-1, 1, estimate.size), self.numeric.weights, step_limit=1.0
            )
            if outcome.converged:
                found.append(outcome.x)
        return min(found, key=lambda q: float(np.sum(self.numeric.weights * (q - estimate) ** 2)), default=None)

    def _by_optimisation(
        self, estimate: np.ndarray, equalities: Sequence[Condition], inequalities: Sequence[Condition]
    ) -> np.ndarray | None:
        """Nearest pose by IPOPT, or None."""
        numeric, eom = self.numeric, self.numeric.eom
        distance = 0.5 * ca.dot(ca.DM(numeric.weights) * (eom.q - ca.DM(estimate)), eom.q - ca.DM(estimate))
        rows = [eom.Phi, *[c.expression for c in equalities], *[c.expression for c in inequalities]]
        bound = ca.substitute(ca.vertcat(*rows), ca.vertcat(eom.t, eom.z, eom.p), ca.vertcat(self.t, self.z, numeric.p))
        lower = np.r_[np.zeros(eom.Phi.numel() + len(equalities)), np.full(len(inequalities), -np.inf)]
        silent = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False, "expand": True}
        options = {"print_level": 0, "sb": "yes", "max_iter": 300, "tol": 1e-10}
        with quiet():
            solver = ca.nlpsol("pose", "ipopt", {"x": eom.q, "f": distance, "g": bound}, silent | {"ipopt": options})
            q = solver(x0=estimate, lbg=lower, ubg=0)["x"].full().ravel()
        outcome = solve(self._with(equalities, np.zeros(len(equalities))), q, numeric.weights, iterations=20)
        met = all(self._values([c], outcome.x)[0] <= 1e-8 for c in inequalities)
        return outcome.x if outcome.converged and met else None

    # --- meeting conditions ------------------------------------------------------------------
    def _values(self, conditions: Sequence[Condition], q: np.ndarray) -> np.ndarray:
        function = self._compile(conditions)
        return function(q, self.t, self.z, self.numeric.p)[0].full().ravel()

    def _compile(self, conditions: Sequence[Condition]) -> ca.Function:
        values = ca.vertcat(ca.SX(0, 1), *[c.expression for c in conditions])
        jacobian = ca.jacobian(values, self.numeric.eom.q)
        return ca.Function("conditions", self._arguments, [ca.densify(values), jacobian])

    def _with(self, conditions: Sequence[Condition], offset: np.ndarray):
        """Constraint rows and conditions less an offset, as one system."""
        function = self._compile(conditions)

        def rows(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            phi, jacobian = self._rows(q)
            values, slope = function(q, self.t, self.z, self.numeric.p)
            return np.r_[phi, values.full().ravel() - offset], np.vstack([jacobian, slope.full()])

        return rows

    def _meet(self, conditions: list[Condition], start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        if not conditions:
            return start
        weights = self.numeric.weights
        target = self._with(conditions, np.zeros(len(conditions)))
        q = self._continue_to(conditions, start)
        if q is None:
            q = self._without_continuation(conditions, target, start, estimate)
        return nearest(target, q, estimate, weights)

    def _continue_to(self, conditions: list[Condition], start: np.ndarray) -> np.ndarray | None:
        """Move the conditions from their value at the start to their target, in steps that turn no body far."""
        first = self._values(conditions, start)
        turns = np.zeros(start.size, bool)
        turns[2 : 3 * len(self.numeric.eom.mechanism.bodies) : 3] = True
        q, done, step = start, 0.0, 1.0
        while done < 1.0:
            share = min(done + step, 1.0)
            outcome = solve(self._with(conditions, (1 - share) * first), q, self.numeric.weights, iterations=15)
            turned = largest((outcome.x - q)[turns])
            if outcome.converged and turned <= LARGEST_TURN:
                q, done = outcome.x, share
                step *= 2.0 if turned < LARGEST_TURN / 3 else 1.0
            else:
                step /= 2
                if step < 1e-5:
                    return None
        return q

    def _without_continuation(self, conditions, target, start: np.ndarray, estimate: np.ndarray) -> np.ndarray:
        outcomes = [solve(target, guess, self.numeric.weights, step_limit=1.0) for guess in (start, estimate)]
        found = [outcome.x for outcome in outcomes if outcome.converged]
        q = found[0] if found else self._by_optimisation(estimate, conditions, [])
        if q is None:
            q = self._from_other_starts(target, estimate)
        if q is None:
            raise self._conditions_missed(conditions, min(outcomes, key=lambda o: float(o.residual @ o.residual)))
        warnings.warn(
            f"assembly: {', '.join(c.label for c in conditions)} cannot be reached from the estimated pose without "
            "passing a singular pose or coming apart; the pose that was found may lie on another branch of the linkage",
            MechanismWarning,
            stacklevel=6,
        )
        return q

    # --- messages --------------------------------------------------------------------------------
    def _parts_apart(self, outcome: Outcome) -> AssemblyError:
        residuals = self._residuals(outcome.residual)
        parts = ", ".join(f"'{name}' ({value:.3g})" for name, value in residuals.items() if value > OPEN)
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
        shown = {name: value for name, value in (missed | residuals).items() if value > OPEN}
        parts = ", ".join(f"{name} ({value:.3g})" for name, value in shown.items())
        return _ConditionsNotMet(
            f"cannot assemble the mechanism at t = {self.t:.6g} s so that {', '.join(c.label for c in conditions)}: "
            f"left open (m or rad) are {parts}; the linkage does not reach there, or the conditions contradict "
            "the joints or each other",
            residuals=missed | residuals,
            time=self.t,
        )

    def _residuals(self, values: np.ndarray) -> dict[str, float]:
        eom = self.numeric.eom
        found: dict[str, float] = {}
        for k, value in zip(eom.position_rows, values, strict=True):
            name = eom.row_elements[k].name
            found[name] = max(found.get(name, 0.0), abs(float(value)))
        return dict(sorted(found.items(), key=lambda item: -item[1]))


class _ConditionsNotMet(AssemblyError, ConditionError):
    """An assembly that fails at its conditions is both."""
