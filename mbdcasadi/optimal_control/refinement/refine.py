"""Mesh refinement: intervals are split and merged until their local errors suit the tolerance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...errors import Interrupted
from ...numerics.console import interruptible
from ..checks.failure import OptimizationError
from ..nlp.solver import Solver
from ..solution import Solution
from ..solve_statistics import Pass
from .local_error import scaled_errors
from .mesh import Mesh

#: Passes of the refinement, pieces into which an interval is split, and intervals of a mesh, at the most.
PASSES, PIECES, INTERVALS = 12, 6, 2000
#: Share of the tolerance below which the error of two merged intervals must be foreseen.
WELL_BELOW = 0.05


def refine(solver: Solver, solution: Solution, tolerance: float) -> Solution:
    """Solve on other meshes until the local error of every interval is below a tolerance.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / (r + 1)))``
    pieces, r the order of the scheme; neighbours whose common interval is
    foreseen to stay far below the tolerance are merged. Each pass starts from
    the last solution.
    """
    passes: list[Pass] = []
    merging = True
    reason = f"{PASSES} passes are made"
    for _ in range(PASSES):
        errors = _errors(solution)
        s = solution.statistics
        passes.append(Pass(solution.shares.count, float(np.max(errors)), solution.cost, s.iterations, s.seconds))
        solution.statistics = replace(s, passes=passes)
        if np.max(errors) <= tolerance:
            return solution
        before = [p.error for p in passes[:-1]][-2:]
        if len(before) == 2 and passes[-1].error > max(before) / 2 and not merging:
            reason = "the local error does not fall any further"
            break
        merging = merging and passes[-1].error <= min(before, default=np.inf) / 2
        mesh = adapted(solution.shares, errors, tolerance, solution.program.scheme.order, merging=merging)
        if mesh.count > INTERVALS:
            reason = f"the next mesh would have {mesh.count} intervals"
            break
        guess = solution.as_guess(solver.problem)
        try:
            solution = solver.solve(mesh, guess, warm=True)
        except OptimizationError:  # what is near on one mesh may be far on another
            try:
                solution = solver.solve(mesh, guess)
            except OptimizationError as error:
                error.reached = solution
                raise
    raise OptimizationError(
        f"the mesh was refined to {solution.shares.count} intervals and the local error is still "
        f"{passes[-1].error:.2g}, above the tolerance {tolerance:g}: {reason}; the last solution is in .partial",
        largest_violations=[],
        partial=solution,
        time=None,
    )


def _errors(solution: Solution) -> np.ndarray:
    with interruptible() as interruption:
        try:
            return scaled_errors(solution)
        except (KeyboardInterrupt, RuntimeError):
            if not interruption.requested:
                raise
    raise Interrupted("stopped by the user; the last solution is in .partial", partial=solution)


def adapted(mesh: Mesh, errors: np.ndarray, tolerance: float, order: int, *, merging: bool = True) -> Mesh:
    """Mesh whose intervals are split or merged by their local errors (N,).

    Parameters
    ----------
    mesh : Mesh
        The mesh so far.
    errors : numpy.ndarray
        Local errors (N,).
    tolerance : float
        What they should stay below.
    order : int
        Of the scheme: local errors go with the power ``order + 1`` of the length.
    merging : bool
        Whether intervals may be merged: not after a pass that did not bring the error down.
    """
    pieces = np.clip(np.ceil((2 * errors / tolerance) ** (1 / (order + 1))), 1, PIECES).astype(int)
    pieces[errors <= tolerance] = 1
    merge = np.zeros(errors.size, bool)
    k = 0
    while merging and k + 1 < errors.size:
        together = (mesh.length[k] + mesh.length[k + 1]) / np.minimum(mesh.length[k], mesh.length[k + 1])
        foreseen = max(errors[k], errors[k + 1]) * together ** (order + 1)
        if mesh.phase[k] == mesh.phase[k + 1] and foreseen <= WELL_BELOW * tolerance:
            merge[k] = True
            k += 1
        k += 1
    return mesh.refined(pieces, merge)
