"""The part of a sweep that travels to a worker: casadi.Functions and arrays, nothing of the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..integrators.failures import reason_of
from ..numerics.console import call
from .packed import Packed
from .starts import StartPath


class Parcel:
    """A compiled run ``(x0, p, levels, cuts, sides, borders) -> (outputs, clock)``, and the way to its starts.

    Parameters
    ----------
    function : casadi.Function
        The run.
    path : StartPath
        Way from the start of one case to those of others.
    span : float
        What the clock shows at the end, s.
    """

    def __init__(self, function: ca.Function, path: StartPath, span: float):
        self.run, self.path, self.span = Packed(function), path, span


@dataclass(frozen=True)
class Outcome:
    """Results of some cases.

    Attributes
    ----------
    values : numpy.ndarray
        Outputs (k, n); NaN for a case without.
    messages : list of str
        Why a case failed; empty for others.
    reached : numpy.ndarray of bool
        Whether its start was found (k,).
    """

    values: np.ndarray
    messages: list[str]
    reached: np.ndarray


def run_batch(
    parcel: Parcel,
    parameters: np.ndarray,
    levels: np.ndarray,
    course: tuple[np.ndarray, ...],
    starts: np.ndarray | None = None,
) -> Outcome:
    """Run some cases one after the other.

    Parameters
    ----------
    parcel : Parcel
        The run.
    parameters, levels : numpy.ndarray
        By case (k, …).
    course : tuple of numpy.ndarray
        Times of the cuts, sides and borders, by case (k, …).
    starts : numpy.ndarray, optional
        By case (k, n_x); found here if left out.
    """
    function = parcel.run.unpacked()
    if starts is None:
        starts, reached = parcel.path.starts(parameters)
    else:
        reached = np.ones(len(parameters), bool)
    values, messages = np.full((len(parameters), function.numel_out(0)), np.nan), [""] * len(parameters)
    for k in np.flatnonzero(reached):
        case = starts[k], parameters[k], levels[k], *(argument[k] for argument in course)
        try:
            row, clock = call(_evaluated, function, case)
            arrived = abs(clock - parcel.span) <= 1e-6 * parcel.span and np.all(np.isfinite(row))
            message = "" if arrived else "a step became too small, or a value was not finite"
        except RuntimeError as error:
            message = reason_of(error)
        if message:
            messages[k] = f"the integrator stopped: {message}; simulate with the values of this case says where and why"
        else:
            values[k] = row
    return Outcome(values, messages, reached)


def _evaluated(function: ca.Function, case: tuple[Any, ...]) -> tuple[np.ndarray, float]:
    """Outputs of a case by time, and its clock, as numbers."""
    found, clock = function(*case)
    return found.full().ravel(order="F"), float(clock)
