"""Motions as entries of one NumPy file without pickle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..equations import equations
from ..model.mechanism import Mechanism
from .archives import write_arrays
from .fingerprint import fingerprint
from .motion import Motion
from .state import EventOccurrence, State
from .stored_states import ARRAYS, column_names, states_of
from .stored_steps import steps_of

#: Formats of a motion in one mechanism, and of one through several.
FORMAT, PHASED_FORMAT = "mbdcasadi trajectory 1", "mbdcasadi phased trajectory 1"


def save(motion: Motion, path: str | Path) -> None:
    """Write all arrays, the names they belong to, events and statistics to one NumPy file, without pickle.

    ``.npz`` is usual as its ending, and is not added.
    """
    write_arrays(path, _content(motion) if motion.phases[0] is motion else _phased_content(motion))


def _content(motion: Motion) -> dict[str, Any]:
    """Entries of a motion in one mechanism."""
    eom = motion.equations
    content: dict[str, Any] = {"format": FORMAT, "t": motion.t, "parameters": motion.parameters}
    content |= {name: getattr(motion, name) for name in ARRAYS}
    content |= {f"{kind} names": np.array(names, dtype=str) for kind, names in column_names(eom).items()}
    content["fingerprint"] = fingerprint(eom, motion.arguments)
    content["missing multipliers"] = motion.missing_multipliers
    content["statistics"] = json.dumps(asdict(motion.statistics))
    content["event names"] = np.array([event.name for event in motion.events], dtype=str)
    content["event t"] = np.array([event.t for event in motion.events], float)
    content |= states_of([event.state for event in motion.events], eom, "event ")
    content |= states_of([event.after or event.state for event in motion.events], eom, "event after ")
    content["event resets"] = np.array([event.after is not None for event in motion.events], dtype=bool)
    return content | steps_of(motion)


def _phased_content(motion: Motion) -> dict[str, Any]:
    """Entries of a motion through several mechanisms."""
    parts, whole = motion.phases, motion.mechanism
    mechanisms = list(dict.fromkeys(part.mechanism for part in parts))
    content: dict[str, Any] = {
        "format": PHASED_FORMAT,
        "t": motion.t,
        "parameter names": np.array([p.label for p in whole.parameters], dtype=str),
        "parameters": np.reshape(motion.parameters_by_phase, (len(parts), len(whole.parameters))),
        "phase mechanisms": np.array([mechanisms.index(part.mechanism) for part in parts]),
        "phase lengths": np.array([len(part) for part in parts]),
        "phase statistics": json.dumps([asdict(part.statistics) for part in parts]),
        "missing multipliers": json.dumps([part.missing_multipliers for part in parts]),
        "statistics": json.dumps(asdict(motion.statistics)),
    }
    for k, mechanism in enumerate(mechanisms):
        its_parts, eom = [part for part in parts if part.mechanism is mechanism], equations(mechanism)
        prefix = f"mechanism {k} "
        content |= {prefix + name: np.vstack([getattr(part, name) for part in its_parts]) for name in ARRAYS}
        content |= {f"{prefix}{kind} names": np.array(names, dtype=str) for kind, names in column_names(eom).items()}
        content[f"{prefix}fingerprint"] = fingerprint(eom, its_parts[0].arguments)
    for k, part in enumerate(parts):
        content |= steps_of(part, f"phase {k} ")
    return content | _events_of(motion, mechanisms)


def _events_of(motion: Motion, mechanisms: Sequence[Mechanism]) -> dict[str, Any]:
    """Entries of the events: their states by mechanism, and the places of each event's states there."""
    states: list[list[State]] = [[] for _ in mechanisms]
    values: list[np.ndarray] = []
    rows = []
    for event in motion.events:
        places = []
        for state in (event.state, event.after):
            if state is None:
                places += [-1, -1]
                continue
            k = mechanisms.index(state.mechanism)
            places += [k, len(states[k])]
            states[k].append(state)
            values.append(state.whole.parameters)
        rows.append([_phase_of(event, motion), *places])
    content: dict[str, Any] = {
        "event names": np.array([event.name for event in motion.events], dtype=str),
        "event t": np.array([event.t for event in motion.events], float),
        "event places": np.reshape(rows, (len(rows), 5)).astype(int),
        "event parameters": np.reshape(values, (len(values), motion.parameters.size)),
    }
    for k, (mechanism, its_states) in enumerate(zip(mechanisms, states, strict=True)):
        content |= states_of(its_states, equations(mechanism), f"mechanism {k} event ")
    return content


def _phase_of(event: EventOccurrence, motion: Motion) -> int:
    """Number of the phase within which an event took place; -1 of a change between phases."""
    for k, part in enumerate(motion.phases):
        if any(other.name == event.name and other.t == event.t for other in part.events):
            return k
    return -1
