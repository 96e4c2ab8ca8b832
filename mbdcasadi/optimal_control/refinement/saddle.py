"""Saddles: solutions at which the cost has no slope, but falls to second order.

A solver stays there, as at rest if the greatest speed is sought. The second derivatives of the program show in which
direction the cost falls, and from a little further along it the solver finds its way.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import casadi as ca
import numpy as np

from ...errors import warn
from ..checks.failure import OptimizationError, is_unbounded
from ..guess.guess import Guess
from ..nlp.problem_solver import ProblemSolver
from ..nlp.solvers.base import Beginning
from ..nlp.statistics import Attempt
from ..solution import Solution, same_cost
from .mesh import Mesh

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
#: Largest number of iterations from a guess.
ITERATIONS = 300


def leave_saddle(solver: ProblemSolver, solution: Solution) -> Solution:
    """Return a solution of lower cost if this one is a saddle, else the same one.

    Its statistics say whether it is a saddle, and have all solves. That the cost has no lower bound from there is an
    :class:`OptimizationError`.
    """
    for _ in range(SADDLES):
        guesses = [] if solution.statistics.at_saddle is False else _falling_guesses(solver, solution)
        solution.statistics = replace(solution.statistics, at_saddle=bool(guesses))
        before = solution.statistics
        lower = _best(solver, solution.meshes, guesses, before.starts or [solution.as_attempt("to a saddle")])
        if lower is None or lower.cost >= solution.cost or same_cost(lower.cost, solution.cost):
            break
        lower.statistics = replace(lower.statistics, stages=before.stages)
        solution = lower
    return solution


def solve_past_saddle(solver: ProblemSolver, stuck: Solution) -> Solution | None:
    """Return a solution from the last iterate of a solve that got stuck while it met all demands, as near a saddle.

    None if the cost does not fall to second order there, or no solve succeeds.
    """
    return _best(solver, stuck.meshes, _falling_guesses(solver, stuck), [stuck.as_attempt("near a saddle")])


def warn_of_saddle(solution: Solution) -> None:
    """Warn if a solution is a saddle that was not left."""
    if solution.statistics.at_saddle:
        warn(
            f"the solution is a saddle: its cost, {solution.cost:.6g}, has no slope there, but falls nearby, and no "
            "lower one was found from there; give another guess= or starts="
        )


def _best(
    solver: ProblemSolver, meshes: Sequence[Mesh], guesses: Sequence[Guess], reports: Sequence[Attempt]
) -> Solution | None:
    """The best solution from guesses, whose statistics have reports of all solves besides those before."""
    best = None
    for guess in guesses:
        solver.best.new_stage()
        try:
            found = end = solver.solve(meshes, guess, limit=ITERATIONS)
        except OptimizationError as error:
            found, end = None, error.partial
            if is_unbounded(end):
                raise
        reports = [*reports, end.as_attempt(guess.description)]
        if found is not None and (best is None or found.cost < best.cost):
            best = found
    if best is not None:
        best.statistics = replace(best.statistics, starts=list(reports))
    return best


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
    """Scaled direction that the rows leave and along which the cost falls to second order; None if none is found.

    Limits count as in an interior-point method: by their multipliers and slacks.
    """
    from scipy.sparse import bmat, diags, eye
    from scipy.sparse.linalg import splu

    assert begin.iterate is not None
    x, bounds, iterate = begin.x, begin.bounds, begin.iterate
    derivatives = begin.program.nlp.derivatives
    hessian = ca.triu2symm(derivatives["hess_lag"](x, begin.data, 1.0, iterate.lam_g)).sparse()
    rows, jacobian = derivatives["jac_g"](x, begin.data)
    slopes = jacobian.sparse()
    of_rows = _stiffness(rows.full().ravel(), bounds.rows_lower, bounds.rows_upper, iterate.lam_g)
    of_variables = _stiffness(x, bounds.lower, bounds.upper, iterate.lam_x)
    free, held, soft = of_variables <= HELD, of_rows > HELD, of_rows <= HELD
    limits = slopes[soft].T @ diags(of_rows[soft]) @ slopes[soft]
    whole = (hessian + diags(of_variables) + limits).tocsc()[free][:, free]
    slopes, n = slopes[held][:, free], int(free.sum())
    if n == 0:
        return None
    random = np.random.default_rng(0).normal(size=n)
    nearly_zero = -SINGULAR * eye(slopes.shape[0])
    factors = splu(bmat([[eye(n), slopes.T], [slopes, nearly_zero]], format="csc"))

    def projected(vector: np.ndarray) -> np.ndarray:
        return factors.solve(np.concatenate([vector, np.zeros(slopes.shape[0])]))[:n]

    first = projected(random)
    if not np.linalg.norm(first) > ROUNDING * np.linalg.norm(random):  # the rows leave nothing
        return None
    direction, largest = _least_curved(lambda v: projected(whole @ v), first)
    # of a direction in which rows that nearly depend on each other change nothing is left
    within = projected(direction)
    if largest <= FLAT or within @ (whole @ within) >= -FALLING * largest or np.linalg.norm(within) < LEFT:
        return None
    found = np.zeros(x.size)
    found[free] = within
    return found


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
