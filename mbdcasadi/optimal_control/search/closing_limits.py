"""Limits that close in: the problem is solved without them, and from there with all of them."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ...numerics.tolerances import MET
from ..measures.branch import branch_jump
from ..motion.guess import Guess
from ..program.variant import WITHOUT_LIMITS
from .budgets import BUDGETS
from .proposal import Outcome, Proposal, Violations
from .refine import is_coarse
from .strategy import Proposals, Strategy
from .trials import Trials

#: Weights of the cost beside the sum of scaled violations, which fall as the price of these rises as long as their sum
#: falls below a share of what it was.
COST_WEIGHTS, FALLING = (0.1, 0.01, 0.001), 0.9
#: Sum of scaled violations up to which the problem itself is solved from a motion: a least violation that is not zero
#: may be a local one, which a solver that may violate the equations of motion on its way gets round.
NEAR = 1.0
#: Share up to which sums of violations are the same.
SAME_VIOLATION = 0.01
#: Weight of the distance from the guess that leaves a least violation as it is.
NEARNESS = 1e-8


class ClosingLimits(Strategy):
    """Solves without limits, and from there with all of them; then with violations at a price that rises.

    The meshes of the search are halved if they are coarse for the motion without limits, since limits that are just met
    there may not be met on a coarse one.
    """

    name = "closing limits"
    goes_on = True
    ends_at_solution = True

    def applies(self, trials: Trials) -> bool:
        """Return True if nothing is solved."""
        return not trials.solved

    def proposals(self, trials: Trials) -> Proposals:
        """Propose variants from the first guess, and from the natural motion if there is one."""
        guesses = trials.guesses[:1]
        if trials.motions.is_underactuated and not trials.are_given:
            guesses.append(trials.motions.natural(trials.motions.ways(trials.motions.durations(0))))
        for guess in guesses:
            if trials.has_limits:
                yield from self._closed_in(trials, guess)
            yield from priced(trials, guess, guess.description)

    def _closed_in(self, trials: Trials, guess: Guess) -> Proposals:
        free = yield Proposal(guess, "no limits", BUDGETS.variant, WITHOUT_LIMITS)
        if free.succeeded and trials.refines and is_coarse(free.last):
            trials.meshes = [mesh.split(2) for mesh in trials.meshes]
            free = yield Proposal(guess, "no limits, finer mesh", BUDGETS.variant, WITHOUT_LIMITS)
        if not free.succeeded:
            return
        trials.without_limits = free.last
        motion = trials.solver.motion_of(free.last)
        yield Proposal(motion, "all limits, closed in", BUDGETS.closing)
        yield from priced(trials, motion, "no limits")


def priced(trials: Trials, guess: Guess, description: str) -> Generator[Proposal, Outcome, None]:
    """Propose violations at a price that rises, and the problem itself from a motion near to all demands."""
    before, sums = np.inf, trials.sums
    for weight in COST_WEIGHTS:
        text = f"violations at a price, from {description}"
        outcome = yield Proposal(guess, text, BUDGETS.price, Violations(NEARNESS, weight))
        total = outcome.violation
        if (not outcome.succeeded and total > NEAR) or branch_jump(outcome.last) is not None:
            return
        if total < trials.least:
            trials.least, trials.nearest = total, outcome.last
        guess = trials.solver.motion_of(outcome.last)
        if total <= MET or total > FALLING * before:
            break
        before = total
    known = total > MET and any(abs(total - other) <= SAME_VIOLATION * other for other in sums)
    sums.append(total)
    if not known and total <= NEAR:  # from the same local minimum the solver would end as it did before
        yield Proposal(guess, "all limits, from a motion near to them", BUDGETS.closing)
