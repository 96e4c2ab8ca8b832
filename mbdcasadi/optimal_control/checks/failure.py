"""What is said where an optimum was not found: which demand is not met, where, at what time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MechanismError
from ..nlp.rows import violations

if TYPE_CHECKING:
    from ..solution import Solution

#: Violations in scaled rows that count.
COUNTS = 1e-7

_WORDS = {
    "Infeasible_Problem_Detected": "the problem is infeasible: no motion near the guess meets all demands "
    "(starts= tries others)",
    "Restoration_Failed": "the problem seems infeasible: the solver could not reduce the violation of the demands",
    "Maximum_Iterations_Exceeded": "the solver ran out of iterations (options={'ipopt.max_iter': …})",
    "Invalid_Option": "the solver refuses an option, or lacks what it names (another linear solver?)",
    "Maximum_CpuTime_Exceeded": "the solver ran out of time",
    "Maximum_WallTime_Exceeded": "the solver ran out of time",
    "Not_Enough_Degrees_Of_Freedom": "there are more independent demands than unknowns",
    "Invalid_Number_Detected": "an expression or its derivative is not finite (a square root or norm at zero?)",
    "Search_Direction_Becomes_Too_Small": "the solver got stuck: demands that contradict each other, or poor scaling",
    "Diverging_Iterates": "the iterates diverge: something that is free should be bounded",
    "Error_In_Step_Computation": "the solver could not compute a step (a condition that is met at an extremum, such as "
    "a height at its top, has no slope there: state the coordinate instead)",
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
        By how much, in the unit.
    unit : str
        Of the row.
    time : float
        When, s.
    interval : int or None
        In which interval of the mesh; None for conditions at one place.
    share : float
        Where in that interval, 0 to 1.
    scaled : float
        By how much, relative to the typical size.
    """

    label: str
    violation: float
    unit: str
    time: float
    interval: int | None
    share: float
    scaled: float

    def __str__(self) -> str:
        return f"{self.label} by {self.violation:.3g} {self.unit} at t = {self.time:.6g} s"


class OptimizationError(MechanismError):
    """An optimum was not found.

    Attributes
    ----------
    largest_violations : list of Violation
        Sorted, the largest first.
    partial : Solution
        The last iterate; it is no solution.
    reached : Solution or None
        The last solution of a continuation, or of a refinement of the mesh, that could not be finished.
    """

    reached: Any = None

    def __init__(self, message: str, *, largest_violations: list[Violation], partial: Any, time: float | None):
        super().__init__(message, time=time, partial=partial)
        self.largest_violations = largest_violations


def explain_failure(solution: Solution, status: str) -> OptimizationError:
    """The error for a solve that did not succeed.

    Parameters
    ----------
    solution : Solution
        The last iterate.
    status : str
        The solver's own word.
    """
    violations = violations_of(solution)
    words = _WORDS.get(status, f"the solver stopped: {status}")
    if status == "Solved_To_Acceptable_Level" or not violations:
        worst = "; all demands are met at the last iterate" if not violations else ""
    else:
        worst = f"; least met is: {violations[0]}"
    if not violations and status == "Maximum_Iterations_Exceeded":
        worst += " (a cost or limit with kinks, such as fabs or fmax, or inputs that chatter unseen, may be the cause)"
    if violations and status in ("Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small"):
        worst += " (the problem may be infeasible)"
    return OptimizationError(
        f"{words}{worst}; after {solution.statistics.iterations} iterations, the last iterate is in .partial",
        largest_violations=violations,
        partial=solution,
        time=violations[0].time if violations else None,
    )


def violations_of(solution: Solution) -> list[Violation]:
    """Rows that are not met, the largest first."""
    program, mesh, rows = solution.program, solution.mesh, solution.answer.rows
    amount = violations(rows, program.lower)
    found = []
    for k in np.flatnonzero(~(amount <= COUNTS)):
        row = program.rows[k]
        i, share, scaled = row.interval, float(row.share), float(amount[k])
        time = float(mesh[i] + share * (mesh[i + 1] - mesh[i]))
        where = i if k < program.interval_rows else None
        found.append(Violation(row.side(rows[k]), scaled * row.size, row.unit, time, where, share, scaled))
    return sorted(found, key=lambda v: -v.scaled)
