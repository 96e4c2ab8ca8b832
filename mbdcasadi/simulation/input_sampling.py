"""The inputs while a simulation runs: interval by interval, and as values at outputs."""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..arguments.inputs import SampledController, Signals
from ..arguments.values import pairs_of, position_in
from ..equations.numeric import NumericEquations
from ..errors import SimulationError
from ..results.state import State
from .chunks import Chunk


class InputFeed:
    """Input values of a run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    signals : Signals
        The inputs as they were given.
    grid : numpy.ndarray
        Output times, on which samples are given.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals, grid: np.ndarray):
        self.signals = signals
        self._numeric, self._grid = numeric, grid
        self._held = numeric.eom.input_values.copy()
        eom = numeric.eom
        arguments = [eom.t, eom.q, eom.v, eom.z, eom.p, signals.channel]
        self._values = ca.Function("inputs", arguments, [ca.densify(signals.expressions)])

    @property
    def period(self) -> float | None:
        """Sampling period of the controller, where there is one."""
        return self.signals.controller.period if self.signals.controller else None

    def channel(self, chunk: Chunk) -> np.ndarray | None:
        """What changes by interval of a chunk (channel, k); None where nothing does."""
        if not self.signals.is_sampled:
            return None
        begins = np.r_[chunk.start, chunk.times[:-1]]
        if self.signals.controller:
            return np.vstack([np.tile(self._held[:, None], (1, begins.size)), begins])
        table = self.signals.channel_values(self._grid, self._held)
        inside = np.searchsorted(self._grid, begins + 1e-12 * abs(self._grid[-1]), side="right") - 1
        sampled = table[:, np.clip(inside, 0, table.shape[1] - 1)]
        return np.vstack([sampled, self.signals.piece_values(begins)])

    def at_start(self, time: float) -> np.ndarray | None:
        """The same for the start alone."""
        return self.channel(Chunk(time, np.array([time]), np.array([True])))

    def values(
        self, times: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, channel: np.ndarray | None
    ) -> np.ndarray:
        """Values of all inputs at states (k, n_u)."""
        given = np.zeros(0) if channel is None else channel
        found = self._values(times[None, :], q.T, v.T, z.T, self._numeric.p, given).full().T
        return np.broadcast_to(found, (times.size, found.shape[1]))

    def rule(self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray) -> np.ndarray:
        """Inputs at interpolated states: expressions are evaluated, samples taken as interpolated."""
        if not self.signals.is_sampled:
            return self.values(t, q, v, z, None)
        for k, piece in self.signals.pieces.items():
            u[:, k] = piece(t)
        return u

    # --- a controller ----------------------------------------------------------------------
    def ask(self, state: State) -> None:
        """Ask the controller; its answer is held until it is asked again."""
        if self.signals.controller is not None:
            self._held = read_answer(self.signals.controller, state)


def read_answer(controller: SampledController, state: State) -> np.ndarray:
    """Values of all inputs that a controller gives at a state (n_u,)."""
    eom = state.equations
    inputs, values = eom.mechanism.inputs, eom.input_values.copy()
    for key, value in pairs_of(controller.function(state.t, state), "the controller's answer"):
        k = position_in(inputs, key, "the controller's answer")
        values[k] = float(value)
        if not np.isfinite(values[k]):
            raise SimulationError(
                f"the controller gives {values[k]} for input '{inputs[k].label}' at t = {state.t:.6g} s", time=state.t
            )
    return values
