"""A solve that a strategy proposes, and how it ended."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...errors import ModelError, OptimizationError
from ..motion.guess import Guess
from ..program.limit_sides import Slacks
from ..program.statistics import Attempt
from ..program.variant import ITSELF, Variant
from ..solution import Solution
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh


@dataclass(frozen=True)
class Violations:
    """Variant of a program whose limits and conditions yield at a price; see :class:`ElasticProgram`.

    Attributes
    ----------
    nearness : float
        Weight of the squared distance from the guess.
    cost : float
        Weight of the cost of the problem.
    limits_alone : bool
        True if conditions hold, and limits alone yield.
    """

    nearness: float
    cost: float = 0.0
    limits_alone: bool = False


@dataclass(frozen=True)
class Proposal:
    """A solve that a strategy proposes.

    Attributes
    ----------
    guess : Guess
        Motion to begin with.
    description : str
        What is solved, and from where, in words.
    iterations : int or None
        Largest number; None for that of the solver.
    variant : Variant or Violations
        The program itself, or an easier one.
    meshes : sequence of Mesh, optional
        By phase; those of the search if left out.
    is_warm : bool
        True if the guess is a solution of nearly the same problem.
    settles : bool
        True if a solution takes the place of those before whatever its cost, which was false.
    ceiling : float
        Cost above which the solve is given up after a while.
    solver : ProblemSolver, optional
        Solver of the problem in other coordinates.
    """

    guess: Guess
    description: str
    iterations: int | None
    variant: Variant | Violations = ITSELF
    meshes: Sequence[Mesh] | None = None
    is_warm: bool = False
    settles: bool = False
    ceiling: float = np.inf
    solver: ProblemSolver | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.guess, Guess):
            raise ModelError(f"Proposal: guess must be a Guess, as trials.motions makes them, got {self.guess!r}")
        if self.iterations is not None and self.iterations < 0:
            raise ModelError(f"Proposal: iterations must not be negative, got {self.iterations}")

    @property
    def is_itself(self) -> bool:
        """True if the problem itself is solved, not a variant."""
        return isinstance(self.variant, Variant) and self.variant.is_itself


@dataclass(frozen=True)
class Outcome:
    """How a proposed solve ended.

    Attributes
    ----------
    proposal : Proposal
        What was tried.
    solver : ProblemSolver
        Solver that tried it.
    end : Solution or OptimizationError
        A solution, also of a variant, or why there is none.
    slacks : dict of RowName to float
        Scaled violations by name, of a variant whose demands yield.
    strategy : str
        Name of the strategy.
    """

    proposal: Proposal
    solver: ProblemSolver
    end: Solution | OptimizationError
    slacks: Slacks
    strategy: str

    @property
    def last(self) -> Solution:
        """Last iterate."""
        return self.end if isinstance(self.end, Solution) else self.end.partial

    @property
    def succeeded(self) -> bool:
        """True if the solver did."""
        return isinstance(self.end, Solution)

    @property
    def is_solution(self) -> bool:
        """True if it is a solution of the problem itself."""
        return self.succeeded and self.proposal.is_itself

    @property
    def violation(self) -> float:
        """Sum of the scaled violations."""
        return sum(self.slacks.values())

    @property
    def attempt(self) -> Attempt:
        """Entry in the statistics."""
        violation = self.violation if isinstance(self.proposal.variant, Violations) else None
        return self.last.as_attempt(self.proposal.description, violation=violation)
