"""Changes at an instant of a run: of its mode, of velocities by resets, of inputs by a controller, of the mechanism."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import casadi as ca

from ...arguments.inputs import read_answer
from ...equations.impact_law import by_element
from ...errors import MechanismError, SimulationError
from ...model.events import Event
from ...results.state import EventOccurrence, State
from .events import EventState, EventStates, EventWatch, Standing
from .impacts import Impacts
from .modes import Modes, Strike

#: Switches between modes, or changes of the mechanism, in one run, at most.
SWITCHES = 20_000


class Transitions:
    """Changes of a run at instants, each from the state just before to the one just after.

    Parameters
    ----------
    events : sequence of Event
        Events of the user.
    instant : float
        Time that counts as one instant, s.

    Attributes
    ----------
    mode : hashable
        The mode that holds; None before the start.
    states : EventStates
        States of the events.
    impacts : Impacts
        Resets, from the first state on.
    """

    def __init__(self, modes: Modes, events: Sequence[Event], instant: float):
        self._modes, self._events, self._instant = modes, tuple(events), instant
        self.mode: Any = None
        self.states = EventStates(EventState)
        self._switches = 0

    def begin(self) -> None:
        """Forget an earlier run."""
        for state in self.states.values():
            state.become(Standing.ARMED)
        numeric = self._modes.numeric(self._modes.free)
        self.mode = None
        self._modes.settling.clear()
        self.impacts = Impacts(numeric, EventWatch(numeric.eom, self._events, self._instant))

    def whole(self, state: State) -> State:
        """Return a state in the present mode as one of the whole mechanism."""
        return self._modes.whole(self.mode, state)

    def decided(self, state: State) -> State:
        """Find the mode that holds at a pose and velocity; return the state in it."""
        return self._settled(state)[0]

    def started(self, state: State) -> tuple[State, list[EventOccurrence]]:
        """Find the mode that holds at the first state of a run; return the state in it, and what strikes there."""
        before = self._modes.whole(self._modes.free, state)
        state, strike = self._settled(state)
        if strike is None:
            return state, []
        after = self._modes.whole(self.mode, state, strike.impulses)
        return state, [EventOccurrence(name, state.t, before, after) for name in strike.names]

    def _settled(self, state: State, events: Sequence[Event] = ()) -> tuple[State, Strike | None]:
        """Find the mode in which the motion goes on, after impacts if there are any; return the state, and these."""
        strike = self._modes.struck(state, events, self.mode)
        self.mode, state = self._modes.decided(state if strike is None else strike.state, events, self.mode)
        return state, strike

    # --- changes ----------------------------------------------------------------------------
    def out_of_mode(self, state: State, events: Sequence[Event]) -> tuple[State, list[EventOccurrence]]:
        """Return the state in the mode that follows events of the present one, and these.

        Raises
        ------
        SimulationError
            If friction chatters.
        """
        before, mode = self.whole(state), self.mode
        state, strike = self._settled(state, events)
        after = self._modes.whole(self.mode, state, None if strike is None else strike.impulses)
        self._switches += 1
        if self._switches > SWITCHES:
            raise SimulationError(
                f"friction or contact switched {SWITCHES} times up to t = {state.t:.9g} s; the motion chatters, take a "
                "smoothed law",
                time=state.t,
            )
        if strike is None and self._modes.continues(mode, self.mode):
            return state, []
        names = [event.name for event in events]
        came_about = [name for name in names if self._modes.came_about(name, self.mode)]
        names = came_about or self._modes.switched(mode, self.mode) or names
        return state, [EventOccurrence(name, state.t, before, after) for name in names]

    def to_rest(self, state: State) -> list[EventOccurrence]:
        """Return the events by which bounces come to rest up to a state, which are then past."""
        settling = self._modes.settling
        names = [name for name, time in settling.items() if time <= state.t + self._instant]
        for name in names:
            del settling[name]
        here, after = self.whole(state), self._modes.whole(self.mode, state, {})
        return [EventOccurrence(name, state.t, here, after) for name in names]

    def by_resets(
        self, state: State, located: Sequence[Event], passed: Sequence[Event] = ()
    ) -> tuple[State, list[EventOccurrence]]:
        """Return the state after the resets that take place at a state, and these; itself if there are none."""
        modes, before = self._modes, self.whole(state)
        moving = modes.at(modes.free, state.t, state.q, state.v, state.z)
        occurrences: list[EventOccurrence] = []
        fired: list[Event] = []
        for impact in self.impacts.resolved(moving, located, passed):
            moving = modes.at(modes.free, state.t, state.q, impact.v, impact.z)
            state, strike = self._settled(moving)
            impulses = by_element(modes.numeric(modes.free).eom, impact.impulses)
            for element, answer in () if strike is None else strike.impulses.items():
                impulses[element] = impulses.get(element, 0.0) + answer
            after = modes.whole(self.mode, state, impulses)
            occurrences += [EventOccurrence(event.name, state.t, before, after) for event in impact.events]
            before = after
            fired += impact.events
        for event in located:
            if event not in fired:
                self.states[event].become(Standing.RESTING, float(moving[event.expression]))
        return state, occurrences

    def by_controller(self, state: State) -> tuple[State, list[EventOccurrence]]:
        """Call the controller if there is one; return the state under its answer, and what switches by it."""
        modes, signals = self._modes, self._modes.setup.signals
        if signals.controller is None:
            return state, []
        mode, before = self.mode, self.whole(state)
        try:
            modes.levels[:] = read_answer(signals.controller, self.whole(state), signals.level_values)
        except (MechanismError, KeyboardInterrupt):
            raise
        except Exception as error:
            raise SimulationError(
                f"the controller raised {type(error).__name__} at t = {state.t:.6g} s: {error}; what was computed is "
                "in .partial",
                time=state.t,
            ) from error
        state = self.decided(modes.at(modes.free, state.t, state.q, state.v, state.z))
        names = modes.switched(mode, self.mode)
        after = self.whole(state) if names else before
        return state, [EventOccurrence(name, state.t, before, after) for name in names]

    def to_another_mechanism(self, state: State, passed: Sequence[Event]) -> list[Event]:
        """Return the events by which the mechanism changes at a state at which a run begins.

        Parameters
        ----------
        passed : sequence of Event
            Events that led there.
        """
        watched, eom = [event for event in self._events if event.becomes is not None], state.equations
        watch = EventWatch(eom, watched, self._instant)
        changing = [e for e in watch.driven_through(state) if e not in passed]
        # a reaction that has the wrong sign from the start on never passes zero
        of_reactions = [e for e in watched if ca.depends_on(e.expression, eom.lam)]
        return changing + [e for e in of_reactions if e.direction * state[e.expression] > 0]
