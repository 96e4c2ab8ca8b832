"""Records of how a solution was found."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np


@dataclass(frozen=True)
class Start:
    """One of several starts.

    Attributes
    ----------
    guess : str
        Origin of the guess.
    cost : float
        Minimum that it led to; nan if it did not lead to one.
    iterations : int
        Iterations of the solver.
    status : str
        Message of the solver.
    """

    guess: str
    cost: float
    iterations: int
    status: str


@dataclass(frozen=True)
class Pass:
    """One mesh of a refinement.

    Attributes
    ----------
    intervals : int
        Number of intervals.
    error : float
        Largest local error of an interval, as :attr:`Solution.mesh_error`.
    cost : float
        Minimum on this mesh.
    iterations : int
        Iterations of the solver.
    seconds : float
        Time of building and solving, s.
    """

    intervals: int
    error: float
    cost: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class ContinuationStep:
    """One step of a continuation.

    Attributes
    ----------
    values : dict of str to float
        Parameter, by name, to its value.
    cost : float
        Minimum there.
    iterations : int
        Iterations of the solver.
    seconds : float
        Time of building and solving, s.
    """

    values: dict[str, float]
    cost: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Stage:
    """One stage of a search that went on after a solve had failed.

    Attributes
    ----------
    description : str
        Limits that were kept, or what was minimised.
    iterations : int
        Iterations of the solver.
    status : str
        Message of the solver.
    seconds : float
        Time of building and solving, s.
    """

    description: str
    iterations: int
    status: str
    seconds: float


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
    starts : list of Start
        Results of the starts if there were several.
    passes : list of Pass
        Meshes of the refinement.
    steps : list of ContinuationStep
        Values of a continuation, including those inserted in between.
    stages : list of Stage
        Stages of a search with limits that close in, if the solver failed at first, and runs of fatrop that failed.
    solver : {"ipopt", "fatrop"}
        Solver that found the solution.
    """

    iterations: int
    status: str
    seconds: float
    build_seconds: float
    variables: int
    rows: int
    starts: list[Start] = field(default_factory=list)
    passes: list[Pass] = field(default_factory=list)
    steps: list[ContinuationStep] = field(default_factory=list)
    stages: list[Stage] = field(default_factory=list)
    solver: str = "ipopt"

    def after(self, first: SolveStatistics) -> SolveStatistics:
        """Return the statistics of a solve that went on from another one."""
        return replace(
            self,
            iterations=first.iterations + self.iterations,
            starts=first.starts,
            seconds=first.seconds + self.seconds,
            build_seconds=first.build_seconds + self.build_seconds,
        )


@dataclass(frozen=True)
class Answer:
    """Result of the solver besides the variables, scaled: multipliers of the bounds and of the rows, and the rows."""

    lam_x: np.ndarray
    lam_g: np.ndarray
    rows: np.ndarray
