"""How a solution was found, and what the solver said of it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True)
class Start:
    """One of several starts.

    Attributes
    ----------
    guess : str
        Where it came from.
    cost : float
        What it led to; nan where it led nowhere.
    iterations : int
        Of the solver.
    status : str
        The solver's own word.
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
        Of the mesh.
    error : float
        Largest local error of an interval, as :attr:`Solution.mesh_error`.
    cost : float
        Minimum on this mesh.
    iterations : int
        Of the solver.
    seconds : float
        Building and solving, s.
    """

    intervals: int
    error: float
    cost: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class Step:
    """One step of a continuation.

    Attributes
    ----------
    values : dict of str to float
        Parameter, by name, to its value.
    cost : float
        Minimum there.
    iterations : int
        Of the solver.
    seconds : float
        Building and solving, s.
    """

    values: dict[str, float]
    cost: float
    iterations: int
    seconds: float


@dataclass(frozen=True)
class SolveStatistics:
    """How a solution was found.

    Attributes
    ----------
    iterations : int
        Of the solver.
    status : str
        Its own word.
    seconds, build_seconds : float
        Building and solving, and the building of it, s.
    variables, rows : int
        Size of the program.
    starts : list of Start
        What each start led to, where there were several.
    passes : list of Pass
        Meshes of the refinement.
    steps : list of Step
        Values of a continuation, those between that were found necessary included.
    """

    iterations: int
    status: str
    seconds: float
    build_seconds: float
    variables: int
    rows: int
    starts: list[Start] = field(default_factory=list)
    passes: list[Pass] = field(default_factory=list)
    steps: list[Step] = field(default_factory=list)


@dataclass(frozen=True)
class Answer:
    """What the solver returns besides the variables, scaled: multipliers of the bounds and the rows, and the rows."""

    lam_x: np.ndarray
    lam_g: np.ndarray
    rows: np.ndarray
