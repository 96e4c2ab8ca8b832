"""Programs and solvers of a problem, kept for the next solve and shared among threads."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

from ...model.cache import Cache
from ...numerics.symbolic import LOCK

Made = TypeVar("Made")

#: Programs of a problem that are kept: those of the meshes of a refinement, and some more.
PROGRAMS = 24
#: Setups and ranks of conditions that are kept: one for each set of parameter values.
SETUPS = 4
#: Sets of options for which the idle solvers of a program are kept.
OPTION_SETS = 8


class CompiledProblem:
    """Programs of a problem and what they are made of, each made once and used by all solves.

    It belongs to the problem and is released with it; only the most recent entries are kept.
    Any number of threads may use it.
    """

    def __init__(self) -> None:
        #: programs by what decides them besides the problem
        self.programs = Cache(PROGRAMS)
        #: setups of phases whose start is a state, by settings and parameter values
        self.setups = Cache(SETUPS)
        #: ranks of conditions, by phase and parameter values
        self.ranks = Cache(SETUPS)
        #: kinks of its costs and of its path conditions, in words
        self.kinks = Cache()


class SolverPool:
    """Solvers of one program, each lent to one solve at a time.

    A solver holds the statistics of its last solve and calls back to Python: no two threads share one.
    """

    def __init__(self) -> None:
        self._idle: OrderedDict[Hashable, list[Any]] = OrderedDict()

    @property
    def idle(self) -> int:
        """Number of solvers that are kept and not in use."""
        with LOCK:
            return sum(map(len, self._idle.values()))

    @contextmanager
    def lent(self, key: Hashable, make: Callable[[], Made]) -> Iterator[Made]:
        """Lend the solver of a key, made if none is idle; leaving the context returns it."""
        with LOCK:
            idle = self._idle.setdefault(key, [])
            self._idle.move_to_end(key)
            while len(self._idle) > OPTION_SETS:
                self._idle.popitem(last=False)
            solver: Made = idle.pop() if idle else make()
        try:
            yield solver
        finally:
            idle.append(solver)
