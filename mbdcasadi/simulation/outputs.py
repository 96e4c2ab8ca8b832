"""From the integrator's states to outputs: projection, inputs, accelerations, multipliers."""

from __future__ import annotations

import numpy as np

from ..equations.numeric import NumericEquations
from ..equations.recovery import Recovery
from ..results.state import State
from .input_sampling import InputFeed


class Outputs:
    """What is made of states ``x = (q, v, z)``, each by row.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    feed : InputFeed
        Inputs of the run.
    redundant : bool
        Whether rows are dependent.
    """

    def __init__(self, numeric: NumericEquations, feed: InputFeed, *, redundant: bool):
        self.numeric, self.feed = numeric, feed
        self.recovery = Recovery(numeric, redundant=redundant)

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coordinates, velocities and first-order states."""
        n = self.numeric.eom.q.numel()
        return x[:, :n], x[:, n : 2 * n], x[:, 2 * n :]

    def projected(self, times: np.ndarray, x: np.ndarray) -> np.ndarray:
        """States on the constraints at position and velocity level."""
        q, v, z = self.split(x)
        q = self.recovery.positions(times, q)
        return np.hstack([q, self.recovery.velocities(times, q, v), z])

    def block(self, times: np.ndarray, x: np.ndarray, channel: np.ndarray | None) -> tuple[np.ndarray, ...]:
        """``t, q, v, a, z, lam, u`` at outputs."""
        q, v, z = self.split(x)
        u = self.feed.values(times, q, v, z, channel)
        a, lam = self.recovery.accelerations(times, q, v, z, u)
        return times, q, v, a, z, lam, u

    def unknowns(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> np.ndarray:
        """Accelerations and multipliers at one state, as the integrator takes them."""
        _, _, _, a, _, lam, _ = self.block(np.array([time]), x[None, :], channel)
        return np.r_[a[0], lam[0]]

    def state(self, time: float, x: np.ndarray, channel: np.ndarray | None) -> State:
        """One state with everything in it."""
        _, q, v, a, z, lam, u = (part[0] for part in self.block(np.array([time]), x[None, :], channel))
        return State(self.numeric.eom.mechanism, time, q, v, a, z, lam, u, self.numeric.p)
