"""What a search has tried: outcomes of solves, the best solution, and whether its mesh holds."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ...errors import OptimizationError
from ...numerics.lazy import cached_property
from ..measures.branch import branch_jump
from ..motion.guess import Guess
from ..program.limit_sides import LimitSides
from ..program.statistics import Attempt
from ..solution import SAME_COST, Solution, same_cost
from ..solve.problem_solver import ProblemSolver
from ..transcription.mesh import Mesh
from .proposal import Outcome
from .refine import is_lost, refine_if_coarse
from .starts import Starts


@dataclass
class Trials:
    """State of a search, which strategies look at.

    Attributes
    ----------
    solver : ProblemSolver
        Problem to be solved.
    others : callable
        Solvers of the same problem in other coordinates.
    meshes : list of Mesh
        By phase.
    guesses : list of Guess
        First guesses: those of the user, or the usual ones.
    starts : int or None
        Number of starts that the user asks for.
    are_given : bool
        True if the guesses are the user's.
    is_warm : bool
        True if the guess is a solution of nearly the same problem.
    refines : bool
        True if meshes that are too coarse for the motion may become finer.
    is_known : bool
        True if the guess is a solution of the same problem.
    first_limit : int or None
        Iterations of a first solve; None for those of the solver.
    tolerance : float or None
        Tolerance to which the mesh is refined at the end.
    outcomes : list of Outcome
        All solves.
    nearest, least : Solution or None, float
        Motion that violates the demands least of those found with violations at a price, and the sum of its violations.
    sums : list of float
        Sums of violations at a price that were found.
    without_limits : Solution or None
        Solution of the problem without its limits.
    """

    solver: ProblemSolver
    others: Callable[[], list[tuple[ProblemSolver, list[Guess]]]]
    meshes: list[Mesh]
    guesses: list[Guess]
    starts: int | None
    are_given: bool
    is_warm: bool
    refines: bool
    is_known: bool
    first_limit: int | None
    tolerance: float | None
    outcomes: list[Outcome] = field(default_factory=list)
    nearest: Solution | None = None
    least: float = np.inf
    sums: list[float] = field(default_factory=list)
    without_limits: Solution | None = None
    _lost: dict[int, bool] = field(default_factory=dict)
    _settled: dict[int, tuple[Solution, bool]] = field(default_factory=dict)

    def on(self, meshes: list[Mesh]) -> Trials:
        """Return the same search on other meshes, which may be refined, before anything is tried."""
        fresh: dict[str, Any] = {"outcomes": [], "sums": [], "_lost": {}, "_settled": {}}
        return replace(self, meshes=meshes, refines=True, **fresh)

    @cached_property
    def motions(self) -> Starts:
        """Motions to begin with."""
        return Starts(self.solver)

    # --- what was found ---------------------------------------------------------------------------
    @property
    def solved(self) -> list[Outcome]:
        """Outcomes that are motions and solutions of the problem, the cheapest one first."""
        found = [outcome for outcome in self.outcomes if outcome.is_solution]
        last = max((k for k, outcome in enumerate(found) if outcome.proposal.settles), default=0)
        return sorted(found[last:], key=lambda outcome: outcome.last.cost)

    @property
    def failures(self) -> list[OptimizationError]:
        """Why solves of the problem itself failed."""
        failed = [outcome.end for outcome in self.outcomes if outcome.proposal.is_itself]
        return [end for end in failed if isinstance(end, OptimizationError)]

    @property
    def best(self) -> tuple[Outcome, Solution, bool] | None:
        """The best solution, on a mesh that is refined for it, and whether this holds; None if there is none.

        The cheapest one of those whose mesh holds, else of all that are motions: a coarse mesh may promise a cost that
        no motion has.
        """
        best: tuple[Outcome, Solution, bool] | None = None
        before = np.nan
        for outcome in self.solved:
            cost = outcome.last.cost
            if best is not None and best[2] and cost >= best[1].cost * (1 - SAME_COST):
                break
            if same_cost(cost, before):
                continue
            found = self._settle(outcome)
            if found is None:
                continue
            before = cost
            if best is None or (not found[1], found[0].cost) < (not best[2], best[1].cost):
                best = outcome, *found
        if best is None and self.solved:
            found = self._settle(self.solved[0], lost=True)
            return None if found is None else (self.solved[0], *found)
        return best

    def _settle(self, outcome: Outcome, *, lost: bool = False) -> tuple[Solution, bool] | None:
        """A solution on a mesh that is refined for it, and whether this holds; None if it is no motion.

        One that is lost on its own mesh is refined if asked for: it leads to a motion at times.
        """
        solution = outcome.last
        if not self.refines:
            return None if branch_jump(solution) is not None else (solution, True)
        if self._is_lost(solution) and not lost:
            return None
        if id(solution) not in self._settled:
            self._settled[id(solution)] = refine_if_coarse(outcome.solver, solution)
        found = self._settled[id(solution)]
        return None if is_lost(found[0]) or branch_jump(found[0]) is not None else found

    @property
    def jumps(self) -> bool:
        """True if the cheapest solution jumps to another branch of a linkage."""
        return bool(self.solved) and branch_jump(self.solved[0].last) is not None

    @property
    def lowest_cost(self) -> float:
        """Lowest cost of the solutions that are motions of the mechanism on their meshes; infinite if there is none."""
        return next((outcome.last.cost for outcome in self.solved if not self._is_lost(outcome.last)), np.inf)

    def _is_lost(self, solution: Solution) -> bool:
        if id(solution) not in self._lost:
            self._lost[id(solution)] = is_lost(solution)
        return self._lost[id(solution)]

    @property
    def agreeing(self) -> int:
        """Number of the solutions that have the lowest cost."""
        lowest = self.lowest_cost
        return sum(same_cost(outcome.last.cost, lowest) for outcome in self.solved) if np.isfinite(lowest) else 0

    @property
    def has_limits(self) -> bool:
        """True if limits hold throughout a phase."""
        return bool(self.outcomes) and bool(LimitSides(self.outcomes[0].last.program).sides)

    # --- statistics -------------------------------------------------------------------------------
    @property
    def as_starts(self) -> list[Attempt]:
        """Entries of the solves of the problem itself, with the number of those of the same cost.

        The cost is nan if a solve failed, or its solution is no motion of the mechanism on its mesh.
        """
        own = [outcome for outcome in self.outcomes if outcome.proposal.is_itself]
        lost = [outcome.is_solution and self._is_lost(outcome.last) for outcome in own]
        costs = [
            o.last.cost if o.is_solution and not no_motion else np.nan for o, no_motion in zip(own, lost, strict=True)
        ]
        entries = []
        for outcome, cost, no_motion in zip(own, costs, lost, strict=True):
            text = outcome.attempt.description + (", no motion on its mesh" if no_motion else "")
            found = sum(same_cost(cost, other) for other in costs)
            entries.append(replace(outcome.attempt, cost=cost, found=found, description=text))
        return entries
