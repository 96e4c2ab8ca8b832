"""One problem, one mesh, one solve: program, guess, IPOPT, answer."""

from __future__ import annotations

import time as clock
import warnings
from dataclasses import replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from ...arguments.values import pairs_of, parameter_vector
from ...equations.numeric import NumericEquations
from ...errors import Interrupted, MechanismError, MechanismWarning, ModelError
from ...numerics.console import interruptible, quiet
from ...results.state import State
from ...results.trajectory import Trajectory
from ...simulation.simulate import simulate
from ..checks.failure import OptimizationError, explain_failure
from ..guess.guess import Guess, guess_from_motion, guess_from_other, kinematic_guess
from ..guess.kinematic_guess import STEPS, goes_nowhere, kinematic_poses, nominal_marks
from ..guess.least_squares_loads import Balance
from ..preparation import Preparation, Settings, first_state
from ..problem import OptimalControlProblem
from ..refinement.mesh import Mesh
from ..solution import Shifted, Solution
from ..solve_statistics import Answer, SolveStatistics
from .motion_program import MotionProgram
from .solver_callback import Monitor

#: Options of IPOPT that were measured best on these programs.
DEFAULTS = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-8,
    "ipopt.constr_viol_tol": 1e-11,
    "ipopt.acceptable_tol": 1e-7,
    "ipopt.acceptable_constr_viol_tol": 1e-9,
    "ipopt.acceptable_dual_inf_tol": 1e-5,
    "ipopt.max_iter": 1000,
    "ipopt.mumps_permuting_scaling": 0,
    "ipopt.mumps_pivot_order": 0,
    "ipopt.mu_strategy": "adaptive",
    # progress by the residual of the optimality conditions, and no barrier above the scale of the program: of the
    # programs of the examples some needed half the iterations, and none failed by rounding of its data any more
    "ipopt.adaptive_mu_globalization": "kkt-error",
    "ipopt.mu_max": 1.0,
    "ipopt.honor_original_bounds": "yes",
}
#: Further ones where the guess is a solution of nearly the same problem, on another mesh or on the same one.
WARMTH: dict[str, dict[str, Any]] = {
    "cold": {},
    "warm": {"ipopt.mu_init": 1e-4, "ipopt.max_iter": 300},
    "hot": {
        "ipopt.mu_init": 1e-6,
        "ipopt.max_iter": 60,
        "ipopt.warm_start_init_point": "yes",
        "ipopt.warm_start_bound_push": 1e-8,
        "ipopt.warm_start_mult_bound_push": 1e-8,
        "ipopt.warm_start_slack_bound_push": 1e-8,
    },
}
#: Miss of an implied condition that counts, as a share of the window that is left to it.
MISSED = 1e-3
#: Largest scaled violation of a guess from which a solver is started as warm.
NEAR = 1e-2


