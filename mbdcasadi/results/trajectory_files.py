"""Trajectories in files: one NumPy file without pickle."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from ..equations import Equations, equations
from ..errors import FileError, MechanismError, warn
from ..model.mechanism import Mechanism
from .archives import Archive, read_arrays
from .fingerprint import difference, fingerprint
from .motion import Statistics
from .phases import PhasedTrajectory, in_whole, union_of
from .saving import FORMAT, PHASED_FORMAT
from .state import Arrays, EventOccurrence, State, six
from .stored_states import check_columns, read_columns, read_states, read_times
from .stored_steps import read_steps
from .trajectory import Trajectory


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
        Between its times it is the motion that was saved.

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
    archive = read_arrays(path, (FORMAT, PHASED_FORMAT), "trajectory", "Trajectory.save")
    if str(archive["format"]) == PHASED_FORMAT:
        return _read_phased(archive, mechanisms)
    if len(mechanisms) > 1:
        raise FileError(
            f"{path}: the motion goes through one mechanism, and {len(mechanisms)} are given; give only that one"
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
    arrays = _, v, a, _, lam, _ = read_columns(archive, "", eom, t.size)
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
        statistics=_read_statistics(archive, archive.json("statistics") if "statistics" in archive else {}),
        interpolation=read_steps(archive, "", eom, t, arrays, parameters),
        missing_multipliers=unknown_multipliers,
    )


def _read_statistics(archive: Archive, values: Any) -> Statistics:
    """Statistics from names and values; those that this version does not know are left out."""
    if not isinstance(values, dict):
        raise archive.refuse(f"the entry 'statistics' holds {values!r} instead of names and values")
    known = {field.name for field in fields(Statistics)}
    return Statistics(**{name: value for name, value in values.items() if name in known})


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


# --- motions through several mechanisms -----------------------------------------------------


def _read_phased(archive: Archive, candidates: Sequence[Mechanism]) -> PhasedTrajectory:
    """A motion through several mechanisms, which are given in any order."""
    numbers, times = _read_phases(archive)
    count = int(numbers.max()) + 1
    labels = archive.names("parameter names")
    values = archive.numbers("parameters", numbers.size, len(labels))
    matching = _Matching(archive, candidates, count)
    mechanisms: list[Mechanism] = []
    tables: list[Arrays] = []
    for k in range(count):
        chosen = np.flatnonzero(numbers == k)
        own_t, first = np.concatenate([times[i] for i in chosen]), chosen[0]
        mechanism, columns = matching.find(k, own_t, times[first].size, labels, values[first])
        mechanisms.append(mechanism)
        tables.append(columns)
    matching.warn_of_differences()
    whole = union_of([*mechanisms, *candidates])
    by_phase = [_parameters_in(whole, labels, row) for row in values]
    events, own_events = _read_phased_events(archive, mechanisms, whole, labels, numbers.size)
    all_statistics, missing = (
        archive.json_list(name, numbers.size) for name in ("phase statistics", "missing multipliers")
    )
    parts, used = [], [0] * count
    for i, k in enumerate(numbers):
        eom, rows = equations(mechanisms[k]), slice(used[k], used[k] + times[i].size)
        used[k] += times[i].size
        columns = six(x[rows] for x in tables[k])
        p = _parameters_in(eom.mechanism, labels, values[i])
        part = Trajectory(
            mechanisms[k],
            times[i],
            *columns,
            p,
            events=own_events[i],
            statistics=_read_statistics(archive, all_statistics[i]),
            interpolation=read_steps(archive, f"phase {i} ", eom, times[i], columns, p),
            missing_multipliers=str(missing[i]),
        )
        parts.append(part)
    statistics = _read_statistics(archive, archive.json("statistics"))
    return PhasedTrajectory(parts, whole, by_phase, events=events, statistics=statistics)


def _read_phases(archive: Archive) -> tuple[np.ndarray, list[np.ndarray]]:
    """Number of the mechanism, and times, s, by phase."""
    t = read_times(archive)
    numbers = archive.numbers("phase mechanisms", None).astype(int)
    lengths = archive.numbers("phase lengths", numbers.size).astype(int)
    if not numbers.size or np.sum(lengths) != t.size or np.any(lengths < 0) or np.any(numbers < 0):
        raise archive.refuse("the entries 'phase mechanisms' and 'phase lengths' do not fit the times")
    if set(numbers.tolist()) != set(range(int(numbers.max()) + 1)):
        raise archive.refuse("the entry 'phase mechanisms' leaves out a number")
    return numbers, [t[first:last] for first, last in pairwise(np.cumsum([0, *lengths]))]


class _Matching:
    """Mechanisms of a file among those that are given: by their names, and by their fingerprints if several fit."""

    def __init__(self, archive: Archive, given: Sequence[Mechanism], count: int):
        self._archive, self._given, self._count = archive, given, count
        self._taken: set[Mechanism] = set()
        self._differences: list[str] = []

    def find(
        self, number: int, t: np.ndarray, count: int, labels: Sequence[str], values: np.ndarray
    ) -> tuple[Mechanism, Arrays]:
        """Return a mechanism and its columns ``q, v, a, z, lam, u``; `count` times are those of its first phase."""
        candidates: list[tuple[bool, bool, Mechanism, Arrays, str]] = []
        for mechanism in self._with_names(number):
            eom = equations(mechanism)
            columns = read_columns(self._archive, f"mechanism {number} ", eom, t.size)
            p = _parameters_in(eom.mechanism, labels, values)
            first = [x[:count] for x in columns]
            here = fingerprint(eom, (t[:count, None], *first, p[None]))
            other = difference(eom, self._archive.rows(f"mechanism {number} fingerprint"), here)
            candidates.append((bool(other), mechanism in self._taken, mechanism, columns, other))
        _, _, mechanism, columns, other = min(candidates, key=lambda one: one[:2])
        self._taken.add(mechanism)
        if other:
            self._differences.append(f"mechanism {number + 1} in {other}")
        return mechanism, columns

    def _with_names(self, number: int) -> list[Mechanism]:
        """Given mechanisms with the names of one in the file."""
        fitting, errors = [], []
        for mechanism in self._given:
            try:
                check_columns(self._archive, equations(mechanism), f"mechanism {number} ")
            except FileError as error:
                errors.append(error)
            else:
                fitting.append(mechanism)
        if fitting:
            return fitting
        message = str(errors[min(number, len(errors) - 1)])
        if len(self._given) == 1 and self._count > 1:
            message += f"; the motion goes through {self._count} mechanisms: give them in a list"
        raise FileError(f"{message} (mechanism {number + 1} of the motion)")

    def warn_of_differences(self) -> None:
        """Warn of mechanisms that have the right names but other masses, lengths or forces."""
        if self._differences:
            warn(
                f"{self._archive.path}: the mechanisms have the names of those that were saved, but differ from them: "
                + ", ".join(self._differences)
            )


def _read_phased_events(
    archive: Archive, mechanisms: Sequence[Mechanism], whole: Mechanism, labels: Sequence[str], phases: int
) -> tuple[list[EventOccurrence], list[list[EventOccurrence]]]:
    """All events in the symbols of the whole, and by phase those within it."""
    times = archive.numbers("event t", None)
    names = archive.names("event names", times.size)
    rows = archive.numbers("event places", times.size, 5).astype(int)
    if np.any(rows[:, 0] >= phases) or np.any(rows[:, [1, 3]] >= len(mechanisms)) or np.any(rows[:, 1] < 0):
        raise archive.refuse("the entry 'event places' does not hold places")
    places = [(k, place, times[i], i) for i, row in enumerate(rows) for k, place in (row[1:3], row[3:5]) if k >= 0]
    values = archive.numbers("event parameters", len(places), len(labels))
    by_place = {(k, place): (time, values[i]) for i, (k, place, time, _) in enumerate(places)}
    if len(by_place) < len(places):
        raise archive.refuse("the entry 'event places' does not hold places")
    states = _states_at_events(archive, mechanisms, labels, by_place)
    events: list[EventOccurrence] = []
    by_phase: list[list[EventOccurrence]] = [[] for _ in range(phases)]
    for name, time, row in zip(names, times.tolist(), rows.tolist(), strict=True):
        phase, keys = row[0], [tuple(row[1:3]), tuple(row[3:5])]
        own_states = [states.get(key) for key in keys]
        wide = [
            None if s is None else in_whole(s, whole, _parameters_in(whole, labels, by_place[key][1]))
            for s, key in zip(own_states, keys, strict=True)
        ]
        assert own_states[0] is not None and wide[0] is not None
        events.append(EventOccurrence(name, time, wide[0], wide[1]))
        if phase >= 0:
            by_phase[phase].append(EventOccurrence(name, time, own_states[0], own_states[1]))
    return events, by_phase


def _states_at_events(
    archive: Archive,
    mechanisms: Sequence[Mechanism],
    labels: Sequence[str],
    by_place: Mapping[tuple[int, int], tuple[float, np.ndarray]],
) -> dict[tuple[int, int], State]:
    """States at events, by the number of their mechanism and their place, from their times and parameters."""
    states: dict[tuple[int, int], State] = {}
    for k, mechanism in enumerate(mechanisms):
        places = sorted(place for number, place in by_place if number == k)
        eom = equations(mechanism)
        at = np.array([by_place[k, place][0] for place in places], float)
        p = [_parameters_in(eom.mechanism, labels, by_place[k, place][1]) for place in places]
        read = read_states(archive, f"mechanism {k} event ", eom, at, p)
        states |= {(k, place): state for place, state in zip(places, read, strict=True)}
    return states


def _parameters_in(whole: Mechanism, labels: Sequence[str], values: np.ndarray) -> np.ndarray:
    """Values of all parameters; those that the file does not have keep their own."""
    known = dict(zip(labels, values.tolist(), strict=True))
    return np.array([known.get(p.label, whole.value_of(p, p.value)) for p in whole.parameters], float)
