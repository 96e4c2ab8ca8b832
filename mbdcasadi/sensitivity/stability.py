"""Stability of a periodic motion that was simulated: its return map, by saltation matrices across the changes."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol, runtime_checkable

import casadi as ca
import numpy as np

from ..errors import ModelError, warn
from ..integrators import Integrator, as_integrator
from ..model.conditions import Condition, read_conditions
from ..model.events import Event
from ..model.placeholders import placeholders_in, with_symbols
from ..model.symbols import as_sx
from ..model.symbols import t as time
from ..numerics.console import keyboard_interrupts
from ..numerics.least_squares import largest
from ..numerics.tolerances import MET
from ..results.state import State
from ..results.trajectory import Trajectory
from ..simulation.changes.events import read_events
from .phase_flow import Directions, VariedMotion
from .phased_variation import phased_variation, start_directions
from .return_map import Stability, next_start, warn_of_a_clock
from .switched_motion import smooth_phases


@runtime_checkable
class OwnStability(Protocol):
    """What has a stability of its own: a solution of optimal control."""

    def stability(self) -> Stability:
        """Return the return map of its period."""


def stability(
    motion: Trajectory | OwnStability,
    boundary: Any = (),
    *,
    events: Sequence[Event] = (),
    inputs: Any = None,
    method: str | Integrator = "idas",
    reltol: float = 1e-10,
    abstol: float = 1e-10,
) -> Stability:
    """Return the stability of a periodic motion: its return map to first order, and the Floquet multipliers.

    Disturbances of the start are carried by the variational equations through every phase, and by saltation matrices
    across the changes, whose instants they shift. The boundary conditions lead from the end to the next start.
    If an event ends the period, time begins anew with the next one, as of a push that each step gives; the clock of a
    table that shakes goes on: let the motion last a period of it, with events that do not end it.

    Parameters
    ----------
    motion : Trajectory or Solution
        One period: a simulation, through changes of the mechanism or in one mechanism, which ends at an event or
        after the period; or a solution of a periodic problem, which needs no other argument.
    boundary : sequence of relations
        Relations between :func:`at_start` and :func:`at_end`: the start of the next period.
    events : sequence of Event
        Events of the simulation; those of exact friction and of rigid contacts are known.
    inputs : mapping, optional
        Inputs of the simulation, numbers and expressions; by default the values at the start.
    method, reltol, abstol
        Integrator, and its tolerances.

    Returns
    -------
    Stability
        ``.matrix``, ``.multipliers``, ``.is_stable``.

    Raises
    ------
    ModelError
        If the boundary conditions do not decide the next start, or contain more than positions, velocities, states
        and parameters.
    SimulationError
        See :func:`sensitivities`.

    Warns
    -----
    MechanismWarning
        If the motion does not meet the boundary conditions, or depends on time and ends at an event.

    References
    ----------
    Leine and Nijmeijer, *Dynamics and Bifurcations of Non-Smooth Mechanical Systems*, Springer 2004, chapter 7.

    Examples
    --------
    A pendulum that swings a little is neither stable nor unstable.

    >>> import numpy as np, mbdcasadi as mbd
    >>> arm = mbd.Body("arm", mass=1, inertia=0)
    >>> hinge = mbd.Revolute("hinge", mbd.ground.at(0, 0), arm.at(0, 1))
    >>> pendulum = mbd.Mechanism(bodies=[arm], joints=[hinge], forces=[mbd.Gravity((0, -np.pi**2))])
    >>> down = mbd.Event("lowest", arm.phi, direction=1, terminal=True)
    >>> swing = mbd.simulate(pendulum, [0, 1, 3], initial=[arm.phi == 0, arm.omega == 0.01], events=[down])
    >>> same = [mbd.at_end(arm.phi) == mbd.at_start(arm.phi), mbd.at_end(arm.omega) == mbd.at_start(arm.omega)]
    >>> found = mbd.stability(swing, same, events=[down])
    >>> bool(np.allclose(found.multipliers, [1, 0], atol=1e-6))
    True
    """
    if isinstance(motion, OwnStability):
        if boundary or events or inputs is not None:
            raise ModelError("stability: boundary=, events= and inputs= belong to a simulation; a solution has its own")
        return motion.stability()
    if not isinstance(motion, Trajectory):
        raise ModelError(f"stability: takes a Trajectory or a Solution, got {motion!r}")
    relations = read_conditions(boundary)
    if not relations:
        raise ModelError("stability: boundary= is empty, and so there is no next period")
    with keyboard_interrupts("stability"):
        integrator = as_integrator(method, reltol, abstol)
        return _stability_of_simulation(motion, relations, read_events(events), inputs, integrator)


def _stability_of_simulation(
    motion: Trajectory, boundary: Sequence[Condition], events: Sequence[Event], inputs: Any, integrator: Integrator
) -> Stability:
    phases = smooth_phases(motion)
    first, last = phases[0].motion, phases[-1].motion
    # in the symbols of their own mechanisms
    start, end = (State(state.mechanism, *state.arguments) for state in (first.initial, last.final))
    if inputs is None:
        held = [list(zip(p.mechanism.inputs, p.initial.inputs.tolist(), strict=True)) for p in motion.phases]
        inputs = [pair for pairs in reversed(held) for pair in pairs]
    tangent = start_directions(first.mechanism, start)
    directions, known = Directions(tangent, {}, {}), list(dict(inputs).items())
    variation = phased_variation(VariedMotion(motion, motion.t[[0, -1]], [], directions, integrator, known), events)
    last_event = variation.events[-1] if variation.events and variation.events[-1].t == motion.t[-1] else None
    if last_event is not None and np.any(last_event.time):
        of_modes = [event for phase in phases for event in phase.events]
        rows = [as_sx(value) for value in dict(inputs).values()] + _timed(motion, [*events, *of_modes])
        mechanisms = [phase.motion.mechanism for phase in phases]
        warn_of_a_clock(mechanisms, rows, f"event '{last_event.name}' ends the period")
    left, right = [], []
    for relation in boundary:
        if not relation.equality:
            raise ModelError(f"stability: boundary= takes equalities, got {relation.label}")
        by_start, by_end, residual = _slopes(relation, start, end)
        if abs(residual) > MET * (1 + largest(end.q) + largest(end.v)):
            warn(f"stability: the motion is not periodic: {relation.label} is missed by {residual:.3g}")
        left.append(by_start @ tangent)
        right.append(-by_end @ variation.end)
    return next_start(np.array(left), np.array(right), "state it in boundary=")


def _timed(motion: Trajectory, events: Sequence[Event]) -> list[ca.SX]:
    """Expressions of the events of a motion that move with time, and rows of their joints."""
    known, found = {event.name: event for event in events}, []
    for occurrence in motion.events:
        event = known[occurrence.name]
        found += [joint.rows for joint in event.restitution]
        slope = ca.gradient(event.expression, time)
        if float(occurrence.state[slope]) != 0:  # a switch in time, such as if_else(t > 0.1, ...), has none
            found.append(event.expression)
    return found


def _slopes(relation: Condition, start: State, end: State) -> tuple[np.ndarray, np.ndarray, float]:
    """Derivatives of a boundary condition by the state at the start and at the end, and its value."""
    marks = placeholders_in(relation.expression)
    for mark in marks:
        if mark.phase is not None or mark.kind not in ("at_start", "at_end"):
            raise ModelError(f"stability: {relation.label}: takes at_start and at_end of the motion, got {mark.label}")
    symbols, put_in = with_symbols(marks)
    named = put_in(relation.expression)
    values = [float((start if mark.kind == "at_start" else end)[mark.expression]) for mark in marks]
    rest = ca.substitute(named, symbols, ca.SX(ca.DM(values))) if marks else named
    by_mark: Any = end[ca.substitute(ca.jacobian(named, symbols), symbols, ca.SX(ca.DM(values)))] if marks else []
    by_start, by_end = np.zeros(start.q.size * 2 + start.z.size), _gradient(rest, end)
    for mark, factor in zip(marks, np.atleast_1d(by_mark).ravel(), strict=True):
        if mark.kind == "at_start":
            by_start = by_start + factor * _gradient(mark.expression, start)
        else:
            by_end = by_end + factor * _gradient(mark.expression, end)
    return by_start, by_end, float(end[rest])


def _gradient(expression: ca.SX, state: State) -> np.ndarray:
    """Derivatives of an expression by ``(q, v, z)`` at a state."""
    eom = state.equations
    if ca.depends_on(expression, ca.vertcat(eom.a, eom.lam, eom.u)):
        raise ModelError(
            f"stability: boundary= contains {expression}, in accelerations, reactions or inputs; a start is positions, "
            "velocities and first-order states"
        )
    slope = ca.densify(ca.jacobian(ca.SX(expression), ca.vertcat(eom.q, eom.v, eom.z)))
    return np.atleast_1d(state[slope]).ravel()
