"""Singular poses: places where a linkage locks or branches, which no mesh resolves if an optimum tends to them.

Lengths that are free may tend to a linkage with a change point, whose links turn ever faster beside it.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from ...errors import warn
from ...simulation.path import Path
from ...simulation.singular.regularity import Regularity, folding_pose
from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion

#: Share of the usual distance from singular poses below which a pose is close to one.
CLOSE = 0.4


def independent_rows(part: PhaseSolution) -> list[int]:
    """Return the constraint rows that the program keeps."""
    scheme = part.program.scheme
    return [*scheme.eom.explicit, *(scheme.eom.rows[k] for k in scheme.rows)]


def scaled_jacobians(part: PhaseSolution, rows: Sequence[int], points: Iterable[int]) -> list[np.ndarray]:
    """Return the scaled Jacobians of constraint rows at points of the trajectory."""
    motion = part.trajectory
    return [part.numeric.scaled_jacobian(float(motion.t[k]), motion.q[k])[rows] for k in points]


def close_to_singular(part: PhaseSolution, interval: int) -> str:
    """Return in words that a linkage comes close to a singular pose in an interval, with a remedy; empty if not."""
    rows = independent_rows(part)
    if not rows or not part.phase.equations.has_loops:
        return ""
    jacobians = scaled_jacobians(part, rows, range(len(part.trajectory)))
    distances = np.array([np.linalg.svd(one, compute_uv=False)[-1] for one in jacobians])
    first = interval * part.points_per_interval
    share = np.min(distances[first : first + part.points_per_interval + 1]) / np.median(distances)
    if share > CLOSE:
        return ""
    return (
        f"; there the linkage comes close to a pose in which it locks or branches (its distance from one is "
        f"{share:.2g} of the usual one): a limit in path=, such as that of a transmission angle, keeps away from it"
    )


def folding_pose_of(part: PhaseSolution) -> str | None:
    """Description of a pose in which the linkage of a phase could fold, if its motion comes close to one."""
    if not part.mesh.count or not part.phase.equations.has_loops:
        return None
    path = Path(part.mesh_times, part.mesh_states, np.zeros((0, 0)))
    regularity = Regularity(part.numeric, path.times[0], path.x[0, : part.numeric.eom.q.numel()])
    return folding_pose(regularity, path, part.numeric)


def warn_of_folding_poses(solution: SolvedMotion) -> None:
    """Warn of a motion that passes a pose in which its linkage could fold, or comes close to one."""
    several = len(solution.phases) > 1
    for part in solution.phases:
        pose = folding_pose_of(part)
        if pose is None:
            continue
        of_phase = f" of phase '{part.phase.name}'" if several else ""
        warn(
            f"the motion{of_phase} comes close to {pose}: reactions next to it mean little, and a simulation with "
            "the inputs that were found may stop there or take the other branch; a limit in path=, such as that of "
            "a transmission angle, keeps away from it"
        )
