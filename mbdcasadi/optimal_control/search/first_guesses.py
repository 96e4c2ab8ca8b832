"""First guesses: those of the user, or the motion through the poses of the places on the way."""

from __future__ import annotations

from .budgets import BUDGETS
from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials


class FirstGuesses(Strategy):
    """Solves from the guesses of the user, or from the usual ones.

    A guess that is another solution is tried with the settings of a warm start first, and if these fail without them.
    Of the usual ones the last comes first; once one has led to a solution, others take fewer iterations.
    """

    name = "first guesses"

    def applies(self, trials: Trials) -> bool:
        """Return True: every search begins with them."""
        return True

    def proposals(self, trials: Trials) -> Proposals:
        """Propose the guesses."""
        ordered = trials.guesses if trials.are_given or trials.starts is not None else trials.guesses[::-1]
        for guess in ordered:
            if trials.is_warm:
                outcome = yield Proposal(guess, f"{guess.description}, warm", trials.first_limit, is_warm=True)
                if outcome.is_solution:
                    continue
            known = bool(trials.solved) and not trials.are_given and trials.starts is None
            yield Proposal(guess, guess.description, BUDGETS.further if known else trials.first_limit)

    def independent(self, trials: Trials) -> list[Proposal]:
        """Solves that do not depend on each other."""
        return [Proposal(guess, guess.description, trials.first_limit) for guess in trials.guesses]
