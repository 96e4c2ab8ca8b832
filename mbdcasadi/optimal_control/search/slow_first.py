"""Motions that are too fast for a mesh: solved slowly first, then faster and faster.

Between the points of a coarse mesh a link may whip round at no cost, and such a solution seldom leads to a motion on
finer meshes. With limits of speeds and accelerations that the mesh resolves there is none; from the motion that is
found the limits rise, on meshes that are refined for it, until the motion stays below them or they are gone.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from ..motion.guess import Guess
from ..program.variant import ITSELF, Variant
from ..solution import Solution, same_cost
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh
from .budgets import BUDGETS
from .coarse_mesh import is_lost, refine_if_coarse
from .proposal import Outcome, Proposal
from .strategy import Proposals, Strategy
from .trials import Trials

#: Steps from mesh point to mesh point, and changes of these, that a mesh resolves, in rad or sizes of the mechanism;
#: and multiples of those of the guess that are allowed in any case.
RESOLVED_STEP, GUESSED = 0.4, 2.0
#: Pieces into which the intervals of the first mesh are split, more of them if no guess leads to a solution.
PIECES = (2, 4)
#: Factor by which these speeds and accelerations rise in turn, number of times, and number of others in between that
#: are tried if a step is too large.
FACTOR, RISES, INSERTED = 2.0, 2, 3
#: Work, in iterations times intervals, after which no further guess is tried, unless the solves before took more: a
#: minute for a four-bar.
WORK = 600_000
#: Random starts that are tried besides the first guesses.
STARTS = 3


class SlowFirst(Strategy):
    """Solves with limits of speeds that the mesh resolves, which rise until the motion stays below them."""

    name = "slow first"

    def applies(self, trials: Trials) -> bool:
        """Return True if no mesh holds, and finer ones are allowed."""
        best = trials.best
        return trials.refines and bool(trials.solved) and (not trials.jumps if best is None else not best[2])

    def proposals(self, trials: Trials) -> Proposals:
        """Propose variants from the first guesses and random starts on finer meshes."""
        best = trials.solver.best
        allowed, seen = best.work + max(best.work, WORK), list[float]()
        guesses = [*trials.guesses, *trials.motions.at_random(trials.meshes, STARTS)]
        for pieces, guess in itertools.product(PIECES, guesses):
            if best.work > allowed:
                return
            yield from _from(trials, [mesh.split(pieces) for mesh in trials.meshes], guess, seen)
            if trials.best is not None and trials.best[2]:
                return


def _from(trials: Trials, meshes: Sequence[Mesh], guess: Guess, seen: list[float]) -> Proposals:
    """Propose variants from a guess, of which `seen` are the costs from others with the first limits of speeds."""
    solver, variant = trials.solver, Variant(speeds=resolved_speeds(trials.solver, meshes, guess))
    found = yield Proposal(guess, f"slow first, {guess.description}", BUDGETS.variant, variant, meshes)
    settled = _settled(solver, found, variant)
    if settled is None or any(same_cost(settled[0].cost, cost) for cost in seen):
        return
    seen.append(settled[0].cost)
    rises = [FACTOR] * RISES
    inserted = 0
    while not (settled[1] and solver.keeps_below(settled[0], variant)):
        faster = variant.faster(rises[0]) if rises else ITSELF
        solution = settled[0]
        more = Proposal(solver.motion_of(solution), "faster", BUDGETS.variant, faster, solution.meshes, is_warm=True)
        found = yield more
        dearer = found.succeeded and found.last.cost > solution.cost and not same_cost(found.last.cost, solution.cost)
        further = None if dearer else _settled(solver, found, faster)
        if faster.is_itself:
            return  # it counts as a solution, if it is one
        if further is None and inserted < INSERTED:
            inserted += 1
            rises[0] = rises[0] ** 0.5
            continue
        if further is None:
            return
        variant, settled, rises = faster, further, rises[1:]
    if not variant.is_itself:  # a motion below its limits of speeds is one without them
        last = settled[0]
        yield Proposal(
            solver.motion_of(last),
            "slow first, without limits of speeds",
            BUDGETS.variant,
            meshes=last.meshes,
            is_warm=True,
        )


def _settled(solver: ProblemSolver, found: Outcome, variant: Variant) -> tuple[Solution, bool] | None:
    """The solution of a variant on a mesh that is refined for it, and whether this holds; None if it is no motion."""
    if not found.succeeded:
        return None
    settled = refine_if_coarse(solver, found.last, variant)
    return None if is_lost(settled[0]) else settled


def resolved_speeds(solver: ProblemSolver, meshes: Sequence[Mesh], guess: Guess) -> tuple[np.ndarray, ...]:
    """Speeds and accelerations that meshes resolve, or those of the guess if it is faster, by phase (2, n)."""
    speeds = []
    for setup, mesh, part in zip(solver.setups, meshes, guess.phases, strict=True):
        times, chosen = mesh.times(part.segment_times), list(setup.scheme.eom.independent)
        if not mesh.count:
            speeds.append(np.full((2, len(chosen)), np.inf))
            continue
        step = np.max(np.diff(times))
        q = part.sample(times)["q"][:, chosen]
        guessed = [np.max(np.abs(np.diff(q, order, axis=0)), axis=0, initial=0.0) for order in (1, 2)]
        steps = np.maximum(RESOLVED_STEP * setup.scales.q[chosen], GUESSED * np.array(guessed))
        speeds.append(steps / step ** np.array([[1], [2]]))
    return tuple(speeds)
