"""What is said where an optimum was not found: which demand is not met, where, at what time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MechanismError
from .program import MotionProgram

if TYPE_CHECKING:
    from .solution import Solution

#: Violations in scaled rows that count.
COUNTS = 1e-7

_WORDS = {
    "Infeasible_Problem_Detected": "the problem is infeasible: no motion meets all demands (locally)",
    "Restoration_Failed": "the problem seems infeasible: the solver could not reduce the violation of the demands",
    "Maximum_Iterations_Exceeded": "the solver ran out of iterations (options={'ipopt.max_iter': …})",
    "Maximum_CpuTime_Exceeded": "the solver ran out of time",
    "Maximum_WallTime_Exceeded": "the solver ran out of time",
    "Not_Enough_Degrees_Of_Freedom": "there are more independent demands than unknowns",
    "Invalid_Number_Detected": "an expression or its derivative is not finite (a square root or norm at zero?)",
    "Search_Direction_Becomes_Too_Small": "the solver got stuck: demands that contradict each other, or poor scaling",
    "Diverging_Iterates": "the iterates diverge: something that is free should be bounded",
    "Solved_To_Acceptable_Level": "the solver stopped short of the tolerance (options={'ipopt.tol': …})",
}


@dataclass(frozen=True)
class Violation:
    """A row that is not met.

    Attributes
    ----------
    label : str
        Which equation of which element.
    violation : float
        By how much, in the row's own unit.
    time : float
        When, s.
    interval : int or None
        In which interval of the mesh; None for conditions at the ends.
    scaled : float
        By how much, relative to the typical size.
    """

    label: str
    violation: float
    time: float
    interval: int | None
    scaled: float


class OptimizationError(MechanismError):
    """An optimum was not found.

    Attributes
    ----------
    largest_violations : list of Violation
        Sorted, the largest first.
    partial : Solution
        The last iterate; it is no solution.
    """

    def __init__(self, message: str, *, largest_violations: list[Violation], partial: Any, time: float | None):
        super().__init__(message, time=time, partial=partial)
        self.largest_violations = largest_violations


def explain_failure(
    solution: Solution, program: MotionProgram, mesh: np.ndarray, rows: np.ndarray, equality: np.ndarray, status: str
) -> OptimizationError:
    """The error for a solve that did not succeed."""
    violations = _violations(solution, program, mesh, rows, equality)
    words = _WORDS.get(status, f"the solver stopped: {status}")
    if status == "Solved_To_Acceptable_Level" or not violations:
        worst = "; all demands are met at the last iterate" if not violations else ""
    else:
        first = violations[0]
        worst = f"; least met is: {first.label} by {first.violation:.3g} at t = {first.time:.6g} s"
    if violations and status in ("Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small"):
        worst += " (the problem may be infeasible)"
    return OptimizationError(
        f"{words}{worst}; after {solution.statistics.iterations} iterations, the last iterate is in .partial",
        largest_violations=violations,
        partial=solution,
        time=violations[0].time if violations else None,
    )


def _violations(
    solution: Solution, program: MotionProgram, mesh: np.ndarray, rows: np.ndarray, equality: np.ndarray
) -> list[Violation]:
    amount = np.where(equality, np.abs(rows), np.maximum(rows, 0.0))
    found: list[Violation] = []
    k = 0
    places = [(i, g) for i in range(program.count) for g in program.interval_groups]
    for interval, group in [*places, *[(None, g) for g in program.end_groups]]:
        for label, size in zip(group.labels, group.scale, strict=True):
            if amount[k] > COUNTS:
                share = group.share
                if interval is not None:
                    share = mesh[interval] + group.share * (mesh[interval + 1] - mesh[interval])
                time = float(share * solution.duration)
                found.append(Violation(label, float(amount[k] * size), time, interval, float(amount[k])))
            k += 1
    return sorted(found, key=lambda v: -v.scaled)
