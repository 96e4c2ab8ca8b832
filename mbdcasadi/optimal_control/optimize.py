"""Solve an optimal-control problem: transcribe, guess, hand to IPOPT, read the answer."""

from __future__ import annotations

import time as clock
from typing import Any

import numpy as np

from ..analysis.assemble import assemble_at
from ..analysis.inputs import read_signals
from ..analysis.mappings import pairs_of, parameter_vector
from ..equations.numeric import NumericEquations
from ..errors import AssemblyError, ConditionError, Interrupted, ModelError
from ..model.symbols import symbols_of
from ..numerics.console import interruptible, quiet
from ..results.state import State
from ..results.trajectory import Trajectory
from .failure import explain_failure
from .gauss import GaussCollocation
from .guess import first_guess, guess_from, start_of
from .problem import OptimalControlProblem
from .program import MotionProgram
from .refine import refine
from .scaling import scales_of
from .solution import Solution, SolveStatistics, independent_rows

#: Options of IPOPT that were measured best on these programs.
DEFAULTS = {"ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.tol": 1e-8, "ipopt.mumps_permuting_scaling": 0}


def optimize(
    problem: OptimalControlProblem,
    *,
    intervals: int = 40,
    degree: int = 3,
    tolerance: float | None = None,
    guess: Any = None,
    initial: Any = None,
    parameters: Any = None,
    options: dict[str, Any] | None = None,
) -> Solution:
    """Find the motion of least cost by direct collocation.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    intervals : int, default 40
        Intervals of the mesh, of equal length.
    degree : int, default 3
        Stages of an interval; order ``2 degree`` at the mesh points.
    tolerance : float, optional
        Refine the mesh until the local error of every interval is below it.
    guess : Solution or Trajectory, optional
        Where to start, on any mesh; else a kinematic motion by continuation.
    initial : sequence of relations, optional
        Instead of the problem's own; what was compiled is used again.
    parameters : mapping, optional
        Parameter to number.
    options : dict, optional
        Passed on, as ``{"ipopt.max_iter": 500}``.

    Returns
    -------
    Solution
        The optimum.

    Raises
    ------
    OptimizationError
        Where the solver does not succeed: its status in words,
        ``.largest_violations`` with labels, the last iterate in ``.partial``.
    """
    if not isinstance(problem, OptimalControlProblem):
        raise ModelError(f"optimize takes an OptimalControlProblem, got {problem!r}")
    memory = problem.memory
    if initial is not None:
        problem = problem.replace(initial=initial)
    solver = Solver(problem, degree, parameters, options or {})
    if solver.fixed_start:  # a start that is given enters by bounds alone: the programs serve any
        solver.memory = memory
    mesh = np.linspace(0, 1, _count(intervals) + 1)
    solution = solver.solve(mesh, guess)
    return solution if tolerance is None else refine(solver, solution, tolerance)


def _count(intervals: Any) -> int:
    if int(intervals) != intervals or intervals < 2:
        raise ModelError(f"optimize: intervals must be a whole number of at least 2, got {intervals!r}")
    return int(intervals)


