"""The guess that a user gave."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...errors import ModelError
from ...results.interpolation import linear
from ...results.state import State
from ...results.trajectory import Trajectory
from ..motion.guess import Guess, PhaseGuess, guess_from_motion, guess_from_other, kinematic_guess
from ..poses.given_path import given_poses
from ..poses.kinematic_guess import STEPS, KinematicPath
from ..poses.least_squares_loads import LeastSquaresLoads
from ..program.change import numeric_at
from ..program.setup import PhaseSetup
from ..solution import Shifted, Solution
from ..solve.problem_solver import ProblemSolver
from ..statement.courses import GivenCourses, read_courses
from ..statement.phase import Phase, on_positions
from .whole_guess import start_of, through_poses


def read_guess(solver: ProblemSolver, guess: Any) -> Guess:
    """Return the guess that a user gave: a solution, a trajectory, or courses of expressions."""
    problem, phases = solver.problem, solver.problem.phases
    if isinstance(guess, Mapping | list):
        return _by_courses(solver, read_courses(problem, guess))
    if isinstance(guess, Solution) and not _goes_through(guess, phases):
        guess = guess.trajectory
    if isinstance(guess, Solution | Shifted):
        return guess.as_guess(problem)
    if not isinstance(guess, Trajectory):
        raise ModelError(
            f"optimize: guess= takes a Solution, a Trajectory or {{expression: values over time}}, got {guess!r}"
        )
    needed = [phase for phase in phases if not phase.is_instant]
    given = [part for part in guess.phases if part.t[-1] > part.t[0]] if len(phases) > 1 else [guess]
    if len(given) != len(needed):
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


def _by_courses(solver: ProblemSolver, given: GivenCourses) -> Guess:
    """The guess in which expressions have given courses; the rest is that of the usual one."""
    parts, begin = [], 0.0
    for k, (setup, duration) in enumerate(zip(solver.setups, given.durations, strict=True)):
        if setup.phase.is_instant:
            parts.append(PhaseGuess(through_poses(solver, setup).sample, np.full(2, begin)))
            continue
        times = begin + setup.phase.segment_times(duration)
        parts.append(_phase_by_courses(setup, *start_of(solver, setup), times, given, k))
        begin = float(times[-1])
    values = dict(zip(solver.problem.free_parameters, solver.free_values.tolist(), strict=True)) | given.parameters
    return Guess(tuple(parts), np.array(list(values.values())), "given")


def _phase_by_courses(
    setup: PhaseSetup, start: State, usual: KinematicPath, segment_times: np.ndarray, given: GivenCourses, k: int
) -> PhaseGuess:
    """The motion of a phase, the k-th, from its usual path and the courses in it."""
    courses, numeric, eom = given.phases[k], numeric_at(setup.numeric, given.parameters), setup.phase.equations
    steps, spans = max(STEPS, *(c.samples - 1 for c in courses), 0), itertools.pairwise(segment_times.tolist())
    times = np.concatenate([segment_times[:1], *(np.linspace(*span, steps + 1)[1:] for span in spans)])
    poses = linear(usual.times, usual.poses, np.interp(times, segment_times, usual.segment_times))
    posed = [course for course in courses if on_positions(course.expression)]
    if posed:
        values = np.column_stack([given.at(k, course, times) for course in posed])
        poses = given_poses(numeric, [course.expression for course in posed], values, times, poses, start.z)
    inputs, states = (
        {place: course for course in courses if (place := _place_in(symbols, course.expression)) is not None}
        for symbols in (eom.u, eom.z)
    )

    def loads_and_states(wanted: np.ndarray) -> dict[str, np.ndarray]:
        u, z = np.full((wanted.size, eom.u.numel()), np.nan), np.tile(start.z, (wanted.size, 1))
        rate = np.zeros_like(z)
        for place, course in inputs.items():
            u[:, place] = given.at(k, course, wanted)
        for place, course in states.items():
            z[:, place] = given.at(k, course, wanted)
            rate[:, place] = np.interp(wanted, times, np.gradient(given.at(k, course, times), times))
        return {"u": u, "z": z, "rate": rate}

    loads, path = LeastSquaresLoads(numeric, setup.scheme.eom, setup.scales), KinematicPath(segment_times, times, poses)
    return kinematic_guess(loads, start, path, loads_and_states)


def _place_in(symbols: ca.SX, expression: ca.SX) -> int | None:
    """Index of a symbol among others, or None."""
    hashes = [symbol.element_hash() for symbol in ca.vertsplit(symbols)]
    return hashes.index(expression.element_hash()) if expression.element_hash() in hashes else None


def _goes_through(solution: Solution, phases: Sequence[Phase]) -> bool:
    """Return True if a solution goes through the mechanisms of phases, one after the other."""
    theirs, ours = ([(x.mechanism, x.is_instant) for x in of] for of in (solution.problem.phases, phases))
    return theirs == ours


def _value_in(motion: Trajectory, parameter: Any, otherwise: float) -> float:
    """Last value of a parameter in a motion."""
    if not any(parameter is own for own in motion.mechanism.parameters):
        return otherwise
    return float(np.clip(motion[parameter][-1], parameter.lower, parameter.upper))
