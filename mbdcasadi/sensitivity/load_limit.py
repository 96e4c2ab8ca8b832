"""Longest step of analyses whose steps are compiled beforehand: it must not pass over loads that come and go.

A simulation finds such loads on its path (see :mod:`~mbdcasadi.simulation.checks.unseen_loads`). It is repeated here
for all values of the parameters that are not near to earlier ones, since a body may reach a bump at some values alone.
"""

from __future__ import annotations

from collections import deque

import casadi as ca
import numpy as np

from ..arguments.values import RunValues
from ..assembly.setup import Setup
from ..errors import MechanismError
from ..integrators import Integrator
from ..simulation.changes.modes import SingleMode
from ..simulation.checks.unseen_loads import meets_loads
from ..simulation.contact.watched_terms import has_gaps
from ..simulation.loop import Run
from .reference_run import REMEMBERED, is_near, start_state

#: Steps over the shortest load that a simulation of the motion would have passed over, and steps that this may take.
STEPS_PER_LOAD, MOST_LOAD_STEPS = 2.0, 1e5


class LoadLimit:
    """Longest step over the loads that were found at all values so far.

    Attributes
    ----------
    is_needed : bool
        True if loads may come and go with the motion, or outlines meet.
    """

    def __init__(self, setup: Setup, integrator: Integrator, integrands: ca.SX | None = None):
        self._setup, self._integrator = setup, integrator
        passing = integrands is not None and integrands.numel() and meets_loads(setup.eom, setup.signals, integrands)
        #: expressions that are integrated along the motion and may come and go
        self._integrands = integrands if passing else None
        self.is_needed = bool(passing) or meets_loads(setup.eom, setup.signals) or has_gaps(setup.eom.mechanism)
        self._shortest = np.inf
        self._known: dict[tuple[float, float], deque[np.ndarray]] = {}

    def look(self, start: np.ndarray, values: RunValues, grid: np.ndarray) -> None:
        """Look for loads on the motion from a state ``(q, v, z)`` over a grid, unless one near to it is known."""
        if not self.is_needed:
            return
        point = np.concatenate([start, *map(np.ravel, values)])
        known = self._known.setdefault((grid[0], grid[-1]), deque(maxlen=REMEMBERED))
        if is_near(point, known):
            return
        known.append(point)
        setup = self._setup.at_values(grid, values)
        shortest = shortest_unseen_load(setup, self._integrator, start, self._integrands)
        if shortest < self._shortest:  # a power of two, so that nearly equal loads share what is compiled
            self._shortest = float(2.0 ** np.floor(np.log2(shortest)))

    @property
    def max_step(self) -> float | None:
        """Longest step, s; None if no load was found."""
        if not np.isfinite(self._shortest):
            return None
        span = float(self._setup.grid[-1] - self._setup.grid[0])
        return max(self._shortest / STEPS_PER_LOAD, span / MOST_LOAD_STEPS)


def shortest_unseen_load(
    setup: Setup, integrator: Integrator, start: np.ndarray, integrands: ca.SX | None = None
) -> float:
    """Duration of the shortest load or contact on a motion over which the steps of an integrator may pass, s.

    Infinite if there is none. A simulation stops around loads that its own steps pass over; analyses whose steps are
    compiled beforehand limit these by it. If the simulation stops early, what came before counts.

    Parameters
    ----------
    start : numpy.ndarray
        State ``(q, v, z)`` at the first time.
    integrands : casadi.SX, optional
        Expressions that are integrated along the motion, whose courses count as loads do.
    """
    modes = SingleMode(setup)
    run = Run(setup, modes, (), integrator, keeps_paths=True)
    try:
        run.run(start_state(modes, start))
    except MechanismError:  # the analysis itself says why
        pass
    return run.shortest_load(integrands)
