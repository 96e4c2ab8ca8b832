"""An open chain that is not solved in its angles alone, in all coordinates."""

from __future__ import annotations

from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials


class AllCoordinates(Strategy):
    """Solves of an open chain in all coordinates, in which its equations are less nonlinear."""

    name = "all coordinates"
    ends_at_solution = True

    def applies(self, trials: Trials) -> bool:
        """Return True if the chain was tried in its angles, in vain."""
        return not trials.solved and bool(trials.others())

    def proposals(self, trials: Trials) -> Proposals:
        """Propose the usual guesses."""
        for solver, guesses in trials.others():
            for guess in guesses:
                yield Proposal(guess, f"{guess.description}, in all coordinates", trials.first_limit, solver=solver)
