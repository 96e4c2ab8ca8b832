"""The guess that a user gave."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import ModelError
from ...results.trajectory import Trajectory
from ..motion.guess import Guess, PhaseGuess, guess_from_motion, guess_from_other
from ..solution import Shifted, Solution
from ..solve.problem_solver import ProblemSolver
from ..statement.phase import Phase
from .whole_guess import through_poses


def read_guess(solver: ProblemSolver, guess: Any) -> Guess:
    """Return the guess that a user gave: a solution, or a trajectory."""
    problem, phases = solver.problem, solver.problem.phases
    if isinstance(guess, Solution) and not _goes_through(guess, phases):
        guess = guess.trajectory
    if isinstance(guess, Solution | Shifted):
        return guess.as_guess(problem)
    if not isinstance(guess, Trajectory):
        raise ModelError(f"optimize: guess= takes a Solution or a Trajectory, got {guess!r}")
    needed = [phase for phase in phases if not phase.is_instant]
    given = [part for part in guess.phases if part.t[-1] > part.t[0]] if len(phases) > 1 else [guess]
    if len(phases) > 1 and [part.mechanism for part in given] != [phase.mechanism for phase in needed]:
        raise ModelError(
            f"optimize: the motion given as guess goes through {len(given)} mechanism{'s' * (len(given) != 1)}, which "
            f"are not those of the phases {', '.join(repr(phase.name) for phase in needed)} in their order"
        )
    parts, time, description = [], 0.0, "trajectory"
    for phase, setup in zip(phases, solver.setups, strict=True):
        if phase.is_instant:
            parts.append(PhaseGuess(through_poses(solver, setup).sample, np.array([time, time])))
            continue
        motion = given.pop(0)
        times = time + phase.segment_times(float(np.clip(motion.t[-1] - motion.t[0], *phase.span)))
        if motion.mechanism is phase.mechanism and not motion.missing_multipliers:
            parts.append(guess_from_motion(motion, times))
        else:
            parts.append(guess_from_other(phase, setup.loads, motion, times))
            description = "inverse dynamics"
        time = float(times[-1])
    values = [_value_in(guess, p, value) for p, value in zip(problem.free_parameters, solver.free_values, strict=True)]
    return Guess(tuple(parts), np.array(values), description)


def _goes_through(solution: Solution, phases: Sequence[Phase]) -> bool:
    """Return True if a solution goes through the mechanisms of phases, one after the other."""
    theirs, ours = ([(x.mechanism, x.is_instant) for x in of] for of in (solution.problem.phases, phases))
    return theirs == ours


def _value_in(motion: Trajectory, parameter: Any, otherwise: float) -> float:
    """Last value of a parameter in a motion."""
    if not any(parameter is own for own in motion.mechanism.parameters):
        return otherwise
    return float(np.clip(motion[parameter][-1], parameter.lower, parameter.upper))
