"""The least violation of all demands: what is in conflict if it ends above zero from several starts.

A solver that stops at an infeasible point has found that no motion near that point meets all demands, and nothing else.
Only if the sum of all violations ends above zero, and at the same least one from several starts, does the problem seem
infeasible, unless the linkage could fold on the way and get there on its other branch. The least violation of limits
alone, with all conditions met, then says which of them would have to be wider.
"""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterable, Sequence

from ...numerics.tolerances import MET
from ..measures.branch import branch_jump
from ..measures.singularity import folding_pose_of
from ..motion.guess import Guess
from ..solve.expressions import kinks_in_path
from ..solve.failure import infeasible
from .budgets import BUDGETS
from .closing_limits import NEARNESS, SAME_VIOLATION
from .proposal import Outcome, Proposal, Violations
from .strategy import Proposals, Strategy
from .trials import Trials

#: Weights of the distance from the guess in a least violation, and from each motion found in the next one: the first
#: ones lead on safely, the last one leaves the least violation as it is.
WEIGHTS = (1e-4, 1e-6, NEARNESS)
#: Starts from which the same least violation must be found, and none below, for a problem to seem infeasible; one more
#: if others end in larger ones, since several minima show that there may be further ones. And starts at random, and
#: other ends, among those that are tried.
STARTS, RANDOM_STARTS, OTHER_ENDS = 2, 3, 2
#: What is found from them, in words.
LEAST_VIOLATION = "the least violation of all its demands together"


class LeastViolation(Strategy):
    """Least violation of all demands from several starts, and the problem itself from a motion that meets all."""

    name = "least violation"
    goes_on = True
    ends_at_solution = True

    def applies(self, trials: Trials) -> bool:
        """Return True if a solve has failed, and nothing is solved."""
        return not trials.solved and bool(trials.failures)

    def proposals(self, trials: Trials) -> Proposals:
        """Propose violations near to all starts first, which often end at a motion that meets all; then farther away.

        Raises
        ------
        OptimizationError
            If the least violation is not zero and the same from several starts, unless the solve that failed had met
            all demands at its end, or the linkage could fold on the way.
        """
        solver, failure = trials.solver, trials.failures[0]
        arguable = bool(failure.largest_violations) and not kinks_in_path(solver.problem)
        guesses: Iterable[Guess] = _starts(trials)
        for weights in (WEIGHTS[:1], WEIGHTS[1:]):
            conflicting: list[Outcome] = []
            for guess in guesses:
                outcome = yield from _least(trials, guess, weights)
                if branch_jump(outcome.last) is not None:
                    continue  # it is not a motion of the mechanism
                if outcome.violation <= MET:
                    arguable = False
                    motion = solver.motion_of(outcome.last)
                    yield Proposal(motion, "all limits, from a motion that meets them", BUDGETS.closing)
                elif outcome.succeeded:
                    conflicting.append(outcome)
            if not arguable or len(conflicting) < STARTS:
                return
            guesses = [solver.motion_of(outcome.last) for outcome in conflicting]
        yield from _concluded(trials, conflicting)


def _starts(trials: Trials) -> Iterable[Guess]:
    nearest = trials.guesses[0] if trials.nearest is None else trials.solver.motion_of(trials.nearest)
    motions = trials.motions
    lazily = (motions.at_rest() for _ in range(1))
    ends = (guess for _ in range(1) for guess in motions.to_other_ends(OTHER_ENDS))
    return itertools.chain([nearest], lazily, motions.at_random(trials.meshes, RANDOM_STARTS), ends)


def _concluded(trials: Trials, conflicting: Sequence[Outcome]) -> Proposals:
    """Raise what is in conflict if enough starts agree; propose the problem from a motion if that meets all demands."""
    least = min(conflicting, key=lambda outcome: outcome.violation)
    agreeing = sum(outcome.violation <= (1 + SAME_VIOLATION) * least.violation for outcome in conflicting)
    is_local = trials.least < (1 - SAME_VIOLATION) * least.violation
    if is_local or agreeing < STARTS + (agreeing < len(conflicting)):
        return
    if any(folding_pose_of(part) is not None for outcome in conflicting for part in outcome.last.phases):
        return  # all demands may be met beyond that pose on its other branch
    free = trials.without_limits
    widened = yield from least_limits(trials, least.last if free is None else free)
    if widened is not None and widened.violation <= MET:
        motion = trials.solver.motion_of(widened.last)
        yield Proposal(motion, "all limits, from a motion that meets them", BUDGETS.closing)
        return
    reason = f"{LEAST_VIOLATION}, from {agreeing} starts, is not zero"
    found = None if widened is None else (widened.last, widened.slacks)
    raise infeasible(trials.failures[0], (least.last, least.slacks), found, reason, MET) from None


def least_limits(trials: Trials, solution) -> Generator[Proposal, Outcome, Outcome | None]:
    """Propose the least violation of limits alone, near to a motion, with all conditions met; None if not found."""
    outcome = yield from _least(trials, trials.solver.motion_of(solution), WEIGHTS, limits_alone=True)
    return outcome if outcome.succeeded else None


def _least(
    trials: Trials, near: Guess, weights: Sequence[float], *, limits_alone: bool = False
) -> Generator[Proposal, Outcome, Outcome]:
    """Propose the least violation from a guess, less and less near to it."""
    text = f"least violation{' of limits alone' if limits_alone else ''}"
    for weight in weights:
        outcome = yield Proposal(near, text, BUDGETS.violation, Violations(weight, limits_alone=limits_alone))
        if not outcome.succeeded or outcome.violation <= MET:
            break
        near = trials.solver.motion_of(outcome.last)
    return outcome
