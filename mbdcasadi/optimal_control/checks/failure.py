"""Errors for an optimum that was not found: which demand is not met, where, at what time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import MechanismError
from ..nlp.limit_sides import LimitSides
from ..nlp.limits import time_of, variable_bounds
from ..nlp.rows import OWN_UNIT, violations
from .expressions import kinks_in_costs, kinks_in_path, not_finite

if TYPE_CHECKING:
    from ..solution import Solution

#: Violation of a scaled row from which it is reported.
VIOLATION_TOLERANCE = 1e-7

#: Share of the largest violation below which others are not reported as in conflict.
SMALL_SHARE = 1e-3

_MESSAGES = {
    "Infeasible_Problem_Detected": "no motion that meets all demands was found near the guess (starts= tries others)",
    "Restoration_Failed": "no motion that meets all demands was found: the solver could not reduce their violation",
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
#: The same without the usual cause, if another one is known.
_PLAIN = {"Error_In_Step_Computation": "the solver could not compute a step"}


@dataclass(frozen=True)
class Violation:
    """A row that is not met.

    Attributes
    ----------
    label : str
        Equation and element.
    violation : float
        Amount, in the unit.
    unit : str
        Unit of the row.
    time : float
        Time, s.
    interval : int or None
        Interval of the mesh; None for conditions at one place.
    tau : float
        Point of that interval, 0 to 1.
    scaled : float
        Amount relative to the typical size.
    """

    label: str
    violation: float
    unit: str
    time: float
    interval: int | None
    tau: float
    scaled: float

    @property
    def share(self) -> float:
        """Former name of :attr:`tau`."""
        return self.tau

    def __str__(self) -> str:
        return f"{self.label} by {self.violation:.3g} {self.unit} at t = {self.time:.6g} s"


class OptimizationError(MechanismError):
    """An optimum was not found.

    Attributes
    ----------
    largest_violations : list of Violation
        The largest first.
    partial : Solution
        The last iterate; it is not a solution.
    reached : Solution or None
        The last solution of a continuation, or of a refinement of the mesh, that did not reach its end.
    conflict : tuple of Violation
        Demands that cannot be met together, and by how much they are violated where all violations together are
        least; empty if the problem was not found to be infeasible.
    """

    reached: Any = None
    conflict: tuple[Violation, ...] = ()

    def __init__(self, message: str, *, largest_violations: list[Violation], partial: Any, time: float | None):
        super().__init__(message, time=time, partial=partial)
        self.largest_violations = largest_violations


def explain_failure(solution: Solution, status: str) -> OptimizationError:
    """Return the error for a solve that did not succeed, from its last iterate and the message of the solver."""
    violations = violations_of(solution)
    message = _MESSAGES.get(status, f"the solver stopped: {status}")
    if status == "Solved_To_Acceptable_Level" or not violations:
        worst = "; all demands are met at the last iterate" if not violations else ""
    else:
        worst = f"; least met is: {violations[0]}"
    kinks = kinks_in_costs(solution.problem) or kinks_in_path(solution.problem)
    wrong = not_finite(solution) if status in ("Invalid_Number_Detected", "Error_In_Step_Computation") else None
    if wrong is not None:
        iterations = solution.statistics.iterations
        message, worst = f"{wrong[0]}, {'in the guess' if not iterations else 'in the last iterate'}", ""
    elif kinks and not violations:
        message = _PLAIN.get(status, message)
    if kinks:
        worst += f" ({kinks})"
    elif not violations and status == "Maximum_Iterations_Exceeded":
        worst += " (inputs that chatter unseen may be the cause)"
    if violations and status in ("Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small"):
        worst += " (the problem may be infeasible)"
    return OptimizationError(
        f"{message}{worst}; after {solution.statistics.iterations} iterations, the last iterate is in .partial",
        largest_violations=violations,
        partial=solution,
        time=wrong[1] if wrong else violations[0].time if violations else None,
    )


def infeasible(
    failure: OptimizationError, solution: Solution, slacks: dict[str, float], starts: int, tolerance: float
) -> OptimizationError:
    """Return the error for a problem whose least violation ends above zero.

    `failure` is that with which the search began, `solution` the motion of the least violation, with scaled violations
    `slacks` by label, found from so many starts; a demand counts as violated from the scaled `tolerance` on.
    """
    least = max(tolerance, SMALL_SHARE * max(slacks.values()))
    conflict = tuple(_conflicts(solution, {label: x for label, x in slacks.items() if x > least}))
    listed = ", ".join(map(str, conflict[:3])) + ("" if len(conflict) <= 3 else f" and {len(conflict) - 3} more")
    text = (
        f"the problem is infeasible: the least violation of its demands, from {starts} starts, is not zero; violated "
        f"then: {listed}; {_without_message(failure)}"
    )
    error = OptimizationError(
        text, largest_violations=failure.largest_violations, partial=failure.partial, time=failure.time
    )
    error.conflict = conflict
    return error


def not_found(failure: OptimizationError, stages: list[str]) -> OptimizationError:
    """Return the error for a problem whose solution was not found, though it may have one."""
    text = (
        f"no solution was found, and the problem may still have one (tried: {'; '.join(stages)}); starts= and guess= "
        f"look elsewhere; {_without_message(failure)}"
    )
    return OptimizationError(
        text, largest_violations=failure.largest_violations, partial=failure.partial, time=failure.time
    )


def _without_message(failure: OptimizationError) -> str:
    """Report of a failure without the message of the solver: from the least met demand on."""
    text = str(failure)
    status = _MESSAGES.get(failure.partial.statistics.status, "")
    return text.removeprefix(status).removeprefix("; ").removeprefix(" ")


def _conflicts(solution: Solution, slacks: dict[str, float]) -> list[Violation]:
    """Violations by label, the largest first; each where it is largest."""
    program, rows = solution.program, solution.answer.rows
    sides, violations = LimitSides(program, conditions=True).sides, []
    for label, slack in slacks.items():
        side = sides[label]
        above, below = rows[side.rows_above], program.lower[side.rows_below] - rows[side.rows_below]
        places = [*side.rows_above, *side.rows_below]
        if places:
            row = program.rows[places[int(np.argmax(np.r_[above, below]))]]
            interval = row.interval if row.repeated else None
            time = time_of(row, solution)
            violations.append(Violation(label, slack * row.size, row.unit, time, interval, row.tau, slack))
            continue
        violations.append(_of_bound(solution, label, slack))
    return sorted(violations, key=lambda v: -v.scaled)


def _of_bound(solution: Solution, label: str, slack: float) -> Violation:
    """Violation of a limit that is the bound of variables."""
    size, interval, time, most = 1.0, 0, 0.0, -np.inf
    for part in solution.phases:
        for bound in variable_bounds(part.program) if part.mesh.count else ():
            excess = bound.sign * (solution.variables[bound.place] - bound.value)
            scale = float(solution.program.scale[bound.place])
            if bound.label == label and excess / scale > most:
                most, size, interval = excess / scale, scale, bound.intervals[0]
                time = float(part.mesh_times[interval])
    return Violation(label, slack * size, OWN_UNIT, time, interval, 0.0, slack)


def violations_of(solution: Solution) -> list[Violation]:
    """Return the rows that are not met, the largest violation first."""
    program, rows = solution.program, solution.answer.rows
    amounts = violations(rows, program.lower)
    result = []
    for k in np.flatnonzero(~(amounts <= VIOLATION_TOLERANCE)):
        row, scaled = program.rows[k], float(amounts[k])
        interval = row.interval if row.repeated else None
        label, time = row.side(rows[k]), time_of(row, solution)
        if len(solution.phases) > 1 and row.phase >= 0 and "phase '" not in label:
            label += f" in phase '{solution.phases[row.phase].phase.name}'"
        result.append(Violation(label, scaled * row.size, row.unit, time, interval, row.tau, scaled))
    return sorted(result, key=lambda v: -v.scaled)
