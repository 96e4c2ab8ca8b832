"""What stays the same from mesh to mesh: scheme, scales, start, options; and one solve."""

from __future__ import annotations

import time as clock
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..analysis.assemble import assemble_at
from ..analysis.inputs import read_signals
from ..analysis.mappings import pairs_of, parameter_vector
from ..equations.numeric import LARGE, NumericEquations
from ..errors import AssemblyError, ConditionError, Interrupted, ModelError
from ..model.conditions import Condition
from ..model.symbols import symbols_of, time_derivative
from ..numerics.console import interruptible, quiet
from ..numerics.rank import dependent_rows
from ..results.state import State
from ..results.trajectory import Trajectory
from .consistency import ConditionRank, on_states
from .constraints import MotionConstraints, prescribes_motion
from .controls import input_basis
from .failure import explain_failure
from .gauss import GaussLegendre
from .guess import Guess, guess_from_motion, guess_from_other, kinematic_guess, nominal_marks
from .hermite_simpson import HermiteSimpson
from .mesh import Mesh
from .monitor import Monitor
from .poses import kinematic_poses
from .problem import OptimalControlProblem
from .program import MotionProgram
from .scaling import scales_of
from .solution import Solution, SolveStatistics
from .transcription import Transcription

#: Options of IPOPT that were measured best on these programs.
DEFAULTS = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_pivot_order": 0,
}
#: Further ones where the guess is a solution of nearly the same problem.
WARM = {"ipopt.mu_init": 1e-4}
#: What ``transcription=`` may say.
TRANSCRIPTIONS = (GaussLegendre.name, HermiteSimpson.name)


@dataclass(frozen=True)
class Settings:
    """What a user chose for a solve."""

    transcription: str
    degree: int
    control: str
    options: dict[str, Any]
    progress: bool

    @property
    def plain(self) -> dict[str, Any]:
        """What decides the program, as a file holds it."""
        return {"transcription": self.transcription, "degree": self.degree, "control": self.control}

    @property
    def option_key(self) -> tuple:
        """What tells compiled solvers of one program apart."""
        return tuple(sorted((k, repr(v)) for k, v in self.options.items()))


