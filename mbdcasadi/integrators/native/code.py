"""Functions as tapes that are interpreted, and as a library once compiling them pays."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache

import casadi as ca
import numpy as np

from ...numerics.c_code import Tape, simplified, tape_of
from ...numerics.lazy import cached_property
from . import build

#: Optimisation of equations: more gives nothing (measured), and takes twice the time.
OPTIMISATION = "-O1"
#: Changes whenever what is written changes.
FORMAT = "4"
#: Time to compile, s: at least, and by instruction (measured with gcc 12).
COMPILING, COMPILING_BY_INSTRUCTION = 0.08, 1.4e-4
#: Share of the time of the interpreter that compiled code saves.
SAVED = 0.7


@cache
def package_version() -> str:
    """Version of this package."""
    from importlib.metadata import PackageNotFoundError, version  # imports e-mail and archives

    try:
        return version("mbdcasadi")
    except PackageNotFoundError:
        return "unknown"


@dataclass(frozen=True, eq=False)
class Written:
    """C code of functions, written with loops instead of from their instructions.

    Attributes
    ----------
    shared : str
        Code before them: tables and functions that they share.
    bodies : mapping
        By the name of a function its definition, and the length of the work array that it needs.
    size : int
        Number of instructions.
    opened : callable, optional
        Called with the path of the library, which contains the shared functions too.
    """

    shared: str
    bodies: Mapping[str, tuple[str, int]]
    size: int
    opened: Callable[[str], None] | None = None


class Code:
    """Some functions, interpreted at first, and compiled together once that pays.

    They are compiled when interpreting has cost as much time as compiling takes, or will: so a run is
    never much slower than the better of the two would have been.

    Parameters
    ----------
    functions : sequence of casadi.Function
        ``SX`` functions.
    written : Written, optional
        Code of some of them. These are not interpreted, so that all must be compiled.

    Attributes
    ----------
    library : ctypes.CDLL or None
        The compiled functions.
    spent : float
        Time that interpreting them has taken so far, s.
    note : str
        Compiler and time, or the reason for which they are not compiled, in words.
    """

    def __init__(self, functions: Sequence[ca.Function], written: Written | None = None):
        self._written = written
        self._bodies = {} if written is None else written.bodies
        self.functions = [f if f.name() in self._bodies else simplified(f) for f in functions]
        self.library: ctypes.CDLL | None = None
        self.spent = 0.0
        self.note = ""
        self._given_up = False
        self._looked_for: tuple[build.Compiler, str] | None = None
        self._lock = threading.Lock()

    @cached_property
    def tapes(self) -> list[Tape]:
        """Their instructions, of which a library that was built before has no need.

        Raises
        ------
        UnsupportedOperation
            For a function that is not written as C.
        """
        return [_no_tape(f) if f.name() in self._bodies else tape_of(f) for f in self.functions]

    @cached_property
    def size(self) -> int:
        """Number of instructions."""
        count = sum(f.n_instructions() for f in self.functions if f.name() not in self._bodies)
        return count + (0 if self._written is None else self._written.size)

    @property
    def price(self) -> float:
        """Estimate of the time to compile, s."""
        return COMPILING + COMPILING_BY_INSTRUCTION * self.size

    def entry(self, k: int) -> tuple[int, int]:
        """Address of a function in the library, and the size of its work array."""
        assert self.library is not None
        name = self.functions[k].name()
        address = ctypes.cast(getattr(self.library, name), ctypes.c_void_p).value
        return int(address or 0), int(ctypes.c_longlong.in_dll(self.library, f"{name}_work").value)

    def look_for_library(self, using: build.Compiler) -> None:
        """Open the library if it was built before."""
        if self.library is not None or not self.size:
            return
        place = using, str(build.cache_folder())
        if self._looked_for != place:
            self._looked_for = place
            self.library = build.find(self._key(using))
            if self.library is not None:
                self.note = "compiled equations, kept from before"

    def pays(self, coming: float) -> bool:
        """Return True if compiling pays before interpreting them for so many seconds more."""
        waits = self.library is None and not self._given_up
        return waits and SAVED * (self.spent + coming) > self.price

    def compile(self, using: build.Compiler) -> None:
        """Compile them, or note why not."""
        with self._lock:
            if self.library is not None or self._given_up:
                return
            began = time.perf_counter()
            try:
                self.library = build.build(self._key(using), self._source(), OPTIMISATION, using)
            except build.CompilationError as error:
                self._given_up, self.note = True, f"interpreted equations: {error}"
                return
            self.note = f"equations compiled by {using.name} in {time.perf_counter() - began:.2g} s"

    def _source(self) -> str:
        parts = ["#include <math.h>\n", "" if self._written is None else self._written.shared]
        for tape in self.tapes:
            name = tape.function.name()
            text, work = self._bodies.get(name) or (tape.as_c, tape.work_in_c)
            parts += [text, f"const long long {name}_work = {work};\n"]
        return "\n".join(parts)

    def _key(self, using: build.Compiler) -> str:
        if not hasattr(self, "_serialised"):
            whole = self._written is None
            self._serialised = [f.serialize() for f in self.functions] if whole else [self._source()]
        return build.key_of(FORMAT, package_version(), using.identity, OPTIMISATION, *build.FLAGS, *self._serialised)


def _no_tape(function: ca.Function) -> Tape:
    """A tape without instructions, of a function that is not interpreted."""
    return Tape(function, np.zeros((0, 4), np.int32), np.zeros(0), 0)
