"""How much a short stretch counts, in which inputs are off since a switch is not resolved."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..phase_solution import PhaseSolution

#: Largest share of the cost that is lost if a velocity or first-order state reaches its value late, for one share of
#: the duration: 0.01 to 0.1 for motors whose current counts.
LATE = 1 / 8
#: Share of its typical size below which a velocity or first-order state does not change.
STILL = 1e-6


def weight_of(part: PhaseSolution, intervals: Iterable[int], share: float = 1.0) -> float:
    """Return the root of the share of the cost by which intervals that follow each other may be wrong.

    A switch that comes early or late costs the square of the stretch, as a share of the duration. If the input is so
    large there that a velocity or a first-order state changes by much, a `share` of that change is off for as long, and
    a cost of this goes with its square.
    """
    chosen = list(intervals)
    if not chosen:
        return 0.0
    first, last, n = chosen[0], chosen[-1] + 1, part.phase.equations.q.numel()
    length = float(part.mesh_times[last] - part.mesh_times[first]) / part.duration
    rates = part.mesh_states[:, n:]
    least = STILL * np.r_[part.state_sizes[n:], part.program.scales.z]
    amplitudes = np.maximum(np.ptp(rates, axis=0) / 2, least)
    change = float(np.max(np.ptp(rates[first : last + 1], axis=0) / amplitudes, initial=0.0))
    return max(length, share * change * float(np.sqrt(LATE * length)))
