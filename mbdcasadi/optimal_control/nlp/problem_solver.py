"""One problem, one mesh, one solve: program, guess, run of a solver, solution."""

from __future__ import annotations

import itertools
import time as clock
from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from ...arguments.inputs import Signals
from ...arguments.values import pairs_of
from ...assembly.setup import Setup
from ...equations.numeric import NumericEquations
from ...errors import ConditionError, ModelError
from ...model.conditions import Condition
from ...numerics.lazy import cached_property
from ...numerics.least_squares import largest
from ...results.state import State
from ..checks.consistency import check_end
from ..checks.expressions import kinks_in_costs
from ..checks.failure import OptimizationError, explain_failure
from ..guess.free_poses import FreePoses, PosedPlace, free_poses, places_of
from ..guess.guess import Guess
from ..guess.key_poses import key_poses
from ..guess.kinematic_guess import KinematicPath, kinematic_path
from ..phase import Phase, read_state_or_conditions
from ..problem import OptimalControlProblem
from ..refinement.mesh import Mesh
from ..solution import Solution
from .best_so_far import BestSoFar
from .change import ChangeSetup, numeric_at
from .collocation_program import CollocationProgram, Held
from .elastic_program import ElasticProgram
from .held_limits import LIMIT_TOLERANCE, ROUNDS, largest_share, points_to_hold
from .limit_sides import LimitSides
from .setup import PhaseSetup, Settings, typical_duration
from .solvers.base import Beginning, Bounds, Elsewhere, Result
from .start import check_start, first_state
from .statistics import Answer

#: Miss of an implied condition from which a solution is refused, as a share of the window that is left to it.
BRANCH_TOLERANCE = 1e-3
#: Distance of the first key pose from the start, as a share of the coordinates, from which it is another one.
START_MOVED = 1e-9
#: Largest number of iterations if a cost has a kink: at one that matters the solver does not converge.
KINKED_ITERATIONS = 200
#: Largest scaled violation of a guess with which a solver is started as warm.
WARM_VIOLATION = 1e-2


