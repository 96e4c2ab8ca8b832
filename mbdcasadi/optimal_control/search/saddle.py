"""Saddles: solutions at which the cost has no slope, but falls to second order.

A solver stays there, as at rest if the greatest speed is sought. The second derivatives of the program show in which
direction the cost falls, and from a little further along it the solver finds its way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ...errors import OptimizationError, warn
from ..motion.guess import Guess
from ..program.collocation_program import Bounds, CollocationProgram
from ..solution import Solution, same_cost
from ..solve.failure import is_unbounded
from ..solve.problem_solver import ProblemSolver
from ..solve.solvers.base import Beginning
from .budgets import BUDGETS
from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials

#: Curvature of the scaled cost, as a share of the largest one, from which it falls, and the largest one that is an
#: error of the multipliers, as if the duration alone counts and is at its limit; steps in which it is looked for, and
#: share of the products that is rounding.
FALLING, FLAT, LANCZOS, ROUNDING = 1e-5, 1e-10, 100, 1e-10
#: Squared size at which a combination of rows counts as none, and share of a direction that the rows have to leave.
SINGULAR, LEFT = 1e-14, 0.9
#: Stiffness of a limit, multiplier over slack and scaled, from which it is held in any direction, and least slack.
HELD, CLOSEST = 1.0, 1e-12
#: Largest step of a scaled variable from a saddle to a guess, and number of saddles that are left one after another.
STEP, SADDLES = 0.5, 3


class PastSaddle(Strategy):
    """Solves from both sides of a saddle, along the direction in which its cost falls.

    Also from where the first solve got stuck while it met all demands, as near a saddle.
    """

    name = "past a saddle"

    def applies(self, trials: Trials) -> bool:
        """Return True if a solution was found that may be a saddle, or a solve got stuck near one."""
        if trials.is_known or not trials.outcomes:
            return False
        if trials.solved:
            return trials.best is not None
        return not trials.failures[0].largest_violations

    def proposals(self, trials: Trials) -> Proposals:
        """Propose guesses beside a saddle, as long as there is one and the cost falls."""
        for _ in range(SADDLES):
            best = trials.best
            near, solver = (trials.outcomes[0].last, trials.solver) if best is None else (best[1], best[0].solver)
            guesses = [] if near.statistics.at_saddle is False else _falling_guesses(solver, near)
            near.statistics = replace(near.statistics, at_saddle=bool(guesses))
            before = np.inf if best is None else near.cost
            for guess in guesses:
                outcome = yield Proposal(guess, guess.description, BUDGETS.first, meshes=near.meshes, solver=solver)
                if isinstance(outcome.end, OptimizationError) and is_unbounded(outcome.last):
                    raise outcome.end
            now = trials.best
            if not guesses or now is None or now[1].cost >= before or same_cost(now[1].cost, before):
                return


def warn_of_saddle(solution: Solution) -> None:
    """Warn if a solution is a saddle that was not left."""
    if solution.statistics.at_saddle:
        warn(
            f"the solution is a saddle: its cost, {solution.cost:.6g}, has no slope there, but falls nearby, and no "
            "lower one was found from there; give another guess= or starts="
        )


def _falling_guesses(solver: ProblemSolver, solution: Solution) -> list[Guess]:
    """Guesses on both sides of a solution along the direction in which its cost falls most; none if it does not."""
    begin = solver.beginning_at(solution)
    direction = _falling_direction(begin)
    if direction is None or begin.iterate is None:
        return []
    step, guesses = STEP * direction / np.max(np.abs(direction)), []
    for moved in (begin.x + step, begin.x - step):
        x = np.clip(moved, begin.bounds.lower, begin.bounds.upper)
        guesses.append(replace(begin.guess, iterate=replace(begin.iterate, x=x), description="away from a saddle"))
    return guesses


def _falling_direction(begin: Beginning) -> np.ndarray | None:
    """Scaled direction that the rows leave and along which the cost falls to second order; None if none is found."""
    iterate = begin.iterate
    assert iterate is not None
    curvature = Curvature(begin.program, begin.x, begin.data, begin.bounds, iterate.lam_x, iterate.lam_g)
    whole, free, n = curvature.whole, curvature.free, int(curvature.free.sum())
    if n == 0:
        return None
    random = np.random.default_rng(0).normal(size=n)
    projected = curvature.response()
    first = projected(random)
    if not np.linalg.norm(first) > ROUNDING * np.linalg.norm(random):  # the rows leave nothing
        return None
    direction, largest = _least_curved(lambda v: projected(whole @ v), first)
    # of a direction in which rows that nearly depend on each other change nothing is left
    within = projected(direction)
    if largest <= FLAT or within @ (whole @ within) >= -FALLING * largest or np.linalg.norm(within) < LEFT:
        return None
    found = np.zeros(free.size)
    found[free] = within
    return found


class Curvature:
    """Second derivatives of the scaled cost at a solution, in directions that its rows leave.

    Limits count as in an interior-point method: by their multipliers and slacks.

    Attributes
    ----------
    free : numpy.ndarray
        Variables that no limit holds (n,).
    whole : scipy.sparse.csc_matrix
        Second derivatives by these, those of the rows by their multipliers included.
    """

    def __init__(
        self,
        program: CollocationProgram,
        x: np.ndarray,
        data: np.ndarray,
        bounds: Bounds,
        lam_x: np.ndarray,
        lam_g: np.ndarray,
    ):
        from scipy.sparse import diags

        derivatives = program.nlp.derivatives
        hessian = ca.triu2symm(derivatives["hess_lag"](x, data, 1.0, lam_g)).sparse()
        rows, jacobian = derivatives["jac_g"](x, data)
        slopes = jacobian.sparse()
        of_rows = _stiffness(rows.full().ravel(), bounds.rows_lower, bounds.rows_upper, lam_g)
        of_variables = _stiffness(x, bounds.lower, bounds.upper, lam_x)
        self.free, held, soft = of_variables <= HELD, of_rows > HELD, of_rows <= HELD
        limits = slopes[soft].T @ diags(of_rows[soft]) @ slopes[soft]
        self.whole = (hessian + diags(of_variables) + limits).tocsc()[self.free][:, self.free]
        self._slopes = slopes[held][:, self.free]

    def response(self, least: float | None = None) -> Callable[[np.ndarray], np.ndarray]:
        """Return the function from a force on the free variables to the step with which they give way within the rows.

        They resist by the curvature of the cost and `least` more; by one each if that is None, and the step is the
        projection of the force.
        """
        from scipy.sparse import bmat, eye
        from scipy.sparse.linalg import splu

        n, count = self.whole.shape[0], self._slopes.shape[0]
        stiffness = eye(n) if least is None else self.whole + least * eye(n)
        factors = splu(bmat([[stiffness, self._slopes.T], [self._slopes, -SINGULAR * eye(count)]], format="csc"))
        return lambda force: factors.solve(np.concatenate([force, np.zeros(count)]))[:n]

    def compliance(self, places: Sequence[int], least: float) -> np.ndarray:
        """Return steps of some variables by forces on each of them (k, k); zero for those that a limit holds."""
        respond, among = self.response(least), np.cumsum(self.free) - 1
        found = np.zeros((len(places), len(places)))
        moving = [j for j, place in enumerate(places) if self.free[place]]
        for j in moving:
            force = np.zeros(self.whole.shape[0])
            force[among[places[j]]] = 1.0
            found[moving, j] = respond(force)[among[[places[k] for k in moving]]]
        return (found + found.T) / 2


def _least_curved(times: Callable[[np.ndarray], np.ndarray], start: np.ndarray) -> tuple[np.ndarray, float]:
    """Direction of least curvature that some steps of Lanczos find, and the largest curvature.

    `times` multiplies a vector by a symmetric matrix.
    """
    basis, products = [start / np.linalg.norm(start)], []
    for _ in range(min(LANCZOS, start.size)):
        products.append(times(basis[-1]))
        rest, known = products[-1], np.array(basis)
        for _ in range(2):
            rest = rest - known.T @ (known @ rest)
        if np.linalg.norm(rest) <= ROUNDING * max(map(np.linalg.norm, products)):
            break
        basis.append(rest / np.linalg.norm(rest))
    found = np.array(basis[: len(products)])
    curvatures, vectors = np.linalg.eigh(found @ np.array(products).T)
    return found.T @ vectors[:, 0], float(np.max(np.abs(curvatures)))


def _stiffness(values: np.ndarray, lower: np.ndarray, upper: np.ndarray, multipliers: np.ndarray) -> np.ndarray:
    """Stiffnesses of limits, multiplier over slack of the one it belongs to; infinite if both are the same."""
    slack = np.maximum(np.where(multipliers < 0, values - lower, upper - values), CLOSEST)
    return np.where(lower == upper, np.inf, np.abs(multipliers) / slack)
