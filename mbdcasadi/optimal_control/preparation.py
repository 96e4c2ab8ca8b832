"""What the solves of a problem on all meshes have in common: start, ends, sizes, transcription."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.inputs import read_signals
from ..assembly.consistent_start import complete_state, consistent_start
from ..equations.numeric import LARGE, NumericEquations
from ..equations.reduced import ReducedEquations, reduced_equations
from ..errors import AssemblyError, ConditionError
from ..model.conditions import Condition, stacked
from ..model.symbols import symbols_of
from ..numerics.least_squares import largest
from ..numerics.rank import dependent_rows, unit_rows
from ..results.state import State
from .checks.condition_rank import ConditionRank, ranks_of
from .checks.consistency import at_end_alone, on_states
from .constraints import MotionConstraints, held_conditions, with_rates
from .guess.kinematic_guess import kinematic_poses, nominal_marks
from .guess.linear_conditions import state_of
from .nlp.scaling import scales_of
from .problem import OptimalControlProblem
from .transcription.base import Transcription
from .transcription.controls import input_basis
from .transcription.gauss_legendre import GaussLegendre
from .transcription.hermite_simpson import HermiteSimpson

#: What ``transcription=`` may say, besides a class.
TRANSCRIPTIONS: dict[str, type[Transcription]] = {scheme.name: scheme for scheme in (GaussLegendre, HermiteSimpson)}
#: Share of its typical change within which an implied condition must stay while the solver runs.
WINDOW = 0.05
#: By how much a start may miss a path condition that prescribes the motion.
OFF = 1e-6


@dataclass(frozen=True)
class Settings:
    """What a user chose for a solve."""

    transcription: str | type[Transcription]
    degree: int
    control: str
    options: dict[str, Any]
    progress: bool

    @property
    def plain(self) -> dict[str, Any]:
        """What decides the program; names and numbers, unless the transcription is the user's own."""
        return {"transcription": self.transcription, "degree": self.degree, "control": self.control}

    @property
    def option_key(self) -> tuple:
        """What tells compiled solvers of one program apart."""
        return tuple(sorted((k, repr(v)) for k, v in self.options.items()))


