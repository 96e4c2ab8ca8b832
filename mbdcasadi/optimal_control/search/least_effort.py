"""Guesses for mechanisms with an input for each coordinate: the motion of the least effort of many ways."""

from __future__ import annotations

import numpy as np

from ...numerics.symbolic import numeric_work
from ..motion.guess import Guess, PhaseGuess
from ..solve.problem_solver import ProblemSolver
from .driven.random_motions import best_motion
from .whole_guess import guess_of


def least_effort(solver: ProblemSolver) -> Guess | None:
    """Return the motion of the least effort that is found on a coarse mesh; None for other problems."""
    motions = solver.driven
    if motions is None:
        return None
    with numeric_work():
        found = best_motion(motions)
    if found is None:
        return None

    def sample(times: np.ndarray) -> dict[str, np.ndarray]:
        return motions.values(found.spline, found.x, times)

    phase = PhaseGuess(sample, solver.setups[0].path.segment_times)
    return guess_of(solver, [phase], f"least effort of {found.tried} ways")
