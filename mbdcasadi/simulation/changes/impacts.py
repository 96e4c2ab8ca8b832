"""Resets at events: velocities that jump, by impulses along what is reset and in the joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ...equations.impact_law import Jump, jump
from ...equations.numeric import NumericEquations
from ...errors import ExpressionError, SimulationError
from ...model.events import Event
from ...model.symbols import StateVariable
from ...numerics.least_squares import largest
from ...numerics.tolerances import MET, NEGLIGIBLE
from ...results.state import State
from .events import Accumulation, EventWatch

#: Fraction of a run that counts as one instant: events so near to each other take place together.
INSTANT = 1e-10
#: Distance beyond the zero of an event, relative to the coordinates, that a rounded start explains.
BEYOND_BY_ROUNDING = 1e-5
#: Times in a row that an event may take place again at once as others answer it: that comes to an end after a few.
ANSWERS = 20
#: Remedy for resets that take place ever faster.
REST = (
    "its resets come to rest, which a reset cannot hold: make the event terminal, or model the contact by a force "
    "(Contact, EndStop)"
)
#: Rounds of impacts at one instant after which the events drive each other without end.
ROUNDS = 1000


@dataclass(frozen=True)
class Impact:
    """Events that reset velocities together.

    Attributes
    ----------
    events : tuple of Event
        The events.
    before : State
        State just before.
    v, z : numpy.ndarray
        Velocities and first-order states just after.
    impulses : numpy.ndarray
        Impulses of the joints, as their multipliers (m,).
    """

    events: tuple[Event, ...]
    before: State
    v: np.ndarray
    z: np.ndarray
    impulses: np.ndarray


@dataclass
class Impacts:
    """Resets of a run.

    Parameters
    ----------
    watch : EventWatch
        The events of the user.
    """

    numeric: NumericEquations
    watch: EventWatch

    def __post_init__(self) -> None:
        self._accumulation = Accumulation(REST, ANSWERS)
        for event in self.watch.events:
            for pair in event.reset:  # refused before anything is run
                try:
                    self.numeric.eom.function(ca.vertcat(*pair))
                except ExpressionError as error:
                    raise ExpressionError(f"event '{event.name}', reset: {error}") from None

    def resolved(self, state: State, located: Sequence[Event] = (), passed: Sequence[Event] = ()) -> list[Impact]:
        """Impacts of one instant, in the rounds in which they follow each other.

        All events that are at their zero and driven through it are resolved
        together, in one system of impulses; so the order in which they were given
        does not matter. What closes by this takes place in the next round.

        Parameters
        ----------
        state : State
            Just before; complete with accelerations.
        located : sequence of Event
            Events that were found to take place at this instant.
        passed : sequence of Event
            Events that took place at this instant already, in another mechanism.

        Returns
        -------
        list of Impact
            Empty if nothing moves through its zero.

        Raises
        ------
        SimulationError
            If a reset contradicts the constraints or another one, and if events accumulate.
        """
        impacts: list[Impact] = []
        passing = set(passed)
        for _ in range(ROUNDS):
            active = self._active(state, () if impacts else located, passing)
            if not active:
                return impacts
            if not impacts:
                self._accumulation.refuse(active, state.t, self.watch.instant)
            v, z, impulses = self._jump(active, state)
            impacts.append(Impact(tuple(active), state, v, z, impulses))
            state = _with_velocities(state, v, z)
        names = ", ".join(dict.fromkeys(f"'{e.name}'" for impact in impacts[-10:] for e in impact.events))
        raise SimulationError(
            f"the events {names} reset each other without end at t = {state.t:.9g} s; give them restitution below one, "
            "or model the contact by a force",
            time=state.t,
        )

    def _active(self, state: State, located: Sequence[Event], passing: set[Event]) -> list[Event]:
        """Events with a reset that take place: located ones that do not stand still, and others driven through zero.

        One that goes on through its zero after its reset, as at a kick, is `passing`:
        it takes place again once another one has turned it back.
        """
        watch, active = self.watch, []
        driven = watch.driven_through(state)
        for event, rests, through in zip(watch.events, watch.rests(state), watch.moves_through(state), strict=True):
            if not event.reset:
                continue
            if not through:
                passing.discard(event)
            if (event in located and not rests) or (event in driven and event not in passing):
                active.append(event)
        passing.update(active)
        return active

    # --- at the start of a run ---------------------------------------------------------------
    def passed_by_rounding(self, state: State) -> list[Event]:
        """Events with a reset whose expressions are just beyond zero at a start and move on, as if there."""
        if not self.watch.events:
            return []
        limit = BEYOND_BY_ROUNDING * self.numeric.scale.fineness * (1 + largest(state.q))
        through = self.watch.moves_through(state)
        return [e for k, e in enumerate(self.watch.events) if through[k] and 0 < self._beyond(e, state) <= limit]

    def remarks_on_start(self, state: State) -> list[str]:
        """Sentences on events with a reset that are violated at a start, or of which it is not known."""
        if not self.watch.events:
            return []
        limit = BEYOND_BY_ROUNDING * self.numeric.scale.fineness * (1 + largest(state.q))
        rests, at_zero, remarks = self.watch.rests(state), self.watch.at_zero(state), []
        for k, event in enumerate(self.watch.events):
            if not event.reset:
                continue
            if k in at_zero and not event.direction and not rests[k] and self._turns_back(event, state):
                remarks.append(
                    f"event '{event.name}' is at its zero at the start, t = {state.t:.6g} s, and counts in both "
                    "directions: it is taken to have been passed; give it direction=-1 or 1, in which it takes place "
                    "at once if the motion starts that way"
                )
            beyond = self._beyond(event, state)
            if beyond > limit and k not in at_zero and self._turns_back(event, state):
                remarks.append(
                    f"event '{event.name}' is beyond its zero by {beyond:.3g} at the start, t = {state.t:.6g} s, on "
                    "the side from which its reset turns the motion back: it cannot take place before the motion has "
                    "come back; start on the other side"
                )
        return remarks

    @staticmethod
    def _beyond(event: Event, state: State) -> float:
        """By how much an expression is on the side to which its event passes; 0 of one that counts both ways."""
        value = event.direction * float(state[event.expression])
        return value if np.isfinite(value) else 0.0

    def _turns_back(self, event: Event, state: State) -> bool:
        """True if a reset turns a motion through the zero of its event back, as a floor does."""
        eom, k = self.numeric.eom, self.watch.events.index(event)
        rate = self.watch.rate_expression(k)
        if rate is None or not ca.depends_on(rate, eom.v):
            return False
        slope = np.nan_to_num(np.ravel(state[ca.densify(ca.jacobian(rate, eom.v))]))
        if not np.any(slope):
            return False
        now, direction = float(self.watch.rates(state)[k]), float(event.direction or 1)
        wanted = direction * max(abs(now), 1.0) if event.direction else now
        moving = _with_velocities(state, state.v + slope * (wanted - now) / (slope @ slope), state.z)
        try:
            after = _with_velocities(moving, *self._jump([event], moving)[:2])
        except SimulationError:  # no impulse of this reset is possible here
            return False
        return bool(float(self.watch.rates(after)[k]) * wanted < 0)

    def refuse_pressed_through(self, state: State) -> None:
        """Raise for an event that a reset has stopped, or that starts at rest, and that goes on through its zero."""
        event = next((e for e in self.watch.pressed_through(state) if e.reset), None)
        if event is not None:
            raise SimulationError(
                f"event '{event.name}' is at its zero and at rest at t = {state.t:.9g} s, and the forces press it "
                "through: a reset of velocities cannot hold it; make the event terminal, or model the contact by a "
                "force (Contact, EndStop)",
                time=state.t,
            )

    def _jump(self, events: Sequence[Event], state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Velocities, first-order states and impulses of the joints just after events that take place together."""
        moving = [(e, target, value) for e in events for target, value in e.reset if not _is_state(target)]
        z = self._states_after(events, state)
        leads = self.numeric.eom.follows_states and bool(np.any(z != state.z))
        if not moving and not leads:
            return state.v.copy(), z, np.zeros(self.numeric.eom.lam.numel())
        if leads:
            self._refuse_jump_of_position(events, state, z)
        none = ca.SX(0, 1)
        targets, values = ca.vertcat(none, *[t for _, t, _ in moving]), ca.vertcat(none, *[v for *_, v in moving])
        after = jump_to(self.numeric, _with_velocities(state, state.v, z), targets, np.ravel(state[values]))
        left_over = after.left_over
        if largest(left_over) > NEGLIGIBLE * (1 + largest(after.v) + largest(state.v)):
            names = [*self.numeric.eom.row_names, *[str(target) for _, target, _ in moving]]
            misses = np.abs(after.contradiction)
            worst = names[int(np.argmax(misses >= (1 - 1e-9) * np.max(misses)))]  # of equal ones the first
            raise SimulationError(
                f"event {_names(events)} at t = {state.t:.6g} s: the reset contradicts the constraints"
                f"{' or another reset' if len(events) > 1 else ''}; {worst} would be missed by "
                f"{largest(left_over):.3g}; reset as many velocities as the joints leave free",
                time=state.t,
            )
        return after.v, z, after.impulses[: self.numeric.eom.lam.numel()]

    def _refuse_jump_of_position(self, events: Sequence[Event], state: State, z: np.ndarray) -> None:
        """Raise if drivers that follow states, which are reset to z, would have to move at once."""
        phi = np.abs(self.numeric.position(state.t, state.q, z)[0])
        if largest(phi) > MET * (1 + largest(state.q)):
            row = self.numeric.eom.position_names[int(np.argmax(phi))]
            raise SimulationError(
                f"event {_names(events)} at t = {state.t:.6g} s: the reset of the states that '{row}' follows would "
                f"move it by {largest(phi):.3g} at once; reset the state of its velocity, not that of its position",
                time=state.t,
            )

    def _states_after(self, events: Sequence[Event], state: State) -> np.ndarray:
        """First-order states after events that take place together."""
        states, z = self.numeric.eom.mechanism.states, state.z.copy()
        resets: dict[int, tuple[Event, float]] = {}
        for event in events:
            for target, value in event.reset:
                if not _is_state(target):
                    continue
                k = next(k for k, own in enumerate(states) if own is target)
                wanted = float(state[value])
                if k in resets and abs(resets[k][1] - wanted) > NEGLIGIBLE * (1 + abs(wanted)):
                    raise SimulationError(
                        f"the events '{resets[k][0].name}' and '{event.name}' take place together at t = "
                        f"{state.t:.6g} s and reset '{states[k].label}' to {resets[k][1]:.6g} and {wanted:.6g}",
                        time=state.t,
                    )
                resets[k] = (event, wanted)
                z[k] = wanted
        return z


def _with_velocities(state: State, v: np.ndarray, z: np.ndarray) -> State:
    """A state with other velocities and first-order states."""
    return State(state.mechanism, state.t, state.q, v, state.a, z, state.lam, state.inputs, state.parameters)


def _is_state(target: object) -> bool:
    return isinstance(target, StateVariable)


def _names(events: Sequence[Event]) -> str:
    return ", ".join(f"'{event.name}'" for event in events)


def jump_to(numeric: NumericEquations, state: State, targets: ca.SX, wanted: np.ndarray) -> Jump:
    """Return velocities after impulses of the joints and along some velocities, which get the values wanted.

    Parameters
    ----------
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
    rows, nu = numeric.velocity(state.t, state.q, state.z)
    jacobian = np.vstack([rows, np.reshape(state[along], (targets.numel(), eom.v.numel()))])
    right = np.r_[nu, wanted - np.ravel(state[rest])]
    return jump(numeric, jacobian, right, state.v, state.z)


def instant_of(grid: np.ndarray) -> float:
    """Return the time that counts as one instant of a run over a grid, s."""
    start, end = float(grid[0]), float(grid[-1])
    return max(INSTANT * (end - start), 4 * math.ulp(max(abs(start), abs(end))))
