"""Search after a solve that failed: from other meshes and motions, and by the least violation of the demands.

A solver that stops at an infeasible point has found that no motion near that point meets all demands, and nothing
else. So the search goes on, until a solution is found:

1. if the solver ran out of iterations, on a mesh of other intervals, and from there on the mesh itself: that it lost
   its way may be an accident of the mesh,
2. without limits, and from there with all of them, on a mesh twice as fine if it is coarse for that motion; a chain
   with fewer inputs than angles also from motions on which it swings,
3. with violations of limits and conditions at a price beside the cost, from the motion without limits, from the first
   guess, from simulated motions under random inputs, and from motions to other poses at the end; and with all demands
   from motions that come near to them, to other poses at the end also from a solution without limits,
4. from the first guess with more iterations, if the solver had run out of them,
5. from detours (a weak motor swings a pendulum up in several swings),
6. with the least sum of all violations, from several starts.

Only if that ends above zero, and at the same least violation from several starts, does the problem seem infeasible,
unless the linkage could fold on the way and get there on its other branch; or before stage 3 if a mechanism of one
degree of freedom does not reach a place in the time, see :mod:`in_time`. The least violation of limits alone, with all
conditions met, then says which of them would have to be wider. If the problem is not solved without its limits either,
the violations come first, and detours at last.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import partial

import numpy as np

from ...errors import OptimizationError
from ...numerics.lazy import cached_property
from ..measures.branch import branch_jump
from ..measures.local_error import COARSE_ERROR, Coarseness
from ..measures.singularity import folding_pose_of
from ..motion.guess import Guess
from ..program.limit_sides import LimitSides, Slacks
from ..program.statistics import Attempt
from ..solution import Solution
from ..solve.expressions import kinks_in_costs, kinks_in_path
from ..solve.failure import infeasible, is_unbounded, not_found
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh, interval_count
from .coarse_mesh import HALVED_INTERVALS, is_lost
from .detours import SWINGS, swings
from .in_time import out_of_time
from .multistart import other_ends, random_motions
from .slow_first import solve_slowly_first

#: Messages of the solver after which the search goes on.
RESUMABLE = (
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Maximum_Iterations_Exceeded",
    "Search_Direction_Becomes_Too_Small",
    "Diverging_Iterates",
    "Error_In_Step_Computation",
)
#: Iterations without limits, with all limits from a motion without or near to them, and of a least violation.
FREE_ITERATIONS, CLOSING_ITERATIONS, VIOLATION_ITERATIONS = 200, 150, 300
#: Largest number of meshes, each twice as fine, on which a problem without limits is solved again from its guess.
FRESH_PASSES = 2
#: Share of the intervals that another mesh has, and iterations on it: accidents of a mesh cost twenty elsewhere.
OTHER_MESH, OTHER_ITERATIONS = 1.25, 100
#: Weights of the cost beside the sum of scaled violations, which fall as the price of these rises as long as their sum
#: falls below a share of what it was; and iterations with each.
COST_WEIGHTS, FALLING, PENALTY_ITERATIONS = (0.1, 0.01, 0.001), 0.9, 100
#: Sum of scaled violations up to which the problem itself is solved from a motion: a least violation that is not zero
#: may be a local one, which a solver that may violate the equations of motion on its way gets round.
NEAR = 1.0
#: Iterations of the problem itself from its first guess, if it ran out of them at first, and number of starts whose
#: violations at a price agree from which it does not do so.
MORE_ITERATIONS, AGREEING = 1000, 4
#: Random motions from which penalties are tried.
TRIED_MOTIONS = 6
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
#: What is found from them, in words.
LEAST_VIOLATION = "the least violation of all its demands together"


def may_go_on(error: OptimizationError, options: dict) -> bool:
    """Return True if a failure leaves open whether the problem has a solution, and the user did not ask to stop.

    With a kink in the cost, or a cost without a lower bound, a solver with derivatives would fail again from any guess.
    """
    status = error.partial.statistics.status
    if status not in RESUMABLE or is_limited(error, options) or is_unbounded(error.partial):
        return False
    return not kinks_in_costs(error.partial.problem)


def is_limited(error: OptimizationError, options: dict) -> bool:
    """Return True if a solve ended after as many iterations as the user allows."""
    return _ran_out(error) and "ipopt.max_iter" in options


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
        #: the motion that violates the demands least of those found with penalties, and the sum of its violations
        self._nearest: Solution | None = None
        self._least = np.inf
        self._sums: list[float] = []

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
        closed = self._by_another_mesh() if _ran_out(failure) else None
        if closed is None:
            closed = self._searched(failure)
        failed = failure.partial.statistics
        closed.statistics = closed.statistics.after(failed).at_end_of(self._stages, failed)
        return closed

    def _searched(self, failure: OptimizationError) -> Solution:
        """The first solution of the stages of the search; raises as :meth:`run` does."""
        has_limits = bool(LimitSides(failure.partial.program).sides)
        free = self._without_limits() if has_limits else None
        if has_limits:
            self._refuse_out_of_time(failure, free)
        searches: list[Callable[[], Solution | None]] = [
            partial(self._close_in, free),
            *([self._by_swings] if has_limits else []),
            partial(self._by_random_motions, free),
            self._by_other_ends,
            partial(self._by_more_iterations, failure),
            self._by_detours,
        ]
        # without a solution without limits, what is said to be in conflict comes before detours and more iterations
        place = len(searches) - (2 if free is None else 0)
        searches.insert(place, partial(self._by_violation, failure, free))
        solutions = (search() for search in searches)
        closed = next((solution for solution in solutions if solution is not None), None)
        if closed is None:
            widened = None if free is None else self._widened(free)
            raise not_found(failure, [stage.description for stage in self._stages], widened, FEASIBLE) from None
        return closed

    def _note(self, solution: Solution, description: str, violation: float | None = None) -> None:
        self._stages.append(solution.as_attempt(description, violation=violation))

    def _by_another_mesh(self) -> Solution | None:
        """Solution from one on a mesh of other intervals, from the first guess; None if there is none."""
        meshes = [mesh.resized(OTHER_MESH) for mesh in self._meshes]
        other = self._solved(self._guess, "all limits, another mesh", OTHER_ITERATIONS, meshes)
        return other and self._solved(
            self._solver.motion_of(other), "all limits, from another mesh", CLOSING_ITERATIONS
        )

    # --- limits that close in -----------------------------------------------------------------
    def _without_limits(self) -> Solution | None:
        """Solution without limits, on a mesh so fine that it is a motion; None if there is none.

        If it is coarse for that motion, limits close in on a mesh twice as fine, since limits that are just met there
        may not be met on a coarse one.
        """
        for _ in range(FRESH_PASSES + 1):
            free, succeeded = self._solver.solve_unlimited(self._meshes, self._guess, FREE_ITERATIONS)
            self._note(free, "no limits")
            if not succeeded:
                return None
            lost = self._refined and is_lost(free)
            motion = self._slowly_without_limits() if lost else None
            if motion is not None:
                return motion
            coarse = self._refined and Coarseness(free).largest > COARSE_ERROR
            if lost or (coarse and interval_count(self._meshes) <= HALVED_INTERVALS):
                self._meshes = [mesh.split(2) for mesh in self._meshes]
            if not lost:
                break
        return free

    def _slowly_without_limits(self) -> Solution | None:
        """Solution without limits of the problem, slowly first, on a mesh that holds; None if there is none."""
        meshes = [mesh.split(2) for mesh in self._meshes]
        found = solve_slowly_first(self._solver.unlimited(), meshes, self._guess, [])
        if found is None or not found[1]:
            return None
        self._note(found[0], "no limits, slowly first")
        self._meshes = list(found[0].meshes)
        return found[0]

    def _close_in(self, free: Solution | None) -> Solution | None:
        """Solution with all limits, from one without and from the first guess."""
        if free is not None:
            guess = self._solver.motion_of(free)
            solved = self._solved(guess, "all limits, closed in", CLOSING_ITERATIONS)
            solved = self._by_penalties(guess, "no limits") if solved is None else solved
            if solved is not None:
                return solved
        return self._by_penalties(self._guess, self._guess.description)

    def _by_random_motions(self, free: Solution | None) -> Solution | None:
        """The first solution from one of the best of random motions; None if there is none."""
        nearest = free if self._nearest is None else self._nearest
        if nearest is None:
            return None
        peaks = np.max(np.abs(nearest.phases[0].trajectory.inputs), axis=0)
        for guess in random_motions(self._solver, self._meshes, peaks, np.random.default_rng(0))[:TRIED_MOTIONS]:
            solved = self._by_penalties(guess, guess.description)
            if solved is not None:
                return solved
        return None

    def _by_swings(self) -> Solution | None:
        """The cheapest solution from motions on which a chain swings; None if there is none."""
        closed = [self._closed_in_from(guess) for guess in swings(self._solver, [])[: len(SWINGS)]]
        return min(filter(None, closed), key=lambda solution: solution.cost, default=None)

    @cached_property
    def _other_ends(self) -> list[Guess]:
        """Motions that end in other poses than the first guess."""
        return other_ends(self._solver)

    def _by_other_ends(self) -> Solution | None:
        """The first solution from motions to other poses at the end; None if there is none."""
        for guess in self._other_ends:
            solved = self._closed_in_from(guess) or self._by_penalties(guess, guess.description)
            if solved is not None:
                return solved
        return None

    def _closed_in_from(self, guess: Guess) -> Solution | None:
        """Solution with all limits, from one without limits from a guess; None if there is none."""
        free, succeeded = self._solver.solve_unlimited(self._meshes, guess, FREE_ITERATIONS)
        self._note(free, f"no limits, {guess.description}")
        if not succeeded or branch_jump(free) is not None:
            return None
        return self._solved(
            self._solver.motion_of(free), f"all limits, closed in, {guess.description}", CLOSING_ITERATIONS
        )

    def _by_penalties(self, guess: Guess, description: str) -> Solution | None:
        """Solution from a motion whose violations have a price that rises, if this comes near to all demands."""
        before = np.inf
        for weight in COST_WEIGHTS:
            solution, slacks, succeeded = self._solver.least_violation(
                self._meshes, guess, PENALTY_ITERATIONS, NEARNESS[-1], weight
            )
            total = sum(slacks.values())
            self._note(solution, f"violations at a price, from {description}", total)
            if (not succeeded and total > NEAR) or branch_jump(solution) is not None:
                return None
            if total < self._least:
                self._least, self._nearest = total, solution
            guess = self._solver.motion_of(solution)
            if total <= FEASIBLE or total > FALLING * before:
                break
            before = total
        known = total > FEASIBLE and any(abs(total - other) <= SAME_VIOLATION * other for other in self._sums)
        self._sums.append(total)
        if known or total > NEAR:  # from the same local minimum the solver would end as it did before
            return None
        return self._solved(guess, "all limits, from a motion near to them", CLOSING_ITERATIONS)

    def _by_more_iterations(self, failure: OptimizationError) -> Solution | None:
        """Solution from the first guess with more iterations, if the solver ran out of them.

        Not if penalties led from all starts to the same sum of violations.
        """
        same = len(self._sums) >= AGREEING and max(self._sums) <= (1 + SAME_VIOLATION) * min(self._sums)
        if same or not _ran_out(failure):
            return None
        return self._solved(self._guess, "all limits, more iterations", MORE_ITERATIONS)

    # --- detours --------------------------------------------------------------------------------
    def _by_detours(self) -> Solution | None:
        """The first solution from a random detour; None if there is none."""
        for guess in (self._detour() for _ in range(DETOURS)):
            solved = self._solved(guess, f"all limits, {guess.description}", DETOUR_ITERATIONS)
            if solved is not None:
                return solved
        return None

    def _solved(
        self, guess: Guess, description: str, limit: int, meshes: Sequence[Mesh] | None = None
    ) -> Solution | None:
        """A solution of the problem itself from a guess; None if it is not found, or jumps to another branch."""
        try:
            solution = self._solver.solve(self._meshes if meshes is None else meshes, guess, limit=limit)
        except OptimizationError as error:
            self._note(error.partial, description)
            return None
        self._note(solution, description)
        return solution if branch_jump(solution) is None else None

    # --- the least violation --------------------------------------------------------------------
    def _by_violation(self, failure: OptimizationError, free: Solution | None) -> Solution | None:
        """Solution from a motion that meets all demands; None if no such motion was found.

        Raises
        ------
        OptimizationError
            If the least violation is not zero and the same from several starts, unless the solve that failed had met
            all demands at its end, or the linkage could fold on the way.
        """
        problem, arguable = self._solver.problem, bool(failure.largest_violations)
        arguable = arguable and not kinks_in_path(problem)
        nearest = self._guess if self._nearest is None else self._solver.motion_of(self._nearest)
        starts = (lambda: nearest, lambda: self._second, *[self._detour] * DETOURED_STARTS)
        guesses: Iterable[Guess] = itertools.chain((start() for start in starts), self._other_ends)
        # near to all starts first, which often ends at a motion that meets all; the rest is for what is in conflict
        for weights in (NEARNESS[:1], NEARNESS[1:]):
            conflicting: list[tuple[float, Solution, Slacks]] = []
            for guess in guesses:
                solution, slacks, succeeded = self._least_violation(guess, weights)
                total = sum(slacks.values())
                if branch_jump(solution) is not None:
                    continue  # it is not a motion of the mechanism
                if total <= FEASIBLE:
                    arguable = False
                    found = "all limits, from a motion that meets them"
                    solved = self._solved(self._solver.motion_of(solution), found, CLOSING_ITERATIONS)
                    if solved is not None:
                        return solved
                elif succeeded:
                    conflicting.append((total, solution, slacks))
            if not arguable or len(conflicting) < STARTS:
                return None
            guesses = [self._solver.motion_of(solution) for _, solution, _ in conflicting]
        least = min(conflicting, key=lambda found: found[0])
        agreeing = sum(total <= (1 + SAME_VIOLATION) * least[0] for total, *_ in conflicting)
        if self._least < (1 - SAME_VIOLATION) * least[0]:
            return None
        if agreeing < STARTS + (agreeing < len(conflicting)):
            return None
        if any(folding_pose_of(part) is not None for _, solution, _ in conflicting for part in solution.phases):
            return None  # all demands may be met beyond that pose on its other branch
        widened = self._widened(least[1] if free is None else free)
        if widened is not None and sum(widened[1].values()) <= FEASIBLE:
            found = "all limits, from a motion that meets them"
            return self._solved(self._solver.motion_of(widened[0]), found, CLOSING_ITERATIONS)
        reason = f"{LEAST_VIOLATION}, from {agreeing} starts, is not zero"
        raise infeasible(failure, least[1:], widened, reason, FEASIBLE) from None

    def _refuse_out_of_time(self, failure: OptimizationError, free: Solution | None) -> None:
        """Raise the failure if a place is not reached in the time, and the least violation is not zero either."""
        place = out_of_time(self._solver)
        if not place:
            return
        solution, slacks, _ = self._least_violation(self._guess, NEARNESS)
        if sum(slacks.values()) > FEASIBLE:
            reason = f"{place} is not reached in the time with all the work that the inputs can do within their limits"
            widened = None if free is None else self._widened(free)
            raise infeasible(
                failure, (solution, slacks), widened, f"{reason}; {LEAST_VIOLATION} is not zero", FEASIBLE
            ) from None

    def _widened(self, solution: Solution) -> tuple[Solution, Slacks] | None:
        """Least violation of limits alone, near to a motion, with all conditions met; None if it is not found."""
        motion, slacks, succeeded = self._least_violation(self._solver.motion_of(solution), NEARNESS, limits_alone=True)
        return (motion, slacks) if succeeded else None

    def _least_violation(
        self, near: Guess, weights: Sequence[float], *, limits_alone: bool = False
    ) -> tuple[Solution, Slacks, bool]:
        """Least violation from a guess, less and less near to it; as :meth:`ProblemSolver.least_violation`."""
        for weight in weights:
            result = self._solver.least_violation(
                self._meshes, near, VIOLATION_ITERATIONS, weight, limits_alone=limits_alone
            )
            solution, slacks, succeeded = result
            total = sum(slacks.values())
            if not succeeded or total <= FEASIBLE:
                break
            near = self._solver.motion_of(solution)
        self._note(solution, f"least violation{' of limits alone' if limits_alone else ''}", total)
        return result


def _ran_out(failure: OptimizationError) -> bool:
    """True if the solver ran out of iterations."""
    return bool(failure.partial.statistics.status == "Maximum_Iterations_Exceeded")
