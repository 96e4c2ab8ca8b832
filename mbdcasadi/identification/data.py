"""Measured data: experiments, outputs, missing samples, weights."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of, time_grid
from ..errors import MechanismError, ModelError
from ..model.immutable import Immutable
from ..model.symbols import Numbers, as_expression
from ..model.texts import text_of
from ..numerics.real import real_array
from ..results.state import Conditions
from ..sensitivity.design_variables import find_output


class IdentificationError(MechanismError):
    """Parameters could not be identified; ``partial`` holds the last fit."""


class Experiment(Immutable):
    """One measured motion, for :func:`identify`.

    Parameters
    ----------
    times : sequence of float
        Times of the samples, the first one the start; they need not be equally far apart, s.
    data : mapping or list of pairs
        Expression to samples (n_t,), or (n_t, k) for a vector; NaN where a sample is missing.
    initial, inputs, parameters
        Of this experiment, as for :func:`simulate`; they may hold unknown parameters.
    weights : mapping or list of pairs, optional
        Expression to weight: a number, or one for each time; the inverse of the standard deviation of the noise,
        up to a common factor. Without, the noise of each measured quantity is estimated from its residuals.
    name : str, default ""
        For messages and plots.
    """

    def __init__(
        self,
        times: Numbers,
        data: Any,
        initial: Conditions = (),
        inputs: Any = None,
        parameters: Any = None,
        weights: Any = None,
        name: str = "",
    ):
        self.name = str(name)
        self.times = time_grid(times)
        self.initial, self.inputs, self.parameters = initial, inputs, parameters
        what = f"experiment '{self.name}'" if self.name else "identify"
        pairs = pairs_of(data, "data=")
        if not pairs:
            raise ModelError(f"{what}: data= is empty; give {{expression: samples}}")
        self.outputs = tuple(as_expression(e, "data=") for e, _ in pairs)
        columns = [self._samples(e, v, what) for e, (_, v) in zip(self.outputs, pairs, strict=True)]
        #: samples, stacked over the outputs (n_y, n_t)
        self.samples = np.vstack(columns)
        if not np.any(np.isfinite(self.samples)):
            raise ModelError(f"{what}: every sample is missing")
        self.weighted = weights is not None
        self.weights = self._read_weights(weights, what)

    def _samples(self, expression: ca.SX, values: Any, what: str) -> np.ndarray:
        label = text_of(expression) if expression.numel() == 1 else f"a vector of {expression.numel()}"
        try:
            samples = np.atleast_1d(real_array(values))
        except (TypeError, ValueError):
            raise ModelError(f"{what}: the samples of {label} must be numbers, got {values!r}") from None
        samples = samples[:, None] if samples.ndim == 1 else samples
        if samples.shape != (self.times.size, expression.numel()):
            columns = samples.shape[1] if samples.ndim > 1 else 1
            raise ModelError(
                f"{what}: {samples.shape[0]} samples of {columns} values are given for {label} at "
                f"{self.times.size} times; missing ones are NaN"
            )
        if np.any(np.isinf(samples)):
            raise ModelError(f"{what}: a sample of {label} is infinite")
        return samples.T

    def _read_weights(self, weights: Any, what: str) -> np.ndarray:
        all_weights = np.ones(self.samples.shape)
        for key, value in pairs_of(weights, "weights="):
            rows = self.rows_of(key)
            if rows is None:
                raise ModelError(f"{what}: weights= holds {key!r}, which is not among data=")
            try:
                weight = real_array(value)
            except (TypeError, ValueError):
                raise ModelError(f"{what}: weights must be numbers, got {value!r}") from None
            if weight.ndim > 1 or (weight.ndim == 1 and weight.size != self.times.size):
                raise ModelError(f"{what}: a weight is a number or one for each of {self.times.size} times")
            if not np.all(np.isfinite(weight)) or np.any(weight < 0):
                raise ModelError(f"{what}: weights must be finite and not negative, got {value!r}")
            all_weights[rows] = weight
        return all_weights

    def rows_of(self, key: Any) -> slice | None:
        """Rows of an output among the samples."""
        k = find_output([("", e) for e in self.outputs], key)
        if k is None:
            return None
        first = sum(e.numel() for e in self.outputs[:k])
        return slice(first, first + self.outputs[k].numel())

    @property
    def measured(self) -> np.ndarray:
        """True for samples that are there and count (n_y, n_t)."""
        return np.isfinite(self.samples) & (self.weights > 0)

    @property
    def labels(self) -> list[str]:
        """One for each row of the samples."""
        names: list[str] = []
        for e in self.outputs:
            names += [text_of(part) for part in ca.vertsplit(ca.vec(e))]
        return names


def range_of(experiment: Experiment) -> np.ndarray:
    """Return the range of each row of samples; the size of one that does not vary, one for zeros."""
    rows = [row[there] for row, there in zip(experiment.samples, experiment.measured, strict=True)]
    return np.array([(np.ptp(row) if row.size else 0.0) or np.max(np.abs(row), initial=0.0) or 1.0 for row in rows])


def read_experiments(times: Any, data: Any, experiments: Any, **of_one: Any) -> tuple[Experiment, ...]:
    """One experiment from the arguments of ``identify``, or the list of them."""
    if experiments is None:
        if times is None or data is None:
            raise ModelError("identify: give times and data=, or experiments=[Experiment(…), …]")
        return (Experiment(times, data, **of_one),)
    if times is not None or data is not None or any(v not in (None, ()) for v in of_one.values()):
        raise ModelError("identify: with experiments= the times, data, starts, inputs and weights are given in these")
    if isinstance(experiments, Experiment | Mapping) or not isinstance(experiments, Iterable):
        raise ModelError("identify: experiments= takes a list of Experiment")
    listed = tuple(experiments)
    if not listed or not all(isinstance(e, Experiment) for e in listed):
        raise ModelError(f"identify: experiments= takes a list of Experiment, got {experiments!r}")
    return listed
