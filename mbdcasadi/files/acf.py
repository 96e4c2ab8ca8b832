"""Analyses from the JSON analysis files of the ME451 course (``.acf``)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..errors import FileError
from .fields import Fields
from .text import read_json

KINDS = ("kinematics", "inverse dynamics", "dynamics")
#: Analyses that other programs of the course name, and the function that does them here.
_ELSEWHERE = {"equilibrium": "mbd.equilibrium", "static": "mbd.equilibrium", "statics": "mbd.equilibrium"}
_MOST_STEPS = 10_000_000


@dataclass(frozen=True)
class Analysis:
    """Content of an analysis file.

    Attributes
    ----------
    kind : {"kinematics", "inverse dynamics", "dynamics"}
        Kind of analysis.
    end : float
        Its last time, s; it starts at 0.
    output_steps : int
        Number of intervals between outputs.
    step_size : float or None
        Step that the file proposes, s. The integrators choose theirs.
    """

    kind: str
    end: float
    output_steps: int
    step_size: float | None = None

    @property
    def times(self) -> np.ndarray:
        """Output times (output_steps + 1,), s."""
        return np.linspace(0.0, self.end, self.output_steps + 1)


def read_acf(path: str | Path) -> Analysis:
    """Read an analysis file.

    It holds ``simulation`` (``"Kinematics"``, ``"Dynamics"`` or ``"Inverse
    dynamics"``), ``tend``, ``outputSteps`` and, if at all, ``stepSize``.

    Parameters
    ----------
    path : str or Path
        The file.

    Returns
    -------
    Analysis
        Kind, end, and ``.times``.

    Raises
    ------
    FileError
        With the file, the field and its value.

    Examples
    --------
    >>> import mbdcasadi as mbd
    >>> mbd.read_acf("examples/models/slider_crank.acf").times[-1]
    np.float64(2.0)
    """
    fields = Fields(read_json(path), Path(path).name, "")
    end = fields.number("tend", above=0.0)
    steps = fields.whole("outputSteps")
    if not 1 <= steps <= _MOST_STEPS:
        raise fields.refuse(f"outputSteps must be from 1 to {_MOST_STEPS}, got {steps}")
    step_size = fields.number("stepSize", above=0.0) if fields.has("stepSize") else None
    kind = _kind(fields)
    fields.done()
    return Analysis(kind, end, steps, step_size)


def _kind(fields: Fields) -> str:
    written = fields.text("simulation")
    kind = " ".join(written.lower().replace("_", " ").replace("-", " ").split())
    if kind in ("inverse", "inversedynamics"):
        kind = "inverse dynamics"
    if kind in KINDS:
        return kind
    elsewhere = f"; use {_ELSEWHERE[kind]} in Python" if kind in _ELSEWHERE else ""
    raise FileError(
        f"{fields.file}: simulation = '{written}' is not supported{elsewhere}; known are {', '.join(KINDS)}"
    )
