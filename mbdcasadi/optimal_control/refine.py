"""Mesh refinement: intervals are split until their local error is small enough."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..errors import SimulationError
from .local_error import scaled_errors

if TYPE_CHECKING:
    from .optimize import Solver
    from .solution import Solution

#: Passes of the refinement, and pieces into which an interval is split at the most.
PASSES, PIECES = 12, 6


def refine(solver: Solver, solution: Solution, tolerance: float) -> Solution:
    """Solve on finer meshes until the local error of every interval is below a tolerance.

    An interval with error e is split into ``ceil((2 e / tolerance)^(1 / (2 d + 1)))``
    pieces, d the degree; each pass starts from the last solution.
    """
    power = 1.0 / (2 * solver.scheme.degree + 1)
    for _ in range(PASSES):
        errors = scaled_errors(solution)
        if np.max(errors) <= tolerance:
            return solution
        pieces = np.clip(np.ceil((2 * errors / tolerance) ** power), 1, PIECES).astype(int)
        pieces[errors <= tolerance] = 1
        shares = solution.shares
        finer = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(shares[:-1], shares[1:], pieces, strict=True)]
        solution = solver.solve(np.r_[np.concatenate(finer), 1.0], solution)
    raise SimulationError(
        f"the mesh was refined {PASSES} times to {solution.shares.size - 1} intervals and the local error is still "
        f"{np.max(errors):.2g}, above the tolerance {tolerance:g}",
        partial=solution,
    )
