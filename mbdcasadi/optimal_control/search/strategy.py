"""What a search tries: strategies propose solves, and see how these ended."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Generator
from typing import ClassVar

from .proposal import Outcome, Proposal
from .trials import Trials

#: What a strategy proposes one after another; it gets the outcome of each.
Proposals = Generator[Proposal, Outcome, None]


class Strategy(ABC):
    """One way to look for a solution.

    A subclass sets :attr:`name`, says in :meth:`applies` when it is of use, and proposes solves in :meth:`proposals`.

    Attributes
    ----------
    name : str
        For lists and statistics.
    goes_on : bool
        True if it comes after a failure that leaves open whether the problem has a solution.
    ends_at_solution : bool
        True if nothing more is proposed once a solution is found.
    """

    name: ClassVar[str]
    goes_on: ClassVar[bool] = False
    ends_at_solution: ClassVar[bool] = False

    @abstractmethod
    def applies(self, trials: Trials) -> bool:
        """Return True if the strategy may help, after what was tried before."""

    @abstractmethod
    def proposals(self, trials: Trials) -> Proposals:
        """Propose solves; the value of each ``yield`` is its :class:`Outcome`.

        Raises
        ------
        OptimizationError
            If it is found that the problem has no solution.
        """

    def independent(self, trials: Trials) -> list[Proposal]:
        """Return proposals that do not depend on each other, which an executor may solve at a time; none by default."""
        return []

    def __repr__(self) -> str:
        return f"{type(self).__name__}()"
