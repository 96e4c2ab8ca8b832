"""Trajectories in files: one NumPy file without pickle."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from ..equations import Equations, equations
from ..errors import FileError, MechanismError, warn
from ..model.mechanism import Mechanism
from .archives import Archive, read_arrays, write_arrays
from .fingerprint import difference, fingerprint
from .phased_files import PHASED_FORMAT, read_phased
from .state import EventOccurrence
from .stored_states import (
    ARRAYS,
    check_columns,
    column_names,
    read_columns,
    read_states,
    read_statistics,
    read_times,
    refinement,
    states_of,
)
from .trajectory import Trajectory

_FORMAT = "mbdcasadi trajectory 1"


def save(motion: Trajectory, path: str | Path) -> None:
    """Write all arrays, the names they belong to, events and statistics to one NumPy file, without pickle.

    ``.npz`` is usual as its ending, and is not added.
    """
    eom = motion.equations
    content: dict[str, Any] = {"format": _FORMAT, "t": motion.t, "parameters": motion.parameters}
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
    write_arrays(path, content)


def read_trajectory(path: str | Path, mechanism: Mechanism | Sequence[Mechanism]) -> Trajectory:
    """Read what ``Trajectory.save`` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    mechanism : Mechanism or sequence of Mechanism
        The model that it belongs to: coordinates, rows, states, inputs and
        parameters must have the same names in the same order. For a motion through several mechanisms
        all of them, in any order.

    Returns
    -------
    Trajectory
        Its ``.at(times)`` takes inputs between the times as linear.

    Raises
    ------
    FileError
        If the file cannot be read, an entry is missing or damaged, or it belongs to a mechanism with other names; it
        names the first difference.

    Warns
    -----
    MechanismWarning
        If the mechanism has the same names, but other masses, lengths or forces than the one that was saved.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> model = mbd.read_adm("examples/models/slider_crank.adm")
    >>> mbd.simulate(model, duration=0.1).save("run.npz")  # doctest: +SKIP
    >>> motion = mbd.read_trajectory("run.npz", model)  # doctest: +SKIP
    """
    mechanisms = _read_mechanisms(mechanism)
    archive = read_arrays(path, (_FORMAT, PHASED_FORMAT), "trajectory", "Trajectory.save")
    if str(archive["format"]) == PHASED_FORMAT:
        return read_phased(archive, mechanisms)
    if len(mechanisms) > 1:
        raise FileError(
            f"{path}: the motion goes through one mechanism, and {len(mechanisms)} are given; give that one alone"
        )
    return _read_one(archive, equations(mechanisms[0]))


def _read_mechanisms(given: Any) -> tuple[Mechanism, ...]:
    mechanisms = tuple(given) if isinstance(given, list | tuple) else (given,)
    if not mechanisms or not all(isinstance(one, Mechanism) for one in mechanisms):
        raise MechanismError(f"read_trajectory: takes a mechanism after the path, got {given!r}")
    return mechanisms


def _read_one(archive: Archive, eom: Equations) -> Trajectory:
    check_columns(archive, eom)
    t = read_times(archive)
    parameters = archive.numbers("parameters", len(eom.mechanism.parameters))
    arrays = q, v, a, _, lam, _ = read_columns(archive, "", eom, t.size)
    unknown_multipliers = str(archive.get("missing multipliers", ""))
    for name, values in ({"v": v, "a": a} | ({} if unknown_multipliers else {"lam": lam})).items():
        if values.size and np.all(np.isnan(values)):
            raise archive.refuse(f"the entry '{name}' is not a number at any time")
    if "fingerprint" in archive:
        here = fingerprint(eom, (t[:, None], *arrays, parameters[None]))
        other = difference(eom, archive.rows("fingerprint"), here)
        if other:
            warn(
                f"{archive.path}: the mechanism has the names of the one that was saved, but differs from it in "
                f"{other}",
            )
    return Trajectory(
        eom.mechanism,
        t,
        *arrays,
        parameters,
        events=_events(archive, eom, parameters),
        statistics=read_statistics(archive, archive.json("statistics") if "statistics" in archive else {}),
        refine=refinement(eom, t, q, parameters),
        missing_multipliers=unknown_multipliers,
    )


def _events(archive: Archive, eom: Equations, parameters: np.ndarray) -> list[EventOccurrence]:
    times = archive.numbers("event t", None)
    names = archive.names("event names", times.size)
    before = read_states(archive, "event ", eom, times, [parameters] * times.size)
    # files of older versions know no resets
    resets = archive.numbers("event resets", times.size) if "event resets" in archive else np.zeros(times.size, bool)
    after = read_states(archive, "event after ", eom, times, [parameters] * times.size) if np.any(resets) else before
    return [
        EventOccurrence(name, state.t, state, following if resets[k] else None)
        for k, (name, state, following) in enumerate(zip(names, before, after, strict=True))
    ]
