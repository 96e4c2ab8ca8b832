"""Starts of different kinds, durations and ends at random."""

from __future__ import annotations

import itertools

import numpy as np

from ..motion.guess import Guess
from ..program.variant import WITHOUT_LIMITS
from .budgets import BUDGETS
from .natural_motions import has_swings
from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials

#: Number of random starts of a mechanism that swings, and of those besides the swings of an open chain; and number of
#: solutions of the same lowest cost after which no further one is sought.
FEW, MORE, AGREEING = 5, 2, 3
#: Number of random starts of a problem that no other way has solved.
MANY = 12
#: Multiple of the iterations of the first solves that one from a random start may take: those that take more seldom end
#: at lower costs. And multiple of the lowest cost above which it is given up: of some 500 of 93 chains that were above
#: it after 20 iterations one ended at a cost that was lower by more than half a per cent.
PATIENCE, HOPELESS = 2.0, 4.0


class RandomStarts(Strategy):
    """Solves from as many starts as the user asks for; by default a few, if the mechanism swings."""

    name = "random starts"

    def applies(self, trials: Trials) -> bool:
        """Return True if starts are left, or for a mechanism that swings, if it is solved already or an open chain."""
        if trials.starts is not None:
            return trials.starts > len(trials.guesses)
        return not trials.are_given and has_swings(trials) and (bool(trials.solved) or trials.motions.is_open_chain)

    def proposals(self, trials: Trials) -> Proposals:
        """Propose starts until the lowest cost was found several times, or as many as the user asks for."""
        if trials.starts is not None:
            for proposal in self.independent(trials):  # noqa: UP028 - a list takes no outcomes
                yield proposal
            return
        longest = max((outcome.last.statistics.iterations for outcome in trials.solved), default=BUDGETS.first)
        limit, swings = min(BUDGETS.further, int(PATIENCE * longest)), trials.motions.swinging()
        count = 0 if not trials.solved else MORE if swings else FEW
        random = trials.motions.at_random(trials.meshes, count, are_first=False)
        for guess in itertools.chain(swings, random):
            if trials.agreeing >= AGREEING:
                return
            best = trials.lowest_cost
            ceiling = HOPELESS * best if best > 0 else np.inf
            if swings and trials.has_limits:
                yield from closed_in(trials, guess, limit, ceiling)
            else:
                yield Proposal(guess, guess.description, limit, ceiling=ceiling)

    def independent(self, trials: Trials) -> list[Proposal]:
        """Solves that do not depend on each other."""
        count = (trials.starts or 0) - len(trials.guesses)
        guesses = trials.motions.at_random(trials.meshes, count)
        return [Proposal(guess, guess.description, BUDGETS.further) for guess in guesses]


def closed_in(trials: Trials, guess: Guess, limit: int, ceiling: float) -> Proposals:
    """Propose the problem without its limits from a guess, and from there with them.

    Of 96 solves of 12 chains under limits that their free optima pass, 50 succeed so, and 10 with the limits from the
    beginning.
    """
    text = f"no limits, {guess.description}"
    free = yield Proposal(guess, text, limit, WITHOUT_LIMITS, ceiling=ceiling)
    if free.succeeded:
        motion = trials.solver.motion_of(free.last)
        yield Proposal(motion, f"closed in, {guess.description}", limit, ceiling=ceiling)


class LastStarts(Strategy):
    """Solves from further starts of a problem that no other way has solved, or of which no solution is a motion.

    On a mesh twice as fine, and from the usual guess first, if there are solutions, as on another branch of a linkage.
    """

    name = "last starts"
    goes_on = True
    ends_at_solution = True

    def applies(self, trials: Trials) -> bool:
        """Return True if nothing else has led to a motion."""
        return trials.best is None

    def proposals(self, trials: Trials) -> Proposals:
        """Propose the first guess, the poses at rest, and random starts."""
        finer, motions = bool(trials.solved), trials.motions
        meshes = [mesh.split(1 + finer) for mesh in trials.meshes]
        usual, at_rest = trials.guesses[:1], (motions.at_rest() for _ in range(1))
        others = itertools.chain(at_rest, motions.at_random(meshes, MANY))
        for guess in itertools.chain(usual, others) if finer else itertools.chain(others, usual):
            text = f"finer mesh, {guess.description}" if finer else f"all limits, {guess.description}"
            yield Proposal(guess, text, BUDGETS.variant, meshes=meshes)
