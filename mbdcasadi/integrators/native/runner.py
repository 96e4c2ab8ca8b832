"""The choice of what runs a method in C: the equations compiled, or interpreted."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from functools import partial
from typing import ClassVar

import casadi as ca
import numpy as np

from ...errors import SimulationError
from ...model.cache import Cache
from ...numerics.c_code import UnsupportedOperation
from ...numerics.lazy import cached_property
from . import build
from .code import Code
from .run import NativeRun, engine
from .stretch import Cases, ExplicitSystem, Progress, Reached, Stretch, Watched

#: Operations of equations, once a step, and least number of steps after which a run comes back: for progress, and the
#: choice to compile.
SLICE, SHORTEST_SLICE = 10_000_000, 20


class Runner(ABC):
    """Runs one system by a method in C, with compiled equations where that pays; base class of those of the methods.

    Parameters
    ----------
    system : ExplicitSystem
        The equations.
    watched : Watched or None
        Events.
    cache : Cache
        Of the mechanism: what is compiled serves later runs with the same functions.
    compiles : bool
        True if the equations are compiled at once, and not only once that pays.

    Attributes
    ----------
    method, instead : str
        Name of the method, and the argument of those to take where there is no C.
    run : NativeRun
        What runs it now: another one once compiled code is there.
    note : str
        Code that runs, and the reason, in words.

    Raises
    ------
    SimulationError
        Without a C compiler, with one that fails, and for operations that are not written as C.
    """

    method: ClassVar[str]
    instead: ClassVar[str]

    def __init__(self, system: ExplicitSystem, watched: Watched | None, cache: Cache, *, compiles: bool = False):
        self.system, self.watched = system, watched
        self._cache, self._compiles = cache, compiles
        self._codes: tuple[Code, ...] = ()
        self.note = ""
        using = build.compiler()
        if using is None:
            raise self._refusal(
                f"{build.no_compiler()}: install gcc or clang, or set $CC to the command of a C compiler"
            )
        self._using = using
        self.run = self._made()

    @staticmethod
    @abstractmethod
    def _steps() -> str:
        """C code of the method, with its ``mbd_advance``."""

    def _refusal(self, reason: str) -> SimulationError:
        return SimulationError(f'method="{self.method}" runs in C alone, and {reason}; or take {self.instead}')

    # --- what runs ---------------------------------------------------------------------------
    def _made(self) -> NativeRun:
        try:
            self._library = engine(self._steps(), self._using)
            self._codes = self._code()
        except build.CompilationError as error:
            raise self._refusal(str(error)) from None
        for code in self._codes:
            self._open(code)
        if self._compiles:
            self._compile(np.inf)
        return self._native()

    def _open(self, code: Code) -> None:
        """Look for a library of a code that was built before; raise if there is none and it cannot be interpreted."""
        code.look_for_library(self._using)
        try:
            _ = code.library or code.tapes
        except UnsupportedOperation as error:
            raise self._refusal(str(error)) from None

    def _native(self) -> NativeRun:
        """A run in C with what is compiled now."""
        self._describe()
        return NativeRun(self._library, self.system, self._codes, self.watched)

    def take_compiled(self) -> None:
        """Run the compiled code that there is now: others may have compiled it since."""
        if not self.run.is_current:
            self.run = self._native()
        else:
            self._describe()

    def _code(self) -> tuple[Code, ...]:
        s = self.system
        event = None if self.watched is None else self.watched.function

        def made() -> tuple[Code, ...]:
            parts: list[tuple[ca.Function, ...]] = [tuple(s.functions.values()), (s.input,)]
            parts += [] if event is None else [(event,)]
            codes = [
                self._cache.get_or_create(("code", *functions), partial(Code, functions)) for functions in parts[1:]
            ]
            return tuple([self._mechanism_code(parts[0]), *codes])

        if s.written is not None:
            return made()
        return self._cache.get_or_create(("codes", s, event), made, bounded=True)

    def _mechanism_code(self, functions: tuple[ca.Function, ...]) -> Code:
        """Code of the mechanism: what is written with loops is compiled at once."""
        written = self.system.written
        if written is not None:
            key = ("code with loops", *functions)
            code = self._cache.get_or_create(key, partial(Code, functions, written))
            code.look_for_library(self._using)
            code.compile(self._using)
            if code.library is not None:
                if written.opened is not None:
                    written.opened(code.library._name)
                return code
            if self.system.slopes is not None:
                raise build.CompilationError(code.note)
        return self._cache.get_or_create(("code", *functions), partial(Code, functions))

    def _compile(self, coming: float) -> None:
        """Compile what pays before interpreting for so many seconds more."""
        total = sum(code.size for code in self._codes) or 1
        for code in self._codes:
            if code.size and code.pays(coming * code.size / total):
                code.compile(self._using)

    def _describe(self) -> None:
        note = self._codes[0].note
        if self._codes[0].library is None and not note:
            note = f"interpreted equations: compiling them, about {self._codes[0].price:.2g} s, would not have paid"
        self.note = f"{self.method} ran in C, {note}"

    # --- running ------------------------------------------------------------------------------
    @property
    def is_interpreted(self) -> bool:
        """True if equations are interpreted that may be compiled."""
        return self._codes[0].library is None

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch, or a part of it."""
        if not self.is_interpreted:
            return self.run.advance(s, progress)
        began = time.perf_counter()
        reached = self.run.advance(s, progress)
        seconds = time.perf_counter() - began
        total = sum(code.size for code in self._codes) or 1
        for code in self._codes:
            code.spent += seconds * code.size / total
        end = float(s.times[-1])
        done = (float(reached.times[-1]) - s.start) / (end - s.start) if reached.times.size else 0.0
        self._compile(seconds * (1 - done) / done if done > 0 else 0.0)
        self.take_compiled()
        return reached

    def code_of(self, output: ca.Function) -> Code:
        """Code of a further function, as for the outputs of cases.

        Raises
        ------
        SimulationError
            For operations that are not written as C.
        """
        code = self._cache.get_or_create(("code", output), lambda: Code((output,)))
        self._open(code)
        return code

    def run_cases(
        self, cases: Cases, common: Stretch, output: ca.Function, values: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Run cases one after the other; see :meth:`NativeRun.run_cases`."""
        code = self.code_of(output)
        if self._compiles and code.pays(np.inf):
            code.compile(self._using)
        return self.run.run_cases(cases, common, code, values)

    @cached_property
    def slice(self) -> int:
        """Steps after which a call is to come back: not a time, on which results of a busy machine would hang."""
        size = self.system.dynamics.n_instructions() + self.system.projection.n_instructions()
        return max(SHORTEST_SLICE, SLICE // max(size, 1))
