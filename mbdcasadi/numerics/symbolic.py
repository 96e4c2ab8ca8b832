"""One thread at a time works with expressions.

CasADi leaves Python's own lock while it works, and is not safe then: with eight threads that derive, substitute or
differentiate expressions at the same time it corrupts memory, in ``substitute`` and ``simplify`` within seconds, in
functions that are applied to expressions rarely (CasADi 3.8.2, although references are counted safely). Functions that
are called with numbers are safe, and so is a solver that belongs to one thread.

An analysis therefore holds :data:`LOCK` while it prepares its functions, and gives it up while it computes.
"""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import ParamSpec, TypeVar

P = ParamSpec("P")
T = TypeVar("T")

#: Held by the thread that works with expressions; it may take it several times.
LOCK = threading.RLock()
if hasattr(os, "register_at_fork"):  # a child process must not inherit the lock of a thread that it does not have
    os.register_at_fork(after_in_child=LOCK._at_fork_reinit)  # type: ignore[attr-defined]


def symbolic(function: Callable[P, T]) -> Callable[P, T]:
    """Decorate a function that works with expressions: no other such function runs meanwhile."""

    @wraps(function)
    def locked(*args: P.args, **kwargs: P.kwargs) -> T:
        with LOCK:
            return function(*args, **kwargs)

    return locked


@contextmanager
def numeric_work() -> Iterator[None]:
    """Let other threads work with expressions while this one computes with numbers."""
    held = LOCK._is_owned()  # type: ignore[attr-defined]
    # however often it was taken, as threading.Condition does
    state = LOCK._release_save() if held else None  # type: ignore[attr-defined]
    try:
        yield
    finally:
        if held:
            LOCK._acquire_restore(state)  # type: ignore[attr-defined]
