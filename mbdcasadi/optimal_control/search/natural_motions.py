"""Motions that the mechanism makes by itself, for mechanisms that inputs do not drive in all directions."""

from __future__ import annotations

from ..solution import same_cost
from .budgets import BUDGETS
from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials

#: Number of durations from which a problem that is not solved yet is tried, and of free motions of a mechanism that
#: swings.
DURATIONS, FREE_MOTIONS = 8, 4
#: Iterations of the usual guesses below which the program is nearly linear but for limits, and has no other optimum.
NEARLY_LINEAR = 20


class NaturalMotions(Strategy):
    """Solves from motions whose driven coordinates follow the poses and whose others move freely, and free ones.

    A path that leads from pose to pose evenly has none of the swings by which a mechanism moves that has fewer inputs
    than degrees of freedom; the free motion has those of its own.
    """

    name = "natural motions"

    def applies(self, trials: Trials) -> bool:
        """Return True for a mechanism that swings, or one that may get to its end by itself."""
        if trials.are_given or trials.starts is not None:
            return False
        return has_swings(trials) or trials.motions.has_loose_end

    def proposals(self, trials: Trials) -> Proposals:
        """Propose free motions, and natural ones in several durations until one leads to a solution."""
        motions, swings = trials.motions, has_swings(trials)
        for guess in motions.free_motions(trials.meshes)[: FREE_MOTIONS if swings else 1]:
            yield Proposal(guess, guess.description, BUDGETS.further)
        for k in range(0 if not swings else DURATIONS if motions.has_free_durations else 1):
            guess = motions.natural(motions.ways(motions.durations(k)))
            outcome = yield Proposal(guess, guess.description, BUDGETS.further)
            if outcome.is_solution:
                break


def has_swings(trials: Trials) -> bool:
    """Return True for a mechanism that may have to swing and whose program is not nearly linear.

    It counts as such if the usual guesses led to one cost in few iterations, or all in the same number.
    """
    counts = [outcome.last.statistics.iterations for outcome in trials.solved]
    agree = all(same_cost(outcome.last.cost, trials.solved[0].last.cost) for outcome in trials.solved)
    even = bool(counts) and (max(counts) < NEARLY_LINEAR or (len(counts) > 1 and len(set(counts)) == 1))
    return trials.motions.swings and not (even and agree)
