"""Mechanisms with exact friction in one mode, and which mode holds at a state."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.inputs import read_signals
from ...arguments.values import parameter_vector
from ...assembly.state import complete_state
from ...equations import equations
from ...equations.numeric import NumericEquations
from ...errors import SimulationError, SingularityError
from ...model.mechanism import Mechanism
from ...model.rates import time_derivative
from ...numerics.rank import analyse_rank
from ...results.state import State
from ..impacts import velocities_with

#: Sliding speed, relative to the largest velocity, that counts as rest where a piece begins.
REST = 1e-9
#: Share by which friction at rest may exceed its limit, and accelerations point the wrong way, by rounding.
ROUNDING = 1e-7
#: Sliding for each motion that the joints leave free, relative to the largest there could be, below which the pose
#: alone makes a joint turn: the guide of a crank at its dead centre.
TURNS = 1e-6
#: Modes of the frictions at rest that are tried at one instant, at the most.
TRIALS = 729

Modes = tuple[str, ...]
SENSE = {"forth": 1.0, "back": -1.0, "sticks": 0.0, "free": 0.0}


def switching(mechanism: Mechanism) -> list[Any]:
    """Elements with exact dry friction."""
    elements = getattr(mechanism, "elements", ())  # what is no mechanism is refused by the caller
    return [element for element in elements if getattr(element, "modes", ())]


def without_exact_friction(mechanism: Mechanism) -> Mechanism:
    """The mechanism with nothing that sticks or slides; itself where there is no exact friction."""
    if not switching(mechanism):
        return mechanism
    modes = ModesOfFriction(mechanism, None, lambda _: {})
    return modes.variant(modes.free)


class ModesOfFriction:
    """The modes of a mechanism with exact friction.

    Parameters
    ----------
    mechanism : Mechanism
        With joints that have exact dry friction.
    parameters : mapping or None
        Parameter to number.
    inputs_at : callable
        ``inputs_at(time) -> {input: number or expression}``.
    """

    def __init__(self, mechanism: Mechanism, parameters: Any, inputs_at: Callable[[float], dict[Any, Any]]):
        self.mechanism, self.parameters, self._inputs_at = mechanism, parameters, inputs_at
        self.frictions = switching(mechanism)
        #: frictions at rest that cannot slide before something else does, of the modes that were found last
        self.held: list[int] = []
        self.free: Modes = ("free",) * len(self.frictions)

    # --- mechanisms in one mode ------------------------------------------------------------------
    def variant(self, modes: Modes) -> Mechanism:
        """The mechanism with every friction in a mode; made once."""

        def make() -> Mechanism:
            place = {f: f.in_mode(mode) for f, mode in zip(self.frictions, modes, strict=True)}
            return self.mechanism.replace(forces=[place.get(f, f) for f in self.mechanism.forces])

        return self.mechanism.cache.get_or_create(("stick and slip", modes), make)

    def numeric(self, modes: Modes) -> NumericEquations:
        """Equations in a mode, at the parameters of the run."""
        eom = equations(self.variant(modes))
        return NumericEquations(eom, parameter_vector(eom, self.parameters))

    def row(self, modes: Modes, friction: Any) -> int:
        """Row of a friction that sticks."""
        return equations(self.variant(modes)).row_names.index(friction.name)

    def multipliers(self, modes: Modes, motion: Any) -> np.ndarray:
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

    def whole(self, modes: Modes, s: State) -> State:
        """A state in one mode as one of the mechanism."""
        lam = self.multipliers(modes, s)[0]
        return State(self.mechanism, s.t, s.q, s.v, s.a, s.z, lam, s.inputs, s.parameters)

    def at(self, modes: Modes, time: float, q: np.ndarray, v: np.ndarray, z: np.ndarray) -> State:
        """A pose and velocity in some modes, with the accelerations and multipliers there."""
        numeric = self.numeric(modes)
        return complete_state(numeric, read_signals(numeric.eom, self._inputs_at(time)), time, q, v, z)

    @property
    def rest(self) -> ca.SX:
        """Sliding speed from which what the pose held at rest counts as sliding, m/s."""
        return 2 * REST * (1 + ca.norm_2(equations(self.variant(self.free)).v))

    # --- which mode holds -----------------------------------------------------------------------------
    def pull(self, index: int, state: State) -> float:
        """Sense in which what sticks is pulled."""
        eom = state.equations
        return float(np.sign(state.lam[eom.row_names.index(self.frictions[index].name)]))

    def decided(self, state: State, broken: dict[int, float]) -> tuple[Modes, State] | None:
        """Modes that meet the laws of friction at a pose and velocity, and the state in them; None where none do.

        Parameters
        ----------
        state : State
            In any mode.
        broken : dict of int to float
            Frictions that break away just there, and the sense in which they were pulled.
        """
        speeds = np.atleast_1d(state[ca.vertcat(*[f.sliding_speed for f in self.frictions])])
        limit = REST * (1 + float(np.max(np.abs(state.v))))
        resting = [i for i, speed in enumerate(speeds) if abs(speed) <= limit]
        if 3 ** len(resting) > TRIALS:
            raise SimulationError(
                f"{len(resting)} frictions come to rest together at t = {state.t:.6g} s, more than are sorted out at "
                "once; take a smoothed law for some of them",
                time=state.t,
            )
        rows = dict(zip(resting, self._slides(state, resting), strict=True))
        by_pose = self._held(rows, ())
        v = self._at_rest(state, [i for i in resting if i not in by_pose])
        choices = [self._choices(i, float(speeds[i]), i in resting, broken) for i in range(len(self.frictions))]
        for i in by_pose:
            choices[i] = ["forth", "back", "free"]
        for modes, held in self._candidates(choices, rows):
            try:
                trial = self.at(modes, state.t, state.q, v, state.z)
                if self._is_met(modes, trial, resting, by_pose, held, broken):
                    self.held = held
                    return modes, trial
            except SingularityError:
                continue
        return None

    @staticmethod
    def _choices(i: int, speed: float, rests: bool, broken: dict[int, float]) -> list[str]:
        if not rests:
            return ["forth" if speed > 0 else "back"]
        if i in broken:
            return ["forth" if broken[i] > 0 else "back"]
        return ["sticks", "free", "forth", "back"]

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
        basis = analyse_rank(np.reshape([rows[i] for i in sticking], (-1, whole.shape[1])), TURNS).null_columns
        left = np.linalg.norm(whole @ basis, axis=1)
        return [i for i, size in zip(rows, left, strict=True) if size <= TURNS and i not in sticking]

    def _candidates(self, choices: Sequence[list[str]], rows: dict[int, np.ndarray]) -> list[tuple[Modes, list[int]]]:
        """Modes that may hold, and what is held in them; last those in which something held helps what sticks."""
        found: list[tuple[bool, Modes, list[int]]] = []
        for modes in product(*choices):
            sticking = [i for i in rows if modes[i] == "sticks"]
            held = self._held(rows, sticking)
            depends = sticking and analyse_rank(np.array([rows[i] for i in sticking]), TURNS).rank < len(sticking)
            if not depends and not any(mode == "free" and i not in held for i, mode in enumerate(modes)):
                found.append((bool(sticking) and any(SENSE[modes[i]] for i in held), modes, held))
        return [(modes, held) for _, modes, held in sorted(found, key=lambda candidate: candidate[0])]

    def _is_met(
        self,
        modes: Modes,
        trial: State,
        resting: Sequence[int],
        by_pose: Sequence[int],
        held: Sequence[int],
        broken: dict[int, float],
    ) -> bool:
        """Whether friction at rest is below its limit, and what starts to slide does so in its sense.

        What others that stick hold may exert any force up to its limit.
        """
        for i in resting:
            friction, mode = self.frictions[i], modes[i]
            if mode == "sticks":
                pull = abs(trial.lam[self.row(modes, friction)])
                limit = trial[ca.SX(friction.law.static_coefficient * friction.load)]
                if not pull <= limit * (1 + ROUNDING):
                    return False
                continue
            if mode == "free" or (i in held and i not in by_pose):
                continue
            onset = SENSE[mode] * trial[time_derivative(friction.sliding_speed)]
            largest = float(np.max(np.abs(trial.a)))
            slack = -ROUNDING * largest if i in by_pose else ROUNDING * (1 + largest) if i in broken else 0.0
            if not onset > -slack:
                return False
        return True

    def _at_rest(self, state: State, resting: Sequence[int]) -> np.ndarray:
        """Velocities with the speeds of what rests at zero exactly."""
        if not resting:
            return state.v
        speeds = ca.vertcat(*[self.frictions[i].sliding_speed for i in resting])
        numeric = NumericEquations(state.equations, state.parameters)
        return velocities_with(numeric, state, speeds, np.zeros(len(resting)))[0]
