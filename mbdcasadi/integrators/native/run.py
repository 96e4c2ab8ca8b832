"""A run in C: the engine of a method, which the package ships as source, and its calls."""

from __future__ import annotations

import ctypes
import threading
import weakref
from collections.abc import Sequence
from ctypes import c_char, c_int, c_longlong, c_void_p
from functools import cache
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np

from ...numerics import tolerances
from ...numerics.c_code import Tape, interpreter_in_c
from . import build, shared, stretch
from .code import Code, package_version
from .shared import CASES, FUNCTION, STRETCH, SYSTEM
from .stretch import MOST_SAMPLES, SAMPLES, Cases, ExplicitSystem, Progress, Reached, Status, Stretch, Watched

#: Optimisation of the engine, which is compiled once.
OPTIMISATION = "-O3"
#: States beyond the outputs that one call may return.
EXTRA_ROWS = 2048
#: Bytes that one call may return beyond the outputs.
EXTRA_BYTES = 4_000_000
#: Constants that the engines take from ``stretch``.
CONSTANTS = ("LEAST", "MOST", "MOST_SAMPLES", "LOOSE")
#: Bytes of room for these that are kept from one call to the next, at most.
MOST_KEPT = 2 * EXTRA_BYTES
#: Numbers of a system, what a stretch gives at addresses that stay, its settings, and what is handed on from one
#: stretch to the next: names that Python and the engine share.
SIZES = ("coordinates", "states", "multipliers", "inputs", "integrals", "switches")
GIVEN = ("x", "p", "levels", "weights")
SETTINGS, PROGRESS = (tuple(shared.numbers_of(of)) for of in (Stretch, Progress))
_GIVEN, _SETTINGS, _PROGRESS = (attrgetter(*names) for names in (GIVEN, SETTINGS, PROGRESS))
#: Folder of the C that all methods share.
FOLDER = Path(__file__).parent
#: By their numbers in C.
_STATUS = tuple(Status)

_HEAD = """\
#include <math.h>
#include <stdlib.h>
#include <string.h>
#if defined(__GNUC__) && !defined(__clang__) && defined(__x86_64__) && defined(__gnu_linux__)
#define CLONES __attribute__((target_clones("avx2", "default")))
#else
#define CLONES
#endif
"""


@cache
def _shipped(name: str) -> str:
    """C of this folder."""
    return (FOLDER / name).read_text(encoding="utf-8")


def defined(module: Any, names: Sequence[str]) -> str:
    """Constants of a module as definitions in C."""
    return "".join(f"#define {name} {getattr(module, name)!r}\n" for name in names)


def engine_source(steps: str) -> str:
    """Return the engine of a method as one C source.

    Parameters
    ----------
    steps : str
        C code of the method, with its ``mbd_advance``; it stands below ``run.c`` and above ``cases.c``.
    """
    operations = interpreter_in_c().replace("\n", " \\\n")
    constants = defined(stretch, CONSTANTS) + defined(tolerances, ["PROJECTIONS"])
    above = f"{_HEAD}\n{constants}\n#define OPERATIONS \\\n{operations}\n\n{shared.in_c()}"
    return f"{above}{_shipped('run.c')}\n{steps}\n{_shipped('cases.c')}"


_lock = threading.Lock()


def engine(steps: str, using: build.Compiler) -> ctypes.CDLL:
    """Return the engine of a method, built if it is not kept.

    Raises
    ------
    CompilationError
        If it cannot be built.
    """
    with _lock:
        return _engine(steps, using, str(build.cache_folder()))


@cache
def _engine(steps: str, using: build.Compiler, folder: str) -> ctypes.CDLL:
    source = engine_source(steps)
    key = "engine-" + build.key_of(source, package_version(), using.identity, OPTIMISATION, *build.FLAGS)
    library = build.find(key) or build.build(key, source, OPTIMISATION, using)
    library.mbd_new.restype = c_void_p
    library.mbd_new.argtypes = [c_void_p]
    library.mbd_free.restype = None
    library.mbd_free.argtypes = [c_void_p]
    library.mbd_advance.restype = c_int
    library.mbd_advance.argtypes = [c_void_p, c_void_p]
    library.mbd_complete.restype = None
    library.mbd_complete.argtypes = [c_void_p, c_void_p, c_longlong, *[c_void_p] * 6]
    library.mbd_run_cases.restype = None
    library.mbd_run_cases.argtypes = [c_void_p, c_void_p, c_void_p, c_longlong, c_longlong]
    for structure in shared.STRUCTURES:
        size = getattr(library, structure.size_function)
        size.restype = c_longlong
        if size() != structure.size:
            raise build.CompilationError(f"the compiler {using.name} lays structures out in another way")
    return library


