"""A problem with exact friction and contact as one in phases, in each of which all that switches has one mode."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import casadi as ca
import numpy as np

from ...errors import OptimizationError
from ...model.conditions import Bounded, Condition, bounded, stacked
from ...model.placeholders import at_end
from ...model.sites import Site
from ...model.symbols import t as time
from ...numerics.rank import dependent_rows, unit_rows
from ...numerics.tolerances import MET
from ...results.state import State
from ..motion.guess import Guess, PhaseGuess
from ..problem import OptimalControlProblem
from ..solution import Solution
from ..statement.phase import BEYOND_STATES, Phase
from ..statement.sites import SENSE, Relaxation, Replaced, gap_of, replaced
from ..statement.state_conditions import independent_state_conditions
from ..statement.time_span import between
from .pattern import CREEP, SHORTEST, Piece, joined

#: Shortest phase that begins where a contact closes, or ends where one opens, as a share of the duration: what touches
#: and leaves at one instant costs as large a share more.
INSTANT = 1e-6
#: Rest of a unit row below which a condition on velocities follows from what is closed or sticks.
IMPLIED = 1e-6


@dataclass(frozen=True)
class _Made:
    """A phase, what stands in place of friction and contacts in it, and conditions at its ends that these imply."""

    phase: Phase
    replaced: Replaced
    at_start: Sequence[Condition]
    at_end: Sequence[Condition]


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
    made : list
        Of each phase, what stands in place of friction and contacts, and conditions that these imply.
    """

    problem: OptimalControlProblem
    pieces: Sequence[Piece]
    guess: Guess
    made: list[_Made]

    def refuse_missed(self, solution: Solution) -> None:
        """Raise an error if a condition is missed that was left out since what is closed should imply it.

        Raises
        ------
        OptimizationError
            Naming the condition.
        """
        for part, one in zip(solution.phases, self.made, strict=True):
            for state, conditions in ((part.initial, one.at_start), (part.final, one.at_end)):
                for condition in conditions:
                    missed = abs(float(state[condition.expression]))
                    if missed > MET * float(part.program.sizes.of_changes([condition.expression])[0]):
                        raise OptimizationError(
                            f"{part.phase.name}: {condition.label} is missed by {missed:.3g} at t = {state.t:.6g} s",
                            partial=solution,
                            time=state.t,
                        )

    @property
    def order(self) -> str:
        """The modes in their order, in words."""
        return "; ".join(phase.name.partition(": ")[2] for phase in self.problem.phases)


