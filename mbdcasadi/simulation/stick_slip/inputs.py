"""Inputs of a run that is cut where friction switches."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.inputs import SampledController, read_signals
from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...arguments.values import pairs_of, position_in
from ...equations import equations
from ...model.mechanism import Mechanism
from ..chunks import periods_of
from ..input_sampling import read_answer


class CutInputs:
    """Inputs that do not depend on where a run is cut.

    Samples on the output grid become piecewise polynomials with breaks of their own; a
    controller gives numbers, which hold until it is asked again.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    inputs : as of simulate
        Inputs as they were given.
    grid : numpy.ndarray
        Output times.
    """

    def __init__(self, mechanism: Mechanism, inputs: Any, grid: np.ndarray):
        self._mechanism = mechanism
        self.controller = inputs if isinstance(inputs, SampledController) else None
        read_signals(equations(mechanism), inputs, grid)  # raises what is to be said of them
        if isinstance(getattr(inputs, "inputs", None), Mapping):  # a solution stands for all its inputs
            inputs = inputs.inputs
        #: as simulate takes them for a piece
        self.values: dict[Any, Any] = {}
        for key, value in () if self.controller else pairs_of(inputs, "inputs="):
            symbol = mechanism.inputs[position_in(mechanism.inputs, key, "inputs=")]
            self.values[symbol] = _own_times(value, symbol, grid)

    def instants(self, grid: np.ndarray) -> np.ndarray:
        """Ends of the stretches over which a controller's answer holds; the end of the run alone without one."""
        return grid[-1:] if self.controller is None else periods_of(grid, self.controller.period)

    def ask(self, state: Any) -> None:
        """Ask the controller, where there is one."""
        if self.controller is not None:
            values = read_answer(self.controller, state)
            self.values = dict(zip(self._mechanism.inputs, values.tolist(), strict=True))

    def at(self, time: float) -> dict[Any, Any]:
        """The same at one instant: numbers and expressions."""
        return {
            key: float(value(np.array([time]))[0]) if isinstance(value, PiecewisePolynomial) else value
            for key, value in self.values.items()
        }


def _own_times(value: Any, symbol: Any, grid: np.ndarray) -> Any:
    """A value that knows its times: samples as straight lines between them, a solution as its own course."""
    if isinstance(getattr(value, "inputs", None), Mapping):
        value = value.inputs[symbol]
    if isinstance(value, PiecewisePolynomial | ca.SX) or np.ndim(value) == 0:
        return value
    samples = np.asarray(value, float).ravel()
    return PiecewisePolynomial(grid, np.column_stack([samples[:-1], np.diff(samples) / np.diff(grid)]))
