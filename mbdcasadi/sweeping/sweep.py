"""Sweeps: one compiled simulation over many values, in this process or in many."""

from __future__ import annotations

import os
import time as clock
import warnings
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of, position_in
from ..assembly.setup import Setup
from ..equations import equations
from ..errors import (
    AssemblyError,
    FileError,
    Interrupted,
    MechanismError,
    MechanismWarning,
    ModelError,
    SimulationError,
    SingularityError,
    warn,
)
from ..integrators import Integrator
from ..model.conditions import read_conditions
from ..model.events import Event
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter
from ..numerics.progress import progress_bar
from ..results.state import State
from ..sensitivity.compiled_run import MotionSetup
from ..sensitivity.differentiable_motion import Cuts, channel_over
from ..sensitivity.load_limit import LoadLimit
from ..sensitivity.sensitivities import named_outputs
from ..simulation.events import refuse_events
from ..simulation.time_dependence import timed_equations
from .cases import farthest, read_cases
from .result import Sweep
from .starts import StartPath, assembled_start, out_of_limits, repeat_for_case
from .sweep_file import SweepFile, fingerprint
from .whole_runs import WholeParcel, refuse_unsuited, times_of
from .worker import BatchOutcome, Parcel, run_batch

#: Ratio of the masses of cases up to which one scaling serves all: with 1e6 no error was seen, with 1e12 it was.
LIKE_MASSES = 1e8
#: Batches into which the cases are cut, and the largest of them, where the user does not say.
BATCHES, LARGEST_BATCH = 64, 250
#: The same for threads of this process, which share a batch.
WHOLE_BATCHES = 16, 1000
#: Cases that are tried as the one from which the others are reached.
TRIES = 100

#: Cases, as far from each other as they are spread, from which the absolute tolerance is chosen, and on whose motions
#: short loads are looked for.
RANGES, PROBED = 8, 16

