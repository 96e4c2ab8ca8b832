"""Mesh points at times at which something jumps, if other times are free."""

from __future__ import annotations

import numpy as np

from ..measures.time_jumps import meshes_at_jumps
from .budgets import BUDGETS
from .proposal import Proposal
from .strategy import Proposals, Strategy
from .trials import Trials


class TimePoints(Strategy):
    """Solves with mesh points that stay at times of jumps.

    Without them the cost jumps with the duration, each time a stage passes such a time: a solve fails, or ends in the
    best duration between two of these.
    """

    name = "mesh points at jumps"

    def applies(self, trials: Trials) -> bool:
        """Return True if times are free, unless a refinement follows, which places these points itself."""
        return (
            bool(trials.outcomes)
            and trials.solver.problem.has_free_times
            and (trials.tolerance is None or not trials.solved)
        )

    def proposals(self, trials: Trials) -> Proposals:
        """Propose the best motion so far on a mesh with these points."""
        best = trials.best
        near = trials.outcomes[0].last if best is None else best[1]
        meshes = meshes_at_jumps(near, np.inf)
        if meshes is not None:
            guess = trials.solver.motion_of(near)
            yield Proposal(guess, "mesh points at jumps", BUDGETS.first, meshes=meshes, settles=True)
