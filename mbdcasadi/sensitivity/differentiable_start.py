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
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import Signals
from ..assembly.consistent_start import consistent_start, independent_rows, levels_of
from ..equations.numeric import NumericEquations
from ..model.conditions import Condition, read_conditions
from ..numerics.console import call_each
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
    relations : list
        The relations as given, where they were given.
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
        eom = self.numeric.eom
        at_position, at_velocity, at_states = levels_of(self.numeric, self.conditions)
        right = ca.SX.sym("right", len(self.conditions))
        z_estimate = ca.SX.sym("z estimate", eom.z.numel())
        q, v, _ = self._targets
        metric = self.numeric.weights_expression / float(np.mean(self.numeric.weights))
        known = [eom.p, right, z_estimate]
        velocity = eom.Phi_q @ eom.v - eom.nu
        z_metric = ca.SX.ones(eom.z.numel())
        problems = [
            _Nearest("z", eom.z, [], at_states, z_metric, z_estimate, known, []),
            _Nearest("q", eom.q, ca.vertsplit(eom.Phi), at_position, metric, ca.SX(q), known, [eom.z]),
            _Nearest("v", eom.v, ca.vertsplit(velocity), at_velocity, metric, ca.SX(v), known, [eom.z, eom.q]),
        ]
        solution = {"z": self.state.z, "q": self.state.q, "v": self.state.v}
        p, rights, estimate = (ca.MX.sym(name, s.numel()) for name, s in zip(("p", "right", "z"), known, strict=True))
        guess: list[np.ndarray] = []
        for problem in problems:
            others = [solution[s] for s in ("z", "q")[: problem.later]]
            guess.append(
                problem.prepare(
                    self,
                    right,
                    eom.t,
                    self.time,
                    solution[problem.name],
                    (self.numeric.p, self.right, self._targets[2]),
                    others,
                )
            )
        self.guess = np.concatenate(guess)
        whole = ca.MX.sym("guess", self.guess.size)
        parts = ca.vertsplit(whole, [0, *np.cumsum([g.size for g in guess]).tolist()])
        solutions: list[ca.MX] = []
        answers: list[ca.MX] = []
        residuals: list[ca.MX] = []
        for problem, part in zip(problems, parts, strict=True):
            answer, residual = problem.solve(part, [p, rights, estimate, *solutions])
            answers.append(answer)
            residuals.append(residual)
            solutions.append(answer[: problem.count])
        z, q, v = solutions
        self.function = ca.Function(
            "start",
            [p, rights, estimate, whole],
            [ca.vertcat(q, v, z), ca.vertcat(*answers), ca.norm_inf(ca.vertcat(0, *residuals))],
            ["p", "right", "z", "guess"],
            ["x", "solution", "residual"],
        )

    def solve(self, p: np.ndarray, guess: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Starts at many parameters (n_p, k), as columns: states, solutions to go on from, residuals (k,).

        Without a guess the solution of the first start is one. A residual is NaN if there is no start nearby.
        """
        x, solution, residual = call_each(
            self.function, p, self.right, self.z_estimate, self.guess if guess is None else guess
        )
        return x, solution, residual.ravel()

    @property
    def z_estimate(self) -> np.ndarray:
        """Estimate of the first-order states."""
        return np.asarray(self._targets[2], float)

    def column_scale(self, name: str) -> np.ndarray:
        """Scale of the unknowns of one of the problems (n,): of states, pose or velocity."""
        return np.ones(self.numeric.eom.z.numel()) if name == "z" else self.numeric.column_scale

    def label(self, index: int) -> str:
        """A condition as it was written."""
        return self.conditions[index].label


class _Nearest:
    """One of the three problems: the unknowns nearest to their estimate that meet rows."""

    def __init__(
        self,
        name: str,
        unknowns: ca.SX,
        rows: Sequence[ca.SX],
        conditions: Sequence[Condition],
        metric: ca.SX,
        target: ca.SX,
        known: Sequence[ca.SX],
        before: Sequence[ca.SX],
    ):
        self.name, self.unknowns, self.metric, self.target = name, unknowns, metric, target
        self.rows, self.conditions, self.known, self.before = list(rows), list(conditions), list(known), list(before)
        self.count, self.later = unknowns.numel(), len(before)

    def prepare(
        self,
        start: DifferentiableStart,
        right: ca.SX,
        clock: ca.SX,
        time: float,
        solution: np.ndarray,
        values: Sequence[np.ndarray],
        others: Sequence[np.ndarray],
    ) -> np.ndarray:
        """Leave out rows that others imply, compile, and return the solution with its multipliers."""
        shifts = [right[start.conditions.index(c)] for c in self.conditions]
        rows = [*self.rows, *[c.expression - s for c, s in zip(self.conditions, shifts, strict=True)]]
        r = ca.substitute(ca.vertcat(ca.SX(0, 1), *rows), clock, ca.SX(time))
        slope = ca.jacobian(r, self.unknowns)
        arguments = [self.unknowns, *self.known, *self.before]
        numbers = ca.Function("rows", arguments, [ca.densify(slope)])(solution, *values, *others).full()
        of_mechanism = len(self.rows)
        kept = independent_rows(numbers[:of_mechanism], numbers[of_mechanism:], start.column_scale(self.name))
        r, slope = r[kept], slope[kept, :]
        mu = ca.SX.sym("mu", len(kept))
        x = ca.vertcat(self.unknowns, mu)
        stationary = self.metric * (self.unknowns - self.target) + slope.T @ mu
        residual = ca.vertcat(stationary, r)
        self._residual = ca.Function("residual", [x, *self.known, *self.before], [ca.densify(residual)])
        if x.numel():
            options = {"linear_solver": "csparse", "error_on_fail": False, "max_iter": 25, "abstol": 1e-13}
            self._root = ca.rootfinder("start_" + self.name, "newton", self._residual, options)
        away = self._residual(np.concatenate([solution, np.zeros(len(kept))]), *values, *others).full().ravel()
        mu_value = -least_norm(numbers[kept].T, away[: self.count]) if kept else np.zeros(0)
        return np.concatenate([solution, mu_value])

    def solve(self, guess: ca.MX, known: Sequence[ca.MX]) -> tuple[ca.MX, ca.MX]:
        """Solution with its multipliers, and what is left over."""
        if not guess.numel():
            return guess, ca.MX(0, 1)
        answer = self._root(guess, *known)
        return answer, self._residual(answer, *known)


def found(residual: Any) -> bool:
    """True if a start was found, by its residual."""
    return bool(np.isfinite(residual)) and largest(np.asarray(residual)) <= FOUND