class PhaseMaker:
    """Phases of a problem, from a motion with friction and contact as forces."""

    def __init__(self, problem: OptimalControlProblem, relaxation: Relaxation, motion: Solution):
        self.problem, self._relaxation, self.motion = problem, relaxation, motion
        self._given, self._sites = problem.given, relaxation.sites
        (self._part,) = motion.phases

    def phased(self, pieces: Sequence[Piece]) -> PhasedFriction:
        """Return the problem in the phases of a pattern."""
        made = [self._phase(k, pieces) for k in range(len(pieces))]
        phases = [one.phase for one in made]
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
        motions = [self._motion_in(piece, one.phase) for piece, one in zip(pieces, made, strict=True)]
        values = [self.motion.parameters.get(p, p.value) for p in whole.free_parameters]
        guess = Guess(tuple(motions), np.array(values), "laws as forces")
        return PhasedFriction(whole, pieces, guess, made)

    def possible(self, pieces: Sequence[Piece]) -> list[Piece]:
        """Return the pieces without those in which something slides though what is closed or sticks holds it.

        Such a piece, as of a block that stands still and another one that touches it and slides away into it, becomes
        part of the one before or after it. All are returned if none is possible. A place of contact that what sticks
        holds neither opens nor closes.
        """
        durations = [0.0 if self._holds_what_slides(piece) else piece.duration for piece in pieces]
        kept = list(joined(pieces, 0.0, durations) or pieces)
        for k in range(1, len(kept)):
            kept[k] = self._at_rest_as_before(kept[k - 1], kept[k])
        return joined(kept, 0.0)

    def _holds_what_slides(self, piece: Piece) -> bool:
        """Whether a sliding speed follows from the speeds that are zero in a piece, and is not in its sense."""
        sliding = {site.sliding_speed: SENSE[mode] for site, mode in self._modes(piece).items() if mode in SENSE}
        speeds = self._following(piece, list(self._held(piece).values()), list(sliding))
        return bool(np.any(np.array(list(sliding.values())) * speeds <= CREEP))

    def _at_rest_as_before(self, before: Piece, piece: Piece) -> Piece:
        """A piece with its places of contact as open or closed as before if what sticks in it holds them."""
        senses, rows = list(piece.senses), self._rows(piece)
        for k, site in enumerate(self._sites):
            if site.place is None or (senses[k] == "open") == (before.senses[k] == "open"):
                continue
            others = [row for (other, _), row in rows.items() if other is not site]
            if np.all(np.abs(self._following(piece, others, [site.element.normal_speeds[site.place]])) <= CREEP):
                closed = "closed" if site.law is None else "sticks"
                senses[k] = "open" if before.senses[k] == "open" else closed
        return replace(piece, senses=tuple(senses))

    def _following(self, piece: Piece, held: Sequence[ca.SX], wanted: Sequence[ca.SX]) -> np.ndarray:
        """Speeds, in typical ones, that follow if those held are zero in a piece; not a number for others (k,)."""
        if not held or not wanted:
            return np.full(len(wanted), np.nan)
        at = self._state((piece.begin + piece.end) / 2)
        rows = ca.vertcat(*held, *wanted)
        velocity, column = at.equations.v, self._part.numeric.column_scale
        slopes = np.reshape(at[ca.vec(ca.jacobian(rows, velocity))], (rows.numel(), -1), order="F") * column
        joints = self._part.numeric.jacobian(at.t, at.q) * column
        known, speeds = np.vstack([joints, slopes[: len(held)]]), np.ravel(at[rows])
        stops = np.linalg.lstsq(known, np.concatenate([np.zeros(len(joints)), -speeds[: len(held)]]))[0]
        found = (speeds + slopes @ stops)[len(held) :] / self._part.program.sizes.of_changes(list(wanted))
        follows = [
            len(known) in dependent_rows(unit_rows(np.vstack([known, slope])), IMPLIED) for slope in slopes[len(held) :]
        ]
        return np.where(follows, found, np.nan)

    # --- one phase --------------------------------------------------------------------------------
    def _phase(self, k: int, pieces: Sequence[Piece]) -> _Made:
        piece, before, after = pieces[k], pieces[k - 1] if k else None, pieces[k + 1] if k + 1 < len(pieces) else None
        held = self._held(piece)
        free = [one for one in self._rows(piece) if one not in held]
        of = replaced(self._given["mechanism"], self._modes(piece), free)
        path = [*of.conditions(self._given["path"]), *self._laws(of, piece)]
        demanded = self._demanded(piece, is_last=after is None)
        final, at_end = self._independent(held, piece.end, [*demanded, *self._stops(piece, after)])
        initial: Any = () if before is None else self._impulses(of, before, piece)
        at_start = list[Any]()
        if before is None:
            initial = self.problem.initial
            if not isinstance(initial, State):
                initial, at_start = self._independent(held, piece.begin, initial)
        low, high = self.problem.duration
        touches = any(one is not None and self._closing(one, piece) for one in (before, after))
        least = (INSTANT if touches else SHORTEST) * high
        span = (low, high) if len(pieces) == 1 else (least, high)
        duration = span[0] if span[0] == span[1] else between(*span, guess=float(np.clip(piece.duration, *span)))
        name = f"{k + 1}: {', '.join(f'{site.name} {_words(mode)}' for site, mode in self._modes(piece).items())}"
        phase = Phase(name, of.mechanism, duration, initial, final, path, of.of(self._given["running_cost"]))
        return _Made(phase, of, at_start, at_end)

    def _modes(self, piece: Piece) -> dict[Site, str]:
        return dict(zip(self._sites, piece.senses, strict=True))

    def _laws(self, of: Replaced, piece: Piece) -> list[Condition]:
        """What the modes of a piece demand of its motion."""
        path = list[Condition]()
        for site, mode in self._modes(piece).items():
            if mode == "open":
                path.append(Condition(-gap_of(site), False, f"{site.name} is not passed"))
            elif site.place is not None:
                path.append(Condition(-of.normal[site], False, f"{site.name} does not pull"))
            if mode == "sticks":
                path += of.cone(site)
            elif mode in SENSE:
                path.append(Condition(-SENSE[mode] * site.sliding_speed, False, f"{site.name} slides {mode}"))
        return path

    def _stops(self, piece: Piece, after: Piece | None) -> list[Condition]:
        """Speeds that are zero at the end of a piece: of what stops, unless a contact closes there."""
        if after is None or self._closing(piece, after):
            return []
        both = zip(self._sites, piece.senses, after.senses, strict=True)
        stopping = [site for site, mode, other in both if mode in SENSE and other not in ("open", mode)]
        return [Condition(site.sliding_speed, True, f"{site.name} stops") for site in stopping]

    def _closing(self, before: Piece, after: Piece) -> bool:
        both = zip(before.senses, after.senses, strict=True)
        return any(one == "open" != other for one, other in both)

    def _impulses(self, of: Replaced, before: Piece, piece: Piece) -> list[Condition]:
        """Laws of the impulses if a contact closes: contacts do not pull, what sticks is within its limit."""
        if not self._closing(before, piece):
            return []
        laws = list[Condition]()
        impulse = {key: -element.impulses[row] for key, (element, row) in of.rows.items()}
        for (site, kind), value in impulse.items():
            if kind == "normal":
                laws.append(Condition(-value, False, f"{site.name} is struck without a pull"))
            elif site.place is None:
                laws.append(Condition(value, True, f"{site.name} is not struck"))
            elif (site, "normal") in impulse:
                limit = site.law.coefficient * impulse[site, "normal"]
                label = f"{site.name} is struck within its friction"
                laws += [Condition(sign * value - limit, False, label) for sign in (1, -1)]
        return laws

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
    def _slopes(self, at: State, expressions: ca.SX, symbols: ca.SX) -> np.ndarray:
        """Derivatives of expressions by coordinates or velocities, in sizes of these (k, n)."""
        jacobian = ca.jacobian(expressions, symbols)
        values = np.reshape(at[ca.vec(jacobian)], jacobian.shape, order="F")
        return unit_rows(values * self._part.numeric.column_scale)

    def _constrained(self, at: State) -> np.ndarray:
        return unit_rows(self._part.numeric.jacobian(at.t, at.q) * self._part.numeric.column_scale)

    def _rows(self, piece: Piece) -> dict[tuple[Site, str], ca.SX]:
        """Speeds that are zero in a piece, by site and "normal" or "friction": normal ones first."""
        modes = self._modes(piece).items()
        closed = [site for site, mode in modes if site.place is not None and mode != "open"]
        normal = {(site, "normal"): site.element.normal_speeds[site.place] for site in closed}
        return normal | {(site, "friction"): site.sliding_speed for site, mode in modes if mode == "sticks"}

    def _held(self, piece: Piece) -> dict[tuple[Site, str], ca.SX]:
        """Those of them that the joints and others before them do not hold."""
        rows, at = self._rows(piece), self._state((piece.begin + piece.end) / 2)
        joints = self._constrained(at)
        speeds = self._slopes(at, ca.vertcat(ca.SX(0, 1), *rows.values()), at.equations.v)
        dependent = set(dependent_rows(np.vstack([joints, speeds]), IMPLIED))
        return {key: row for k, (key, row) in enumerate(rows.items()) if k + len(joints) not in dependent}

    def _independent(
        self, held: Mapping[Any, ca.SX], t: float, conditions: Sequence[Any]
    ) -> tuple[list[Any], list[Any]]:
        """Conditions at a time, and those on positions and velocities that what is held, and others, imply."""
        at, implied = self._state(t), list[Any]()
        stated = [c for c in conditions if isinstance(c, Condition) and c.equality and not c.depends_on(*BEYOND_STATES)]
        moving = [c for c in stated if c.depends_on("velocity")]
        normal = {key: row for key, row in held.items() if key[1] == "normal"}
        for some, rows, symbols in (
            ([c for c in stated if normal and c not in moving and c.depends_on("position")], normal, at.equations.q),
            (moving, held, at.equations.v),
        ):
            known = self._slopes(at, ca.vertcat(ca.SX(0, 1), *rows.values()), at.equations.v)
            known = np.vstack([self._constrained(at), known])
            slopes = self._slopes(at, stacked(some), symbols)
            dependent = set(dependent_rows(np.vstack([known, slopes]), IMPLIED))
            implied += [c for k, c in enumerate(some) if k + len(known) in dependent]
        return [c for c in conditions if not any(c is one for one in implied)], implied

    def _state(self, t: float) -> State:
        return self.motion.trajectory.at(t).initial

    # --- the motion to begin with -------------------------------------------------------------------
    def _motion_in(self, piece: Piece, phase: Phase) -> PhaseGuess:
        """The motion with the laws as forces, over a piece, with the multipliers and inputs of the phase."""
        sample, eom, whole = self._sampler, phase.equations, self._part.phase
        n = whole.equations.lam.numel()
        columns = {s.element_hash(): k for k, s in enumerate(ca.vertsplit(whole.equations.lam))}
        places = {u.element_hash(): n + k for k, u in enumerate(whole.mechanism.inputs)}
        for symbol, value in zip(*map(ca.vertsplit, self._relaxation.replaced.multipliers), strict=True):
            columns[symbol.element_hash()] = places.get(
                (-value).element_hash(), -1
            )  # of what has no friction is no row
        lam = [columns[s.element_hash()] for s in ca.vertsplit(eom.lam)]
        names = {u.label: k for k, u in enumerate(whole.mechanism.inputs)}
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
    return f"slides {mode}" if mode in SENSE else {"open": "is open", "closed": "is closed"}.get(mode, mode)
