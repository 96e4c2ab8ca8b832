"""Second solves of solutions that are not motions: from other guesses if they jump, and on finer meshes."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace

import numpy as np

from ...errors import OptimizationError
from ..measures.branch import branch_jump, refuse_branch_jump
from ..measures.local_error import Coarseness, coarse_mesh
from ..motion.guess import Guess
from ..motion.phase_solution import PhaseSolution
from ..program.statistics import Attempt
from ..solution import Solution
from ..solve.problem_solver import ProblemSolver
from .coarse_mesh import refine_if_coarse

#: Step by which the end of an interval is moved onto the constraints, in rad or sizes of the mechanism, from which a
#: solution is not a motion, whatever mesh was asked for.
LARGEST_PROJECTION = 0.1
#: Error of an interval, as :func:`coarseness` has it, from which it is none either.
LARGEST_ERROR = 1.0
#: Pieces into which intervals are split for another guess.
PIECES = 2
#: Largest number of iterations from another guess.
ITERATIONS = 300


def as_motion(
    solver: ProblemSolver, solution: Solution, guesses: Iterable[Callable[[], Guess]], *, refined: bool
) -> Solution:
    """Return a solution that is a motion: the same one, or one of another mesh or from another guess.

    A solution may jump to another branch within an interval; guesses are then tried in turn on a finer mesh. Or an
    interval ends far off the constraints or the motion; then the mesh is refined, unless it is `refined` already as
    far as that leads. An :class:`OptimizationError` is raised if all solutions jump, or the mesh stays that coarse.
    """
    jump = branch_jump(solution)
    if (
        jump is None
        and _largest_projection(solution) <= LARGEST_PROJECTION
        and _FarOff(solution).largest <= LARGEST_ERROR
    ):
        return solution
    what = "mesh too coarse for the motion" if jump is None else f"jump to another branch at t = {jump.begin:.6g} s"
    attempts = [solution.as_attempt(what)]
    # on a finer mesh a jump seldom leads to a motion, and at great cost
    motion = _from_guesses(solver, solution, guesses, attempts) if jump is not None else None
    if motion is None:
        motion = solution if refined else _refined(solver, solution, attempts)
        refuse_branch_jump(motion)
        _refuse_far_off(motion)
    motion.statistics = motion.statistics.at_end_of(attempts, solution.statistics)
    return motion


def _refined(solver: ProblemSolver, solution: Solution, attempts: list[Attempt]) -> Solution:
    """The solution on a mesh that is refined where it is coarse; the same one if that does not succeed."""
    before, refined = solution.statistics, refine_if_coarse(solver, solution)[0]
    if refined is not solution:
        record = refined.as_attempt("refined mesh")
        further = record.iterations - before.iterations, record.seconds - before.seconds
        attempts.append(replace(record, iterations=further[0], seconds=further[1]))
    return refined


def _from_guesses(
    solver: ProblemSolver, solution: Solution, guesses: Iterable[Callable[[], Guess]], attempts: list[Attempt]
) -> Solution | None:
    """The first solution without jumps from other guesses on a finer mesh; None if there is none."""
    meshes = [mesh.split(PIECES) for mesh in solution.meshes]
    for make in guesses:
        guess = make()
        solver.best.new_stage()
        failed = False
        try:
            candidate = refine_if_coarse(solver, solver.solve(meshes, guess, limit=ITERATIONS))[0]
        except OptimizationError as error:
            candidate, failed = error.partial, True
        attempts.append(candidate.as_attempt(f"finer mesh, {guess.description}"))
        if not failed and branch_jump(candidate) is None:
            return candidate
    return None


def _largest_projection(solution: Solution) -> float:
    """Largest step onto the constraints in positions, in rad or sizes of the mechanism."""
    steps = [
        np.max(part.projection_steps[:, : part.program.scales.q.size] / part.program.scales.q, initial=0.0)
        for part in solution.phases
        if part.mesh.count
    ]
    return float(max(steps))


class _FarOff(Coarseness):
    """Errors by which intervals of closed loops end far from the next ones, perhaps on another branch."""

    def of(self, part: PhaseSolution) -> np.ndarray:
        """Errors of the intervals of a phase (N,)."""
        errors = super().of(part) if part.phase.equations.has_branches else np.zeros(part.mesh.count)
        # an interval that cannot be integrated again, because it is stiff, may be right
        return np.where(np.isfinite(errors), errors, 0.0)


def _refuse_far_off(solution: Solution) -> None:
    measure = _FarOff(solution)
    if measure.largest > LARGEST_ERROR:
        part, k = measure.worst
        text = coarse_mesh(part, measure.errors[part.program.number])
        raise OptimizationError(
            f"the solution is not a motion of the mechanism: {text}", partial=solution, time=float(part.mesh_times[k])
        )
