"""The arguments that analyses of motion share, read in one place."""

from __future__ import annotations

import warnings
from functools import cached_property
from typing import Any

import numpy as np

from ..arguments.inputs import Signals, read_signals
from ..arguments.values import duration_grid, pairs_of, parameter_vector, time_grid
from ..equations import Equations, equations
from ..equations.numeric import NumericEquations
from ..errors import MechanismWarning, SimulationError
from ..model.mechanism import Mechanism
from ..results.state import State
from .consistent_start import carried_by, consistent_start


class Setup:
    """A mechanism with the parameters, inputs, times and start of an analysis.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    analysis : str
        Name of the analysis, for messages.
    times : sequence of float, optional
        Output times, the first one the start, s.
    duration : float, optional
        Instead of `times`: an even grid from 0, s.
    t : float, optional
        The one time of an analysis without output times, s.
    initial : sequence of relations, or State
        The start. A state brings its parameters and inputs along.
    inputs : mapping, list of pairs, Solution or SampledController, optional
        Values of inputs, over those of a state.
    parameters : mapping or list of pairs, optional
        Values of parameters, over those of a state.

    Attributes
    ----------
    eom : Equations
        Equations of the mechanism.
    p : numpy.ndarray
        Values of the parameters.
    grid : numpy.ndarray
        Output times; the one time of an analysis without.
    signals : Signals
        The inputs.

    Raises
    ------
    MechanismError
        For values that do not belong to the mechanism, and times that do not increase.

    Warns
    -----
    MechanismWarning
        For values of parameters beyond the limits that these carry.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        analysis: str,
        *,
        times: Any = None,
        duration: Any = None,
        t: float | None = None,
        initial: Any = (),
        inputs: Any = None,
        parameters: Any = None,
    ):
        self.mechanism, self.initial = mechanism, initial
        self.eom: Equations = equations(mechanism)
        if t is not None:
            self.grid = np.array([float(t)])
        elif (times is None) == (duration is None):
            raise SimulationError(f"{analysis}: give either times or duration=")
        else:
            self.grid = duration_grid(duration, analysis) if times is None else time_grid(times)
        carried = carried_by(initial, mechanism)
        self.p = parameter_vector(self.eom, carried["parameters"] | dict(pairs_of(parameters, "parameters=")))
        _report_exceeded_limits(mechanism, self.p, analysis)
        samples_on = self.grid if self.grid.size > 1 else None
        self.signals: Signals = read_signals(self.eom, inputs, samples_on, carried=carried["inputs"])

    @cached_property
    def numeric(self) -> NumericEquations:
        """Equations at the values of the parameters."""
        return NumericEquations(self.eom, self.p)

    def numeric_of(self, variant: Mechanism) -> NumericEquations:
        """Equations of another mechanism with the same parameters, at their values."""
        return NumericEquations(equations(variant), self.p)

    @cached_property
    def start(self) -> State:
        """The consistent start, at the first time."""
        return consistent_start(self.numeric, self.initial, float(self.grid[0]), self.signals)

    @cached_property
    def has_redundant_rows(self) -> bool:
        """Whether constraint rows depend on each other at the start."""
        return self.numeric.has_redundant_rows(self.start.t, self.start.q)


def _report_exceeded_limits(mechanism: Mechanism, p: np.ndarray, analysis: str) -> None:
    beyond = [
        f"'{symbol.label}' = {value:.6g} is beyond {symbol.lower:.6g} … {symbol.upper:.6g}"
        for symbol, value in zip(mechanism.parameters, p, strict=True)
        if not symbol.lower <= value <= symbol.upper
    ]
    if beyond:
        warnings.warn(
            f"{analysis}: parameter {', parameter '.join(beyond)}, the limits that it carries; the value is used as "
            "given",
            MechanismWarning,
            stacklevel=4,
        )
