"""What a search has found at any instant: the best solution, for the user who stops it."""

from __future__ import annotations

from ...errors import Interrupted
from ..solution import Solution


class BestSoFar:
    """The best solution at any instant of a search, for the user who stops it.

    Attributes
    ----------
    solution : Solution or None
        The best one of the present stage, or of the last stage that has one.
    iterate : Solution or None
        The last iterate of a solve that did not end in a solution.
    """

    def __init__(self) -> None:
        self.solution: Solution | None = None
        self.iterate: Solution | None = None
        self._is_old = False

    def new_stage(self) -> None:
        """From now on any solution is better than those before: on a finer mesh, at the next parameter values."""
        self._is_old = True

    def add(self, solution: Solution) -> None:
        """Take a solution into account."""
        if self.solution is None or self._is_old or solution.cost < self.solution.cost:
            self.solution, self._is_old = solution, False

    def interrupted(self) -> Interrupted:
        """The exception for a search that the user stopped."""
        which = "best solution" if self.solution is not None else "last iterate"
        partial = self.solution if self.solution is not None else self.iterate
        more = f"the {which} is in .partial" if partial is not None else "no solution was found yet"
        return Interrupted(f"stopped by the user; {more}", partial=partial)
