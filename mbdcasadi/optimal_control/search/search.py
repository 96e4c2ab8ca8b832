"""Search for a solution: strategies propose solves, which are tried, recorded, and ranked by what they cost.

Before anything is solved it is looked whether the linkage reaches the waypoints and the end at all, see
:mod:`~mbdcasadi.kinematics.reach`. Then the strategies have their turns, in the order of :mod:`strategies`: each says
whether it applies, proposes one solve after another, and sees how it ended. Those that look for a solution after a
failure have no turn if the failure is final. The best solution is the cheapest one whose mesh holds; with a tolerance
its mesh is refined, see :func:`refine`.

A mesh that is fine is solved from the solution that the whole search finds on a coarse one. In a continuation a failure
after the first values inserts values in between, see :mod:`parameter_continuation`.
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from ...arguments.values import pairs_of
from ...errors import ModelError, OptimizationError
from ...numerics.symbolic import numeric_work, symbolic
from ...numerics.tolerances import MET
from ..measures.branch import branch_jump, refuse_branch_jump
from ..motion.guess import Guess
from ..problem import OptimalControlProblem
from ..program.setup import PhaseSetup, Settings, has_open_chains
from ..program.statistics import Attempt
from ..solution import Shifted, Solution
from ..solve.best_so_far import BestSoFar
from ..solve.expressions import kinks_in_costs
from ..solve.failure import is_unbounded, not_found
from ..solve.problem_solver import ProblemSolver
from ..solve.solvers.base import Elsewhere
from ..solve.solvers.ipopt import sharp_options
from ..transcription.mesh import Mesh, interval_count
from .budgets import BUDGETS
from .far_off import refined_if_far_off
from .first_mesh import INTERVALS, first_meshes, is_automatic
from .given_guess import read_guess
from .least_violation import least_limits
from .parameter_continuation import by_continuation
from .proposal import Outcome, Proposal, Violations
from .reach import check_reach
from .refine import refine
from .starts import Starts
from .strategies import STRATEGIES
from .strategy import Strategy
from .trials import Trials

#: Number of intervals from which a mesh is fine.
FINE = 160
#: Messages of the solver after which the search goes on.
RESUMABLE = (
    "Infeasible_Problem_Detected",
    "Restoration_Failed",
    "Maximum_Iterations_Exceeded",
    "Search_Direction_Becomes_Too_Small",
    "Diverging_Iterates",
    "Error_In_Step_Computation",
)

Found = TypeVar("Found")

#: Number of starts, or guesses of each; None for the usual ones.
Several = int | list[Any] | None


@dataclass(frozen=True)
class Search:
    """Solves of one problem with the same settings, at any parameter values.

    Parameters
    ----------
    problem : OptimalControlProblem
        Problem to be solved.
    intervals : int or "auto"
        Number of intervals of the mesh of each phase.
    initial : State or sequence of Condition, optional
        Start in place of the problem's own.
    settings : Settings
        Choices of the user.
    best : BestSoFar
        Record for the user who stops the search.
    executor : Executor, optional
        Threads or processes that solve from several starts at a time.
    strategies : sequence of Strategy
        What is tried, in this order.
    """

    problem: OptimalControlProblem
    intervals: Any
    initial: Any
    settings: Settings
    best: BestSoFar
    executor: Executor | None = None
    strategies: Sequence[Strategy] = STRATEGIES

    def is_known(self, guess: Any) -> bool:
        """Return True if a guess is a solution of the same problem, whose mesh is not checked anew."""
        return isinstance(guess, Shifted) or (isinstance(guess, Solution) and guess.problem is self.problem)

    def solve_in_turn(
        self, steps: list[dict[Any, float]], parameters: Any, guess: Any, starts: Several, tolerance: float | None
    ) -> Solution:
        """Solve for the values of a continuation, and refine the last mesh if a tolerance is given."""

        def solve(values: dict[Any, float], near: Any, *, first: bool, last: bool) -> Solution:
            pairs = [*pairs_of(parameters, "parameters="), *values.items()]
            several, within = starts if first else None, tolerance if last else None
            return self.solve(pairs, near, several, within, goes_on=first)

        return by_continuation(steps, solve, guess)

    def solve(
        self, parameters: Any, guess: Any, starts: Several, tolerance: float | None, *, goes_on: bool = True
    ) -> Solution:
        """Solve from one or several guesses, and refine the mesh if a tolerance is given.

        If `goes_on`, a failure is followed by strategies that look for a solution in other ways.
        """
        trials = self._trials(parameters, guess, starts, tolerance, goes_on=goes_on)
        count = interval_count(trials.meshes)
        if count >= FINE and not trials.is_warm:
            solver, solution = self._on_fine_mesh(trials, goes_on=goes_on)
        else:
            solver, solution = self._run(trials, goes_on=goes_on)
        if not trials.is_known:
            solution = refined_if_far_off(solver, solution, refined=trials.refines)
        return solution if tolerance is None else refine(solver, solution, tolerance)

    # --- what a search begins with ----------------------------------------------------------------
    def _trials(
        self, parameters: Any, guess: Any, starts: Several, tolerance: float | None, *, goes_on: bool
    ) -> Trials:
        near = guess.solution if isinstance(guess, Shifted) else guess
        is_known = self.is_known(guess)
        first, *others = self._settings(near, starts, tolerance)
        solver, guesses = self._first(first, parameters, guess, starts)
        meshes = self._meshes(solver.setups, near)
        if not is_known:
            check_reach(solver, guesses)
        return Trials(
            solver,
            lambda: [self._first(settings, parameters, guess, starts) for settings in others],
            meshes,
            guesses,
            starts=starts if isinstance(starts, int) else None,
            are_given=guess is not None or isinstance(starts, list),
            is_warm=isinstance(near, Solution) and starts is None,
            refines=is_automatic(self.intervals) and not is_known,
            is_known=is_known,
            first_limit=BUDGETS.first if goes_on and not isinstance(guess, Shifted) else None,
            tolerance=tolerance,
        )

    def _first(
        self, settings: Settings, parameters: Any, guess: Any, starts: Several
    ) -> tuple[ProblemSolver, list[Guess]]:
        """Solver and first guesses."""
        near = guess.solution if isinstance(guess, Shifted) else guess
        setup = near.phases[0].program.setup if self.is_known(guess) and len(near.phases) == 1 else None
        solver = ProblemSolver(self.problem, settings, parameters, self.initial, self.best, setup)
        return solver, _guesses(solver, starts, guess)

    def _settings(self, near: Any, starts: Several, tolerance: float | None) -> list[Settings]:
        """Settings that are tried in turn: an open chain in its angles, and then in all coordinates."""
        settings = self.settings
        if tolerance is not None:
            settings = replace(settings, options=sharp_options(tolerance) | settings.options)
        if isinstance(near, Solution) and starts is None:
            return [replace(settings, angles=near.settings.angles)]
        if near is None and not isinstance(starts, list) and has_open_chains(self.problem):
            return [replace(settings, angles=True), settings]
        return [settings]

    def _meshes(self, setups: Sequence[PhaseSetup], near: Any) -> list[Mesh]:
        """Meshes of the phases to begin with: those of a solution that is the guess, if no number is given."""
        meshes = first_meshes(setups, self.intervals)
        known = near.meshes if is_automatic(self.intervals) and isinstance(near, Solution) else []
        fits = [len(mesh.segments) for mesh in meshes] == [len(mesh.segments) for mesh in known]
        return list(known) if fits else meshes

    # --- the search -------------------------------------------------------------------------------
    def _on_fine_mesh(self, trials: Trials, *, goes_on: bool) -> tuple[ProblemSolver, Solution]:
        """Solver and solution on a fine mesh, from that on a coarse one; a search on the fine one if that fails."""
        coarse = [mesh.resized(INTERVALS / interval_count(trials.meshes)) for mesh in trials.meshes]
        try:
            solver, solution = self._run(trials.on(coarse), goes_on=goes_on)
            fine = solver.solve_further(solution, trials.meshes, limit=BUDGETS.fine)
            if fine is not None:
                fine.statistics = replace(fine.statistics, starts=solution.statistics.starts)
                return solver, fine
        except OptimizationError as error:
            if error.conflict:
                raise
        self.best.new_stage()
        return self._run(trials, goes_on=goes_on)

    def _run(self, trials: Trials, *, goes_on: bool) -> tuple[ProblemSolver, Solution]:
        """Give each strategy its turn, and return solver and best solution."""
        self.best.new_stage()
        at_once = self._all_at_once(trials) if self.executor is not None else set()
        for strategy in self.strategies:
            if strategy.name in at_once:
                continue
            if strategy.goes_on and not (goes_on and may_go_on(trials)):
                continue
            if strategy.applies(trials):
                self._followed(strategy.proposals(trials), trials, strategy)
        best = trials.best
        if best is not None:
            outcome, solution, _ = best
        elif trials.solved:
            outcome = trials.solved[0]
            refuse_branch_jump(outcome.last)
            solution = outcome.last
        else:
            raise self._failure(trials, goes_on=goes_on)
        later = {strategy.name for strategy in self.strategies if strategy.goes_on}
        return outcome.solver, _with_statistics(trials, outcome, solution, later)

    def _all_at_once(self, trials: Trials) -> set[str]:
        """Try what strategies propose that does not depend on outcomes, on the executor; their names."""
        applying = [strategy for strategy in self.strategies if strategy.applies(trials)]
        proposed = [(strategy.name, proposal) for strategy in applying for proposal in strategy.independent(trials)]
        if proposed:
            trials.outcomes += self._side_by_side(proposed, trials)
        return {name for name, _ in proposed}

    def _followed(
        self, proposals: Generator[Proposal, Outcome, Found], trials: Trials, strategy: Strategy | None = None
    ) -> Found | None:
        """Try proposals one after another, each of which sees how the one before ended; return their result."""
        if not isinstance(proposals, Generator):
            raise ModelError(f"optimize: proposals() of {strategy!r} must yield Proposals, got {proposals!r}")
        try:
            proposal = next(proposals)
            while True:
                if not isinstance(proposal, Proposal):
                    raise ModelError(f"optimize: proposals() of {strategy!r} must yield Proposals, got {proposal!r}")
                outcome = tried(proposal, trials, proposal.solver or trials.solver, strategy.name if strategy else "")
                trials.outcomes.append(outcome)
                if strategy is not None and strategy.ends_at_solution and trials.best is not None:
                    proposals.close()
                    return None
                proposal = proposals.send(outcome)
        except StopIteration as stop:
            result: Found = stop.value
            return result

    def _side_by_side(self, proposals: list[tuple[str, Proposal]], trials: Trials) -> list[Outcome]:
        """Outcomes of proposals; the runs of the solver take place on an executor, what leads to them in threads."""
        assert self.executor is not None
        elsewhere = Elsewhere(self.executor)

        def outcome(proposed: tuple[str, Proposal]) -> Outcome:
            name, proposal = proposed
            try:
                return symbolic(tried)(proposal, trials, trials.solver.on(elsewhere), name)
            except KeyboardInterrupt:  # it may reach a worker first
                elsewhere.give_up()
                raise

        with numeric_work(), ThreadPoolExecutor(len(proposals)) as threads:
            try:
                return list(threads.map(outcome, proposals))
            except KeyboardInterrupt:
                elsewhere.give_up()
                raise

    def _failure(self, trials: Trials, *, goes_on: bool) -> OptimizationError:
        """The error for a problem that was not solved."""
        failures = trials.failures
        if not failures:
            names = ", ".join(strategy.name for strategy in self.strategies)
            text = f"nothing was tried: no strategy of search= proposes a solve ({names})"
            return OptimizationError(text, partial=None)
        if not (goes_on and may_go_on(trials)):
            return failures[-1] if trials.starts is not None or trials.are_given else failures[0]
        widened = None
        if trials.without_limits is not None:
            outcome = self._followed(least_limits(trials, trials.without_limits), trials)
            widened = None if outcome is None else (outcome.last, outcome.slacks)
        return not_found(failures[0], [o.proposal.description for o in trials.outcomes], widened, MET)


def tried(proposal: Proposal, trials: Trials, solver: ProblemSolver, strategy: str) -> Outcome:
    """Solve what is proposed, and return how it ended."""
    meshes = trials.meshes if proposal.meshes is None else proposal.meshes
    variant, end = proposal.variant, None
    if proposal.meshes is not None or proposal.settles or not proposal.is_itself:
        solver.best.new_stage()
    if isinstance(variant, Violations):
        weights = variant.nearness, variant.cost
        last, slacks, succeeded = solver.least_violation(
            meshes,
            proposal.guess,
            proposal.iterations or BUDGETS.violation,
            *weights,
            limits_alone=variant.limits_alone,
        )
        end = last if succeeded else OptimizationError("the least violation was not found", partial=last)
        return Outcome(proposal, solver, end, slacks, strategy)
    how: dict[str, Any] = {"variant": variant, "warm": proposal.is_warm, "limit": proposal.iterations}
    try:
        end = solver.solve(meshes, proposal.guess, ceiling=proposal.ceiling, **how)
    except OptimizationError as error:
        end = error
    return Outcome(proposal, solver, end, {}, strategy)


def may_go_on(trials: Trials) -> bool:
    """Return True if a failure leaves open whether the problem has a solution, and the user did not ask to stop.

    With a kink in the cost, or a cost without a lower bound, a solver with derivatives would fail again from any guess.
    """
    if trials.solved or not trials.failures:
        return True
    error, options = trials.failures[0], trials.solver.settings.options
    status = error.partial.statistics.status
    is_limited = status == "Maximum_Iterations_Exceeded" and "ipopt.max_iter" in options
    if status not in RESUMABLE or is_limited or is_unbounded(error.partial):
        return False
    return trials.first_limit is not None and not kinks_in_costs(trials.solver.problem)


def _with_statistics(trials: Trials, outcome: Outcome, solution: Solution, later: set[str]) -> Solution:
    """The solution with its starts, and with stages if variants or strategies after a failure took part."""
    starts = trials.as_starts
    own = solution.statistics = replace(solution.statistics, starts=starts if len(starts) > 1 else [])
    if all(other.proposal.is_itself and other.strategy not in later for other in trials.outcomes):
        return solution
    others = [other.last.statistics for other in trials.outcomes if other is not outcome]
    solution.statistics = replace(
        own,
        iterations=own.iterations + sum(statistics.iterations for statistics in others),
        seconds=own.seconds + sum(statistics.seconds for statistics in others),
        stages=[*own.stages, *map(_stage, trials.outcomes)],
    )
    return solution


def _stage(outcome: Outcome) -> Attempt:
    """The entry of an outcome in the statistics, which says if it is a solution, but no motion."""
    jump = branch_jump(outcome.last) if outcome.is_solution else None
    attempt = outcome.attempt
    return attempt if jump is None else replace(attempt, description=f"{attempt.description}, {jump.title}")


def _guesses(solver: ProblemSolver, starts: Several, guess: Any) -> list[Guess]:
    """The guesses that are given, or the usual ones."""
    if isinstance(starts, list):
        return [usual_guesses(solver)[0] if one is None else read_guess(solver, one) for one in starts]
    first = usual_guesses(solver) if guess is None else [read_guess(solver, guess)]
    return first[:starts]


def usual_guesses(solver: ProblemSolver) -> list[Guess]:
    """Return the usual guess; for a chain in angles, which is solved twice in less time than in all coordinates, two.

    Of 28 made-up chains of two to four links with a motor in every joint, on meshes that hold, the first of the two led
    to the lower cost in 8, the second one in 5.
    """
    starts = Starts(solver)
    usual = starts.usual()
    is_chain = solver.setups[0].scheme.eom.is_chain
    return [usual, starts.at_rest()] if is_chain and not starts.stays_at_rest() else [usual]