class NativeRun:
    """Runs of one system in C; one thread at a time.

    Parameters
    ----------
    library : ctypes.CDLL
        The engine.
    system : ExplicitSystem
        The equations.
    codes : sequence of Code
        Of the dynamics, projection, quadrature and what switches; of the input; of the events.
    watched : Watched, optional
        Events.
    """

    def __init__(
        self, library: ctypes.CDLL, system: ExplicitSystem, codes: Sequence[Code], watched: Watched | None = None
    ):
        self.library, self.system, self.codes, self.watched = library, system, tuple(codes), watched
        self._halt = np.zeros(1, np.int32)
        self._state = self.compiled
        found = SYSTEM(
            **{name: getattr(system, name) for name in SIZES},
            events=0 if watched is None else watched.size,
            event_needs_dynamics=watched is not None and watched.needs_dynamics,
        )
        mechanism, inputs, *events = self.codes
        for k, name in enumerate(system.functions):
            setattr(found, name, _entry(mechanism, k))
        found.input = _entry(inputs, 0)
        if events:
            found.event = _entry(events[0], 0)
        self._system = found
        self._run = library.mbd_new(ctypes.addressof(found))
        if not self._run:
            raise MemoryError("no memory for the run in C")
        weakref.finalize(self, library.mbd_free, self._run)
        self._rows, self._arrays = _Rows(system, 0), _Arrays()
        self._given = [np.zeros(size) for size in (system.size, *system.constants, system.coordinates)]
        self._task = STRETCH(
            **dict(zip(GIVEN, map(self._arrays.address, self._given), strict=True)),
            channel=system.channel,
            accuracy=tolerances.ON_CONSTRAINTS,
            halt=self._halt.ctypes.data,
            samples=SAMPLES,
        )
        if watched is not None:
            self._task.direction = self._arrays.ints(watched.direction)
            self._task.decides = self._arrays.ints(watched.decides)

    @property
    def compiled(self) -> tuple[bool, ...]:
        """Names of the codes that are compiled now."""
        return tuple([code.library is not None for code in self.codes])

    @property
    def is_current(self) -> bool:
        """True if it runs the compiled code that there is."""
        return self._state == self.compiled

    def halt(self) -> None:
        """End the call that runs in another thread at the end of its step, and any later one."""
        self._halt[0] = 1

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch; `progress` goes on."""
        task, arrays = self._task, _Arrays()
        rows = self._prepare(s, progress, s.times.size, arrays)
        self.library.mbd_advance(self._run, ctypes.addressof(task))
        vars(progress).update(zip(PROGRESS, _PROGRESS(task), strict=True))
        count = task.recorded
        if rows.size > MOST_KEPT:
            self._rows = _Rows(self.system, 0)
        return Reached(
            rows.times[:count].copy(),
            rows.x[:count].copy(),
            rows.integrals[:count].copy(),
            rows.index[:count].copy(),
            _STATUS[task.status],
            task.steps,
            task.rejected,
            task.evaluations,
            task.least_regularity,
        )

    def _prepare(self, s: Stretch, progress: Progress, outputs: int, arrays: _Arrays) -> _Rows:
        """Make a stretch the task of the engine, which reads what is kept in `arrays`; return the room for its states.

        Parameters
        ----------
        outputs : int
            Number of outputs that there may be.
        """
        extra = 0
        if s.every_step or s.keep_samples or self.watched is not None or s.fall:
            extra = MOST_SAMPLES + max(min(EXTRA_ROWS, EXTRA_BYTES // (8 * self.system.size + 16)), 64)
        task, rows, capacity = self._task, self._rows, outputs + 8 + extra
        for place, values in zip(self._given, _GIVEN(s), strict=True):
            place[:] = values
        for name, value in zip(SETTINGS, _SETTINGS(s), strict=True):
            setattr(task, name, value)
        for name, value in vars(progress).items():
            setattr(task, name, value)
        if rows.times.size < capacity:
            rows = self._rows = _Rows(self.system, capacity)
            for name, address in rows.addresses.items():
                setattr(task, name, address)
        task.count, task.capacity = s.times.size, capacity
        task.times, task.channels = arrays.doubles(s.times), arrays.doubles(s.channels)
        task.stops = arrays.ints(s.stops)
        if self.watched is not None:
            for name in ("offset", "band", "side"):
                values = getattr(s, name)
                setattr(task, name, arrays.doubles(values if values.size else np.zeros(self.watched.size)))
        return rows

    def complete(
        self, times: np.ndarray, x: np.ndarray, channels: np.ndarray, p: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Accelerations (k, n), multipliers (k, m) and inputs (k, n_u) at states by row.

        Parameters
        ----------
        channels : numpy.ndarray
            Values in the interval of each state (k, n_channel).
        """
        system, arrays, count = self.system, _Arrays(), times.size
        a, lam = np.empty((count, system.coordinates)), np.empty((count, system.multipliers))
        u = np.empty((count, system.inputs))
        task = STRETCH(channel=system.channel, p=arrays.doubles(p), levels=arrays.doubles(levels))
        self.library.mbd_complete(
            self._run,
            ctypes.addressof(task),
            count,
            arrays.doubles(times),
            arrays.doubles(x),
            arrays.doubles(channels),
            arrays.address(a),
            arrays.address(lam),
            arrays.address(u),
        )
        return a, lam, u

    def run_cases(
        self, cases: Cases, common: Stretch, output: Code, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run cases one after the other without Python; another thread may run others by another object.

        Parameters
        ----------
        cases : Cases
            The cases.
        common : Stretch
            The first of them: tolerances and what else all of them share.
        output : Code
            Of one function ``(t, q, v, a, z, lam, u, p) -> outputs``.
        values : numpy.ndarray
            Outputs (cases, rows, outputs), which are written.

        Returns
        -------
        status : numpy.ndarray of int
            By case.
        reached : numpy.ndarray
            Times up to which they came, s.
        """
        arrays, count = _Arrays(), cases.times.shape[-1]
        self._prepare(common, Progress(), count, arrays)
        number = len(cases.starts)
        status, reached = np.zeros(number, np.int32), np.zeros(number)
        entry = _entry(output, 0)
        written = {"values": values, "status": status, "reached": reached, "work": np.empty(entry.work)}
        asked = CASES(
            **{name: arrays.doubles(getattr(cases, name)) for name in ("starts", "p", "times", "channels", "max_step")},
            parameters=cases.p.shape[1],
            levels=cases.levels.shape[1],
            outputs=values.shape[2],
            rows=values.shape[1],
            output_needs_dynamics=cases.needs_dynamics,
            output=entry,
            levels_of=arrays.doubles(cases.levels),
            stride=count if len(cases.times) > 1 else 0,
            stops=arrays.ints(cases.stops),
            requested=arrays.ints(cases.requested),
            **{name: array.ctypes.data for name, array in written.items()},
        )
        self.library.mbd_run_cases(self._run, ctypes.addressof(self._task), ctypes.addressof(asked), 0, number)
        return status, reached


class _Rows:
    """Room for the states that a call returns, at addresses by the names of the engine."""

    def __init__(self, system: ExplicitSystem, capacity: int):
        self.times, self.x = np.empty(capacity), np.empty((capacity, system.size))
        self.integrals, self.index = np.empty((capacity, system.integrals)), np.empty(capacity, np.int64)
        parts, self._arrays = vars(self).copy(), _Arrays()
        self.size = sum(part.nbytes for part in parts.values())
        self.addresses = {f"out_{name}": self._arrays.address(part) for name, part in parts.items()}


class _Arrays:
    """Arrays that live as long as a call that is given their addresses."""

    def __init__(self) -> None:
        self._kept: list[np.ndarray] = []

    def doubles(self, values: Any) -> int:
        """Address of values as C doubles."""
        return self.address(np.ascontiguousarray(values, dtype=np.float64))

    def ints(self, values: Any) -> int:
        """Address of values as C ints."""
        return self.address(np.ascontiguousarray(values, dtype=np.int32))

    def address(self, array: np.ndarray) -> int:
        """Address of an array in one piece; 0 of an empty one."""
        if not array.size:
            return 0
        self._kept.append(array)
        try:
            return ctypes.addressof(c_char.from_buffer(array.data))  # a fifth of the time that array.ctypes takes
        except TypeError:  # read-only
            return int(array.ctypes.data)


def _entry(code: Code, k: int) -> Any:
    """A function for the engine: compiled if it is."""
    if code.library is not None:
        address, work = code.entry(k)
        return FUNCTION(code=address, work=work + 1)
    tape: Tape = code.tapes[k]
    return FUNCTION(
        tape=tape.instructions.ctypes.data,
        constants=tape.constants.ctypes.data,
        count=tape.size,
        work=tape.work + 1,
    )
