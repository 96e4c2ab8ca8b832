"""The part of a sweep that travels to a worker: casadi.Functions and arrays, nothing of the model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..integrators.failures import reason_of
from ..numerics.console import call
from ..numerics.packed import Packed
from ..simulation.singular.regularity import ENTRY
from .starts import StartPath
from .whole_runs import Results, WholeParcel


class Parcel:
    """A compiled run ``(x0, p, levels, cuts, sides, borders) -> (outputs, clock, fall)``, and the way to its starts.

    The fall is that of the regularity of its poses, see :meth:`Regularity.fall`.

    Parameters
    ----------
    span : float
        Time of the clock at the end, s.
    may_fold : bool
        True if the mechanism has poses in which it could fold: near them a run may stop.
    """

    note = ""

    def __init__(self, function: ca.Function, path: StartPath, span: float, *, may_fold: bool):
        self.run, self.path, self.span, self.may_fold = Packed(function), path, span, may_fold
        self.size = function.numel_out(0)

    def results(
        self, starts: np.ndarray, parameters: np.ndarray, levels: np.ndarray, course: tuple[np.ndarray, ...]
    ) -> Results:
        """Outputs of cases."""
        function = self.run.unpacked()
        values, messages = np.full((len(starts), self.size), np.nan), [""] * len(starts)
        folds = np.zeros(len(starts), bool)
        for k, case in enumerate(zip(starts, parameters, levels, *course, strict=True)):
            try:
                row, clock, fall = call(_evaluated, function, case)
                folds[k] = not fall > ENTRY
                arrived = abs(clock - self.span) <= 1e-6 * self.span and np.all(np.isfinite(row))
                messages[k] = "" if arrived else "a step became too small, or a value was not finite"
            except RuntimeError as error:
                messages[k] = reason_of(error)
            if messages[k]:
                folds[k] = self.may_fold
            else:
                values[k] = row
        return Results(values, messages, folds)


@dataclass(frozen=True)
class BatchOutcome(Results):
    """Results of a batch, with their reasons as sentences.

    Attributes
    ----------
    reached : numpy.ndarray of bool
        True if its start was found (k,).
    note : str
        Code that ran, in words; empty for the methods of CasADi.
    """

    reached: np.ndarray
    note: str


def run_batch(
    parcel: Parcel | WholeParcel,
    parameters: np.ndarray,
    levels: np.ndarray,
    course: tuple[np.ndarray, ...],
    starts: np.ndarray | None = None,
) -> BatchOutcome:
    """Run some cases one after the other.

    Parameters
    ----------
    parameters, levels : numpy.ndarray
        By case (k, …).
    course : tuple of numpy.ndarray
        Times of the cuts, sides and borders, by case (k, …).
    starts : numpy.ndarray, optional
        By case (k, n_x); found here if left out.
    """
    if starts is None:
        starts, reached = parcel.path.starts(parameters)
    else:
        reached = np.ones(len(parameters), bool)
    values, reasons = np.full((len(parameters), parcel.size), np.nan), [""] * len(parameters)
    chosen = np.flatnonzero(reached)
    if chosen.size < len(reached):
        course = tuple(argument[chosen] for argument in course)
    results = parcel.results(starts[chosen], parameters[chosen], levels[chosen], course)
    values[chosen], folds = results.values, np.zeros(len(parameters), bool)
    folds[chosen] = results.folds
    for k, reason in zip(chosen, results.reasons, strict=True):
        if reason:
            reasons[k] = f"the integrator stopped: {reason}; simulate with the values of this case says where and why"
    return BatchOutcome(values, reasons, folds, reached, parcel.note)


def _evaluated(function: ca.Function, case: tuple[Any, ...]) -> tuple[np.ndarray, float, float]:
    """Outputs of a case by time, its clock, and the fall of its regularity, as numbers."""
    values, clock, fall = function(*case)
    return values.full().ravel(order="F"), float(clock), float(fall)
