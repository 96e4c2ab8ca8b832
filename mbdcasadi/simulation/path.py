"""The path of an integrator over a piece of a run."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..results.interpolation import cubic, linear

#: ``times -> states``: a short integration from a state to later times (k,), with the states (k, n_x).
StatesAt = Callable[[np.ndarray], np.ndarray]
#: ``(start, state) -> states_at``.
StatesFrom = Callable[[float, np.ndarray], StatesAt]


@dataclass(frozen=True)
class Path:
    """States that an integrator found over a piece, as its steps have them.

    Attributes
    ----------
    times, x : numpy.ndarray
        Start and outputs (k + 1,), (k + 1, n_x).
    integrals : numpy.ndarray
        Integrals over each interval (k, n).
    of_steps : bool
        True if it holds the ends of the steps, which are on the constraints, and what is interpolated inside.
    is_regular : bool
        True if the integrator has seen that no pose on it is near to a singular one.
    """

    times: np.ndarray
    x: np.ndarray
    integrals: np.ndarray
    of_steps: bool = False
    is_regular: bool = False

    def until(self, time: float) -> Path:
        """The part of it up to a time."""
        count = int(self.times.searchsorted(time, side="right"))
        if count == self.times.size:
            return self
        return replace(self, times=self.times[:count], x=self.x[:count], integrals=self.integrals[: max(count - 1, 0)])

    @staticmethod
    def joined(paths: Sequence[Path]) -> Path:
        """Return paths that follow each other as one."""
        first, *later = paths
        return Path(
            np.concatenate([first.times, *(path.times[1:] for path in later)]),
            np.vstack([first.x, *(path.x[1:] for path in later)]),
            np.vstack([path.integrals for path in paths]),
        )


def hermite_states(path: Path, times: np.ndarray, n: int) -> np.ndarray:
    """States of a path at other times (k, n_x): coordinates by cubic Hermite polynomials, velocities as their rates.

    Parameters
    ----------
    n : int
        Number of coordinates.
    """
    q, v = cubic(path.times, path.x[:, :n], path.x[:, n : 2 * n], times)
    return np.hstack([q, v, linear(path.times, path.x[:, 2 * n :], times)])


def hermite_poses(path: Path, times: np.ndarray, n: int) -> np.ndarray:
    """Coordinates (k, n) of :func:`hermite_states` alone."""
    return cubic(path.times, path.x[:, :n], path.x[:, n : 2 * n], times)[0]


def states_from_start(start: float, x: np.ndarray, integrated: StatesAt) -> StatesAt:
    """Return the motion from a state, by a function that integrates to times later than its own."""

    def states_at(times: np.ndarray) -> np.ndarray:
        later, states = times > start, np.tile(x, (times.size, 1))
        if np.any(later):
            states[later] = integrated(times[later])
        return states

    return states_at
