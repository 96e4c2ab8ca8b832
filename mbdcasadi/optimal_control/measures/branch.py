"""Motions that jump from one branch of a linkage to another within an interval of the mesh.

At a mesh point the motion is moved onto the constraints. On a coarse mesh the constraints may be met again on another
branch: an elbow points up at one mesh point and down at the next, and every row of the program holds.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ...errors import OptimizationError
from ..motion.phase_solution import PhaseSolution
from ..solution import Solution
from .local_error import COARSE_ERROR, coarseness
from .singularity import independent_rows, scaled_jacobians

#: Least share that a determinant has of the largest one in the same pose, for its sign to count.
REGULAR = 0.1


@dataclass(frozen=True)
class BranchJump:
    """A jump to another branch: the interval in which it takes place, s, the constraint, the body, and its step."""

    begin: float
    end: float
    row: str
    coordinate: str
    step: float

    @property
    def title(self) -> str:
        """What happens and when, in a few words."""
        return f"jump to another branch at t = {self.begin:.6g} s"

    def __str__(self) -> str:
        return (
            f"from t = {self.begin:.6g} to {self.end:.6g} s {self.coordinate} jumps by {self.step:.3g} to another "
            f"branch of the linkage (halfway {self.row} is missed most)"
        )


def branch_jump(solution: Solution) -> BranchJump | None:
    """Return the first jump of a solution from one branch of the linkage to another."""
    return next((jump for part in solution.phases if (jump := _jump(part)) is not None), None)


def refuse_branch_jump(solution: Solution) -> None:
    """Raise an :class:`OptimizationError` for a jump to another branch: constraint, coordinate and time."""
    jump = branch_jump(solution)
    if jump is not None:
        raise OptimizationError(
            f"the solution is not a motion of the mechanism: {jump}; take more intervals=, tolerance=, another guess=, "
            "or starts=",
            partial=solution,
            time=jump.begin,
        )


def _jump(part: PhaseSolution) -> BranchJump | None:
    eom = part.phase.equations
    if not part.program.scheme.eom.rows or not part.mesh.count or not eom.has_branches:
        return None
    positions, points = set(eom.position_rows.tolist()), part.points_per_interval
    rows = [k for k in independent_rows(part) if k in positions]
    for i in np.flatnonzero(coarseness(part) > COARSE_ERROR):
        jacobians = scaled_jacobians(part, rows, range(i * points, (i + 1) * points + 1))
        if any(changes_sign(*pair) for pair in itertools.pairwise(jacobians)):
            return _described(part, int(i))
    return None


def changes_sign(before: np.ndarray, after: np.ndarray) -> bool:
    """Return True if a determinant of dependent coordinates changes its sign and is far from zero at both poses."""
    columns = [_dependent(jacobian) for jacobian in (before, after)]
    best = [np.linalg.slogdet(jacobian[:, c]) for jacobian, c in zip((before, after), columns, strict=True)]
    for chosen in columns:
        signs, shares = [], []
        for jacobian, largest in zip((before, after), best, strict=True):
            sign, size = np.linalg.slogdet(jacobian[:, chosen])
            signs.append(sign)
            shares.append(float(np.exp(size - largest[1])))
        if signs[0] * signs[1] < 0 and min(shares) > REGULAR:
            return True
    return False


def _dependent(jacobian: np.ndarray) -> np.ndarray:
    """Columns whose determinant is large, in ascending order."""
    from scipy.linalg import qr

    pivots: np.ndarray = qr(jacobian, mode="r", pivoting=True)[1]
    return np.sort(pivots[: len(jacobian)])


def _described(part: PhaseSolution, i: int) -> BranchJump:
    """The jump in an interval: the constraint that is missed most halfway, and the largest step of a coordinate."""
    eom, numeric = part.phase.equations, part.numeric
    n, end = eom.q.numel(), float(part.mesh_times[i + 1])
    q = part.polynomials.at(np.array([i]), np.ones(1))[1].ravel()
    missed = numeric.position(end, (q + part.mesh_states[i + 1, :n]) / 2, part.mesh_states[i + 1, 2 * n :])[0]
    steps = part.projection_steps[i, :n] / part.program.scales.q
    row = eom.row_names[int(eom.position_rows[int(np.argmax(np.abs(missed)))])]
    worst = int(np.argmax(steps))
    step = float(steps[worst] * part.program.scales.q[worst])
    return BranchJump(float(part.mesh_times[i]), end, row, eom.coordinate_names[worst], step)
