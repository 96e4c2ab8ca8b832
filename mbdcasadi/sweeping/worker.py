"""What travels to a worker, and what it does there: casadi.Functions and arrays, nothing of the model."""

from __future__ import annotations

import threading
from uuid import uuid4

import casadi as ca
import numpy as np

from ..integrators.compiled import last_line
from ..numerics.console import call

_compiled: dict[tuple[str, int], ca.Function] = {}


class Parcel:
    """A compiled run ``(x0, p, levels) -> (outputs, clock)`` that unpacks once in each process and thread.

    Parameters
    ----------
    function : casadi.Function
        The run.
    span : float
        What the clock shows at its end, s.
    """

    def __init__(self, function: ca.Function, span: float):
        self.key = uuid4().hex
        self.text = function.serialize()
        self.span = span

    def unpacked(self) -> ca.Function:
        """The function, of this thread alone: an integrator keeps a memory of its own."""
        key = self.key, threading.get_ident()
        if key not in _compiled:
            _compiled[key] = ca.Function.deserialize(self.text)
        return _compiled[key]


def run_batch(
    parcel: Parcel, starts: np.ndarray, parameters: np.ndarray, levels: np.ndarray
) -> tuple[np.ndarray, list[str]]:
    """Run some cases one after the other.

    Parameters
    ----------
    parcel : Parcel
        The run.
    starts, parameters, levels : numpy.ndarray
        By case (k, …).

    Returns
    -------
    values : numpy.ndarray
        Outputs (k, n); NaN for a case that failed.
    messages : list of str
        Why it failed; empty where it did not.
    """
    function = parcel.unpacked()
    values = np.full((len(starts), function.numel_out(0)), np.nan)
    messages = []
    for k, case in enumerate(zip(starts, parameters, levels, strict=True)):
        try:
            row, clock = call(_evaluated, function, case)
            arrived = abs(clock - parcel.span) <= 1e-6 * parcel.span and np.all(np.isfinite(row))
            message = "" if arrived else "a step became too small, or a value was not finite"
        except RuntimeError as error:
            message = last_line(error)
        if message:
            messages.append(
                f"the integrator stopped: {message}; simulate with the values of this case says where and why"
            )
        else:
            values[k] = row
            messages.append("")
    return values, messages


def _evaluated(function: ca.Function, case: tuple[np.ndarray, ...]) -> tuple[np.ndarray, float]:
    """Outputs of a case by time, and its clock, as numbers."""
    found, clock = function(*case)
    return found.full().ravel(order="F"), float(clock)
