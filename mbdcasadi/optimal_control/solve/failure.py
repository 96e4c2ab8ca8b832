"""Errors for an optimum that was not found: which demand is not met, where, at what time."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import OptimizationError
from ...kinematics.reachable import Obstacle
from ..motion.limits import label_of
from ..program.limit_sides import LimitSides, Side, Slacks
from ..solution import Solution
from ..transcription.rows import violations
from .expressions import kinks_in_costs, kinks_in_path, not_finite
from .solvers.base import REFUSED, UNBOUNDED_COST

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
    REFUSED: "there are more independent demands than unknowns: leave one of them out, or leave a part of the start, a "
    "duration or a parameter free",
    "Invalid_Number_Detected": "an expression or its slope is not finite (a division by zero, a root or norm at zero?)",
    "Search_Direction_Becomes_Too_Small": "the solver got stuck: demands that contradict each other, or poor scaling",
    "Diverging_Iterates": "the iterates diverge: something that is free should be bounded",
    "Error_In_Step_Computation": "the solver could not compute a step (a condition that is met at an extremum, such as "
    "a height at its top, has no slope there: state the coordinate instead)",
    "User_Requested_Stop": "its cost stayed far above that of another start",
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
        unit = f" {self.unit}" if self.unit else ""
        return f"{self.label} by {self.violation:.3g}{unit} at t = {self.time:.6g} s"


def explain_failure(solution: Solution, status: str) -> OptimizationError:
    """Return the error for a solve that did not succeed, from its last iterate and the message of the solver."""
    violations = violations_of(solution)
    if is_unbounded(solution):
        return OptimizationError(
            f"the cost seems to have no lower bound: it is {solution.cost:.3g} at the last iterate, "
            f"after {solution.statistics.iterations} iterations, and falls on; limit the inputs, or add a cost for "
            "what grows",
            largest_violations=violations,
            partial=solution,
        )
    usual = message = _MESSAGES.get(status, f"the solver stopped: {status}")
    worst = ""
    if status != REFUSED and not violations:
        worst = "all demands are met at the last iterate"
    elif status not in (REFUSED, "Solved_To_Acceptable_Level"):
        worst = f"least met is: {violations[0]}"
    kinks = kinks_in_costs(solution.problem) or kinks_in_path(solution.problem, stated=True)
    wrong = not_finite(solution) if status in ("Invalid_Number_Detected", "Error_In_Step_Computation") else None
    if wrong is not None:
        iterations = solution.statistics.iterations
        message, worst = f"{wrong[0]}, {'in the guess' if not iterations else 'in the last iterate'}", ""
    elif status == "Invalid_Number_Detected":
        message += f": running costs and path conditions are finite, so look at {_further_places(solution)}"
        worst = worst if violations else ""
    elif kinks and not violations:
        message = _PLAIN.get(status, message)
    remark = _likely_cause(status, kinks, is_met=not violations)
    error = OptimizationError(
        "; ".join([*filter(None, [message, worst])]) + f"{remark}; {_left(solution)}",
        largest_violations=violations,
        partial=solution,
        time=wrong[1] if wrong else violations[0].time if violations else None,
    )
    findings = "; ".join(filter(None, ["" if message == usual else message, worst])) + remark
    error.findings = "; ".join(filter(None, [findings.strip(), _left(solution)]))
    return error


def _likely_cause(status: str, kinks: str, *, is_met: bool) -> str:
    """Likely cause of a failure in brackets; empty if there is none."""
    if kinks:
        return f" ({kinks})"
    if is_met:
        return " (inputs that chatter unseen may be the cause)" if status == "Maximum_Iterations_Exceeded" else ""
    stuck = status in ("Maximum_Iterations_Exceeded", "Search_Direction_Becomes_Too_Small")
    return " (the problem may be infeasible)" if stuck else ""


def _further_places(solution: Solution) -> str:
    """Where else an expression may not be finite, in words."""
    problem = solution.problem
    stated = {
        "terminal_cost": not problem.terminal_cost.is_zero(),
        "boundary": bool(problem.boundary),
        "waypoints": any(phase.waypoints for phase in problem.phases),
        "forces": True,
    }
    return f"{', '.join(name for name, there in stated.items() if there)}; guess= or limits may keep away from zero"


def _left(solution: Solution) -> str:
    """What is left of a search that failed, in words."""
    return f"after {solution.statistics.iterations} iterations, the last iterate is in .partial"


def is_unbounded(solution: Solution) -> bool:
    """Return True if the cost of a last iterate that is no solution is so low that it seems to have no lower bound."""
    return solution.cost < UNBOUNDED_COST * solution.program.cost_scale


#: A motion, and what it violates.
Violated = tuple[Solution, Slacks]


def infeasible(
    failure: OptimizationError, least: Violated, widened: Violated | None, reason: str, tolerance: float
) -> OptimizationError:
    """Return the error for a problem that seems to have no solution, for a reason.

    `failure` is that with which the search began, `least` the motion of the least violation, and `widened` one that
    violates limits alone, if there is one; a demand counts as violated from the scaled `tolerance` on.
    """
    together = _conflicts(*least, tolerance)
    limits = [] if widened is None else _conflicts(*widened, tolerance)
    text = (
        f"the problem seems infeasible: {_wider(limits)}{reason}; violated then: "
        f"{_listed(list(map(str, together)), 3)}; {_last_iterate(failure)}"
    )
    error = _instead_of(failure, text)
    named = {violation.label for violation in limits}
    error.conflict = (*limits, *(violation for violation in together if violation.label not in named))
    error.time = error.conflict[0].time if error.conflict else failure.time
    return error


def not_reached(place: str, obstacle: Obstacle) -> OptimizationError:
    """Return the error for a place that the linkage seems not to reach, before anything was solved."""
    missed = [
        Violation(one.label, one.amount, one.unit, obstacle.time, None, 1.0, one.share) for one in obstacle.missed
    ]
    error = OptimizationError(
        f"the problem seems infeasible: {obstacle.text(place, missed)} (nothing was solved yet)",
        largest_violations=missed,
        partial=None,
        time=obstacle.time,
    )
    error.conflict = tuple(missed)
    return error


def _listed(names: Sequence[str], most: int = 4) -> str:
    """Names in a row, of many the first ones."""
    return ", ".join(names[:most]) + ("" if len(names) <= most else f" and {len(names) - most} more")


def not_found(
    failure: OptimizationError, stages: list[str], widened: Violated | None, tolerance: float
) -> OptimizationError:
    """Return the error for a problem whose solution was not found, though it may have one.

    `widened` is a motion that violates limits alone, if there is one.
    """
    limits = [] if widened is None else _conflicts(*widened, tolerance)
    text = (
        f"no solution was found, and the problem may still have one (tried: {_tried(stages)}); {_wider(limits)}"
        f"starts= and guess= look elsewhere; {failure.findings or failure}"
    )
    return _instead_of(failure, text)


def _tried(stages: list[str]) -> str:
    """Stages of a search in the order in which they came first, each once."""
    return "; ".join(name if times == 1 else f"{name} ({times} times)" for name, times in Counter(stages).items())


def _wider(limits: Sequence[Violation]) -> str:
    """Limits that would have to be wider, in words."""
    listed = _listed(list(map(str, limits)), 3)
    return f"all conditions could be met with wider limits: {listed}; " if limits else ""


def _instead_of(failure: OptimizationError, text: str) -> OptimizationError:
    """A failure with another message."""
    return OptimizationError(
        text, largest_violations=failure.largest_violations, partial=failure.partial, time=failure.time
    )


def _last_iterate(failure: OptimizationError) -> str:
    """Report of a failure without its demands that are not met, which say little beside the least violation."""
    problem = failure.partial.problem
    kinks = kinks_in_costs(problem) or kinks_in_path(problem, stated=True)
    return f"{kinks}; {_left(failure.partial)}" if kinks else _left(failure.partial)


def _conflicts(solution: Solution, slacks: Slacks, tolerance: float) -> list[Violation]:
    """Violations by name, the largest first, each where it is largest; those beside which they are small left out."""
    least = max(tolerance, SMALL_SHARE * max(slacks.values(), default=0.0))
    slacks = {name: slack for name, slack in slacks.items() if slack > least}
    sides = LimitSides(solution.program, conditions=True).sides
    values = np.r_[solution.answer.rows, solution.variables / solution.program.scale]
    violations = []
    for name, slack in slacks.items():

        def excess(side: Side) -> float:
            amount = values[side.place] - side.bound
            return float(abs(amount) if side.equality else side.sign * amount)

        side = max(sides[name], key=excess)
        time = solution.phases[side.phase].time_at(side.intervals[0], side.tau)
        interval = side.intervals[0] if side.repeated else None
        label = label_of(solution, side.phase, name)
        violations.append(Violation(label, slack * side.size, side.unit, time, interval, side.tau, slack))
    # both sides of a limit are often violated by the same amount, but for rounding
    return sorted(violations, key=lambda v: -float(f"{v.scaled:.5g}"))


def violations_of(solution: Solution) -> list[Violation]:
    """Return the rows that are not met, the largest violation first."""
    program, rows = solution.program, solution.answer.rows
    amounts = violations(rows, program.lower)
    result = []
    for k in np.flatnonzero(~(amounts <= VIOLATION_TOLERANCE)):
        row, scaled = program.rows[k], float(amounts[k])
        interval = row.interval if row.repeated else None
        label = label_of(solution, row.phase, row.side(rows[k]))
        time = solution.phases[row.phase].time_at(row.interval, row.tau)
        result.append(Violation(label, scaled * row.size, row.unit, time, interval, row.tau, scaled))
    return sorted(result, key=lambda v: -v.scaled)
