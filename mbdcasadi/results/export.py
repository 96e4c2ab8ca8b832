"""Trajectories as tables, data sets and files."""

from __future__ import annotations

import csv
import importlib
import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..equations import Equations, equations
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..errors import FileError, MechanismError
from ..model.mechanism import Mechanism
from ..numerics.writing import whole_file
from .archives import read_arrays, write_arrays
from .columns import columns, read_expressions
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
        Scalars are named as given; a vector of two becomes ``name.x`` and
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
        others have dimensions ``name_0`` and ``name_1`` of their own. Without, ``q, v, a`` by
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
        marker's body, or on the one that moves where that is the ground;
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
        The file, named as given; ``.npz`` is usual.
    """
    content: dict[str, Any] = {"format": _FORMAT, "t": motion.t, "parameters": motion.parameters}
    content |= {name: getattr(motion, name) for name in _ARRAYS}
    content |= {f"{kind} names": np.array(names, dtype=str) for kind, names in _names(motion.equations).items()}
    content["missing multipliers"] = motion._missing_multipliers
    content["statistics"] = json.dumps(asdict(motion.statistics))
    content["event names"] = np.array([event.name for event in motion.events], dtype=str)
    content["event t"] = np.array([event.t for event in motion.events])
    for name in _ARRAYS:
        values = [getattr(event.state, name) for event in motion.events]
        content[f"event {name}"] = np.reshape(values, (len(values), getattr(motion, name).shape[1]))
        values = [getattr(event.after or event.state, name) for event in motion.events]
        content[f"event after {name}"] = np.reshape(values, (len(values), getattr(motion, name).shape[1]))
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
        For a file that is none, or belongs to another mechanism; it names the first difference.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> model = mbd.read_adm("examples/models/slider_crank.adm")
    >>> mbd.simulate(model, duration=0.1).save("run.npz")  # doctest: +SKIP
    >>> motion = mbd.read_trajectory("run.npz", model)  # doctest: +SKIP
    """
    content = read_arrays(Path(path), _FORMAT, "trajectory", "Trajectory.save")
    eom = equations(mechanism)
    for kind, names in _names(eom).items():
        _check_names(path, kind, content[f"{kind} names"].tolist(), names)
    parameters = content["parameters"]
    q, v, a, z, lam, u = (content[name] for name in _ARRAYS)
    return Trajectory(
        mechanism,
        content["t"],
        q,
        v,
        a,
        z,
        lam,
        u,
        parameters,
        events=[_event(mechanism, content, k) for k in range(content["event t"].size)],
        statistics=Statistics(**json.loads(str(content["statistics"]))),
        refine=_refine(eom, content),
        missing_multipliers=str(content["missing multipliers"]),
    )


def _event(mechanism: Mechanism, content: dict[str, np.ndarray], k: int) -> EventOccurrence:
    time = float(content["event t"][k])

    def state(which: str) -> State:
        q, v, a, z, lam, u = (content[f"{which} {name}"][k] for name in _ARRAYS)
        return State(mechanism, time, q, v, a, z, lam, u, content["parameters"])

    after = state("event after") if "event resets" in content and content["event resets"][k] else None
    return EventOccurrence(str(content["event names"][k]), time, state("event"), after)


def _names(eom: Equations) -> dict[str, tuple[str, ...]]:
    mechanism = eom.mechanism
    return {
        "coordinate": eom.coordinate_names,
        "row": eom.row_names,
        "state": tuple(s.label for s in mechanism.states),
        "input": tuple(u.label for u in mechanism.inputs),
        "parameter": tuple(p.label for p in mechanism.parameters),
    }


def _check_names(path: str | Path, kind: str, found: Sequence[str], expected: Sequence[str]) -> None:
    for k in range(max(len(found), len(expected))):
        there, here = (f"'{names[k]}'" if k < len(names) else "none" for names in (found, expected))
        if there != here:
            raise FileError(
                f"{path}: the trajectory belongs to another mechanism: its {kind} number {k + 1} is {there}, "
                f"that of the mechanism is {here}"
            )


def _refine(eom: Equations, content: dict[str, np.ndarray]) -> Callable[..., tuple[np.ndarray, ...]] | None:
    """How values between the times return onto the constraints, as in the run that was saved."""
    if not content["t"].size or any(getattr(element, "modes", ()) for element in eom.mechanism.elements):
        return None  # the constraints of exact friction change along the motion
    numeric = NumericEquations(eom, content["parameters"])
    redundant = numeric.rank(float(content["t"][0]), content["q"][0]).rank < eom.lam.numel()
    return Recovery(numeric, redundant=redundant).refine()


def _imported(name: str, method: str) -> Any:
    try:
        return importlib.import_module(name)
    except ImportError:
        raise MechanismError(f'{method} needs {name}; install it by pip install "mbdcasadi[data]"') from None
