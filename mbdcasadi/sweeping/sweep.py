"""Sweeps: one compiled simulation over many values, in this process or in many."""

from __future__ import annotations

import time as clock
from collections.abc import Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, as_completed
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np

from ..arguments.values import pairs_of
from ..errors import AssemblyError, Interrupted, MechanismError, ModelError, SimulationError, SingularityError
from ..integrators import Integrator
from ..model.mechanism import Mechanism
from ..model.symbols import Parameter
from ..numerics.progress import progress_bar
from ..sensitivity.compiled_run import MotionSetup
from ..sensitivity.sensitivities import named_outputs
from .cases import read_cases
from .result import Sweep
from .starts import starts_of
from .sweep_file import SweepFile, fingerprint
from .worker import Parcel, run_batch

#: Batches into which the cases are cut, and the largest of them, where the user does not say.
BATCHES, LARGEST_BATCH = 64, 250
#: Cases that are tried as the one from which the others are reached.
TRIES = 100

Batch = tuple[np.ndarray, np.ndarray, list[str]]


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
    method: str | Integrator = "idas",
    reltol: float | None = None,
    abstol: float | None = None,
    batch: int | None = None,
    file: str | Path | None = None,
    progress: bool = False,
) -> Sweep:
    """Run one compiled simulation over many values of parameters and inputs.

    The starts of all cases are found first, together; then what travels to the
    workers are a ``casadi.Function`` and arrays. A case that fails is kept as
    such, with its message, and the others go on.

    Parameters
    ----------
    mechanism : Mechanism
        The model.
    times : sequence of float
        Output times, s.
    cases : mapping
        Parameter or input to its values (k,); see :func:`full_factorial` and :func:`latin_hypercube`.
    outputs : {name: expression}, or sequence of expressions
        What is kept of each run.
    initial, inputs, parameters
        As for :func:`simulate`; conditions may hold the parameters that vary.
    executor : concurrent.futures.Executor, optional
        Threads, processes, a Dask cluster by ``client.get_executor()``; without, one case after the other, here.
    method : {"idas", "erk", "rosenbrock", "auto"}
        Integrator, for all cases; "auto" decides by the first.
    reltol, abstol : float, default 1e-8
        Of the integrator.
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
        For cases that do not fit the mechanism.
    FileError
        Where the file belongs to another sweep.
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
    varied = read_cases(mechanism, cases)
    count = len(next(iter(varied.values())))
    named = named_outputs(outputs)
    fixed = [(key, value) for key, value in pairs_of(parameters, "parameters=") if key not in varied]
    settings = {"method": method, "reltol": reltol, "abstol": abstol}
    setup = _setup(mechanism, times, initial, inputs, fixed, varied, settings)
    result = Sweep(setup.grid, varied, named)
    p, levels = _values(setup, varied, count)
    starts, failures = starts_of(setup, p)
    parcel = _parcel(setup, named)
    store = None if file is None else SweepFile(file, _fingerprint(setup, named, p, levels, starts))
    for block in store.read() if store else []:
        result.take(*block)
    waiting = np.flatnonzero(~result.done)
    none = np.array([k for k in waiting if int(k) in failures], int)
    _enter(
        result, store, (none, np.full((none.size, result._values[0].size), np.nan), [failures[int(k)] for k in none])
    )
    left = np.array([k for k in waiting if int(k) not in failures], int)
    batches = [left[k : k + size] for size in [_batch_size(batch, left.size)] for k in range(0, left.size, size)]
    began = clock.perf_counter()
    try:
        with _bar(count, count - left.size, progress) as bar:
            for block in _run(executor, parcel, batches, starts, p, levels):
                _enter(result, store, block)
                bar.update(len(block[0]))
    except KeyboardInterrupt:
        result.seconds = clock.perf_counter() - began
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
    result.seconds = clock.perf_counter() - began
    return result


def _setup(
    mechanism: Mechanism,
    times: Any,
    initial: Any,
    inputs: Any,
    fixed: list[tuple[Any, Any]],
    varied: dict[Any, np.ndarray],
    settings: dict[str, Any],
) -> MotionSetup:
    """The mechanism at the first of the cases, spread over all of them, that can be assembled."""
    obstacle: MechanismError | None = None
    count = len(next(iter(varied.values())))
    for k in np.unique(np.linspace(0, count - 1, min(count, TRIES)).astype(int)):
        values = [(key, column[k]) for key, column in varied.items() if isinstance(key, Parameter)]
        try:
            return MotionSetup(
                mechanism, "sweep", times, initial=initial, inputs=inputs, parameters=[*fixed, *values], **settings
            )
        except (AssemblyError, SingularityError) as error:
            obstacle = obstacle or error
        except ModelError as error:  # a length below zero belongs to its case; all else is wrong in every case
            if not values:
                raise
            obstacle = obstacle or error
    assert obstacle is not None
    raise obstacle


def _values(setup: MotionSetup, varied: dict[Any, np.ndarray], count: int) -> tuple[np.ndarray, np.ndarray]:
    """Parameters (count, n_p) and levels of the inputs (count, n_levels)."""
    mechanism, signals = setup.mechanism, setup.signals
    p, levels = np.tile(setup.p, (count, 1)), np.tile(signals.level_values, (count, 1))
    for key, values in varied.items():
        if isinstance(key, Parameter):
            p[:, [k for k, own in enumerate(mechanism.parameters) if own is key]] = values[:, None]
            continue
        k = next(k for k, own in enumerate(mechanism.inputs) if own is key)
        if k not in signals.level_places:
            raise ModelError(f"sweep: input '{key.label}' is in cases= and, varying, in inputs= too; leave one out")
        levels[:, signals.level_places[k]] = values
    return p, levels


def _parcel(setup: MotionSetup, named: list[tuple[Any, ca.SX]]) -> Parcel:
    motion = setup.motion(())
    size = setup.differentiable_start.function.size1_out(0)
    x0, p = ca.MX.sym("x0", size), ca.MX.sym("p", setup.numeric.p.size)
    levels, channel = ca.MX.sym("levels", setup.signals.levels.numel()), motion.channel()
    course = motion.course(None, setup.p, setup.signals.level_values, channel)
    states, _ = motion.motion(course)(x0, p, levels, channel, *course.arguments)
    values = motion.outputs([e for _, e in named])(states, p, levels, channel)
    return Parcel(ca.Function("run", [x0, p, levels], [values, states[-1, -1]]), float(setup.grid[-1] - setup.grid[0]))


def _fingerprint(setup: MotionSetup, named: list[tuple[Any, ca.SX]], *numbers: np.ndarray) -> str:
    """Of the equations, the outputs, the inputs, the settings and all numbers."""
    eom, signals = setup.eom, setup.signals
    expressions = [eom.mass_diagonal, eom.Q, eom.Phi, eom.Phi_q, eom.z_rate, signals.parametrised]
    expressions += [ca.vec(e) for _, e in named]
    # a serialised function holds every constant to the last digit; printed expressions do not
    known = [*eom.symbols, signals.levels, signals.channel]
    content = ca.Function("sweep", known, [ca.densify(e) for e in expressions]).serialize()
    samples = [np.asarray(v) for v in signals.samples.values()]
    names = [name for name, _ in named if isinstance(name, str)]
    return fingerprint(content, *names, repr(setup.integrator), setup.grid, *samples, *numbers)


def _batch_size(given: int | None, count: int) -> int:
    if given is None:
        return max(1, min(LARGEST_BATCH, -(-count // BATCHES)))
    if not isinstance(given, int) or given < 1:
        raise ModelError(f"sweep: batch must be an integer of at least 1, got {given!r}")
    return given


def _run(
    executor: Executor | None,
    parcel: Parcel,
    batches: list[np.ndarray],
    starts: np.ndarray,
    p: np.ndarray,
    levels: np.ndarray,
) -> Iterator[Batch]:
    """Finished batches, as they come."""
    if executor is None:
        for indices in batches:
            yield (indices, *run_batch(parcel, starts[indices], p[indices], levels[indices]))
        return
    futures: dict[Future, np.ndarray] = {
        executor.submit(run_batch, parcel, starts[indices], p[indices], levels[indices]): indices for indices in batches
    }
    try:
        for future in as_completed(futures):
            yield (futures[future], *future.result())
    finally:
        for future in futures:
            future.cancel()


def _enter(result: Sweep, store: SweepFile | None, block: Batch) -> None:
    if len(block[0]):
        result.take(*block)
        if store is not None:
            store.append(*block)


def _bar(total: int, done: int, show: bool) -> Any:
    return progress_bar(total, "sweep", "case", show=show, done=done)
