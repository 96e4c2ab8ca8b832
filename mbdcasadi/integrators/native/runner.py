"""The choice of what runs a method: C with the equations compiled or interpreted, or what does without C."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from functools import partial
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

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


class Run(Protocol):
    """Runs of one system; one thread at a time. See :class:`NativeRun`."""

    @property
    def is_current(self) -> bool: ...

    def halt(self) -> None: ...

    def advance(self, s: Stretch, progress: Progress) -> Reached: ...

    def complete(
        self, times: np.ndarray, x: np.ndarray, channels: np.ndarray, p: np.ndarray, levels: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]: ...


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
    method : str
        Name of the method.
    run : Run
        What runs it now: another one once compiled code is there.
    said : str
        Code that runs, and the reason, in words.
    """

    method: ClassVar[str]

    def __init__(self, system: ExplicitSystem, watched: Watched | None, cache: Cache, *, compiles: bool = False):
        self.system, self.watched = system, watched
        self._cache, self._compiles = cache, compiles
        self._codes: tuple[Code, ...] = ()
        self._using = build.compiler()
        self.said = ""
        self.run: Run = self._made(self._using)

    @staticmethod
    @abstractmethod
    def _steps() -> str:
        """C code of the method, with its ``mbd_advance``."""

    @abstractmethod
    def _without_c(self, reason: str) -> Run:
        """Return what runs the method without C, or raise for the reason that there is none."""

    # --- what runs ---------------------------------------------------------------------------
    def _made(self, using: build.Compiler | None) -> Run:
        if using is None:
            return self._without_c(build.no_compiler())
        try:
            self._library = engine(self._steps(), using)
            self._codes = self._code(using)
            for code in self._codes:
                code.look_for_library(using)
                if code.library is None:
                    _ = code.tapes  # raises for what cannot be interpreted
        except (build.CompilationError, UnsupportedOperation) as error:
            return self._without_c(str(error))
        if self._compiles:
            self._compile(using, np.inf)
        return self._native()

    def _native(self) -> NativeRun:
        """A run in C with what is compiled now."""
        self._describe()
        return NativeRun(self._library, self.system, self._codes, self.watched)

    def take_compiled(self) -> None:
        """Run the compiled code that there is now: others may have compiled it since."""
        if not self.run.is_current:
            self.run = self._native()
        elif isinstance(self.run, NativeRun):
            self._describe()

    def _code(self, using: build.Compiler) -> tuple[Code, ...]:
        s = self.system
        event = None if self.watched is None else self.watched.function

        def made() -> tuple[Code, ...]:
            parts: list[tuple[ca.Function, ...]] = [tuple(s.functions.values()), (s.input,)]
            parts += [] if event is None else [(event,)]
            codes = [
                self._cache.get_or_create(("code", *functions), partial(Code, functions)) for functions in parts[1:]
            ]
            return tuple([self._mechanism_code(parts[0], using), *codes])

        if s.written is not None:
            return made()
        return self._cache.get_or_create(("codes", s, event), made, bounded=True)

    def _mechanism_code(self, functions: tuple[ca.Function, ...], using: build.Compiler) -> Code:
        """Code of the mechanism: what is written with loops is compiled at once."""
        written = self.system.written
        if written is not None:
            key = ("code with loops", *functions)
            code = self._cache.get_or_create(key, partial(Code, functions, written))
            code.look_for_library(using)
            code.compile(using)
            if code.library is not None:
                if written.opened is not None:
                    written.opened(code.library._name)
                return code
            if self.system.slopes is not None:
                raise build.CompilationError(code.said)
        return self._cache.get_or_create(("code", *functions), partial(Code, functions))

    def _compile(self, using: build.Compiler, coming: float) -> None:
        """Compile what pays before interpreting for so many seconds more."""
        total = sum(code.size for code in self._codes) or 1
        for code in self._codes:
            if code.size and code.pays(coming * code.size / total):
                code.compile(using)

    def _describe(self) -> None:
        said = self._codes[0].said
        if self._codes[0].library is None and not said:
            said = f"interpreted equations: compiling them, about {self._codes[0].price:.2g} s, would not have paid"
        self.said = f"{self.method} ran in C, {said}"

    # --- running ------------------------------------------------------------------------------
    @property
    def is_interpreted(self) -> bool:
        """True if equations are interpreted that may be compiled."""
        return isinstance(self.run, NativeRun) and self._codes[0].library is None

    def advance(self, s: Stretch, progress: Progress) -> Reached:
        """Integrate over a stretch, or a part of it."""
        if self._using is None or not self.is_interpreted:
            return self.run.advance(s, progress)
        began = time.perf_counter()
        reached = self.run.advance(s, progress)
        seconds = time.perf_counter() - began
        total = sum(code.size for code in self._codes) or 1
        for code in self._codes:
            code.spent += seconds * code.size / total
        end = float(s.times[-1])
        done = (float(reached.times[-1]) - s.start) / (end - s.start) if reached.times.size else 0.0
        self._compile(self._using, seconds * (1 - done) / done if done > 0 else 0.0)
        self.take_compiled()
        return reached

    def run_cases(self, cases: Cases, common: Stretch, output: ca.Function, values: np.ndarray) -> Any:
        """Run cases one after the other in C; see :meth:`NativeRun.run_cases`. None without C."""
        if self._using is None or not isinstance(self.run, NativeRun):
            return None
        code = self._cache.get_or_create(("code", output), lambda: Code((output,)))
        code.look_for_library(self._using)
        try:
            if self._compiles and code.pays(np.inf):
                code.compile(self._using)
            return self.run.run_cases(cases, common, code, values)
        except UnsupportedOperation as error:
            self._describe()
            self.said += f"; the outputs of each case by CasADi: {error}"
            return None

    @cached_property
    def slice(self) -> int:
        """Steps after which a call is to come back: not a time, on which results of a busy machine would hang."""
        size = self.system.dynamics.n_instructions() + self.system.projection.n_instructions()
        return max(SHORTEST_SLICE, SLICE // max(size, 1))
