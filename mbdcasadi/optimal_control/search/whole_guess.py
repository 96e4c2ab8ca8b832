"""The guess of a whole problem from the motions of its phases."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ...results.state import State
from ..motion.guess import Guess, PhaseGuess, kinematic_guess
from ..poses.kinematic_guess import KinematicPath
from ..program.setup import PhaseSetup
from ..solve.problem_solver import ProblemSolver


def start_of(solver: ProblemSolver, setup: PhaseSetup) -> tuple[State, KinematicPath]:
    """First state and poses of a phase; the setup of the first one may belong to another start."""
    return (solver.start, solver.path) if setup is solver.setups[0] else (setup.start, setup.path)


def through_poses(
    solver: ProblemSolver, setup: PhaseSetup, make: Callable[..., PhaseGuess] = kinematic_guess
) -> PhaseGuess:
    """The motion of a phase through its poses."""
    if setup.phase.is_instant:
        return PhaseGuess(lambda _times: {}, setup.path.segment_times)
    return make(setup.loads, *start_of(solver, setup))


def guess_of(solver: ProblemSolver, phases: Iterable[PhaseGuess], description: str) -> Guess:
    """The guess that consists of motions of the phases."""
    return Guess(tuple(phases), solver.free_values, description)
