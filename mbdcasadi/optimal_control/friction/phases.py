"""A problem with exact friction as one in phases, in each of which every friction sticks or slides one way."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...model.conditions import Bounded, Condition, bounded, stacked
from ...model.forces.friction.joint_friction import FrictionInJoint
from ...model.placeholders import at_end
from ...model.symbols import t as time
from ...numerics.rank import dependent_rows, unit_rows
from ...results.state import State
from ..motion.guess import Guess, PhaseGuess
from ..problem import OptimalControlProblem
from ..solution import Solution
from ..statement.dry_friction import SENSE, Relaxation, Replaced, replaced
from ..statement.phase import BEYOND_STATES, Phase
from ..statement.state_conditions import independent_state_conditions
from ..statement.time_span import between
from .pattern import SHORTEST, Piece

#: Rest of a unit row below which a condition on velocities follows from what sticks.
IMPLIED = 1e-6


@dataclass(frozen=True)
class PhasedFriction:
    """A problem in phases, and a motion through them to begin with.

    Attributes
    ----------
    problem : OptimalControlProblem
        The problem in phases.
    pieces : sequence of Piece
        Modes in the phases.
    guess : Guess
        The motion to begin with.
    replaced : list of Replaced
        What stands in place of friction in the phases.
    """

    problem: OptimalControlProblem
    pieces: Sequence[Piece]
    guess: Guess
    replaced: list[Replaced]

    @property
    def order(self) -> str:
        """The modes in their order, in words."""
        return "; ".join(phase.name.partition(": ")[2] for phase in self.problem.phases)


class PhaseMaker:
    """Phases of a problem with exact friction, from a motion with friction as a force."""

    def __init__(self, problem: OptimalControlProblem, relaxation: Relaxation, motion: Solution):
        self.problem, self._relaxation, self._motion = problem, relaxation, motion
        self._given = problem.given
        self._frictions = tuple(relaxation.replaced.inputs)
        (self._part,) = motion.phases

    def phased(self, pieces: Sequence[Piece]) -> PhasedFriction:
        """Return the problem in the phases of a pattern."""
        made = [self._phase(k, pieces) for k in range(len(pieces))]
        phases = [phase for phase, _ in made]
        problem = self.problem
        cost, boundary = ca.SX(self._given["terminal_cost"]), list[Any](self._given["boundary"])
        for phase, piece in zip(phases, pieces, strict=True):
            if piece.waypoint is not None:
                waypoint = problem.waypoints[piece.waypoint]
                cost += phase.at_end(waypoint.own_cost) if not waypoint.own_cost.is_zero() else 0
                boundary.append(_within(phase.at_end(time), waypoint.time))
        if len(phases) > 1:
            boundary.append(_within(at_end(time), problem.duration))
        if problem.has_input_rates(problem.initial):
            for before, after in itertools.pairwise(phases):
                boundary += [before.at_end(u) == after.at_start(u) for u in problem.mechanism.inputs]
        free = problem.whole["free_parameters"]
        whole = OptimalControlProblem(phases=phases, terminal_cost=cost, boundary=boundary, free_parameters=free)
        motions = [self._motion_in(piece, of, phase) for piece, (phase, of) in zip(pieces, made, strict=True)]
        values = [self._motion.parameters.get(p, p.value) for p in whole.free_parameters]
        guess = Guess(tuple(motions), np.array(values), "friction as a force")
        return PhasedFriction(whole, pieces, guess, [of for _, of in made])

    # --- one phase --------------------------------------------------------------------------------
    def _phase(self, k: int, pieces: Sequence[Piece]) -> tuple[Phase, Replaced]:
        piece, is_last = pieces[k], k + 1 == len(pieces)
        modes = dict(zip(self._frictions, piece.senses, strict=True))
        held = self._held(piece)
        of = replaced(
            self._given["mechanism"],
            {f: None if mode == "sticks" and f not in held else mode for f, mode in modes.items()},
        )
        path = list(of.conditions(self._given["path"]))
        for friction, mode in modes.items():
            if mode == "sticks":
                path += of.cone(friction)
            else:
                label = f"{friction.name} slides {mode}"
                path.append(Condition(-SENSE[mode] * friction.sliding_speed, False, label))
        after = piece.senses if is_last else pieces[k + 1].senses
        both = zip(self._frictions, piece.senses, after, strict=True)
        stopping = [f for f, mode, other in both if mode not in ("sticks", other)]
        demanded = self._demanded(piece, is_last=is_last)
        stops = [Condition(f.sliding_speed, True, f"{f.name} stops") for f in stopping]
        final = self._independent(held, piece.end, [*demanded, *stops])
        initial: Any = ()
        if k == 0:
            initial = self.problem.initial
            if not isinstance(initial, State):
                initial = self._independent(held, piece.begin, initial)
        low, high = self.problem.duration
        span = (low, high) if len(pieces) == 1 else (SHORTEST * high, high)
        duration = span[0] if span[0] == span[1] else between(*span, guess=float(np.clip(piece.duration, *span)))
        name = f"{k + 1}: {', '.join(f'{f.name} {_words(mode)}' for f, mode in modes.items())}"
        cost = of.of(ca.SX(self._given["running_cost"]))
        return Phase(name, of.mechanism, duration, initial, final, path, cost), of

    def _demanded(self, piece: Piece, *, is_last: bool) -> list[Any]:
        """Conditions at the end of a piece: those of the waypoint there, or of the end."""
        if is_last:
            final = self.problem.whole["final"] if "final" in self.problem.whole else self.problem.final
            return list(independent_state_conditions(final) if isinstance(final, State) else final)
        if piece.waypoint is None:
            return []
        waypoint = self.problem.waypoints[piece.waypoint]
        return [*waypoint.conditions, *waypoint.soft_limits]

    # --- rank -------------------------------------------------------------------------------------
    def _slopes(self, at: State, expressions: ca.SX) -> np.ndarray:
        """Derivatives of expressions by the velocities, in sizes of these (k, n)."""
        jacobian = ca.jacobian(expressions, at.equations.v)
        values = np.reshape(at[ca.vec(jacobian)], jacobian.shape, order="F")
        return unit_rows(values * self._part.numeric.column_scale)

    def _constrained(self, at: State) -> np.ndarray:
        return unit_rows(self._part.numeric.jacobian(at.t, at.q) * self._part.numeric.column_scale)

    def _held(self, piece: Piece) -> list[FrictionInJoint]:
        """Frictions that stick in a piece and are not held by the joints and others that stick."""
        sticking = [f for f, mode in zip(self._frictions, piece.senses, strict=True) if mode == "sticks"]
        at = self._state((piece.begin + piece.end) / 2)
        joints = self._constrained(at)
        rows = self._slopes(at, ca.vertcat(ca.SX(0, 1), *[f.sliding_speed for f in sticking]))
        dependent = set(dependent_rows(np.vstack([joints, rows]), IMPLIED))
        return [f for k, f in enumerate(sticking) if k + len(joints) not in dependent]

    def _independent(self, held: Sequence[FrictionInJoint], t: float, conditions: Sequence[Any]) -> list[Any]:
        """Conditions at a time without those on velocities that what sticks, and others before them, imply."""
        on_speeds = [
            c for c in conditions
            if isinstance(c, Condition) and c.equality and c.depends_on("velocity") and not c.depends_on(*BEYOND_STATES)
        ]  # fmt: skip
        at = self._state(t)
        known = np.vstack([
            self._constrained(at), self._slopes(at, ca.vertcat(ca.SX(0, 1), *[f.sliding_speed for f in held]))
        ])  # fmt: skip
        dependent = set(dependent_rows(np.vstack([known, self._slopes(at, stacked(on_speeds))]), IMPLIED))
        implied = [c for k, c in enumerate(on_speeds) if k + len(known) in dependent]
        return [c for c in conditions if not any(c is one for one in implied)]

    def _state(self, t: float) -> State:
        return self._motion.trajectory.at(t).initial

    # --- the motion to begin with -------------------------------------------------------------------
    def _motion_in(self, piece: Piece, of: Replaced, phase: Phase) -> PhaseGuess:
        """The motion with friction as a force, over a piece, with the multipliers and inputs of the phase."""
        sample, eom, whole = self._sampler, phase.equations, self._part.phase
        n = whole.equations.lam.numel()
        columns = {s.element_hash(): k for k, s in enumerate(ca.vertsplit(whole.equations.lam))}
        names = {u.label: k for k, u in enumerate(whole.mechanism.inputs)}
        columns |= {
            of.forces[f].element_hash(): n + names[u.label] for f, u in self._relaxation.replaced.inputs.items()
        }
        lam = [columns[s.element_hash()] for s in ca.vertsplit(eom.lam)]
        u = [names[u.label] for u in phase.mechanism.inputs]

        def of_phase(wanted: np.ndarray) -> dict[str, np.ndarray]:
            values = sample(wanted)
            return values | {"lam": np.hstack([values["lam"], -values["u"]])[:, lam], "u": values["u"][:, u]}

        return PhaseGuess(of_phase, np.array([piece.begin, piece.end]))

    @property
    def _sampler(self) -> Any:
        return self._part.as_guess(self._part.phase, 0.0).sample


def _within(value: ca.SX, span: tuple[float, float]) -> ca.SX | Bounded:
    low, high = span
    return value == low if low == high else bounded(low, value, high)


def _words(mode: str) -> str:
    return mode if mode == "sticks" else f"slides {mode}"