class ProblemSolver:
    """A problem with its parameters and its start, ready to be solved on meshes.

    `initial` may replace the problem's own start; `best` records the solutions.
    """

    def __init__(
        self,
        problem: OptimalControlProblem,
        settings: Settings,
        parameters: Any = None,
        initial: Any = None,
        best: BestSoFar | None = None,
    ):
        self.problem, self.settings, self._nlp_solver = problem, settings, settings.make_solver()
        #: points at which path limits are held besides stages and mesh points
        self.held: Held = ()
        #: share of its size by which a path limit may be passed between them
        self.limit_tolerance = LIMIT_TOLERANCE
        self.best = BestSoFar() if best is None else best
        values = dict(pairs_of(parameters, "parameters="))
        for free in problem.free_parameters:
            if any(free is key for key in values):
                raise ModelError(f"optimize: parameter '{free.label}' is both given and free")
        #: conditions at the start
        self.initial = problem.phases[0].initial if initial is None else self._other_start(initial)
        first = problem.phases[0]
        read = [
            Setup(phase.mechanism, "optimize", t=0.0, initial=self.initial if phase is first else (), parameters=values)
            for phase in problem.phases
        ]
        numerics = [setup.numeric for setup in read]
        #: values of the free parameters to begin with
        self.free_values = np.array([p.value for p in problem.free_parameters])
        #: first state, as far as the initial conditions decide it
        self.start = self._first_state(numerics, read[0].signals)
        if isinstance(self.initial, State):
            check_start(problem, first, numerics[0], self.initial)
        self.changes: list[ChangeSetup] = []
        if len(problem.phases) == 1:
            path = self._free_path(numerics, read[0].signals) if problem.free_parameters else None
            self.setups = [self._setup(first, numerics[0], path)]
        else:
            self._set_up_phases(numerics)

    def on(self, elsewhere: Elsewhere) -> ProblemSolver:
        """Return the same solver with its runs on an executor; several of these work beside each other."""
        other = copy(self)
        other._nlp_solver = self.settings.make_solver(elsewhere)
        return other

    def _first_state(self, numerics: list[NumericEquations], signals: Signals) -> State:
        """First state; with other values of free parameters, which the equations then have, if it needs them."""
        problem, phase = self.problem, self.problem.phases[0]
        try:
            return first_state(problem, phase, numerics[0], self.initial, signals)
        except ConditionError:
            if isinstance(self.initial, State):
                raise
            poses = free_poses(problem, phase, numerics[0], [PosedPlace(0.0, self.initial)])
            if poses is None:
                raise
        self._take(poses, numerics)
        return first_state(problem, phase, numerics[0], self.initial, signals, poses)

    def _take(self, poses: FreePoses, numerics: list[NumericEquations]) -> None:
        """Take values of the free parameters over into the equations."""
        self.free_values = np.array([poses.values[p] for p in self.problem.free_parameters])
        numerics[:] = [numeric_at(numeric, poses.values) for numeric in numerics]

    def _free_path(self, numerics: list[NumericEquations], signals: Signals) -> KinematicPath:
        """Poses of the only phase; with other values of free parameters if a place is not reached without."""
        problem, phase = self.problem, self.problem.phases[0]
        times = phase.segment_times(typical_duration(phase))

        def path(**how: Any) -> KinematicPath:
            values = dict(zip(problem.free_parameters, self.free_values.tolist(), strict=True))
            return kinematic_path(problem, phase, numerics[0], self.start, times, values=values, **how)

        first = path()
        if first.complete:
            return first
        past = path(through=False)
        near = np.array([past.pose_at(t) for t in times.tolist()])
        poses = free_poses(problem, phase, numerics[0], places_of(phase, self.initial, times), near)
        if poses is None:
            return first
        self._take(poses, numerics)
        if not isinstance(self.initial, State):
            self.start = first_state(problem, phase, numerics[0], self.initial, signals, poses)
        steered = path(poses=dict(enumerate(poses.poses)))
        return steered if steered.complete else path()

    def _set_up_phases(self, numerics: list[NumericEquations]) -> None:
        """Setups of phases that follow each other, with key poses that were assembled together."""
        problem, phases = self.problem, self.problem.phases
        durations = [0.0 if phase.is_instant else typical_duration(phase) for phase in phases]
        ends = np.cumsum(durations)
        spans = list(zip((ends - durations).tolist(), ends.tolist(), strict=True))
        poses = key_poses(problem, numerics, self.start.q, spans)
        self.free_values = poses.parameters
        values = dict(zip(problem.free_parameters, poses.parameters.tolist(), strict=True))
        numerics = [numeric_at(numeric, values) for numeric in numerics]
        moved = largest(poses.starts[0] - self.start.q) > START_MOVED * (1 + largest(self.start.q))
        if moved and not isinstance(self.initial, State):
            s = self.start
            own = (s.v, s.a, s.z, s.lam, s.inputs, numerics[0].p)
            self.start = State(s.mechanism, s.t, poses.starts[0], *own)
        usual = float(np.median([d for d in durations if d > 0]))
        self.setups = []
        for k, (phase, numeric) in enumerate(zip(phases, numerics, strict=True)):
            start = self.start if k == 0 else _at_rest(phase, poses.starts[k], spans[k][0], numeric.p)
            path = self._path_of(phase, numeric, start, spans[k], poses.ends[k])
            initial = self.initial if k == 0 else phase.initial
            time = usual if phase.is_instant else None
            self.setups.append(PhaseSetup(problem, phase, self.settings, numeric, start, initial, path, time))
        for k, (before, after) in enumerate(itertools.pairwise(self.setups)):
            change = ChangeSetup.at(before, after, poses.ends[k], spans[k][1], problem.free_parameters)
            self.changes.append(change)

    def _path_of(
        self, phase: Phase, numeric: NumericEquations, start: State, span: tuple[float, float], end: np.ndarray
    ) -> KinematicPath:
        """Poses of a phase between its key poses."""
        if phase.is_instant:
            return KinematicPath(np.array(span), np.array(span[:1]), end[None, :])
        times = span[0] + phase.segment_times(span[1] - span[0])
        return kinematic_path(self.problem, phase, numeric, start, times, poses={times.size - 1: end})

    def _other_start(self, initial: Any) -> State | tuple[Condition, ...]:
        """A start in place of the problem's own, checked as that is."""
        phase = self.problem.phases[0]
        conditions = read_state_or_conditions(initial, phase.mechanism)
        if not isinstance(conditions, State):
            self.problem.check_symbols(phase, "initial", conditions)
            check_end(self.problem, phase, "initial", conditions)
        return conditions

    def _setup(self, phase: Phase, numeric: NumericEquations, path: KinematicPath | None) -> PhaseSetup:
        """Setup of a phase; starts that are given as states share one."""
        make = partial(PhaseSetup, self.problem, phase, self.settings, numeric, self.start, self.initial, path)
        if not isinstance(self.initial, State):
            return make()
        key = phase, self.settings.key, numeric.p.tobytes()
        return self.problem.compiled.setups.get_or_create(key, make, bounded=True)

    @cached_property
    def path(self) -> KinematicPath:
        """Poses from this start on."""
        setup = self.setups[0]
        if self.start is setup.start or len(self.setups) > 1:
            return setup.path
        return kinematic_path(self.problem, setup.phase, setup.numeric, self.start, setup.path.segment_times)

    # --- one mesh -------------------------------------------------------------------------
    def transcribe(self, meshes: Sequence[Mesh]) -> CollocationProgram:
        """Return the program for a number of intervals, made once and kept."""
        parts = (*(setup.key for setup in self.setups), *(change.key for change in self.changes))
        key = tuple(mesh.structure for mesh in meshes), self.settings.key, parts, self.held
        make = partial(CollocationProgram, self.problem, self.setups, meshes, self.changes, self.held)
        return self.problem.compiled.programs.get_or_create(key, make, bounded=True)

    def solve(self, meshes: Sequence[Mesh], guess: Guess, *, warm: bool = False, limit: int | None = None) -> Solution:
        """Solve on a mesh, and again if the solution passes path limits between the points at which they are held.

        `warm` if the guess is a solution of nearly the same problem; at most `limit` iterations. An
        :class:`OptimizationError` is raised if the solver does not succeed, or the solution lies on another branch of
        the linkage, and ``Interrupted`` after Ctrl-C.
        """
        if guess.iterate is not None:
            self.held = tuple(sorted({*self.held, *guess.iterate.program.held}))
        limit = KINKED_ITERATIONS if limit is None and self._has_kinks else limit
        solution = self._solve(meshes, guess, warm=warm, limit=limit)
        passed = largest_share(solution)
        for _ in range(ROUNDS):
            more = points_to_hold(solution, self.limit_tolerance) if passed > self.limit_tolerance else set()
            if not more:
                break
            before, self.held = self.held, tuple(sorted({*self.held, *more}))
            held = _further(solution, partial(self._solve, solution.meshes, solution.as_guess(self.problem), warm=True))
            share = np.inf if held is None else largest_share(held)
            if held is None or share > 0.8 * passed:  # what is passed is the error of the mesh: more points do not help
                self.held = before
                break
            solution, passed = held, share
        return solution

    @cached_property
    def _has_kinks(self) -> bool:
        """True if a cost has a kink."""
        return bool(kinks_in_costs(self.problem))

    def solve_further(self, solution: Solution, meshes: Sequence[Mesh], guess: Guess | None = None) -> Solution | None:
        """Solve on other meshes, as a new stage, from a guess or from the solution itself; None if that fails."""
        self.best.new_stage()
        near = solution.as_guess(self.problem) if guess is None else guess
        return _further(solution, partial(self.solve, meshes, near, warm=guess is None))

    def _solve(self, meshes: Sequence[Mesh], guess: Guess, *, warm: bool, limit: int | None = None) -> Solution:
        """Solve on a mesh; raises as :meth:`solve` does."""
        begin = self._beginning(meshes, guess)
        program, iterate = begin.program, begin.iterate
        warmth = ("hot" if iterate else "warm") if warm else "cold"
        x0 = np.clip(begin.x, begin.bounds.lower, begin.bounds.upper)
        if warmth == "warm" and program.violation(program.rows_at(x0, begin.data)) > WARM_VIOLATION:
            warmth = "cold"
        result = self._nlp_solver.run(begin, begin.bounds, warmth, iterate, limit)
        solution, status = self._solution(begin, result), result.statistics.status
        error = self._other_branch(solution) if result.succeeded else explain_failure(solution, status)
        if error is None:
            self.best.add(solution)
        else:
            self.best.iterate = solution
        if result.interrupted:
            raise self.best.interrupted()
        if error is not None:
            raise error
        return solution

    # --- limits that yield ------------------------------------------------------------------
    def solve_loosened(
        self, meshes: Sequence[Mesh], guess: Guess, amounts: dict[str, float] | None, limit: int
    ) -> tuple[Solution, dict[str, float], bool]:
        """Solve with limits that may be passed: no solution of the problem, but perhaps a guess for one.

        They may be passed by scaled amounts by label. If `amounts` is left out, by any, and the motion is no faster
        than the guess: a least time without limits has forces without end. Returned are the last iterate, scaled
        amounts by which it passes limits, and whether the solver succeeded.
        """
        begin = self._beginning(meshes, guess)
        sides = LimitSides(begin.program)
        loose = (
            _unhurried(begin, sides.without(begin.bounds)) if amounts is None else sides.loosened(begin.bounds, amounts)
        )
        warmth = "cold" if begin.iterate is None else "warm"
        result = self._nlp_solver.run(begin, loose, warmth, limit=limit)
        solution = self._kept(begin, result)
        x = solution.variables / begin.program.scale
        return solution, sides.excess(begin.bounds, x, solution.answer.rows), result.succeeded

    def least_violation(
        self, meshes: Sequence[Mesh], guess: Guess, limit: int, nearness: float
    ) -> tuple[Solution, dict[str, float], bool]:
        """Look for the motion that violates limits and conditions least; as :meth:`solve_loosened`.

        The square of the distance from the guess, by which one of many such motions is left, has a weight `nearness`.
        """
        begin = self._beginning(meshes, guess)
        elastic = ElasticProgram(begin.program, begin.bounds, nearness)
        result, slacks = self._nlp_solver.least_violation(begin, elastic, limit)
        return self._kept(begin, result), slacks, result.succeeded

    def _kept(self, begin: Beginning, result: Result) -> Solution:
        """The last iterate of a solve whose result is no solution; it is kept for the user who stops."""
        self.best.iterate = solution = self._solution(begin, result)
        if result.interrupted:
            raise self.best.interrupted()
        return solution

    # --- before and after a run -------------------------------------------------------------
    def _beginning(self, meshes: Sequence[Mesh], guess: Guess) -> Beginning:
        began = clock.perf_counter()
        program = self.transcribe(meshes)
        iterate = guess.iterate if guess.iterate is not None and guess.iterate.belongs_to(program, meshes) else None
        x = iterate.x if iterate else guess.variables(program, meshes)
        lower, upper = program.bounds(self.start, meshes, guess.segment_times)
        data = program.data([setup.numeric.p for setup in self.setups], meshes, guess.segment_times)
        if program.has_integrals and not iterate:
            x = program.with_integrals(x, program.rows_at(np.clip(x, lower, upper), data))
        bounds = Bounds(lower, upper, program.lower, np.zeros(program.lower.size))
        return Beginning(program, meshes, guess, iterate, x, data, bounds, began)

    def _solution(self, begin: Beginning, result: Result) -> Solution:
        x, f, *rest = (result.answer[name] for name in ("x", "f", "lam_x", "lam_g", "g"))
        return Solution(
            self.problem,
            begin.program,
            self.settings,
            self.initial,
            [setup.numeric.p for setup in self.setups],
            begin.meshes,
            begin.guess.segment_times,
            x * begin.program.scale,
            float(f[0]) * begin.program.cost_scale,
            result.statistics,
            Answer(*rest),
        )

    def _other_branch(self, solution: Solution) -> OptimizationError | None:
        """The error for an optimum on another branch than the conditions ask for, if it is one."""
        for setup, part in zip(self.setups, solution.phases, strict=True):
            for condition, window in setup.ends.implied.items():
                # a condition at the end may come from a state, and is then none that the user stated
                start = self.initial if setup is self.setups[0] else setup.phase.initial
                at_start = not isinstance(start, State) and condition in start
                place = part.trajectory.initial if at_start else part.trajectory.final
                amount = float(place[condition.expression])
                if abs(amount) > BRANCH_TOLERANCE * window:
                    return OptimizationError(
                        f"the solution misses the condition {condition.label} by {amount:.3g}: it lies on another "
                        "branch of the linkage; another guess, or starts=, may find the right one",
                        partial=solution,
                        time=place.t,
                    )
        return None


def _further(solution: Solution, solve: Callable[[], Solution]) -> Solution | None:
    """What a further solve finds, with the statistics of both; None if it fails."""
    try:
        found = solve()
    except OptimizationError:
        return None
    found.statistics = found.statistics.after(solution.statistics)
    return found


def _unhurried(begin: Beginning, bounds: Bounds) -> Bounds:
    """Bounds in which phases of free duration end no earlier than in the guess."""
    ends = [phase.stated_time_index[-1] for phase in begin.program.phases if phase.time_count]
    lower = bounds.lower.copy()
    lower[ends] = np.clip(begin.x[ends], bounds.lower[ends], bounds.upper[ends])
    return replace(bounds, lower=lower)


def _at_rest(phase: Phase, q: np.ndarray, t: float, p: np.ndarray) -> State:
    """A state at rest, for guesses."""
    eom = phase.equations
    sizes = (eom.v.numel(), eom.a.numel())
    v, a = (np.zeros(size) for size in sizes)
    return State(phase.mechanism, t, q, v, a, eom.estimate[2], np.zeros(eom.lam.numel()), eom.input_values, p)
