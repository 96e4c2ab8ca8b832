"""A problem solved for a sequence of parameter values, each from the last solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ..arguments.values import pairs_of
from ..errors import ModelError
from ..model.symbols import Parameter
from .checks.failure import OptimizationError
from .problem import OptimalControlProblem
from .solution import Solution
from .solve_statistics import Step

#: Values put between two of the user's where the solver fails at the second one, at the most.
BETWEEN = 8


def read_continuation(problem: OptimalControlProblem, continuation: Any, parameters: Any) -> list[dict[Any, float]]:
    """Parameter to value for each step.

    Raises
    ------
    ModelError
        For what is no parameter of the mechanism, values that do not go together, and a parameter that is also
        given or sought.
    """
    what = "optimize: continuation="
    given = [key for key, _ in pairs_of(parameters, "parameters=")]
    columns: dict[Any, np.ndarray] = {}
    for key, values in pairs_of(continuation, "continuation="):
        if not isinstance(key, Parameter) or not any(key is p for p in problem.mechanism.parameters):
            raise ModelError(f"{what} {key} is no parameter of the mechanism")
        for others, word in ((given, "given by parameters="), (problem.free_parameters, "sought")):
            if any(key is other for other in others):
                raise ModelError(f"{what} parameter '{key.label}' is also {word}")
        try:
            columns[key] = np.asarray(values, float).ravel()
        except (TypeError, ValueError):
            raise ModelError(f"{what} takes the values of '{key.label}' one after another, got {values!r}") from None
        if not columns[key].size or not np.all(np.isfinite(columns[key])):
            raise ModelError(f"{what} the values of '{key.label}' must be finite numbers, got {values!r}")
    if not columns:
        raise ModelError(f"{what} is empty; leave it out where nothing is to change")
    if len({column.size for column in columns.values()}) > 1:
        counts = ", ".join(f"'{key.label}' {column.size}" for key, column in columns.items())
        raise ModelError(f"{what} its parameters change together and want equally many values; there are {counts}")
    count = next(iter(columns.values())).size
    return [{key: float(column[k]) for key, column in columns.items()} for k in range(count)]


def by_continuation(steps: list[dict[Any, float]], solve: Callable[..., Solution], guess: Any) -> Solution:
    """Solve step after step, with values between where one is too long.

    Parameters
    ----------
    steps : list of dict
        Parameter to value.
    solve : callable
        ``solve(values, guess, first=..., last=...)`` returns a solution.
    guess : Solution, Trajectory or None
        Of the first step.

    Raises
    ------
    OptimizationError
        Naming the values that could not be reached; ``.reached`` is the last solution, if there is one.
    """
    left, done, between = list(steps), [], 0
    found: Solution | None = None
    reached: dict[Any, float] = {}
    while left:
        values = left[0]
        try:
            solution = solve(values, guess if found is None else found, first=found is None, last=len(left) == 1)
        except OptimizationError as error:
            for_the_mesh = error.reached is not None or error.partial.statistics.passes  # solved, but not refined
            if found is None or between >= BETWEEN or for_the_mesh:
                said = ", ".join(f"{key.label} = {value:.6g}" for key, value in values.items())
                error.args = (f"continuation stopped at {said}: {error}",)
                error.reached = error.reached or found
                raise
            between += 1
            left.insert(0, {key: _between(reached[key], value) for key, value in values.items()})
            continue
        found, reached = solution, left.pop(0)
        s = solution.statistics
        labels = {key.label: value for key, value in reached.items()}
        done.append(Step(labels, solution.cost, s.iterations, s.seconds))
    assert found is not None
    found.statistics = replace(found.statistics, steps=done)
    return found


def _between(first: float, second: float) -> float:
    """The geometric mean of two values of one sign, the arithmetic one of others."""
    return float(np.sign(first) * np.sqrt(first * second)) if first * second > 0 else (first + second) / 2
