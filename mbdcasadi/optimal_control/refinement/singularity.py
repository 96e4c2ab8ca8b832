"""Singular poses: places where a linkage locks or branches, which no mesh resolves if an optimum tends to them.

Lengths that are free may tend to a linkage with a change point, whose links turn ever faster beside it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..phase_solution import PhaseSolution

#: Share of the usual distance from singular poses below which a pose is close to one.
CLOSE = 0.4


def independent_jacobians(part: PhaseSolution, points: Iterable[int]) -> list[np.ndarray]:
    """Return the scaled Jacobians of the rows that the program keeps, at points of the trajectory."""
    scheme, motion = part.program.scheme, part.trajectory
    rows = [*scheme.eom.explicit, *(scheme.eom.rows[k] for k in scheme.rows)]
    return [part.numeric.scaled_jacobian(float(motion.t[k]), motion.q[k])[rows] for k in points]


def close_to_singular(part: PhaseSolution, interval: int) -> str:
    """Return in words that a linkage comes close to a singular pose in an interval, with a remedy; empty if not."""
    scheme = part.program.scheme
    if not (scheme.eom.explicit or scheme.rows) or not part.phase.equations.has_loops:
        return ""
    distances = np.array(
        [np.linalg.svd(one, compute_uv=False)[-1] for one in independent_jacobians(part, range(len(part.trajectory)))]
    )
    first = interval * part.points_per_interval
    share = np.min(distances[first : first + part.points_per_interval + 1]) / np.median(distances)
    if share > CLOSE:
        return ""
    return (
        f"; there the linkage comes close to a pose in which it locks or branches (its distance from one is "
        f"{share:.2g} of the usual one): a limit in path=, such as that of a transmission angle, keeps away from it"
    )
