"""Fine meshes: the problem is solved on a coarse mesh first, from whose solution few iterations are left."""

from __future__ import annotations

from collections.abc import Sequence

from ...errors import OptimizationError
from ..measures.local_error import COARSE_ERROR, Coarseness
from ..motion.guess import Guess
from ..solution import Solution
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh, interval_count

#: Number of intervals of the coarse mesh, and number from which a mesh is fine.
COARSE, FINE = 40, 160
#: Largest number of iterations on the coarse mesh, on the fine one from its solution, and on the fine one from the
#: guess if a search on the coarse mesh follows.
COARSE_ITERATIONS, FINE_ITERATIONS, DIRECT_ITERATIONS = 100, 30, 100


def coarse_meshes(meshes: Sequence[Mesh]) -> list[Mesh] | None:
    """Return coarse meshes on which a problem is solved first; None if the meshes are not fine."""
    count = interval_count(meshes)
    return [mesh.resized(COARSE / count) for mesh in meshes] if count >= FINE else None


def solve_coarse_first(
    solver: ProblemSolver, meshes: Sequence[Mesh], guess: Guess, *, limit: int | None = None
) -> Solution:
    """Solve from a guess; on a fine mesh from the solution on a coarse one, if that is a motion and few iterations do.

    At most `limit` iterations on a mesh; if it is given, a search follows a failure. Raises
    :class:`OptimizationError` as :meth:`ProblemSolver.solve` does.
    """
    coarse = coarse_meshes(meshes)
    if coarse is None or guess.iterate is not None:
        return solver.solve(meshes, guess, limit=limit)
    try:
        first = solver.solve(coarse, guess, limit=COARSE_ITERATIONS)
        holds = Coarseness(first).largest <= COARSE_ERROR
        fine = solver.solve_further(first, meshes, limit=FINE_ITERATIONS) if holds else None
    except OptimizationError as error:
        first, fine = error.partial, None
    if fine is None:
        solver.best.new_stage()
        fine = solver.solve(meshes, guess, limit=None if limit is None else min(limit, DIRECT_ITERATIONS))
        fine.statistics = fine.statistics.after(first.statistics)
    return fine
