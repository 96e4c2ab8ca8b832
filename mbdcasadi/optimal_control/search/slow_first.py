"""Motions that are too fast for a mesh: solved slowly first, then faster and faster.

Between the points of a coarse mesh a link may whip round at no cost, and such a solution seldom leads to a motion on
finer meshes. With limits of speeds and accelerations that the mesh resolves there is none; from the motion that is
found the limits rise, on meshes that are refined for it, until the motion stays below them or they are gone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from ...errors import OptimizationError
from ..motion.guess import Guess
from ..solution import Solution, same_cost
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh
from .coarse_mesh import is_lost, refine_further, refine_if_coarse

#: Steps from mesh point to mesh point, and changes of these, that a mesh resolves, in rad or sizes of the mechanism;
#: and multiples of those of the guess that are allowed in any case.
RESOLVED_STEP, GUESSED = 0.4, 2.0
#: Pieces into which the intervals of the first mesh are split, more of them if no guess leads to a solution.
PIECES = (2, 4)
#: Multiples of these speeds and accelerations that are allowed in turn after them, number of others in between that are
#: tried if a step is too large, and iterations with each.
MULTIPLES, INSERTED, ITERATIONS = (2.0, 4.0, np.inf), 3, 200
#: Work, in iterations times intervals, after which no further solve is begun, unless those before took more: a minute
#: for a four-bar. The best speed of a crank with a weak motor, which differs from mesh to mesh, took several.
WORK = 600_000


def refine_or_begin_anew(
    solver: ProblemSolver,
    solution: Solution,
    meshes: Sequence[Mesh],
    guesses: Callable[[], list[Guess]],
    without_limits: Callable[[], Solution | None],
) -> Solution:
    """Refine the best solution of all starts; if its mesh does not become fine enough, solve from guesses anew.

    A solution that owes its cost to the errors of a coarse mesh leads to a motion on finer ones at times, and ranks
    behind any on a mesh that holds. If no guess leads to one either, limits close in from a solution without them.
    """
    refined = refine_if_coarse(solver, solution)[0] if is_lost(solution) else solution
    refined, holds = refine_further(solver, refined)
    allowed, seen = solver.best.work + max(solver.best.work, WORK), list[float]()
    for pieces, guess in () if holds else itertools.product(PIECES, guesses()):
        if solver.best.work > allowed:
            break
        found = solve_slowly_first(solver, [mesh.split(pieces) for mesh in meshes], guess, seen, allowed)
        if found is not None and found[1]:
            found[0].statistics = found[0].statistics.after(solution.statistics)
            solver.best.add(found[0])
            return found[0]
    closed = _closed_in(solver, None if holds or solver.best.work > allowed else without_limits())
    if closed is not None:
        closed.statistics = closed.statistics.after(solution.statistics)
        return closed
    return refined


def _closed_in(solver: ProblemSolver, free: Solution | None) -> Solution | None:
    """Solution on a mesh that holds, from one without limits; None if there is none."""
    if free is None or is_lost(free):
        return None
    try:
        found = solver.close_in(free, ITERATIONS)
    except OptimizationError:
        return None
    settled, holds = refine_if_coarse(solver, found)
    return settled if holds else None


def solve_slowly_first(
    solver: ProblemSolver, meshes: Sequence[Mesh], guess: Guess, seen: list[float], allowed: float = np.inf
) -> tuple[Solution, bool] | None:
    """Solve from a guess with limits of the speeds and accelerations that a mesh resolves, which rise step by step.

    `seen` are the costs with the first ones of other guesses, to which that of this one is added.

    Returns
    -------
    Solution, bool
        The solution without these limits, and whether its mesh is fine enough; None if the motion is lost on the way
        or is that of another guess, or the work of the search is more than is allowed.
    """
    slow = copy(solver)
    slow.pace = _resolved_pace(solver, meshes, guess)
    solver.best.new_stage()
    try:
        found = slow.solve(meshes, guess, limit=ITERATIONS)
    except OptimizationError:
        return None
    solution, holds = refine_if_coarse(slow, found)
    if is_lost(solution) or solver.best.work > allowed or any(same_cost(solution.cost, cost) for cost in seen):
        return None
    seen.append(solution.cost)
    return _released(slow, solution, holds, allowed)


def _released(slow: ProblemSolver, solution: Solution, holds: bool, allowed: float) -> tuple[Solution, bool] | None:
    """The solution without limits of speeds and accelerations, from one with them; as :func:`solve_slowly_first`.

    One that stays below these limits is that without: a solve without limits may lead far away from it.
    """
    assert slow.pace is not None
    pace, reached, multiples, inserted = slow.pace, 1.0, [*MULTIPLES], 0
    is_free = slow.is_below_pace(solution)
    while multiples and not (holds and is_free):
        multiple = multiples.pop(0)
        slow.pace = [multiple * of_phase for of_phase in pace]
        faster = _with_more_speed(slow, solution)
        is_too_much = faster is None or not (faster[1] or np.isfinite(multiple))
        if is_too_much and inserted < INSERTED and slow.best.work <= allowed:
            more = _in_between(reached, multiple, INSERTED - inserted)
            multiples[:0], inserted = [*more, multiple], inserted + len(more)
            continue
        if faster is None or (slow.best.work > allowed and multiples):
            return None
        solution, holds = faster
        reached, is_free = multiple, slow.is_below_pace(solution)
    return solution, holds


def _in_between(reached: float, multiple: float, most: int) -> list[float]:
    """Multiples between one that was reached and one that was not: their mean, or if that is infinite doubled ones."""
    if np.isfinite(multiple):
        return [reached * min((multiple / reached) ** 0.5, 2.0)]
    return [reached * 2.0**k for k in range(1, most + 1)]


def _with_more_speed(slow: ProblemSolver, solution: Solution) -> tuple[Solution, bool] | None:
    """The solution with the present limits of speeds and accelerations, from one with lower ones.

    On a mesh that is refined for it, and whether this is fine enough; None if there is none, or the motion is lost.
    """
    slow.best.new_stage()
    try:
        found = slow.solve(solution.meshes, slow.motion_of(solution), warm=True, limit=ITERATIONS)
    except OptimizationError:
        return None
    if _is_dearer(found, solution):
        return None
    found.statistics = found.statistics.after(solution.statistics)
    refined, holds = refine_if_coarse(slow, found)
    return None if is_lost(refined) else (refined, holds)


def _is_dearer(found: Solution, solution: Solution) -> bool:
    """True if a solution with higher limits costs more than the one from which it came, and is so another one."""
    return found.cost > solution.cost and not same_cost(found.cost, solution.cost)


def _resolved_pace(solver: ProblemSolver, meshes: Sequence[Mesh], guess: Guess) -> list[np.ndarray]:
    """Speeds and accelerations that meshes resolve, or those of the guess if it is faster, by phase (2, n)."""
    pace = []
    for setup, mesh, part in zip(solver.setups, meshes, guess.phases, strict=True):
        times, chosen = mesh.times(part.segment_times), list(setup.scheme.eom.independent)
        if not mesh.count:
            pace.append(np.full((2, len(chosen)), np.inf))
            continue
        step = np.max(np.diff(times))
        q = part.sample(times)["q"][:, chosen]
        guessed = [np.max(np.abs(np.diff(q, order, axis=0)), axis=0, initial=0.0) for order in (1, 2)]
        steps = np.maximum(RESOLVED_STEP * setup.scales.q[chosen], GUESSED * np.array(guessed))
        pace.append(steps / step ** np.array([[1], [2]]))
    return pace
