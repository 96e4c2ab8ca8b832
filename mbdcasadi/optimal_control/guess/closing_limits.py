"""Search after a solve that failed: without limits first, then with limits that close in, then the least violation.

A solver that stops at an infeasible point has found that no motion near that point meets all demands, and nothing
else. So the problem is solved without its limits, and from that solution with limits that close in step by step. If
these cannot be closed, detours are tried (a weak motor swings a pendulum up in several swings), and at last the sum
of all violations is minimised from several starts. Only if that ends above zero, and at the same least violation
from several of them, does the problem seem infeasible. If the problem is not solved without its limits either, the
violations come first, and detours at last.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from ...numerics.homotopy import Step, follow
from ..checks.expressions import kinks_in_costs, kinks_in_path
from ..checks.failure import OptimizationError, infeasible, is_unbounded, not_found
from ..nlp.problem_solver import ProblemSolver
from ..nlp.statistics import Attempt
from ..refinement.coarse_mesh import FRESH_PASSES, is_lost
from ..refinement.mesh import Mesh
from ..solution import Solution
from .guess import Guess

#: Messages of the solver after which the search goes on.
RESUMABLE = (
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Maximum_Iterations_Exceeded",
    "Search_Direction_Becomes_Too_Small",
    "Diverging_Iterates",
    "Error_In_Step_Computation",
)
#: Iterations without limits, of a step in which limits close in, and of a least violation.
FREE_ITERATIONS, CLOSING_ITERATIONS, VIOLATION_ITERATIONS = 300, 150, 300
#: Share of its length below which a step in which limits close in is given up.
SMALLEST_STEP = 1 / 8
#: Power with which the remaining excess falls from step to step: in the end it is small compared with the limits.
CLOSING_POWER = 3
#: Sum of scaled violations up to which a motion counts as one that meets all demands.
FEASIBLE = 1e-6
#: Detours that are tried, and iterations of each.
DETOURS, DETOUR_ITERATIONS = 6, 200
#: Weights of the distance from the guess in a least violation, and from each motion found in the next one: the first
#: ones lead on safely, the last one leaves the least violation as it is.
NEARNESS = (1e-4, 1e-6, 1e-8)
#: Starts from which the same least violation must be found, up to a share of it, and none below, for a problem to seem
#: infeasible; one more if others end in larger ones, since several minima show that there may be further ones. And
#: starts with detours among those that are tried.
STARTS, SAME_VIOLATION, DETOURED_STARTS = 2, 0.01, 3


def may_go_on(error: OptimizationError, options: dict) -> bool:
    """Return True if a failure leaves open whether the problem has a solution, and the user did not ask to stop.

    With a kink in the cost, or a cost without a lower bound, a solver with derivatives would fail again from any guess.
    """
    status = error.partial.statistics.status
    limited = status == "Maximum_Iterations_Exceeded" and "ipopt.max_iter" in options
    if status not in RESUMABLE or limited or is_unbounded(error.partial):
        return False
    return not kinks_in_costs(error.partial.problem)


class LimitSearch:
    """Search for a solution after a solve that failed.

    Parameters
    ----------
    solver : ProblemSolver
        Problem to be solved.
    meshes : sequence of Mesh
        Meshes by phase.
    guess : Guess
        Guess from which the solve failed.
    second : Guess
        Another one, from which violations are minimised besides.
    detour : callable
        Makes guesses with random detours.
    refined : bool
        True if the meshes may become finer: limits close in from a motion, and not from errors of the mesh.
    """

    def __init__(
        self,
        solver: ProblemSolver,
        meshes: Sequence[Mesh],
        guess: Guess,
        second: Guess,
        detour: Callable[[], Guess],
        *,
        refined: bool,
    ):
        self._solver, self._meshes, self._guess, self._second, self._detour = solver, meshes, guess, second, detour
        self._refined = refined
        self._stages: list[Attempt] = []

    def run(self, failure: OptimizationError) -> Solution:
        """Return a solution, or raise the failure with the result of the search.

        Raises
        ------
        OptimizationError
            The problem seems infeasible, with what is in conflict, or no solution was found.
        Interrupted
            After Ctrl-C.
        """
        self._note(failure.partial, "all limits")
        closed, nearest = self._close_in()
        lost = nearest is self._guess  # without limits, too: then what is said to be in conflict comes first
        for search in (self._by_violation, self._by_detours) if lost else (self._by_detours, self._by_violation):
            closed = search(nearest, failure) if closed is None else closed
        if closed is None:
            raise not_found(failure, [stage.description for stage in self._stages]) from None
        failed = failure.partial.statistics
        closed.statistics = closed.statistics.after(failed).at_end_of(self._stages, failed)
        return closed

    def _note(self, solution: Solution, description: str) -> None:
        self._stages.append(solution.as_attempt(description))

    # --- limits that close in -----------------------------------------------------------------
    def _close_in(self) -> tuple[Solution | None, Guess]:
        """Solution with all limits, from one without; else the last motion on the way."""
        solver = self._solver
        free, excess, succeeded = self._without_limits()
        if not succeeded:
            return None, self._guess

        def closer(point: Solution, _at: float, to: float) -> Step[Solution] | None:
            remaining = (1 - to) ** CLOSING_POWER
            guess = _without_multipliers(point.as_guess(solver.problem))
            if remaining == 0:
                return self._solved(guess, "all limits, closed in")
            loose = {label: remaining * amount for label, amount in excess.items()}
            solution, _, reached = solver.solve_loosened(self._meshes, guess, loose, CLOSING_ITERATIONS)
            self._note(solution, f"limits loosened by {remaining:.2g} of their excess")
            return Step(solution) if reached else None

        end = follow(free, closer, smallest=SMALLEST_STEP)
        return end.point if end.complete else None, _without_multipliers(end.point.as_guess(solver.problem))

    def _without_limits(self) -> tuple[Solution, dict[str, float], bool]:
        """Solution without limits, as :meth:`ProblemSolver.solve_loosened`; on a mesh so fine that it is a motion."""
        for _ in range(FRESH_PASSES + 1):
            result = self._solver.solve_loosened(self._meshes, self._guess, None, FREE_ITERATIONS)
            free, _, succeeded = result
            self._note(free, "no limits")
            if not (self._refined and succeeded and is_lost(free)):
                break
            self._meshes = [mesh.split(2) for mesh in self._meshes]
        return result

    def _by_detours(self, _nearest: Guess, _failure: OptimizationError) -> Solution | None:
        """The first solution from a random detour; None if there is none."""
        for guess in (self._detour() for _ in range(DETOURS)):
            solved = self._solved(guess, f"all limits, {guess.description}", DETOUR_ITERATIONS)
            if solved is not None:
                return solved.point
        return None

    def _solved(self, guess: Guess, description: str, limit: int | None = None) -> Step[Solution] | None:
        """A solution of the problem itself from a guess."""
        try:
            solution = self._solver.solve(self._meshes, guess, warm=limit is None, limit=limit)
        except OptimizationError as error:
            self._note(error.partial, description)
            return None
        self._note(solution, description)
        return Step(solution)

    # --- the least violation --------------------------------------------------------------------
    def _by_violation(self, nearest: Guess, failure: OptimizationError) -> Solution | None:
        """Solution from a motion that meets all demands; None if no such motion was found.

        Raises
        ------
        OptimizationError
            If the least violation is not zero and the same from several starts, unless the solve that failed had met
            all demands at its end.
        """
        problem, arguable = self._solver.problem, bool(failure.largest_violations)
        arguable = arguable and not kinks_in_path(problem)
        starts = (lambda: nearest, lambda: self._second, *[self._detour] * DETOURED_STARTS)
        guesses: Iterable[Guess] = (start() for start in starts)
        # near to all starts first, which often ends at a motion that meets all; the rest is for what is in conflict
        for weights in (NEARNESS[:1], NEARNESS[1:]):
            conflicting: list[tuple[float, Solution, dict[str, float]]] = []
            for guess in guesses:
                solution, slacks, succeeded = self._least_violation(guess, weights)
                total = sum(slacks.values())
                if total <= FEASIBLE:
                    arguable = False
                    feasible = _without_multipliers(solution.as_guess(problem))
                    solved = self._solved(feasible, "all limits, from a motion that meets them")
                    if solved is not None:
                        return solved.point
                elif succeeded:
                    conflicting.append((total, solution, slacks))
            if not arguable or len(conflicting) < STARTS:
                return None
            guesses = [_without_multipliers(solution.as_guess(problem)) for _, solution, _ in conflicting]
        least = min(conflicting, key=lambda found: found[0])
        agreeing = sum(total <= (1 + SAME_VIOLATION) * least[0] for total, *_ in conflicting)
        if agreeing >= STARTS + (agreeing < len(conflicting)):
            raise infeasible(failure, *least[1:], agreeing, FEASIBLE) from None
        return None

    def _least_violation(self, near: Guess, weights: Sequence[float]) -> tuple[Solution, dict[str, float], bool]:
        """Least violation from a guess, less and less near to it; as :meth:`ProblemSolver.least_violation`."""
        for weight in weights:
            result = self._solver.least_violation(self._meshes, near, VIOLATION_ITERATIONS, weight)
            solution, slacks, succeeded = result
            total = sum(slacks.values())
            if not succeeded or total <= FEASIBLE:
                break
            near = _without_multipliers(solution.as_guess(self._solver.problem))
        self._note(solution, f"least violation, {total:.2g} in all")
        return result


def _without_multipliers(guess: Guess) -> Guess:
    """The same motion, without multipliers that belong to other limits."""
    return replace(guess, iterate=None)
