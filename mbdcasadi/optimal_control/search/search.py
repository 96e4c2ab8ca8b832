"""Search for a solution: the attempts that are made, in their order.

Before them it is looked whether the linkage reaches the waypoints and the end at all, see :mod:`reach`.

1. The problem is solved from every guess, see :func:`best_of`: an open chain in its angles alone, in which fewer
   iterations are needed, from poses without speeds and then from a motion through them, or, if it has fewer inputs than
   angles, from motions that swing, see :func:`swings`, and in all coordinates if that fails; on a fine mesh from the
   solution on a coarse one, see :func:`solve_coarse_first`.
2. If no mesh was given, intervals that are too coarse are split before costs are compared, since a
   coarse mesh may promise a cost that no motion has: :func:`refine_if_coarse`. The best one of those that all stay
   coarse is refined once more; if that does not help, or all are no motions, the problem is solved slowly first, and
   at last with limits that close in from a solution without: :mod:`slow_first`.
3. If all of this fails: with mesh points where something jumps in time, if other times are free; without limits, with
   limits that close in, from detours, and with least violation, see :mod:`closing_limits`; for a fine mesh on a coarse
   one first.
4. A saddle is left along the direction in which the cost falls: :mod:`saddle`; so is the neighbourhood of one in which
   the first solve got stuck.
5. A solution that jumps to another branch of the linkage is solved again from other guesses, see :func:`as_motion`.
   With a tolerance the mesh is refined then, see :func:`refine`; without one it gets the mesh points of step 3.

Each single solve adds points at which path limits are held, see :meth:`ProblemSolver.solve`, and rounds kinks of the
equations that it does not get past, see :mod:`rounded_program`. In a continuation,
step 3 is for the first values alone: later failures insert values in between, see :mod:`parameter_continuation`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ...arguments.values import pairs_of
from ...errors import OptimizationError
from ...numerics.lazy import cached_property
from ..measures.time_jumps import meshes_at_jumps
from ..motion.guess import Guess
from ..problem import OptimalControlProblem
from ..program.limit_sides import LimitSides
from ..program.setup import PhaseSetup, Settings, has_open_chains
from ..solution import Shifted, Solution
from ..solve.best_so_far import BestSoFar
from ..solve.problem_solver import ProblemSolver
from ..solve.solvers.ipopt import sharp_options
from ..transcription.mesh import Mesh
from .closing_limits import LimitSearch, is_limited, may_go_on
from .coarse_first import coarse_meshes
from .coarse_mesh import is_lost, refine_if_coarse
from .detours import random_detour
from .first_mesh import first_meshes, is_automatic
from .multistart import at_rest, best_of, guesses
from .parameter_continuation import by_continuation
from .reach import check_reach
from .refine import refine
from .saddle import leave_saddle, solve_past_saddle
from .second_try import as_motion
from .slow_first import refine_or_begin_anew

#: Iterations of a first solve, if a search follows should it fail: most programs take far fewer, and one that takes
#: more is often solved sooner from elsewhere.
FIRST_ITERATIONS = 300
#: Iterations of another start of an open chain once one has succeeded; those that take more seldom end at lower costs.
FURTHER_ITERATIONS = 150
#: Random detours from which a solution that jumps is solved again.
DETOURS = 3


@dataclass(frozen=True)
class Search:
    """Solves of one problem with the same settings, at any parameter values."""

    problem: OptimalControlProblem
    intervals: Any
    initial: Any
    settings: Settings
    best: BestSoFar
    executor: Executor | None = None

    @property
    def _is_automatic(self) -> bool:
        return is_automatic(self.intervals)

    def is_known(self, guess: Any) -> bool:
        """Return True if a guess is a solution of the same problem, whose mesh is not checked anew."""
        return isinstance(guess, Shifted) or (isinstance(guess, Solution) and guess.problem is self.problem)

    def _meshes(self, setups: Sequence[PhaseSetup], near: Any) -> list[Mesh]:
        """Meshes of the phases to begin with: those of a solution that is the guess, if no number is given."""
        meshes = first_meshes(setups, self.intervals)
        known = near.meshes if self._is_automatic and isinstance(near, Solution) else []
        fits = [len(mesh.segments) for mesh in meshes] == [len(mesh.segments) for mesh in known]
        return list(known) if fits else meshes

    def solve(
        self, parameters: Any, guess: Any, starts: Any, tolerance: float | None, *, goes_on: bool = True
    ) -> Solution:
        """Solve from one or several guesses, and refine the mesh if a tolerance is given.

        If `goes_on`, a failure is followed by a search with limits that close in.
        """
        near = guess.solution if isinstance(guess, Shifted) else guess
        warm = isinstance(near, Solution) and starts is None
        checked = not self.is_known(guess)
        automatic = self._is_automatic and checked
        goes_on = goes_on and not isinstance(guess, Shifted)
        limit = FIRST_ITERATIONS if goes_on else None
        failed: list[tuple[_Attempt, OptimizationError]] = []
        for settings in self._settings(near, starts, tolerance):
            attempt = self._attempt(settings, parameters, guess, starts, refined=automatic)
            try:
                solution = attempt.solve(warm=warm, executor=None if starts is None else self.executor, limit=limit)
                break
            except OptimizationError as error:
                failed.append((attempt, error))
        else:
            attempt, failure = failed[0]
            options = attempt.solver.settings.options
            found = attempt.on_jumps(failure.partial) if goes_on and not is_limited(failure, options) else None
            if found is None and not (goes_on and may_go_on(failure, options)):
                raise failure
            solution = attempt.go_on(failure) if found is None else found
        if checked:
            solution = attempt.as_motion(attempt.past_saddle(solution))
        if tolerance is not None:
            return refine(attempt.solver, solution, tolerance)
        past = attempt.on_jumps(solution)
        return solution if past is None else past

    def solve_in_turn(
        self, steps: list[dict[Any, float]], parameters: Any, guess: Any, starts: Any, tolerance: float | None
    ) -> Solution:
        """Solve for the values of a continuation, and refine the last mesh if a tolerance is given."""

        def solve(values: dict[Any, float], near: Any, *, first: bool, last: bool) -> Solution:
            pairs = [*pairs_of(parameters, "parameters="), *values.items()]
            several, within = starts if first else None, tolerance if last else None
            return self.solve(pairs, near, several, within, goes_on=first)

        return by_continuation(steps, solve, guess)

    def _settings(self, near: Any, starts: Any, tolerance: float | None) -> list[Settings]:
        """Settings that are tried in turn: an open chain in its angles, and then in all coordinates."""
        settings = self.settings
        if tolerance is not None:
            settings = replace(settings, options=sharp_options(tolerance) | settings.options)
        if isinstance(near, Solution) and starts is None:
            return [replace(settings, angles=near.settings.angles)]
        if near is None and not isinstance(starts, Iterable) and has_open_chains(self.problem):
            return [replace(settings, angles=True), settings]
        return [settings]

    def _attempt(self, settings: Settings, parameters: Any, guess: Any, starts: Any, *, refined: bool) -> _Attempt:
        near = guess.solution if isinstance(guess, Shifted) else guess
        setup = near.phases[0].program.setup if self.is_known(guess) and len(near.phases) == 1 else None
        solver = ProblemSolver(self.problem, settings, parameters, self.initial, self.best, setup)
        meshes = self._meshes(solver.setups, near)
        candidates = guesses(solver, starts, guess)
        if not self.is_known(guess):
            check_reach(solver, candidates)
        further = FURTHER_ITERATIONS if starts is None and guess is None else None
        return _Attempt(solver, meshes, candidates, refined, further)


@dataclass
class _Attempt:
    """One choice of coordinates: solver, meshes and guesses, and whether coarse meshes are refined.

    Once one guess has led to a solution, the others take at most `further` iterations.
    """

    solver: ProblemSolver
    meshes: list[Mesh]
    candidates: list[Guess]
    refined: bool
    further: int | None

    def solve(self, *, warm: bool, executor: Executor | None, limit: int | None) -> Solution:
        """Return the best solution of all guesses; each solve takes at most `limit` iterations."""
        settle = partial(refine_if_coarse, self.solver) if self.refined else None
        more: dict[str, Any] = {"executor": executor, "settle": settle, "limit": limit, "further": self.further}
        best = best_of(self.solver, self.meshes, self.candidates, warm=warm, **more)
        return self._on_fine_mesh(best) if self.refined else best

    def on_jumps(self, near: Solution) -> Solution | None:
        """A solution with mesh points that stay at times of jumps, if other times are free; None if there is none.

        Without them the cost jumps with the duration, each time a stage passes such a time: a solve fails, or ends in
        the best duration between two of these.
        """
        meshes = meshes_at_jumps(near, np.inf) if self.solver.problem.has_free_times else None
        if meshes is None:
            return None
        found = self.solver.solve_further(near, meshes, self.solver.motion_of(near), FIRST_ITERATIONS)
        return None if found is None else self._refined(found)

    def go_on(self, failure: OptimizationError) -> Solution:
        """Return a solution past a saddle, or one found by limits that close in, or raise the failure with the result.

        A saddle is looked for where the first solve got stuck while it met all demands.
        """
        past = None if failure.largest_violations else solve_past_saddle(self.solver, failure.partial)
        if past is not None:
            return self._refined(past)
        coarse = coarse_meshes(self.meshes)
        fine = None if coarse is None else self._from_coarse(coarse, failure)
        if fine is not None:
            return fine
        return self._refined(self._searched(self.meshes, failure))

    def _refined(self, solution: Solution) -> Solution:
        """The solution on a mesh that is as fine as the motion needs, if no mesh was asked for."""
        if not self.refined:
            return solution
        return self._on_fine_mesh(solution if is_lost(solution) else refine_if_coarse(self.solver, solution)[0])

    def _on_fine_mesh(self, solution: Solution) -> Solution:
        """The solution on a finer mesh, or another one if that does not hold."""
        free = partial(self._without_limits, solution)
        return refine_or_begin_anew(self.solver, solution, self.meshes, self._candidates_and_detours, free)

    def _without_limits(self, limited: Solution) -> Solution | None:
        """The solution of the problem without its limits; None if it has none, or that is not found either."""
        if self.solver.is_unlimited or not LimitSides(limited.program).sides:
            return None
        attempt = replace(self, solver=self.solver.unlimited())
        try:
            return attempt.solve(warm=False, executor=None, limit=FIRST_ITERATIONS)
        except OptimizationError:
            return None

    def _candidates_and_detours(self) -> list[Guess]:
        return [*self.candidates, *(self._detour() for _ in range(DETOURS))]

    def _from_coarse(self, coarse: list[Mesh], failure: OptimizationError) -> Solution | None:
        """The solution on a fine mesh, from one that a search on a coarse mesh found; None if there is none."""
        try:
            found = self._searched(coarse, failure)
        except OptimizationError:  # limits that are just met may not be met on a coarse mesh
            return None
        settled, _ = refine_if_coarse(self.solver, found)
        return self.solver.solve_further(settled, self.meshes)

    def _searched(self, meshes: list[Mesh], failure: OptimizationError) -> Solution:
        """A solution found by the stages of a search on a mesh; raises the failure with the result of the search."""
        second = at_rest(self.solver)
        search = LimitSearch(self.solver, meshes, self.candidates[0], second, self._detour, refined=self.refined)
        return search.run(failure)

    def past_saddle(self, solution: Solution) -> Solution:
        """Return a solution of lower cost if this one is a saddle, on a mesh that is as fine as the motion needs."""
        lower = leave_saddle(self.solver, solution)
        return lower if lower is solution else self._refined(lower)

    def as_motion(self, solution: Solution) -> Solution:
        """Return a solution that is a motion, solved again if this one jumps to another branch of the linkage."""
        makes: list[Callable[[], Guess]] = [partial(at_rest, self.solver)]
        makes += [self._detour] * DETOURS
        guesses = [*makes, lambda: self.candidates[0]]
        return as_motion(self.solver, solution, guesses, refined=self.refined)

    @cached_property
    def _detour(self) -> Callable[[], Guess]:
        """Function that makes guesses with random detours."""
        return partial(random_detour, self.solver, np.random.default_rng(0))
