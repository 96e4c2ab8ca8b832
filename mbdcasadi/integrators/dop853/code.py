"""Functions as tapes that are interpreted, and as a library once compiling them pays."""

from __future__ import annotations

import ctypes
import threading
import time
from collections.abc import Sequence
from functools import cache, cached_property
from importlib.metadata import PackageNotFoundError, version

import casadi as ca

from ...numerics.c_code import Tape, simplified, tape_of
from . import build

#: Optimisation of equations: more gives nothing (measured), and takes twice the time.
OPTIMISATION = "-O1"
#: Changes whenever what is written changes.
FORMAT = "1"
#: Time to compile, s: at least, and by instruction (measured with gcc 12).
COMPILING, COMPILING_BY_INSTRUCTION = 0.08, 1.4e-4
#: Share of the time of the interpreter that compiled code saves.
SAVED = 0.7


@cache
def package_version() -> str:
    """Version of this package."""
    try:
        return version("mbdcasadi")
    except PackageNotFoundError:
        return "unknown"


class Code:
    """Some functions, interpreted at first, and compiled together once that pays.

    What compiling costs is spent when interpreting has cost as much, or will: so a run is
    never much slower than the better of the two would have been.

    Parameters
    ----------
    functions : sequence of casadi.Function
        ``SX`` functions.

    Attributes
    ----------
    library : ctypes.CDLL or None
        The compiled functions.
    spent : float
        Time that interpreting them has taken so far, s.
    said : str
        Compiler and time, or the reason for which they are not compiled, in words.

    Raises
    ------
    UnsupportedOperation
        For a function that is not written as C.
    """

    def __init__(self, functions: Sequence[ca.Function]):
        self.functions = [simplified(f) for f in functions]
        self.tapes: list[Tape] = [tape_of(f) for f in self.functions]
        self.library: ctypes.CDLL | None = None
        self.spent = 0.0
        self.said = ""
        self._given_up = False
        self._looked_for: tuple[build.Compiler, str] | None = None
        self._lock = threading.Lock()

    @cached_property
    def size(self) -> int:
        """Number of instructions."""
        return sum(tape.size for tape in self.tapes)

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
                self.said = "compiled equations, kept from before"

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
            parts = ["#include <math.h>\n", *(tape.as_c for tape in self.tapes)]
            parts += [f"const long long {t.function.name()}_work = {t.work_in_c};\n" for t in self.tapes]
            try:
                self.library = build.build(self._key(using), "\n".join(parts), OPTIMISATION, using)
            except build.CompilationError as error:
                self._given_up, self.said = True, f"interpreted equations: {error}"
                return
            self.said = f"equations compiled by {using.name} in {time.perf_counter() - began:.2g} s"

    def _key(self, using: build.Compiler) -> str:
        if not hasattr(self, "_serialised"):
            self._serialised = [f.serialize() for f in self.functions]
        return build.key_of(FORMAT, package_version(), using.identity, OPTIMISATION, *build.FLAGS, *self._serialised)
