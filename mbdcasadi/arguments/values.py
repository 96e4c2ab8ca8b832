"""Readers of the parameters and times of an analysis."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..equations import Equations
from ..errors import ModelError, SimulationError
from ..model.mechanism import Mechanism
from ..model.quantities import entries, refuse_twice
from ..model.symbols import Input, Parameter, number, place_of
from ..numerics.real import real_array


class RunValues(NamedTuple):
    """Everything besides its start on which a run depends: numbers, or expressions of them.

    Attributes
    ----------
    p : numpy.ndarray
        Values of the parameters.
    levels : numpy.ndarray
        Values of the inputs that are numbers.
    channel : numpy.ndarray
        Values of sampled inputs in the intervals between the output times (rows, k).
    """

    p: Any
    levels: Any
    channel: Any


def pairs_of(values: Any, argument: str) -> list[tuple[Any, Any]]:
    """Entries of a mapping or of a list of pairs; of a list, no input or parameter twice."""
    if values is None:
        return []
    if isinstance(values, Mapping):
        return list(values.items())
    try:
        entries = list(values)
        pairs = [(key, value) for key, value in entries]
    except (TypeError, ValueError):
        entries, pairs = [], None
    if pairs is None or any(isinstance(entry, Mapping) for entry in entries):  # of two keys, one would pass for a pair
        raise ModelError(f"{argument} takes one {{symbol: value}} or a list of pairs, got {values!r}")
    refuse_twice([key for key, _ in pairs if isinstance(key, Input | Parameter)], argument)
    return pairs


def mapping_of(values: Any, argument: str) -> dict[Any, Any]:
    """Values by symbol, of a mapping or of a list of pairs; whether the model has the symbols is not looked at."""
    pairs = pairs_of(values, argument)
    for key, _ in pairs:
        if isinstance(key, ca.SX) and not key.is_scalar():
            raise ModelError(f"{argument} takes single symbols, got {key!r}; give each of its entries a value")
    return dict(pairs)


def position_in(symbols: Iterable[Any], key: Any, argument: str, owner: str = "the mechanism") -> int:
    """Index of a symbol among those of the mechanism or of another owner, or an error that names it."""
    known = list(symbols)
    place = place_of(key, known)
    if place is not None:
        return place
    label = getattr(key, "label", None)
    names = ", ".join(repr(s.label) for s in known) or "none"
    other = " (another symbol of this name)" if label in [s.label for s in known] else ""
    shown = repr(key) if label is None else f"'{label}'"
    raise ModelError(f"{argument} holds {shown}, which is not in {owner}; it has {names}{other}")


def pairs_with(symbols: Iterable[Any], pairs: Iterable[tuple[Any, Any]]) -> list[tuple[Any, Any]]:
    """Pairs whose keys are among some symbols."""
    known = list(symbols)
    return [(key, value) for key, value in pairs if place_of(key, known) is not None]


def inputs_and_parameters(mechanism: Mechanism, listed: Any, argument: str) -> tuple[Any, ...]:
    """Inputs and parameters of the mechanism as they were listed, none of them twice."""
    symbols = entries(listed, argument)
    for symbol in symbols:
        if not isinstance(symbol, Input | Parameter):
            raise ModelError(f"{argument} takes inputs and parameters, got {symbol!r}")
        position_in(mechanism.inputs if isinstance(symbol, Input) else mechanism.parameters, symbol, argument)
    refuse_twice(symbols, argument)
    return symbols


def parameter_vector(eom: Equations, parameters: Any) -> np.ndarray:
    """Parameter values (k,): the parameters' own, overridden by a mapping."""
    values = eom.parameter_values.copy()
    for key, value in pairs_of(parameters, "parameters="):
        where = position_in(eom.mechanism.parameters, key, "parameters=")
        assert isinstance(key, Parameter)
        values[where] = number(value, f"parameter '{key.label}'", "value")
    return values


#: Outputs if only a duration is given.
OUTPUTS = 201


def duration_grid(duration: Any, analysis: str) -> np.ndarray:
    """Even output times from zero to a duration, s."""
    length = number(duration, analysis, "duration")
    if length <= 0:
        raise SimulationError(f"{analysis}: duration must be positive, got {length}")
    return np.linspace(0.0, length, OUTPUTS)


def time_grid(times: Any, *, least: int = 2, takes_duration: bool = False) -> np.ndarray:
    """Check that times are finite and increase strictly.

    Raises
    ------
    SimulationError
        Naming the times at fault.
    """
    try:
        grid = real_array(times)
    except (TypeError, ValueError):
        raise SimulationError(f"times must be numbers, got {times!r}") from None
    if grid.ndim == 0:
        instead = f"; for a run of that length write duration={grid}" if takes_duration else ""
        raise SimulationError(f"times must be a list, got the number {grid}{instead}")
    if grid.ndim != 1 or grid.size < least:
        raise SimulationError(f"times must be a list of at least {least} values, got an array of shape {grid.shape}")
    increasing = grid[1:] > grid[:-1]
    if increasing.all() and math.isfinite(grid[0]) and math.isfinite(grid[-1]):
        return grid
    finite = np.isfinite(grid)
    if not finite.all():
        k = int(np.argmin(finite))
        raise SimulationError(f"times must be finite, but times[{k}] is {grid[k]}")
    k = int(np.argmin(increasing))
    raise SimulationError(f"times must increase, but times[{k}] = {grid[k]} is followed by {grid[k + 1]}")
