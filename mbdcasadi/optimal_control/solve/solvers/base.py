"""Interface of solvers of the nonlinear program: a start on a mesh, a run, here or on an executor, and its answer."""

from __future__ import annotations

import sys
import time as clock
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar, TypeVar

import casadi as ca
import numpy as np

from ....errors import MechanismError, ModelError
from ....numerics.console import Interruption, interruptible, quiet
from ....numerics.packed import Packed
from ....numerics.progress import progress_bar
from ....numerics.symbolic import LOCK, numeric_work, symbolic
from ...motion.guess import Guess, Iterate
from ...program.collocation_program import Bounds, CollocationProgram
from ...program.elastic_program import ElasticProgram
from ...program.limit_sides import Slacks
from ...program.statistics import SolveStatistics
from ...transcription.mesh import Mesh
from ...transcription.rows import violations

Made = TypeVar("Made")

#: Scaled cost below which a cost has no lower bound, as it seems, and iterates that must be there one after another.
UNBOUNDED_COST, UNBOUNDED_ITERATES = -1e6, 20
#: Iterate from which a solve whose cost is above its ceiling is given up.
GIVEN_UP = 20
#: Status of a program with more equations than variables, with which IPOPT does not begin.
REFUSED = "Not_Enough_Degrees_Of_Freedom"
#: Types of options by whose text a solver is found again.
PLAIN = (str, int, float, list, tuple, dict)
#: Options of CasADi for solvers whose failures are reported by their status.
QUIET: dict[str, Any] = {"print_time": False, "show_eval_warnings": False, "error_on_fail": False}


@dataclass(frozen=True)
class Beginning:
    """Start of a solve on a mesh."""

    program: CollocationProgram
    meshes: Sequence[Mesh]
    guess: Guess
    #: the guess with its multipliers, if it belongs to the same program and mesh
    iterate: Iterate | None
    #: scaled variables, and data of the program
    x: np.ndarray
    data: np.ndarray
    bounds: Bounds
    #: reading of the clock at the start, s
    began: float
    #: scaled cost above which the solve is given up after a while
    ceiling: float

    def again(self, **changes: Any) -> Beginning:
        """Return the start of a further solve, which begins now, with other attributes."""
        return replace(self, began=clock.perf_counter(), **changes)


@dataclass(frozen=True)
class Result:
    """Last iterate of a run."""

    #: arrays by the names of CasADi: ``x, f, g, lam_x, lam_g``, scaled
    answer: dict[str, np.ndarray]
    statistics: SolveStatistics
    #: whether it is an optimum
    succeeded: bool
    #: whether the user stopped the run
    interrupted: bool

    def after(self, other: Result) -> Result:
        """Return the same with the work of another run added to its own."""
        return replace(self, statistics=self.statistics.after(other.statistics))


class Elsewhere:
    """An executor, of threads or processes, on which solvers run."""

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
        except RuntimeError as error:
            lost = isinstance(error, BrokenExecutor)
            what = "a worker of the executor was lost" if lost else "the executor takes no more work"
            raise MechanismError(f"optimize: {what} ({error})") from None
        try:
            wait([run, self._stop], return_when=FIRST_COMPLETED)
            if self._stop.done():
                run.cancel()
                raise KeyboardInterrupt
            return run.result()
        except BrokenExecutor as error:
            raise MechanismError(f"optimize: a worker of the executor was lost ({error})") from None


