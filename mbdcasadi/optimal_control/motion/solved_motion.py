"""The motion that the variables of a program describe: an optimum, or the last iterate of a solve."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...arguments.piecewise_polynomial import PiecewisePolynomial
from ...equations.numeric import NumericEquations
from ...model.conditions import Condition
from ...model.symbols import Parameter
from ...numerics.lazy import cached_property
from ...numerics.symbolic import symbolic
from ...results.phases import PhasedTrajectory, in_whole, union_of
from ...results.state import State
from ...results.trajectory import EventOccurrence, Statistics, Trajectory
from ..problem import OptimalControlProblem
from ..program.collocation_program import CollocationProgram
from ..program.phase_program import PhaseProgram
from ..program.setup import Settings
from ..program.statistics import Answer, Attempt, SolveStatistics
from ..transcription.mesh import Mesh, interval_count
from .guess import Guess, Iterate
from .phase_solution import InstantSolution, PhaseSolution


class SolvedMotion:
    """Variables, cost and multipliers of a program, and the motion that they describe.

    Base class of :class:`Solution`, where its arguments and attributes are listed.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        program: CollocationProgram,
        settings: Settings,
        initial: State | tuple[Condition, ...],
        p: Sequence[np.ndarray],
        meshes: Sequence[Mesh],
        segment_times: Sequence[np.ndarray],
        x: np.ndarray,
        cost: float,
        statistics: SolveStatistics,
        answer: Answer,
    ):
        self.problem, self.program, self.settings, self.initial = problem, program, settings, initial
        self.cost, self.statistics, self.answer = cost, statistics, answer
        #: variables of the program, in physical units
        self.variables = x
        free = x[program.parameter_index].tolist()
        self.parameters: dict[Parameter, float] = dict(zip(problem.free_parameters, free, strict=True))
        parts = zip(program.phases, p, meshes, segment_times, strict=True)
        self.phases = tuple(self._part(*part) for part in parts)
        self.durations = tuple(phase.duration for phase in self.phases)
        self.duration = float(self.phases[-1].segment_times[-1])
        self.waypoint_times = np.concatenate([phase.segment_times[1:-1] for phase in self.phases])
        first, *others = (phase.mesh_times for phase in self.phases)
        self.mesh = self.mesh_times = np.concatenate([first, *(times[1:] for times in others)])

    def _part(self, program: PhaseProgram, p: np.ndarray, mesh: Mesh, times: np.ndarray) -> PhaseSolution:
        phase, values = program.phase, p.copy()
        for k, symbol in enumerate(phase.mechanism.parameters):
            values[k] = self.parameters.get(symbol, values[k])
        numeric = NumericEquations(phase.equations, values)
        extra = np.array([self.parameters[s] for s in program.extra_parameters])
        kind = InstantSolution if phase.is_instant else PhaseSolution
        return kind(program, numeric, mesh, self.variables, times, extra, self.statistics.seconds, self.settings.known)

    @property
    def meshes(self) -> tuple[Mesh, ...]:
        """Meshes by phase."""
        return tuple(phase.mesh for phase in self.phases)

    @cached_property
    def inputs(self) -> dict[Any, PiecewisePolynomial]:
        """The inputs as piecewise polynomials, as ``simulate(inputs=…)`` takes them."""
        parts = [part for part in self.phases if not part.phase.is_instant]
        symbols = dict.fromkeys(u for part in parts for u in part.phase.mechanism.inputs)
        return {
            symbol: _joined([(part.mesh_times, part.polynomials.inputs.get(symbol)) for part in parts])
            for symbol in symbols
        }

    @cached_property
    @symbolic
    def trajectory(self) -> Trajectory:
        """The motion at mesh points and stages; ``.at(times)`` between them by the polynomials of the scheme."""
        if len(self.phases) == 1:
            return self.phases[0].trajectory
        whole = union_of(part.phase.mechanism for part in self.phases)
        by_symbol: dict[Any, float] = {}
        for part in self.phases:
            by_symbol |= dict(zip(part.phase.mechanism.parameters, part.numeric.p.tolist(), strict=True))
        values = np.array([by_symbol.get(p, p.value) for p in whole.parameters])
        parts = [part.trajectory for part in self.phases]
        events = []
        for change, (before, after) in zip(self.program.changes, itertools.pairwise(parts), strict=True):
            first = after.initial
            state = State(first.mechanism, *first.arguments, first.obstacle, change.impulses(self.variables))
            ends = [in_whole(one, whole, values) for one in (before.final, state)]
            events.append(EventOccurrence(change.after.phase.name, first.t, *ends))
        statistics = Statistics(parts[0].statistics.method, parts[0].statistics.formulation, self.statistics.seconds)
        return PhasedTrajectory(parts, whole, [values] * len(parts), events=events, statistics=statistics)

    @property
    def mesh_error(self) -> float:
        """Largest local error of an interval: q (m, rad), v by the duration, first-order states by their ranges."""
        return max(phase.mesh_error for phase in self.phases)

    @property
    def cost_size(self) -> float:
        """Absolute value of the cost, or of its running part without cancellation if that is larger."""
        return max(abs(self.cost), sum(part.cost_size for part in self.phases))

    @property
    def points_per_interval(self) -> int:
        """Points of :attr:`trajectory` in each interval."""
        return self.phases[0].points_per_interval

    @property
    def redundant(self) -> bool:
        """True if constraint rows were left out because others imply them: reactions are not unique."""
        return any(phase.redundant for phase in self.phases)

    def as_guess(self, problem: OptimalControlProblem) -> Guess:
        """The motion as a guess for the same or a similar problem."""
        phases, time = [], 0.0
        for part, phase in zip(self.phases, problem.phases, strict=True):
            phases.append(part.as_guess(phase, time))
            time = float(phases[-1].segment_times[-1])
        free = [self.parameters.get(p, p.value) for p in problem.free_parameters]
        return Guess(tuple(phases), np.array(free), "solution", self._iterate(self.variables / self.program.scale))

    def as_attempt(self, description: str, **more: Any) -> Attempt:
        """Return the record of the solve that led to it."""
        s, count = self.statistics, interval_count(self.meshes)
        return Attempt(description, self.cost, s.iterations, s.status, s.seconds, count, **more)

    def _iterate(self, x: np.ndarray) -> Iterate:
        return Iterate(self.program, self.meshes, x, self.answer.lam_x, self.answer.lam_g)


def _joined(parts: Sequence[tuple[np.ndarray, PiecewisePolynomial | None]]) -> PiecewisePolynomial:
    """An input over phases that follow each other; zero in those that do not have it."""
    terms = max(p.terms for _, p in parts if p is not None)
    breaks, rows = [parts[0][0]], []
    for k, (times, polynomial) in enumerate(parts):
        if k:
            breaks.append(times[1:])
        own = np.zeros((times.size - 1, terms))
        if polynomial is not None:
            own[:, : polynomial.terms] = polynomial.coefficients
        rows.append(own)
    return PiecewisePolynomial(np.concatenate(breaks), np.vstack(rows))
