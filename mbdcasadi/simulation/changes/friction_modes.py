"""Mechanisms with exact friction in one mode, and which mode holds at a state."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Container, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from ...assembly.setup import Setup
from ...equations import equations
from ...equations.derivation import why_not_unique
from ...equations.impact_law import impulse_response
from ...equations.numeric import NumericEquations
from ...errors import SimulationError, SingularityError
from ...model.events import Event
from ...model.forces.friction.modes import Senses, modes_by_element, switching, variant_in
from ...model.mechanism import Mechanism
from ...model.quantities import known_value
from ...model.rates import time_derivative
from ...numerics.groups import groups_of
from ...numerics.least_squares import largest
from ...numerics.rank import analyse_rank, rows_taking_part
from ...numerics.tolerances import AT_REST
from ...results.state import State
from ...results.trajectory import Trajectory
from .events import ROUNDING
from .impacts import jump_to
from .modes import Block, Modes

#: Share by which friction at rest may exceed its limit, and accelerations point the wrong way, by rounding.
FRICTION_TOLERANCE = 1e-7
#: Effect of a force on the motion, relative to that on bodies without joints, below which it has none.
NO_EFFECT = 1e-12
#: Sliding for each motion that the joints leave free, relative to the largest there could be, below which the pose
#: alone makes a joint turn: the guide of a crank at its dead centre.
TURNS = 1e-6
#: Roundings of a time by which the instant of a stop may be off.
TIME_ROUNDINGS = 8
#: Modes of the frictions at rest that are tried at one instant, at most.
TRIALS = 729

#: Sign of the sliding speed in each sense.
SENSE = {"forth": 1.0, "back": -1.0, "sticks": 0.0, "free": 0.0, "pulled forth": 0.0, "pulled back": 0.0}


@dataclass(frozen=True)
class FrictionMode:
    """A choice of which frictions stick and which slide.

    Attributes
    ----------
    senses : tuple of str
        By friction: ``"sticks"``, ``"forth"``, ``"back"``, ``"free"``, ``"pulled forth"``, ``"pulled back"``.
    held : tuple of int
        Frictions at rest that cannot slide before something else does.
    """

    senses: Senses
    held: tuple[int, ...] = ()

    @property
    def motion(self) -> Senses:
        """What rests and slides, however the forces share it."""
        return tuple("sticks" if self.is_held(i) else sense for i, sense in enumerate(self.senses))

    def is_held(self, i: int) -> bool:
        """True for a friction that rests until something else slides."""
        return i in self.held and (self.senses[i] == "free" or "sticks" in self.senses)


class SwitchingModes(Modes):
    """Modes in which something sticks and slides."""

    @abstractmethod
    def event_names(self) -> set[str]:
        """Return names of the events of all modes."""

    @abstractmethod
    def _reactions(self, mode: Any) -> ca.SX: ...

    def reactions(self, mode: Any) -> ca.SX:
        """Return the multipliers of the whole mechanism in a mode (m,), as expressions in the symbols of that mode."""
        return self.mechanism.cache.get_or_create(("reactions", mode), lambda: self._reactions(mode))

    @abstractmethod
    def sliding(self, mode: Any) -> list[tuple[Any, float]]:
        """Return what has a sliding speed, with the sign of it in a mode, which is 0 at rest."""

    @property
    @abstractmethod
    def loads(self) -> list[tuple[str, ca.SX]]:
        """Return what friction depends on, with the element of each."""

    def refuse_redundant_rows(self, state: State) -> None:
        numeric = self.numeric(self.free)
        open_ = numeric.eom.lam[rows_taking_part(numeric.rank(state.t, state.q).null_rows)]
        names = [name for name, load in self.loads if ca.depends_on(load, open_)]
        if names:
            raise SingularityError(why_not_unique(list(dict.fromkeys(names))))

    def refuse_names(self, events: Sequence[Event]) -> None:
        """Raise for an event of the user that has the name of one of the modes."""
        names = self.event_names()
        for event in events:
            if event.name in names:
                raise SimulationError(
                    f"event '{event.name}' has the name of an event of exact friction or of a rigid contact; call it "
                    "otherwise"
                )

    def _motion(self, mode: Any, block: Block) -> Trajectory:
        """Outputs in a mode as a motion of the mechanism in that mode."""
        t, q, v, a, z, lam, u = block
        return Trajectory(self.variant(mode), t, q, v, a, z, lam, u, self.setup.p)

    def check(self, mode: Any, block: Block) -> None:
        motion = self._motion(mode, block)
        for friction, sign in self.sliding(mode):
            if not sign:
                continue
            speed = sign * motion[friction.sliding_speed]
            allowed = 1e-6 * (1e-6 * self._fineness + largest(speed)) + _speed_by_rounding(friction, motion)
            if np.min(speed, initial=0.0) < -allowed:
                k = int(np.argmin(speed))
                raise SimulationError(
                    f"{friction.description} stopped and turned between two outputs before t = {motion.t[k]:.6g} s; "
                    "take more outputs",
                    time=float(motion.t[k]),
                )

    def whole_block(self, mode: Any, block: Block) -> Block:
        return *block[:5], self.multipliers(mode, self._motion(mode, block)), block[6]

    @property
    def rest(self) -> ca.SX:
        """Sliding speed from which what the pose held at rest counts as sliding, m/s."""
        return 2 * AT_REST * self._fineness * (1 + ca.norm_2(equations(self.variant(self.free)).v))

    @property
    def _fineness(self) -> float:
        return self.numeric(self.free).scale.fineness


class FrictionModes(SwitchingModes):
    """The modes of a mechanism with exact friction: each friction sticks, slides one way or the other, or is free."""

    prefix: ClassVar[str] = "stick and slip: "

    def __init__(self, setup: Setup):
        super().__init__(setup)
        self.elements = switching(setup.mechanism)
        self.frictions = tuple(friction for element in self.elements for friction in element.frictions)

    # --- mechanisms in one mode ------------------------------------------------------------------
    @property
    def free(self) -> FrictionMode:
        return FrictionMode(("free",) * len(self.frictions))

    def variant(self, mode: FrictionMode) -> Mechanism:
        return variant_in(self.mechanism, tuple(modes_by_element(self.elements, mode.senses).values()))

    def in_mode(self, mode: FrictionMode, expression: Any) -> ca.SX:
        """An expression in multipliers, of which those of what slides are given, in the symbols of a mode."""
        expression, lam = ca.SX(expression), equations(self.mechanism).lam
        return ca.substitute(expression, lam, self.reactions(mode)) if ca.depends_on(expression, lam) else expression

    @property
    def loads(self) -> list[tuple[str, ca.SX]]:
        return [(f.description, ca.SX(limit)) for f in self.frictions for limit in f.limits_of_pull]

    # --- events of a mode ----------------------------------------------------------------------------
    def event_names(self) -> set[str]:
        return {name for f in self.frictions for name in f.event_names}

    def sliding(self, mode: FrictionMode) -> list[tuple[Any, float]]:
        return [(f, SENSE[sense]) for f, sense in zip(self.frictions, mode.senses, strict=True)]

    def events(self, mode: FrictionMode) -> tuple[Event, ...]:
        return tuple(self._event(i, mode) for i in range(len(self.frictions)))

    def _event(self, i: int, mode: FrictionMode) -> Event:
        """Event at which a friction leaves its mode."""
        friction = self.frictions[i]
        sense = mode.senses[i]
        stops, breaks = friction.event_names
        if sense == "sticks":
            lam = equations(self.variant(mode)).lam[self.row(mode, friction)]
            limits = [(sign, self.in_mode(mode, limit)) for sign, limit in _limits(friction)]
            excess = ca.mmax(ca.vertcat(*[sign * lam - limit for sign, limit in limits]))
            return Event(breaks, excess, direction=1, terminal=True)
        if mode.is_held(i):
            leaves = ca.fabs(friction.sliding_speed) - self.rest
            return Event(breaks, leaves, direction=1, terminal=True)
        return Event(stops, friction.sliding_speed, direction=-int(SENSE[sense]), terminal=True)

    def switched(self, before: FrictionMode, after: FrictionMode) -> list[str]:
        rest = [
            [sense == "sticks" or i in mode.held for i, sense in enumerate(mode.senses)] for mode in (before, after)
        ]
        changes = zip(self.frictions, *rest, strict=True)
        return [friction.event_names[0 if rests else 1] for friction, rested, rests in changes if rested != rests]

    def continues(self, before: FrictionMode, after: FrictionMode) -> bool:
        return before.motion == after.motion

    def row(self, mode: FrictionMode, friction: Any) -> int:
        """Row of a friction that sticks."""
        return equations(self.variant(mode)).row_names.index(friction.sticking_row)

    def multipliers(self, mode: FrictionMode, motion: Trajectory | State) -> np.ndarray:
        count = equations(self.mechanism).lam.numel()
        if isinstance(motion, State) and motion.obstacle is not None:
            return np.full((1, count), np.nan)
        return np.reshape(motion[self.reactions(mode)], (-1, count))

    def _reactions(self, mode: FrictionMode) -> ca.SX:
        eom, variant = equations(self.mechanism), equations(self.variant(mode))
        terms = ca.SX(eom.lam)
        modes = modes_by_element(self.elements, mode.senses)
        sliding = {
            f.sticking_row: (element, f)
            for element in self.elements
            for f in element.frictions
            if mode.senses[self.frictions.index(f)] != "sticks"
        }
        for k, name in enumerate(eom.row_names):
            if name in sliding and eom.row_elements[k] is sliding[name][0]:
                element, friction = sliding[name]
                terms[k] = -friction.sliding_force(modes[element])
            else:
                terms[k] = variant.lam[variant.row_names.index(name)]
        return terms

    # --- which mode holds -----------------------------------------------------------------------------
    def pull(self, index: int, mode: FrictionMode, state: State) -> float:
        """Sense in which what sticks in a mode is pulled beyond its limit."""
        friction = self.frictions[index]
        lam = state.lam[state.equations.row_names.index(friction.sticking_row)]
        return float(max(_limits(friction), key=lambda one: one[0] * lam - float(state[self.in_mode(mode, one[1])]))[0])

    def decided(
        self, state: State, events: Sequence[Event] = (), before: FrictionMode | None = None
    ) -> tuple[FrictionMode, State]:
        broken: dict[int, float] = {}
        names = {event.name for event in events}
        for i, friction in enumerate(self.frictions):
            if before is not None and friction.event_names[1] in names and before.senses[i] == "sticks":
                broken[i] = self.pull(i, before, state)
        holding = self.holding(state, broken)
        if holding is not None:
            return holding
        raise SimulationError(
            f"at t = {state.t:.6g} s neither sticking nor sliding of "
            f"{', '.join(f.description for f in self.frictions)} meets the laws of friction: friction is so large that "
            "the joint jams, or its rows contradict each other at rest",
            time=state.t,
        )

    def holding(self, state: State, broken: dict[int, float]) -> tuple[FrictionMode, State] | None:
        """Mode that meets the laws of friction at a pose and velocity, and the state in it; None if none does.

        Parameters
        ----------
        state : State
            In any mode.
        broken : dict of int to float
            Frictions that break away just there, and the sense in which they were pulled.
        """
        speeds = np.atleast_1d(state[ca.vertcat(*[f.sliding_speed for f in self.frictions])])
        resting = self._resting(state, speeds)
        rows = dict(zip(resting, self._slides(state, resting), strict=True))
        by_pose = self._held(rows, ())
        v = self._at_rest(state, [i for i in resting if i not in by_pose])
        choices = [self._choices(i, float(speeds[i]), i in resting, broken) for i in range(len(self.frictions))]
        for i in by_pose:
            choices[i] = ["forth", "back", "free"]
        choices = [self._allowed(i, state, senses) for i, senses in enumerate(choices)]
        senses, held, groups = [own[0] for own in choices], list[int](), self._groups(state, resting)
        for group in groups:
            alone = [["free"] if i in resting and i not in group else own for i, own in enumerate(choices)]
            found = self._group_holding(state, v, alone, {i: rows[i] for i in group}, by_pose, broken)
            if found is None:
                return None
            if len(groups) == 1:
                return found
            held += [i for i in found[0].held if i in group]
            for i in group:
                senses[i] = found[0].senses[i]
        mode = FrictionMode(tuple(senses), tuple(held))
        return mode, self.at(mode, state.t, state.q, v, state.z)

    def _group_holding(
        self,
        state: State,
        v: np.ndarray,
        choices: Sequence[list[str]],
        rows: dict[int, np.ndarray],
        by_pose: Sequence[int],
        broken: dict[int, float],
    ) -> tuple[FrictionMode, State] | None:
        """Mode that meets the laws of some frictions at rest, and the state in it; others at rest are free.

        Parameters
        ----------
        v : numpy.ndarray
            Velocities with the speeds of what rests at zero (n,).
        choices : sequence of list of str
            Senses of all frictions.
        rows : dict of int to numpy.ndarray
            Sliding of the frictions, see `_slides`.
        """
        resting, at_limit = list(rows), None
        by_pose = [i for i in by_pose if i in rows]
        begins = [(i, rows[i], rows[k]) for i in rows for k in broken if k in rows]
        breaking = {i for i, own, other in begins if _parallel(own, other)}
        # what has a part in the motion that begins would break away at once if it were at its limit: others come first
        strict = {i for i, own, other in begins if abs(float(own @ other)) > TURNS}
        for senses, held in self._candidates(choices, rows):
            mode = FrictionMode(senses, tuple(held))
            try:
                trial = self.at(mode, state.t, state.q, v, state.z)
                if self._is_met(mode, trial, resting, by_pose, breaking, strict):
                    return mode, trial
                if strict and at_limit is None and self._is_met(mode, trial, resting, by_pose, breaking):
                    at_limit = mode, trial
            except SingularityError:
                continue
        return at_limit

    def _groups(self, state: State, resting: Sequence[int]) -> list[list[int]]:
        """Frictions at rest that act on each other, by their motion or their loads; raise if they are too many."""
        numeric, frictions = self.numeric(self.free), [self.frictions[i] for i in resting]
        eom = numeric.eom
        speeds = ca.vertcat(ca.SX(0, 1), *[friction.sliding_speed for friction in frictions])
        along = np.reshape(state[ca.jacobian(speeds, eom.v)], speeds.shape[:1] + eom.v.shape[:1])
        response, joints = impulse_response(numeric, numeric.jacobian(state.t, state.q), along, state.z)
        matrix = along @ response
        unit = np.sqrt(np.maximum(np.diag(matrix), np.finfo(float).tiny))
        acts = np.abs(joints) > NO_EFFECT * np.max(np.abs(joints), axis=1, keepdims=True, initial=0.0)
        joined = np.abs(matrix / np.outer(unit, unit)) > NO_EFFECT
        for k, friction in enumerate(frictions):
            limit = ca.vertcat(*[ca.SX(value) for _, value in _limits(friction)])
            needs = np.array(ca.which_depends(limit, eom.lam, 1, False), bool)
            by_friction = [ca.depends_on(limit, other.multipliers) for other in frictions]
            joined[k] |= by_friction | np.any(acts[needs], axis=0)
        groups = groups_of(joined)
        largest_group = max(map(len, groups), default=0)
        if 3**largest_group > TRIALS:
            raise SimulationError(
                f"{largest_group} frictions that act on each other rest together at t = {state.t:.6g} s, more than are "
                "sorted out at once; take a smoothed law for some of them",
                time=state.t,
            )
        return [[resting[k] for k in group] for group in groups] or [[]]

    def _resting(self, state: State, speeds: np.ndarray) -> list[int]:
        """Frictions at rest."""
        limit = AT_REST * self._fineness * (1 + largest(state.v))
        frictions = zip(self.frictions, speeds, strict=True)
        return [i for i, (f, s) in enumerate(frictions) if abs(s) <= limit + _speed_by_rounding(f, state)]

    @staticmethod
    def _choices(i: int, speed: float, rests: bool, broken: dict[int, float]) -> list[str]:
        if not rests:
            return ["forth" if speed > 0 else "back"]
        if i in broken:
            return ["forth" if broken[i] > 0 else "back"]
        return ["sticks", "free", "forth", "back"]

    def _allowed(self, i: int, state: State, senses: list[str]) -> list[str]:
        """Senses without those in which it always holds."""
        friction = self.frictions[i]
        slides = {"forth": 1, "back": -1}
        allowed = [s for s in senses if s not in slides or slides[s] in dict(_limits(friction))]
        if not allowed:
            raise SimulationError(
                f"{friction.description} moves at t = {state.t:.6g} s in the sense in which it holds, with "
                f"{float(state[friction.sliding_speed]):.6g} {friction.units[0]}; start it at rest or the other way",
                time=state.t,
            )
        return allowed

    def _slides(self, state: State, which: Sequence[int]) -> np.ndarray:
        """Sliding of frictions by the motions that joints leave free, of size one (k, f); zero where there is none."""
        numeric = self.numeric(self.free)
        free = numeric.rank(state.t, state.q).null_columns * numeric.column_scale[:, None]
        rows = np.zeros((len(which), free.shape[1]))
        for row, i in zip(rows, which, strict=True):
            along = np.reshape(state[ca.jacobian(self.frictions[i].sliding_speed, numeric.eom.v)], -1)
            size = np.linalg.norm(along @ free)
            if size > TURNS * np.linalg.norm(along * numeric.column_scale):
                row[:] = along @ free / size
        return rows

    @staticmethod
    def _held(rows: dict[int, np.ndarray], sticking: Sequence[int]) -> list[int]:
        """Frictions at rest that the pose, or others that stick, keep from sliding whatever force they exert."""
        if not rows:
            return []
        whole = np.array(list(rows.values()))
        held = np.reshape([rows[i] for i in sticking], (len(sticking), whole.shape[1]))
        left = np.linalg.norm(whole @ analyse_rank(held, TURNS).null_columns, axis=1)
        return [i for i, size in zip(rows, left, strict=True) if size <= TURNS and i not in sticking]

    def _candidates(self, choices: Sequence[list[str]], rows: dict[int, np.ndarray]) -> list[tuple[Senses, list[int]]]:
        """Modes that may hold, and what is held in them: first those in which most sticks, and of these without help.

        With no more friction at rest than in motion, what can be held does not slide: help comes last.
        """
        falls = any(self.frictions[i].falls for i in rows)
        candidates: list[tuple[tuple[int, int, bool], Senses, list[int]]] = []
        for modes in product(*choices):
            sticking = [i for i in rows if modes[i] == "sticks"]
            held = self._held(rows, sticking)
            if not self._is_possible(modes, rows, sticking, held):
                continue
            helps = {i for i in held if sticking and SENSE[modes[i]]}
            # what the pose holds starts to slide; what others hold is at its limit at rest
            pulled = {i for i in helps if np.any(rows[i])}
            senses = tuple(f"pulled {mode}" if i in pulled else mode for i, mode in enumerate(modes))
            candidates.append(((helps != pulled, -len(sticking) if falls else 0, bool(helps)), senses, held))
            if pulled:  # by what moves: they begin to slide
                candidates.append(((2, 0, True), modes, [i for i in held if i not in pulled]))
        return [(senses, held) for _, senses, held in sorted(candidates, key=lambda candidate: candidate[0])]

    @staticmethod
    def _is_possible(modes: Senses, rows: dict[int, np.ndarray], sticking: list[int], held: list[int]) -> bool:
        """True if what sticks is independent, what slides together does so in one sense, and what is free is held."""
        if sticking and analyse_rank(np.array([rows[i] for i in sticking]), TURNS).rank < len(sticking):
            return False
        slide = [(rows[i], SENSE[modes[i]]) for i in rows if i not in held and i not in sticking]
        if any(_parallel(one, other) * sense * to < 0 for (one, sense), (other, to) in combinations(slide, 2)):
            return False
        return all(modes[i] != "free" or i in held for i in rows)

    def _is_met(
        self,
        mode: FrictionMode,
        trial: State,
        resting: Sequence[int],
        by_pose: Sequence[int],
        breaking: set[int],
        strict: Container[int] = (),
    ) -> bool:
        """True if friction at rest is below its limit, and what starts to slide does so in its sense.

        Other frictions that stick may exert any force up to their limits; what is breaking away may not yet accelerate.
        Conditions that are `strict` have to be clear of their limits and of rest by more than rounding.
        """
        for i in resting:
            friction, sense = self.frictions[i], mode.senses[i]
            sign = -1 if i in strict else 1
            if sense == "sticks":
                lam = trial.lam[self.row(mode, friction)]
                # without load, reactions that are rounding are no pull
                rounding = sign * ROUNDING * largest(trial.lam)
                limits = [(to * lam, trial[self.in_mode(mode, limit)]) for to, limit in _limits(friction)]
                if not all(pull <= limit * (1 + sign * FRICTION_TOLERANCE) + rounding for pull, limit in limits):
                    return False
                continue
            onset = float(trial[time_derivative(friction.sliding_speed)])
            rounding = FRICTION_TOLERANCE * self._fineness * (1 + largest(trial.a))
            if sense == "free" or (i in mode.held and i not in by_pose):
                if abs(onset) > rounding:
                    return False  # what holds it moves
                continue
            onset *= SENSE[sense]
            slack = rounding * (-1 if i in by_pose else 1 if i in breaking else min(sign, 0))
            if not onset > -slack:
                return False
        return True

    def _at_rest(self, state: State, resting: Sequence[int]) -> np.ndarray:
        """Velocities with the speeds of what rests at zero exactly."""
        if not resting:
            return state.v
        speeds = ca.vertcat(*[self.frictions[i].sliding_speed for i in resting])
        numeric = NumericEquations(state.equations, state.parameters)
        return jump_to(numeric, state, speeds, np.zeros(len(resting))).v


def _parallel(first: np.ndarray, second: np.ndarray) -> int:
    """Sign in which two frictions slide together, by their sliding of size one in free motions; 0 if they need not."""
    cosine = float(first @ second)
    return int(np.sign(cosine)) if abs(cosine) > 1 - TURNS else 0


def _limits(friction: Any) -> list[tuple[int, Any]]:
    """Senses in which a friction can be pulled so that it slides, and the largest pull at rest in each."""
    limits = zip((1, -1), friction.limits_of_pull, strict=True)
    return [(sign, limit) for sign, limit in limits if known_value(limit) != np.inf]


def _speed_by_rounding(friction: Any, motion: Trajectory | State) -> float:
    """Sliding speed that is gathered in the time by which the instant of a stop may be off, m/s."""
    time = TIME_ROUNDINGS * float(np.spacing(np.max(np.abs(motion.t), initial=0.0)))
    return time * largest(np.atleast_1d(motion[time_derivative(friction.sliding_speed)]))
