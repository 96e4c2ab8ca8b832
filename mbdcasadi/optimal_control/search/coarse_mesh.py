"""Meshes of which no tolerance is asked: refined if they are too coarse for the motion that was found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..measures.cost_error import FalseCost
from ..measures.local_error import COARSE_ERROR, Coarseness, ReplayErrors, StateCoarseness
from ..measures.measure import split
from ..measures.singularity import close_to_singular
from ..motion.limit_excess import LIMIT_TOLERANCE, passed_limits
from ..solution import Solution
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh, interval_count
from .budgets import BUDGETS

#: What is measured on such a mesh.
COARSE_MEASURES: tuple[type[Coarseness], ...] = (Coarseness, StateCoarseness, ReplayErrors, FalseCost)
#: Largest number of passes, and of intervals of a mesh that is halved.
COARSE_PASSES, HALVED_INTERVALS = 4, 200
#: Error after these passes up to which as many more are made.
NEAR_ERROR = 10 * COARSE_ERROR
#: Local error, in rad or sizes of the mechanism, velocities times the duration, from which a solution is not a motion.
LOST_ERROR = 3.0
#: Ratio of these errors, of a solution on a finer mesh and the one from which it came, from which it leads elsewhere.
ASTRAY = 2.0


def is_lost(solution: Solution) -> bool:
    """Return True if the mesh is so coarse that a solution is not a motion at all."""
    return Coarseness(solution).largest > LOST_ERROR


def is_coarse(solution: Solution) -> bool:
    """Return True if the mesh is too coarse for the motion, and one twice as fine is allowed."""
    return Coarseness(solution).largest > COARSE_ERROR and _can_halve(solution)


def refine_if_coarse(solver: ProblemSolver, solution: Solution) -> tuple[Solution, bool]:
    """Solve again with intervals split that are too coarse for the motion, or in which it passes a limit.

    A few times at most. If the largest error does not fall, since a fast motion moved on to the next coarse interval,
    or no motion is found on the finer mesh, all intervals are halved; unless free parameters lead to a singular pose
    there, which no mesh resolves.

    Returns
    -------
    Solution, bool
        The last one of the solutions whose errors falsify the cost least, and whether its mesh is fine enough.
    """
    measures, stalled = [measure(solution) for measure in COARSE_MEASURES], False
    error = max(measure.largest for measure in measures)
    best, least = solution, _falsifying_error(measures)
    for number in range(2 * COARSE_PASSES):
        if (number >= COARSE_PASSES and error > NEAR_ERROR) or (stalled and _tends_to_lock(measures[0])):
            break
        halves = stalled and _can_halve(solution)
        meshes = [mesh.split(2) for mesh in solution.meshes] if halves else _split_where_coarse(solution, measures)
        if interval_count(meshes) == interval_count(solution.meshes):
            break
        finer = solver.solve_further(solution, meshes, limit=BUDGETS.finer)
        if finer is None or _went_astray(finer, solution):
            if stalled or not _can_halve(solution):
                break
            stalled = True
            continue
        solution, measures, before = finer, [measure(finer) for measure in COARSE_MEASURES], error
        error = max(measure.largest for measure in measures)
        best, least = (best, least) if least < _falsifying_error(measures) else (finer, _falsifying_error(measures))
        stalled = not error < max(COARSE_ERROR, before / 2)  # infinite if an interval cannot be integrated
    return best, least <= COARSE_ERROR


def _falsifying_error(measures: Sequence[Coarseness]) -> float:
    """Largest error that falsifies the cost; the same for all meshes that are fine enough."""
    return max(COARSE_ERROR, *(measure.largest for measure in measures if measure.falsifies_cost))


def _can_halve(solution: Solution) -> bool:
    """True if all intervals of a mesh may be halved."""
    return interval_count(solution.meshes) <= HALVED_INTERVALS


def _went_astray(finer: Solution, solution: Solution) -> bool:
    """True if a solution on a finer mesh is no motion, and further from one than the solution from which it came."""
    return is_lost(finer) and Coarseness(finer).largest > ASTRAY * Coarseness(solution).largest


def _tends_to_lock(measure: Coarseness) -> bool:
    """True if dimensions are free and the linkage is close to a singular pose where the mesh is coarsest."""
    parts = (
        zip(measure.solution.phases, measure.errors, strict=True) if measure.solution.problem.free_parameters else ()
    )
    return any(errors.size and close_to_singular(part, int(np.argmax(errors))) for part, errors in parts)


def _split_where_coarse(solution: Solution, measures: Sequence[Coarseness]) -> list[Mesh]:
    """Meshes with intervals split that are too coarse, and with those halved in which limits are passed."""
    meshes, passed = [], passed_limits(solution, LIMIT_TOLERANCE)
    for number, part in enumerate(solution.phases):
        times = [limit.time for limit in passed if limit.phase == number]
        least = np.ones(part.mesh.count, int)
        least[np.clip(np.searchsorted(part.mesh_times, times) - 1, 0, part.mesh.count - 1)] = 2
        meshes.append(split(part, measures, least))
    return meshes