class SolverWatch:
    """Progress of one solve at a time, and reasons to stop it.

    These are the wish of the user, a cost that falls on and on, and one that stays above a ceiling.

    `lower` are the lower bounds of the rows, `cost_scale` is the size by which the cost was divided.
    """

    def __init__(self, lower: np.ndarray, cost_scale: float):
        self._lower, self._cost_scale = lower, cost_scale
        self._bar: Any = None
        self._unbounded = self._iterates = 0
        self._ceiling = np.inf
        self.interruption: Interruption | None = None

    @contextmanager
    def watching(self, interruption: Interruption, show: bool, ceiling: float) -> Iterator[None]:
        """Watch one solve; a bar writes to the standard error of now, which the solve redirects."""
        self.interruption, self._ceiling, self._unbounded, self._iterates = interruption, ceiling, 0, 0
        form = "{desc}: {n} iterations{postfix}"
        with progress_bar(None, "optimize", " iterations", show=show, bar_format=form, file=sys.stderr) as bar:
            self._bar = bar if show else None
            try:
                yield
            finally:
                self._bar = None

    @property
    def is_shown(self) -> bool:
        """True if progress is shown."""
        return self._bar is not None

    @property
    def is_stopped(self) -> bool:
        """True after Ctrl-C."""
        return self.interruption is not None and self.interruption.requested

    def note_cost(self, cost: float) -> bool:
        """Note the scaled cost of the next iterate; True if it and those before are a reason to stop."""
        self._unbounded = self._unbounded + 1 if cost < UNBOUNDED_COST else 0
        self._iterates += 1
        return self._unbounded >= UNBOUNDED_ITERATES or (self._iterates > GIVEN_UP and cost > self._ceiling)

    def show(self, cost: float, rows: np.ndarray) -> None:
        """Show scaled cost and rows of the next iterate."""
        worst = float(np.max(violations(rows, self._lower), initial=0.0))
        cost_text = f"cost {cost * self._cost_scale:.6g}"
        self._bar.set_postfix_str(f"{cost_text}, largest scaled violation {worst:.1e}", refresh=False)
        self._bar.update(1)


class NLPSolver(ABC):
    """Base class of solvers.

    A subclass sets :attr:`name`, :attr:`defaults` and :attr:`warm_start`, and writes :meth:`make`,
    :meth:`make_watched` and :meth:`least_violation`.

    Parameters
    ----------
    options : dict
        Options of the user, which prevail.
    progress : bool
        True if progress is shown.
    elsewhere : Elsewhere, optional
        Executor on which programs are solved.

    Attributes
    ----------
    name : str
        Its name in CasADi.
    defaults : dict
        Options that were measured best.
    warm_start : dict
        Further ones by the quality of the guess, "cold", "warm" or "hot".
    """

    name: ClassVar[str]
    defaults: ClassVar[dict[str, Any]]
    warm_start: ClassVar[dict[str, dict[str, Any]]]

    def __init__(self, options: dict[str, Any], progress: bool, elsewhere: Elsewhere | None = None):
        self.options, self.progress, self.elsewhere = options, progress, elsewhere

    def cost_factor(self, ratio: float) -> float:
        """Factor by which the cost is raised that is smaller than its typical size by a ratio; 1 for none."""
        return 1.0

    def with_cost_factor(self, factor: float) -> NLPSolver:
        """Return the same solver, with the cost raised by a factor where residuals are compared with the tolerance."""
        return self

    @abstractmethod
    def make(self, program: CollocationProgram, options: dict[str, Any]) -> ca.Function:
        """Return the solver of a program without callback, which can travel."""

    @abstractmethod
    def make_watched(self, program: CollocationProgram, options: dict[str, Any]) -> tuple[ca.Function, SolverWatch]:
        """Return the solver of a program, and what watches it; options of the user prevail."""

    @abstractmethod
    def least_violation(self, begin: Beginning, elastic: ElasticProgram, limit: int) -> tuple[Result, Slacks]:
        """Minimise the violations of a program near a start, in at most so many iterations.

        Returned are the last iterate with the cost of the program itself and no multipliers, and scaled violations by
        label.
        """

    def run(
        self, begin: Beginning, bounds: Bounds, warmth: str, iterate: Iterate | None = None, limit: int | None = None
    ) -> Result:
        """Solve a program between bounds, from the multipliers of an iterate if there is one.

        `warmth` is the quality of the guess, "cold", "warm" or "hot"; at most `limit` iterations, and no more than are
        set for a guess of that quality.
        """
        arguments: dict[str, Any] = {
            "x0": np.clip(begin.x, bounds.lower, bounds.upper), "p": begin.data,
            "lbx": bounds.lower, "ubx": bounds.upper, "lbg": bounds.rows_lower, "ubg": bounds.rows_upper,
        }  # fmt: skip
        arguments |= {"lam_x0": iterate.lam_x, "lam_g0": iterate.lam_g} if iterate else {}
        most = f"{self.name}.max_iter"
        own = (self.defaults | self.warm_start[warmth])[most]
        chosen = ({} if limit is None or limit >= own else {most: limit}) | self.options
        result = self._solve(begin, warmth, chosen, arguments)
        # bounds may be relaxed by the last digits; a mass must not become negative
        result.answer["x"] = np.clip(result.answer["x"], bounds.lower, bounds.upper)
        return result

    def _solve(self, begin: Beginning, warmth: str, chosen: dict[str, Any], arguments: dict[str, Any]) -> Result:
        """Solve here or on the executor, by a function that is made once."""
        options = self.defaults | self.warm_start[warmth] | chosen
        key = self.name, warmth, *sorted((name, repr(value)) for name, value in chosen.items())
        if self.elsewhere is not None:
            packed = begin.program.packed.get_or_create(
                key, lambda: Packed(_checked(self.make, begin.program, options)), bounded=True
            )
            built = clock.perf_counter()
            with numeric_work():
                answer, stats = self.elsewhere.run(packed, arguments)
            return _result(begin, built, answer, stats, interrupted=False)
        make = partial(_checked, self.make_watched, begin.program, options)
        if not all(isinstance(value, PLAIN) for value in self.options.values()):  # what a callback does is its own
            return self._call(begin, *make(), arguments)
        solvers = begin.program.solvers
        lent = solvers.borrow(key, make)
        result = self._call(begin, *lent, arguments)
        solvers.give_back(key, lent)
        return result

    def _call(self, begin: Beginning, solver: ca.Function, watch: SolverWatch, arguments: dict[str, Any]) -> Result:
        built = clock.perf_counter()
        with interruptible(raising=False) as interruption:
            with watch.watching(interruption, self.progress, begin.ceiling), quiet(), numeric_work():
                answer = _answer(solver, arguments)
            stats = solver.stats()
        return _result(begin, built, answer, stats, interruption.requested)


