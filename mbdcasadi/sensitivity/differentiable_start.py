"""The consistent start as a function of parameters and of the right sides of its conditions.

The start is the solution of three problems, one after the other: first-order
states, pose, velocity, each nearest to its estimate among all that meet the
rows. With multipliers ``mu`` and a metric ``W``

    W(p) (x - x_estimate) + r_x^T mu = 0,    r(x, p) = right sides,

which Newton's method solves from a solution nearby; by the theorem of implicit
functions it can be differentiated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..assembly.consistent_start import consistent_start, independent_rows, levels_of
from ..assembly.followed_states import led_levels
from ..equations.numeric import NumericEquations
from ..errors import ModelError
from ..model.conditions import Condition, read_conditions
from ..numerics.least_squares import largest, least_norm
from ..results.state import State

#: Value of an inequality at the start above which it holds the start in place.
ACTIVE = -1e-7
#: Residual from which a start counts as not found.
FOUND = 1e-9


class DifferentiableStart:
    """The start of an analysis as a function ``(p, right sides, z estimate, guess) -> (x, guess, residual)``.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters at which the start is assembled first.
    initial : sequence of relations, or State
        As for ``simulate``. Inequalities that hold the start there go on to hold it.
    time : float
        Time of the start, s.

    Attributes
    ----------
    state : State
        The start that was assembled.
    conditions : tuple of Condition
        Equalities, and inequalities that hold the start in place.
    guess : numpy.ndarray
        Solution at that start, from which Newton's method finds others.
    right : numpy.ndarray
        Right sides at that start: zero, one for each equality.
    """

    def __init__(self, numeric: NumericEquations, initial: Any, time: float, signals: Signals):
        self.numeric, self.time = numeric, time
        self.state = consistent_start(numeric, initial, time, signals)
        eom = numeric.eom
        conditions = () if isinstance(initial, State) else read_conditions(initial)
        self.conditions = tuple(c for c in conditions if c.equality or self.state[c.expression] > ACTIVE)
        self.right = np.zeros(len(self.conditions))
        if isinstance(initial, State):
            self._targets = self.state.q, self.state.v, self.state.z
        else:
            self._targets = eom.estimate
        self._assemble_function()

    def _assemble_function(self) -> None:
        numeric, eom = self.numeric, self.numeric.eom
        levels = levels_of(numeric, self.conditions)
        right, z_estimate = ca.SX.sym("right", len(self.conditions)), ca.SX.sym("z estimate", eom.z.numel())
        problems = self._problems(levels, z_estimate)
        # each problem knows the solutions of those before it
        known, values = [eom.p, right, z_estimate], [numeric.p, self.right, self._targets[2]]
        guesses = []
        for problem in problems:
            guesses.append(problem.prepare(self, right, known, values))
            known, values = [*known, problem.unknowns], [*values, problem.solution]
        self.guess = np.concatenate(guesses)
        symbols = [ca.MX.sym(name, s.numel()) for name, s in zip(("p", "right", "z"), known, strict=False)]
        whole = ca.MX.sym("guess", self.guess.size)
        parts = ca.vertsplit(whole, [0, *np.cumsum([g.size for g in guesses]).tolist()])
        solutions, answers, residuals = list(symbols), [], []
        for problem, part in zip(problems, parts, strict=True):
            answer, residual = problem.solve(part, solutions)
            answers.append(answer)
            residuals.append(residual)
            solutions.append(answer[: problem.solution.size])
        found = {problem.name: solution for problem, solution in zip(problems, solutions[3:], strict=True)}
        self.function = ca.Function(
            "start",
            [*symbols, whole],
            [
                ca.vertcat(found["q"], found["v"], found["z"]),
                ca.vertcat(*answers),
                ca.norm_inf(ca.vertcat(0, *residuals)),
            ],
            ["p", "right", "z", "guess"],
            ["x", "solution", "residual"],
        )

    def _problems(self, levels: tuple[list[Condition], ...], z_estimate: ca.SX) -> list[_Nearest]:
        """The problems in an order in which each needs solutions of those before it alone.

        States that drivers follow come first, or after the pose (and the velocities) that conditions decide.
        """
        numeric, eom = self.numeric, self.numeric.eom
        following, (by_pose, by_speed) = eom.following_rows, led_levels(numeric, levels, self.state)
        mixed = [c for level, led in zip(levels, (by_pose, by_speed), strict=False) for c in level if led]
        in_part = by_pose is None or by_speed is None or (by_speed and not by_pose)
        if in_part or any(c.depends_on("state") for c in mixed):
            servos = ", ".join(dict.fromkeys(eom.row_elements[row].description for row in following))
            raise ModelError(
                f"derivatives: conditions decide in part how {servos} start{'s' if len(following) == 1 else ''}; give "
                "all their starts by positions and velocities, or by states, as position == 0, velocity == 0"
            )
        metric = numeric.weights_expression / float(np.mean(numeric.weights))
        speeds = eom.Phi_q @ eom.v - eom.nu
        poses, rates, leading = eom.Phi, speeds, ca.SX(0, 1)
        if by_pose:
            poses, leading = eom.closing, eom.Phi[np.searchsorted(eom.position_rows, following).tolist()]
        if by_speed:
            rates = speeds[[row for row in range(eom.lam.numel()) if row not in following]]
            leading = ca.vertcat(leading, speeds[following])
        (q, v, _), state = self._targets, self.state
        at_z = _Nearest("z", eom.z, leading, levels[2], ca.SX.ones(eom.z.numel()), z_estimate, state.z)
        at_q = _Nearest("q", eom.q, poses, levels[0], metric, ca.SX(q), state.q)
        at_v = _Nearest("v", eom.v, rates, levels[1], metric, ca.SX(v), state.v)
        if by_speed:
            return [at_q, at_v, at_z]
        return [at_q, at_z, at_v] if by_pose else [at_z, at_q, at_v]

    @property
    def z_estimate(self) -> np.ndarray:
        """Estimate of the first-order states."""
        return np.asarray(self._targets[2], float)

    def column_scale(self, name: str) -> np.ndarray:
        """Scale of the unknowns of one of the problems (n,): of states, pose or velocity."""
        return np.ones(self.numeric.eom.z.numel()) if name == "z" else self.numeric.column_scale


@dataclass(eq=False)
class _Nearest:
    """One of the three problems: the unknowns nearest to their target, in a metric, that meet rows and conditions."""

    name: str
    unknowns: ca.SX
    rows: ca.SX
    conditions: Sequence[Condition]
    metric: ca.SX
    target: ca.SX
    solution: np.ndarray

    def prepare(
        self, start: DifferentiableStart, right: ca.SX, known: list[ca.SX], values: list[np.ndarray]
    ) -> np.ndarray:
        """Leave out rows that others imply, compile, and return the solution with its multipliers."""
        open_ = [c.expression - right[start.conditions.index(c)] for c in self.conditions]
        r = ca.substitute(ca.vertcat(self.rows, *open_), start.numeric.eom.t, ca.SX(start.time))
        slope = ca.jacobian(r, self.unknowns)
        numbers = ca.Function("rows", [self.unknowns, *known], [ca.densify(slope)])(self.solution, *values).full()
        of_mechanism = self.rows.numel()
        kept = independent_rows(numbers[:of_mechanism], numbers[of_mechanism:], start.column_scale(self.name))
        r, slope = r[kept], slope[kept, :]
        mu = ca.SX.sym("mu", len(kept))
        x = ca.vertcat(self.unknowns, mu)
        residual = ca.vertcat(self.metric * (self.unknowns - self.target) + slope.T @ mu, r)
        self._residual = ca.Function("residual", [x, *known], [ca.densify(residual)])
        if x.numel():
            options = {"linear_solver": "csparse", "error_on_fail": False, "max_iter": 25, "abstol": 1e-13}
            self._root = ca.rootfinder("start_" + self.name, "newton", self._residual, options)
        away = self._residual(np.r_[self.solution, np.zeros(len(kept))], *values).full().ravel()
        mu_value = -least_norm(numbers[kept].T, away[: self.solution.size]) if kept else np.zeros(0)
        return np.r_[self.solution, mu_value]

    def solve(self, guess: ca.MX, known: Sequence[ca.MX]) -> tuple[ca.MX, ca.MX]:
        """Solution with its multipliers, and what is left over."""
        if not guess.numel():
            return guess, ca.MX(0, 1)
        answer = self._root(guess, *known)
        return answer, self._residual(answer, *known)


def found(residual: Any) -> bool:
    """True if a start was found, by its residual."""
    return bool(np.isfinite(residual)) and largest(np.asarray(residual)) <= FOUND
