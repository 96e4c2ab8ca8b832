"""Runs of IPOPT: its options, a start, and its answer; here or on an executor."""

from __future__ import annotations

import time as clock
from collections.abc import Callable, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from functools import partial
from typing import Any, ClassVar, TypeVar

import casadi as ca
import numpy as np

from ...errors import MechanismError, ModelError
from ...numerics.console import interruptible, quiet
from ...numerics.packed import Packed
from ...numerics.symbolic import LOCK, numeric_work
from ..guess.guess import Guess, Iterate
from ..refinement.mesh import Mesh
from .collocation_program import CollocationProgram
from .elastic_program import ElasticProgram
from .limit_sides import Bounds
from .setup import Settings
from .solver_callback import SolverCallback, SolverWatch
from .statistics import SolveStatistics

Made = TypeVar("Made")

#: Options of CasADi for solvers whose failures are reported by their status.
QUIET: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}
#: Residual of the conditions of an optimum, scaled, at which IPOPT ends.
TOLERANCE = 1e-8
#: Options of IPOPT that were measured best on these programs.
DEFAULTS = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": TOLERANCE,
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
#: Further ones for several phases: no step without centring, since the first one of a gait led next to its limits,
#: where later ones were short; and limits as sharp at the end as without it.
SEVERAL_PHASES = {"ipopt.sigma_min": 1e-2, "ipopt.compl_inf_tol": 1e-10}
#: Further ones for a guess that is a solution of nearly the same problem, on another mesh or on the same one.
WARM_START: dict[str, dict[str, Any]] = {
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
#: Tightest tolerance of IPOPT, below which steps are rounding, and the range of the products of multiplier and slack at
#: which limits count as met.
SHARPEST, SLACKS = 1e-10, (1e-13, 1e-10)


def sharp_options(tolerance: float) -> dict[str, float]:
    """Return options by which inputs and limits are found to a tolerance, as a share of their sizes.

    A small residual of the conditions of an optimum, each of the weight of a stage in the cost, is a far larger error
    of the inputs. An input that holds a position at its limit is off by the second derivative of the slack.
    """
    slack = float(np.clip(1e-6 * tolerance, *SLACKS))
    return {
        "ipopt.tol": float(np.clip(1e-3 * tolerance, SHARPEST, TOLERANCE)),
        "ipopt.compl_inf_tol": slack,
        "ipopt.mu_min": slack / 10,
        "ipopt.bound_relax_factor": slack,
    }


@dataclass(frozen=True)
class Beginning:
    """Start of a solve on a mesh.

    Attributes
    ----------
    program : CollocationProgram
        The program.
    meshes : sequence of Mesh
        Meshes by phase.
    guess : Guess
        Guess from which the variables come.
    iterate : Iterate or None
        The guess with its multipliers, if it belongs to the same program and mesh.
    x, data : numpy.ndarray
        Scaled variables, and data of the program.
    bounds : Bounds
        Bounds of variables and rows.
    began : float
        Reading of the clock at the start, s.
    """

    program: CollocationProgram
    meshes: Sequence[Mesh]
    guess: Guess
    iterate: Iterate | None
    x: np.ndarray
    data: np.ndarray
    bounds: Bounds
    began: float


@dataclass(frozen=True)
class Result:
    """Last iterate of a run.

    Attributes
    ----------
    answer : dict
        Arrays by the names of CasADi: ``x, f, g, lam_x, lam_g``, scaled.
    statistics : SolveStatistics
        Iterations, status and times.
    succeeded : bool
        True if it is an optimum.
    interrupted : bool
        True if the user stopped the run.
    """

    answer: dict[str, np.ndarray]
    statistics: SolveStatistics
    succeeded: bool
    interrupted: bool


class Elsewhere:
    """An executor on which IPOPT runs.

    Parameters
    ----------
    executor : concurrent.futures.Executor
        Threads or processes.
    """

    def __init__(self, executor: Executor):
        self._executor = executor
        #: is done when nobody waits for a run any more
        self._stop: Future = Future()

    def give_up(self) -> None:
        """Wait for no run any more."""
        with LOCK:
            if not self._stop.done():
                self._stop.set_result(None)

    def run(self, solver: Packed, arguments: dict[str, Any]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Return answer and statistics of a run."""
        try:
            run = self._executor.submit(run_packed, solver, arguments)
            wait([run, self._stop], return_when=FIRST_COMPLETED)
            if self._stop.done():
                run.cancel()
                raise KeyboardInterrupt
            return run.result()
        except BrokenExecutor as error:
            raise MechanismError(f"optimize: a worker of the executor was lost ({error})") from None


class Ipopt:
    """IPOPT with the options of the user, which prevail.

    Parameters
    ----------
    settings : Settings
        Choices of the user.
    elsewhere : Elsewhere, optional
        Executor on which programs are solved.
    """

    name = "ipopt"
    #: options by the quality of the guess
    by_warmth: ClassVar[dict[str, dict[str, Any]]] = {warmth: DEFAULTS | more for warmth, more in WARM_START.items()}

    def __init__(self, settings: Settings, elsewhere: Elsewhere | None = None):
        self.settings, self.elsewhere = settings, elsewhere
        self._own = settings.options_of(self.name)

    def run(
        self, begin: Beginning, bounds: Bounds, warmth: str, iterate: Iterate | None, options: dict[str, Any]
    ) -> Result:
        """Solve a program between bounds, from the multipliers of an iterate if there is one.

        Parameters
        ----------
        begin : Beginning
            Program, variables and data.
        bounds : Bounds
            Bounds of variables and rows.
        warmth : {"cold", "warm", "hot"}
            Options for the quality of the guess.
        iterate : Iterate, optional
            Has the multipliers.
        options : dict
            Further options of IPOPT.
        """
        arguments: dict[str, Any] = {
            "x0": np.clip(begin.x, bounds.lower, bounds.upper), "p": begin.data,
            "lbx": bounds.lower, "ubx": bounds.upper, "lbg": bounds.rows_lower, "ubg": bounds.rows_upper,
        }  # fmt: skip
        arguments |= {"lam_x0": iterate.lam_x, "lam_g0": iterate.lam_g} if iterate else {}
        result = self._solve(begin, warmth, options, arguments)
        # IPOPT relaxes bounds by the last digits; a mass must not become negative
        result.answer["x"] = np.clip(result.answer["x"], bounds.lower, bounds.upper)
        return result

    def run_elastic(self, begin: Beginning, limit: int) -> tuple[Result, dict[str, float]]:
        """Minimise the violations of a program near a start.

        Returns
        -------
        Result, dict of str to float
            The last iterate with the cost of the program itself and no multipliers, and scaled violations by label.
        """
        program = begin.program
        elastic = ElasticProgram(program, begin.bounds)
        arguments = elastic.arguments(begin.x, begin.data, rows_at(program, begin.x, begin.data))
        callback = SolverCallback(elastic.size, arguments["lbg"], 1.0, arguments["p"].size)
        with quiet():
            run_options = {"iteration_callback": callback, "ipopt.max_iter": limit}
            solver = elastic.solver(QUIET | DEFAULTS | run_options | self.settings.options_of(Ipopt.name))
        result = self._call(begin, solver, callback, arguments)
        x, slacks = elastic.split(result.answer["x"])
        x = np.clip(x, *elastic.limits)
        rows = rows_at(program, x, begin.data)
        cost = np.array(program.nlp.evaluate(x, begin.data)[0]).ravel()
        answer = {"lam_x": np.zeros(x.size), "lam_g": np.zeros(rows.size), "x": x, "g": rows, "f": cost}
        return Result(answer, result.statistics, result.succeeded, result.interrupted), slacks

    def make(self, program: CollocationProgram, options: dict[str, Any]) -> ca.Function:
        """Return the solver of a program without callback, which can travel."""
        return program.nlp.solver(QUIET | (SEVERAL_PHASES if program.changes else {}) | options)

    def make_watched(self, program: CollocationProgram, options: dict[str, Any]) -> tuple[ca.Function, SolverWatch]:
        """Return the solver of a program and its callback; options of the user prevail."""
        callback = SolverCallback(program.size, program.lower, program.cost_scale, program.nlp.data_size)
        return self.make(program, {"iteration_callback": callback} | options), callback

    def _solve(self, begin: Beginning, warmth: str, more: dict[str, Any], arguments: dict[str, Any]) -> Result:
        """Solve here or on the executor, by a function that is made once."""
        options = self.by_warmth[warmth] | more | self._own
        key = self.name, warmth, *sorted((name, repr(value)) for name, value in (more | self._own).items())
        if self.elsewhere is not None:
            packed = begin.program.packed.get_or_create(
                key, lambda: Packed(_checked(self.make, begin.program, options)), bounded=True
            )
            built = clock.perf_counter()
            with numeric_work():
                answer, stats = self.elsewhere.run(packed, arguments)
            return self._result(begin, built, answer, stats, interrupted=False)
        with begin.program.solvers.lent(key, partial(_checked, self.make_watched, begin.program, options)) as lent:
            return self._call(begin, *lent, arguments)

    def _call(self, begin: Beginning, solver: ca.Function, callback: SolverWatch, arguments: dict[str, Any]) -> Result:
        built = clock.perf_counter()
        with interruptible(raising=False) as interruption:
            with callback.watching(interruption, self.settings.progress), quiet(), numeric_work():
                answer = _answer(solver, arguments)
            stats = solver.stats()
        return self._result(begin, built, answer, stats, interruption.requested)

    def _result(
        self, begin: Beginning, built: float, answer: dict[str, Any], stats: dict[str, Any], interrupted: bool
    ) -> Result:
        """Result of a run from its answer as arrays, and its statistics in CasADi."""
        seconds = clock.perf_counter() - begin.began
        # CasADi leaves the count open if IPOPT refuses to begin
        iterations, status = max(int(stats["iter_count"]), 0), str(stats["return_status"])
        sizes = begin.program.size, begin.program.lower.size
        statistics = SolveStatistics(iterations, status, seconds, built - begin.began, *sizes)
        return Result(answer, statistics, bool(stats["success"]), interrupted)


def run_packed(solver: Packed, arguments: dict[str, Any]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Run a packed solver in a worker: its answer as arrays, and what its statistics say about it."""
    with LOCK:  # a function is made of expressions
        function = solver.unpacked()
    answer, stats = _answer(function, arguments), function.stats()
    return answer, {name: stats[name] for name in ("iter_count", "return_status", "success")}


def _answer(function: ca.Function, arguments: dict[str, Any]) -> dict[str, np.ndarray]:
    """Values of a solver by name."""
    return {name: value.full().ravel() for name, value in function(**arguments).items()}


def _checked(make: Callable[..., Made], program: CollocationProgram, options: dict[str, Any]) -> Made:
    """Result of a function of a program and options; refuses options that CasADi does not take."""
    try:
        with quiet():
            return make(program, options)
    except RuntimeError as error:
        raise ModelError(f"optimize: the solver refuses the options: {error}") from None


def rows_at(program: CollocationProgram, x: np.ndarray, data: np.ndarray) -> np.ndarray:
    """Rows of a program at an iterate, scaled."""
    rows: np.ndarray = program.nlp.evaluate(x, data)[1].full().ravel()
    return rows
