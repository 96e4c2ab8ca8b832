"""Solutions that are no motions, whatever mesh was asked for: intervals that end far off the motion."""

from __future__ import annotations

import numpy as np

from ...errors import OptimizationError
from ..measures.branch import refuse_branch_jump
from ..measures.local_error import Coarseness, coarse_mesh
from ..motion.phase_solution import PhaseSolution
from ..solution import Solution
from ..solve.problem_solver import ProblemSolver
from .refine import refine_if_coarse

#: Step by which the end of an interval is moved onto the constraints, in rad or sizes of the mechanism, from which a
#: solution is not a motion, whatever mesh was asked for.
LARGEST_PROJECTION = 0.1
#: Error of an interval, as :func:`coarseness` has it, from which it is none either.
LARGEST_ERROR = 1.0


def refined_if_far_off(solver: ProblemSolver, solution: Solution, *, refined: bool) -> Solution:
    """Return the solution, on a finer mesh if an interval ends far off, unless the mesh is `refined` already.

    Raises
    ------
    OptimizationError
        If an interval still ends far off, or the solution jumps to another branch.
    """
    if _largest_projection(solution) <= LARGEST_PROJECTION and _FarOff(solution).largest <= LARGEST_ERROR:
        return solution
    motion = solution if refined else refine_if_coarse(solver, solution)[0]
    refuse_branch_jump(motion)
    refuse_far_off(motion)
    return motion


def refuse_far_off(solution: Solution) -> None:
    """Raise an :class:`OptimizationError` for an interval of a closed loop that ends far from the next one."""
    measure = _FarOff(solution)
    if measure.largest > LARGEST_ERROR:
        part, k = measure.worst
        text = coarse_mesh(part, measure.errors[part.program.number])
        raise OptimizationError(
            f"the solution is not a motion of the mechanism: {text}", partial=solution, time=float(part.mesh_times[k])
        )


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
