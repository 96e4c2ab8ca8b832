"""Sweeps: one compiled simulation over many values, in this process or in many."""

from __future__ import annotations

import os
import time as clock
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, ThreadPoolExecutor, wait
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import mapping_of
from ..equations import equations
from ..errors import FileError, Interrupted, ModelError, SimulationError
from ..integrators import Integrator
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.quantities import yes_or_no
from ..numerics.console import keyboard_interrupts
from ..numerics.progress import progress_bar
from ..sensitivity.sensitivities import named_outputs
from ..simulation.changes.events import refuse_events
from .cases import read_cases
from .jobs import Jobs, batch_size, jobs_of
from .plan import Plan
from .result import Sweep
from .sweep_file import SweepFile
from .whole_runs import WholeParcel
from .worker import BatchOutcome, run_batch

#: Finished cases: their indices, outputs (k, n), and messages.
Block = tuple[np.ndarray, np.ndarray, list[str]]


@keyboard_interrupts("sweep")
def sweep(
    mechanism: Mechanism,
    times: Any,
    cases: Any,
    outputs: Any,
    initial: Any = (),
    *,
    executor: Executor | None = None,
    inputs: Any = None,
    parameters: Any = None,
    events: Sequence[Event] = (),
    method: str | Integrator = "idas",
    reltol: float | None = None,
    abstol: float | None = None,
    batch: int | None = None,
    file: str | Path | None = None,
    progress: bool = False,
) -> Sweep:
    """Run one compiled simulation over many values of parameters and inputs.

    The workers receive ``casadi.Function`` objects and arrays: they
    find the starts of their cases by continuation from that of one of them, and
    integrate. A start that is not reached this way is assembled here. A
    case that fails is kept as such, with its message, and the others are run.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, s.
    cases : mapping
        Parameter or input to its values (k,); see :func:`full_factorial` and :func:`latin_hypercube`.
    outputs : {name: expression}, or sequence of expressions
        Quantities of each run that are kept.
    initial, inputs, parameters
        As for :func:`simulate`; conditions may hold the parameters that vary.
    events : sequence of Event
        Not supported: refused with the analyses that take them.
    executor : concurrent.futures.Executor, optional
        Threads, processes, a Dask cluster by ``client.get_executor()``; without, one case after the other, here.
    method : {"idas", "dop853", "erk", "rosenbrock", "auto"}
        Integrator, for all cases. :class:`DOP853` is much the fastest where forces are smooth and not stiff; without
        an executor its cases are shared by a thread for each processor. "auto" decides by the first case: it takes
        DOP853 if the motion at the start is not stiff, forces and inputs neither jump nor act in contacts, no
        prescribed motion switches in time and there is a C compiler; otherwise "erk" or, if it is stiff, "idas".
    reltol, abstol : float, default 1e-8
        Of the integrator, for all cases. If `abstol` is left out and one of the cases that are spread farthest stays
        within a range that the default does not resolve, it is one that does.
    batch : int, optional
        Cases in a batch: what a worker takes at a time.
    file : str or Path, optional
        Finished batches are appended to it; the same call with the same file runs what is missing.
    progress : bool, default False
        Show a progress bar.

    Returns
    -------
    Sweep
        ``swept["name"]`` (cases, n_t), ``.failures``, ``.to_xarray()``.

    Raises
    ------
    ModelError
        For cases that do not fit the mechanism, and for events.
    FileError
        If the file belongs to another sweep.
    Interrupted
        On Ctrl-C; ``.partial`` holds what was finished.

    Examples
    --------
    >>> import numpy as np, mbdcasadi as mbd
    >>> g = mbd.Parameter("g", 9.81)
    >>> stone = mbd.Body("stone", mass=1, inertia=1)
    >>> fall = mbd.Mechanism(bodies=[stone], forces=[mbd.Gravity((0, -g))], parameters=[g])
    >>> swept = mbd.sweep(fall, [0, 1], cases={g: [1.62, 3.71, 9.81]}, outputs={"y": stone.y})
    >>> np.round(swept["y"][:, -1], 3)
    array([-0.81 , -1.855, -4.905])
    """
    if executor is not None and not hasattr(executor, "submit"):
        raise ModelError(f"sweep: executor= takes a concurrent.futures executor, got {executor!r}")
    yes_or_no(progress, "sweep", "progress")
    equations(mechanism)  # raises for what is not a mechanism
    refuse_events(events, "sweep")
    varied = read_cases(mechanism, cases)
    count = len(next(iter(varied.values())))
    named = named_outputs(outputs)
    batch_size(batch, count)
    fixed = [(key, value) for key, value in mapping_of(parameters, "parameters=").items() if key not in varied]
    arguments = {"initial": initial, "inputs": inputs, "method": method, "reltol": reltol, "abstol": abstol}
    arguments["outputs"] = [expression for _, expression in named]
    plan = Plan(mechanism, times, fixed, varied, arguments)
    result = Sweep(plan.setup.grid, varied, named)
    store = None if file is None else SweepFile(file, plan.fingerprint(named))
    for block in store.read() if store else []:
        result.take(*block)
    blocks = _blocks(executor, plan, named, np.flatnonzero(~result.done), batch, result.notes)
    _collect(blocks, result, store, progress=progress)
    return result