class Solver:
    """A problem with everything that its solves on different meshes have in common.

    Parameters
    ----------
    problem : OptimalControlProblem
        What to solve.
    settings : Settings
        How.
    parameters : mapping, optional
        Parameter to number.
    """

    def __init__(self, problem: OptimalControlProblem, settings: Settings, parameters: Any):
        self.problem, self.settings = problem, settings
        eom = problem.equations
        given = dict(pairs_of(parameters, "parameters="))
        for free in problem.free_parameters:
            if any(free is key for key in given):
                raise ModelError(f"optimize: parameter '{free.label}' is given and sought")
        self.numeric = NumericEquations(eom, parameter_vector(eom, given))
        self.start = self._start()
        low, high = problem.duration
        self.marks = nominal_marks(problem, high if low == high else (low * high) ** 0.5 if low > 0 else high / 2)
        self.times, self.poses = kinematic_poses(problem, self.numeric, self.start, self.marks)
        self.initial, self.final = self._ends()
        self.scales = scales_of(self.numeric, float(self.marks[-1]), self.poses)
        self.scheme = self._scheme()

    # --- preparations -------------------------------------------------------------------------
    def _start(self) -> State:
        """State at the start, as far as the initial conditions decide it."""
        problem = self.problem
        if isinstance(problem.initial, State):
            return problem.initial
        own = {p.element_hash() for p in problem.own_parameters}
        rows = on_states(problem.initial)
        rows = [c for c in rows if not own & {s.element_hash() for s in symbols_of(c.expression)}]
        try:
            return assemble_at(self.numeric, rows, 0.0, read_signals(problem.equations, None))
        except (AssemblyError, ConditionError) as error:
            raise ConditionError(f"the initial conditions cannot be met: {error}") from None

    def _ends(self) -> tuple[list[Condition] | None, list[Condition]]:
        """Independent conditions at both ends; None at the start where it is given as a whole."""
        problem, numeric = self.problem, self.numeric
        eom = numeric.eom
        final = _as_conditions(problem, problem.final)
        if eom.q.numel() * eom.lam.numel() > LARGE and not isinstance(problem.final, State):
            initial = None if isinstance(problem.initial, State) else list(problem.initial)
            return initial, final
        free = ca.vertcat(ca.SX(0, 1), *problem.free_parameters)
        at_end = ConditionRank(numeric, ca.vertcat(free, *([eom.t] if problem.has_free_times else [])))
        end = problem.final if isinstance(problem.final, State) else None
        t = float(self.marks[-1])
        state = (t, end.q, end.v, end.z) if end else (t, self.poses[-1], np.zeros(eom.q.numel()), self.start.z)
        rows = [c for c in on_states(final) if c.equality]
        kept = at_end.independent(rows, state)
        final = [c for c in final if c in kept or c not in rows]
        if isinstance(problem.initial, State):
            return None, final
        ranks = ConditionRank(numeric, free)
        rows = [c for c in on_states(problem.initial) if c.equality]
        begin = (0.0, self.start.q, self.start.v, self.start.z)
        kept = ranks.independent(rows, begin)
        others = [c for c in problem.initial if c not in rows]
        unknowns = 2 * eom.q.numel() + eom.z.numel()
        moving = {s.element_hash() for s in ca.vertsplit(free)}
        fixed = ca.vertcat(eom.Phi, eom.nu, *[c.expression for c in kept])
        if not others and not moving & {s.element_hash() for s in symbols_of(fixed)}:
            jacobian = np.vstack([ranks.constraints_span(begin), ranks.gradients(_stacked(kept), begin)])
            if np.linalg.matrix_rank(jacobian[:, :unknowns], tol=1e-9) == unknowns:
                return None, final
        return [*kept, *others], final

    def _scheme(self) -> Transcription:
        settings, problem = self.settings, self.problem
        own = {p.element_hash() for p in problem.free_parameters}
        held = [
            c
            for c in problem.path
            if prescribes_motion(c) and not own & {s.element_hash() for s in symbols_of(c.expression)}
        ]
        constraints = MotionConstraints(self.numeric, self._independent_rows(), held)
        self._check_start(held)
        weights, rates = self.numeric.weights, problem.has_input_rates
        if settings.transcription == GaussLegendre.name:
            inner, joined = GaussLegendre.input_points(settings.degree)
            basis = input_basis(settings.control, inner, joined, rates=rates)
            return GaussLegendre(constraints, weights, basis, settings.degree)
        inner, joined = HermiteSimpson.input_points()
        return HermiteSimpson(constraints, weights, input_basis(settings.control, inner, joined, rates=rates))

    def _check_start(self, held: list[Condition]) -> None:
        """Refuse a start off the motion that path conditions prescribe."""
        for condition in held if self.initial is None else ():
            levels = [condition.expression]
            if not condition.depends_on("velocity"):
                levels.append(time_derivative(condition.expression))
            for level, what in zip(levels, ("", "the rate of "), strict=False):
                amount = float(self.start[level])
                if abs(amount) > 1e-6:
                    raise ConditionError(
                        f"the initial state does not meet {what}the path condition {condition.label}: "
                        f"it is off by {amount:.3g}"
                    )

    def _independent_rows(self) -> list[int]:
        """Constraint rows without those that others imply; of the poses passed the one with the most counts."""
        found: list[int] = []
        for q in (self.poses[0], self.poses[len(self.poses) // 2], self.poses[-1]):
            jacobian = self.numeric.velocity(0.0, q)[0] * self.numeric.column_scale
            size = np.linalg.norm(jacobian, axis=1, keepdims=True)
            dependent = set(dependent_rows(jacobian / np.where(size > 1e-12, size, 1.0)))
            rows = [k for k in range(jacobian.shape[0]) if k not in dependent]
            found = rows if len(rows) > len(found) else found
        return found

    # --- one mesh ----------------------------------------------------------------------------
    def _key(self, mesh: Mesh) -> tuple:
        initial = None if self.initial is None else tuple(self.initial)
        return mesh.counts, tuple(self.settings.plain.values()), initial, tuple(self.scheme.rows)

    def layout(self, mesh: Mesh) -> MotionProgram:
        """Program for a number of intervals, made once and kept."""
        memory, key = self.problem.memory, self._key(mesh)
        if key not in memory:
            memory[key] = MotionProgram(
                self.problem, self.numeric, self.scheme, self.scales, mesh, self.initial, self.final
            )
        return memory[key]

    def program(self, mesh: Mesh, *, warm: bool) -> tuple[MotionProgram, ca.Function, Monitor]:
        """Program and compiled solver for a number of intervals, made once and kept."""
        program, memory = self.layout(mesh), self.problem.memory
        key = (self._key(mesh), warm, self.settings.option_key)
        if key not in memory:
            memory[key] = self._compiled(program, WARM if warm else {})
        return program, *memory[key]

    def _compiled(self, program: MotionProgram, more: dict[str, Any]) -> tuple[ca.Function, Monitor]:
        monitor = Monitor(program.size, program.equalities, program.cost_scale).finish(program.program.data_size)
        settings: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
        settings |= DEFAULTS | more | {"iteration_callback": monitor}
        try:
            with quiet():
                return program.program.solver(settings | self.settings.options), monitor
        except RuntimeError as error:
            raise ModelError(f"optimize: the solver refuses the options: {error}") from None

    def solve(self, mesh: Mesh, guess: Guess, *, warm: bool = False) -> Solution:
        """Solve on a mesh."""
        began = clock.perf_counter()
        program, solver, monitor = self.program(mesh, warm=warm)
        built = clock.perf_counter()
        lower, upper = self.bounds(program)
        x0 = np.clip(guess.variables(program, mesh), lower, upper)
        p = program.data(self.numeric, mesh, guess.marks)
        limits = {"lbg": np.where(program.equalities, 0.0, -np.inf), "ubg": 0.0}
        with interruptible(raising=False) as interruption, quiet():
            monitor.watch(interruption, self.settings.progress)
            try:
                found = solver(x0=x0, p=p, lbx=lower, ubx=upper, **limits)
            finally:
                monitor.close()
        stats = solver.stats()
        statistics = SolveStatistics(
            int(stats["iter_count"]),
            str(stats["return_status"]),
            clock.perf_counter() - began,
            built - began,
            program.size,
            program.equalities.size,
        )
        solution = self._solution(program, mesh, guess.marks, found, statistics)
        if interruption.requested:
            raise Interrupted("stopped by the user; the last iterate is in .partial", partial=solution)
        if not stats["success"]:
            raise explain_failure(solution, found["g"].full().ravel(), str(stats["return_status"]))
        return solution

    def _solution(
        self, program: MotionProgram, mesh: Mesh, marks: np.ndarray, found: dict, statistics: SolveStatistics
    ) -> Solution:
        x, lam_x, lam_g = (found[name].full().ravel() for name in ("x", "lam_x", "lam_g"))
        cost = float(found["f"]) * program.cost_scale
        return Solution(
            self.problem,
            program,
            self.settings.plain,
            self.numeric,
            mesh,
            x * program.scale,
            marks,
            cost,
            statistics,
            (lam_x, lam_g),
        )

    def bounds(self, program: MotionProgram) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the variables, scaled."""
        problem, scheme = self.problem, program.scheme
        inputs, states = problem.mechanism.inputs, problem.mechanism.states
        n = problem.equations.q.numel()
        bounds = []
        for side, infinite in (("lower", -np.inf), ("upper", np.inf)):
            u, z = ([getattr(x, side) for x in symbols] for symbols in (inputs, states))
            node = np.r_[np.full(2 * n, infinite), z, u if scheme.inputs.joined else []]
            node = np.r_[node, np.full(program.node_size - node.size, infinite)]
            block = np.full(scheme.block_size, infinite)
            block[scheme.block_slice("u")] = np.tile(u, len(scheme.inputs.inner))
            times = [(0.0, 0.0), *[w.time for w in problem.waypoints], problem.duration][: program.mark_count]
            free = [getattr(p, side) for p in problem.free_parameters]
            ends = [span[0 if side == "lower" else 1] for span in times]
            values = np.r_[np.tile(np.r_[node, block], program.count), node, ends, free]
            bounds.append(values / program.scale)
        first = program.node_index(0)
        if self.initial is None:
            state = np.r_[self.start.q, self.start.v, self.start.z]
            for side in bounds:
                side[first[: state.size]] = state / program.node_scale[: state.size]
        for side in bounds:
            side[first[scheme.node_size :]] = 0.0
        return bounds[0], bounds[1]

    # --- guesses --------------------------------------------------------------------------------
    def guess(self, given: Any) -> Guess:
        """A guess from what the user gave: nothing, a solution, or a trajectory."""
        if given is None:
            return kinematic_guess(self.problem, self.numeric, self.start, self.marks, self.times, self.poses)
        if isinstance(given, Solution):
            return given.as_guess(self.problem)
        if isinstance(given, Trajectory):
            low, high = self.problem.duration
            duration = float(np.clip(given.t[-1] - given.t[0], low, high))
            marks = nominal_marks(self.problem, duration)
            if given.mechanism is self.problem.mechanism and not given._missing_multipliers:
                return guess_from_motion(self.problem, given, marks)
            return guess_from_other(self.problem, self.numeric, given, marks)
        raise ModelError(f"optimize: guess= takes a Solution or a Trajectory, got {given!r}")


def _as_conditions(problem: OptimalControlProblem, end: State | tuple[Condition, ...]) -> list[Condition]:
    """Conditions at an end; those that a state sets, by coordinate."""
    if not isinstance(end, State):
        return list(end)
    eom = problem.equations
    symbols, values = ca.vertsplit(ca.vertcat(eom.q, eom.v, eom.z)), np.r_[end.q, end.v, end.z]
    return [
        Condition(symbol - float(value), True, f"{symbol.name()} == {value:.6g}")
        for symbol, value in zip(symbols, values, strict=True)
    ]


def _stacked(conditions: list[Condition]) -> ca.SX:
    return ca.vertcat(ca.SX(0, 1), *[c.expression for c in conditions])
