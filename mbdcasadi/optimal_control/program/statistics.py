"""Records of how a solution was found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Attempt:
    """One solve on the way to a solution: from a start, on a mesh, at parameter values, or with other limits.

    Attributes
    ----------
    description : str
        Origin of the guess, and what was solved if not the problem itself: limits that were kept, what was minimised.
    cost : float
        Cost at its end; nan for a start that did not lead to a solution.
    iterations : int
        Iterations of the solver.
    status : str
        Message of the solver.
    seconds : float
        Time of building and solving, s.
    intervals : int
        Number of intervals of the mesh.
    error : float or None
        On a mesh of a refinement: largest local error of an interval, as :attr:`Solution.mesh_error`.
    values : dict of str to float
        In a step of a continuation: parameter, by name, to its value.
    violation : float or None
        If violations had a price or were minimised: the sum of those that were left, in typical sizes.
    found : int
        Of a start: number of starts that led to the same cost.
    """

    description: str
    cost: float
    iterations: int
    status: str
    seconds: float
    intervals: int
    error: float | None = None
    values: dict[str, float] = field(default_factory=dict)
    violation: float | None = None
    found: int = 0

    @property
    def guess(self) -> str:
        """Former name of :attr:`description`."""
        return self.description


@dataclass(frozen=True)
class SolveStatistics:
    """Record of how a solution was found.

    Attributes
    ----------
    iterations : int
        Iterations of the solver.
    status : str
        Message of the solver.
    seconds, build_seconds : float
        Time of building and solving, and of building alone, s.
    variables, rows : int
        Size of the program.
    starts : list of Attempt
        Results of the starts if there were several.
    passes : list of Attempt
        Meshes of the refinement.
    steps : list of Attempt
        Values of a continuation, including those inserted in between.
    stages : list of Attempt
        Stages of a search with limits that close in, if the solver failed at first.
    at_saddle : bool or None
        True if the cost falls to second order in a direction that rows and limits leave; None if this was not looked
        for, as of a solve from a solution of the same problem. It is False if IPOPT had no curvature to add.
    rounding : float
        Width by which kinks of the equations are rounded in the solution, as a share of the largest value of what
        passes zero there; 0 if they are not.
    """

    iterations: int
    status: str
    seconds: float
    build_seconds: float
    variables: int
    rows: int
    starts: list[Attempt] = field(default_factory=list)
    passes: list[Attempt] = field(default_factory=list)
    steps: list[Attempt] = field(default_factory=list)
    stages: list[Attempt] = field(default_factory=list)
    at_saddle: bool | None = None
    rounding: float = 0.0

    def after(self, first: SolveStatistics) -> SolveStatistics:
        """Return the statistics of a solve that went on from another one."""
        return replace(
            self,
            iterations=first.iterations + self.iterations,
            seconds=first.seconds + self.seconds,
            build_seconds=first.build_seconds + self.build_seconds,
            starts=first.starts,
            stages=[*first.stages, *self.stages],
        )

    @property
    def agreement(self) -> str:
        """How far starts agree, in words: their number, that of their optima, and how often the lowest was found."""
        solved = [start for start in self.starts if np.isfinite(start.cost)]
        if not solved:
            return f"{len(self.starts)} starts led to no motion on their meshes" if self.starts else "one start"
        lowest = min(solved, key=lambda start: start.cost)
        optima = round(sum(1 / max(start.found, 1) for start in solved))
        times = "once" if lowest.found <= 1 else f"{lowest.found} times"
        return f"{len(self.starts)} starts led to {optima} {'optimum' if optima == 1 else 'optima'}, the lowest {times}"


@dataclass(frozen=True)
class Answer:
    """Result of the solver besides the variables, scaled: multipliers of the bounds and of the rows, and the rows."""

    lam_x: np.ndarray
    lam_g: np.ndarray
    rows: np.ndarray
