"""The run: a piece in one mode up to the next switch, then the mode that holds there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.values import pairs_of
from ...assembly.initial_state import carried_by
from ...assembly.state import assemble_mechanism
from ...equations import equations
from ...errors import SimulationError
from ...model.events import Event
from ...model.mechanism import Mechanism
from ...results.state import State
from ...results.trajectory import EventOccurrence, Trajectory
from ..events import EventWatch, read_events
from ..impacts import Impacts
from .friction_modes import SENSE, Modes, ModesOfFriction
from .inputs import CutInputs
from .joined import Piece, joined

#: Switches of one run, at the most.
SWITCHES = 20_000


class StickSlip:
    """A simulation that switches between sticking and sliding.

    Parameters
    ----------
    mechanism : Mechanism
        With joints that have exact dry friction.
    inputs, parameters, events : as of simulate
        What simulate was given. Events that reset velocities act on the mechanism
        without friction, which takes no part in an impulse.
    settings : dict
        Of the integrator.
    smooth_motion : callable
        Simulates a mechanism in one mode.
    grid : numpy.ndarray
        Output times.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: Any,
        parameters: Any,
        events: Sequence[Event],
        settings: dict[str, Any],
        smooth_motion: Callable[..., tuple[Trajectory, list[str]]],
        grid: np.ndarray,
    ):
        self.mechanism, self._smooth_motion, self._settings = mechanism, smooth_motion, settings
        self.events, self.grid = read_events(events), grid
        self.inputs = CutInputs(mechanism, inputs, grid)
        self.modes = ModesOfFriction(mechanism, parameters, self.inputs.at)
        self.frictions = self.modes.frictions
        free = equations(self.modes.variant(self.modes.free))
        self._watch = EventWatch(free, self.events)
        self._refuse_names()
        self._pieces: list[Piece] = []
        self._found: list[EventOccurrence] = []
        self._unresolved: list[str] = []

    def _refuse_names(self) -> None:
        own = {name for f in self.frictions for name in (_stops(f), _breaks(f))}
        for event in self.events:
            if event.name in own:
                raise SimulationError(
                    f"event '{event.name}' has the name of an event of exact friction; call it otherwise"
                )

    # --- the run -----------------------------------------------------------------------------------
    def over(self, initial: Any) -> tuple[Trajectory, list[str]]:
        """Run over the output grid: the motion, and what was not resolved."""
        grid, free = self.grid, self.modes.free
        begin = float(grid[0])
        own = carried_by(initial, self.mechanism)
        self.modes.parameters = own["parameters"] | dict(pairs_of(self.modes.parameters, "parameters="))
        self.inputs.values = own["inputs"] | self.inputs.values
        state = initial
        if not isinstance(initial, State):
            given = {"inputs": self.inputs.at(begin), "parameters": self.modes.parameters}
            state = assemble_mechanism(self.modes.variant(free), initial, begin, **given)
        state = self.modes.at(free, begin, state.q, state.v, state.z)
        self._refuse_redundant(state)
        self._impacts = Impacts(self.modes.numeric(free), self._watch, float(grid[-1] - grid[0]))
        self._switches = 0
        for end in self.inputs.instants(grid):
            ended, state = self._until(float(end), state)
            if ended:
                break
        return joined(self.modes, self._pieces, self._found, grid), list(dict.fromkeys(self._unresolved))

    def _refuse_redundant(self, state: State) -> None:
        """Friction under reactions that are not unique has no solution to find."""
        if not self.modes.numeric(self.modes.free).has_redundant_rows(state.t, state.q):
            return
        names = [f.description for f in self.frictions if ca.depends_on(ca.SX(f.load), equations(self.mechanism).lam)]
        if names:
            raise SimulationError(
                f"{', '.join(names)} depends on reactions, and with redundant constraints these are not unique: remove "
                "the redundant rows (see check), or take LoadIndependentFriction"
            )

    def _until(self, end: float, state: State) -> tuple[bool, State]:
        """Run to a time at which inputs jump, or to the end: whether an event ended it, and the state reached."""
        if self.inputs.controller is not None:
            decided, state = self._decided(state, {})
            self.inputs.ask(self.modes.whole(decided, state))
        modes, state = self._decided(state, {})
        tiny = 1e-12 * (self.grid[-1] - self.grid[0])
        after_reset = False
        while state.t < end - tiny:
            inside = self.grid[(self.grid > state.t + tiny) & (self.grid < end - tiny)]
            piece = self._piece(modes, state, np.r_[state.t, inside, end], after_reset)
            last = piece.motion.events[-1] if piece.motion.events else None
            if last is None or last.t < piece.motion.t[-1] or not self._cuts(last.name):
                self._note(piece, piece.motion.events)
                piece.shown_end = last is not None and last.t == piece.motion.t[-1] and self._ends(last.name)
                return piece.shown_end, piece.motion.final
            self._note(piece, piece.motion.events[:-1])
            before = self.modes.whole(modes, last.state)
            after_reset = last.name not in self._own_names
            if after_reset:
                modes, state = self._reset(last, before)
            else:
                broken = {
                    i: self.modes.pull(i, last.state)
                    for i, f in enumerate(self.frictions)
                    if last.name == _breaks(f) and modes[i] == "sticks"
                }
                modes, state = self._decided(last.state, broken)
                self._found.append(EventOccurrence(last.name, last.t, before, self.modes.whole(modes, state)))
            self._count(state.t)
        return False, state

    def _count(self, time: float) -> None:
        self._switches += 1
        if self._switches > SWITCHES:
            raise SimulationError(
                f"friction switched {SWITCHES} times up to t = {time:.9g} s; the motion chatters, take a smoothed law",
                time=time,
                partial=joined(self.modes, self._pieces, self._found, self.grid[self.grid <= time]),
            )

    def _cuts(self, name: str) -> bool:
        """Whether an event cuts the motion, which then goes on."""
        return name in self._own_names or any(e.reset for e in self.events if e.name == name)

    def _ends(self, name: str) -> bool:
        return any(e.terminal for e in self.events if e.name == name)

    def _piece(self, modes: Modes, state: State, times: np.ndarray, after_reset: bool) -> Piece:
        own = []
        for i, (friction, mode) in enumerate(zip(self.frictions, modes, strict=True)):
            if mode == "sticks":
                lam = equations(self.modes.variant(modes)).lam[self.modes.row(modes, friction)]
                excess = ca.fabs(lam) - friction.law.static_coefficient * friction.load
                own.append(Event(_breaks(friction), excess, direction=1, terminal=True))
            elif i in self.modes.held and (mode == "free" or "sticks" in modes):  # at rest until something else slides
                leaves = ca.fabs(friction.sliding_speed) - self.modes.rest
                own.append(Event(_breaks(friction), leaves, direction=1, terminal=True))
            else:
                sense = -int(SENSE[mode])
                own.append(Event(_stops(friction), friction.sliding_speed, direction=sense, terminal=True))
        self._own_names = {event.name for event in own}
        motion, unresolved = self._smooth_motion(
            self.modes.variant(modes),
            times,
            initial=state,
            inputs=self.inputs.values,
            parameters=self.modes.parameters,
            events=[*own, *[_stopping(event) for event in self.events]],
            after_reset=after_reset,
            **self._settings,
        )
        self._unresolved += unresolved
        self._check_senses(modes, motion)
        return Piece(modes, motion)

    def _check_senses(self, modes: Modes, motion: Trajectory) -> None:
        """Refuse a motion that slid back between two points at which the run looks for events."""
        for friction, mode in zip(self.frictions, modes, strict=True):
            speed = SENSE[mode] * motion[friction.sliding_speed]
            if np.min(speed, initial=0.0) < -1e-6 * (1e-6 + np.max(np.abs(speed), initial=0.0)):
                k = int(np.argmin(speed))
                raise SimulationError(
                    f"{friction.description} stopped and turned between two outputs before t = {motion.t[k]:.6g} s; "
                    "take more outputs",
                    time=float(motion.t[k]),
                )

    def _note(self, piece: Piece, events: Sequence[EventOccurrence]) -> None:
        self._pieces.append(piece)
        self._found += [EventOccurrence(e.name, e.t, self.modes.whole(piece.modes, e.state)) for e in events]

    # --- what comes next -----------------------------------------------------------------------------
    def _decided(self, state: State, broken: dict[int, float]) -> tuple[Modes, State]:
        """Modes that hold at a pose and velocity, and the state in them."""
        found = self.modes.decided(state, broken)
        if found is not None:
            return found
        names = ", ".join(f.description for f in self.frictions)
        raise SimulationError(
            f"at t = {state.t:.6g} s neither sticking nor sliding of {names} meets the laws of friction: friction is "
            "so large that the joint jams, or its rows contradict each other at rest",
            time=state.t,
            partial=joined(self.modes, self._pieces, self._found, None) if self._pieces else None,
        )

    def _reset(self, found: EventOccurrence, before: State) -> tuple[Modes, State]:
        """Velocities after an event that resets them, and the modes that hold then."""
        s, free = found.state, self.modes.free
        (event,) = (e for e in self.events if e.name == found.name)
        moving = self.modes.at(free, s.t, s.q, s.v, s.z)
        try:
            impacts = self._impacts.after(event, moving)
        except SimulationError as error:
            partial = joined(self.modes, self._pieces, self._found, None)
            raise SimulationError(str(error), time=s.t, partial=partial) from None
        for fired, _, v, z in impacts:
            modes, state = self._decided(self.modes.at(free, s.t, s.q, v, z), {})
            after = self.modes.whole(modes, state)
            self._found.append(EventOccurrence(fired.name, s.t, before, after))
            before = after
        return modes, state


def _stopping(event: Event) -> Event:
    """An event that resets velocities as one at which a piece ends."""
    return Event(event.name, event.expression, event.direction, terminal=True) if event.reset else event


def _stops(friction: Any) -> str:
    return f"{friction.name} stops"


def _breaks(friction: Any) -> str:
    return f"{friction.name} breaks away"
