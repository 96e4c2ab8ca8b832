"""Cases that run in C: one compiled method for all of them, which threads share."""

from __future__ import annotations

import threading
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..equations.switching.switches import jumps_anywhere
from ..errors import SimulationError
from ..integrators.dop853.runner import ExplicitRunner
from ..integrators.native.stretch import Cases, Status, Stretch
from ..model.cache import Cache
from ..numerics.lending import Lending
from ..sensitivity.compiled_run import MotionSetup
from ..simulation.contact.watched_terms import has_gaps
from ..simulation.formulations import choose_formulation
from ..simulation.schedule import Schedule
from ..simulation.singular.regularity import ENTRY
from ..simulation.stepping.explicit_system import explicit_system
from ..simulation.stepping.whole_stepper import refuse_redundant_rows
from ..simulation.time_dependence import dependence_at, timed_equations
from .starts import StartPath

#: Steps of a case, at most.
MOST_STEPS = 1_000_000
#: Cases from which compiling the equations always pays.
MANY = 50
#: In words, why a case stops.
REASONS = {
    Status.PAUSED: f"{MOST_STEPS} steps lead no further",
    Status.TOO_SMALL: "a step became too small",
    Status.NOT_FINITE: "a value was not finite",
    Status.APART: "the constraints cannot be met together any more",
    Status.SINGULAR: "it comes near to a pose in which the mechanism could fold",
}
STOPPED = "it was stopped"


@dataclass(frozen=True)
class Results:
    """Outputs of some cases.

    Attributes
    ----------
    values : numpy.ndarray
        Outputs (k, n); NaN for a case without.
    reasons : list of str
        Reason why a case has none; empty for others.
    folds : numpy.ndarray of bool
        True if a case is to be simulated (k,): it comes near to a pose in which the mechanism could fold, or it is one
        of a compiled run that stopped, as near such a pose.
    """

    values: np.ndarray
    reasons: list[str]
    folds: np.ndarray


@dataclass(frozen=True)
class Times:
    """Times of a case: outputs, and those that no step may cross.

    Attributes
    ----------
    arguments : tuple of numpy.ndarray
        Times (k,), which are outputs, which are stops, inputs that hold in the interval before each (k, n_channel), and
        the longest step (1,), s.
    """

    arguments: tuple[np.ndarray, ...]

    @property
    def pattern(self) -> tuple[Any, ...]:
        """Key of the properties that cases of one batch share."""
        return ("whole", self.arguments[0].size)


class SweepSetup(MotionSetup):
    """The arguments of a sweep; "auto" takes DOP853 for cases that are smooth, if it runs here.

    Parameters
    ----------
    outputs : list of casadi.SX
        Quantities that are kept.
    *arguments, **settings
        As for :class:`MotionSetup`.
    """

    def __init__(self, *arguments: Any, outputs: list[ca.SX], **settings: Any):
        self._outputs = outputs
        super().__init__(*arguments, **settings)

    def _in_c(self) -> list[ca.SX] | None:
        return self._outputs if is_smooth(self) and not timed_equations(self).has_switching_rows else None


def is_smooth(setup: MotionSetup) -> bool:
    """Return True if no forces and inputs jump, and none act in contacts."""
    eom = setup.eom
    expressions = [eom.Q, eom.z_rate, eom.gamma, eom.nu, eom.Phi, setup.signals.parametrised]
    return not has_gaps(eom.mechanism) and not jumps_anywhere([ca.SX(e) for e in expressions])


def refuse_unsuited(setup: MotionSetup) -> None:
    """Raise for a mechanism whose cases need more than steps from output to output.

    Raises
    ------
    SimulationError
        With the method that takes it.
    """
    numeric, method = setup.numeric, setup.integrator.name
    if setup.has_redundant_rows:
        refuse_redundant_rows(setup.integrator, numeric, setup.start)
    choose_formulation(numeric, setup.integrator, redundant=False)
    if not is_smooth(setup):
        raise SimulationError(
            f'sweep: method="{method}" takes forces and inputs that are smooth, and here some jump or act in contacts; '
            'use method="erk" or "idas"'
        )


def times_of(setup: MotionSetup, p: np.ndarray, load_step: float | None = None) -> Times:
    """Find the times of a case.

    Parameters
    ----------
    load_step : float, optional
        Longest step over loads that come and go with the motion, s.

    Raises
    ------
    SimulationError
        If a prescribed position or velocity jumps.
    """
    grid, signals = setup.grid, setup.signals
    dependence = dependence_at(timed_equations(setup), p, float(grid[0]), float(grid[-1]))
    if dependence.velocity_jumps or dependence.position_jump is not None:
        raise SimulationError(
            f'a prescribed motion jumps; method="{setup.integrator.name}" does not take that in sweeps'
        )
    longest = setup.integrator.longest_step(dependence.max_step, load_step)
    schedule = Schedule(grid, stops=np.r_[signals.breaks, dependence.stops, dependence.jumps], watch_points=0)
    piece = schedule.piece(float(grid[0]), 0, schedule.size - 1)
    columns = signals.columns_from(piece.begins)
    return Times((piece.times, piece.requested, piece.stops, columns, np.array([longest])))