class Preparation:
    """Ends, sizes and transcription of a problem.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    settings : Settings
        How.
    numeric : NumericEquations
        Equations at the parameters that are given.
    start : State
        First state, as far as the initial conditions decide it.

    Attributes
    ----------
    marks : numpy.ndarray
        Times of start, waypoints and end to begin with, s.
    initial : list of Condition or None
        Independent conditions at the start; None where it is given as a whole.
    final : list of Condition
        Independent conditions at the end.
    scales : Scales
        Typical sizes.
    scheme : Transcription
        The transcription.
    """

    def __init__(self, problem: OptimalControlProblem, settings: Settings, numeric: NumericEquations, start: State):
        self.problem, self.numeric, self.start = problem, numeric, start
        self.held = held_conditions(problem)
        #: conditions that others imply on one branch, with their windows; they are checked in the solution
        self.implied: dict[Condition, float] = {}
        low, high = problem.duration
        self.marks = nominal_marks(problem, high if low == high else (low * high) ** 0.5 if low > 0 else high / 2)
        self.times, self.poses = kinematic_poses(problem, numeric, start, self.marks)
        self.final = self._final(start)
        self.initial = self._initial(start)
        self.scales = scales_of(numeric, float(self.marks[-1]), self.poses)
        self.scheme = self._scheme(settings)

    def _final(self, start: State) -> list[Condition]:
        """Independent conditions at the end."""
        problem, numeric = self.problem, self.numeric
        eom, end = numeric.eom, problem.final
        if isinstance(end, State):
            state = (float(self.marks[-1]), end.q, end.v, end.z)
            final = _as_conditions(problem, end)
        else:
            state = (float(self.marks[-1]), self.poses[-1], np.zeros(eom.q.numel()), start.z)
            final = list(end)
        rows = [c for c in on_states(final) if c.equality]
        if not rows or (eom.q.numel() * eom.lam.numel() > LARGE and not isinstance(end, State)):
            return final
        ranks = ranks_of(problem, numeric, timed=True)
        kept = ranks.independent(rows, state, with_rates(self.held))
        stationary = {c: self._stationary(c) for c in kept if ranks.meets_singular([c], state)}
        kept = [c for c in kept if not stationary.get(c)]
        others = [c for c in final if c in kept or c not in rows]
        return [*others, *itertools.chain(*stationary.values()), *self._windows(rows, kept, ranks)]

    def _stationary(self, condition: Condition) -> list[Condition]:
        """What a condition that is met at an extremum says to first order: its slopes vanish.

        The height of a pendulum is that of its top where its slope by the angle is zero; the condition itself has
        no slope there, and no multiplier. None where constraints are left in which slopes would have to be taken.
        """
        eom = reduced_equations(self.problem.equations)
        if eom.rows or condition.depends_on("velocity"):
            return []
        (expression,) = eom.of(condition.expression)
        slopes = ca.jacobian(expression, eom.q)
        bent = [k for k in range(eom.q.numel()) if ca.depends_on(slopes[k], eom.q)]
        return [
            Condition(slopes[k], True, f"the slope of {condition.label} by {eom.coordinate_names[k]}") for k in bent
        ]

    def _windows(self, rows: list[Condition], kept: list[Condition], ranks: ConditionRank) -> list[Condition]:
        """Limits about conditions that others imply: implied they are on one branch alone."""
        found = []
        for condition in rows:
            if condition not in kept:
                width = self.implied[condition] = self._window(condition, ranks)
                label = f"{condition.label} (on the same branch)"
                found += [Condition(sign * condition.expression - width, False, label) for sign in (1, -1)]
        return found

    def _window(self, condition: Condition, ranks: ConditionRank) -> float:
        """Half width of such a limit: a share of what the quantity changes by."""
        eom = self.problem.equations
        slopes = eom.function(ca.jacobian(condition.expression, ca.vertcat(eom.q, eom.v, eom.z)))
        zero = np.zeros(eom.q.numel())
        m = np.zeros(eom.lam.numel())
        found = [
            np.abs(slopes(t, q, v, zero, z, m, eom.input_values, self.numeric.p).full()) for t, q, v, z in ranks.states
        ]
        typical = np.r_[self.numeric.typical_step, self.numeric.typical_step / self.marks[-1], np.ones(eom.z.numel())]
        return WINDOW * max((float(np.max(x * typical, initial=0.0)) for x in found), default=1.0)

    def _initial(self, start: State) -> list[Condition] | None:
        """Independent conditions at the start; None where they give it as a whole."""
        problem, eom = self.problem, self.problem.equations
        if isinstance(problem.initial, State):
            return None
        if eom.q.numel() * eom.lam.numel() > LARGE:
            return list(problem.initial)
        free = ca.vertcat(ca.SX(0, 1), *problem.free_parameters)
        ranks, begin = ranks_of(problem, self.numeric, timed=False), (0.0, start.q, start.v, start.z)
        rows = [c for c in on_states(problem.initial) if c.equality]
        held = with_rates(self.held)
        kept = ranks.independent(rows, begin, held)
        others = [c for c in problem.initial if c not in rows]
        moving = {s.element_hash() for s in ca.vertsplit(free)}
        fixed = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu, stacked([*held, *kept]))
        if not others and not moving & {s.element_hash() for s in symbols_of(fixed)}:
            if ranks.complete([*held, *kept]):  # nothing that is free occurs in the rows
                return None
        return [*kept, *others, *self._windows(rows, kept, ranks)]

    def _is_singular(self) -> bool:
        """Whether the conditions of a place are met where they say nothing to first order: at the top of a circle."""
        problem, z, last = self.problem, self.start.z, float(self.marks[-1])
        if problem.equations.q.numel() * problem.equations.lam.numel() > LARGE:
            return False
        at_end = [] if isinstance(problem.final, State) else [*self.final, *at_end_alone(problem)]
        places = [(0.0, list(self.initial or [])), (last, at_end)]
        places += [(float(t), list(w.conditions)) for t, w in zip(self.marks[1:-1], problem.waypoints, strict=True)]
        ranks = ranks_of(problem, self.numeric, timed=True)
        for t, conditions in places:
            rows = [c for c in on_states(conditions) if c.equality]
            q = self.poses[int(np.argmin(np.abs(self.times - t)))]
            at = (t, q, np.zeros(q.size), z)
            if rows and ranks.meets_singular(ranks.independent(rows, at), at):
                return True
        return False

    def _scheme(self, settings: Settings) -> Transcription:
        problem = self.problem
        eom = reduced_equations(problem.equations, curved=not self._is_singular())
        constraints = MotionConstraints(eom, self.numeric.p, self._independent_rows(eom), self.held)
        weights, rates = self.numeric.weights[eom.independent], problem.has_input_rates
        chosen = settings.transcription
        scheme = TRANSCRIPTIONS[chosen] if isinstance(chosen, str) else chosen
        # an input that drives a first-order state could else move it unseen: by a polynomial that is zero at all stages
        drives = bool(eom.u.numel()) and bool(ca.depends_on(eom.z_rate, eom.u))
        inner, joined = scheme.input_points(max(settings.degree - drives, 1))
        basis = input_basis(settings.control, inner, joined, rates=rates)
        return scheme(constraints, weights, basis, settings.degree)

    def check_start(self, start: State) -> None:
        """Refuse a state given as the start off the motion that path conditions prescribe, or of another linkage."""
        if not isinstance(self.problem.initial, State):
            return
        eom = self.problem.equations
        name, missed = self.numeric.largest_miss(0.0, start.q, start.v)
        if abs(missed) > OFF * (1 + largest(start.q) + largest(start.v)):
            raise ConditionError(
                f"the initial state does not meet {name}: it is off by {missed:.3g}; "
                "assemble it with the parameters of this problem, and for its start at t = 0"
            )
        rows = ca.vertcat(eom.Phi, eom.Phi_q @ eom.v - eom.nu)
        for parameter in self.problem.free_parameters:
            if ca.depends_on(rows, parameter) and np.any(np.abs(start[ca.jacobian(rows, parameter)]) > OFF):
                raise ConditionError(
                    f"the initial state meets the constraints at one value of the free parameter '{parameter.label}' "
                    "alone; state conditions in its place"
                )
        for condition in with_rates(self.held):
            amount = float(start[condition.expression])
            if abs(amount) > OFF:
                raise ConditionError(f"the initial state does not meet {condition.label}: it is off by {amount:.3g}")

    def _independent_rows(self, eom: ReducedEquations) -> list[int]:
        """Rows that are left without those that others imply; of the poses passed the one with the most counts."""
        found: list[int] = []
        if not eom.rows:
            return found
        order, explicit = [*eom.explicit, *eom.rows], len(eom.explicit)
        for q in (self.poses[0], self.poses[len(self.poses) // 2], self.poses[-1]):
            jacobian = unit_rows(self.numeric.velocity(0.0, q)[0] * self.numeric.column_scale)
            dependent = set(dependent_rows(jacobian[order]))
            rows = [k for k in range(len(eom.rows)) if k + explicit not in dependent]
            found = rows if len(rows) > len(found) else found
        return found


def first_state(problem: OptimalControlProblem, numeric: NumericEquations) -> State:
    """State at the start, as far as the initial conditions decide it."""
    if isinstance(problem.initial, State):
        return problem.initial
    own = {p.element_hash() for p in problem.own_parameters}
    rows = on_states(problem.initial)
    rows = [c for c in rows if not own & {s.element_hash() for s in c.symbols}]
    held = with_rates(held_conditions(problem))
    signals, z = read_signals(problem.equations, None), problem.equations.estimate[2]
    found = state_of(numeric, [*rows, *held], 0.0, z)
    if found is not None:
        return complete_state(numeric, signals, 0.0, *found, z)
    try:
        return consistent_start(numeric, [*rows, *held], 0.0, signals)
    except (AssemblyError, ConditionError) as error:
        more = " together with the path conditions that prescribe the motion" if held else ""
        raise ConditionError(f"the initial conditions cannot be met{more}: {error}") from None


def _as_conditions(problem: OptimalControlProblem, end: State) -> list[Condition]:
    """Conditions that a state sets, by coordinate."""
    eom = problem.equations
    symbols, values = ca.vertsplit(ca.vertcat(eom.q, eom.v, eom.z)), np.r_[end.q, end.v, end.z]
    return [
        Condition(symbol - float(value), True, f"{symbol.name()} == {value:.6g}")
        for symbol, value in zip(symbols, values, strict=True)
    ]
