"""States as entries of a file: arrays by time with the names of their columns, and events."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..equations import Equations
from ..errors import FileError, MechanismError
from .archives import Archive
from .state import Arrays, State, six

#: Arrays by time, and what their columns belong to.
ARRAYS = {"q": "coordinate", "v": "coordinate", "a": "coordinate", "z": "state", "lam": "row", "inputs": "input"}


def column_names(eom: Equations) -> dict[str, tuple[str, ...]]:
    """Names of coordinates, rows, states, inputs and parameters."""
    mechanism = eom.mechanism
    return {
        "coordinate": eom.coordinate_names,
        "row": eom.row_names,
        "state": tuple(s.label for s in mechanism.states),
        "input": tuple(u.label for u in mechanism.inputs),
        "parameter": tuple(p.label for p in mechanism.parameters),
    }


def check_columns(archive: Archive, eom: Equations, prefix: str = "") -> None:
    """Raise a :class:`FileError` that names the first difference to the names in a file."""
    for kind, expected in column_names(eom).items():
        saved = archive.names(f"{prefix}{kind} names")
        for k in range(max(len(saved), len(expected))):
            there, here = (f"'{names[k]}'" if k < len(names) else "none" for names in (saved, expected))
            if there != here:
                raise FileError(
                    f"{archive.path}: the trajectory belongs to another mechanism: its {kind} number {k + 1} is "
                    f"{there}, that of the mechanism is {here}"
                )


def read_times(archive: Archive) -> np.ndarray:
    """Return the times (n_t,), s, none before the last one."""
    t = archive.numbers("t", None)
    if np.any(np.diff(t) < 0):
        raise archive.refuse("the entry 't' decreases")
    return t


def read_columns(archive: Archive, prefix: str, eom: Equations, count: int) -> Arrays:
    """Return ``q, v, a, z, lam, u`` by time."""
    return six(
        archive.numbers(prefix + name, count, size, unknown=name != "q")
        for name, size in zip(ARRAYS, eom.sizes, strict=True)
    )


def states_of(states: Sequence[State], eom: Equations, prefix: str) -> dict[str, Any]:
    """Return the entries of single states of one mechanism, with their impulses and obstacles."""
    content: dict[str, Any] = {
        prefix + name: np.reshape([getattr(state, name) for state in states], (len(states), size))
        for name, size in zip(ARRAYS, eom.sizes, strict=True)
    }
    impulses = [None if s.impulses is None else _by_name(s.impulses) for s in states]
    content[f"{prefix}impulses"] = json.dumps(impulses)
    content[f"{prefix}obstacles"] = json.dumps(["" if s.obstacle is None else str(s.obstacle) for s in states])
    return content


def _by_name(impulses: Mapping[Any, np.ndarray]) -> dict[str, list[float]]:
    return {getattr(element, "name", element): np.asarray(values).tolist() for element, values in impulses.items()}


def read_states(
    archive: Archive, prefix: str, eom: Equations, times: np.ndarray, parameters: Sequence[np.ndarray]
) -> list[State]:
    """Return what :func:`states_of` wrote, at times and with parameters by state."""
    columns = read_columns(archive, prefix, eom, times.size)
    # files of older versions hold no impulses
    impulses = _listed(archive, f"{prefix}impulses", times.size, None)
    obstacles = _listed(archive, f"{prefix}obstacles", times.size, "")
    elements = {element.name: element for element in eom.row_elements}
    states = []
    for k, (time, p) in enumerate(zip(times.tolist(), parameters, strict=True)):
        arrays = six(x[k] for x in columns)
        obstacle = MechanismError(obstacles[k]) if obstacles[k] else None
        by_element = None
        if impulses[k] is not None:
            by_element = {elements.get(name, name): np.array(x, float) for name, x in impulses[k].items()}
        states.append(State(eom.mechanism, time, *arrays, p, obstacle, by_element))
    return states


def _listed(archive: Archive, name: str, count: int, otherwise: Any) -> list[Any]:
    if name not in archive:
        return [otherwise] * count
    values = archive.json_list(name, count)
    kinds = (dict, type(None)) if otherwise is None else (str,)
    if not all(isinstance(value, kinds) for value in values):
        raise archive.refuse(f"the entry '{name}' holds {next(v for v in values if not isinstance(v, kinds))!r}")
    return values
