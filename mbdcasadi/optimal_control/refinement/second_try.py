"""Solutions that are no motions, solved again: on a finer mesh from where they are, and then from other guesses."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..checks.branch import branch_jump, refuse_branch_jump
from ..checks.failure import OptimizationError
from ..nlp.statistics import Stage
from .local_error import coarseness
from .refine import refine_if_coarse

if TYPE_CHECKING:
    from ..guess.guess import Guess
    from ..nlp.solver import Solver
    from ..solution import Solution

#: Local error of an interval, in rad or sizes of the mechanism, velocities times the duration, from which a solution is
#: none, whatever mesh was asked for.
NO_MOTION = 0.3
#: Pieces into which intervals are split for another guess.
PIECES = 2
#: Largest number of iterations from another guess.
ITERATIONS = 300


def as_motion(solver: Solver, solution: Solution, guesses: Iterable[Callable[[], Guess]]) -> Solution:
    """Return a solution that is a motion: the same one, or one of another mesh or from another guess.

    Parameters
    ----------
    solver : Solver
        Problem that was solved.
    solution : Solution
        Solution that may jump to another branch of the linkage within an interval, or miss its next mesh point by far.
    guesses : iterable of callable
        Make guesses, which are tried in turn on a finer mesh if the solution still jumps on a refined one.

    Raises
    ------
    OptimizationError
        If all solutions jump to another branch.
    """
    if branch_jump(solution) is None and _largest_error(solution) <= NO_MOTION:
        return solution
    refined = refine_if_coarse(solver, solution)[0]
    stages = _stages_so_far(solution, refined)
    found = refined if branch_jump(refined) is None else _from_guesses(solver, solution, guesses, stages)
    if found is None:
        refuse_branch_jump(refined)
        raise AssertionError("a solution that jumps is refused")
    tried = stages[len(solution.statistics.stages) + 1 :]
    found.statistics = replace(
        found.statistics,
        iterations=solution.statistics.iterations + sum(stage.iterations for stage in tried),
        seconds=solution.statistics.seconds + sum(stage.seconds for stage in tried),
        starts=solution.statistics.starts,
        stages=stages,
    )
    return found


def _stages_so_far(solution: Solution, refined: Solution) -> list[Stage]:
    """Stages of a solution that is no motion, that solution itself, and its refinement if there was one."""
    jump, s, r = branch_jump(solution), solution.statistics, refined.statistics
    what = "mesh too coarse for the motion" if jump is None else f"jump to another branch at t = {jump.begin:.6g} s"
    stages = [*s.stages, Stage(what, s.iterations, s.status, s.seconds)]
    if refined is not solution:
        stages.append(Stage("refined mesh", r.iterations - s.iterations, r.status, r.seconds - s.seconds))
    return stages


def _from_guesses(
    solver: Solver, solution: Solution, guesses: Iterable[Callable[[], Guess]], stages: list[Stage]
) -> Solution | None:
    """The first solution without jumps from other guesses on a finer mesh; None if there is none."""
    meshes = [
        mesh.refined(np.full(mesh.count, PIECES), np.zeros(mesh.count, bool)) if mesh.count else mesh
        for mesh in solution.meshes
    ]
    for make in guesses:
        guess = make()
        solver.best.new_stage()
        failed = False
        try:
            found = refine_if_coarse(solver, solver.solve(meshes, guess, limit=ITERATIONS))[0]
        except OptimizationError as error:
            found, failed = error.partial, True
        s = found.statistics
        stages.append(Stage(f"finer mesh, {guess.description}", s.iterations, s.status, s.seconds))
        if not failed and branch_jump(found) is None:
            return found
    return None


def _largest_error(solution: Solution) -> float:
    return max((float(np.max(coarseness(part), initial=0.0)) for part in solution.phases), default=0.0)
