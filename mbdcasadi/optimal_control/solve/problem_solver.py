"""One problem, one mesh, one solve: program, guess, run of a solver, solution."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...errors import OptimizationError
from ...results.state import State
from ..motion.guess import Guess
from ..motion.limit_excess import LIMIT_TOLERANCE, ROUNDS, largest_share, points_to_hold
from ..problem import OptimalControlProblem
from ..program.collocation_program import Held
from ..program.elastic_program import ElasticProgram
from ..program.limit_sides import LimitSides, Slacks
from ..program.problem_setup import ProblemSetup
from ..program.setup import PhaseSetup, Settings
from ..program.statistics import Answer, SolveStatistics
from ..program.variant import ITSELF, Variant
from ..solution import Solution
from ..transcription.mesh import Mesh
from .best_so_far import BestSoFar
from .expressions import kinks_in_costs
from .failure import explain_failure
from .rounded_program import RoundedProgram, reaches_kinks
from .solvers.base import Beginning, Elsewhere, NLPSolver, Result
from .solvers.ipopt import Ipopt

#: Miss of an implied condition from which a solution is refused, as a share of the window that is left to it.
BRANCH_TOLERANCE = 1e-3
#: Largest number of iterations if a cost has a kink: at one that matters the solver does not converge.
KINKED_ITERATIONS = 200
#: Message of the solver where no small step comes nearer to the demands, which is no accident of the iterations.
INFEASIBLE = "Infeasible_Problem_Detected"
#: Iterations after which a solve may have stopped at a kink of the equations, and messages of the solver then; and
#: iterations with sharp kinks from a solution with rounded ones.
SHARP_ITERATIONS, PAST_ITERATIONS = 60, 30
AT_KINKS = (
    "Maximum_Iterations_Exceeded",
    "Search_Direction_Becomes_Too_Small",
    "Restoration_Failed",
    "Error_In_Step_Computation",
    INFEASIBLE,
)
#: Largest scaled violation of a guess with which a solver is started as warm.
WARM_VIOLATION = 1e-2


class ProblemSolver(ProblemSetup):
    """A problem with its parameters and its start, ready to be solved on meshes.

    Arguments are those of :class:`ProblemSetup`; `best` records the solutions.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: Settings,
        parameters: Any = None,
        initial: Any = None,
        best: BestSoFar | None = None,
        near: PhaseSetup | None = None,
    ):
        self._nlp_solver: NLPSolver = Ipopt(settings.options, settings.progress)
        self.best = BestSoFar() if best is None else best
        super().__init__(problem, settings, parameters, initial, near)

    def on(self, elsewhere: Elsewhere) -> ProblemSolver:
        """Return the same solver with its runs on an executor; several of these work beside each other."""
        other = copy(self)
        other._nlp_solver = Ipopt(self.settings.options, self.settings.progress, elsewhere)
        return other

    def with_raised_cost(self, solution: Solution) -> tuple[ProblemSolver, float]:
        """Return the solver with the cost scaled by its size in a solution, if that is far smaller than typical.

        It finds the cost to its tolerance as a share of that size; the typical one may be far larger, as that of the
        work of a motor whose voltage stays far below its limits. The second result is the factor by which it is raised.
        """
        size = solution.cost_size
        factor = self._nlp_solver.cost_factor(solution.program.cost_scale / size) if size > 0 else 1.0
        other = self
        if factor != 1.0:
            other = copy(self)
            other._nlp_solver = self._nlp_solver.with_cost_factor(factor)
        return other, factor

    # --- one mesh -------------------------------------------------------------------------
    def solve(
        self,
        meshes: Sequence[Mesh],
        guess: Guess,
        *,
        variant: Variant = ITSELF,
        warm: bool = False,
        limit: int | None = None,
        ceiling: float = np.inf,
        limit_tolerance: float = LIMIT_TOLERANCE,
    ) -> Solution:
        """Solve on a mesh, and again if the solution passes path limits between the points at which they are held.

        Parameters
        ----------
        meshes : sequence of Mesh
            By phase.
        guess : Guess
            If it has an iterate, limits are enforced where the program of that one does so, too.
        variant : Variant
            Variant of the program; without its limits no point is added.
        warm : bool
            True if the guess is a solution of nearly the same problem.
        limit : int, optional
            Largest number of iterations.
        ceiling : float
            Cost above which the solve is given up after a while.
        limit_tolerance : float
            Share of its size by which a path limit may be passed between the points at which it is held.

        Raises
        ------
        OptimizationError
            If the solver does not succeed, or the solution lies on another branch of the linkage.
        Interrupted
            After Ctrl-C.
        """
        held = () if guess.iterate is None else guess.iterate.program.held
        if kinks_in_costs(self.problem):
            limit = KINKED_ITERATIONS if limit is None else min(limit, KINKED_ITERATIONS)
        run = partial(self._solve, variant=variant, ceiling=ceiling)
        solution = run(meshes, guess, held=held, warm=warm, limit=limit)
        solution = self._past_pinned(solution, partial(run, held=held, warm=True, limit=limit))
        if not variant.limits:
            return solution
        passed = largest_share(solution)
        for _ in range(ROUNDS):
            more = points_to_hold(solution, limit_tolerance) if passed > limit_tolerance else set()
            if not more:
                break
            held = tuple(sorted({*held, *more}))
            near = solution.as_guess(self.problem)
            found = _further(solution, partial(run, solution.meshes, near, held=held, warm=True))
            share = np.inf if found is None else largest_share(found)
            if found is None or share > 0.8 * passed:  # it is passed by the error of the mesh: more points do not help
                break
            solution, passed = found, share
        return solution

    def _past_pinned(self, solution: Solution, run: Callable[..., Solution]) -> Solution:
        """The solution past mesh points that keep their times, if these stop its waypoints or ends and it costs less.

        On equal intervals, since those beside such a point have shrunk to almost nothing.
        """
        stopped = [np.any(part.stopped) for part in solution.phases]
        if not any(stopped):
            return solution
        meshes = [mesh.resized(1.0) if at else mesh for mesh, at in zip(solution.meshes, stopped, strict=True)]
        past = _further(solution, partial(run, meshes, self.motion_of(solution)))
        return solution if past is None or past.cost >= solution.cost else past

    def _run(self, begin: Beginning, warmth: str, limit: int | None) -> Result:
        """Run the solver; with rounded kinks if it does not get past one it reaches, and else with all iterations."""
        run = partial(self._nlp_solver.run, begin, begin.bounds, warmth, begin.iterate)
        most = SHARP_ITERATIONS if limit is None else min(limit, SHARP_ITERATIONS)
        if not begin.program.nlp.is_kinked or kinks_in_costs(self.problem) or self._has_own_limit:
            return run(limit)
        sharp = run(most)
        if sharp.interrupted or sharp.statistics.status not in AT_KINKS:
            return sharp
        again = begin.again()
        rounded = None
        if any(reaches_kinks(begin.program.nlp, x, begin.data) for x in (begin.x, sharp.answer["x"])):
            rounded = RoundedProgram(begin.program, begin.x, begin.data).solve(self._nlp_solver, again)
        if rounded is None:
            if most == limit or sharp.statistics.status == INFEASIBLE:
                return sharp
            return self._nlp_solver.run(begin.again(), begin.bounds, warmth, begin.iterate, limit).after(sharp)
        result, width = rounded
        result = replace(result, statistics=replace(result.statistics, rounding=width, at_saddle=False)).after(sharp)
        if result.interrupted:
            return result
        exact = self._nlp_solver.run(begin.again(x=result.answer["x"]), begin.bounds, "warm", limit=PAST_ITERATIONS)
        return exact.after(result) if exact.succeeded else replace(result.after(exact), interrupted=exact.interrupted)

    @property
    def _has_own_limit(self) -> bool:
        """True if the user limits the iterations."""
        return f"{self._nlp_solver.name}.max_iter" in self.settings.options

    def solve_further(
        self,
        solution: Solution,
        meshes: Sequence[Mesh],
        *,
        limit: int | None = None,
        limit_tolerance: float = LIMIT_TOLERANCE,
    ) -> Solution | None:
        """Solve on other meshes, as a new stage, from a solution; None if that fails."""
        self.best.new_stage()
        guess = solution.as_guess(self.problem)
        return _further(
            solution, partial(self.solve, meshes, guess, warm=True, limit=limit, limit_tolerance=limit_tolerance)
        )

    def _solve(
        self,
        meshes: Sequence[Mesh],
        guess: Guess,
        *,
        variant: Variant,
        held: Held,
        warm: bool,
        limit: int | None = None,
        ceiling: float = np.inf,
    ) -> Solution:
        """Solve on a mesh; raises as :meth:`solve` does."""
        begin = self._beginning(meshes, guess, variant, held, ceiling)
        program, iterate = begin.program, begin.iterate
        warmth = ("hot" if iterate else "warm") if warm else "cold"
        x0 = np.clip(begin.x, begin.bounds.lower, begin.bounds.upper)
        if warmth == "warm" and program.violation(program.rows_at(x0, begin.data)) > WARM_VIOLATION:
            warmth = "cold"
        result = self._run(begin, warmth, limit)
        solution, status = self._solution(begin, result), result.statistics.status
        error = self._other_branch(solution) if result.succeeded else explain_failure(solution, status)
        if error is None and variant.is_itself:
            self.best.add(solution)
        else:
            self.best.iterate = solution
        if result.interrupted:
            raise self.best.interrupted()
        if error is not None:
            raise error
        return solution

    # --- demands that yield -----------------------------------------------------------------
    def least_violation(
        self,
        meshes: Sequence[Mesh],
        guess: Guess,
        limit: int,
        nearness: float,
        cost_weight: float = 0.0,
        *,
        limits_alone: bool = False,
    ) -> tuple[Solution, Slacks, bool]:
        """Look for the motion that violates limits and conditions least, or limits alone and no condition.

        The squared distance from the guess, which singles out one of many such motions, has the weight `nearness`, and
        the cost of the problem itself a `cost_weight`. Returned are the last iterate, scaled amounts by which demands
        are violated, by label, and whether the solver succeeded.
        """
        begin = self._beginning(meshes, guess)
        elastic = ElasticProgram(begin.program, begin.bounds, nearness, cost_weight, limits_alone=limits_alone)
        result, slacks = self._nlp_solver.least_violation(begin, elastic, limit)
        return self._kept(begin, result), slacks, result.succeeded

    def violation(self, meshes: Sequence[Mesh], guess: Guess) -> float:
        """Sum of the scaled amounts by which a guess violates limits and conditions, the largest one of each label."""
        begin = self._beginning(meshes, guess)
        sides, rows = LimitSides(begin.program, conditions=True), begin.program.rows_at(begin.x, begin.data)
        return sum(sides.excess(begin.bounds, begin.x, rows).values())

    def _kept(self, begin: Beginning, result: Result) -> Solution:
        """The last iterate of a solve whose result is no solution; it is kept for the user who stops."""
        self.best.iterate = solution = self._solution(begin, result)
        if result.interrupted:
            raise self.best.interrupted()
        return solution

    # --- before and after a run -------------------------------------------------------------
    def motion_of(self, solution: Solution) -> Guess:
        """Return the motion of a solution as a guess, without multipliers, which belong to other limits."""
        return replace(solution.as_guess(self.problem), iterate=None)

    def unsolved(self, meshes: Sequence[Mesh], guess: Guess) -> Solution:
        """Return the motion of a guess on meshes as it is, in the form of a solution."""
        begin = self._beginning(meshes, guess)
        x, rows = begin.x, begin.program.rows_at(begin.x, begin.data)
        answer = {"x": x, "f": np.full(1, np.nan), "lam_x": 0 * x, "lam_g": 0 * rows, "g": rows}
        statistics = SolveStatistics(0, "not solved", 0.0, 0.0, x.size, rows.size)
        return self._solution(begin, Result(answer, statistics, succeeded=False, interrupted=False))

    def beginning_at(self, solution: Solution, variant: Variant = ITSELF) -> Beginning:
        """Return the start of a solve at a solution, with its multipliers."""
        return self._beginning(solution.meshes, solution.as_guess(self.problem), variant, solution.program.held)

    def _beginning(
        self,
        meshes: Sequence[Mesh],
        guess: Guess,
        variant: Variant = ITSELF,
        held: Held = (),
        ceiling: float = np.inf,
    ) -> Beginning:
        began = clock.perf_counter()
        program = self.transcribe(meshes, held)
        iterate = guess.iterate if guess.iterate is not None and guess.iterate.belongs_to(program, meshes) else None
        x = iterate.x if iterate else guess.variables(program, meshes)
        bounds = variant.bounds(program, self.start, meshes, guess.segment_times, x)
        parameters = [setup.numeric.p for setup in self.setups]
        data = program.data(parameters, meshes, guess.segment_times, self.settings.known)
        if program.has_integrals and not iterate:
            x = program.with_integrals(x, program.rows_at(np.clip(x, bounds.lower, bounds.upper), data))
        return Beginning(program, meshes, guess, iterate, x, data, bounds, began, ceiling / program.cost_scale)

    def _solution(self, begin: Beginning, result: Result) -> Solution:
        x, f, *rest = (result.answer[name] for name in ("x", "f", "lam_x", "lam_g", "g"))
        return Solution(
            self.problem,
            begin.program,
            self.settings,
            self.initial,
            [setup.numeric.p for setup in self.setups],
            begin.meshes,
            begin.guess.segment_times,
            x * begin.program.scale,
            float(f[0]) * begin.program.cost_scale,
            result.statistics,
            Answer(*rest),
        )

    def _other_branch(self, solution: Solution) -> OptimizationError | None:
        """The error for an optimum on another branch than the conditions ask for, if it is one."""
        for setup, part in zip(self.setups, solution.phases, strict=True):
            for condition, window in setup.ends.implied.items():
                # a condition at the end may come from a state, and is then none that the user stated
                start = self.initial if setup is self.setups[0] else setup.phase.initial
                at_start = not isinstance(start, State) and condition in start
                place = part.trajectory.initial if at_start else part.trajectory.final
                amount = float(place[condition.expression])
                if abs(amount) > BRANCH_TOLERANCE * window:
                    return OptimizationError(
                        f"the solution misses the condition {condition.label} by {amount:.3g}: it lies on another "
                        "branch of the linkage; another guess, or starts=, may find the right one",
                        partial=solution,
                        time=place.t,
                    )
        return None


def _further(solution: Solution, solve: Callable[[], Solution]) -> Solution | None:
    """What a further solve finds, with the statistics of both; None if it fails."""
    try:
        found = solve()
    except OptimizationError:
        return None
    found.statistics = found.statistics.after(solution.statistics)
    return found
