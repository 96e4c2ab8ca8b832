"""Simulation with exact dry friction: pieces of motion in one mode each, joined where friction switches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from ..equations import equations
from ..equations.numeric import NumericEquations
from ..errors import SimulationError, SingularityError
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import time_derivative
from ..results.state import State
from ..results.trajectory import EventOccurrence, Statistics, Trajectory
from .assemble import assemble, complete_state
from .impact import velocity_after
from .inputs import read_signals
from .mappings import pairs_of, parameter_vector

#: Sliding speed, relative to the largest velocity, that counts as rest where a piece begins.
REST = 1e-9
#: Share by which friction at rest may exceed its limit, and accelerations point the wrong way, by rounding.
ROUNDING = 1e-7
#: Modes of the frictions at rest that are tried at one instant, and switches of one run, at the most.
TRIALS, SWITCHES = 729, 20_000

Modes = tuple[str, ...]
SENSE = {"forth": 1.0, "back": -1.0, "sticks": 0.0, "free": 0.0}


def switching(mechanism: Mechanism) -> list[Any]:
    """Elements with exact dry friction."""
    elements = getattr(mechanism, "elements", ())  # what is no mechanism is refused by the caller
    return [element for element in elements if getattr(element, "modes", ())]


@dataclass
class Piece:
    """Motion in one mode."""

    modes: Modes
    motion: Trajectory


class StickSlip:
    """A simulation that switches between sticking and sliding.

    Parameters
    ----------
    mechanism : Mechanism
        With joints that have exact dry friction.
    inputs, parameters, events : as of simulate
        Inputs as numbers or expressions.
    settings : dict
        Of the integrator.
    simulate : callable
        Simulates a mechanism in one mode.
    """

    def __init__(
        self,
        mechanism: Mechanism,
        inputs: Any,
        parameters: Any,
        events: Sequence[Event],
        settings: dict[str, Any],
        simulate: Callable[..., Trajectory],
    ):
        self.mechanism, self.simulate = mechanism, simulate
        self.frictions = switching(mechanism)
        self.given: dict[str, Any] = {"inputs": inputs, "parameters": parameters}
        self.events, self.settings = tuple(events), settings
        self._refuse()
        self._pieces: list[Piece] = []
        self._found: list[EventOccurrence] = []

    def _refuse(self) -> None:
        names = ", ".join(f.what for f in self.frictions)
        for event in self.events:
            if isinstance(event, Event) and event.reset:
                raise SimulationError(
                    f"event '{event.name}' resets velocities, and {names} switches exactly between sticking and "
                    "sliding: impacts with exact friction are not offered; take Coulomb or LuGre"
                )
        if self.given["inputs"] is None:
            return
        for _, value in pairs_of(self.given["inputs"], "inputs= with exact dry friction"):
            if not isinstance(value, ca.SX | int | float | np.number):
                raise SimulationError(
                    f"with {names} inputs are numbers or expressions, got {type(value).__name__}; write samples as "
                    "spline(t, times, values)"
                )

    # --- mechanisms in one mode ------------------------------------------------------------------
    def variant(self, modes: Modes) -> Mechanism:
        """The mechanism with every friction in a mode; made once."""
        key = ("stick and slip", modes)
        memory = self.mechanism.memory
        if key not in memory:
            place = {id(f): f.in_mode(mode) for f, mode in zip(self.frictions, modes, strict=True)}
            memory[key] = self.mechanism.replace(forces=[place.get(id(f), f) for f in self.mechanism.forces])
        return memory[key]

    def _multipliers(self, modes: Modes, motion: Any) -> np.ndarray:
        """Multipliers in the order of the mechanism, of a trajectory or state in one mode (k, m)."""
        eom, own = equations(self.mechanism), equations(self.variant(modes))
        lam = np.atleast_2d(motion.lam)
        columns = np.zeros((len(lam), eom.lam.numel()))
        sliding = {f.name: (f, SENSE[mode]) for f, mode in zip(self.frictions, modes, strict=True) if mode != "sticks"}
        for k, name in enumerate(eom.row_names):
            if name in sliding and eom.row_elements[k] is sliding[name][0]:
                friction, sense = sliding[name]
                columns[:, k] = motion[ca.SX(sense * friction.law.coefficient * friction.load)]
            else:
                columns[:, k] = lam[:, own.row_names.index(name)]
        return columns

    def _state(self, modes: Modes, s: State) -> State:
        """A state in one mode as one of the mechanism."""
        lam = self._multipliers(modes, s)[0]
        return State(self.mechanism, s.t, s.q, s.v, s.a, s.z, lam, s.inputs, s.parameters)

    # --- the run -----------------------------------------------------------------------------------
    def over(self, grid: np.ndarray, initial: Any) -> Trajectory:
        """Run over an output grid."""
        free = self.variant(("free",) * len(self.frictions))
        state = initial
        if not isinstance(initial, State):
            state = assemble(free, initial, t=float(grid[0]), **self.given)
        elif self.given["parameters"] is None:
            self.given["parameters"] = dict(zip(initial.mechanism.parameters, initial.parameters, strict=True))
        state = self._at(("free",) * len(self.frictions), float(grid[0]), state)
        modes, state = self._decided(state, {})
        time, left = float(grid[0]), grid[1:]
        tiny = 1e-12 * (grid[-1] - grid[0])
        for _ in range(SWITCHES):
            piece = self._piece(modes, state, np.r_[time, left])
            last = piece.motion.events[-1] if piece.motion.events else None
            if last is None or last.t < piece.motion.t[-1] or last.name not in self._own_names:
                self._note(piece, piece.motion.events)
                return self._joined(grid)
            self._note(piece, piece.motion.events[:-1])
            broken = {i: self._pull(i, last.state) for i, f in enumerate(self.frictions) if last.name == _breaks(f)}
            moving = self._at(("free",) * len(self.frictions), last.t, last.state)
            before = self._state(modes, last.state)
            modes, state = self._decided(moving, broken)
            after = self._state(modes, state)
            self._found.append(EventOccurrence(last.name, last.t, before, after))
            time, left = last.t, left[left > last.t + tiny]
            if not left.size:
                return self._joined(grid)
        raise SimulationError(
            f"friction switched {SWITCHES} times up to t = {time:.9g} s; the motion chatters, take a smoothed law",
            time=time,
            partial=self._joined(grid[grid <= time]),
        )

    def _piece(self, modes: Modes, state: State, times: np.ndarray) -> Piece:
        own = []
        for friction, mode in zip(self.frictions, modes, strict=True):
            if mode == "sticks":
                lam = equations(self.variant(modes)).lam[self._row(modes, friction)]
                excess = ca.fabs(lam) - friction.law.static_coefficient * friction.load
                own.append(Event(_breaks(friction), excess, direction=1, terminal=True))
            else:
                sense = -int(SENSE[mode])
                own.append(Event(_stops(friction), friction.sliding_speed, direction=sense, terminal=True))
        self._own_names = {event.name for event in own}
        events = [*own, *self.events]
        motion = self.simulate(self.variant(modes), times, initial=state, events=events, **self.given, **self.settings)
        self._check_senses(modes, motion)
        return Piece(modes, motion)

    def _check_senses(self, modes: Modes, motion: Trajectory) -> None:
        """Refuse a motion that slid back between two points at which the run looks for events."""
        for friction, mode in zip(self.frictions, modes, strict=True):
            speed = SENSE[mode] * motion[friction.sliding_speed]
            if np.min(speed, initial=0.0) < -1e-6 * (1e-6 + np.max(np.abs(speed), initial=0.0)):
                k = int(np.argmin(speed))
                raise SimulationError(
                    f"{friction.what} stopped and turned between two outputs before t = {motion.t[k]:.6g} s; take more "
                    "outputs",
                    time=float(motion.t[k]),
                )

    def _row(self, modes: Modes, friction: Any) -> int:
        return equations(self.variant(modes)).row_names.index(friction.name)

    def _note(self, piece: Piece, events: Sequence[EventOccurrence]) -> None:
        self._pieces.append(piece)
        self._found += [EventOccurrence(e.name, e.t, self._state(piece.modes, e.state)) for e in events]

    # --- which mode comes next -----------------------------------------------------------------------
    def _at(self, modes: Modes, time: float, s: State) -> State:
        """The same pose and velocity in other modes, with the accelerations and multipliers there."""
        variant = self.variant(modes)
        eom = equations(variant)
        numeric = NumericEquations(eom, parameter_vector(eom, self.given["parameters"]))
        return complete_state(numeric, read_signals(eom, self.given["inputs"]), time, s.q, s.v, s.z)

    def _pull(self, index: int, state: State) -> float:
        """Sense in which what sticks is pulled."""
        eom = state.equations
        return float(np.sign(state.lam[eom.row_names.index(self.frictions[index].name)]))

    def _decided(self, state: State, broken: dict[int, float]) -> tuple[Modes, State]:
        """Modes that meet the laws of friction at a pose and velocity, and the state in them."""
        speeds = np.atleast_1d(state[ca.vertcat(*[f.sliding_speed for f in self.frictions])])
        limit = REST * (1 + float(np.max(np.abs(state.v))))
        resting = [i for i, speed in enumerate(speeds) if abs(speed) <= limit]
        state = self._at_rest(state, resting)
        if 3 ** len(resting) > TRIALS:
            raise SimulationError(
                f"{len(resting)} frictions come to rest together at t = {state.t:.6g} s, more than are sorted out at "
                "once; take a smoothed law for some of them",
                time=state.t,
            )
        choices = [self._choices(i, float(speeds[i]), i in resting, broken) for i in range(len(self.frictions))]
        for modes in product(*choices):
            try:
                trial = self._at(modes, state.t, state)
                if self._is_met(modes, trial, resting, broken):
                    return modes, trial
            except SingularityError:
                continue
        names = ", ".join(self.frictions[i].what for i in resting) or ", ".join(f.what for f in self.frictions)
        raise SimulationError(
            f"at t = {state.t:.6g} s neither sticking nor sliding of {names} meets the laws of friction: friction is "
            "so large that the joint jams, or its rows contradict each other at rest",
            time=state.t,
            partial=self._joined(None) if self._pieces else None,
        )

    @staticmethod
    def _choices(i: int, speed: float, rests: bool, broken: dict[int, float]) -> list[str]:
        if not rests:
            return ["forth" if speed > 0 else "back"]
        if i in broken:
            return ["forth" if broken[i] > 0 else "back"]
        return ["sticks", "forth", "back"]

    def _is_met(self, modes: Modes, trial: State, resting: Sequence[int], broken: dict[int, float]) -> bool:
        """Whether friction at rest is below its limit, and what starts to slide does so in its sense."""
        for i in resting:
            friction, mode = self.frictions[i], modes[i]
            if mode == "sticks":
                pull = abs(trial.lam[self._row(modes, friction)])
                limit = trial[ca.SX(friction.law.static_coefficient * friction.load)]
                if not pull <= limit * (1 + ROUNDING):
                    return False
                continue
            onset = SENSE[mode] * trial[time_derivative(friction.sliding_speed)]
            slack = ROUNDING * (1 + float(np.max(np.abs(trial.a)))) if i in broken else 0.0
            if not onset > -slack:
                return False
        return True

    def _at_rest(self, state: State, resting: Sequence[int]) -> State:
        """The state with the speeds of what rests at zero exactly."""
        if not resting:
            return state
        eom = state.equations
        numeric = NumericEquations(eom, state.parameters)
        speeds = ca.vertcat(*[self.frictions[i].sliding_speed for i in resting])
        rows, nu = numeric.velocity(state.t, state.q)
        along = np.reshape(state[ca.jacobian(speeds, eom.v)], (len(resting), -1))
        rest = np.atleast_1d(state[ca.substitute(speeds, eom.v, ca.SX.zeros(eom.v.numel()))])
        v = velocity_after(numeric.mass, np.vstack([rows, along]), np.r_[nu, -rest], state.v)
        return State(state.mechanism, state.t, state.q, v, state.a, state.z, state.lam, state.inputs, state.parameters)

    # --- the result --------------------------------------------------------------------------------------
    def _joined(self, grid: np.ndarray | None) -> Trajectory:
        """All pieces as one motion of the mechanism, at the times that were asked for."""
        blocks: list[tuple[np.ndarray, ...]] = []
        for k, piece in enumerate(self._pieces):
            m = piece.motion
            lam = self._multipliers(piece.modes, m)
            ends = m.events and m.events[-1].t == m.t[-1]
            keep = np.ones(m.t.size, bool) if grid is None else _near(m.t, grid)
            keep[0] &= k == 0
            if ends and piece is self._pieces[-1] and m.events[-1].name not in _names(self.frictions):
                keep[-1] = True  # a terminal event of the user's
            blocks.append(tuple(x[keep] for x in (m.t, m.q, m.v, m.a, m.z, lam, m.inputs)))
        t, q, v, a, z, lam, u = (np.concatenate(part) for part in zip(*blocks, strict=True))
        first = self._pieces[0].motion.statistics
        statistics = Statistics(
            first.method,
            "stick and slip: " + first.formulation,
            sum(piece.motion.statistics.seconds for piece in self._pieces),
            sum(piece.motion.statistics.restarts for piece in self._pieces),
            list(dict.fromkeys(note for piece in self._pieces for note in piece.motion.statistics.notes)),
        )
        return Trajectory(
            self.mechanism,
            t,
            q,
            v,
            a,
            z,
            lam,
            u,
            self._pieces[0].motion.parameters,
            events=self._found,
            statistics=statistics,
            refine=self._refine,
        )

    def _refine(
        self, t: np.ndarray, q: np.ndarray, v: np.ndarray, z: np.ndarray, u: np.ndarray
    ) -> tuple[np.ndarray, ...]:
        """Interpolated states on the constraints of the piece that each belongs to."""
        starts = np.array([piece.motion.t[0] for piece in self._pieces])
        which = np.clip(np.searchsorted(starts, t, side="right") - 1, 0, len(starts) - 1)
        lam = np.zeros((t.size, equations(self.mechanism).lam.numel()))
        q, v, a, u = q.copy(), v.copy(), np.zeros_like(q), u.copy()
        for k in np.unique(which):
            piece, mask = self._pieces[k], which == k
            part = piece.motion.at(np.clip(t[mask], piece.motion.t[0], piece.motion.t[-1]))
            q[mask], v[mask], a[mask], u[mask] = part.q, part.v, part.a, part.inputs
            lam[mask] = self._multipliers(piece.modes, part)
        return q, v, a, lam, u


def _near(times: np.ndarray, grid: np.ndarray) -> np.ndarray:
    """Which of some times are those of a grid."""
    tiny = 1e-12 * (grid[-1] - grid[0]) if grid.size > 1 else 0.0
    after = np.clip(np.searchsorted(grid, times), 0, grid.size - 1)
    return np.minimum(np.abs(grid[after] - times), np.abs(grid[np.maximum(after - 1, 0)] - times)) <= tiny


def _stops(friction: Any) -> str:
    return f"{friction.name} stops"


def _breaks(friction: Any) -> str:
    return f"{friction.name} breaks away"


def _names(frictions: Sequence[Any]) -> set[str]:
    return {name for f in frictions for name in (_stops(f), _breaks(f))}