class Solver:
    """What stays the same from mesh to mesh: scheme, scales, start, options."""

    def __init__(self, problem: OptimalControlProblem, degree: int, parameters: Any, options: dict[str, Any]):
        if degree not in (1, 2, 3, 4, 5):
            raise ModelError(f"optimize: degree must be 1 to 5, got {degree!r}")
        self.problem = problem
        eom = problem.equations
        given = dict(pairs_of(parameters, "parameters="))
        for free in problem.free_parameters:
            if any(free is key for key in given):
                raise ModelError(f"optimize: parameter '{free.label}' is given and sought")
        self.numeric = NumericEquations(eom, parameter_vector(eom, given))
        self.options = options
        self.memory = problem.memory
        self.start = self._start()
        self.fixed_start = start_of(problem, self.numeric, self.start)
        rows = independent_rows(self.numeric, 0.0, self.start.q)
        self.scheme = GaussCollocation(eom, rows, self.numeric.weights, degree)
        low, high = problem.duration
        self.duration = high if low == high else (low * high) ** 0.5 if low > 0 else high / 2
        self.scales = scales_of(self.numeric, self.duration)

    def _start(self) -> State:
        if isinstance(self.problem.initial, State):
            return self.problem.initial
        eom = self.problem.equations
        rows = [c for c in self.problem.initial if not c.depends_on("acceleration", "multiplier", "input")]
        own = {p.element_hash() for p in self.problem.own_parameters}
        rows = [c for c in rows if not own & {s.element_hash() for s in symbols_of(c.expression)}]
        try:
            return assemble_at(self.numeric, rows, 0.0, read_signals(eom, None))
        except (AssemblyError, ConditionError) as error:
            raise ConditionError(f"the initial conditions cannot be met: {error}") from None

    # --- one mesh ----------------------------------------------------------------------------
    def program(self, count: int) -> tuple[MotionProgram, Any]:
        """Program and solver for a number of intervals, made once and kept."""
        key = (count, self.scheme.degree, self.fixed_start, tuple(sorted(self.options.items())))
        memory = self.memory
        if key not in memory:
            program = MotionProgram(
                self.problem, self.numeric, self.scheme, self.scales, count, fixed_start=self.fixed_start
            )
            settings = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False} | DEFAULTS
            try:
                with quiet():
                    solver = program.program.solver(settings | self.options)
            except RuntimeError as error:
                raise ModelError(f"optimize: the solver refuses the options: {error}") from None
            memory[key] = program, solver
        return memory[key]

    def solve(self, mesh: np.ndarray, guess: Any, warm: bool = False) -> Solution:
        """Solve on a mesh given as shares of the duration."""
        began = clock.perf_counter()
        count = mesh.size - 1
        program, solver = self.program(count)
        x0 = self._guess(program, guess, mesh)
        lower, upper = self._bounds(program)
        equality = self._equalities(program)
        data = np.vstack([mesh[:-1], np.diff(mesh)]).T.ravel()
        p = np.r_[self.numeric.p, data, mesh[1], mesh[-1] - mesh[-2]]
        limits = {"lbg": np.where(equality, 0.0, -np.inf), "ubg": 0.0}
        x0 = np.clip(x0, lower, upper)
        with interruptible() as interruption, quiet():
            found = solver(x0=x0, p=p, lbx=lower, ubx=upper, **limits)
        stats = solver.stats()
        x = found["x"].full().ravel()
        statistics = SolveStatistics(
            int(stats["iter_count"]), str(stats["return_status"]), clock.perf_counter() - began, x.size, equality.size
        )
        solution = Solution(program, self.problem, self.numeric, x, mesh, float(found["f"]), statistics)
        if interruption.requested:
            raise Interrupted("stopped by the user; the last iterate is in .partial", partial=solution)
        if not stats["success"]:
            raise explain_failure(
                solution, program, mesh, found["g"].full().ravel(), equality, str(stats["return_status"])
            )
        return solution

    def _guess(self, program: MotionProgram, guess: Any, mesh: np.ndarray) -> np.ndarray:
        if guess is None:
            return first_guess(program, self.start, self.duration, mesh)
        if isinstance(guess, Solution):
            low, high = self.problem.duration
            x = guess_from(program, guess.trajectory, float(np.clip(guess.duration, low, high)), mesh)
            for k, free in enumerate(self.problem.free_parameters):
                if free in guess.parameters:
                    x[program.global_index[1 + k]] = guess.parameters[free] / program.global_scale[1 + k]
            return x
        if isinstance(guess, Trajectory):
            return guess_from(program, guess, float(np.clip(guess.t[-1] - guess.t[0], *self.problem.duration)), mesh)
        raise ModelError(f"optimize: guess= takes a Solution or a Trajectory, got {guess!r}")

    def _bounds(self, program: MotionProgram) -> tuple[np.ndarray, np.ndarray]:
        lower = np.full(program.size, -np.inf)
        upper = np.full(program.size, np.inf)
        first = program.node_index(0)
        if self.fixed_start:
            state = np.r_[self.start.q, self.start.v, self.start.z]
            lower[first[: state.size]] = upper[first[: state.size]] = state / program.node_scale[: state.size]
        lower[first[program.scheme.node_size :]] = upper[first[program.scheme.node_size :]] = 0.0
        spans = [self.problem.duration, *[(p.lower, p.upper) for p in self.problem.free_parameters]]
        for place, (low, high), size in zip(program.global_index, spans, program.global_scale, strict=True):
            lower[place], upper[place] = low / size, high / size
        return lower, upper

    @staticmethod
    def _equalities(program: MotionProgram) -> np.ndarray:
        """Which rows are equalities."""
        one = [np.full(g.expression.numel(), g.equality) for g in program.interval_groups]
        ends = [np.full(g.expression.numel(), g.equality) for g in program.end_groups]
        return np.concatenate([np.tile(np.concatenate(one), program.count), *ends]).astype(bool)
