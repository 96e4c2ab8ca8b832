"""The arguments that analyses of motion share, read in one place."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ..arguments.inputs import Signals, read_signals
from ..arguments.values import RunValues, duration_grid, mapping_of, parameter_vector, time_grid
from ..equations import Equations, equations
from ..equations.numeric import NumericEquations
from ..errors import ModelError, SimulationError, warn
from ..model.cache import Cache
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter, number
from ..numerics.lazy import cached_property
from ..results.state import State
from .consistent_start import carried_by, consistent_start

#: Values of the parameters at which the equations of a mechanism are kept.
RECENT_PARAMETERS = 4
#: Mark of an argument that is not given: None is refused as a time.
_UNSET: Any = object()


class Setup:
    """A mechanism with the parameters, inputs, times and start of an analysis.

    Parameters
    ----------
    times : sequence of float, optional
        Output times, the first one the start, s.
    duration : float, optional
        Instead of `times`: an even grid from 0, s.
    t : float, optional
        Instead of both: the one time of an analysis at one instant, s.
    fewest_times : int, default 2
        Number of output times that the analysis needs at least.
    initial : sequence of relations, or State
        The start. A state brings its parameters and inputs along.
    inputs : mapping, list of pairs, Solution or SampledController, optional
        Values of inputs, over those of a state.
    parameters : mapping or list of pairs, optional
        Values of parameters, over those of a state.
    fixed : mapping of Parameter or Input to float, optional
        Values that the analysis itself sets, over all others.
    takes_controller : bool, default False
        True if the analysis calls a sampled controller.
    takes_duration : bool, default True
        True if the analysis takes a duration in place of times.

    Attributes
    ----------
    eom : Equations
        Equations of the mechanism.
    p : numpy.ndarray
        Values of the parameters.
    grid : numpy.ndarray
        Output times; the one time of an analysis without.

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
        t: Any = _UNSET,
        fewest_times: int = 2,
        initial: Any = (),
        inputs: Any = None,
        parameters: Any = None,
        fixed: Mapping[Any, float] | None = None,
        takes_controller: bool = False,
        takes_duration: bool = True,
    ):
        self.mechanism, self.initial = mechanism, initial
        self.eom: Equations = equations(mechanism)
        if t is not _UNSET:
            self.grid = np.array([number(t, analysis, "t")])
        elif (times is None) == (duration is None):
            raise SimulationError(
                f"{analysis}: give {'either times or duration=' if takes_duration else 'the output times'}"
            )
        elif times is None:
            self.grid = duration_grid(duration, analysis)
        else:
            self.grid = time_grid(times, least=fewest_times, takes_duration=takes_duration)
        carried, fixed = carried_by(initial, mechanism), fixed or {}
        over = {key: value for key, value in fixed.items() if isinstance(key, Parameter)}
        self.p = parameter_vector(self.eom, carried["parameters"] | mapping_of(parameters, "parameters=") | over)
        if self.p.size:
            _report_exceeded_limits(mechanism, self.p, analysis)
        grid = self.grid if t is _UNSET else None
        others = {key: value for key, value in fixed.items() if key not in over}
        self._read = partial(read_signals, self.eom, inputs, grid, carried=carried["inputs"], fixed=others)
        if (inputs is not None or others) and self.signals.controller is not None and not takes_controller:
            raise ModelError(
                f"{analysis}: inputs= takes numbers, samples and expressions here; only simulate calls a "
                "SampledController, and its motion gives samples of the answers"
            )

    @cached_property
    def signals(self) -> Signals:
        """The inputs."""
        return self._read()

    def at_values(self, grid: np.ndarray, values: RunValues) -> Setup:
        """Return a setup for runs from states that are known, at other values and with samples over a grid."""
        other = Setup.__new__(Setup)
        other.mechanism, other.eom, other.initial = self.mechanism, self.eom, ()
        other.grid, other.p = grid, values.p
        other.signals = self.signals.at_values(grid, values.levels, values.channel)
        return other

    @property
    def time(self) -> float:
        """The first time, s."""
        return float(self.grid[0])

    @cached_property
    def numeric(self) -> NumericEquations:
        """Equations at the values of the parameters."""
        return kept_numeric(self.eom, self.p)

    def numeric_of(self, variant: Mechanism) -> NumericEquations:
        """Equations of another mechanism with the same parameters, at their values."""
        return self.numeric if variant is self.mechanism else kept_numeric(equations(variant), self.p)

    @cached_property
    def start(self) -> State:
        """The consistent start, at the first time."""
        return consistent_start(self.numeric, self.initial, self.time, self.signals)

    @cached_property
    def has_redundant_rows(self) -> bool:
        """True if constraint rows depend on each other at the start."""
        return self.numeric.has_redundant_rows(self.start.t, self.start.q)


def kept_numeric(eom: Equations, p: np.ndarray) -> NumericEquations:
    """Return the equations at values of the parameters; the last ones of a mechanism are kept."""
    recent = eom.mechanism.cache.get_or_create("numeric equations", lambda: Cache(RECENT_PARAMETERS))
    return recent.get_or_create(p.tobytes(), lambda: NumericEquations(eom, p.copy()), bounded=True)


def _report_exceeded_limits(mechanism: Mechanism, p: np.ndarray, analysis: str) -> None:
    beyond = [
        f"'{symbol.label}' = {value:.6g} is beyond {symbol.lower:.6g} … {symbol.upper:.6g}"
        for symbol, value in zip(mechanism.parameters, p, strict=True)
        if not symbol.lower <= value <= symbol.upper
    ]
    if beyond:
        warn(
            f"{analysis}: parameter {', parameter '.join(beyond)}, the limits that it carries; the value is used as "
            "given"
        )
