"""How much a short stretch counts, in which inputs are off since a switch is not resolved."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..motion.phase_solution import PhaseSolution
from ..motion.solved_motion import SolvedMotion
from .cost_error import cost_size, cost_slopes

#: Largest share of the cost that is lost if a velocity or first-order state reaches its value late, for one share of
#: the duration: 0.01 to 0.1 for motors whose current counts.
LATE = 1 / 8
#: Share of its typical size below which a velocity or first-order state does not change.
STILL = 1e-6


class StretchWeights:
    """Weights of stretches of a solution."""

    def __init__(self, solution: SolvedMotion):
        size = cost_size(solution)
        self._slopes = [cost_slopes(part) / size for part in solution.phases]

    def lost(self, part: PhaseSolution, intervals: Iterable[int], share: float) -> float:
        """Return the share of the cost by which intervals may be wrong whose inputs are off by a share."""
        length, late = self._parts(part, intervals, share)
        return max((share * length) ** 2, late)

    def of(self, part: PhaseSolution, intervals: Iterable[int], share: float = 1.0) -> float:
        """Return the root of the share of the cost by which intervals that follow each other may be wrong.

        A switch that comes early or late costs the square of the stretch, as a share of the duration. If the input is
        so large there that a velocity or a first-order state changes by much, a `share` of that change is off for as
        long, and a cost of this goes with its square. A running cost that changes with the states is off for as long,
        too: it may be one short peak, far shorter than the duration.
        """
        length, late = self._parts(part, intervals, share)
        return max(length, float(np.sqrt(late)))

    def _parts(self, part: PhaseSolution, intervals: Iterable[int], share: float) -> tuple[float, float]:
        """Length of a stretch, as a share of the duration, and the share of the cost of what is late in it."""
        chosen = list(intervals)
        if not chosen:
            return 0.0, 0.0
        first, last, n = chosen[0], chosen[-1] + 1, part.phase.equations.q.numel()
        time = float(part.mesh_times[last] - part.mesh_times[first])
        length, ranges = time / part.duration, np.ptp(part.mesh_states[first : last + 1], axis=0)
        rates = part.mesh_states[:, n:]
        least = STILL * np.r_[part.state_sizes[n:], part.program.scales.z]
        amplitudes = np.maximum(np.ptp(rates, axis=0) / 2, least)
        change = float(np.max(ranges[n:] / amplitudes, initial=0.0))
        slopes = np.max(self._slopes[part.program.number][first:last], axis=0)
        late = max((share * change) ** 2 * length, share * float(slopes @ ranges) * time)
        return length, LATE * late
