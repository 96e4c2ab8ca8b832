"""Mesh refinement: intervals are split and merged until their local errors suit the tolerance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...numerics.console import interruptible
from ..checks.failure import OptimizationError
from ..nlp.held_limits import passed_limits
from ..nlp.solver import Solver, together
from ..nlp.statistics import Pass
from ..solution import Solution
from .local_error import COARSE_ERROR, coarseness, scaled_errors
from .mesh import Mesh

#: Largest number of passes, of pieces into which an interval is split, and of intervals of a mesh.
PASSES, PIECES, INTERVALS = 12, 6, 2000
#: Largest number of passes for a mesh that is too coarse, if no tolerance is asked for.
COARSE_PASSES = 3
#: Share of the tolerance below which the error of two merged intervals must be foreseen.
MERGING_SHARE = 0.05


def refine(solver: Solver, solution: Solution, tolerance: float) -> Solution:
    """Solve on other meshes until the local error of every interval is below a tolerance.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / (r + 1)))``
    pieces, r the order of the scheme; neighbours whose common interval is
    foreseen to stay far below the tolerance are merged. Each pass starts from
    the last solution.

    Raises
    ------
    OptimizationError
        If a pass fails, with the last solution in ``.reached``, or if no mesh was found that meets the tolerance,
        with the last solution in ``.partial``.
    """
    passes: list[Pass] = []
    merging = True
    reason = f"{PASSES} passes are made"
    for _ in range(PASSES):
        errors = _errors(solution)
        error, s = float(np.max(np.concatenate(errors))), solution.statistics
        passes.append(Pass(_count(solution.meshes), error, solution.cost, s.iterations, s.seconds))
        solution.statistics = replace(s, passes=list(passes))
        if error <= tolerance:
            return solution
        before = [p.error for p in passes[:-1]][-2:]
        if len(before) == 2 and error > max(before) / 2 and not merging:
            reason = "the local error does not fall any further"
            break
        merging = merging and error <= min(before, default=np.inf) / 2
        order = solution.phases[0].program.scheme.order
        meshes = [
            adapted(mesh, e, tolerance, order, merging=merging) for mesh, e in zip(solution.meshes, errors, strict=True)
        ]
        if _count(meshes) > INTERVALS:
            reason = f"the next mesh would have {_count(meshes)} intervals"
            break
        guess = solution.as_guess(solver.problem)
        solver.best.new_stage()
        try:
            solution = solver.solve(meshes, guess, warm=True)
        except OptimizationError:  # a guess that is near on one mesh may be far on another
            try:
                solution = solver.solve(meshes, guess)
            except OptimizationError as failure:
                failure.reached = solution
                raise
    raise OptimizationError(
        f"the mesh was refined to {_count(solution.meshes)} intervals and the local error is still "
        f"{error:.2g}, above the tolerance {tolerance:g}: {reason}; the last solution is in .partial",
        largest_violations=[],
        partial=solution,
        time=None,
    )


def refine_if_coarse(solver: Solver, solution: Solution) -> tuple[Solution, bool]:
    """Solve again with intervals split that are too coarse for the motion, or in which it passes a limit.

    A few times at most.

    Returns
    -------
    Solution, bool
        The last solution, and whether its mesh is fine enough.
    """
    for _ in range(COARSE_PASSES):
        order = solution.phases[0].program.scheme.order
        meshes = []
        for part in solution.phases:
            if not part.mesh.count:
                meshes.append(part.mesh)
                continue
            # foreseen to be well below, and one power less than the order: the steps of projection are no smooth error
            pieces = np.ceil((4 * coarseness(part) / COARSE_ERROR) ** (1 / order))
            pieces[coarseness(part) <= COARSE_ERROR] = 1
            passed = [limit.time for limit in passed_limits(solution) if limit.phase == part.program.number]
            places = np.clip(np.searchsorted(part.mesh_times, passed) - 1, 0, part.mesh.count - 1)
            pieces[places] = np.maximum(pieces[places], 2)
            pieces = np.clip(np.nan_to_num(pieces, nan=PIECES), 1, PIECES).astype(int)
            meshes.append(part.mesh.refined(pieces, np.zeros(part.mesh.count, bool)))
        if _count(meshes) == _count(solution.meshes):
            break
        solver.best.new_stage()
        try:
            finer = solver.solve(meshes, solution.as_guess(solver.problem), warm=True)
        except OptimizationError:
            break
        finer.statistics = together(solution.statistics, finer.statistics)
        solution = finer
    return solution, all(np.max(coarseness(part), initial=0.0) <= COARSE_ERROR for part in solution.phases)


def _count(meshes: Sequence[Mesh]) -> int:
    """Number of intervals of all phases."""
    return sum(mesh.count for mesh in meshes)


def _errors(solution: Solution) -> list[np.ndarray]:
    """Local errors of the intervals by phase; Ctrl-C in compiled code comes as what it is."""
    with interruptible() as interruption:
        try:
            return [scaled_errors(phase) for phase in solution.phases]
        except RuntimeError:
            if not interruption.requested:
                raise
    raise KeyboardInterrupt


def adapted(mesh: Mesh, errors: np.ndarray, tolerance: float, order: int, *, merging: bool = True) -> Mesh:
    """Return the mesh with intervals split or merged by their local errors.

    Parameters
    ----------
    mesh : Mesh
        Present mesh.
    errors : numpy.ndarray
        Local errors (N,).
    tolerance : float
        Value that they should stay below.
    order : int
        Order of the scheme: local errors go with the power ``order + 1`` of the length.
    merging : bool
        True if intervals may be merged: not after a pass that did not bring the error down.
    """
    pieces = np.clip(np.ceil((2 * errors / tolerance) ** (1 / (order + 1))), 1, PIECES).astype(int)
    pieces[errors <= tolerance] = 1
    merge = np.zeros(errors.size, bool)
    k = 0
    while merging and k + 1 < errors.size:
        together = (mesh.length[k] + mesh.length[k + 1]) / np.minimum(mesh.length[k], mesh.length[k + 1])
        foreseen = max(errors[k], errors[k + 1]) * together ** (order + 1)
        if mesh.segment[k] == mesh.segment[k + 1] and foreseen <= MERGING_SHARE * tolerance:
            merge[k] = True
            k += 1
        k += 1
    return mesh.refined(pieces, merge)
