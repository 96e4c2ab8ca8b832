"""Trajectories as tables and data sets."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..errors import MechanismError
from ..numerics.lazy import optional_package
from ..numerics.writing import whole_file
from .columns import columns, phase_numbers, read_expressions
from .motion import Motion
from .stored_states import ARRAYS, column_names

if TYPE_CHECKING:
    import pandas
    import xarray


def to_pandas(motion: Motion, expressions: dict[str, Any] | None = None) -> pandas.DataFrame:
    """Return a DataFrame whose index is the time ``t``, s.

    Parameters
    ----------
    expressions : dict of str to expression, optional
        Scalars keep their names; a vector of two becomes ``name.x`` and
        ``name.y``, others ``name[0]`` and so on. Without, the columns of :func:`to_csv`.
    """
    pd = optional_package("pandas", "to_pandas", "data")
    return pd.DataFrame(columns(motion, expressions), index=pd.Index(motion.t, name="t"))


def to_xarray(motion: Motion, expressions: dict[str, Any] | None = None) -> xarray.Dataset:
    """Return a Dataset with the dimension ``t``, s.

    Parameters
    ----------
    expressions : dict of str to expression, optional
        One variable each; a vector of two has the dimension ``axis`` (x, y),
        others have the dimensions ``name_0`` and ``name_1``. Without, ``q, v, a`` by
        ``coordinate``, ``lam`` by ``row``, ``z`` by ``state`` and ``inputs`` by ``input``.
        A motion through several mechanisms has the coordinate ``phase``: its number by time, from 0.
    """
    xr = optional_package("xarray", "to_xarray", "data")
    variables: dict[str, Any] = {}
    coordinates: dict[str, Any] = {"t": ("t", motion.t, {"units": "s"})}
    if len(motion.phases) > 1 and "phase" not in (expressions or {}):
        coordinates["phase"] = ("t", phase_numbers(motion))
    if expressions is None:
        names = column_names(motion.equations)
        coordinates |= {kind: list(names[kind]) for kind in ARRAYS.values()}
        variables = {name: (("t", kind), getattr(motion, name)) for name, kind in ARRAYS.items()}
        return xr.Dataset(variables, coords=coordinates)
    for name, expression in read_expressions(expressions).items():
        values = motion[expression]
        if values.ndim == 2 and values.shape[1] == 2:
            variables[name] = (("t", "axis"), values)
            coordinates["axis"] = ["x", "y"]
        else:
            variables[name] = (("t", *(f"{name}_{k}" for k in range(values.ndim - 1))), values)
    return xr.Dataset(variables, coords=coordinates)


def to_csv(motion: Motion, path: str | Path, expressions: dict[str, Any] | None = None) -> None:
    """Write a table with the column ``t`` and one for each quantity; a failure leaves no file behind.

    Parameters
    ----------
    path : str or Path
        The file.
    expressions : dict of str to expression, optional
        As for :func:`to_pandas`. Without: ``body.x, .y, .phi, .vx, .vy,
        .omega, .ax, .ay, .alpha``; by joint ``joint.fx, .fy`` (N, global axes)
        and ``.torque`` (N m, about the joint marker), which act on the second
        marker's body, or on the one that moves if that is the ground;
        ``driver.effort``; inputs and first-order states; ``phase``, the number of the phase from 0, if the motion
        goes through several mechanisms.
    """
    table = columns(motion, expressions)
    if "t" in table:
        raise MechanismError("the column 't' is the time; give the expression another name")
    rows = np.column_stack([motion.t, *table.values()])
    with whole_file(path) as temporary, open(temporary, "w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(["t", *table])
        writer.writerows(rows.tolist())