#: Finished cases: their indices, outputs (k, n), and messages.
Block = tuple[np.ndarray, np.ndarray, list[str]]


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
    case that fails is kept as such, with its message, and the others go on.

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
        Integrator, for all cases; "auto" decides by the first. :class:`DOP853` is much the fastest where forces are
        smooth and not stiff; without an executor its cases are shared by a thread for each processor.
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
    equations(mechanism)  # refuses what is none
    refuse_events(events, "sweep")
    varied = read_cases(mechanism, cases)
    count = len(next(iter(varied.values())))
    named = named_outputs(outputs)
    _batch_size(batch, count)
    fixed = [(key, value) for key, value in pairs_of(parameters, "parameters=") if key not in varied]
    arguments = {"initial": initial, "inputs": inputs, "method": method, "reltol": reltol, "abstol": abstol}
    plan = _Plan(mechanism, times, fixed, varied, arguments)
    result = Sweep(plan.setup.grid, varied, named)
    store = None if file is None else SweepFile(file, plan.fingerprint(named))
    for block in store.read() if store else []:
        result.take(*block)
    began = clock.perf_counter()
    try:
        with _bar(count, int(np.sum(result.done)), progress) as bar:
            for block in _blocks(executor, plan, named, np.flatnonzero(~result.done), batch):
                result.take(*block)
                if store is not None:
                    store.append(*block)
                bar.update(len(block[0]))
    except (KeyboardInterrupt, SystemError) as error:
        # inside the conversions of NumPy and CasADi Ctrl-C becomes the cause of a SystemError
        if not isinstance(error, KeyboardInterrupt) and not isinstance(error.__cause__, KeyboardInterrupt):
            raise
        raise Interrupted(
            f"stopped by the user after {int(np.sum(result.done))} of {count} cases; .partial holds them"
            + (f", and so does {file}" if file else ""),
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
    return result


class _Plan:
    """The cases of a sweep, as arguments of compiled runs.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, s.
    fixed : list of (Parameter, float)
        Values of parameters that do not vary.
    varied : dict
        Parameter or input to its values (k,).
    given : dict
        Further arguments of :class:`MotionSetup`.

    Attributes
    ----------
    setup : Setup
        The arguments, read; nothing is assembled.
    p, levels : numpy.ndarray
        Parameters (k, n_p), and values of the inputs that are numbers (k, n_levels).
    """

    def __init__(
        self,
        mechanism: Mechanism,
        times: Any,
        fixed: list[tuple[Any, Any]],
        varied: dict[Any, np.ndarray],
        given: dict[str, Any],
    ):
        self._mechanism, self._times, self._fixed, self._varied, self._given = mechanism, times, fixed, varied, given
        self.count = len(next(iter(varied.values())))
        shared = {name: given[name] for name in ("initial", "inputs")}
        with warnings.catch_warnings():
            # limits of what varies are looked at in all cases
            warnings.simplefilter("ignore", MechanismWarning)
            self.setup = Setup(
                mechanism, "sweep", times=times, parameters=self._parameters(0), takes_duration=False, **shared
            )
        self.p, self.levels = self._values()
        self._report_exceeded_limits()
        self._report_unlike_masses()

    def _parameters(self, case: int) -> list[tuple[Any, Any]]:
        varied = [(key, column[case]) for key, column in self._varied.items() if isinstance(key, Parameter)]
        return [*self._fixed, *varied]

    def _values(self) -> tuple[np.ndarray, np.ndarray]:
        mechanism, signals = self._mechanism, self.setup.signals
        p, levels = np.tile(self.setup.p, (self.count, 1)), np.tile(signals.level_values, (self.count, 1))
        for key, values in self._varied.items():
            if isinstance(key, Parameter):
                p[:, position_in(mechanism.parameters, key, "cases=")] = values
                continue
            k = position_in(mechanism.inputs, key, "cases=")
            if k not in signals.level_places:
                raise ModelError(f"sweep: input '{key.label}' is in cases= and, varying, in inputs= too; leave one out")
            levels[:, signals.level_places[k]] = values
        return p, levels

    def _report_exceeded_limits(self) -> None:
        for parameter, values in zip(self._mechanism.parameters, self.p.T, strict=True):
            beyond = np.flatnonzero((values < parameter.lower) | (values > parameter.upper))
            if beyond.size:
                shown = ", ".join(str(k) for k in beyond[:5]) + (" …" if beyond.size > 5 else "")
                warn(
                    f"sweep: parameter '{parameter.label}' is beyond its limits {parameter.lower:.6g} … "
                    f"{parameter.upper:.6g} in {beyond.size} of {self.count} cases ({shown}); they are used as given",
                )

    def _report_unlike_masses(self) -> None:
        eom = self.setup.eom
        if not ca.depends_on(eom.mass_diagonal, eom.p):
            return
        masses = ca.Function("masses", [eom.p], [ca.densify(eom.mass_diagonal)])(ca.DM(self.p.T)).full().T
        with np.errstate(divide="ignore", invalid="ignore"):
            ratios = masses / masses[0]
        ratios = ratios[np.isfinite(ratios) & (ratios > 0)]
        if ratios.size and ratios.max() > LIKE_MASSES * ratios.min():
            warn(
                f"sweep: masses or inertias of the cases differ by a factor of {ratios.max() / ratios.min():.1g}, and "
                "the equations are scaled for one of them: errors may be larger than the tolerances ask for; sweep "
                "cases of like masses separately"
            )

    def fingerprint(self, named: list[tuple[Any, ca.SX]]) -> str:
        """Digest of the equations, the outputs, the start, the inputs, the settings and all numbers."""
        setup, eom, signals = self.setup, self.setup.eom, self.setup.signals
        expressions = [eom.mass_diagonal, eom.Q, eom.Phi, eom.Phi_q, eom.z_rate, signals.parametrised]
        expressions += [ca.vec(e) for _, e in named]
        initial, numbers = setup.initial, [*eom.estimate]
        if isinstance(initial, State):
            numbers += [initial.q, initial.v, initial.z]
        else:
            conditions = read_conditions(initial)
            expressions += [c.expression for c in conditions]
            numbers.append(np.array([c.equality for c in conditions], float))
        # a serialised function holds every constant to the last digit; printed expressions do not
        known = [*eom.symbols, signals.levels, signals.channel]
        content = ca.Function("sweep", known, [ca.densify(e) for e in expressions]).serialize()
        samples = [np.asarray(v) for v in signals.samples.values()]
        names = [name for name, _ in named if isinstance(name, str)]
        settings = repr([self._given[name] for name in ("method", "reltol", "abstol")])
        return fingerprint(content, *names, settings, setup.grid, *samples, *numbers, self.p, self.levels)

    def first_assembled(self) -> MotionSetup:
        """The mechanism at the first of the cases, spread over all of them, that can be assembled.

        Raises
        ------
        MechanismError
            Reason for which the first one cannot, if none can.
        """
        obstacle: MechanismError | None = None
        shared = {name: self._given[name] for name in ("initial", "inputs", "method", "reltol", "abstol")}
        varies = any(isinstance(key, Parameter) for key in self._varied)
        for k in np.unique(np.linspace(0, self.count - 1, min(self.count, TRIES)).astype(int)):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                try:
                    setup = MotionSetup(
                        self._mechanism, "sweep", self._times, parameters=self._parameters(int(k)), **shared
                    )
                except (AssemblyError, SingularityError) as error:
                    obstacle = obstacle or error
                    continue
                except ModelError as error:
                    # a length below zero belongs to its case; all else is wrong in every case
                    if not varies:
                        raise
                    obstacle = obstacle or error
                    continue
            repeat_for_case([w for w in caught if "the limits that it carries" not in str(w.message)], int(k))
            return setup
        assert obstacle is not None
        raise obstacle


class _Jobs:
    """Batches of cases with what is compiled for them.

    Attributes
    ----------
    batching : tuple of int
        Batches into which the cases are cut, and the largest of them, if the user does not say.

    Parameters
    ----------
    setup : MotionSetup
        The mechanism at the first of the cases that can be assembled.
    plan : _Plan
        The cases.
    named : list of (str, casadi.SX)
        Outputs.
    """

    batching = BATCHES, LARGEST_BATCH

    def __init__(self, setup: MotionSetup, plan: _Plan, named: list[tuple[Any, ca.SX]]):
        self._plan, self.setup = plan, setup
        self._path = StartPath(setup)
        self._prepare(named)
        #: numbers that are kept of a case
        self.width = setup.grid.size * sum(e.numel() for _, e in named)

    def _prepare(self, named: list[tuple[Any, ca.SX]]) -> None:
        """Make what the cases share."""
        plan = self._plan
        parameters = self.setup.mechanism.parameters
        varied = [k for k, own in enumerate(parameters) if np.ptp(plan.p[:, k]) > 0]
        self._motion = self.setup.motion(varied, in_state=False)
        channel = self._motion.channel()
        spread = self._spread()
        poses = []
        for x0, p, levels in spread[:RANGES]:
            try:
                poses.append(self._motion.poses_from(x0, p, levels, channel))
            except MechanismError:  # the case itself says why
                continue
        if self.setup.resolve_all(poses):
            self._motion = self.setup.motion(varied, in_state=False)
        for x0, p, levels in spread:
            self._motion.load_limit.look(x0, p, levels, channel)
        self._outputs = self._motion.outputs([e for _, e in named])
        self._parcels: dict[tuple[Any, ...], Parcel] = {}

    def _spread(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Starts, parameters and numbers of the inputs of the cases whose values are farthest from each other."""
        plan = self._plan
        chosen = farthest(np.hstack([plan.p, plan.levels]), PROBED)
        starts, reached = self._path.starts(plan.p[chosen])
        usable = reached & np.all(np.isfinite(starts), axis=1)
        return [(x0, plan.p[k], plan.levels[k]) for x0, k in zip(starts[usable], chosen[usable], strict=True)]

    def courses(self, cases: np.ndarray) -> tuple[dict[int, Any], dict[int, str]]:
        """Cuts of the motions of cases, and the reasons why some have none."""
        courses, failures = {}, out_of_limits(self.setup, self._plan.p, cases)
        channel = self._motion.channel()
        shared: Cuts | None = None
        for k in cases:
            if int(k) in failures:
                continue
            if shared is not None:
                courses[int(k)] = shared
                continue
            try:
                courses[int(k)] = self._motion.course(None, self._plan.p[k], self._plan.levels[k], channel)
            except MechanismError as error:
                failures[int(k)] = str(error)
                continue
            if not self._motion.course_varies:
                shared = courses[int(k)]
        return courses, failures

    def parcel(self, course: Any) -> Parcel | WholeParcel:
        """The compiled batch for a course and others of its pattern."""
        if course.pattern not in self._parcels:
            setup, motion = self.setup, self._motion
            n_x, n_p = setup.differentiable_start.function.size1_out(0), setup.p.size
            x0, p = ca.MX.sym("x0", n_x), ca.MX.sym("p", n_p)
            levels, cuts = ca.MX.sym("levels", setup.signals.levels.numel()), course.symbols
            channel = motion.channel()
            states, _ = motion.motion(course)(x0, p, levels, channel, *cuts)
            values = self._outputs(states, p, levels, channel)
            run = ca.Function("run", [x0, p, levels, *cuts], [values, states[-1, -1]])
            self._parcels[course.pattern] = Parcel(run, self._path, float(setup.grid[-1] - setup.grid[0]))
        return self._parcels[course.pattern]

    def batches(self, courses: dict[int, Any], size: int | None) -> Iterator[tuple[Any, ...]]:
        """Batches of cases with the same pattern: indices, and arguments of :func:`run_batch`."""
        groups: dict[tuple[Any, ...], list[int]] = {}
        for k, course in courses.items():
            groups.setdefault(course.pattern, []).append(k)
        length = _batch_size(size, len(courses), *self.batching)
        for members in groups.values():
            for first in range(0, len(members), length):
                yield self.batch(np.array(members[first : first + length]), courses)

    def batch(self, cases: np.ndarray, courses: dict[int, Any], starts: np.ndarray | None = None) -> tuple[Any, ...]:
        """One batch."""
        plan, own = self._plan, [courses[int(k)] for k in cases]
        if all(course is own[0] for course in own):
            arguments = tuple(np.broadcast_to(part, (len(own), *part.shape)) for part in own[0].arguments)
        else:
            arguments = tuple(np.stack(parts) for parts in zip(*[c.arguments for c in own], strict=True))
        return cases, self.parcel(own[0]), plan.p[cases], plan.levels[cases], arguments, starts

    def assembled(self, cases: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[str]]:
        """Starts of cases to which no way leads from the first: which have one, these, and messages of others."""
        starts, messages = [], []
        for k in cases:
            try:
                starts.append(assembled_start(self.setup, self._plan.p[k], int(k)))
                messages.append("")
            except MechanismError as error:
                messages.append(str(error))
        good = np.array([not message for message in messages], bool)
        return good, np.array(starts), messages


class _WholeJobs(_Jobs):
    """Batches of cases that run in C, by threads if they run here."""

    threads = 1

    def _prepare(self, named: list[tuple[Any, ca.SX]]) -> None:
        refuse_unsuited(self.setup)
        self._named = [e for _, e in named]
        self._whole: WholeParcel | None = None
        spread, setup = self._spread(), self.setup
        parcel = WholeParcel(setup, self._path, [setup.eom.q], len(spread), 1)
        poses = []
        for x0, p, levels in spread[:RANGES]:
            try:
                course = [part[None, ...] for part in times_of(setup, p).arguments]
            except MechanismError:  # the case itself says why
                continue
            values = parcel.results(x0[None, :], p[None, :], levels[None, :], tuple(course))[0][0]
            poses.append(values.reshape(setup.grid.size, -1))
        setup.resolve_all(poses)
        limit = LoadLimit(setup, setup.integrator)
        channel = channel_over(setup.signals, setup.grid)
        for x0, p, levels in spread:
            limit.look(x0, p, levels, channel)
        self._load_step = limit.max_step

    def courses(self, cases: np.ndarray) -> tuple[dict[int, Any], dict[int, str]]:
        setup, failures = self.setup, out_of_limits(self.setup, self._plan.p, cases)
        found: dict[int, Any] = {}
        same = None if timed_equations(setup).depends else times_of(setup, setup.p, self._load_step)
        for k in (int(k) for k in cases if int(k) not in failures):
            try:
                found[k] = same or times_of(setup, self._plan.p[k], self._load_step)
            except MechanismError as error:
                failures[k] = str(error)
        return found, failures

    def parcel(self, course: Any) -> WholeParcel:
        if self._whole is None:
            self._whole = WholeParcel(self.setup, self._path, self._named, self._plan.count, self.threads)
        return self._whole


def _jobs(plan: _Plan, named: list[tuple[Any, ca.SX]], *, here: bool) -> _Jobs:
    """Batches by the method of a sweep."""
    setup = plan.first_assembled()
    if not setup.integrator.runs_whole:
        return _Jobs(setup, plan, named)
    jobs = _WholeJobs(setup, plan, named)
    if here:
        jobs.threads, jobs.batching = os.cpu_count() or 1, WHOLE_BATCHES
    return jobs


def _blocks(
    executor: Executor | None, plan: _Plan, named: list[tuple[Any, ca.SX]], cases: np.ndarray, size: int | None
) -> Iterator[Block]:
    """Finished cases, as they come."""
    if not cases.size:
        return
    jobs = _jobs(plan, named, here=executor is None)
    courses, failures = jobs.courses(cases)
    if failures:
        yield _failed(failures, jobs)
    runner = _Here() if executor is None else _Elsewhere(executor)
    try:
        for batch in jobs.batches(courses, size):
            runner.submit(batch)
        for done, outcome in runner.results():
            ran = outcome.reached
            if np.any(ran):
                messages = [m for m, good in zip(outcome.messages, ran, strict=True) if good]
                yield done[ran], outcome.values[ran], messages
            left = done[~ran]
            if left.size:
                good, starts, messages = jobs.assembled(left)
                if np.any(good):
                    runner.submit(jobs.batch(left[good], courses, starts))
                if not np.all(good):
                    yield _failed({int(k): m for k, m in zip(left, messages, strict=True) if m}, jobs)
    finally:
        runner.cancel()


def _failed(failures: dict[int, str], jobs: _Jobs) -> Block:
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


def _batch_size(size: int | None, count: int, batches: int = BATCHES, largest: int = LARGEST_BATCH) -> int:
    if size is None:
        return max(1, min(largest, -(-count // batches)))
    if isinstance(size, bool) or not isinstance(size, int) or size < 1:
        raise ModelError(f"sweep: batch must be an integer of at least 1, got {size!r}")
    return size


def _bar(total: int, done: int, show: bool) -> Any:
    return progress_bar(total, "sweep", "case", show=show, done=done)
