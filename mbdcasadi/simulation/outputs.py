"""From the integrator's states to outputs: projection, inputs, accelerations, multipliers."""

from __future__ import annotations

import numpy as np

from ..arguments.inputs import Signals
from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..results.state import State
from .path import Path, hermite_states


class Outputs:
    """Outputs of states ``x = (q, v, z)``, each by row.

    Parameters
    ----------
    levels : numpy.ndarray
        Values of the inputs that are numbers, as they are when outputs are made.
    redundant : bool
        True if rows are dependent.
    """

    def __init__(self, numeric: NumericEquations, signals: Signals, levels: np.ndarray, *, redundant: bool):
        self.numeric, self.signals, self._levels = numeric, signals, levels
        self.recovery = Recovery(numeric, redundant=redundant)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates, velocities and first-order states."""
        n = self.numeric.eom.sizes[0]
        return x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]

    def projected(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        """States on the constraints at position and velocity level."""
        q, v, z = self.split(x)
        q = self.recovery.positions(times, q, z)
        return np.hstack([q, self.recovery.velocities(times, q, v, z), z])

    def block(self, times: np.ndarray, x: np.ndarray, since: np.ndarray | None = None) -> tuple[np.ndarray, ...]:
        """Return ``t, q, v, a, z, lam, u`` at outputs.

        Parameters
        ----------
        since : numpy.ndarray, optional
            Start of the interval that each output ends; by its inputs the outputs
            are made. If left out, the interval that begins at each of them.
        """
        q, v, z = self.split(x)
        channel = self.signals.channel_from(times if since is None else since)
        u = self.signals.values(times, q, v, z, self.numeric.p, self.numeric.eom, levels=self._levels, channel=channel)
        a, lam = self.recovery.accelerations(times, q, v, z, u)
        return times, q, v, a, z, lam, u

    def accelerations(self, path: Path, times: np.ndarray) -> np.ndarray:
        """Accelerations at times of a path (k, n)."""
        return self.block(times, hermite_states(path, times, self.numeric.eom.q.numel()))[3]

    def unknowns(self, time: float, x: np.ndarray) -> np.ndarray:
        """Accelerations and multipliers at one state, as the integrator takes them."""
        _, _, _, a, _, lam, _ = self.block(np.array([time]), x[None, :])
        return np.r_[a[0], lam[0]]

    def state(self, time: float, x: np.ndarray) -> State:
        """One state with everything in it."""
        _, q, v, a, z, lam, u = (part[0] for part in self.block(np.array([time]), x[None, :]))
        return State(self.numeric.eom.mechanism, time, q, v, a, z, lam, u, self.numeric.p)

    def inputs_at(self, t: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Inputs at one state (n_u,)."""
        p, eom = self.numeric.p, self.numeric.eom
        values: np.ndarray = self.signals.values(t, q[None], v[None], z[None], p, eom, levels=self._levels)[0]
        return values
