"""Courses over time that a user gives as a guess: ``{expression: number, array, curve or expression in t}``."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.values import pairs_of, time_grid
from ...errors import ExpressionError, ModelError, SimulationError
from ...model.quantities import is_relation
from ...model.symbols import Parameter, describe, number, place_of, role_of, symbols_of
from ...model.symbols import t as time
from ...model.texts import text_of
from ...numerics.lazy import cached_property
from ...numerics.real import real_array
from .phase import Phase, on_positions
from .statement import ProblemStatement


@dataclass(frozen=True, eq=False)
class Course:
    """Values over time of an expression in positions, of an input, or of a first-order state."""

    expression: ca.SX
    label: str
    #: values (k,) at readings of the clock
    curve: Callable[[np.ndarray], np.ndarray]
    #: ``"share"`` of the length, ``"own"`` time since the start of the course, or that of the ``"motion"``, s
    clock: str
    #: whether it is over the whole motion, not over a phase
    is_whole: bool
    #: time that it lasts, s, if it was given with times, or 0
    lasts: float = 0.0
    #: number of samples
    samples: int = 1

    def at(self, times: np.ndarray, begin: float, length: float, lasts: float) -> np.ndarray:
        """Values at times of the motion, s (k,), of a course that begins at `begin` and has a length, s.

        Courses with times, of which the longest `lasts` so long, are stretched to the length. A :class:`ModelError` is
        raised if a value is not finite.
        """
        shares = np.clip((times - begin) / length, 0.0, 1.0)
        readings = {"share": shares, "own": shares * (lasts or length), "motion": times}[self.clock]
        try:
            values = np.broadcast_to(real_array(self.curve(readings)), times.shape)
        except (TypeError, ValueError):
            raise ModelError(f"optimize: {self.label} is no function from times (k,) to values (k,)") from None
        wrong = np.flatnonzero(~np.isfinite(values))
        if wrong.size:
            place = int(wrong[0])
            raise ModelError(f"optimize: {self.label} is {values[place]} at t = {times[place]:.6g} s")
        return values


@dataclass(frozen=True)
class GivenCourses:
    """What a user gives of a motion: courses by phase, and values of free parameters."""

    problem: ProblemStatement
    phases: tuple[tuple[Course, ...], ...]
    parameters: dict[Parameter, float]

    @cached_property
    def durations(self) -> list[float]:
        """Durations of the phases, s: those of courses with times, within the limits, or else those to begin with."""
        phases = self.problem.phases
        usual = [0.0 if phase.is_instant else phase.span.typical for phase in phases]
        factor = self.lasts(None) / sum(usual) or 1.0
        wanted = [self.lasts(k) or factor * duration for k, duration in enumerate(usual)]
        return [float(np.clip(value, *phase.span)) for value, phase in zip(wanted, phases, strict=True)]

    def at(self, k: int, course: Course, times: np.ndarray) -> np.ndarray:
        """Values of a course of the k-th phase at times of the motion, s."""
        if course.is_whole:
            return course.at(times, 0.0, sum(self.durations), self.lasts(None))
        return course.at(times, sum(self.durations[:k]), self.durations[k], self.lasts(k))

    def lasts(self, phase: int | None) -> float:
        """Longest time that courses over a phase, or over the whole motion, last, s; 0 if they have no times."""
        chosen = [c for courses in self.phases for c in courses] if phase is None else self.phases[phase]
        return max((c.lasts for c in chosen if c.is_whole == (phase is None)), default=0.0)


def read_courses(problem: ProblemStatement, guess: Any) -> GivenCourses:
    """Read a guess by expressions, or by phases and expressions.

    Raises
    ------
    ExpressionError, ModelError
        For what no phase has, expressions that are no positions, inputs or states, phases that are not in the problem,
        and values that are no courses.
    """
    courses: list[list[Course]] = [[] for _ in problem.phases]
    parameters: dict[Parameter, float] = {}
    for k, key, value in _entries(problem, guess):
        if isinstance(key, Parameter):
            if place_of(key, problem.free_parameters) is None:
                raise ModelError(f"optimize: guess= holds the parameter '{key.label}', which is not free")
            parameters[key] = number(value, "optimize", f"the guess of '{key.label}'")
            continue
        candidates = [j for j, phase in enumerate(problem.phases) if k in (None, j) and not phase.is_instant]
        for j in _places_with(problem, candidates, key):
            courses[j].append(_course(key, value, is_whole=k is None))
    return GivenCourses(problem, tuple(map(tuple, courses)), parameters)


def _entries(problem: ProblemStatement, guess: Any) -> Iterator[tuple[int | None, Any, Any]]:
    """Index of a phase, or None for the whole motion, expressions and what is given for them."""
    pairs = pairs_of(guess, "guess=")
    for key, value in pairs:
        if isinstance(key, str | Phase):
            for expression, course in pairs_of(value, f"guess= of phase {key!r}"):
                yield _place_of_phase(problem, key), expression, course
        else:
            yield None, key, value


def _place_of_phase(problem: ProblemStatement, key: str | Phase) -> int:
    lasting = [phase for phase in problem.phases if not phase.is_instant]
    for phase in lasting:
        if key is phase or key == phase.name:
            return problem.phases.index(phase)
    names, name = ", ".join(repr(phase.name) for phase in lasting), key if isinstance(key, str) else key.name
    raise ModelError(f"optimize: guess= is for a phase {name!r}; the phases that last are {names}")


def _places_with(problem: ProblemStatement, candidates: Sequence[int], key: Any) -> list[int]:
    """Indices of the phases that have all symbols of an expression; at least one."""
    if not isinstance(key, ca.SX) or not key.is_scalar() or key.is_constant() or is_relation(key):
        raise ModelError(
            "optimize: guess= takes {expression: values} with an expression for each number, such as a coordinate, "
            f"hand.x or an input; got {key!r}"
        )
    places = [k for k in candidates if problem.phases[k].has(key)]
    if not places:
        foreign = next(s for s in symbols_of(key) if not any(problem.phases[k].has(s) for k in candidates[:1]))
        of = f" of phase '{problem.phases[candidates[0]].name}'" if len(candidates) < len(problem.phases) else ""
        raise ExpressionError(
            f"guess= holds {text_of(key)}, with {describe(foreign)}, which the mechanism{of} does not have"
        )
    role = role_of(key)
    if not on_positions(key) and (role is None or role.kind not in ("input", "state")):
        raise ModelError(
            f"optimize: guess= holds {text_of(key)}; it takes expressions in positions, inputs and first-order states "
            "alone, from which the rest follows: velocities from positions, loads from the motion"
        )
    return places


def _course(expression: ca.SX, value: Any, *, is_whole: bool) -> Course:
    """The course of an expression from any form in which it is given."""
    return course_of(expression, value, f"the guess of {text_of(expression)}", is_whole=is_whole)


def course_of(
    expression: ca.SX, value: Any, label: str, *, is_whole: bool = True, through: Callable[..., Any] | None = None
) -> Course:
    """Return the course of an expression from any form in which it is given; `label` names it in messages.

    `through` makes a function of samples at places; without it the curve through them does not overshoot.
    """
    if isinstance(value, ca.SX):
        return Course(expression, label, _curve_of(value, label), "motion", is_whole)
    if callable(value):
        return Course(expression, label, value, "own", is_whole)
    if isinstance(value, tuple) and len(value) == 2 and np.ndim(value[0]):
        try:
            times = time_grid(value[0])
        except SimulationError as error:
            raise ModelError(f"optimize: {label}: {error}") from None
        if times[-1] <= 0:
            raise ModelError(
                f"optimize: {label}: times count from the start of the motion, got {times[0]:g} … {times[-1]:g} s"
            )
        curve = _through(times, _samples(value[1], label, times.size), label, through)
        return Course(expression, label, curve, "own", is_whole, float(times[-1]), times.size)
    samples = _samples(value, label)
    curve = _through(np.linspace(0, 1, samples.size), samples, label, through)
    return Course(expression, label, curve, "share", is_whole, samples=samples.size)


def _curve_of(value: ca.SX, label: str) -> Callable[[np.ndarray], np.ndarray]:
    """The values of an expression in time."""
    if not value.is_scalar():
        raise ModelError(f"optimize: {label} must be a scalar, got an expression of shape {value.shape}")
    for symbol in symbols_of(value):
        if ca.is_equal(symbol, time):
            continue
        raise ExpressionError(f"{label} contains {describe(symbol)}; it takes expressions in t alone")
    function = ca.Function("guess", [time], [ca.densify(value)])
    return lambda times: function(times[None, :]).full().ravel()


def _samples(value: Any, label: str, count: int | None = None) -> np.ndarray:
    """A number as two samples, or a list of them."""
    try:
        samples = real_array(value)
    except (TypeError, ValueError):
        raise ModelError(
            f"optimize: {label} takes a number, an array over the duration, a pair (times, values), a "
            f"curve or an expression in t, got {value!r}"
        ) from None
    if samples.ndim == 0 and count is None:
        samples = np.repeat(samples, 2)
    if samples.ndim != 1 or samples.size != (count or samples.size) or samples.size < 2:
        asked = f"{count} values, as there are times" if count else "at least two values over the duration"
        raise ModelError(f"optimize: {label} is an array of shape {samples.shape}; give {asked}")
    return samples


def _through(
    places: np.ndarray, samples: np.ndarray, label: str, through: Callable[..., Any] | None
) -> Callable[[np.ndarray], np.ndarray]:
    """The curve through samples, constant beyond the ends; see :func:`course_of`."""
    if not np.all(np.isfinite(samples)):
        place = int(np.flatnonzero(~np.isfinite(samples))[0])
        raise ModelError(f"optimize: {label} has the value {samples[place]} as sample {place}")
    if through is None:
        from scipy.interpolate import PchipInterpolator

        through = PchipInterpolator
    curve = through(places, samples)
    return lambda readings: curve(np.clip(readings, places[0], places[-1]))
