"""Several starts: other ways from the first pose to the last one."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...errors import ModelError
from ...numerics.newton import solve
from ...numerics.rank import analyse_rank
from ..checks.failure import OptimizationError
from ..nlp.solver import Solver
from ..refinement.mesh import Mesh
from ..solution import Solution
from ..solve_statistics import Start
from .guess import Guess, kinematic_guess


def guesses(solver: Solver, starts: Any, guess: Any) -> list[Guess]:
    """Guesses to start from: the usual one and others at random, or those that are given."""
    if starts is None:
        return [solver.guess(guess)]
    if isinstance(starts, int) and not isinstance(starts, bool):
        if starts < 1:
            raise ModelError(f"optimize: starts must be at least 1, got {starts}")
        random = np.random.default_rng(0)
        return [solver.guess(guess), *[wandering(solver, random) for _ in range(starts - 1)]]
    try:
        given = list(starts)
    except TypeError:
        raise ModelError(f"optimize: starts= takes a number or a list of guesses, got {starts!r}") from None
    if not given:
        raise ModelError("optimize: starts= is an empty list")
    return [solver.guess(one) for one in given]


def wandering(solver: Solver, random: np.random.Generator) -> Guess:
    """The kinematic motion with a detour: a few half waves in the free directions of each pose."""
    numeric, times, poses = solver.numeric, *solver.way
    waves = random.integers(1, 4)
    direction = random.normal(size=poses.shape[1]) * np.where(
        solver.prepared.scales.angles, 1.0, 0.5 * solver.prepared.scales.q
    )
    amplitude = random.uniform(0.5, 2.0)
    detour = amplitude * np.sin(np.pi * waves * times / times[-1])
    moved, before = [], 0.0
    q = poses[0]
    for k, pose in enumerate(poses):
        free = analyse_rank(numeric.velocity(float(times[k]), q)[0]).null_columns
        step = (pose - poses[max(k - 1, 0)]) + free @ (free.T @ direction) * (detour[k] - before)
        before = detour[k]
        rows = partial(numeric.position, float(times[k]))
        outcome = solve(rows, q + step, numeric.weights, iterations=30, step_limit=numeric.typical_step)
        q = outcome.x if outcome.converged else q
        moved.append(q)
    guess = kinematic_guess(solver.problem, solver.balance, solver.start, solver.prepared.marks, times, np.array(moved))
    return replace(guess, word=f"kinematic with a detour of {waves} half wave{'s' if waves > 1 else ''}")


def best_of(solver: Solver, mesh: Mesh, candidates: list[Guess], *, warm: bool) -> Solution:
    """Solve from every guess and keep the best; all are reported in the statistics.

    A guess that is another solution is tried with the settings of a warm start
    first, and where these fail once more without them.

    Raises
    ------
    OptimizationError
        Where none succeeds: that of the last.
    """
    found: list[Solution] = []
    reports, errors = [], []
    attempts = [(guess, warm) for guess in candidates]
    while attempts:
        guess, is_warm = attempts.pop(0)
        word = f"{guess.word}, warm" if is_warm else guess.word
        try:
            solution = solver.solve(mesh, guess, warm=is_warm)
            found.append(solution)
            reports.append(Start(word, solution.cost, solution.statistics.iterations, solution.statistics.status))
        except OptimizationError as error:
            errors.append(error)
            s = error.partial.statistics
            reports.append(Start(word, float("nan"), s.iterations, s.status))
            attempts += [(guess, False)] if is_warm else []
    if not found:
        raise errors[-1]
    best = min(found, key=lambda solution: solution.cost)
    if len(reports) > 1:
        best.statistics = replace(best.statistics, starts=reports)
    return best