class Solver:
    """A problem with its parameters and its start, ready to be solved on meshes.

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
        self.start = first_state(problem, self.numeric)
        self.prepared = self._prepared()
        self.prepared.check_start(self.start)

    def _prepared(self) -> Preparation:
        """Preparation; starts that are given as states share one."""
        if not isinstance(self.problem.initial, State):
            return Preparation(self.problem, self.settings, self.numeric, self.start)
        key = "preparation", tuple(self.settings.plain.values()), self.numeric.p.tobytes()
        return self.problem.cache.get_or_create(
            key, lambda: Preparation(self.problem, self.settings, self.numeric, self.start)
        )

    @cached_property
    def balance(self) -> Balance:
        """Loads and inputs for guesses."""
        return Balance(self.numeric, self.prepared.scheme.eom, self.prepared.scales)

    @cached_property
    def way(self) -> tuple[np.ndarray, np.ndarray]:
        """Times and poses from this start on."""
        if self.start is self.prepared.start:
            return self.prepared.times, self.prepared.poses
        return kinematic_poses(self.problem, self.numeric, self.start, self.prepared.marks)

    # --- one mesh ----------------------------------------------------------------------------
    def _key(self, mesh: Mesh) -> tuple:
        initial = None if self.prepared.initial is None else tuple(self.prepared.initial)
        scheme = self.prepared.scheme
        rows = tuple(scheme.eom.independent), tuple(scheme.rows)
        return mesh.counts, tuple(self.settings.plain.values()), initial, *rows

    def layout(self, mesh: Mesh) -> MotionProgram:
        """Program for a number of intervals, made once and kept."""
        return self.problem.cache.get_or_create(self._key(mesh), lambda: MotionProgram(self.prepared, mesh))

    def compiled(self, program: MotionProgram, mesh: Mesh, warmth: str) -> tuple[ca.Function, Monitor]:
        """Solver of a program, made once and kept."""
        key = self._key(mesh), warmth, self.settings.option_key
        return self.problem.cache.get_or_create(key, lambda: self._compiled(program, WARMTH[warmth]))

    def _compiled(self, program: MotionProgram, more: dict[str, Any]) -> tuple[ca.Function, Monitor]:
        monitor = Monitor(program.size, program.lower, program.cost_scale, program.program.data_size)
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
        program = self.layout(mesh)
        known = guess.iterate if guess.iterate is not None and guess.iterate.belongs_to(program, mesh) else None
        lower, upper = self.bounds(program)
        x0 = np.clip(known.x if known else guess.variables(program, mesh), lower, upper)
        p = program.data(self.numeric, mesh, guess.marks)
        solver, monitor = self.compiled(program, mesh, ("hot" if known else "warm") if warm else "cold")
        rows = solver.get_function("nlp_g")
        if program.integrals and not known:
            x0 = program.with_integrals(x0, rows(x0, p).full().ravel())
        if warm and not known and program.violation(rows(x0, p).full().ravel()) > NEAR:
            solver, monitor = self.compiled(program, mesh, "cold")
        built = clock.perf_counter()
        multipliers = {"lam_x0": known.lam_x, "lam_g0": known.lam_g} if known else {}
        limits = {"lbg": program.lower, "ubg": 0.0}
        with interruptible(raising=False) as interruption, monitor.watching(interruption, self.settings.progress):
            with quiet():
                found = solver(x0=x0, p=p, lbx=lower, ubx=upper, **limits, **multipliers)
        # IPOPT relaxes bounds by the last digits; a mass must not become negative
        found["x"] = np.clip(found["x"].full().ravel(), lower, upper)
        stats = solver.stats()
        statistics = SolveStatistics(
            max(int(stats["iter_count"]), 0),  # CasADi leaves the count open where IPOPT refuses to begin
            str(stats["return_status"]),
            clock.perf_counter() - began,
            built - began,
            program.size,
            program.lower.size,
        )
        solution = self._solution(program, mesh, guess.marks, found, statistics)
        if interruption.requested:
            raise Interrupted("stopped by the user; the last iterate is in .partial", partial=solution)
        if not stats["success"]:
            raise explain_failure(solution, str(stats["return_status"]))
        self._check_implied(solution)
        return solution

    def _check_implied(self, solution: Solution) -> None:
        """Refuse an optimum on another branch than the conditions ask for.

        Raises
        ------
        OptimizationError
            Naming the condition that is missed.
        """
        for condition, window in self.prepared.implied.items():
            ends = [solution.trajectory.initial, solution.trajectory.final]
            place = ends[int(condition in self.problem.final) if not isinstance(self.problem.final, State) else 1]
            amount = float(place[condition.expression])
            if abs(amount) > MISSED * window:
                raise OptimizationError(
                    f"the solution misses the condition {condition.label} by {amount:.3g}: it lies on another branch "
                    "of the linkage; another guess, or starts=, may find the right one",
                    largest_violations=[],
                    partial=solution,
                    time=place.t,
                )

    def _solution(
        self, program: MotionProgram, mesh: Mesh, marks: np.ndarray, found: dict, statistics: SolveStatistics
    ) -> Solution:
        x, *answer = (np.array(found[name]).ravel() for name in ("x", "lam_x", "lam_g", "g"))
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
            Answer(*answer),
        )

    def bounds(self, program: MotionProgram) -> tuple[np.ndarray, np.ndarray]:
        """Limits of the variables, scaled."""
        problem, scheme = self.problem, program.scheme
        inputs, states = problem.mechanism.inputs, problem.mechanism.states
        n = scheme.eom.q.numel()
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
        if self.prepared.initial is None:
            start, own = self.start, scheme.eom.independent
            state = np.r_[start.q[own], start.v[own], start.z]
            for side in bounds:
                side[first[: state.size]] = state / program.node_scale[: state.size]
        for side in bounds:
            side[first[scheme.node_size :]] = 0.0
        return bounds[0], bounds[1]

    def _coasting(self) -> Trajectory | None:
        """The motion from the start with the inputs' own values; None where it cannot be simulated."""
        p = dict(zip(self.problem.mechanism.parameters, self.numeric.p, strict=True))
        times = np.linspace(0, self.prepared.marks[-1], STEPS + 1)
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", MechanismWarning)
                return simulate(self.problem.mechanism, times, initial=self.start, parameters=p)
        except MechanismError:  # a guess through poses does as well
            return None

    # --- guesses --------------------------------------------------------------------------------
    def guess(self, given: Any) -> Guess:
        """A guess from what the user gave: nothing, a solution, or a trajectory."""
        if given is None:
            coasting = self._coasting() if goes_nowhere(self.problem) and np.any(self.start.v) else None
            if coasting is not None:
                return replace(guess_from_motion(self.problem, coasting, self.prepared.marks), word="free motion")
            return kinematic_guess(self.problem, self.balance, self.start, self.prepared.marks, *self.way)
        if isinstance(given, Solution):
            if given.problem.mechanism is not self.problem.mechanism:
                return self.guess(given.trajectory)
            return given.as_guess(self.problem)
        if isinstance(given, Shifted):
            return given.as_guess(self.problem)
        if isinstance(given, Trajectory):
            low, high = self.problem.duration
            duration = float(np.clip(given.t[-1] - given.t[0], low, high))
            marks = nominal_marks(self.problem, duration)
            if given.mechanism is self.problem.mechanism and not given._missing_multipliers:
                return guess_from_motion(self.problem, given, marks)
            return guess_from_other(self.problem, self.balance, given, marks)
        raise ModelError(f"optimize: guess= takes a Solution or a Trajectory, got {given!r}")
