"""Explicit dependence of a run on time: where the integrator must stop, and how long its steps may be."""

from __future__ import annotations

from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..assembly.setup import Setup
from ..equations.switching.explicit_time import ConstraintJump, ExplicitTime, explicit_time, first_jump
from ..errors import SimulationError
from .checks.unseen_loads import AROUND

#: Steps over a run whose equations depend on time, at least: what begins after rest would be stepped over otherwise.
LEAST_STEPS = 400
#: Transients of one run that get stops of their own; what passes quickly more often bounds every step.
MOST_TRANSIENTS = 2000


@dataclass(frozen=True)
class TimeDependence:
    """Properties of the time in the equations of a run that integrators must know.

    Attributes
    ----------
    stops : numpy.ndarray
        Times that no step may cross: knots, switches, the middles of short transients, s.
    jumps : numpy.ndarray
        Times at which the accelerations jump, so that an integrator restarts, s.
    max_step : float or None
        Longest step, s; None if nothing depends on time.
    velocity_jumps : list of ConstraintJump
        Prescribed velocities that jump, which takes an impulse.
    position_jump : ConstraintJump or None
        First prescribed position that jumps: no motion goes on there.
    """

    stops: np.ndarray
    jumps: np.ndarray
    max_step: float | None = None
    velocity_jumps: list[ConstraintJump] = field(default_factory=list)
    position_jump: ConstraintJump | None = None

    def obstacle(self) -> SimulationError | None:
        """Error at the first prescribed position that jumps; None if none does."""
        jump = self.position_jump
        return None if jump is None else SimulationError(f"{jump}; {jump.remedy}", time=jump.time)

    @property
    def notes(self) -> list[str]:
        """Sentences for the statistics of a run."""
        return [f"{jump}: the velocities jump there, by the impulse that this takes" for jump in self.velocity_jumps]


#: Of equations that do not depend on time.
INDEPENDENT = TimeDependence(np.zeros(0), np.zeros(0))


def time_dependence(setup: Setup) -> TimeDependence:
    """Find out how the equations of a run depend on time."""
    return dependence_at(timed_equations(setup), setup.p, float(setup.grid[0]), float(setup.grid[-1]))


def timed_equations(setup: Setup, integrands: ca.SX | None = None) -> ExplicitTime:
    """Return the equations of a run, its inputs substituted, as functions of time."""
    eom, signals = setup.eom, setup.signals
    if not signals.structure:
        return explicit_time(eom, None, integrands)
    # samples and polynomials change at times that are known; expressions may switch
    return explicit_time(eom, signals.with_expressions(eom.u), integrands)


def dependence_at(timed: ExplicitTime, p: np.ndarray, start: float, end: float) -> TimeDependence:
    """Find out how equations depend on time between two times, at values of the parameters."""
    if not timed.depends:
        return INDEPENDENT
    constraint_jumps = timed.jumps(p, start, end)
    breaks, restarts = timed.breaks(p, start, end)
    max_step = (end - start) / LEAST_STEPS
    stops = [breaks.times[~restarts]]
    if breaks.transients.shape[0] <= MOST_TRANSIENTS:
        middles, lengths = breaks.transients.T
        stops.append((middles[:, None] + lengths[:, None] * AROUND).ravel())
    else:
        max_step = min(max_step, float(np.min(breaks.transients[:, 1])))
    inside = np.unique(np.concatenate(stops))
    inside = inside[(inside > start) & (inside < end)]
    ends = np.unique(np.r_[start, inside, breaks.times, end])
    short = np.diff(ends) <= max_step
    hidden = timed.hidden_between(p, np.column_stack([ends[:-1], ends[1:]])[short])
    return TimeDependence(
        np.union1d(inside, hidden),
        breaks.times[restarts],
        max_step,
        [jump for jump in constraint_jumps if jump.level == "velocity"],
        first_jump(constraint_jumps),
    )