def _result(begin: Beginning, built: float, answer: dict[str, Any], stats: dict[str, Any], interrupted: bool) -> Result:
    """Result of a run from its answer as arrays, and its statistics in CasADi."""
    seconds = clock.perf_counter() - begin.began
    status = str(stats["return_status"])
    # CasADi leaves the count open if the solver refuses to begin: it is any number then
    iterations = 0 if status == REFUSED else max(int(stats["iter_count"]), 0)
    sizes = begin.program.size, begin.program.lower.size
    added = stats.get("iterations", {}).get("regularization_size", [])[1:]
    at_saddle = False if added and added[-1] == 0 else None
    statistics = SolveStatistics(iterations, status, seconds, built - begin.began, *sizes, at_saddle=at_saddle)
    return Result(answer, statistics, bool(stats["success"]), interrupted)


def run_packed(solver: Packed, arguments: dict[str, Any]) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """Run a packed solver in a worker: its answer as arrays, and what its statistics say about it."""
    with LOCK:  # a function is made of expressions
        function = solver.unpacked()
    answer, stats = _answer(function, arguments), function.stats()
    kept = ("iter_count", "return_status", "success", "iterations")
    return answer, {name: stats[name] for name in kept if name in stats}


def _answer(function: ca.Function, arguments: dict[str, Any]) -> dict[str, np.ndarray]:
    """Values of a solver by name."""
    return {name: value.full().ravel() for name, value in function(**arguments).items()}


@symbolic
def _checked(make: Callable[..., Made], program: CollocationProgram, options: dict[str, Any]) -> Made:
    """Result of a function of a program and options; refuses options that CasADi does not take."""
    try:
        with quiet():
            return make(program, options)
    except RuntimeError as error:
        raise ModelError(f"optimize: the solver refuses the options: {error}") from None
