"""Growth of errors along a motion: by how much it is missed if it is simulated from its start with its own inputs.

An error in one interval is carried on by all that follow. Near an unstable pose it grows from interval to interval, and
local errors that are small lead far away.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce

import numpy as np

from ..transcription.motion import Polynomials

#: Relative step of differences.
STEP = 1e-6
#: Miss of a simulation with the inputs of a solution, rad or sizes of the mechanism, from which it does not follow the
#: motion, and growth from which a motion is called unstable.
REPLAY_ERROR, UNSTABLE_GROWTH = 0.01, 100
#: Points of an interval at which slopes are taken, each for its share of it: halfway alone, a miss of 0.04 rad of a
#: planet gear, which turned by half a radian in an interval, was foreseen as 0.005.
POINTS = (0.25, 0.75)


@dataclass(frozen=True)
class Growth:
    """Transitions of small errors from mesh point to mesh point.

    Attributes
    ----------
    places : list of int
        Places of the coordinates, and of their rates, in a state, in which errors are carried on.
    transitions : numpy.ndarray
        Errors at the end of each interval by those at its start (N, 2 k, 2 k).
    """

    places: list[int]
    transitions: np.ndarray

    def carried(self, errors: np.ndarray) -> np.ndarray:
        """Errors at the ends of the intervals if each adds its own (N, 2 k) to what those before have become."""
        sums = np.zeros(errors.shape)
        for i, (transition, error) in enumerate(zip(self.transitions, errors[:, self.places], strict=True)):
            sums[i, self.places] = error + (transition @ sums[i - 1, self.places] if i else 0.0)
        return sums

    def to_end(self, sizes: np.ndarray) -> np.ndarray:
        """Factors by which errors at the ends of the intervals grow up to the end, in typical sizes (N, k, 2 k)."""
        own = sizes[self.places]
        count, half = len(self.transitions), len(self.places) // 2
        factors = np.zeros((count, half, 2 * half))
        factors[-1] = np.eye(half, 2 * half)
        for i in range(count - 1, 0, -1):
            factors[i - 1] = factors[i] @ (self.transitions[i] * own / own[:, None])
        return factors


def growth(motion: Polynomials) -> Growth:
    """Return the transitions of a motion to first order: by the slopes of accelerations at points of each interval.

    First-order states stay as they are.
    """
    scheme, numeric = motion.scheme, motion.numeric
    intervals = np.repeat(np.arange(len(motion.intervals)), len(POINTS))
    count = intervals.size
    eom = scheme.eom
    n, chosen = numeric.eom.q.numel(), list(eom.independent)
    k = len(chosen)
    t, q, v, _, z, _, u, _ = motion.at(intervals, np.tile(POINTS, len(motion.intervals)))
    w, rate = q[:, chosen], v[:, chosen]
    sizes = np.r_[numeric.scale.coordinates[chosen], np.maximum(np.max(np.abs(rate), axis=0, initial=0.0), 1.0)]
    steps = STEP * np.vstack([np.zeros((1, 2 * k)), np.diag(sizes)])
    moved = (np.hstack([w, rate])[None, :, :] + steps[:, None, :]).reshape(-1, 2 * k)

    def repeated(x: np.ndarray) -> np.ndarray:
        return np.tile(x.reshape(count, -1), (2 * k + 1, 1))

    times = repeated(t)
    poses, speeds = eom.states(times.ravel(), moved[:, :k], moved[:, k:], repeated(z), numeric.p)
    states = times, poses, speeds, repeated(z), repeated(u)
    a = numeric.accelerations_of_rows(*states, redundant=scheme.redundant)[0][:, chosen]
    here, *changed = a.reshape(2 * k + 1, count, k)
    slopes = ((np.array(changed) - here) / (STEP * sizes[:, None, None])).transpose(1, 2, 0)
    rates = np.concatenate([np.broadcast_to(np.eye(k, 2 * k, k), (count, k, 2 * k)), slopes], axis=1)
    lengths = np.repeat(np.diff(motion.times) / len(POINTS), len(POINTS))
    parts = _exponentials(lengths[:, None, None] * rates).reshape(-1, len(POINTS), 2 * k, 2 * k)
    return Growth([*chosen, *(n + j for j in chosen)], reduce(lambda total, part: part @ total, parts.swapaxes(0, 1)))


def _exponentials(matrices: np.ndarray) -> np.ndarray:
    """Exponentials of matrices (N, k, k), to fourth order and without overflow if they are stiff."""
    unit, square = np.eye(matrices.shape[-1]), matrices @ matrices / 12
    return np.linalg.solve(unit - matrices / 2 + square, unit + matrices / 2 + square)
