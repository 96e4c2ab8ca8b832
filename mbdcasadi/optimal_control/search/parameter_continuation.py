"""A problem solved for a sequence of parameter values, each from the last solution."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from ...arguments.values import pairs_of
from ...errors import ModelError, OptimizationError
from ...model.symbols import Parameter
from ...numerics.real import real_array
from ..problem import OptimalControlProblem
from ..solution import Solution

#: Largest number of values that are inserted between those of the user if the solver fails.
INSERTED = 8


def read_continuation(problem: OptimalControlProblem, continuation: Any, parameters: Any) -> list[dict[Any, float]]:
    """Return the parameter values of each step.

    What is not a parameter of the mechanism, or is also given or free, and values that do not go together are refused.
    """
    what = "optimize: continuation="
    known = [p for phase in problem.phases for p in phase.mechanism.parameters]
    fixed = [key for key, _ in pairs_of(parameters, "parameters=")]
    columns: dict[Any, np.ndarray] = {}
    for key, values in pairs_of(continuation, "continuation="):
        if not isinstance(key, Parameter) or not any(key is p for p in known):
            raise ModelError(f"{what} {key} is not a parameter of the mechanism")
        for others, how in ((fixed, "given by parameters="), (problem.free_parameters, "free")):
            if any(key is other for other in others):
                raise ModelError(f"{what} parameter '{key.label}' is also {how}")
        try:
            columns[key] = real_array(values).ravel()
        except (TypeError, ValueError):
            raise ModelError(f"{what} takes the values of '{key.label}' one after another, got {values!r}") from None
        if not columns[key].size or not np.all(np.isfinite(columns[key])):
            raise ModelError(f"{what} the values of '{key.label}' must be finite numbers, got {values!r}")
    if not columns:
        raise ModelError(f"{what} is empty; leave it out if nothing is to change")
    if len({column.size for column in columns.values()}) > 1:
        counts = ", ".join(f"'{key.label}' {column.size}" for key, column in columns.items())
        raise ModelError(f"{what} its parameters change together and must have the same number of values; got {counts}")
    count = next(iter(columns.values())).size
    return [{key: float(column[k]) for key, column in columns.items()} for k in range(count)]


def by_continuation(steps: list[dict[Any, float]], solve: Callable[..., Solution], guess: Any) -> Solution:
    """Solve step after step by ``solve(values, guess, first=…, last=…)``, with values in between if one is too long.

    The :class:`OptimizationError` of a failure names the values that could not be reached, and has the last solution,
    if there is one, in ``.reached``.
    """
    remaining, done, inserted = list(steps), [], 0
    solution: Solution | None = None
    reached: dict[Any, float] = {}
    while remaining:
        values, last = remaining[0], len(remaining) == 1
        near = guess if solution is None else solution
        try:
            following = solve(values, near, first=solution is None, last=last)
        except OptimizationError as error:
            # solved, but not refined
            for_the_mesh = error.reached is not None or (error.partial and error.partial.statistics.passes)
            if solution is None or inserted >= INSERTED or for_the_mesh:
                where = ", ".join(f"{key.label} = {value:.6g}" for key, value in values.items())
                error.args = (f"continuation stopped at {where}: {error}",)
                error.reached = error.reached or solution
                raise
            inserted += 1
            remaining.insert(0, {key: _between(reached[key], value) for key, value in values.items()})
            continue
        solution, reached = following, remaining.pop(0)
        labels = {key.label: value for key, value in reached.items()}
        done.append(solution.as_attempt("continuation", values=labels))
        solution.statistics = replace(solution.statistics, steps=list(done))
    assert solution is not None
    return solution


def _between(first: float, second: float) -> float:
    """The geometric mean of two values of one sign, the arithmetic mean of others."""
    return float(np.sign(first) * np.sqrt(first * second)) if first * second > 0 else (first + second) / 2
