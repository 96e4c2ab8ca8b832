"""Trajectories as tables, data sets and files."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..equations import Equations, equations
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import MechanismError, warn
from ..model.mechanism import Mechanism
from ..numerics.writing import whole_file
from .archives import Archive, check_names, read_arrays, write_arrays
from .columns import columns, read_expressions
from .fingerprint import difference, fingerprint
from .state import State
from .trajectory import EventOccurrence, Statistics, Trajectory

if TYPE_CHECKING:
    import pandas
    import xarray

_FORMAT = "mbdcasadi trajectory 1"
#: Arrays by time, and what their columns belong to.
_ARRAYS = {"q": "coordinate", "v": "coordinate", "a": "coordinate", "z": "state", "lam": "row", "inputs": "input"}


def to_pandas(motion: Trajectory, expressions: dict[str, Any] | None = None) -> pandas.DataFrame:
    """Return a DataFrame whose index is the time ``t``, s.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    expressions : dict of str to expression, optional
        Scalars keep their names; a vector of two becomes ``name.x`` and
        ``name.y``, others ``name[0]`` and so on. Without, the columns of :func:`to_csv`.
    """
    pd = _imported("pandas", "to_pandas")
    return pd.DataFrame(columns(motion, expressions), index=pd.Index(motion.t, name="t"))


def to_xarray(motion: Trajectory, expressions: dict[str, Any] | None = None) -> xarray.Dataset:
    """Return a Dataset with the dimension ``t``, s.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    expressions : dict of str to expression, optional
        One variable each; a vector of two has the dimension ``axis`` (x, y),
        others have the dimensions ``name_0`` and ``name_1``. Without, ``q, v, a`` by
        ``coordinate``, ``lam`` by ``row``, ``z`` by ``state`` and ``inputs`` by ``input``.
    """
    xr = _imported("xarray", "to_xarray")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"t": ("t", motion.t, {"units": "s"})}
    if expressions is None:
        names = _names(motion.equations)
        coordinates |= {kind: list(names[kind]) for kind in _ARRAYS.values()}
        variables = {name: (("t", kind), getattr(motion, name)) for name, kind in _ARRAYS.items()}
        return xr.Dataset(variables, coords=coordinates)
    for name, expression in read_expressions(expressions).items():
        values = motion[expression]
        if values.ndim == 2 and values.shape[1] == 2:
            variables[name] = (("t", "axis"), values)
            coordinates["axis"] = ["x", "y"]
        else:
            variables[name] = (("t", *(f"{name}_{k}" for k in range(values.ndim - 1))), values)
    return xr.Dataset(variables, coords=coordinates)


def to_csv(motion: Trajectory, path: str | Path, expressions: dict[str, Any] | None = None) -> None:
    """Write a table with the column ``t`` and one for each quantity; a failure leaves no file behind.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    path : str or Path
        The file.
    expressions : dict of str to expression, optional
        As for :func:`to_pandas`. Without: ``body.x, .y, .phi, .vx, .vy,
        .omega, .ax, .ay, .alpha``; by joint ``joint.fx, .fy`` (N, global axes)
        and ``.torque`` (N m, about the joint marker), which act on the second
        marker's body, or on the one that moves if that is the ground;
        ``driver.effort``; inputs and first-order states.
    """
    table = columns(motion, expressions)
    if "t" in table:
        raise MechanismError("the column 't' is the time; give the expression another name")
    rows = np.column_stack([motion.t, *table.values()])
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["t", *table])
        writer.writerows(rows.tolist())


# --- the whole trajectory ------------------------------------------------------------
def save(motion: Trajectory, path: str | Path) -> None:
    """Write all arrays, the names they belong to, events and statistics to one NumPy file, without pickle.

    Parameters
    ----------
    motion : Trajectory
        The motion.
    path : str or Path
        The file; ``.npz`` is usual, and is not added.
    """
    content: dict[str, Any] = {"format": _FORMAT, "t": motion.t, "parameters": motion.parameters}
    content |= {name: getattr(motion, name) for name in _ARRAYS}
    content |= {f"{kind} names": np.array(names, dtype=str) for kind, names in _names(motion.equations).items()}
    content["fingerprint"] = fingerprint(motion.equations, motion.arguments)
    content["missing multipliers"] = motion._missing_multipliers
    content["statistics"] = json.dumps(asdict(motion.statistics))
    content["event names"] = np.array([event.name for event in motion.events], dtype=str)
    content["event t"] = np.array([event.t for event in motion.events], float)
    for name in _ARRAYS:
        for entry, states in (
            ("event", [event.state for event in motion.events]),
            ("event after", [event.after or event.state for event in motion.events]),
        ):
            values = [getattr(state, name) for state in states]
            content[f"{entry} {name}"] = np.reshape(values, (len(values), getattr(motion, name).shape[1]))
    content["event resets"] = np.array([event.after is not None for event in motion.events], dtype=bool)
    write_arrays(path, content)


def read_trajectory(path: str | Path, mechanism: Mechanism) -> Trajectory:
    """Read what ``Trajectory.save`` wrote.

    Parameters
    ----------
    path : str or Path
        The file.
    mechanism : Mechanism
        The model that it belongs to: coordinates, rows, states, inputs and
        parameters must have the same names in the same order.

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
    if not isinstance(mechanism, Mechanism):
        raise MechanismError(f"read_trajectory: takes a mechanism after the path, got {mechanism!r}")
    archive = read_arrays(path, _FORMAT, "trajectory", "Trajectory.save")
    eom = equations(mechanism)
    for kind, names in _names(eom).items():
        check_names(archive, kind, "trajectory", names)
    t = archive.numbers("t", None)
    if np.any(np.diff(t) < 0):
        raise archive.refuse("the entry 't' decreases")
    parameters = archive.numbers("parameters", len(mechanism.parameters))
    arrays = q, v, a, z, lam, u = _states(archive, "", eom, t.size)
    unknown_multipliers = str(archive.get("missing multipliers", ""))
    for name, values in ({"v": v, "a": a} | ({} if unknown_multipliers else {"lam": lam})).items():
        if values.size and np.all(np.isnan(values)):
            raise archive.refuse(f"the entry '{name}' is not a number at any time")
    if "fingerprint" in archive:
        here = fingerprint(eom, (t[:, None], *arrays, parameters[None]))
        other = difference(eom, archive["fingerprint"], here)
        if other:
            warn(
                f"{path}: the mechanism has the names of the one that was saved, but differs from it in {other}",
            )
    known = {field.name for field in fields(Statistics)}
    statistics = archive.json("statistics") if "statistics" in archive else {}
    if not isinstance(statistics, dict):
        raise archive.refuse(f"the entry 'statistics' holds {statistics!r} instead of names and values")
    return Trajectory(
        mechanism,
        t,
        q,
        v,
        a,
        z,
        lam,
        u,
        parameters,
        events=_events(archive, eom, parameters),
        statistics=Statistics(**{name: value for name, value in statistics.items() if name in known}),
        refine=_refine(eom, t, q, parameters),
        missing_multipliers=unknown_multipliers,
    )


