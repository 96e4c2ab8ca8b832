"""Resets at events: velocities that jump, by impulses along what is reset and in the joints."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import casadi as ca
import numpy as np

from ..equations.numeric import NumericEquations
from ..errors import ExpressionError, SimulationError
from ..model.events import Event
from ..model.symbols import StateVariable
from ..numerics.least_squares import largest
from ..results.state import State
from .events import EventWatch

#: Share of the velocities by which a reset may miss what it asks for.
MISSED = 1e-9
#: Share of a run that counts as one instant: events so near to each other take place together.
INSTANT = 1e-10
#: Resets at one instant after which the events drive each other without end.
CASCADE = 1000


@dataclass
class Impacts:
    """Resets of a run.

    Parameters
    ----------
    numeric : NumericEquations
        Equations at the parameters of the run.
    watch : EventWatch
        The events of the run.
    span : float
        Length of the run, s.
    """

    numeric: NumericEquations
    watch: EventWatch
    span: float
    _last: dict[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.watch.instant = INSTANT * self.span
        for event in self.watch.events:
            for pair in event.reset:  # refused before anything is run
                try:
                    self.numeric.eom.function(ca.vertcat(*pair))
                except ExpressionError as error:
                    raise ExpressionError(f"event '{event.name}', reset: {error}") from None

    def after(self, event: Event, state: State) -> list[tuple[Event, State, np.ndarray, np.ndarray]]:
        """Events of one instant, each with the state before it, and the velocities and states just after.

        An impact that closes another contact makes that event take place as well.

        Raises
        ------
        SimulationError
            Where a reset contradicts the constraints, and where events accumulate.
        """
        self._refuse_accumulation(event, state.t)
        found = []
        turned: set[str] = set()
        for _ in range(CASCADE):
            v, z = self._jump(event, state)
            found.append((event, state, v, z))
            state = State(state.mechanism, state.t, state.q, v, state.a, z, state.lam, state.inputs, state.parameters)
            following = self._driven_on(event, state, turned)
            if following is None:
                return found
            event = following
        names = ", ".join(dict.fromkeys(f"'{e.name}'" for e, *_ in found[-10:]))
        raise SimulationError(
            f"the events {names} reset each other without end at t = {state.t:.9g} s; give them restitution below one, "
            "or model the contact by a force",
            time=state.t,
        )

    def _driven_on(self, fired: Event, state: State, turned: set[str]) -> Event | None:
        """Another event at its zero that its rate drives through, in the direction in which it counts."""
        for event, rate in zip(self.watch.events, self.watch.rates(state), strict=True):
            on = event.direction * rate > 0
            if not event.reset or not event.direction or rate == 0:
                continue
            if abs(float(state[event.expression])) > self.watch.instant * abs(rate):
                continue
            if not on:
                turned.add(event.name)
            elif event is not fired or event.name in turned:
                turned.discard(event.name)
                return event
        return None

    def _refuse_accumulation(self, event: Event, time: float) -> None:
        before = self._last.get(event.name)
        self._last[event.name] = time
        if before is not None and time - before < 10 * self.watch.instant:
            raise SimulationError(
                f"event '{event.name}' takes place ever faster: at t = {before:.12g} s and again {time - before:.3g} s "
                "later; its resets come to rest, which a reset cannot hold: make the event terminal, or model the "
                "contact by a force (Contact, EndStop)",
                time=time,
            )

    def _jump(self, event: Event, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Velocities and first-order states just after an event."""
        eom = self.numeric.eom
        moving = [(target, value) for target, value in event.reset if not isinstance(target, StateVariable)]
        z = state.z.copy()
        for target, value in event.reset:
            if isinstance(target, StateVariable):
                z[[k for k, s in enumerate(eom.mechanism.states) if s is target]] = state[value]
        if not moving:
            return state.v.copy(), z
        targets, values = (ca.vertcat(*part) for part in zip(*moving, strict=True))
        v, left_over = velocities_with(self.numeric, state, targets, np.atleast_1d(state[values]))
        if largest(left_over) > MISSED * (1 + largest(v) + largest(state.v)):
            names = [*eom.row_names, *[str(target) for target, _ in moving]]
            worst = names[int(np.argmax(np.abs(left_over)))]
            raise SimulationError(
                f"event '{event.name}' at t = {state.t:.6g} s: the reset contradicts the constraints; {worst} would "
                f"be missed by {largest(left_over):.3g}; reset as many velocities as the joints leave free",
                time=state.t,
            )
        return v, z


def velocities_with(
    numeric: NumericEquations, state: State, targets: ca.SX, wanted: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Velocity after an impulse that gives some velocities the values wanted, and what all rows then miss.

    Parameters
    ----------
    numeric : NumericEquations
        Equations of the state's mechanism.
    state : State
        Before the impulse.
    targets : casadi.SX
        Velocities (k,), linear in v.
    wanted : numpy.ndarray
        Their values after it (k,).
    """
    eom = numeric.eom
    along = ca.jacobian(targets, eom.v)
    rest = ca.substitute(targets, eom.v, ca.SX.zeros(eom.v.numel()))
    rows, nu = numeric.velocity(state.t, state.q)
    jacobian = np.vstack([rows, np.reshape(state[along], (targets.numel(), -1))])
    right = np.r_[nu, wanted - np.atleast_1d(state[rest])]
    v = velocity_after(numeric.mass, jacobian, right, state.v)
    return v, jacobian @ v - right


def velocity_after(mass: np.ndarray, jacobian: np.ndarray, right: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Velocity after an impulse: ``M (v⁺ - v) + J^T Λ = 0``, ``J v⁺ = b``, also where J has dependent rows.

    Parameters
    ----------
    mass : numpy.ndarray
        Diagonal of M (n,); some of it may be zero.
    jacobian, right : numpy.ndarray
        Rows J (k, n) and right sides b (k,).
    v : numpy.ndarray
        Velocity before (n,).
    """
    n, k = v.size, right.size
    size = np.max(mass)
    system = np.block([[np.diag(mass / size), jacobian.T], [jacobian, np.zeros((k, k))]])
    step = np.linalg.lstsq(system, np.r_[np.zeros(n), right - jacobian @ v], rcond=1e-13)[0]
    return v + step[:n]


def resets(events: Sequence[Event]) -> bool:
    """Whether any of the events resets velocities or states."""
    return any(event.reset for event in events)