def _collect(blocks: Iterator[Block], result: Sweep, store: SweepFile | None, *, progress: bool) -> None:
    """Take finished cases as they come, into the file, too; an error holds those that were finished."""
    began, count = clock.perf_counter(), result.done.size
    try:
        with (
            keyboard_interrupts("sweep"),
            progress_bar(count, "sweep", "case", show=progress, done=int(np.sum(result.done))) as bar,
        ):
            for block in blocks:
                result.take(*block)
                if store is not None:
                    store.append(*block)
                bar.update(len(block[0]))
    except Interrupted:
        raise Interrupted(
            f"sweep: stopped by the user after {int(np.sum(result.done))} of {count} cases; .partial holds them"
            + (f", and so does {store.path}" if store else ""),
            partial=result,
        ) from None
    except BrokenExecutor as error:
        raise SimulationError(
            f"sweep: a worker of the executor was lost ({error}); .partial holds the cases that were finished; "
            "processes need the lines that start them under if __name__ == '__main__'",
            partial=result,
        ) from None
    except FileError as error:
        raise FileError(f"{error}; .partial holds the cases that were finished", partial=result) from None
    finally:
        result.seconds = clock.perf_counter() - began


def _blocks(
    executor: Executor | None,
    plan: Plan,
    named: list[tuple[Any, ca.SX]],
    cases: np.ndarray,
    size: int | None,
    notes: list[str],
) -> Iterator[Block]:
    """Finished cases, as they come; what ran them is added to the notes."""
    if not cases.size:
        return
    jobs = jobs_of(plan, named)
    courses, failures = jobs.courses(cases)
    if failures:
        yield _failed(failures, jobs)
    folding: list[np.ndarray] = []
    runner = _runner(executor, jobs)
    try:
        for batch in jobs.batches(courses, size):
            runner.submit(batch)
        for done, outcome in runner.results():
            ran = outcome.reached & ~outcome.folds
            if outcome.note and outcome.note not in notes:
                notes.append(outcome.note)
            if np.any(outcome.folds):
                folding.append(done[outcome.folds])
            if np.any(ran):
                messages = [m for m, good in zip(outcome.reasons, ran, strict=True) if good]
                yield done[ran], *jobs.judged(outcome.values[ran], messages)
            left = done[~outcome.reached]
            if left.size:
                good, starts, messages = jobs.assembled(left)
                if np.any(good):
                    runner.submit(jobs.batch(left[good], courses, starts))
                if not np.all(good):
                    yield _failed({int(k): m for k, m in zip(left, messages, strict=True) if m}, jobs)
        # no thread runs any more: a simulation writes expressions, which CasADi allows one thread at a time
        for some in folding:
            yield some, *jobs.simulated(some)
        if folding:
            notes.append(
                "cases that come near to poses in which the mechanism could fold, or stopped, ran one after the other, "
                f"as by simulate: {sum(some.size for some in folding)}"
            )
    finally:
        runner.cancel()


def _runner(executor: Executor | None, jobs: Jobs) -> _Here | _Elsewhere:
    """What runs batches: workers that were given, threads, or this one."""
    if executor is not None:
        return _Elsewhere(executor)
    return _InThreads() if jobs.in_threads else _Here()


def _failed(failures: dict[int, str], jobs: Jobs) -> Block:
    """A block of cases that failed."""
    return np.array(list(failures), int), np.full((len(failures), jobs.width), np.nan), list(failures.values())


class _Here:
    """Batches that run one after the other in this process."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[Any, ...]] = deque()

    def submit(self, batch: tuple[Any, ...]) -> None:
        """Add a batch: its cases, and arguments of :func:`run_batch`."""
        self._waiting.append(batch)

    def results(self) -> Iterator[tuple[np.ndarray, BatchOutcome]]:
        """Cases and outcomes, until no batch is left; more may be added on the way."""
        while self._waiting:
            cases, *arguments = self._waiting.popleft()
            yield cases, run_batch(*arguments)

    def cancel(self) -> None:
        """Forget what did not run."""
        self._waiting.clear()


class _Elsewhere:
    """Batches that run in an executor."""

    def __init__(self, executor: Executor):
        self._executor = executor
        self._futures: dict[Future, np.ndarray] = {}

    def submit(self, batch: tuple[Any, ...]) -> None:
        """Add a batch: its cases, and arguments of :func:`run_batch`."""
        cases, *arguments = batch
        self._futures[self._executor.submit(run_batch, *arguments)] = cases

    def results(self) -> Iterator[tuple[np.ndarray, BatchOutcome]]:
        """Cases and outcomes as they come, until no batch is left; more may be added on the way."""
        while self._futures:
            for future in wait(self._futures, return_when=FIRST_COMPLETED).done:
                yield self._futures.pop(future), future.result()

    def cancel(self) -> None:
        """Cancel what did not run."""
        for future in self._futures:
            future.cancel()


class _InThreads(_Elsewhere):
    """Batches that run in C, in as many threads of this process as there are processors."""

    def __init__(self) -> None:
        super().__init__(ThreadPoolExecutor(os.cpu_count() or 1))
        self._parcels: set[WholeParcel] = set()

    def submit(self, batch: tuple[Any, ...]) -> None:
        self._parcels.add(batch[1])
        super().submit(batch)

    def cancel(self) -> None:
        super().cancel()
        for parcel in self._parcels:
            parcel.halt()
        self._executor.shutdown()
