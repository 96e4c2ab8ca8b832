"""Shorter and longer motions than the best one: a mechanism that swings has an optimum for each number of swings."""

from __future__ import annotations

from ..solution import SAME_COST
from .budgets import BUDGETS
from .natural_motions import has_swings
from .proposal import Outcome, Proposal
from .strategy import Proposals, Strategy
from .trials import Trials

#: Factors of the duration of the best solution that are tried, each as long as it leads to lower costs.
FACTORS = (0.8, 1.25)


class OtherDurations(Strategy):
    """Solves from natural motions that are shorter or longer than the best one, if durations are free."""

    name = "other durations"

    def applies(self, trials: Trials) -> bool:
        """Return True if a mechanism that swings is solved, and its duration is free."""
        asked = trials.are_given or trials.starts is not None
        return not asked and bool(trials.solved) and trials.motions.has_free_durations and has_swings(trials)

    def proposals(self, trials: Trials) -> Proposals:
        """Propose motions as long as they become cheaper."""
        motions = trials.motions
        for factor in FACTORS:
            best: Outcome = trials.solved[0]
            while True:
                before = list(best.last.durations)
                durations = motions.scaled_durations(before, factor)
                if durations == before:
                    break
                guess = motions.natural(motions.ways(durations))
                text = f"{guess.description}, {'shorter' if factor < 1 else 'longer'}"
                found = yield Proposal(guess, text, BUDGETS.further)
                if not found.is_solution or not found.last.cost < best.last.cost * (1 - SAME_COST):
                    break
                best = found
