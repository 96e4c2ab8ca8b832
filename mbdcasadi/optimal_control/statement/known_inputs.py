"""Inputs whose courses a user gives: measured signals, loads that are known in advance, references."""

from __future__ import annotations

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.inputs import of_solution
from ...arguments.values import pairs_of, position_in
from ...errors import ModelError
from ...model.symbols import Input, place_of
from .courses import Course, course_of
from .statement import ProblemStatement


@dataclass(frozen=True)
class KnownInputs:
    """Courses of inputs by place among those of a mechanism, phase by phase."""

    phases: tuple[dict[int, Course], ...] = ()
    #: of the whole motion, s
    duration: float = 0.0

    @property
    def key(self) -> Hashable:
        """Which inputs are known: programs are made for these, whatever their courses."""
        return tuple(tuple(courses) for courses in self.phases)

    def places(self, phase: int) -> tuple[int, ...]:
        """Places of the known inputs of a phase."""
        return tuple(self.phases[phase]) if self.phases else ()

    def symbols(self, problem: ProblemStatement) -> list[tuple[int, Input]]:
        """Known inputs with their places among those of a problem."""
        known = [problem.phases[k].mechanism.inputs[place] for k in range(len(self.phases)) for place in self.places(k)]
        return [(k, symbol) for k, symbol in enumerate(inputs_of(problem)) if any(symbol is other for other in known)]

    def values(self, phase: int, times: np.ndarray) -> np.ndarray:
        """Values of the known inputs of a phase at times of the motion, s (k, n)."""
        courses = self.phases[phase].values() if self.phases else ()
        columns = [course.at(times, 0.0, self.duration, self.duration) for course in courses]
        return np.column_stack(columns) if columns else np.zeros((times.size, 0))


#: No input is known.
NO_INPUTS = KnownInputs()


def inputs_of(problem: ProblemStatement) -> list[Input]:
    """Return the inputs of all phases, each once."""
    return list(dict.fromkeys(u for phase in problem.phases for u in phase.mechanism.inputs))


def read_known_inputs(problem: ProblemStatement, inputs: Any) -> KnownInputs:
    """Read ``inputs=`` of an optimisation.

    Raises
    ------
    ModelError
        For inputs that no phase has, what is no course, samples that end before the motion does, and a course
        that changes if a duration or the time of a waypoint is free.
    """
    pairs = pairs_of(inputs, "inputs=")
    if not pairs:
        return NO_INPUTS
    duration = sum(phase.span[1] for phase in problem.phases)
    symbols = inputs_of(problem)
    phases: list[dict[int, Course]] = [{} for _ in problem.phases]
    for key, value in pairs:
        symbol = symbols[position_in(symbols, key, "inputs=")]
        course = _course(symbol, of_solution(value, symbol), duration)
        if problem.has_free_times and (np.ndim(value) or callable(value) or isinstance(value, ca.SX)):
            raise ModelError(
                f"optimize: {course.label} is given as a course over time, but a duration or the time of a waypoint is "
                "free; fix the times, or give a number"
            )
        for phase, courses in zip(problem.phases, phases, strict=True):
            place = None if phase.is_instant else place_of(symbol, phase.mechanism.inputs)
            if place is not None:
                courses[place] = course
    return KnownInputs(tuple(dict(sorted(courses.items())) for courses in phases), duration)


def _course(symbol: Any, value: Any, duration: float) -> Course:
    """The course of an input, straight between samples as in a simulation."""
    course = course_of(symbol, value, f"input '{symbol.label}'", through=_straight)
    if 0 < course.lasts < duration and not np.isclose(course.lasts, duration):
        raise ModelError(
            f"optimize: the samples of {course.label} end at {course.lasts:.6g} s, and the motion at {duration:.6g} s"
        )
    return course


def _straight(places: np.ndarray, samples: np.ndarray) -> Callable[[np.ndarray], np.ndarray]:
    return lambda readings: np.asarray(np.interp(readings, places, samples))
