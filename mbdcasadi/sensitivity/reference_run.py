"""Simulations beside compiled runs: they find what these pass over, and where they leave for another branch."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ..assembly.setup import Setup
from ..integrators import Integrator
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.changes.modes import SingleMode
from ..simulation.loop import Run

#: Relative difference of values from earlier ones that is small, and what counts as zero beside it.
NEAR, ZERO = 1e-2, 1e-9
#: Values that are remembered for each stretch.
REMEMBERED = 1000


def is_near(point: np.ndarray, known: Iterable[np.ndarray]) -> bool:
    """Return True if a point is near to one that is known, in each component."""
    return any(np.all(np.abs(point - other) <= NEAR * np.abs(other) + ZERO) for other in known)


def start_state(modes: SingleMode, start: np.ndarray) -> State:
    """Return the state ``(q, v, z)`` at the first time of a setup, from which a run begins."""
    n, time = modes.setup.eom.q.numel(), float(modes.setup.grid[0])
    return modes.at(modes.free, time, *np.split(start, [n, 2 * n]))


def simulated(setup: Setup, integrator: Integrator, start: np.ndarray) -> tuple[Trajectory, tuple[float, ...]]:
    """Return the motion from a state ``(q, v, z)`` at the first time as :func:`simulate` finds it.

    The times are those at which it passes poses in which the mechanism could fold.
    """
    modes = SingleMode(setup)
    run = Run(setup, modes, (), integrator)
    return run.run(start_state(modes, start)), run.passages