class WholeParcel:
    """Runs of cases in C, the outputs of each, and the way to their starts; it can travel to other processes.

    Parameters
    ----------
    setup : MotionSetup
        The mechanism at the first case.
    outputs : list of casadi.SX
        Quantities that are kept.
    count : int
        Number of cases in all.

    Raises
    ------
    SimulationError
        Without a C compiler, and for operations that are not written as C.
    """

    def __init__(self, setup: MotionSetup, path: StartPath, outputs: list[ca.SX], count: int):
        self.path = path
        self._system, self._start = explicit_system(setup.numeric, setup.signals), float(setup.grid[0])
        self._weights, self._compiles = setup.numeric.projection_weights, setup.integrator.jit or count >= MANY
        self._tolerances = setup.integrator.reltol, setup.integrator.abstol
        eom, column = setup.eom, ca.vertcat(ca.SX(0, 1), *[ca.vec(e) for e in outputs])
        self._outputs = eom.function(column)
        self._needs_dynamics = bool(ca.depends_on(column, ca.vertcat(eom.a, eom.lam, eom.u)))
        self._count, self._may_fold = setup.grid.size, eom.has_loops
        self.size = self._count * self._outputs.numel_out(0)
        self._keep_runners(setup.eom.mechanism.cache)
        ExplicitRunner(self._system, None, self._cache).code_of(self._outputs)  # raises here, and not in a thread

    def _keep_runners(self, cache: Cache) -> None:
        self._cache, self._free, self._stopped = cache, Lending(), threading.Event()
        self._running: list[ExplicitRunner] = []
        #: code that ran the last cases, in words
        self.note = ""

    def __getstate__(self) -> dict[str, Any]:
        # functions travel; compiled code is found again in the user's folder
        own = ("_cache", "_free", "_stopped", "_running", "note")
        return {name: value for name, value in self.__dict__.items() if name not in own}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._keep_runners(Cache())

    def results(
        self, starts: np.ndarray, parameters: np.ndarray, levels: np.ndarray, course: tuple[np.ndarray, ...]
    ) -> Results:
        """Outputs of cases.

        Parameters
        ----------
        starts, parameters, levels : numpy.ndarray
            By case (k, …).
        course : tuple of numpy.ndarray
            :attr:`Times.arguments` by case.
        """
        if not len(starts):
            return Results(np.full((0, self.size), np.nan), [], np.zeros(0, bool))
        # what all cases share has a stride of zero
        times, requested, stops, columns, max_step = (part[:1] if part.strides[0] == 0 else part for part in course)
        cases = Cases(
            starts, parameters, levels, times, requested, stops, columns, max_step.ravel(), self._needs_dynamics
        )
        runner = self._free.borrow("runner", self._runner)
        self._running.append(runner)
        if self._stopped.is_set():  # while this thread was still waiting for its runner
            runner.run.halt()
        results = self._run(runner, cases)
        self._running.remove(runner)
        if not self._stopped.is_set():
            self._free.give_back("runner", runner)
        return results

    def halt(self) -> None:
        """Stop the runs in all threads, and any later ones."""
        self._stopped.set()
        for runner in list(self._running):
            runner.run.halt()

    def _run(self, runner: ExplicitRunner, cases: Cases) -> Results:
        """Outputs of cases in one thread."""
        count = len(cases.starts)
        values = np.full((count, self._count, self._outputs.numel_out(0)), np.nan)
        status, reached = runner.run_cases(cases, self._first(cases), self._outputs, values)
        self.note = runner.note
        failed = status != Status.DONE
        values[failed] = np.nan
        reasons = [""] * count
        for k in np.flatnonzero(failed):
            reasons[k] = f"{REASONS.get(status[k], STOPPED)} at t = {reached[k]:.6g} s"
        return Results(values.reshape(count, -1), reasons, status == Status.SINGULAR)

    def _runner(self) -> ExplicitRunner:
        return ExplicitRunner(self._system, None, self._cache, compiles=self._compiles)

    def _first(self, cases: Cases) -> Stretch:
        """The run of the first case."""
        return Stretch(
            self._start,
            cases.starts[0],
            cases.times[0],
            cases.stops[0],
            cases.channels[0],
            cases.p[0],
            cases.levels[0],
            self._weights,
            *self._tolerances,
            float(cases.max_step[0]),
            most_steps=MOST_STEPS,
            fall=ENTRY if self._may_fold else 0.0,
        )
