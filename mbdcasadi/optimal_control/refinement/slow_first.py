"""Motions that are too fast for a mesh: solved slowly first, then faster and faster.

Between the points of a coarse mesh a link may whip round at no cost, and such a solution leads to no motion on any
finer mesh. With limits of speeds and accelerations that the mesh resolves there is none; from the motion that is found
the limits rise, on meshes that are refined for it, until they are gone.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from copy import copy

import numpy as np

from ..checks.failure import OptimizationError
from ..guess.guess import Guess
from ..nlp.problem_solver import ProblemSolver
from ..solution import Solution, same_cost
from .coarse_mesh import is_lost, refine_further, refine_if_coarse
from .mesh import Mesh

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

    A solution that owes its cost to the errors of a coarse mesh is a poor guess for a finer one, and ranks behind any
    on a mesh that holds. If no guess leads to one either, limits close in from a solution without them.
    """
    lost = is_lost(solution)
    refined, holds = (solution, False) if lost else refine_further(solver, solution)
    allowed, seen = solver.best.work + max(solver.best.work, WORK), list[float]()
    for pieces, guess in () if holds else itertools.product(PIECES, guesses()):
        if solver.best.work > allowed:
            break
        found = solve_slowly_first(solver, [mesh.split(pieces) for mesh in meshes], guess, seen, allowed)
        if found is not None and found[1]:
            found[0].statistics = found[0].statistics.after(solution.statistics)
            return found[0]
    closed = _closed_in(solver, None if holds or solver.best.work > allowed else without_limits())
    if closed is not None:
        closed.statistics = closed.statistics.after(solution.statistics)
        return closed
    return refine_if_coarse(solver, solution)[0] if lost else refined


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
    """The solution without limits of speeds and accelerations, from one with them; as :func:`solve_slowly_first`."""
    assert slow.pace is not None
    pace, reached, multiples, inserted = slow.pace, 1.0, [*MULTIPLES], 0
    while multiples:
        multiple = multiples.pop(0)
        slow.pace = [multiple * of_phase for of_phase in pace]
        slow.best.new_stage()
        near = slow.motion_of(solution)
        try:
            found = slow.solve(solution.meshes, near, warm=True, limit=ITERATIONS)
        except OptimizationError:
            if inserted == INSERTED or slow.best.work > allowed:
                return None
            multiples[:0], inserted = [reached * min((multiple / reached) ** 0.5, 2.0), multiple], inserted + 1
            continue
        found.statistics = found.statistics.after(solution.statistics)
        solution, holds = refine_if_coarse(slow, found)
        reached = multiple
        if is_lost(solution) or (slow.best.work > allowed and multiples):
            return None
    return solution, holds


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