def _states(archive: Archive, prefix: str, eom: Equations, count: int) -> list[np.ndarray]:
    """``q, v, a, z, lam, u`` by time."""
    sizes = (x.numel() for x in (eom.q, eom.v, eom.a, eom.z, eom.lam, eom.u))
    return [
        archive.numbers(prefix + name, count, size, unknown=name != "q")
        for name, size in zip(_ARRAYS, sizes, strict=True)
    ]


def _events(archive: Archive, eom: Equations, parameters: np.ndarray) -> list[EventOccurrence]:
    times = archive.numbers("event t", None)
    names = archive.names("event names", times.size)
    before = _states(archive, "event ", eom, times.size)
    # files of older versions know no resets
    resets = archive.numbers("event resets", times.size) if "event resets" in archive else np.zeros(times.size, bool)
    after = _states(archive, "event after ", eom, times.size) if np.any(resets) else before

    def state(arrays: Sequence[np.ndarray], k: int) -> State:
        q, v, a, z, lam, u = (x[k] for x in arrays)
        return State(eom.mechanism, float(times[k]), q, v, a, z, lam, u, parameters)

    return [
        EventOccurrence(name, float(times[k]), state(before, k), state(after, k) if resets[k] else None)
        for k, name in enumerate(names)
    ]


def _names(eom: Equations) -> dict[str, tuple[str, ...]]:
    mechanism = eom.mechanism
    return {
        "coordinate": eom.coordinate_names,
        "row": eom.row_names,
        "state": tuple(s.label for s in mechanism.states),
        "input": tuple(u.label for u in mechanism.inputs),
        "parameter": tuple(p.label for p in mechanism.parameters),
    }


def _refine(
    eom: Equations, t: np.ndarray, q: np.ndarray, parameters: np.ndarray
) -> Callable[..., tuple[np.ndarray, ...]] | None:
    """Return the function that brings values between the times onto the constraints, as in the run that was saved."""
    if not t.size or any(getattr(element, "modes", ()) for element in eom.mechanism.elements):
        return None  # the constraints of exact friction change along the motion
    numeric = NumericEquations(eom, parameters)
    redundant = numeric.rank(float(t[0]), q[0]).rank < eom.lam.numel()
    return Recovery(numeric, redundant=redundant).refine()


def _imported(name: str, method: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MechanismError(f'{method} needs {name}; install it by pip install "mbdcasadi[data]"') from None
