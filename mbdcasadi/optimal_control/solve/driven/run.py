"""Solve a program among motions: the motion of least effort first, and the optimum of the program near it."""

from __future__ import annotations

import time as clock
from dataclasses import replace

import numpy as np

from ....numerics.console import interruptible
from ....numerics.symbolic import numeric_work
from ...program.statistics import SolveStatistics
from ..solvers.base import Beginning, NLPSolver, Result
from .motions import DrivenMotions, FoundMotion

#: Share by which the effort in a program may differ from that of the motion if its mesh sees the motion, and largest
#: number of iterations for the optimum of the program from there.
SEEN, EXACT_ITERATIONS = 1e-3, 50
#: Scaled violation up to which a motion meets a program.
MET = 1e-8
#: Statuses of a motion whose effort still falls, and of one whose effort does not.
STATUSES = ("Least_Effort_Approached", "Least_Effort_Found")


def run_among_motions(
    motions: DrivenMotions, solver: NLPSolver, begin: Beginning, *, is_near: bool, must_be_exact: bool
) -> Result | None:
    """Return the motion of least effort, or the optimum of the program near it.

    On a coarse mesh the optimum of a program may be no motion. It is taken if it is no dearer as one, or if solutions
    have to be exact.

    Parameters
    ----------
    motions : DrivenMotions
        Motions of the problem.
    solver : NLPSolver
        Solver of the program.
    begin : Beginning
        Program and guess.
    is_near : bool
        True if the guess is near a solution.
    must_be_exact : bool
        True if the result has to be an optimum of the program.

    Returns
    -------
    Result or None
        None if inputs do not follow from the motion.
    """
    times = begin.meshes[0].times(begin.guess.segment_times[0])
    with interruptible(raising=False) as interruption, numeric_work():
        found = motions.search(
            begin.program, begin.x, times, coarse_first=not is_near, stopped=lambda: interruption.requested
        )
    result = None if found is None else _as_result(motions, begin, found, interrupted=interruption.requested)
    if interruption.requested and result is None:
        raise KeyboardInterrupt
    if found is None or result is None or result.interrupted:
        return result
    effort = float(result.answer["f"][0]) * begin.program.cost_scale - motions.least
    if abs(effort - found.effort) > SEEN * found.effort and not must_be_exact:
        return result
    limit = None if must_be_exact else EXACT_ITERATIONS
    exact = solver.run(begin.again(x=found.x), begin.bounds, "warm", begin.iterate, limit)
    if must_be_exact:
        return exact.after(result)
    of_motion = motions.effort_of(begin.program, exact.answer["x"], times)
    is_taken = exact.succeeded and of_motion <= (1 + SEEN) * found.effort
    return exact.after(result) if is_taken else replace(result.after(exact), interrupted=exact.interrupted)


def _as_result(motions: DrivenMotions, begin: Beginning, found: FoundMotion, *, interrupted: bool) -> Result | None:
    """A motion of least effort as the end of a run; None if it is none of the program."""
    program, x, bounds = begin.program, found.x, begin.bounds
    cost, rows = (value.full().ravel() for value in program.nlp.evaluate(x, begin.data))
    if program.violation(rows) > MET or np.any((x < bounds.lower - MET) | (x > bounds.upper + MET)):
        return None
    of_bounds, of_rows = motions.multipliers(program, found, begin.data)
    answer = {"x": x, "f": cost, "g": rows, "lam_x": of_bounds, "lam_g": of_rows}
    seconds, status = clock.perf_counter() - begin.began, STATUSES[found.converged]
    sizes, solver = (program.size, program.lower.size), "levenberg-marquardt"
    statistics = SolveStatistics(found.iterations, status, seconds, 0.0, *sizes, solver=solver, at_saddle=False)
    return Result(answer, statistics, succeeded=not interrupted, interrupted=interrupted)
